"""Effects in the simulation: paired forces, replicas with and without, files from outside the package."""

import json
from collections.abc import Iterator
from dataclasses import replace
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from grain_worlds import MASS, NONE, RADIUS, TIME_STEP, YOUNG, contacts, fingerprint, grains, heap, setup

from taichi_erosion.cli.main import main
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.effect import Acting, acting
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.effects import load_library
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.run.instruments import as_read
from taichi_erosion.scene import parse_scene
from taichi_erosion.scene.sample import SAMPLE
from taichi_erosion.simulation import advance, assemble, prepare, snapshot

THIRD_PARTY = Path(__file__).with_name("constant_pull.py")
LIBRARY = load_library([THIRD_PARTY])
WET = {"moisture": 0.02}
NO_HEAP = no_measurement("pile_height", "m", "no heap")
LAWS = Laws(rolling="elastic_plastic")


@pytest.fixture(autouse=True)
def device() -> Iterator[None]:
    yield
    stop_device()


def with_effects(bare: Setup, **strengths: float) -> Setup:
    """Pair and grain effects at their default parameters; those of strength 0 are left out."""
    found: list[Acting] = [
        acting(LIBRARY[name], LIBRARY[name].params(), strength, WET, RADIUS)
        for name, strength in strengths.items()
        if strength > 0.0
    ]
    return replace(bare, effects=tuple(found))


def motion(setups: list[Setup], until: float) -> list[str]:
    sim = assemble(setups, LAWS, Numerics("cpu", 1))
    advance(sim, [until] * len(setups))
    return [fingerprint(snapshot(sim, r)) for r in range(len(setups))]


def test_a_replica_without_effects_moves_as_the_bare_model_beside_replicas_with_them():
    bare = heap(60, 1)
    (alone,) = motion([bare], 0.02)
    sticky = {"dry_adhesion": 100.0, "liquid_bridge": 30.0, "restitution_speed": 1.0}
    wet, dry, again, half = motion(
        [
            with_effects(bare, **sticky),
            with_effects(bare, liquid_bridge=0.0),
            with_effects(bare, **sticky),
            with_effects(bare, liquid_bridge=15.0),
        ],
        0.02,
    )
    assert dry == alone
    assert wet == again
    assert len({alone, wet, half}) == 3


def test_grains_that_pull_each_other_keep_their_momentum():
    # unequal grains meet, graze each other and part again, which every effect of pairs feels somewhere
    place = [[0.0, 0.0, 0.0], [2.1 * RADIUS, 0.3 * RADIUS, 0.0]]
    table = grains(place, [[0.05, 0.0, 0.0], [-0.05, 0.0, 0.02]])
    table = replace(table, radius=np.array([RADIUS, 1.1 * RADIUS]), mass=np.array([MASS, 1.3 * MASS]))
    bare = setup(table, NONE, gravity=(0.0, 0.0, 0.0), law=contacts(0.5))
    names = [name for name, effect in LIBRARY.items() if effect.place == "pair" and name != "image_charge"]
    each = [with_effects(bare, **{name: 50.0}) for name in names]
    sim = assemble([bare, *each], LAWS, Numerics("cpu", 1, "f64"))
    advance(sim, [5e-3] * (1 + len(names)))
    bare_velocity, *velocities = (snapshot(sim, r).velocity for r in range(1 + len(names)))
    momentum = table.mass @ table.velocity
    for name, velocity in zip(names, velocities, strict=True):
        assert not np.allclose(velocity, bare_velocity, rtol=1e-9), f"{name} must have acted"
        # f64 sums of 500 steps
        assert table.mass @ velocity == pytest.approx(momentum, abs=1e-12 * MASS), name


def test_a_grain_of_restitution_one_loses_what_kuwabara_and_kono_say():
    params = LIBRARY["restitution_speed"].params(loss=0.02, speed=0.1)
    table = grains([[0.0, 0.0, 0.0], [2.001 * RADIUS, 0.0, 0.0]], [[0.05, 0.0, 0.0], [-0.05, 0.0, 0.0]])
    bare = setup(table, NONE, gravity=(0.0, 0.0, 0.0), law=contacts(0.0, restitution=1.0))
    lossy = replace(bare, effects=(acting(LIBRARY["restitution_speed"], params, 1.0, {}, RADIUS),))
    fine = replace(lossy, time_step=0.1 * TIME_STEP)
    sim = assemble([fine], LAWS, Numerics("cpu", 1, "f64"))
    advance(sim, [2e-3])
    rebound = np.diff(snapshot(sim, 0).velocity[:, 0])[0] / 0.1
    # the next order of e(v) is 3/5 loss^2: 1 % of the loss
    assert 1.0 - rebound == pytest.approx(0.02, rel=0.02)


