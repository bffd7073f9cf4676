"""A study as a recording: figures, table of runs and sentences beside the heaps that were recorded."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import CalibrationStudy, read_calibration_study, read_evidence_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.models.load_study import results_folder
from taichi_erosion.recording.study_recording import Shown, StudyPage, record_study
from taichi_erosion.report import evidence_page
from taichi_erosion.report.any_page import is_calibration
from taichi_erosion.report.calibration_page import PAGE
from taichi_erosion.report.html import figure, raster
from taichi_erosion.report.markdown import markdown_table

Row = Mapping[str, str]

NAME = "study.rrd"
MOST_RUNS = 9  # heaps side by side
STAGES = ("confirm", "surface", "climb", "screen")  # runs that are shown first come first


def write_recording(study: Path) -> Path:
    """Write the recording of a study from what it has left in its folder; BadInput where that is nothing."""
    if is_calibration(study):
        file = read_calibration_study(study)
        return record_study(file.folder / NAME, calibration(study, file))
    folder = results_folder(study, read_evidence_study(study))
    return record_study(folder / f"{study.stem}.{NAME}", evidence(evidence_page.found_in(study)))


def calibration(study: Path, file: CalibrationStudy) -> StudyPage:
    """What a calibration has to show."""
    page, table = file.folder / PAGE, file.folder / "runs.csv"
    if not page.is_file() or not table.is_file():
        raise BadInput(f"{study}: not calibrated yet; run doe calibrate on it first")
    with table.open(encoding="utf-8", newline="") as text:
        rows = list(csv.DictReader(text))
    figures = {path.stem.replace("_", " "): path for path in sorted((file.folder / "pictures").glob("*.png"))}
    lines = [line for line in page.read_text(encoding="utf-8").splitlines() if not line.startswith("![")]
    return StudyPage(
        title=file.study.study.title or study.stem,
        summary="\n".join(lines),
        table=run_table(file, rows),
        figures={name: path.read_bytes() for name, path in figures.items()},
        runs=list(recorded_runs(file, rows))[:MOST_RUNS],
        properties={f"target_{name}": target.value for name, target in file.study.targets.items()},
    )


def run_table(file: CalibrationStudy, rows: Sequence[Row]) -> str:
    """Every run: what was set, what came out."""
    paths, targets = list(file.study.parameters), list(file.study.targets)
    header = ["run", *(file.study.parameters[path].label or path for path in paths), *targets]
    cells = [[name_of(row), *(row[key] for key in (*paths, *targets))] for row in rows]
    return markdown_table(header, cells)


def name_of(row: Row) -> str:
    """Name of a run."""
    return f"{row['stage']}-{row['row']}"


def recorded_runs(file: CalibrationStudy, rows: Sequence[Row]) -> Iterator[Shown]:
    """Runs whose recording is there, those of the last stages first."""
    for row in sorted(rows, key=lambda row: STAGES.index(row["stage"])):
        recording = file.folder / "recordings" / f"{name_of(row)}-{row['seed']}.rrd"
        if recording.is_file():
            results = {name: float(row[name]) for name in file.study.targets if row[name]}
            told = ", ".join(
                f"{name} {value:.3g} {file.study.targets[name].unit}" for name, value in results.items()
            )
            settings = {
                path.replace(".", "_").replace("-", "_"): float(row[path]) for path in file.study.parameters
            }
            yield Shown(name_of(row), f"{name_of(row)}: {told}", recording, settings | results)


def evidence(found: evidence_page.Found) -> StudyPage:
    """What an evidence study has to show."""
    first = found.first
    pictures = evidence_page.pictures(found).items()
    facts: dict[str, Any] = {
        "rows": first["rows_visible"],
        "held_out": first["rows_hidden"],
        "seed": first["seed"],
    }
    title = first["title"] or Path(first["study"]).stem
    sentences = evidence_page.summary(found)
    return StudyPage(
        title=title,
        summary="\n\n".join([f"# {title}", *sentences]),
        table=row_table(found),
        figures={name: raster(drawn) for name, drawn in pictures if drawn is not None},
        properties=facts,
    )


def row_table(found: evidence_page.Found) -> str:
    """Every measured row beside the calibrated model."""
    rows = (found.comparison or {}).get("rows") or (found.discovery or {})["rows_before"]
    axes = list(rows["conditions"])
    columns = [rows["conditions"][axis] for axis in axes]
    columns += [rows[key] for key in ("measured", "predicted", "residual")]
    header = ["observable", *axes, "measured", "model", "residual, sd"]
    cells = [
        [name, *(figure(column[place]) for column in columns)]
        for place, name in enumerate(rows["observable"])
    ]
    return markdown_table(header, cells)
