"""One thread per grain against partitions: the same device functions in another order give the same forces.

Both run in double precision from the same start. A force is a sum of a few contact forces, whose order
differs, so what is left is rounding; a heap amplifies it, and 500 steps of a hundred collisions leave 1e-12
of a speed. A graphics processor may also fuse multiplication and addition, by one rounding more.
"""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from few_grains import ARMS, equal_clumps, run_worlds
from grain_worlds import RADIUS, contacts, fingerprint, grains, heap, setup
from own_effects import acted_on
from scipy.spatial.transform import Rotation
from windy_beds import bed, set_in

from taichi_erosion import simulation
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.core.snapshot import AirProfile, Snapshot, Status
from taichi_erosion.core.transfer import download_field
from taichi_erosion.simulation import Simulation
from taichi_erosion.simulation.assemble import reallocate_fields
from taichi_erosion.simulation.grain_decomposition import step

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
ON_CPU, IN_PARTITIONS = Numerics("cpu", 2, "f64", "grains"), Numerics("cpu", 1, "f64")
ROLLING = Laws(rolling="elastic_plastic")
GRAINS = 120
HALF, WHOLE = 0.0025, 0.005  # s
CALM, WIND = 0.002, 0.4  # s, m s-1: wind begins, its friction velocity
SUMS = 1e-10  # of the largest value: rounding of sums, and of lists that are renewed at other steps
FORCES = 1e-6  # of the largest value: what the two ways may differ by; rounding leaves a millionth of that
CUDA = pytest.param(Numerics("cuda", 1, "f64"), marks=[pytest.mark.gpu, pytest.mark.slow], id="cuda")
devices = pytest.mark.parametrize("numerics", [pytest.param(ON_CPU, id="cpu"), CUDA])

State = tuple[Snapshot, AirProfile | None]


def started(setups: list[Setup], laws: Laws, numerics: Numerics) -> Simulation:
    """An ensemble at its start; skips where there is no such device."""
    try:
        return simulation.assemble(setups, laws, numerics)
    except BadInput as missing:
        pytest.skip(str(missing))


def run(setups: list[Setup], laws: Laws, numerics: Numerics, until: float) -> list[State]:
    """States of all replicas at a time, and the wind over them that sets in on the way."""
    sim, replicas, blows = started(setups, laws, numerics), range(len(setups)), setups[0].air is not None
    if blows:
        set_in(sim, WIND, CALM, until)
    else:
        simulation.advance(sim, [until for _ in replicas])
    assert not any(simulation.failure_of(sim, r) for r in replicas)
    winds = [simulation.air_profile(sim, r) if blows else None for r in replicas]
    return [(simulation.snapshot(sim, r), wind) for r, wind in zip(replicas, winds, strict=True)]


def distance(first: Snapshot, second: Snapshot) -> float:
    """Largest difference of velocities, and of spins times the radius, over the largest velocity [1]."""
    slip, turn = first.velocity - second.velocity, RADIUS * (first.spin - second.spin)
    return float(max(np.abs(slip).max(), np.abs(turn).max()) / np.abs(first.velocity).max())


def bits(state: State) -> str:
    """Equal for equal bits of grains and wind."""
    return fingerprint(state[0]) + ("" if state[1] is None else state[1].velocity.tobytes().hex())


def sticky(count: int, seed: int) -> Setup:
    """A heap whose grains adhere; the pull-off force is ten times their weight."""
    dry = heap(count, seed)
    energy = 10.0 * 9.81e-6 / (3.0 * np.pi * 0.5 * RADIUS)
    return replace(dry, contacts=replace(dry.contacts, surface_energy=np.full(3, energy)))


def trickle() -> Setup:
    """Grains that are released one after the other onto a plate."""
    place = [(0.3 * RADIUS * k, 0.0, (3.0 + 2.2 * k) * RADIUS) for k in range(4)]
    table = grains(place, (0.0, 0.0, -0.3), release=[0.0, 0.0, 0.0012, 0.003])
    return setup(table, law=contacts(rolling=0.1))


