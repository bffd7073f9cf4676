"""Our speed beside LAMMPS and LIGGGHTS on the same grains: `python -m benchmarks.peers.compare [CASE]...`.

All codes run in turn, round after round, so that a slow minute of the machine slows them all; ratios are
taken inside a round. A sample during which other programs used more than 4 % of the machine is marked, and
left out where clean ones exist.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from os import sched_getaffinity
from pathlib import Path
from statistics import median
from subprocess import TimeoutExpired

from benchmarks.peers.codes import CASES, PEERS, Code, Workload, contestants, foreign_share, peer_version

MEGA = 1e6
FOREIGN_LIMIT = 0.04  # share of the machine [1]; above it the figures of repeats were seen to scatter

WORKLOADS = (
    Workload("bed10k", "bed10k", "bed", warm_up=200, steps=1000),
    Workload("bed100k", "bed100k", "bed", warm_up=50, steps=150),
    Workload("jkr10k", "bed10k", "bed_jkr", warm_up=200, steps=1000),
    Workload("pile2000", "pile2000", "pile", warm_up=0, steps=20_000),
    Workload("pile10000", "pile10000", "pile", warm_up=0, steps=8000),
    Workload("ensemble", "bed2k", "bed", warm_up=0, steps=4000, runs=32),
)


@dataclass(frozen=True)
class Sample:
    """One timed window of one code."""

    case: str
    cores: int
    code: str
    round: int
    grain_steps_per_s: float
    contacts_per_grain: float
    rebuilds: int
    foreign: float  # share of the machine that others used meanwhile [1]

    @property
    def clean(self) -> bool:
        return self.foreign <= FOREIGN_LIMIT


@dataclass(frozen=True)
class Row:
    """A code on a case: medians over its samples."""

    case: str
    cores: int
    code: str
    rate: float  # grain-steps per second
    rate_low: float
    rate_high: float
    contacts_per_grain: float
    rebuilds: float
    samples: int
    contaminated: int
    gain: dict[str, float]  # median over rounds of our rate over this code's, per precision of ours


def sample(workload: Workload, cores: Sequence[int], code: Code, turn: int) -> Sample:
    """Run one code once."""
    figures, foreign = foreign_share(lambda: code.run(workload, cores))
    found = asdict(figures)
    del found["spent"]
    return Sample(workload.name, len(cores), code.name, turn, **found, foreign=foreign)


def trusted(samples: Sequence[Sample]) -> list[Sample]:
    """The clean samples, or all of them if none is clean."""
    return [one for one in samples if one.clean] or list(samples)


def gain(ours: Sequence[Sample], theirs: Sequence[Sample]) -> float:
    """Median over rounds of our rate over theirs; rounds in which both are clean are preferred."""
    pairs = [(a, b) for a in ours for b in theirs if a.round == b.round]
    clean = [(a, b) for a, b in pairs if a.clean and b.clean]
    return median(a.grain_steps_per_s / b.grain_steps_per_s for a, b in clean or pairs)


def row(group: Sequence[Sample], gains: dict[str, float]) -> Row:
    """Medians over the samples of one code on one case."""
    kept = trusted(group)
    rates = [one.grain_steps_per_s for one in kept]
    return Row(
        case=group[0].case,
        cores=group[0].cores,
        code=group[0].code,
        rate=median(rates),
        rate_low=min(rates),
        rate_high=max(rates),
        contacts_per_grain=median(one.contacts_per_grain for one in kept),
        rebuilds=median(one.rebuilds for one in kept),
        samples=len(group),
        contaminated=len(group) - sum(one.clean for one in group),
        gain=gains,
    )


def summary(samples: Sequence[Sample]) -> list[Row]:
    """One row for each case, core count and code, in the order they first ran."""
    groups: dict[tuple[str, int, str], list[Sample]] = {}
    for one in samples:
        groups.setdefault((one.case, one.cores, one.code), []).append(one)
    rows: list[Row] = []
    for (case, cores, code), group in groups.items():
        ours = {
            key[2]: rival
            for key, rival in groups.items()
            if key[:2] == (case, cores)
            and key[2].startswith("ours")
            and key[2] != code
            and {one.round for one in rival} & {one.round for one in group}
        }
        rows.append(row(group, {name: gain(rival, group) for name, rival in ours.items()}))
    return rows


def table(rows: Sequence[Row]) -> str:
    """Rows as text; M/s is 10^6 grain-steps per second."""
    head = (
        f"{'case':10}{'cores':>6}  {'code':12}{'M/s':>7}{'low':>7}{'high':>7}{'contacts':>10}{'rebuilds':>10}"
    )
    lines = [head + "  samples (contaminated)  our rate over this code's"]
    for one in rows:
        rates = "".join(f"{rate / MEGA:7.2f}" for rate in (one.rate, one.rate_low, one.rate_high))
        counts = f"{one.contacts_per_grain:10.3f}{one.rebuilds:10.0f}"
        repeats = f"  {one.samples} ({one.contaminated})".ljust(25)
        gains = ", ".join(f"{name} {value:.2f}x" for name, value in one.gain.items())
        lines.append(f"{one.case:10}{one.cores:6}  {one.code:12}{rates}{counts}{repeats} {gains}".rstrip())
    return "\n".join(lines) + "\n"


def progress(one: Sample) -> str:
    """One sample as a line."""
    mark = "" if one.clean else "  CONTAMINATED"
    rate = one.grain_steps_per_s / MEGA
    return (
        f"{one.case} {one.cores} core(s) round {one.round}: {one.code} {rate:.2f} M/s, "
        f"others used {one.foreign:.1%}{mark}\n"
    )


def present_codes() -> list[Code]:
    """The codes that can run here; what is left out is said on stderr."""
    codes = contestants()
    for code in codes:
        if code.missing:
            sys.stderr.write(f"{code.name} left out: {code.missing}\n")
    return [code for code in codes if not code.missing]


def measured(
    workloads: Sequence[Workload], core_counts: Sequence[int], rounds: int, codes: Sequence[Code]
) -> list[Sample]:
    """Samples of all codes in turn, each printed on stderr as it comes."""
    allowed = sorted(sched_getaffinity(0))
    samples: list[Sample] = []
    for workload, count, turn, code in product(workloads, core_counts, range(rounds), codes):
        if code.enters(workload):
            samples.append(sample(workload, allowed[-count:], code, turn))
            sys.stderr.write(progress(samples[-1]))
    return samples


def arguments(words: Sequence[str] | None) -> argparse.Namespace:
    """The command line, checked."""
    names = [workload.name for workload in WORKLOADS]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers.compare", description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"any of {', '.join(names)} (default: all)")
    parser.add_argument("--cores", type=int, nargs="+", default=[1, 2], help="core counts (default: 1 2)")
    parser.add_argument("--rounds", type=int, default=3, help="turns of each code (default: 3)")
    parser.add_argument("--codes", nargs="+", metavar="CODE", help="such as 'ours f32' (default: all)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write rows and samples there too")
    chosen = parser.parse_args(words)
    chosen.cases = chosen.cases or names
    for case in chosen.cases:
        if case not in names:
            parser.error(f"CASE = {case}: must be one of {', '.join(names)}")
    for workload in WORKLOADS:
        if workload.name in chosen.cases and not (CASES / f"{workload.case}.npz").exists():
            parser.error(f"{workload.case} is not made yet: run python -m benchmarks.peers.make_cases")
    available = len(sched_getaffinity(0))
    if not 1 <= min(chosen.cores) <= max(chosen.cores) <= available:
        parser.error(f"--cores {chosen.cores}: each must lie in 1 to {available} on this machine")
    if chosen.rounds < 1:
        parser.error(f"--rounds {chosen.rounds}: must be at least 1")
    return chosen


def main(words: Sequence[str] | None = None) -> int:
    """Measure, print the table, and keep it if asked; 3 when a code fails."""
    chosen = arguments(words)
    workloads = [workload for workload in WORKLOADS if workload.name in chosen.cases]
    codes = [code for code in present_codes() if not chosen.codes or code.name in chosen.codes]
    try:
        samples = measured(workloads, chosen.cores, chosen.rounds, codes)
    except (OSError, RuntimeError, ValueError, TimeoutExpired) as failure:
        sys.stderr.write(f"{failure}\n")
        return 3
    rows = summary(samples)
    last = {one.code: one.case for one in samples}
    versions = [peer_version(peer, last[peer.name]) for peer in PEERS if peer.name in last]
    sys.stdout.write(table(rows) + "".join(f"{name}\n" for name in versions))
    if chosen.json:
        document = {
            "versions": versions,
            "rows": list(map(asdict, rows)),
            "samples": list(map(asdict, samples)),
        }
        chosen.json.write_text(json.dumps(document, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
