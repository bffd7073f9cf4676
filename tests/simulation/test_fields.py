"""Fields on the device: small scenes share one size, and an ensemble takes those of one that has ended."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import NONE, PLATE, RADIUS, contacts, ends, grains, heap, setup
from own_effects import acted_on

from taichi_erosion.core.setup import ContactTable, Laws, Numerics, PrimitiveTable, Setup, Surface
from taichi_erosion.core.ti import impl
from taichi_erosion.simulation import assemble, energy_sums, export_state, reuse_or_assemble, set_contacts
from taichi_erosion.simulation.assemble import reallocate_fields
from taichi_erosion.simulation.capacities import initial_capacities
from taichi_erosion.simulation.step import release_grains_before_start

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
LAWS, NUMERICS = Laws(rolling="elastic_plastic"), Numerics("cpu", 1)
FALLEN = 0.01  # s, half way down
SLIPPERY = contacts(0.0, 0.0)


def with_effect(bare: Setup, name: str) -> Setup:
    return acted_on(bare, {"grain_diameter": 1e-3}, **{name: {}})


def three_materials(count: int, seed: int) -> Setup:
    """A heap of grains of the second of three materials: floor of the first, tube of the third."""
    own = heap(count, seed)
    columns = {name: np.full(6, values[0]) for name, values in vars(contacts(rolling=0.1)).items()}
    columns |= {"friction_sliding": np.linspace(0.0, 1.0, 6), "restitution": np.linspace(0.3, 0.8, 6)}
    return replace(
        own,
        grains=replace(own.grains, material=np.ones_like(own.grains.material)),
        materials=("earth", "soil", "steel"),
        contacts=ContactTable(**columns),
        surfaces=(Surface("floor", 0), Surface("tube", 2)),
    )


PLAIN, STICKY = heap(60, 1), with_effect(heap(80, 2), "surface_crust")
OTHERS = [heap(90, 3), three_materials(50, 2), with_effect(heap(40, 4), "surface_crust"), heap(20, 5)]


def test_what_runs_after_another_ensemble_comes_out_as_if_it_had_been_alone():
    """With few materials and many, with and without an effect, and with contacts that have changed."""
    alone = []
    for each in (*OTHERS, replace(OTHERS[0], contacts=SLIPPERY)):
        alone += ends(assemble([each], LAWS, NUMERICS), FALLEN)
    assert len(set(alone)) == len(alone)
    sim = assemble([PLAIN, STICKY, three_materials(90, 1), STICKY], LAWS, NUMERICS)
    ends(sim, FALLEN)
    for slips in (False, True):
        assert reuse_or_assemble(sim, OTHERS, LAWS, NUMERICS) is sim
        if slips:
            set_contacts(sim, 0, SLIPPERY)
        assert ends(sim, FALLEN) == [alone[-1] if slips else alone[0], *alone[1:-1]]


BESIDE, CHARGED = [PLAIN, STICKY], [with_effect(PLAIN, "electric_field")]


@pytest.mark.parametrize(
    ("first", "setups", "laws"),
    [
        (BESIDE, [PLAIN], replace(LAWS, rolling="none")),
        (BESIDE, [with_effect(PLAIN, "liquid_bridge")], LAWS),
        (BESIDE, CHARGED, LAWS),
        (BESIDE, [heap(200, 1)], LAWS),
        (CHARGED, [PLAIN], LAWS),  # an effect on single grains stays with ensembles that have it
    ],
)
def test_other_laws_other_effects_and_more_grains_get_fields_of_their_own(first, setups, laws):
    before = assemble(first, LAWS, NUMERICS)
    assert reuse_or_assemble(before, setups, laws, NUMERICS) is not before


UNTIL = 2e-3  # s, in which a grain that starts a radius above the plate has hit it


def row(count: int, walls: PrimitiveTable = PLATE) -> Setup:
    """Grains side by side, a radius above the plate, that fall on it at 1 m/s."""
    place = np.zeros((count, 3))
    place[:, 0], place[:, 2] = 1.99 * RADIUS * np.arange(count), 2.0 * RADIUS
    return setup(grains(place, velocity=(0.0, 0.0, -1.0)), walls)


@pytest.mark.parametrize("walls", [NONE, PLATE])
@pytest.mark.parametrize(("count", "replicas"), [(1, 1), (2, 40), (33, 7), (128, 64)])
def test_small_scenes_of_any_kind_get_the_same_room(count, replicas, walls):
    assert initial_capacities([row(count, walls)] * replicas) == initial_capacities([row(5)])


def test_a_scene_of_many_grains_gets_room_for_its_own_replicas_only():
    sizes = initial_capacities([row(200)] * 3)
    assert (sizes.replicas, sizes.primitives, sizes.surfaces) == (3, 1, 1)


@pytest.mark.slow
def test_room_that_stays_empty_changes_no_bit_of_a_result():
    sim = assemble([row(2), row(3)], LAWS, NUMERICS)
    start = export_state(sim)
    roomy = ends(sim, UNTIL)
    reallocate_fields(sim, replace(sim.capacities, replicas=2, grains=3, primitives=1, surfaces=1))
    release_grains_before_start(sim.world)
    assert export_state(sim)["released"].tolist() == start["released"].tolist()
    assert ends(sim, UNTIL) == roomy
    assert energy_sums(sim).shape[0] == 2


def test_one_worker_and_two_are_given_the_same_kernels():
    kinds = set()
    for threads in (1, 2):
        sim = assemble([row(2)], Laws(), Numerics("cpu", threads))
        assert sim.workers == threads
        room = sim.schedule.first.shape, sim.schedule.steps.shape
        kinds.add((impl.current_cfg().cpu_max_num_threads, *room))
    assert len(kinds) == 1
