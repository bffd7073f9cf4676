"""A set of sealed cases: studies that the commands solve without the truth, which is opened only to score.

A folder holds `case_<number>.toml` with its table, and the truth in `sealed/truth.json`; the SHA-256 of that
file is written elsewhere before anything is solved. Every command runs in a process of its own. A truth is a
list of cases, each with its `number`, its `effects` by strength, and `outside`, what no candidate describes.
"""

import csv
import json
import random
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import Any, TextIO

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic

PROGRAM = (sys.executable, "-m", "taichi_erosion")
Case = dict[str, Any]


@dataclass(frozen=True)
class SealedSet:
    """Where a set lies and where its digest stands."""

    folder: Path
    digest: Path

    @property
    def truth(self) -> Path:
        return self.folder / "sealed" / "truth.json"

    def study(self, number: int) -> Path:
        """Study file of one case."""
        return self.folder / f"case_{number}.toml"

    def answer(self, number: int) -> Path:
        """What the commands said of it."""
        return self.folder / f"case_{number}.solved.json"


def seal(place: SealedSet, cases: Sequence[Case]) -> None:
    """Write the truth and its digest."""
    sealed = json.dumps({"cases": list(cases), "salt": random.SystemRandom().random()})
    place.truth.parent.mkdir(parents=True, exist_ok=True)
    place.truth.write_text(sealed, encoding="utf-8")
    place.digest.write_text(sha256(sealed.encode()).hexdigest() + "\n", encoding="utf-8")


def opened(place: SealedSet) -> list[Case]:
    """The truth; raises BadInput where it is not the one that was sealed."""
    sealed = place.truth.read_text(encoding="utf-8")
    if sha256(sealed.encode()).hexdigest() != place.digest.read_text(encoding="utf-8").strip():
        raise BadInput(f"{place.truth}: the truth is not the one that was sealed")
    return json.loads(sealed)["cases"]


def solve(place: SealedSet, count: int, to: TextIO) -> None:
    """Every case through `discover` and `adopt`; what has been solved is not solved again."""
    for number in range(count):
        if place.answer(number).exists():
            continue
        found = command("discover", place.study(number), "--budget", "quick")
        names = found["named"] or found["group"]
        adopted = command("adopt", place.study(number), names[0]) if names else {"vault": None}
        answer = {"found": found, "vault": adopted["vault"]}
        write_atomic(place.answer(number), json.dumps(answer).encode())
        to.write(f"case {number}: {found['verdict']} {' '.join(names)}\n")
        to.flush()


def command(word: str, study: Path, *rest: str) -> dict[str, Any]:
    """One command of the program, with its document; raises BadInput where it fails."""
    told = subprocess.run([*PROGRAM, word, str(study), *rest, "--json"], capture_output=True, text=True)
    if told.returncode:
        raise BadInput(f"{study}: {word} ended with {told.returncode}: {told.stderr[-500:]}")
    return json.loads(told.stdout)


def scored(place: SealedSet) -> Iterator[dict[str, Any]]:
    """Truth beside answer, case by case as far as they are solved."""
    for case in opened(place):
        file = place.answer(case["number"])
        if file.exists():
            solved = json.loads(file.read_text(encoding="utf-8"))
            yield scored_row(case, solved["found"], solved["vault"] or {})


def scored_row(case: Case, found: dict[str, Any], vault: dict[str, Any]) -> dict[str, Any]:
    """One row of the table of results."""
    names = sorted(case["effects"])
    strengths = [found["effects"][name]["strength"] for name in names if name in found["effects"]]
    return {
        "case": case["number"],
        "truth": "+".join(names) or case["outside"] or "nothing",
        "strengths": " ".join(f"{case['effects'][name]:.2f}" for name in names),
        "verdict": found["verdict"],
        "named": "+".join(sorted(found["named"])),
        "group": "+".join(sorted(found["group"])),
        "judged": judged(case, found["verdict"], {*found["named"], *found["group"]}),
        "p_misfit": f"{found['p_misfit']:.2g}",
        "vault_before": vault.get("chi2_per_row_before"),
        "vault_after": vault.get("chi2_per_row_after"),
        "vault_wrong": vault.get("chi2_per_row_wrong_effect"),
        "strength_found": " ".join(f"{strength:.2f}" for strength in strengths),
        "runs": found["runs"],
    }


def judged(case: Case, verdict: str, answer: set[str]) -> str:
    """One word on an answer: right, partly, silent, wrong, false alarm."""
    truth = set(case["effects"])
    outside = verdict == "outside_library"
    if not truth and not case["outside"]:
        return "false alarm" if answer or outside else "right"
    if case["outside"]:
        return "right" if outside else "wrong" if answer else "silent"
    if not answer:
        return "wrong" if outside else "silent"
    return "right" if truth <= answer else "partly" if truth & answer else "wrong"


def write_results(place: SealedSet, table: Path) -> dict[str, int]:
    """Write the table of results; how many cases were judged with each word."""
    rows = list(scored(place))
    if not rows:
        raise BadInput(f"{place.folder}: no case has been solved")
    page = StringIO(newline="")
    writer = csv.DictWriter(page, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(table, page.getvalue().encode())
    words = [row["judged"] for row in rows]
    return {word: words.count(word) for word in sorted(set(words))}
