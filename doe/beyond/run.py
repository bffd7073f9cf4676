"""Sealed cases beyond the list: draws, solves in other processes, opens them, writes results.csv.

python -m doe.beyond.run --cases 120 --seed 1 --seal     draws, and writes the digests to seals.csv
python -m doe.beyond.run --cases 120 --seed 1            solves; goes on where it was stopped
python -m doe.beyond.run --cases 120 --seed 1 --score    opens what is answered, and prints the metrics
"""

import csv
import io
import json
import os
import pickle
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, replace
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from types import SimpleNamespace
from typing import Annotated, Any

import numpy as np
import typer

from doe.beyond.cases import draw
from doe.sealed.score import Metric, number, share
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.adopt import adopt
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.mechanism_findings import BeyondList
from taichi_erosion.evidence.data.problem import Candidate, Problem
from taichi_erosion.evidence.inference.map_fit import fit_base
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.models.own_effects import DosedModel

FOLDER = Path(__file__).parent
WORK = FOLDER.parent / "beyond-results"
SEALS = FOLDER / "seals.csv"  # number and SHA-256 of every truth
COLUMNS = ("number", "sha256", "truth", "ratio", "answer")
STRONG = 7.0  # ratio [sd]
MOST_TOLD = 3  # members of a group
FOUND = "found_law"


