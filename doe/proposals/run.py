"""Six proposed experiments against six random ones on sealed cases: draws, asks, measures, solves, opens.

python -m doe.proposals.run draw NAME FOLDER SECRET    problems; truths elsewhere, their digest here
python -m doe.proposals.run ask NAME FOLDER            answers before, proposals, random requests; goes on
python -m doe.proposals.run measure NAME FOLDER SECRET both kinds of measurements, by the laboratory
python -m doe.proposals.run solve NAME FOLDER          answers with either; goes on where it was stopped
python -m doe.proposals.run open NAME FOLDER SECRET    results/NAME.csv and the page
python -m doe.proposals.run page                       only the page
"""

import json
import pickle
import secrets
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import typer

from doe.common.method import method_commit
from doe.proposals.cases import (
    SLOTS,
    drawn_cases,
    laboratory,
    measured_too,
    proposed_requests,
    random_requests,
)
from doe.proposals.page import FOLDER, publish, results_of, write_rows
from doe.sealed.laboratory import Truth
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discovery_of
from taichi_erosion.evidence.answers.next_experiments import next_experiments
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.inference.pipeline import Analysis, confirmed_analysis
from taichi_erosion.evidence.inference.prepared_problem import prepare

ARMS = ("proposed", "random")
SILENT = (
    "none_detected",
    "not_testable",
    "group",
    "unstable",
)  # verdicts after which a user would ask `next`
app = typer.Typer(add_completion=False)


@app.command()
def draw(name: str, folder: Path, secret: Path, share: float = 1.0) -> None:
    """Problems and truths, with a salt of the operating system; commit the digest before asking."""
    salt, truths = secrets.randbits(63), []
    for number, case in enumerate(drawn_cases(salt, share)):
        write(folder / name / "before" / f"{number:03d}.pickle", pickle.dumps(case.problem))
        truths.append({"truth": asdict(case.truth), "level": case.level})
    sealed = json.dumps({"salt": salt, "cases": truths})
    write(secret / f"{name}.json", sealed.encode())
    write(FOLDER / "seals" / f"{name}.sha256", f"{sha256(sealed.encode()).hexdigest()}\n".encode())


