"""Pages (HTML) and recordings (.rrd) of runs, calibrations and evidence studies."""

from pathlib import Path
from types import ModuleType


def write_report(source: Path, to: Path | None = None, force: bool = False) -> Path:
    """Write the page of a study (TOML), or of a run (its JSON document or its recording).

    `force` replaces a file that is not the page of this study or run.
    """
    from taichi_erosion.report import run_page

    page = run_page if source.suffix in (".json", ".rrd") else page_module(source)
    return page.write_report(source, to, force)


def write_recording(study: Path) -> Path:
    """Write the recording of a study from the files in its folder. Raises BadInput where there are none."""
    return page_module(study).write_recording(study)


def page_module(study: Path) -> ModuleType:
    """Pages of calibrations, whose study file has targets, or of evidence studies. Raises BadInput."""
    from taichi_erosion.campaign.study_file import read_study_file
    from taichi_erosion.report import calibration_page, study_page

    return calibration_page if read_study_file(study, lambda _: iter(())).targets else study_page