def four_heaps() -> list[Setup]:
    """Three heaps, and one with a velocity that is no number."""
    lost = heap(8, 1)
    lost.grains.velocity[3] = np.nan
    return [heap(GRAINS, 1), trickle(), heap(GRAINS // 2, 2, friction=0.1), lost]


@devices
def test_heaps_of_an_ensemble_move_as_in_partitions_and_repeat_their_bits(numerics):
    """In partitions, by grain, again, and by grain from half way on; kernels compile once."""
    sim = simulation.assemble(four_heaps(), ROLLING, IN_PARTITIONS)
    simulation.advance(sim, [HALF] * 4)
    state = simulation.export_state(sim)
    simulation.advance(sim, [WHOLE] * 4)
    want = [simulation.snapshot(sim, r) for r in range(3)]
    sim = started(four_heaps(), ROLLING, numerics)
    found = []
    for way in ("by grain", "again", "from half way"):
        assert sim is simulation.reuse_or_assemble(sim, four_heaps(), ROLLING, numerics)
        if way == "from half way":
            simulation.import_state(sim, state)
        simulation.advance(sim, [WHOLE] * 4)
        found.append([simulation.snapshot(sim, r) for r in range(3)])
        assert max(map(distance, want, found[-1])) < FORCES, way
        *others, reason = (simulation.failure_of(sim, r) for r in range(4))
        # a number that is none stops its replica by name
        assert others == [None] * 3
        assert (reason.status, reason.grain) == (Status.NOT_FINITE, 3)
    assert list(map(fingerprint, found[0])) == list(map(fingerprint, found[1]))


WITH_POWERS = {"liquid_bridge": {}, "restitution_speed": {}}
KNOWN = {"grain_diameter": 2.0 * RADIUS, "moisture": 0.01}
AGEING = {"pull_off": 3e-5, "ageing": 5e-4, "still": 0.02}


def clumps(bodies: int, seed: int) -> Setup:
    """Clumps of three spheres that fall and turn; the last fifth is released later."""
    rng = np.random.default_rng(seed)
    loose, poses = heap(bodies, seed), Rotation.random(bodies, rng=rng)
    is_late = np.arange(bodies) >= 0.8 * bodies
    centre = 2.2 * loose.grains.position + np.outer(is_late, [0.0, 0.0, 4.0 * RADIUS])
    spin, velocity = rng.normal(0.0, 30.0, (bodies, 3)), rng.normal((0.0, 0.0, -0.6), 0.2, (bodies, 3))
    arms = poses.as_matrix() @ ARMS.T
    place = centre[:, None] + arms.transpose(0, 2, 1)
    speed = velocity[:, None] + np.cross(spin[:, None], arms.transpose(0, 2, 1))
    late = np.repeat(np.where(is_late, 0.001, 0.0), len(ARMS))
    loose.primitives.shape[1, [6, 8]] *= 2.5  # the tube, as wide as the places of larger bodies want
    spheres = grains(place.reshape(-1, 3), speed.reshape(-1, 3), np.repeat(spin, len(ARMS), axis=0), late)
    return replace(loose, grains=spheres, clumps=equal_clumps(centre, poses))


# of one heap: bare, and with effects without and with a memory
EFFECTS = {}, {"dry_adhesion": {}, "image_charge": {}}, WITH_POWERS, {"ageing_pull": AGEING}
CASES = {  # setups, laws, end [s], and what the two ways may differ by over the largest value [1]
    "effects": (lambda: [acted_on(heap(60, 1), KNOWN, **each) for each in EFFECTS], ROLLING, WHOLE, FORCES),
    "clumps": (lambda: [clumps(40, 1), clumps(25, 2)], ROLLING, WHOLE, FORCES),
    "beds under wind": (lambda: [bed(1), bed(2, 2)], replace(ROLLING, drag="two_limits"), WHOLE, SUMS),
}
for rolling in ("none", "constant_torque", "elastic_plastic"):
    law = Laws(normal="jkr", rolling=rolling)
    CASES[f"adhesion, {rolling}"] = (lambda: [sticky(60, 1), sticky(40, 2)], law, HALF, FORCES)


@devices
@pytest.mark.parametrize("name", CASES)
@pytest.mark.slow
def test_ensembles_move_as_in_partitions_and_repeat_their_bits_alone_and_in_company(numerics, name):
    setups, laws, end, most = CASES[name]
    want = run(setups(), laws, IN_PARTITIONS, end)
    found, again = (run(setups(), laws, numerics, end) for _ in range(2))
    (alone,) = run(setups()[-1:], laws, numerics, end)
    assert list(map(bits, found)) == list(map(bits, again))
    assert bits(found[-1]) == bits(alone)
    assert len(set(map(bits, found))) == len(found), "must have acted"
    for (grains_want, air_want), (moved, blown) in zip(want, found, strict=True):
        assert moved.contacts.sum() > 0
        assert distance(grains_want, moved) < most
        for variable, numbers in grains_want.effect_state.items():
            assert moved.effect_state[variable] == pytest.approx(numbers, rel=most)
        if air_want is not None and blown is not None:
            fastest = np.abs(air_want.velocity).max()
            assert np.abs(blown.velocity - air_want.velocity).max() < most * fastest
            assert blown.void_fraction == pytest.approx(air_want.void_fraction, abs=most)


@devices
@pytest.mark.slow
def test_every_small_world_ends_as_in_partitions(numerics):
    """Meshes, moving walls, periodic boxes, releases, removed walls, and every way to fail."""
    try:
        found = run_worlds(numerics)
    except BadInput as missing:
        pytest.skip(str(missing))
    for name, want in run_worlds().items():
        for a, b in zip(want.frames, found[name].frames, strict=True):
            # velocities of order 0.1 m/s and 50 rad/s; double precision rounds at 1e-16 of that
            assert b.position == pytest.approx(a.position, rel=1e-9, abs=1e-12, nan_ok=True), name
            assert b.velocity == pytest.approx(a.velocity, rel=1e-9, abs=1e-9, nan_ok=True), name
            assert b.spin == pytest.approx(a.spin, rel=1e-9, abs=1e-6, nan_ok=True), name
        assert repr(found[name].failure) == repr(want.failure), name


@pytest.mark.slow
def test_a_state_of_clumps_goes_on_with_one_thread_per_grain():
    first = simulation.assemble([clumps(40, 1)], ROLLING, IN_PARTITIONS)
    simulation.advance(first, [HALF])
    state = simulation.export_state(first)
    simulation.advance(first, [WHOLE])
    want = simulation.snapshot(first, 0)
    second = simulation.assemble([clumps(40, 1)], ROLLING, ON_CPU)
    simulation.import_state(second, state)
    simulation.advance(second, [WHOLE])
    assert distance(want, simulation.snapshot(second, 0)) < FORCES


@pytest.mark.slow
def test_a_resumed_run_and_lists_that_grow_change_no_bit():
    sim = simulation.assemble([heap(GRAINS, 1)], ROLLING, replace(ON_CPU, precision="f32"))
    short = 2 * sim.capacities.grains
    reallocate_fields(sim, replace(sim.capacities, pairs=short, wall_pairs=64))  # the heap wants more
    simulation.advance(sim, [HALF])
    assert sim.capacities.pairs > short
    state = simulation.export_state(sim)
    energy = simulation.energy_sums(sim)
    simulation.advance(sim, [WHOLE])
    end = fingerprint(simulation.snapshot(sim, 0))
    simulation.import_state(sim, state)
    assert simulation.energy_sums(sim) == pytest.approx(energy, rel=1e-12)
    simulation.advance(sim, [WHOLE])
    assert fingerprint(simulation.snapshot(sim, 0)) == end


def test_the_host_starts_hundreds_of_steps_at_once_and_a_step_takes_few_stages(monkeypatch):
    launches = []
    run, name = step.run_steps_in_one_kernel, "run_steps_in_one_kernel"
    monkeypatch.setattr(step, name, lambda *fields: (launches.append(1), run(*fields)))
    sim = simulation.assemble([heap(GRAINS, 1)], ROLLING, Numerics("cpu", 1, "f32", "grains"))
    simulation.advance(sim, [WHOLE])
    assert simulation.energy_totals(sim, 0).step == 500
    assert len(launches) <= 500 / 16
    assert sim.buffers is not None
    # every stage of the last launch ends with a barrier, at which each block arrives once
    stages = int(download_field(sim.buffers.arrivals).max()) // sim.buffers.blocks
    assert stages <= 6 * 500, "with all lists that are renewed"


def test_tasks_of_many_threads_apart_give_the_bits_of_threads_that_wait(monkeypatch):
    ends = []
    for least in (step.APART_LEAST, 0):
        monkeypatch.setattr(step, "APART_LEAST", least)
        ends.append(run([heap(GRAINS, 1), trickle()], ROLLING, ON_CPU, HALF / 5))
    assert list(map(bits, ends[0])) == list(map(bits, ends[1]))


SIMULATION = Path(simulation.__file__).parent
ON_DEVICES = [*sorted((SIMULATION / "grain_decomposition").glob("*.py")), SIMULATION / "readback.py"]
ALL_GRAINS = re.compile(r"for \w+ in range\((?!.*(chunk|begin)).*(released|capacity)")


def test_no_thread_of_a_device_goes_through_all_grains_or_entries():
    """Such a loop stands in a kernel, where it is divided among threads, or goes through one chunk."""
    assert ALL_GRAINS.search("    for rank in range(world.replicas.released[r]):")
    for file in ON_DEVICES:
        tree = ast.parse(file.read_text(encoding="utf-8"))
        for function in [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]:
            loops = [node for node in ast.walk(function) if isinstance(node, ast.For)]
            if "ti.kernel" in map(ast.unparse, function.decorator_list):
                loops = [inner for inner in loops if inner not in function.body]
            lines = [ast.unparse(loop).partition("\n")[0] for loop in loops]
            assert not list(filter(ALL_GRAINS.search, lines)), f"{file.name}: {function.name}"


PATCH, PUSHED = bed(1), replace(heap(8, 1), has_servos=True)
GRIDDED = replace(PATCH, air=replace(PATCH.air, cells=(4, 4, PATCH.air.cells[2])))


@pytest.mark.parametrize(
    ("setups", "numerics", "told"),
    [
        ([GRIDDED], ON_CPU, "one thread per grain has no grids of air"),
        ([PUSHED], ON_CPU, "one thread per grain has no walls under a constant force or torque"),
        ([PATCH, replace(PATCH, air=None)], IN_PARTITIONS, "with and without air"),
    ],
)
def test_what_cannot_run_is_refused_by_name(setups, numerics, told):
    with pytest.raises(BadInput, match=told):
        simulation.assemble(setups, ROLLING, numerics)
