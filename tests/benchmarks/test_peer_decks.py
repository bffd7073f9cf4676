"""The comparison with other codes: what their logs say, and that all start from the same sound geometry."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from scipy.spatial import KDTree

from benchmarks.peers.cases import SOIL, Bed, funnel_pile, funnel_triangles, tiled
from benchmarks.peers.compare import Sample, gain, summary
from benchmarks.peers.peer_log import last_run
from benchmarks.peers.publish import joined

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
    assert wide.period == pytest.approx((2 * side, 5 * side))
    assert touching_pairs(wide) == 10 * pairs


@pytest.mark.parametrize("count", [2000, 10_000])
def test_grains_in_a_funnel_start_without_touching_each_other_or_the_funnel(count: int):
    pile = funnel_pile(count)
    assert len(pile.position) == count
    assert len(KDTree(pile.position).query_pairs(SOIL.diameter)) == 0
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


def test_rounds_of_two_sittings_follow_each_other(tmp_path):
    files = []
    for sitting, (cores, rounds) in enumerate([(1, 2), (1, 3), (2, 1)]):
        samples = [Sample("bed10k", cores, "LAMMPS", turn, 2e6, 4.4, 0, 0.0) for turn in range(rounds)]
        files.append(tmp_path / f"{sitting}.json")
        files[-1].write_text(json.dumps({"samples": list(map(asdict, samples))}))
    assert [(one.cores, one.round) for one in joined(files)] == [*((1, turn) for turn in range(5)), (2, 0)]
