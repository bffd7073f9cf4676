"""Sealed cases on scenes: studies solved by the commands without the truth, which is opened to score them.

    python -m MODULE seal SECRET      draw the truths into the folder SECRET, write their digest
    python -m MODULE make SECRET      the laboratories' tables, and the studies
    python -m MODULE solve            discover and adopt, by the commands; goes on where it was stopped
    python -m MODULE score SECRET     compare the answers with the truths, write results.csv

The truths are drawn from a seed of the operating system, which lies with them outside the tree. Their SHA-256
is committed before anything is measured. Every command runs in a process of its own, in a folder that names
no seed. A truth is a list of cases, each with its `number`, its `effects` by strength, and `outside`, what no
candidate describes.
"""

import csv
import json
import random
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from io import StringIO
from pathlib import Path
from secrets import randbits
from typing import Any

import typer

from doe.common.method import method_commit
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic

PROGRAM = (sys.executable, "-m", "taichi_erosion")
SEED_BITS = 128  # too many to try
Case = dict[str, Any]


@dataclass(frozen=True)
class SealedSet:
    """Where a set lies, where its digest and its results stand, and how its cases are drawn and measured."""

    folder: Path  # studies, tables and answers
    home: Path  # digest and results
    draw: Callable[[random.Random], list[Case]]
    measure: Callable[[Sequence[Case], int], None]  # writes tables and studies; the second is a seed

    @property
    def digest(self) -> Path:
        return self.home / "truth.sha256"

    def study(self, number: int) -> Path:
        """Study file of one case."""
        return self.folder / f"case_{number}.toml"

    def answer(self, number: int) -> Path:
        """What the commands said of it."""
        return self.folder / f"case_{number}.solved.json"


def truth_file(secret: Path) -> Path:
    """The file whose digest is committed."""
    return secret / "truth.json"


def steps(place: SealedSet) -> typer.Typer:
    """Command line of a set."""
    program = typer.Typer(add_completion=False)
    program.command("seal")(lambda secret: seal(place, Path(secret)))
    program.command("make")(lambda secret: make(place, Path(secret)))
    program.command("solve")(lambda: solve(place))
    program.command("score")(lambda secret: typer.echo(write_results(place, Path(secret))))
    return program


def seal(place: SealedSet, secret: Path) -> None:
    """Draw the truths and write their digest; raises BadInput where the folder holds truths already."""
    file, seed = truth_file(secret), randbits(SEED_BITS)
    if file.exists():
        raise BadInput(f"{file}: drawn already; give another folder")
    text = json.dumps({"seed": seed, "cases": place.draw(random.Random(seed))})
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(file, text.encode())
    write_atomic(place.digest, f"{sha256(text.encode()).hexdigest()}\n".encode())


def opened(place: SealedSet, secret: Path) -> tuple[list[Case], int]:
    """The truths and their seed; raises BadInput where they are not the ones that were sealed."""
    text = truth_file(secret).read_text(encoding="utf-8")
    if sha256(text.encode()).hexdigest() != place.digest.read_text(encoding="utf-8").strip():
        raise BadInput(f"{truth_file(secret)}: the truths are not the ones that were sealed")
    told = json.loads(text)
    return told["cases"], told["seed"]


def make(place: SealedSet, secret: Path) -> None:
    """Tables and studies of all laboratories."""
    cases, seed = opened(place, secret)
    place.folder.mkdir(parents=True, exist_ok=True)
    place.measure(cases, seed + 1)


def solve(place: SealedSet) -> None:
    """Every case through `discover` and `adopt`; what has been solved is not solved again."""
    for number in range(len(list(place.folder.glob("case_*.csv")))):
        if place.answer(number).exists():
            continue
        found = command("discover", place.study(number), "--budget", "quick")
        names = found["named"] or found["group"][:1]
        adopted = command("adopt", place.study(number), *names) if names else {"vault": None}
        answer = {"method": method_commit(), "found": found, "vault": adopted["vault"]}
        write_atomic(place.answer(number), json.dumps(answer).encode())
        typer.echo(f"case {number}: {found['verdict']} {' '.join(names)}")


def command(word: str, study: Path, *rest: str) -> dict[str, Any]:
    """One command of the program, with its document; raises BadInput where it fails."""
    told = subprocess.run([*PROGRAM, word, str(study), *rest, "--json"], capture_output=True, text=True)
    if told.returncode:
        raise BadInput(f"{study}: {word} ended with {told.returncode}: {told.stderr[-500:]}")
    return json.loads(told.stdout)


def scored(place: SealedSet, secret: Path) -> Iterator[dict[str, Any]]:
    """Truth beside answer, case by case as far as they are solved."""
    for case in opened(place, secret)[0]:
        file = place.answer(case["number"])
        if file.exists():
            solved = json.loads(file.read_text(encoding="utf-8"))
            row = scored_row(case, solved["found"], solved["vault"] or {})
            yield row | {"method": solved["method"]}


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
        "judged": judged(case, found["verdict"], set(found["named"]), set(found["group"])),
        "p_misfit": f"{found['p_misfit']:.2g}",
        "vault_before": vault.get("chi2_per_row_before"),
        "vault_after": vault.get("chi2_per_row_after"),
        "vault_wrong": vault.get("chi2_per_row_wrong_effect"),
        "strength_found": " ".join(f"{strength:.2f}" for strength in strengths),
        "runs": found["runs"],
    }


def judged(case: Case, verdict: str, named: set[str], group: set[str]) -> str:
    """One word on an answer: right, in the group, partly, silent, wrong, false alarm."""
    truth, outside = set(case["effects"]), verdict == "outside_library"
    if not truth and not case["outside"]:
        return "false alarm" if named or group or outside else "right"
    if case["outside"]:
        return "right" if outside else "wrong" if named or group else "silent"
    if not named and not group:
        return "wrong" if outside else "silent"
    if named == truth:
        return "right"
    if named <= truth <= named | group:
        return "in the group"
    return "partly" if truth & (named | group) else "wrong"


def write_results(place: SealedSet, secret: Path) -> dict[str, int]:
    """Write the table of results; how many cases were judged with each word."""
    rows = list(scored(place, secret))
    if not rows:
        raise BadInput(f"{place.folder}: no case has been solved")
    page = StringIO(newline="")
    writer = csv.DictWriter(page, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(place.home / "results.csv", page.getvalue().encode())
    words = [row["judged"] for row in rows]
    return {word: words.count(word) for word in sorted(set(words))}
