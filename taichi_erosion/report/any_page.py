"""The report of whatever a file describes: a run, a calibration, or an evidence study."""

import tomllib
from pathlib import Path

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file
from taichi_erosion.report import calibration_page, evidence_page, run_page

RUNS = (".json", ".rrd")


def write_report(source: Path, to: Path | None = None) -> Path:
    """Write the page of a study (TOML), or of a run (its document or its recording)."""
    if source.suffix in RUNS:
        return run_page.write_report(source, to)
    return (calibration_page if is_calibration(source) else evidence_page).write_report(source, to)


def is_calibration(study: Path) -> bool:
    """Whether a study has targets to be met, instead of measurements to be explained."""
    try:
        return "targets" in tomllib.loads(read_text_file(study))
    except FileNotFoundError:
        raise BadInput(f"{study}: no such file") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{study}: {error}") from None
