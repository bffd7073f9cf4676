"""A sealed set beyond the list: truths outside the tree, their digests in it, problems for the solver.

Every case is drawn from 128 random bits of the operating system. They lie with its truth and salt its digest.
"""

import csv
import io
import json
import pickle
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path
from secrets import randbits
from typing import Any

import numpy as np

from doe.beyond.cases import OBSERVABLES, Shares, Truth, draw, exact
from doe.common.sealed_set import NOWHERE, SealedSet
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.inference.map_fit import fit_base
from taichi_erosion.evidence.inference.prepared_problem import prepare

FOLDER = Path(__file__).parent
WORK = FOLDER.parent / "beyond-results"  # problems and answers
COLUMNS = ("number", "sha256", "method", "seed", "truth", "ratio", "answer")
SEED_BITS = 128
DIGITS = 4  # of a case in the names of files


def sealed_set(name: str, secret: Path = NOWHERE) -> SealedSet:
    """A set of this study by its name."""
    return SealedSet(name, secret, WORK, FOLDER, DIGITS)


def seal(trial: SealedSet, count: int, shares: Shares) -> None:
    """Draw the cases; write problems, truths and digests; a set is drawn once."""
    trial.refuse_sealed()
    for path in (trial.problem(0), trial.answer(0), trial.truth(0), trial.seals()):
        path.parent.mkdir(parents=True, exist_ok=True)
    lines = []
    for number in range(count):
        seed = randbits(SEED_BITS)
        problem, truth = draw(seed, shares=shares)
        text = json.dumps({"seed": f"{seed:x}", "number": number, "truth": asdict(truth)})
        write_atomic(trial.truth(number), text.encode())
        write_atomic(trial.problem(number), pickle.dumps(problem))
        lines.append(f"{number},{sha256(text.encode()).hexdigest()}")
    write_atomic(trial.seals(), ("\n".join(lines) + "\n").encode())


def sealed(trial: SealedSet) -> dict[int, str]:
    """Digests as they were written before the first answer."""
    lines = (line.split(",") for line in trial.seals().read_text(encoding="utf-8").split())
    return {int(number): digest for number, digest in lines}


def opened(trial: SealedSet, number: int, digest: str) -> dict[str, str]:
    """Row of one answered case; raises ValueError where its truth is not the one that was sealed."""
    told = trial.opened_truth(number, digest)
    answer: dict[str, Any] = json.loads(trial.answer(number).read_text(encoding="utf-8"))
    problem: Problem = pickle.loads(trial.problem(number).read_bytes())
    return {
        "number": str(number),
        "sha256": digest,
        "method": answer.pop("method"),
        "seed": told["seed"],
        "truth": json.dumps(told["truth"]),
        "ratio": f"{ratio(problem, Truth(**told['truth'])):.3g}",
        "answer": json.dumps(answer),
    }


def ratio(problem: Problem, truth: Truth) -> float:
    """Root of the misfit that the calibrated bare model keeps without noise, in sd of the measurements."""
    table = problem.visible()
    named, value = np.array(table.observable), table.value.copy()
    for observable in OBSERVABLES:
        rows = named == observable
        own = {name: column[rows] for name, column in table.conditions.items()}
        value[rows] = exact(truth, observable, own)
    _, best, _ = fit_base(prepare(problem, replace(table, value=value), 0))
    return float(np.sqrt(max(best.misfit, 0.0)))


def write_results(trial: SealedSet) -> None:
    """The table of all answered cases."""
    page = io.StringIO()
    writer = csv.DictWriter(page, list[str](COLUMNS), lineterminator="\n")
    writer.writeheader()
    for number, digest in sealed(trial).items():
        if trial.answer(number).exists():
            writer.writerow(opened(trial, number, digest))
    trial.results().parent.mkdir(parents=True, exist_ok=True)
    write_atomic(trial.results(), page.getvalue().encode())


def read_results(table: Path) -> list[dict[str, str]]:
    """Rows of a table."""
    with table.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
