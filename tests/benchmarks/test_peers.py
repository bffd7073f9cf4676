"""The comparison with other codes: what their logs say, equal and sound starts, measures and errors."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from benchmarks.peers import physics, physics_column
from benchmarks.peers.cases import SOIL, Bed, funnel_pile, funnel_triangles, tiled
from benchmarks.peers.codes import LAMMPS, NEW_LAMMPS
from benchmarks.peers.compare import Sample, gain, summary
from benchmarks.peers.peer_log import last_run
from benchmarks.peers.physics_cases import BED_SIDE, shear_effective, weight, young_effective
from benchmarks.peers.physics_codes import LAMMPS_TSUJI, lammps_damping, lammps_normal
from benchmarks.peers.physics_measures import Rest, bed_numbers, depth
from taichi_erosion.grains.materials import damping_ratio
from taichi_erosion.scene import replica_setup

LAMMPS_LOG = """\
Step Atoms c_kinetic c_contacts 
       0    10000            0       4.3978 
     200    10000 4.7369199e-09       4.3016 
Loop time of 0.978655 on 1 procs for 200 steps with 10000 atoms
Neighbor list builds = 3
Step Atoms c_kinetic c_contacts 
     200    10000 4.7369199e-09       4.3016 
    1200    10000 5.5257406e-10       4.4164 
