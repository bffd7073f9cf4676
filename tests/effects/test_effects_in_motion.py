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
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.effects import load_library
from taichi_erosion.scene.sample import SAMPLE
from taichi_erosion.simulation import advance, assemble, prepare, snapshot

THIRD_PARTY = Path(__file__).with_name("constant_pull.py")
LIBRARY = load_library([THIRD_PARTY])
WET = {"moisture": 0.02}
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


@pytest.mark.parametrize("name", [n for n, e in LIBRARY.items() if e.place == "pair" and n != "image_charge"])
def test_two_grains_that_pull_each_other_keep_their_momentum(name):
    # unequal grains graze each other and part again, which every pair effect feels somewhere
    table = grains(
        [[0.0, 0.0, 0.0], [1.98 * RADIUS, 0.3 * RADIUS, 0.0]], [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.02]]
    )
    table = replace(table, radius=np.array([RADIUS, 1.1 * RADIUS]), mass=np.array([MASS, 1.3 * MASS]))
    bare = setup(table, NONE, gravity=(0.0, 0.0, 0.0), law=contacts(0.5))
    sim = assemble([bare, with_effects(bare, **{name: 50.0})], LAWS, Numerics("cpu", 1, "f64"))
    advance(sim, [5e-3, 5e-3])
    without, with_it = (snapshot(sim, r) for r in range(2))
    mass = table.mass[:, None]
    before = (mass * table.velocity).sum(axis=0)
    assert not np.allclose(with_it.velocity, without.velocity, rtol=1e-9), "it must have acted"
    # f64 sums of some hundred steps
    assert (mass * with_it.velocity).sum(axis=0) == pytest.approx(before, abs=1e-12 * MASS)


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


def test_a_sticky_grain_hangs_from_another_up_to_its_pull_off_force():
    # gravity pulls the lower grain away with less, and with more, than the pull of the effect
    pull = LIBRARY["constant_pull"].params().pull_off
    weight = {"held": 0.8 * pull, "lost": 1.2 * pull}
    table = grains([[0.0, 0.0, 0.0], [0.0, 0.0, -2.0 * RADIUS]])
    soft = 0.5 * (pull / (4.0 / 3.0 * YOUNG * sqrt(0.5 * RADIUS))) ** (2.0 / 3.0)  # overlap near balance [m]
    table = replace(table, position=table.position * (1.0 - soft / (2.0 * RADIUS)))
    table = replace(table, mass=np.array([1e9 * MASS, MASS]))
    setups = [
        with_effects(setup(table, NONE, gravity=(0.0, 0.0, -w / MASS)), constant_pull=1.0)
        for w in weight.values()
    ]
    sim = assemble(setups, LAWS, Numerics("cpu", 1, "f64"))
    advance(sim, [0.01, 0.01])
    apart = [np.ptp(snapshot(sim, r).position[:, 2]) > 2.0 * RADIUS for r in range(2)]
    assert apart == [False, True]


def test_effects_of_strength_nought_leave_the_setup_as_it_is():
    from taichi_erosion.scene import parse_scene

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


def test_a_file_from_outside_the_package_acts_in_a_run(scene_file, capsys):
    words = ["run", str(scene_file), "--no-record", "--json", "--set", "effects.constant_pull.strength=1.0"]
    assert main(words) == 2
    assert "effects.constant_pull is unknown" in capsys.readouterr().err
    assert main([*words, "--effect", str(THIRD_PARTY)]) == 0
    assert json.loads(capsys.readouterr().out)["resolved"]["effects"] == {"constant_pull": {"strength": 1.0}}


def test_an_instrument_shows_its_value_and_notes_the_true_one(scene_file, capsys):
    words = ["run", str(scene_file), "--no-record", "--json", "--set", "measure.angle_of_repose.plate=plate"]
    assert main(words) == 0
    true = json.loads(capsys.readouterr().out)["measures"]["pile_height"]
    assert main([*words, "--set", "effects.repose_method.strength=1.0"]) == 0
    assert json.loads(capsys.readouterr().out)["measures"]["pile_height"]["value"] == true["value"]


def test_a_scene_that_its_effects_make_impossible_is_refused_in_one_line(scene_file, capsys):
    orders = ["effects.side_walls.strength=1.0", "effects.side_walls.width=1e4", "conditions.slope=5.0"]
    words = [word for order in orders for word in ("--set", order)]
    assert main(["run", str(scene_file), "--no-record", "--check", *words]) == 0
    capsys.readouterr()
    twice = ["--set", "effects.sheltering.strength=1.0", "--set", "effects.size_distribution.strength=1.0"]
    assert main(["run", str(scene_file), "--no-record", *twice]) == 2
    assert "effects.size_distribution: grains.size has a distribution already" in capsys.readouterr().err
