"""Effects in the simulation: paired forces, replicas with and without, scenes and results they change."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from grain_worlds import MASS, NONE, RADIUS, TIME_STEP, YOUNG, contacts, fingerprint, grains, heap, setup
from own_effects import LIBRARY, acted_on

from taichi_erosion.core.effect import replica_effect
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Laws, Numerics, Setup, pair_row
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.execution.result import apply_instruments
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.scene import parse_scene
from taichi_erosion.scene.change import SAMPLE
from taichi_erosion.simulation import advance, assemble, export_state, prepare, snapshot
from tests.verification.small_scenes import final_states

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
WET = {"moisture": 0.02}
NO_HEAP = no_measurement("pile_height", "m", "no heap")
LAWS, WEIGHTLESS = Laws(rolling="elastic_plastic"), (0.0, 0.0, 0.0)


def with_effects(bare: Setup, **strengths: float) -> Setup:
    """Pair and grain effects at their default parameters."""
    named = [(LIBRARY[name], strength) for name, strength in strengths.items()]
    return replace(bare, effects=tuple(replica_effect(e, e.params(), s, WET, RADIUS) for e, s in named))


def fallen() -> dict[str, Setup]:
    """A heap bare, and with effects that make grains stick."""
    bare = heap(60, 1)
    sticky = {"dry_adhesion": 100.0, "liquid_bridge": 30.0, "restitution_speed": 1.0}
    wet, again = with_effects(bare, **sticky), with_effects(bare, **sticky)
    damp = with_effects(bare, liquid_bridge=15.0)
    return {"wet heap": wet, "dry heap": bare, "wet heap again": again, "damp heap": damp}


def met() -> Setup:
    """Unequal grains meet, graze each other and part again, which every effect of pairs feels somewhere."""
    place = [[0.0, 0.0, 0.0], [2.1 * RADIUS, 0.3 * RADIUS, 0.0]]
    table = grains(place, [[0.05, 0.0, 0.0], [-0.05, 0.0, 0.02]])
    table = replace(table, radius=np.array([RADIUS, 1.1 * RADIUS]), mass=np.array([MASS, 1.3 * MASS]))
    return setup(table, NONE, gravity=WEIGHTLESS, law=contacts(0.5))


def bounced() -> Setup:
    """Two grains of restitution 1 that lose the fiftieth part of their speed to the contact."""
    table = grains([[0.0, 0.0, 0.0], [2.001 * RADIUS, 0.0, 0.0]], [[0.5 * SPEED, 0, 0], [-0.5 * SPEED, 0, 0]])
    bare = setup(table, NONE, gravity=WEIGHTLESS, law=contacts(0.0, restitution=1.0))
    lossy = acted_on(bare, {}, restitution_speed={"loss": LOSS, "speed": SPEED})
    return replace(lossy, time_step=0.1 * TIME_STEP)


def crossing(high: float) -> Setup:
    """Two grains that fly towards each other, pass in mid-air, and a bed's surface at a height [m]."""
    table = grains([[-2.0 * RADIUS, 0.0, 0.0], [2.0 * RADIUS, 0.0, 0.0]], [[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]])
    known = {"bed_height": high, "grain_diameter": RADIUS}
    return acted_on(setup(table, NONE, gravity=WEIGHTLESS), known, midair_passing={})


def hanging(weight: float, acts: bool = True) -> Setup:
    """A grain that sticks to a ceiling, if effects act there: the floor of a world whose gravity points up.

    It starts where the repulsion is the excess of the pull over a weight of 0.8 of it.
    """
    overlap = (0.2 * PULL / (4.0 / 3.0 * YOUNG * sqrt(RADIUS))) ** (2.0 / 3.0)
    law = contacts()
    law.effects[pair_row(0, 1, 2)] = float(acts)
    bare = setup(grains([0.0, 0.0, RADIUS - overlap]), law=law, gravity=(0.0, 0.0, weight * PULL / MASS))
    return with_effects(bare, constant_pull=1.0)


LOSS, SPEED = 0.02, 0.1  # of restitution [1], at an impact at this speed [m s-1]
PULL = LIBRARY["constant_pull"].params().pull_off  # N
RESTING = ("image_charge", "surface_crust", "ageing_pull")  # of walls, and of grains that have lain still
MEETING = [name for name, effect in LIBRARY.items() if effect.place == "pair" and name not in RESTING]