Loop time of 4.21107 on 1 procs for 1000 steps with 10000 atoms
Neighbor list builds = 0
Total wall time: 0:00:05
"""  # noqa: W291 LAMMPS ends the rows of its table with a blank
LOST_ATOMS = "ERROR: Lost atoms: original 10000 current 9996 (src/thermo.cpp:439)\n"


def touching_pairs(bed: Bed) -> int:
    """Pairs of grains that touch in a box periodic along x and y."""
    box = [*bed.period, 1.0]  # m, of a height that no bed reaches across
    return len(KDTree(bed.position % box, boxsize=box).query_pairs(SOIL.diameter))


def test_the_rate_of_a_lammps_run_comes_from_its_last_loop():
    run = last_run(LAMMPS_LOG)
    assert run.grain_steps_per_s == pytest.approx(10_000 * 1000 / 4.21107)
    assert run.columns["contacts"] == 4.4164
    assert (run.cores, run.steps, run.rebuilds) == (1, 1000, 0)


def test_a_run_that_lost_grains_or_was_cut_off_after_its_last_loop_has_no_rate():
    with pytest.raises(ValueError, match="Lost atoms: original 10000 current 9996"):
        last_run(LAMMPS_LOG.partition("Loop")[0] + LOST_ATOMS)
    with pytest.raises(ValueError, match="ends before"):
        last_run(LAMMPS_LOG[: LAMMPS_LOG.rindex("Neighbor list builds")])


def test_a_tiled_bed_has_the_contacts_of_the_single_bed_everywhere_also_across_its_seams():
    # a narrow box of four diameters, so that many pairs lie across its sides
    side = 4 * SOIL.diameter
    single = Bed(np.random.default_rng(0).uniform(0.0, side, (100, 3)), (side, side))
    wide = tiled(single, (2, 5))
    pairs = touching_pairs(single)
    assert pairs > len(KDTree(single.position).query_pairs(SOIL.diameter)) + 20
    assert (wide.period, touching_pairs(wide)) == (pytest.approx((2 * side, 5 * side)), 10 * pairs)


@pytest.mark.parametrize("count", [2000, 10_000])
def test_grains_in_a_funnel_start_without_touching_each_other_or_the_funnel(count: int):
    pile = funnel_pile(count)
    assert (len(pile.position), len(KDTree(pile.position).query_pairs(SOIL.diameter))) == (count, 0)
    triangles = funnel_triangles(pile)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inside = np.einsum("tk,tk->t", normals, triangles[:, 0]) - pile.position @ normals.T
    # flat facets cut deeper than the cone, so this holds for codes with a cone too
    assert inside.min() > SOIL.diameter / 2
    bottom, top = pile.funnel_bottom, pile.funnel_bottom + pile.funnel_height
    assert bottom < pile.position[:, 2].min() < pile.position[:, 2].max() < top


def test_ratios_compare_runs_of_the_same_round_and_leave_out_disturbed_ones():
    def run(code: str, turn: int, rate: float, foreign: float = 0.0) -> Sample:
        return Sample("bed10k", 1, code, turn, rate, 4.4, 0, foreign)

    # the machine halves its speed in round 1: the ratio of 3 is seen in both rounds; round 2 was disturbed
    ours = [run("ours f32", 0, 12e6), run("ours f32", 1, 6e6), run("ours f32", 2, 12e6)]
    theirs = [run("LAMMPS", 0, 4e6), run("LAMMPS", 1, 2e6), run("LAMMPS", 2, 1e6, foreign=0.4)]
    assert gain(ours, theirs) == pytest.approx(3.0)
    lammps = next(row for row in summary([*ours, *theirs]) if row.code == "LAMMPS")
    assert (lammps.rate_low, lammps.rate_high) == (2e6, 4e6)
    assert (lammps.samples, lammps.contaminated) == (3, 1)
    assert lammps.gain == {"ours f32": pytest.approx(3.0)}


def test_both_versions_of_lammps_are_told_the_same_restitution():
    # of 2021: Tsuji's a is sqrt(5) times the share of critical damping, and walls get the polynomial twice
    old, new = lammps_damping(0.6, LAMMPS), lammps_damping(0.6, NEW_LAMMPS)
    share = np.sqrt(5.0) * damping_ratio(np.array([0.6]))[0]
    assert np.polyval(LAMMPS_TSUJI, old.restitution) == pytest.approx(share)
    assert np.polyval(LAMMPS_TSUJI, np.polyval(LAMMPS_TSUJI, old.restitution_wall)) == pytest.approx(share)
    assert new.restitution == new.restitution_wall == 0.6


STACK = 5


def stack() -> Rest:
    """Grains one above the other on the floor, each overlap the one that carries what lies above."""
    height, below = [], 0.5 * SOIL.diameter - depth(STACK, 0.5)
    for above in range(STACK - 1, -1, -1):
        height.append(below)
        below += SOIL.diameter - (depth(above, 0.25) if above else 0.0)
    middle = np.full(STACK, 0.5 * BED_SIDE)
    still = np.zeros((STACK, 3))
    return Rest(np.stack([middle, middle, np.array(height)], axis=1), still, still)


def test_a_stack_in_equilibrium_carries_its_weight_by_normal_forces_alone():
    found = dict(bed_numbers(stack()))
    assert found["load of the floor over the weight"] == pytest.approx(1.0)
    for cut in (0.25, 0.5, 0.75):
        assert found[f"weight above {cut:g} H that normal forces carry"] == pytest.approx(1.0)
    assert found["stress across over along the vertical, normal forces"] == pytest.approx(0.0)
    assert found["contacts of a grain with grains"] == pytest.approx(2.0 * (STACK - 1) / STACK)
    assert found["kinetic energy of a grain, 1e-6 m g d"] == 0.0


def test_the_decks_are_told_the_grains_of_our_scene():
    law = physics_column.ONE_LAW
    soil, scene = physics_column.column_soil(law), physics_column.column_scene(law)
    contacts = replica_setup(scene, 1).contacts
    # plate, tube and rim are as stiff and as bouncy as the grains, the decks know one modulus
    assert contacts.young_effective == pytest.approx(young_effective(soil))
    assert contacts.shear_effective == pytest.approx(shear_effective(soil))
    assert {contact.restitution for contact in scene.contact.values()} == {soil.restitution}
    damping = {name: contact.rolling_damping for name, contact in scene.contact.items()}
    assert damping["grain-grain"] == damping["grain-plate"] == 0.0
    assert soil.poisson == physics_column.POISSON


def test_sticky_grains_pull_each_other_with_two_weights_and_walls_with_nothing():
    for column in (physics_column.STICKY_FREE, physics_column.STICKY):
        soil, scene = physics_column.column_soil(column), physics_column.column_scene(column)
        energy = {name: contact.surface_energy for name, contact in scene.contact.items()}
        pull = 3.0 * np.pi * energy.pop("grain-grain") * 0.25 * soil.diameter
        assert pull == pytest.approx(2.0 * weight(soil))
        assert set(energy.values()) == {0.0}
        assert scene.laws.normal == "jkr"
        law, *words = lammps_normal(column, 0.6).split()
        told = [soil.young, 0.6, soil.poisson, physics_column.surface_energy(column)]
        assert (law, list(map(float, words))) == ("jkr", told)
    assert physics_column.column_scene(physics_column.USUAL).laws.normal == "hertz"
    assert lammps_normal(physics_column.USUAL, 0.6).startswith("hertz/material")


def test_the_tables_of_the_pages_are_those_of_the_results():
    for page, name, table in physics.page_tables():
        assert f"<!-- table: {name} -->\n{table}<!-- end -->" in page.read_text(encoding="utf-8")