def test_a_grain_hangs_from_a_ceiling_up_to_its_pull_off_force():
    # the floor is a ceiling when gravity points up; the grain starts where pull and repulsion balance
    pull = LIBRARY["constant_pull"].params().pull_off
    overlap = (pull / (4.0 / 3.0 * YOUNG * sqrt(RADIUS))) ** (2.0 / 3.0)
    table = grains([0.0, 0.0, RADIUS - overlap])
    weights = [0.8 * pull, 1.2 * pull]
    setups = [
        with_effects(setup(table, gravity=(0.0, 0.0, weight / MASS)), constant_pull=1.0) for weight in weights
    ]
    sim = assemble(setups, LAWS, Numerics("cpu", 1, "f64"))
    advance(sim, [0.02, 0.02])
    held, lost = (snapshot(sim, r).position[0, 2] for r in range(2))
    assert held < RADIUS < lost


def test_effects_of_strength_nought_leave_the_setup_as_it_is():
    bare = prepare(parse_scene(SAMPLE), 1, LIBRARY)
    off = parse_scene(SAMPLE | {"effects": {name: {"strength": 0.0} for name in LIBRARY}})
    same = prepare(off, 1, LIBRARY)
    assert same.effects == ()
    assert same.time_step == bare.time_step
    for column in ("position", "velocity", "radius", "mass"):
        assert np.array_equal(getattr(same.grains, column), getattr(bare.grains, column))
    for column in ("restitution", "friction_rolling", "friction_sliding"):
        assert np.array_equal(getattr(same.contacts, column), getattr(bare.contacts, column))


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    import tomli_w

    path = tmp_path / "sample.toml"
    stage = {"name": "settle", "until": "time", "duration_max": 2e-4}
    measure = {"pile_height": {"plate": "plate"}}
    path.write_text(tomli_w.dumps(SAMPLE | {"stages": [stage], "measure": measure}), encoding="utf-8")
    return path


def test_a_file_from_outside_the_package_acts_in_a_run_and_an_instrument_is_noted(scene_file, capsys):
    on = ["effects.constant_pull.strength=1.0", "effects.repose_method.strength=1.0"]
    words = ["run", str(scene_file), "--no-record", "--json", *(w for order in on for w in ("--set", order))]
    assert main(words) == 2
    assert "effects.constant_pull is unknown" in capsys.readouterr().err
    assert main([*words, "--effect", str(THIRD_PARTY)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["resolved"]["effects"]["constant_pull"] == {"strength": 1.0}
    assert "before repose_method" not in str(document["measures"]["pile_height"]["notes"])


def test_what_an_instrument_shows_replaces_the_value_and_names_the_true_one():
    scene = parse_scene(SAMPLE | {"effects": {"repose_method": {"strength": 0.5, "ratio": 0.8}}})
    true = {"repose_angle": Measurement("repose_angle", 30.0, 1.0, "deg"), "pile_height": NO_HEAP}
    shown = as_read(true, scene, LIBRARY)
    assert (shown["repose_angle"].value, shown["repose_angle"].sd) == pytest.approx((27.0, 0.9))
    assert shown["repose_angle"].notes == ("30 deg before repose_method",)
    assert shown["pile_height"] is NO_HEAP


def test_effects_that_contradict_each_other_are_refused_in_one_line():
    both = {name: {"strength": 1.0} for name in ("sheltering", "size_distribution")}
    with pytest.raises(
        BadInput, match=r"effects\.size_distribution: grains\.size has a distribution already"
    ):
        prepare(parse_scene(SAMPLE | {"effects": both}), 1, LIBRARY)


def test_a_scene_that_its_effects_make_impossible_is_refused_like_a_file():
    tiny = parse_scene(SAMPLE | {"effects": {"grain_shape": {"strength": 1.0}, "side_walls": {"width": 3.0}}})
    lost = parse_scene(
        SAMPLE | {"run": {"time_step": 9e-6}, "effects": {"size_distribution": {"spread": 3.0}}}
    )
    assert prepare(tiny, 1, LIBRARY).clumps is not None
    with pytest.raises(BadInput, match="with its effects"):
        prepare(lost, 1, LIBRARY)