def main(
    cases: int = 120,
    seed: Annotated[int, typer.Option(help="Family of cases; each is used once.")] = 1,
    processes: int = 1,
    only_seal: Annotated[bool, typer.Option("--seal", help="Draw and seal, solve nothing.")] = False,
    score: Annotated[bool, typer.Option("--score", help="Open what is answered, solve no more.")] = False,
) -> None:
    """Whatever was asked for, then the metrics."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    folder = WORK / f"{seed}-{cases}"
    seal(folder, seed, cases)
    if only_seal:
        return
    if not score:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            list(pool.map(solve_file, [folder / f"{k:04d}.pickle" for k in range(cases)]))
    rows = [opened(folder, seed, k) for k in range(cases) if (folder / f"{k:04d}.json").exists()]
    page = io.StringIO()
    writer = csv.DictWriter(page, list[str](COLUMNS), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(FOLDER / "results.csv", page.getvalue().encode())
    for metric in metrics(rows):
        bounds = f"{metric.low:.3f} to {metric.high:.3f}"
        met = "yes" if metric.met else "**no**"
        typer.echo(
            f"| {metric.name} | {metric.value:.3f} | {bounds} | {metric.count} | {metric.target} | {met} |"
        )


def digest_of(seed: int, number: int, truth: Any) -> str:
    """SHA-256 of a truth with a salt."""
    salt = np.random.default_rng([seed, number, 1]).bytes(16).hex()
    return sha256(json.dumps([salt, asdict(truth)], sort_keys=True).encode()).hexdigest()


def seal(folder: Path, seed: int, cases: int) -> None:
    """Write every problem without truth, and the digest of every truth, before the first answer."""
    if (folder / "0000.pickle").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    for number_ in range(cases):
        problem, truth = draw(seed, number_)
        write_atomic(folder / f"{number_:04d}.pickle", pickle.dumps(problem))
        lines.append(f"{number_},{digest_of(seed, number_, truth)}")
    write_atomic(SEALS, ("\n".join(lines) + "\n").encode())


def solve_file(path: Path) -> None:
    """Answer of one problem file, which is all that the solving process is given."""
    if path.with_suffix(".json").exists():
        return
    problem: Problem = pickle.loads(path.read_bytes())
    start = process_time()
    found = discover(problem, int(path.stem), problem.budget, no_progress)
    answer: dict[str, Any] = {
        "verdict": found.verdict,
        "named": found.named,
        "group": found.group,
        "p_misfit": found.p_misfit,
        "seconds": process_time() - start,
    }
    if found.trend is not None:
        answer |= {"trend": asdict(found.trend)}
    if found.beyond is not None:
        beyond = found.beyond
        answer |= {
            "beyond": beyond.verdict,
            "mechanisms": beyond.group,
            "against": beyond.named,
            "named_odds": beyond.named_odds,
            "withdrawn": beyond.withdrawn,
            "best": [[m.name, m.log_bayes_factor, m.p_left, m.p_one_dose] for m in beyond.mechanisms[:4]],
            "free": beyond.log_bayes_discrepancy,
            "law": None if beyond.law is None else asdict(beyond.law),
            "held_out": held_out(problem, beyond, int(path.stem)),
        }
    write_atomic(path.with_suffix(".json"), json.dumps(answer, default=float).encode())


def held_out(problem: Problem, beyond: BeyondList, seed: int) -> list[float]:
    """Misfit per held-out row before and after the law is adopted; empty for an instrument or no law."""
    law, name = beyond.law, beyond.group[0] if beyond.group else ""
    if law is None or ":" in name:
        return []
    known = {tuple(at[name] for name in law.conditions): dose for at, dose in law.table}

    def dose(_params: Any, conditions: Mapping[str, float]) -> float:
        return known[tuple(conditions[name] for name in law.conditions)]

    effect: Any = SimpleNamespace(mechanism=name, params=lambda: None, dose=dose, name=FOUND)
    with_law = replace(
        problem,
        model=DosedModel(problem.model, {FOUND: effect}),
        candidates=(*problem.candidates, Candidate(FOUND)),
    )
    proof = adopt(with_law, (FOUND,), seed, no_progress)
    return [proof.base.vault_chi2_per_row, proof.added.vault_chi2_per_row]


def opened(folder: Path, seed: int, number_: int) -> dict[str, str]:
    """Row of one answered case, its truth checked against its seal."""
    problem, truth = draw(seed, number_)
    seals = dict(line.split(",") for line in SEALS.read_text().split())
    digest = digest_of(seed, number_, truth)
    if digest != seals[str(number_)]:
        raise ValueError(f"case {number_}: the truth is not the one that was sealed")
    return {
        "number": str(number_),
        "sha256": digest,
        "truth": json.dumps(asdict(truth)),
        "ratio": f"{ratio(problem, truth):.3g}",
        "answer": (folder / f"{number_:04d}.json").read_text(),
    }


def ratio(problem: Problem, truth: Any) -> float:
    """Root of the misfit that the calibrated bare model keeps without noise, in sd of the measurements."""
    from doe.beyond.cases import OBSERVABLES, exact

    table = problem.visible()
    named, value = np.array(table.observable), table.value.copy()
    for observable in OBSERVABLES:
        rows = named == observable
        own = {name: column[rows] for name, column in table.conditions.items()}
        value[rows] = exact(truth, observable, own)
    clean = replace(table, value=value)
    _, best, _ = fit_base(prepare(problem, clean, 0))
    return float(np.sqrt(max(best.misfit, 0.0)))


def is_unchallenged(answer: Mapping[str, Any]) -> bool:
    """Whether an effect is named and neither a mechanism nor another law of it is told."""
    return answer["verdict"] == "present" and not answer.get("mechanisms") and "trend" not in answer


def metrics(rows: Sequence[Mapping[str, str]]) -> list[Metric]:
    """All metrics, with Clopper-Pearson bounds at 95 %."""
    cases = [(json.loads(r["truth"]), float(r["ratio"]), json.loads(r["answer"])) for r in rows]
    outside = [(t, a) for t, hard, a in cases if t["kind"] == "outside" and hard >= STRONG]
    nulls = [a for t, _, a in cases if t["kind"] == "null"]
    listed = [(t, a) for t, hard, a in cases if t["kind"] == "listed" and hard >= STRONG]
    told = [(t, a, a.get("mechanisms", [])) for t, a in outside]
    errors = [a["held_out"] for _, a in outside if a.get("held_out")]
    powers = [
        (
            t["exponent"] if t["condition"] == "moisture" else -t["exponent"],
            a["law"]["exponents"][t["condition"]],
        )
        for t, a in outside
        if t["form"] == "power"
        and (a.get("mechanisms") or [""])[0] == t["name"]
        and a["law"]
        and t["condition"] in a["law"]["exponents"]
    ]
    return [
        share("outside, ratio >= 7: asked for a mechanism", ["beyond" in a for _, a in outside], (">=", 0.9)),
        share(
            "outside, ratio >= 7: mechanism told, alone or in a group of at most three",
            [t["name"] in g and len(g) <= MOST_TOLD for t, _, g in told],
            (">=", 0.8),
        ),
        share(
            "outside, ratio >= 7: mechanism in the group told",
            [t["name"] in g for t, _, g in told],
            (">=", 0.8),
        ),
        share(
            "outside, ratio >= 7: wrong mechanism alone",
            [len(g) == 1 and t["name"] not in g for t, _, g in told],
            ("<=", 0.05),
        ),
        share(
            "outside, ratio >= 7: a listed effect named, nothing beside it",
            [is_unchallenged(a) for _, a in outside],
            ("<=", 0.05),
        ),
        share(
            "outside, ratio >= 7: a listed effect named, a mechanism or another law told with it",
            [a["verdict"] == "present" and not is_unchallenged(a) for _, a in outside],
            ("<=", 1.0),
        ),
        share(
            "listed, ratio >= 7: named, nothing beside it",
            [is_unchallenged(a) and a["named"] == [t["name"]] for t, a in listed],
            (">=", 0.85),
        ),
        share("nulls: any mechanism", [bool(a.get("mechanisms")) for a in nulls], ("<=", 0.02)),
        share(
            "listed, ratio >= 7: named",
            [a["verdict"] == "present" and a["named"] == [t["name"]] for t, a in listed],
            (">=", 0.93),
        ),
        share(
            "power laws, mechanism right: exponent in its 90 % interval",
            [each["low"] <= true <= each["high"] for true, each in powers],
            (">=", 0.85),
        ),
        number(
            "outside, ratio >= 7: held-out misfit after over before",
            [e[1] / e[0] for e in errors],
            ("<=", 0.3),
        ),
        number("seconds of one core", [a["seconds"] for _, _, a in cases], ("<=", 60.0)),
    ]


if __name__ == "__main__":
    typer.run(main)
