"""Page of an evidence study: one self-contained HTML file, or a recording, from the stored results.

The page ends with the limits of the conclusion: what could change it.
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
from taichi_erosion.recording.study_recording import StudyPage, record_study
from taichi_erosion.report import figures
from taichi_erosion.report.figures import Picture
from taichi_erosion.report.html import number, render
from taichi_erosion.report.markdown import markdown_table

Document = Mapping[str, Any]

TEMPLATE = "evidence.html"
RECORDING = "study.rrd"
COMMANDS = ("discover", "compare", "adopt", "next")  # the most complete result first


CONTROLS = {"best_wrong": "control: best other effect", "random_wrong": "control: effect drawn at random"}
NO_MISFIT = "No significant misfit in any observable or along any condition."
UNDECLARED_NUMERICS = (
    "Numerics: the study declares no tolerance for box, time step and grain number. A smooth numerical error "
    "of the model would look like a missing effect."
)
TIMES = {0: "has not been opened", 1: "was opened once"}


@dataclass(frozen=True)
class Results:
    """Stored results of a study."""

    by_command: Mapping[str, Document]  # the most complete first
    adoptions: Sequence[Document] = ()

    @property
    def first(self) -> Document:
        """Most complete result."""
        return next(iter(self.by_command.values()))


def write_report(study: Path, to: Path | None = None) -> Path:
    """Write the HTML page of a study. Raises BadInput without a stored result."""
    folder, page = results_folder(study, read_evidence_study(study)), page_fields(stored_results(study))
    return write_atomic(to or folder / f"{study.stem}.report.html", render(TEMPLATE, page).encode())


def write_recording(study: Path) -> Path:
    """Write the recording of a study. Raises BadInput without a stored result."""
    found, folder = stored_results(study), results_folder(study, read_evidence_study(study))
    first = found.first
    title = first["title"] or Path(first["study"]).stem
    page = StudyPage(
        title=title,
        summary="\n\n".join([f"# {title}", *summary(found)]),
        table=row_table(found),
        figures={name: figures.raster(drawn) for name, drawn in pictures(found).items() if drawn is not None},
        properties={"rows": first["rows_visible"], "held_out": first["rows_hidden"], "seed": first["seed"]},
    )
    return record_study(folder / f"{study.stem}.{RECORDING}", page)


def row_table(found: Results) -> str:
    """Measured and predicted values of every fitted row."""
    comparison, discovery, _ = main_results(found)
    rows = (comparison or {}).get("rows") or (discovery or {})["rows_before"]
    axes = list(rows["conditions"])
    columns = [rows["conditions"][axis] for axis in axes]
    columns += [rows[key] for key in ("measured", "predicted", "residual")]
    header = ["observable", *axes, "measured", "model", "residual, sd"]
    cells = [
        [name, *(number(column[place]) for column in columns)]
        for place, name in enumerate(rows["observable"])
    ]
    return markdown_table(header, cells)


def stored_results(study: Path) -> Results:
    """Stored results of a study. Raises BadInput where there are none."""
    folder = results_folder(study, read_evidence_study(study))
    answers = {command: results.read_answer(folder, study.stem, command) for command in COMMANDS}
    found = {command: document for command, document in answers.items() if document is not None}
    if not found.keys() & {"compare", "discover"}:
        raise BadInput(f"{study}: no results yet; run compare or discover on it first")
    return Results(found, results.ladder(folder))


def main_results(found: Results) -> tuple[Document | None, ...]:
    """Results of compare, discover and adopt; None for a command that has not run."""
    return tuple(found.by_command.get(command) for command in ("compare", "discover", "adopt"))


def page_fields(found: Results) -> dict[str, Any]:
    """Fields of the template."""
    first, next_ = found.first, found.by_command.get("next")
    comparison, discovery, adoption = main_results(found)
    return {
        "title": first["title"] or Path(first["study"]).stem,
        "about": f"{first['measurements']}, answered by {first['model']}",
        "units": first["units"],
        "summary": summary(found),
        "comparison": comparison,
        "discovery": discovery,
        "adoption": adoption,
        "where": failures(comparison) or [NO_MISFIT],
        "effects": ranked_effects(discovery),
        "groups": groups(discovery),
        "clues": [clue["sentence"] for clue in discovery["clues"]] if discovery else [],
        "vault": vault_sentences(found),
        "fits_of_adoption": list(fits(adoption)),
        "adoption_parameters": calibrated(adoption),
        "limits": list(limits(found)),
        "experiments": (next_ or discovery or {"next_experiments": []})["next_experiments"],
        "notes": list(dict.fromkeys([*first["notes"], *first.get("warnings", [])])),
        "facts": list(facts(found)),
        "figures": pictures(found),
    }


def pictures(found: Results) -> dict[str, Picture | None]:
    """Figures by name; None without data."""
    comparison, discovery, adoption = main_results(found)
    before = comparison["rows"] if comparison else discovery["rows_before"] if discovery else None
    after = adoption["added"]["rows"] if adoption else discovery["rows_after"] if discovery else None
    tested = adoption if adoption and adoption["base"]["vault_chi2"] is not None else None
    return {
        "agreement": figures.draw_agreement(before, found.first["units"]) if before else None,
        "residuals": figures.draw_residuals(before, after) if before else None,
        "posterior": figures.draw_posterior(discovery["probabilities"]) if discovery else None,
        "vault": figures.draw_vault(tested) if tested else None,
        "adoptions": figures.draw_adoptions(found.adoptions) if len(found.adoptions) > 1 else None,
    }


def summary(found: Results) -> list[str]:
    """Lead sentences of the page."""
    comparison, discovery, adoption = main_results(found)
    sentences = failures(comparison)[:2]
    sentences += discovery["sentences"][:1] if discovery else []
    sentences += [adoption["sentence"]] if adoption else []
    return sentences or ["The calibrated model agrees with the measurements of the fit."]


def failures(comparison: Document | None) -> list[str]:
    """Sentences on the places of significant misfit."""
    places = comparison["where"] if comparison else ()
    return [place["sentence"] for place in places if fails(place["p"])]


def ranked_effects(discovery: Document | None) -> list[tuple[str, Document]]:
    """Candidates in order of probability."""
    effects = discovery["effects"] if discovery else {}
    return sorted(effects.items(), key=lambda item: -(item[1]["probability"] or 0.0))


def groups(discovery: Document | None) -> list[str]:
    """Groups of effects that the measurements cannot separate."""
    twins = discovery["ambiguity"] if discovery else {}
    return sorted({", ".join(sorted((name, *others))) for name, others in twins.items() if others})


def vault_sentences(found: Results) -> list[str]:
    """Held-out rows, and how often the vault was opened."""
    sentences = [note for note in found.first["notes"] if "held out" in note]
    opened = found.by_command.get("adopt", found.first).get("vault", {}).get("opened", 0)
    return [*sentences, f"The vault {TIMES.get(opened, f'was opened {opened} times')}."]


def fits(adoption: Document | None) -> Iterator[tuple[str, Document]]:
    """Fits of an adoption with their labels."""
    if adoption is None:
        return
    yield "before", adoption["base"]
    yield f"with {adoption['effect']}", adoption["added"]
    for key, label in CONTROLS.items():
        if adoption[key] is not None:
            yield f"{label} ({', '.join(adoption[key]['effects'])})", adoption[key]


def calibrated(adoption: Document | None) -> Document:
    """Strengths and parameters of the model with the adopted effect."""
    return {**adoption["added"]["strengths"], **adoption["added"]["parameters"]} if adoption else {}


def facts(found: Results) -> Iterator[tuple[str, str]]:
    """Inputs and versions, for a repeat."""
    first = found.first
    yield "study", first["study"]
    yield "model", first["model"]
    yield "measurements", f"{first['measurements']}, digest {first['digest']}"
    yield "rows", f"{first['rows_visible']} fitted, {first['rows_hidden']} held out"
    yield "candidates", ", ".join(first["candidates"]) or "none"
    yield "seed", str(first["seed"])
    for command, document in found.by_command.items():
        if "runs" in document:
            yield f"cost of {command}", f"{document['runs']} runs, {document['wall_s']:.1f} s"
    yield "versions", ", ".join(f"{name} {number}" for name, number in first["versions"].items())


def limits(found: Results) -> Iterator[str]:
    """Limits of the conclusion, one sentence each: noise, names, runs, vault."""
    comparison, discovery, adoption = main_results(found)
    noise = (discovery or comparison or {})["noise"]["observables"]
    if unrepeated := ", ".join(name for name, budget in noise.items() if budget["repeats"] < 1):
        yield f"Repeats: the scatter of {unrepeated} is stated, not checked. A larger one lowers misfits."
    if not any(budget["numerical"] for budget in noise.values()):
        yield UNDECLARED_NUMERICS
    if discovery:
        yield from limits_of_names(discovery)
        yield from limits_of_runs(discovery)
    if adoption and adoption["vault"]["opened"] > 1:
        yield "Vault: it was opened more than once. Its rows are no longer unseen data."


def limits_of_names(discovery: Document) -> Iterator[str]:
    """Limits of the named effects."""
    effects = discovery["effects"]
    if hidden := ", ".join(name for name, effect in effects.items() if effect["status"] == "not_testable"):
        yield f"Not testable: these measurements cannot show {hidden}, even if present."
    for name in dict.fromkeys((*discovery["named"], *discovery["group"])):
        if (effects.get(name, {}).get("absorption") or 0.0) > ABSORBED:
            parameter = discovery["absorbed_by"].get(name, "a calibrated parameter")
            yield f"Absorption: {parameter} can imitate most of {name}. Measure that parameter separately."
    if len(discovery["group"]) > 1:
        yield f"Group: these measurements cannot separate {', '.join(discovery['group'])}."


def limits_of_runs(discovery: Document) -> Iterator[str]:
    """Limits of the runs behind the named effects."""
    if discovery["decoy_rank"] == 1:
        yield "Decoy: an artificial effect fits best. The shortlist of effects is not reliable."
    stability = discovery["stability"]
    if stability is not None and stability < STABLE:
        yield f"Seeds: {100.0 * stability:.0f} % of the repeats with other seeds name the same effect first."
    if discovery["failures"]:
        yield f"Failures: {discovery['failures']} model values could not be computed and are left out."
