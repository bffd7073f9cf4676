"""Pages (HTML) and recordings (.rrd) of runs, calibrations and evidence studies."""

import tomllib
from pathlib import Path

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file

RUNS = (".json", ".rrd")


def write_report(source: Path, to: Path | None = None, force: bool = False) -> Path:
    """Write the page of a study (TOML), or of a run (its JSON document or its recording).

    `force` replaces a file that is not the page of this study or run.
    """
    from taichi_erosion.report import calibration_page, run_page, study_page

    if source.suffix in RUNS:
        return run_page.write_report(source, to, force)
    return (calibration_page if is_calibration(source) else study_page).write_report(source, to, force)


def write_recording(study: Path) -> Path:
    """Write the recording of a study from the files in its folder. Raises BadInput where there are none."""
    from taichi_erosion.report import calibration_page, study_page

    return (calibration_page if is_calibration(study) else study_page).write_recording(study)


def is_calibration(study: Path) -> bool:
    """Whether a study file has targets (calibration) instead of measurements (evidence)."""
    try:
        return "targets" in tomllib.loads(read_text_file(study))
    except FileNotFoundError:
        raise BadInput(f"{study}: no such file") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{study}: {error}") from None
