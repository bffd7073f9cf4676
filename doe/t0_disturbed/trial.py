"""A sealed trial: truths in a folder of their own, digests in the tree, problems for the solver.

The salt comes from the operating system and lies with the truths; what the solving process is given are
files with tables, lists and the bare model, named by number.
"""

import csv
import io
import json
import pickle
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from secrets import token_hex

from doe.common.sealed_set import NOWHERE, SealedSet
from doe.sealed.oracle import Difficulty, difficulty
from doe.sealed.solve import Outcome, answer_of, outcome_of
from doe.sealed.trial import rounded
from doe.t0_disturbed.cases import draw_case, undisturbed
from doe.t0_disturbed.laboratory import DisturbedTruth
from taichi_erosion.core.files import write_atomic

FOLDER = Path(__file__).parent
WORK = FOLDER.parent / "t0-results" / "disturbed"  # problems and answers
COLUMNS = ("number", "sha256", "method", "truth", "difficulty", "answer")
DIGITS = 5  # of a case in the names of files


def sealed_set(name: str, secret: Path = NOWHERE) -> SealedSet:
    """A set of this study by its name."""
    return SealedSet(name, secret, WORK, FOLDER, DIGITS)


def seal(trial: SealedSet, count: int, nulls: float) -> None:
    """Draw the cases with a fresh salt; write problems, truths and digests; a set is drawn once."""
    trial.refuse_sealed()
    salt = token_hex(16)
    for path in (trial.problem(0), trial.truth(0), trial.seals()):
        path.parent.mkdir(parents=True, exist_ok=True)
    lines = ["number,sha256"]
    for number in range(count):
        case = draw_case(salt, number, nulls)
        hard = difficulty(undisturbed(case))
        text = json.dumps(
            {"salt": salt, "number": number, "truth": asdict(case.truth), "difficulty": asdict(hard)}
        )
        write_atomic(trial.truth(number), text.encode())
        write_atomic(trial.problem(number), pickle.dumps(case.problem))
        lines.append(f"{number},{sha256(text.encode()).hexdigest()}")
    write_atomic(trial.seals(), ("\n".join(lines) + "\n").encode())


def sealed(trial: SealedSet) -> dict[int, str]:
    """Digests as they were written before the first answer."""
    with trial.seals().open(encoding="utf-8", newline="") as file:
        return {int(row["number"]): row["sha256"] for row in csv.DictReader(file)}


def opened(trial: SealedSet, method: str) -> list[dict[str, str]]:
    """Rows of all cases that one method answered: truth, checked against its seal, difficulty, answer."""
    rows = []
    for number, digest in sealed(trial).items():
        answer = trial.answer(number, method)
        if not answer.exists():
            continue
        found = trial.opened_truth(number, digest)
        rows.append(
            {
                "number": str(number),
                "sha256": digest,
                "method": method,
                "truth": json.dumps(rounded(found["truth"])),
                "difficulty": json.dumps(rounded(found["difficulty"])),
                "answer": json.dumps(rounded(asdict(answer_of(answer)))),
            }
        )
    return rows


def write_results(trial: SealedSet, method: str) -> None:
    """The table of one method in place of its earlier rows."""
    kept = [row for row in read_results(trial.results()) if row["method"] != method]
    page = io.StringIO()
    writer = csv.DictWriter(page, list[str](COLUMNS), lineterminator="\n")
    writer.writeheader()
    writer.writerows(kept + opened(trial, method))
    trial.results().parent.mkdir(parents=True, exist_ok=True)
    write_atomic(trial.results(), page.getvalue().encode())


def read_results(table: Path) -> list[dict[str, str]]:
    """Rows of a table; none where there is no table."""
    if not table.exists():
        return []
    csv.field_size_limit(1_000_000)
    with table.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@dataclass(frozen=True)
class Judged:
    """One case with its truth, difficulty and answer."""

    truth: DisturbedTruth
    hard: Difficulty
    answer: Outcome

    @property
    def told(self) -> set[str]:
        """Every name that the answer gives, alone or in a group."""
        return {*self.answer.named, *self.answer.group}


def judged(rows: list[dict[str, str]]) -> list[Judged]:
    """Truth, difficulty and answer of every row of a table."""
    return [
        Judged(
            DisturbedTruth(**json.loads(row["truth"])),
            Difficulty(**json.loads(row["difficulty"])),
            outcome_of(json.loads(row["answer"])),
        )
        for row in rows
    ]
