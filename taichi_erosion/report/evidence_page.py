"""What would change the conclusion of an evidence study, in sentences, as far as its numbers know.

The report of an evidence study: one HTML page that needs nothing else, made from kept documents.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import read_evidence_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers import documents as results
from taichi_erosion.evidence.inference.levels import ABSORBED, STABLE, fails
from taichi_erosion.evidence.models.load_study import results_folder
from taichi_erosion.report import evidence_figures as figures
from taichi_erosion.report.html import Picture, render

Document = Mapping[str, Any]


def doubts(
    comparison: Document | None, discovery: Document | None, adoption: Document | None
) -> Iterator[str]:
    """All doubts, those about the noise first."""
    noise = (discovery or comparison or {})["noise"]["observables"]
    unrepeated = ", ".join(name for name, budget in noise.items() if budget["repeats"] < 1)
    if unrepeated:
        yield f"Repeats: the scatter of {unrepeated} is stated, not seen; if it is larger, misfits shrink."
    if not any(budget["numerical"] for budget in noise.values()):
        yield (
            "Numerics: no tolerance for box, time step and grain number is declared; a smooth bias of the "
            "model would look like physics."
        )
    if discovery:
        yield from doubts_about_names(discovery)
        yield from doubts_about_runs(discovery)
    if adoption and adoption["vault"]["opened"] > 1:
        yield (
            "The vault has been opened more than once: its error is not that of unseen measurements any more."
        )


def doubts_about_names(discovery: Document) -> Iterator[str]:
    """What could be wrong with the names."""
    effects = discovery["effects"]
    hiding = ", ".join(name for name, effect in effects.items() if effect["status"] == "not_testable")
    if hiding:
        yield f"Hidden: {hiding} could act without these measurements showing it."
    for name in dict.fromkeys((*discovery["named"], *discovery["group"])):
        if (effects.get(name, {}).get("absorption") or 0.0) > ABSORBED:
            parameter = discovery["absorbed_by"].get(name, "a calibrated number")
            yield f"Calibration imitates most of {name}: measure {parameter} by itself to break this."
    if len(discovery["group"]) > 1:
        yield f"These measurements do not tell {', '.join(discovery['group'])} apart."


def doubts_about_runs(discovery: Document) -> Iterator[str]:
    """What could be wrong with the runs behind the names."""
    if discovery["decoy_rank"] == 1:
        yield "A made-up effect fits best of all: the shortlist is not to be trusted."
    stability = discovery["stability"]
    if stability is not None and stability < STABLE:
        yield f"With other seeds the first name is the same in {100.0 * stability:.0f} % of repeats."
    if discovery["failures"]:
        yield f"{discovery['failures']} model values could not be computed; they were left out."


TEMPLATE = "evidence.html"
CONTROLS = {"best_wrong": "control: best other effect", "random_wrong": "control: effect drawn at random"}
NO_MISFIT = "No misfit is seen in any observable or along any condition."
TIMES = {0: "has not been opened", 1: "has been opened once"}


@dataclass(frozen=True)
class Found:
    """Everything that was found about a study; None for a question that was not asked."""

    comparison: Document | None
    discovery: Document | None
    adoption: Document | None
    experiments: Document | None
    rungs: Sequence[Document] = ()

    @property
    def asked(self) -> dict[str, Document]:
        """Answers by the command that gave them."""
        answers = {
            "discover": self.discovery,
            "compare": self.comparison,
            "adopt": self.adoption,
            "next": self.experiments,
        }
        return {command: document for command, document in answers.items() if document is not None}

    @property
    def first(self) -> Document:
        """The answer that knows most about the study."""
        return next(iter(self.asked.values()))


def write_report(study: Path, to: Path | None = None) -> Path:
    """Write the page of a study; raises BadInput where nothing has been found yet."""
    folder, page = results_folder(study, read_evidence_study(study)), words(found_in(study))
    return write_atomic(to or folder / f"{study.stem}.report.html", render(TEMPLATE, page).encode())


def found_in(study: Path) -> Found:
    """What was found about a study; raises BadInput where that is nothing yet."""
    folder = results_folder(study, read_evidence_study(study))
    found = Found(
        results.recall(folder, study.stem, "compare"),
        results.recall(folder, study.stem, "discover"),
        results.recall(folder, study.stem, "adopt"),
        results.recall(folder, study.stem, "next"),
        results.ladder(folder),
    )
    if found.comparison is None and found.discovery is None:
        raise BadInput(f"{study}: nothing has been found yet; run compare or discover on it first")
    return found


def words(found: Found) -> dict[str, Any]:
    """What the template is given."""
    first, adoption, discovery = found.first, found.adoption, found.discovery
    return {
        "title": first["title"] or Path(first["study"]).stem,
        "about": f"{first['measurements']}, answered by {first['model']}",
        "units": first["units"],
        "summary": summary(found),
        "comparison": found.comparison,
        "discovery": discovery,
        "adoption": adoption,
        "where": failures(found.comparison) or [NO_MISFIT],
        "effects": ranked_effects(discovery),
        "groups": groups(discovery),
        "clues": [clue["sentence"] for clue in discovery["clues"]] if discovery else [],
        "vault": vault_sentences(found),
        "fits_of_adoption": list(fits(adoption)),
        "adoption_parameters": calibrated(adoption),
        "doubts": list(doubts(found.comparison, discovery, adoption)),
        "experiments": (found.experiments or discovery or {"next_experiments": []})["next_experiments"],
        "notes": list(dict.fromkeys([*first["notes"], *first.get("warnings", [])])),
        "facts": list(facts(found)),
        "figures": pictures(found),
    }


def pictures(found: Found) -> dict[str, Picture | None]:
    """All figures; None where there is nothing to draw."""
    comparison, discovery, adoption = found.comparison, found.discovery, found.adoption
    before = comparison["rows"] if comparison else discovery["rows_before"] if discovery else None
    after = adoption["added"]["rows"] if adoption else discovery["rows_after"] if discovery else None
    seen = adoption if adoption and adoption["base"]["vault_chi2"] is not None else None
    return {
        "agreement": figures.draw_agreement(before, found.first["units"]) if before else None,
        "residuals": figures.draw_residuals(before, after) if before else None,
        "posterior": figures.draw_posterior(discovery["probabilities"]) if discovery else None,
        "vault": figures.draw_vault(seen) if seen else None,
        "ladder": figures.draw_ladder(found.rungs) if len(found.rungs) > 1 else None,
    }


def summary(found: Found) -> list[str]:
    """The sentences that most readers will read."""
    told = failures(found.comparison)[:2]
    told += found.discovery["sentences"][:1] if found.discovery else []
    told += [found.adoption["sentence"]] if found.adoption else []
    return told or ["The calibrated model is consistent with the measurements that it was shown."]


def failures(comparison: Document | None) -> list[str]:
    """Places where the model fails."""
    places = comparison["where"] if comparison else ()
    return [place["sentence"] for place in places if fails(place["p"])]


def ranked_effects(discovery: Document | None) -> list[tuple[str, Document]]:
    """Candidates, the likeliest first."""
    effects = discovery["effects"] if discovery else {}
    return sorted(effects.items(), key=lambda item: -(item[1]["probability"] or 0.0))


def groups(discovery: Document | None) -> list[str]:
    """Effects that cannot be told apart."""
    twins = discovery["ambiguity"] if discovery else {}
    return sorted({", ".join(sorted((name, *others))) for name, others in twins.items() if others})


def vault_sentences(found: Found) -> list[str]:
    """What was held out, and how often it has been looked at."""
    told = [note for note in found.first["notes"] if "held out" in note]
    opened = (found.adoption or found.first).get("vault", {}).get("opened", 0)
    return [*told, f"The vault {TIMES.get(opened, f'has been opened {opened} times')}."]


def fits(adoption: Document | None) -> Iterator[tuple[str, Document]]:
    """Fits of an adoption with their names."""
    if adoption is None:
        return
    yield "as it was", adoption["base"]
    yield f"with {adoption['effect']}", adoption["added"]
    for key, label in CONTROLS.items():
        if adoption[key] is not None:
            yield f"{label} ({', '.join(adoption[key]['effects'])})", adoption[key]


def calibrated(adoption: Document | None) -> Document:
    """Strengths and parameters once the effect is in the model."""
    return {**adoption["added"]["strengths"], **adoption["added"]["parameters"]} if adoption else {}


def facts(found: Found) -> Iterator[tuple[str, str]]:
    """Everything needed to do it again."""
    first = found.first
    yield "study", first["study"]
    yield "model", first["model"]
    yield "measurements", f"{first['measurements']}, digest {first['digest']}"
    yield "rows", f"{first['rows_visible']} fitted, {first['rows_hidden']} held out"
    yield "candidates", ", ".join(first["candidates"]) or "none"
    yield "seed", str(first["seed"])
    for command, document in found.asked.items():
        if "runs" in document:
            yield f"cost of {command}", f"{document['runs']} runs, {document['wall_s']:.1f} s"
    yield "versions", ", ".join(f"{name} {number}" for name, number in first["versions"].items())
