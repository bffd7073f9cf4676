"""A trial by sealed cases: problems go out as files, truths stay sealed until the answers are in.

The truths are drawn twice, before and after, from a seed that the solving processes are not given; what is
written before the first answer are the problems, without truth, and the SHA-256 of every truth with a salt.
"""

import csv
import json
import pickle
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from doe.sealed.cases import Case, case_generator, draw_case, kind_of
from doe.sealed.laboratory import Truth
from doe.sealed.oracle import Difficulty, difficulty
from doe.sealed.score import Marked
from doe.sealed.solve import answer_of, outcome_of
from taichi_erosion.core.files import write_atomic

SALT_BYTES = 16
COLUMNS = ("number", "sha256", "further", "truth", "difficulty", "answer")  # of a table of results
FURTHER = "pair"  # kind of the cases that are asked for beyond the others, for they are few


@dataclass(frozen=True)
class Trial:
    """Cases 0 to count - 1 of one seed family, then the pairs among as many as `further`; where they lie."""

    family: int
    count: int
    folder: Path
    further: int = 0

    @property
    def numbers(self) -> list[int]:
        """Cases that are asked."""
        beyond = range(self.count, self.count + self.further)
        return [
            *range(self.count),
            *(k for k in beyond if kind_of(case_generator(self.family, k)) == FURTHER),
        ]

    def problem(self, number: int) -> Path:
        """What the solver is given."""
        return self.folder / "problems" / f"{number:05d}.pickle"

    def answer(self, number: int) -> Path:
        """What the solver gives back."""
        return self.folder / "answers" / f"{number:05d}.json"

    def seals(self) -> Path:
        """Digests of all truths."""
        return self.folder / "seals.csv"


def seal_of(family: int, case: Case) -> str:
    """SHA-256 of a truth with a salt that nobody can guess from the problem."""
    salt = np.random.default_rng([family, case.number, 1]).bytes(SALT_BYTES).hex()
    return sha256(json.dumps([salt, asdict(case.truth)], sort_keys=True).encode()).hexdigest()


def seal(trial: Trial) -> None:
    """Write every problem and the digest of every truth; nothing is drawn again once the seals are there."""
    if trial.seals().exists():
        return
    for path in (trial.problem(0), trial.answer(0)):
        path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["number,sha256"]
    for number in trial.numbers:
        case = draw_case(trial.family, number)
        write_atomic(trial.problem(number), pickle.dumps(case.problem))
        lines.append(f"{number},{seal_of(trial.family, case)}")
    write_atomic(trial.seals(), ("\n".join(lines) + "\n").encode())


def sealed(trial: Trial) -> dict[int, str]:
    """Digests as they were written before the first answer."""
    with trial.seals().open(encoding="utf-8", newline="") as file:
        return {int(row["number"]): row["sha256"] for row in csv.DictReader(file)}


def opened(trial: Trial, number: int, digest: str) -> dict[str, str]:
    """Row of one answered case: its truth, checked against its seal, its difficulty, and the answer."""
    case = draw_case(trial.family, number)
    if seal_of(trial.family, case) != digest:
        raise ValueError(f"case {number} of family {trial.family}: the truth is not the one that was sealed")
    return {
        "number": str(number),
        "sha256": digest,
        "further": "yes" if number >= trial.count else "",
        "truth": json.dumps(rounded(asdict(case.truth))),
        "difficulty": json.dumps(rounded(asdict(difficulty(case)))),
        "answer": json.dumps(rounded(asdict(answer_of(trial.answer(number))))),
    }


def rounded(value: Any) -> Any:
    """Plain tables with five significant digits; probabilities below 1e-4 are left out."""
    if isinstance(value, dict):
        return {
            key: rounded({k: v for k, v in entry.items() if v > 1e-4} if key == "probabilities" else entry)
            for key, entry in value.items()
        }
    if isinstance(value, tuple | list):
        return [rounded(entry) for entry in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value


def marked(rows: list[dict[str, str]]) -> list[Marked]:
    """Truth, difficulty and answer of every row of the table of results."""
    return [
        Marked(
            Truth(**json.loads(row["truth"])),
            Difficulty(**json.loads(row["difficulty"])),
            outcome_of(json.loads(row["answer"])),
            row.get("further") == "yes",
        )
        for row in rows
    ]