def write(path: Path, content: bytes) -> None:
    """Write a file, its folder made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, content)


@app.command()
def ask(name: str, folder: Path, every: int = 1, first: int = 0) -> None:
    """Answers before, of one case in so many; where no name stands, proposals and random requests."""
    for path in sorted((folder / name / "before").glob("*.pickle"))[first::every]:
        if path.with_suffix(".json").exists():
            continue
        problem, number = pickle.loads(path.read_bytes()), int(path.stem)
        found = analysed(problem, number)
        if found.decision.verdict in SILENT:
            spare = random_requests(np.random.default_rng(number), problem)
            proposed = next_experiments(problem, discovery_of(found, number), laboratory(problem))
            asked = {
                "proposals": len(proposed.experiments),
                "chance": proposed.experiments[-1].chance if proposed.experiments else 0.0,
                "sentence": proposed.sentence,
                "proposed": proposed_requests(proposed.experiments, spare),
                "random": spare,
            }
            write(folder / name / "requests" / f"{path.stem}.json", json.dumps(asked).encode())
        answer = answer_of(found) | {"method": method_commit()}
        write(path.with_suffix(".json"), json.dumps(answer).encode())


def analysed(problem: Problem, number: int) -> Analysis:
    """The inference of `discover`, without what only its sentences need."""
    return confirmed_analysis(prepare(problem, problem.visible(), number), number, no_progress)


def answer_of(found: Analysis) -> dict[str, Any]:
    """What scoring needs of an answer."""
    decision = found.decision
    return {
        "verdict": decision.verdict,
        "named": list(decision.named),
        "group": list(decision.group),
        "probabilities": dict(found.posterior.probability),
    }


def truths_of(name: str, secret: Path) -> dict[str, Any]:
    """The truths; raises BadParameter where they are not those that were sealed."""
    sealed = (secret / f"{name}.json").read_text(encoding="utf-8")
    if sha256(sealed.encode()).hexdigest() != (FOLDER / "seals" / f"{name}.sha256").read_text().strip():
        raise typer.BadParameter("the truths are not those that were sealed")
    return json.loads(sealed)


@app.command()
def measure(name: str, folder: Path, secret: Path) -> None:
    """What the laboratory measures where it is asked, with a noise of its own for every request."""
    sealed = truths_of(name, secret)
    for path in sorted((folder / name / "requests").glob("*.json")):
        asked, case = json.loads(path.read_text(encoding="utf-8")), sealed["cases"][int(path.stem)]
        problem = pickle.loads((folder / name / "before" / f"{path.stem}.pickle").read_bytes())
        for arm, kind in enumerate(ARMS):
            generator = np.random.default_rng([sealed["salt"], int(path.stem), arm])
            more = measured_too(generator, problem, Truth(**case["truth"]), case["level"], asked[kind])
            write(folder / name / kind / f"{path.stem}.pickle", pickle.dumps(more))


@app.command()
def solve(name: str, folder: Path) -> None:
    """Answers with six more measurements of either kind."""
    for request in sorted((folder / name).glob("requests/*.json")):
        for arm in ARMS:
            path = folder / name / arm / f"{request.stem}.pickle"
            if not path.with_suffix(".json").exists():
                found = analysed(pickle.loads(path.read_bytes()), int(path.stem))
                write(path.with_suffix(".json"), json.dumps(answer_of(found)).encode())


@app.command("open")
def unseal(name: str, folder: Path, secret: Path) -> None:
    """The table of results, and the page."""
    rows = []
    for number, case in enumerate(truths_of(name, secret)["cases"]):
        before = folder / name / "before" / f"{number:03d}.json"
        if before.exists():
            told = json.loads(before.read_text(encoding="utf-8"))
            method = told.pop("method")
            rows.append(row_of(folder / name, number, case["truth"], told) | {"method": method})
    write_rows(results_of(name), rows)
    page()


def row_of(place: Path, number: int, truth: dict[str, Any], before: dict[str, Any]) -> dict[str, str]:
    """Truth beside the answers before and with either kind of measurements."""
    row = {
        "number": str(number),
        "kind": truth["kind"],
        "truth": "+".join(f"{name} {strength:.3g}" for name, strength in truth["effects"].items()),
        "proposals": "",
        "chance": "",
    }
    told = {"before": before}
    request = place / "requests" / f"{number:03d}.json"
    if request.exists():
        asked = json.loads(request.read_text(encoding="utf-8"))
        row |= {"proposals": str(asked["proposals"]), "chance": f"{asked['chance']:.3f}"}
        for arm in ARMS:
            answer = place / arm / f"{number:03d}.json"
            told |= {arm: json.loads(answer.read_text(encoding="utf-8"))} if answer.exists() else {}
    for arm in ("before", *ARMS):
        row |= answer_columns(arm, truth["effects"], told.get(arm))
    return row


def answer_columns(arm: str, effects: dict[str, float], told: dict[str, Any] | None) -> dict[str, str]:
    """Verdict, names and probability of the truth of one answer; empty where there is none."""
    if told is None:
        return {f"{arm} {what}": "" for what in ("verdict", "named", "group", "probability")}
    key = next((k for k in told["probabilities"] if effects and set(k.split("+")) == set(effects)), "none")
    return {
        f"{arm} verdict": told["verdict"],
        f"{arm} named": "+".join(told["named"]),
        f"{arm} group": "+".join(told["group"]),
        f"{arm} probability": f"{told['probabilities'][key] if effects == {} or key != 'none' else 0.0:.4f}",
    }


@app.command()
def page() -> None:
    """The page, from the tables of results."""
    publish(SLOTS)


if __name__ == "__main__":
    app()