@pytest.fixture(scope="module")
def worlds() -> dict[str, Snapshot]:
    """How all these worlds end; one ensemble, because every set of effects is compiled anew."""
    # a strong pull that does not act between their materials
    untouched = replace(contacts(0.5), effects=np.zeros(3))
    dry = replace(with_effects(met(), liquid_bridge=50.0), contacts=untouched)
    setups = fallen() | {"met": met(), "bounced": bounced(), "held": hanging(0.8), "lost": hanging(1.2)}
    setups |= {"let go": hanging(0.8, acts=False), "met as if dry": dry}
    setups |= {"in the air": crossing(-0.1), "in the bed": crossing(0.0)}
    setups |= {f"met with {name}": with_effects(met(), **{name: 50.0}) for name in MEETING}
    sim = assemble(list(setups.values()), LAWS, Numerics("cpu", 1, "f64"))
    advance(sim, [5e-3 if name.startswith("met") else 0.02 for name in setups])
    return {name: snapshot(sim, r) for r, name in enumerate(setups)}


def test_grains_that_have_not_touched_need_no_list_for_an_effect_after_touch():
    wet = with_effects(heap(60, 1), liquid_bridge=30.0)
    (bridge,) = wet.effects
    assert bridge.reach > 0.2 * RADIUS
    anywhere = replace(bridge, effect=replace(bridge.effect, after_touch=False))
    sim = assemble([wet, replace(wet, effects=(anywhere,))], LAWS, Numerics("cpu", 1, "f64"))
    advance(sim, [0.02, 0.02])
    short, long = (export_state(sim)[f"replica{r}_pair_number"].sum() for r in range(2))
    assert short < 0.8 * long
    assert np.allclose(*[snapshot(sim, r).position for r in range(2)], rtol=0.0, atol=1e-6 * RADIUS)


def test_a_replica_without_effects_moves_as_the_bare_model_beside_replicas_with_them(worlds):
    alone = fingerprint(final_states([heap(60, 1)], 0.02, "f64", LAWS)[0])
    wet, dry, again, damp = (fingerprint(worlds[name]) for name in fallen())
    assert dry == alone
    assert wet == again
    assert len({alone, wet, damp}) == 3


@pytest.mark.parametrize("name", MEETING)
def test_grains_that_pull_each_other_keep_their_momentum(name, worlds):
    table, velocity = met().grains, worlds[f"met with {name}"].velocity
    assert not np.allclose(velocity, worlds["met"].velocity, rtol=1e-9), "must have acted"
    # f64 sums of 500 steps
    assert table.mass @ velocity == pytest.approx(table.mass @ table.velocity, abs=1e-12 * MASS)


def test_a_grain_of_restitution_one_loses_what_kuwabara_and_kono_say(worlds):
    rebound = np.diff(worlds["bounced"].velocity[:, 0])[0] / SPEED
    # the next order of e(v) is 3/5 loss^2: 1 % of the loss
    assert 1.0 - rebound == pytest.approx(LOSS, rel=0.02)


def test_grains_pass_through_each_other_in_the_air_and_collide_in_the_bed(worlds):
    flown, bounced = (worlds[name].velocity[:, 0] for name in ("in the air", "in the bed"))
    assert list(flown) == [0.2, -0.2]
    assert bounced[0] < 0.0 < bounced[1]


def test_a_grain_hangs_from_a_ceiling_up_to_its_pull_off_force(worlds):
    held, lost = (worlds[name].position[0, 2] for name in ("held", "lost"))
    assert held < RADIUS < lost


def test_effects_leave_a_contact_alone_that_says_so(worlds):
    assert worlds["let go"].position[0, 2] > RADIUS, "a lighter grain would have held"
    assert np.array_equal(worlds["met as if dry"].velocity, worlds["met"].velocity)


def test_what_an_instrument_shows_replaces_the_value_and_names_the_true_one():
    scene = parse_scene(SAMPLE | {"effects": {"repose_method": {"strength": 0.5, "ratio": 0.8}}})
    true = {"repose_angle": Measurement("repose_angle", 30.0, 1.0, "deg"), "pile_height": NO_HEAP}
    shown = apply_instruments(true, scene, LIBRARY)
    assert (shown["repose_angle"].value, shown["repose_angle"].sd) == pytest.approx((27.0, 0.9))
    assert shown["repose_angle"].notes == ("30 deg before repose_method",)
    assert shown["pile_height"] is NO_HEAP


def test_effects_that_contradict_each_other_or_make_a_scene_impossible_are_refused_like_a_file():
    both = {name: {"strength": 1.0} for name in ("sheltering", "size_distribution")}
    with pytest.raises(BadInput, match=r"effects\.size_distribution: grains\.size has a distribution"):
        prepare(parse_scene(SAMPLE | {"effects": both}), 1, LIBRARY)
    shaped = {"grain_shape": {"strength": 1.0}, "side_walls": {"width": 9.0}}
    assert prepare(parse_scene(SAMPLE | {"effects": shaped}), 1, LIBRARY).clumps is not None
    wide = {"run": {"time_step": 9e-6}, "effects": {"size_distribution": {"spread": 3.0, "cut": 3.0}}}
    with pytest.raises(BadInput, match="with its effects"):
        prepare(parse_scene(SAMPLE | wide), 1, LIBRARY)
