"""Blind trials: draws cases, solves them without their truth, opens them.

    python -m doe.trials.run seal TRIAL SET SECRET --cases 500  truths into SECRET, digests into seals/
    git commit doe/trials/seals
    python -m doe.trials.run solve TRIAL SET --processes 2      in fresh processes; goes on where it stopped
    python -m doe.trials.run open TRIAL SET SECRET              results/TRIAL.jsonl.gz, and its score
    python -m doe.trials.run again TRIAL SET --cases 200        stored cases by this method, as `SET, again`

TRIAL is reduced (the closed-form model: disturbed, beyond, clean and several in turn, each a trial too, as is
intervals), tables (as laboratories write them), other_laws (heaps of our own simulator), or lammps_beyond
(heaps of that code); of heaps `make TRIAL SET SECRET` measures the tables after `seal`. SECRET is a folder
outside the tree that no solving process is given; there lie 128 random bits of the operating system for every
case, out of which it follows.
Nothing is solved before the digests are committed; every row names the commit that answered it.
"""

import json
import os
import random
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from hashlib import sha256
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from secrets import randbits
from typing import Annotated, Any

import typer

from doe.common.cases import ROOT, method_commit
from doe.trials import heaps, lammps
from doe.trials.answers import answer_all
from doe.trials.reduced.families import FAMILIES, Drawn
from doe.trials.score import scores
from doe.trials.table import HERE, Row, add_rows, read_rows, table_of
from doe.trials.tables.draw import TableCase, draw
from taichi_erosion.core.files import write_atomic

LABORATORIES = {"other_laws": heaps.OTHER_LAWS, "lammps_beyond": lammps.BEYOND}
SeededCase = Drawn | TableCase
SEEDED: Mapping[str, Callable[[int, int], SeededCase]] = {**FAMILIES, "tables": draw}
SEED_BITS = 128  # too many to try
Secret = Annotated[Path, typer.Argument(help="Folder of truths, outside the tree.")]
app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class SealedSet:
    """A named set of cases of one trial and where its parts lie."""

    trial: str
    name: str
    work: Path = ROOT / "campaigns" / "trials"  # of problems and answers
    tables: Path = HERE / "seals"

    @property
    def folder(self) -> Path:
        return self.work / self.trial / self.name

    @property
    def seals(self) -> Path:
        """Digests of all truths."""
        return self.tables / f"{self.trial}_{self.name}.csv"

    @property
    def tasks(self) -> list[Path]:
        """Files that the solver is given, in the order of their numbers."""
        files = [*self.folder.glob("case_*.toml"), *self.folder.glob("case_*.pickle")]
        return sorted([*files, *(place for place in self.folder.glob("case_*[0-9]") if place.is_dir())])


def truth_text(seed: int, number: int, truth: Any) -> str:
    """What is digested of a case."""
    return json.dumps({"seed": f"{seed:x}", "number": number, "truth": truth})


def digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()


def seal(place: SealedSet, secret: Path, cases: int) -> None:
    """Draw a set once: random bits into the secret, digests into the tree, problems for solvers."""
    file = secret / f"{place.trial}_{place.name}.json"
    if place.seals.exists() or file.exists():
        raise FileExistsError(f"{place.seals}: this set is sealed already")
    for folder in (place.folder, secret, place.tables):
        folder.mkdir(parents=True, exist_ok=True)
    if place.trial in SEEDED:
        seeds = [randbits(SEED_BITS) for _ in range(cases)]
        truths = []
        for number, seed in enumerate(seeds):
            drawn = SEEDED[place.trial](seed, number)
            drawn.write(place.folder / f"case_{number:05d}")
            truths.append(drawn.truth)
    else:
        laboratory, seed = LABORATORIES[place.trial], randbits(SEED_BITS)
        truths = laboratory.draw(random.Random(seed))
        seeds = [seed] * len(truths)
    lines = [f"{k},{digest(truth_text(seeds[k], k, truth))}" for k, truth in enumerate(truths)]
    write_atomic(file, json.dumps([f"{seed:x}" for seed in seeds]).encode())
    write_atomic(place.seals, "\n".join(["case,sha256", *lines, ""]).encode())


