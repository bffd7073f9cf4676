"""Last lines of commands on scenes and calibrations: what the result means, and which command comes next."""

import os
import tomllib
from collections.abc import Iterator, Mapping
from math import hypot, isfinite, sqrt
from pathlib import Path
from typing import Any

from taichi_erosion.core.files import read_text_file
from taichi_erosion.evidence.words.shell import shell_command

Record = Mapping[str, Any]

FAR = 3.0  # scatters of both sides together, from which a difference is far outside [1]
ERRORS = 2.0  # standard errors, from which a difference is more than chance [1]
ANGLES = {"repose_angle", "angle_of_repose", "cone_angle", "envelope_angle"}  # of a heap
LEAST_RUNS = 2  # that show a scatter
STUDY_FOLDERS = (".", "../doe", "../studies")  # beside a scene, where its studies are looked for


def after_run(document: Record) -> Iterator[str]:
    """What the measures of a run mean beside the measured values, and the studies of its scene."""
    compared = list(comparisons(document))
    yield from (sentence for _, sentence in compared)
    if any(is_off for is_off, _ in compared) or not compared:
        studies = studies_of(Path(str(document["scene"])))
        if "evidence" in studies:
            yield f"{shell_command('compare', studies['evidence'])} says where the model fails."
        if "calibration" in studies:
            yield f"{shell_command('doe', 'calibrate', studies['calibration'])} calibrates it."
    if recording := document.get("recording"):
        yield f"{shell_command('view', recording)} shows the run."
        yield f"{shell_command('report', recording)} makes a page of it."
    if not document["measured"] and document["measures"]:
        yield "The scene states no measured value: [measured] in the scene file prints one beside it."


def comparisons(document: Record) -> Iterator[tuple[bool, str]]:
    """One sentence for every measured value, and whether the two differ."""
    for name, wanted in document["measured"].items():
        found = document["measures"].get(name, {})
        value, lacking = found.get("value"), found.get("shortfalls", ())
        if any(each["blocks"] for each in lacking):
            yield False, f"`{name}` cannot be compared: {lacking[0]['sentence']}."
            continue
        if value is None or not isfinite(value):
            continue
        gap = value - wanted["value"]
        alone = (found.get("n") or 1) < LEAST_RUNS
        shared = known(found.get("details", {}).get("shared_sd"))  # of all replicas alike
        scatters = hypot(
            shared, *(known(side.get("sd")) for side in ((wanted,) if alone else (found, wanted)))
        )
        errors = hypot(
            shared, *(known(side.get("sd")) / sqrt(side.get("n") or 1) for side in (found, wanted))
        )
        unit = found.get("unit", "")
        size = f"{abs(gap):.2g} {unit if unit != '1' else ''}".rstrip()
        is_angle = name in ANGLES
        subject = "The heap" if is_angle else f"`{name}`"
        way = ("flatter", "steeper") if is_angle else ("lower", "higher")
        words = f"{subject} is {size} {way[gap > 0.0]} than measured"
        words += f" ({lacking[0]['sentence'].partition(':')[0]})" if lacking else ""
        if alone:
            yield bool(gap), f"{words}{beside_one_run(gap, scatters)}"
        elif scatters <= 0.0:
            yield bool(gap), f"{words}; no scatter is known."
        elif abs(gap) > FAR * scatters:
            yield True, f"{words}, far outside both scatters."
        elif abs(gap) > ERRORS * errors:
            yield True, f"{words}, {abs(gap) / errors:.1f} standard errors."
        else:
            yield False, f"{subject} agrees with the measured value within its scatter."


def beside_one_run(gap: float, measured_sd: float) -> str:
    """End of a sentence on the difference of one run."""
    share = f", {abs(gap) / measured_sd:.1f} times the measured scatter" if measured_sd > 0.0 else ""
    return f"{share}; one run shows no scatter between runs: `--set scene.replicas=3` does."


def known(sd: float | None) -> float:
    """A standard deviation, 0 where it is unknown."""
    return sd if sd is not None and isfinite(sd) else 0.0


def studies_of(scene: Path) -> dict[str, Path]:
    """A study of each kind that names a scene, looked for beside the scene: evidence, calibration."""
    found: dict[str, Path] = {}
    for folder in STUDY_FOLDERS:
        place = scene.parent / folder if folder != "." else scene.parent
        for path in sorted(place.glob("*.toml")) if place.is_dir() else ():
            kind = kind_of_study(path, scene)
            if kind is not None:
                found.setdefault(kind, Path(os.path.relpath(path)))
    return found


def kind_of_study(path: Path, scene: Path) -> str | None:
    """Kind of a study that names a scene; None for any other file."""
    try:
        table = tomllib.loads(read_text_file(path))
        named = {str(entry.get("scene")) for entry in table["observables"].values()}
        is_named = any((path.parent / name).resolve() == scene.resolve() for name in named)
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        return None
    if not is_named:
        return None
    return "calibration" if "targets" in table else "evidence" if "study" in table else None


def after_calibration(document: Record) -> Iterator[str]:
    """Where the calibrated scene and the page are."""
    for scene in document.get("calibrated_scenes", ()):
        yield f"{shell_command('run', scene)} runs the calibrated scene."
    yield f"{shell_command('report', document['study'])} makes one HTML page."
    yield f"{shell_command('view', document['study'])} shows tables, figures and heaps."


def after_report(page: str) -> str:
    """How to look at a page."""
    return f"Open {page} in a browser; it needs no server, prints, and can be mailed."