def committed(file: Path) -> bool:
    """Whether a file is in the history as it is."""
    words = ["git", "status", "--porcelain", "--ignored", "--", str(file)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    return file.exists() and not done.stdout


def opened(place: SealedSet, secret: Path) -> list[tuple[int, str, Any]]:
    """Seed, digest and case of every number; raises ValueError where a truth is not the one sealed."""
    file = secret / f"{place.trial}_{place.name}.json"
    seeds = [int(seed, 16) for seed in json.loads(file.read_text(encoding="utf-8"))]
    if place.trial in SEEDED:
        cases: Sequence[Any] = [SEEDED[place.trial](seed, k) for k, seed in enumerate(seeds)]
    else:
        cases = LABORATORIES[place.trial].draw(random.Random(seeds[0]))
    lines = place.seals.read_text(encoding="utf-8").split()[1:]
    found = []
    for k, (seed, case, line) in enumerate(zip(seeds, cases, lines, strict=True)):
        text = truth_text(seed, k, case.truth if isinstance(case, SeededCase) else case)
        if line != f"{k},{digest(text)}":
            raise ValueError(f"{place.name}, case {k}: the truth is not the one that was sealed")
        found.append((seed, digest(text), case))
    return found


def answered_again(trial: str, row: Row, method: str) -> Row:
    """A stored case drawn again from its seed. Raises ValueError where that gives another one."""
    case = SEEDED[trial](int(row["seed"], 16), row["case"])
    if plain(case.truth) != plain(row["truth"]):
        raise ValueError(f"{trial}, {row['set']}, case {row['case']} is drawn otherwise than it was")
    head = {"set": f"{row['set']}, again", "method": method}
    return (
        row | head | case.row(case.answer(row["case"])) | {key: row[key] for key in ("truth", "difficulty")}
    )


def plain(truth: Mapping[str, Any]) -> tuple[Any, ...]:
    """What two draws of one case have in common."""
    return truth.get("kind"), truth.get("name"), tuple(truth.get("effects") or ())


def rows(place: SealedSet, secret: Path) -> list[Row]:
    """Truth beside answer of every case that is answered."""
    found = []
    for number, (seed, sealed, case) in enumerate(opened(place, secret)):
        file = place.folder / f"case_{number:05d}.json"
        if not file.exists():
            continue
        answer = json.loads(file.read_text(encoding="utf-8"))
        head = {"set": place.name, "case": number, "sha256": sealed, "method": answer.pop("method")}
        told = case.row(answer) if isinstance(case, SeededCase) else {"truth": case, "answer": answer}
        found.append({**head, "seed": f"{seed:x}", **told})
    return found


@app.command("seal")
def seal_command(trial: str, name: str, secret: Secret, cases: int = 500) -> None:
    """Draw a set; commit its digests before it is solved."""
    if secret.resolve().is_relative_to(ROOT):
        raise typer.BadParameter(f"{secret} lies in the tree")
    seal(SealedSet(trial, name), secret, cases)


@app.command()
def make(trial: str, name: str, secret: Secret) -> None:
    """Tables and studies of laboratories that simulate, with another seed than drew them."""
    cases = opened(place := SealedSet(trial, name), secret)
    place.folder.mkdir(parents=True, exist_ok=True)
    LABORATORIES[trial].measure(place.folder, [case for *_, case in cases], cases[0][0] + 1)


@app.command("solve")
def solve_command(trial: str, name: str, processes: int = 1) -> None:
    """Answer every case that has no answer yet."""
    place = SealedSet(trial, name)
    if not committed(place.seals):
        raise typer.BadParameter(f"commit {place.seals} first")
    answer_all(place.tasks, processes)


@app.command("open")
def open_command(trial: str, name: str, secret: Secret) -> None:
    """Compare the answers with the truths."""
    add_rows(trial, rows(SealedSet(trial, name), secret))
    sys.stdout.writelines(scores(trial, [name]))


@app.command()
def again(trial: str, name: str, cases: int = 200, first: int = 0, processes: int = 1) -> None:
    """Answer stored cases by the present method."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    stored = [row for row in read_rows(table_of(trial)) if row["set"] == name and "seed" in row]
    wanted = stored[first : first + cases]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        add_rows(trial, list(pool.map(answered_again, repeat(trial), wanted, repeat(method_commit()))))
    sys.stdout.writelines(scores(trial, [f"{name}, again"]))


if __name__ == "__main__":
    app()
