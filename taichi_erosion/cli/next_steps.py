"""Last lines of a command: what the result means, and which command comes next.

`files` are the effect files of a command, which the next command needs too.
"""

import os
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from math import hypot, isfinite, sqrt
from pathlib import Path
from typing import Any

from taichi_erosion.core.files import read_text_file
from taichi_erosion.evidence.answers.agreement_words import by_observable, is_untested, unseen_words
from taichi_erosion.evidence.inference.verdict_levels import HELD_OUT_SHARE, fails

Record = Mapping[str, Any]

NAME_SWITCH = "TAICHI_EROSION_NAME"  # environment variable: set by the launcher
FAR = 3.0  # scatters of both sides together, from which a difference is far outside [1]
SETTLE = "Mend the set-up first, then give the same command again."
ERRORS = 2.0  # standard errors, from which a difference is more than chance [1]
ANGLES = {"repose_angle", "angle_of_repose", "cone_angle", "envelope_angle"}  # of a heap
LEAST_RUNS = 2  # that show a scatter
TIDY = "_tidy.csv"  # end of the name of a table that `study new` wrote
STUDY_FOLDERS = (".", "../doe", "../studies")  # beside a scene, where its studies are looked for


def command(*words: object, files: Sequence[Path] = ()) -> str:
    """A command in backquotes, as the user called the program and as a shell takes its words."""
    program = "./erosion" if NAME_SWITCH in os.environ else "taichi-erosion"
    options = [word for file in files for word in ("--effect", file)]
    return f"`{program} {shlex.join(map(str, (*words, *options)))}`"


def after_run(document: Record) -> Iterator[str]:
    """What the measures of a run mean beside the measured values, and the studies of its scene."""
    compared = list(comparisons(document))
    yield from (sentence for _, sentence in compared)
    if any(is_off for is_off, _ in compared) or not compared:
        studies = studies_of(Path(str(document["scene"])))
        if "evidence" in studies:
            yield f"{command('compare', studies['evidence'])} says where the model fails."
        if "calibration" in studies:
            yield f"{command('doe', 'calibrate', studies['calibration'])} calibrates it."
    if recording := document.get("recording"):
        yield f"{command('view', recording)} shows the run."
        yield f"{command('report', recording)} makes a page of it."
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


def waits(document: Record) -> bool:
    """Whether a fault of the set-up comes before any verdict on physics."""
    return any(fault["blocks"] for fault in document.get("faults", ()))


def while_it_waits(document: Record, files: Sequence[Path]) -> str:
    """What to do before a verdict on physics."""
    if {fault["kind"] for fault in document.get("faults", ()) if fault["blocks"]} != {"too_few_rows"}:
        return SETTLE
    return f"{command('next', document['study'], files=files)} proposes the measurements that tell most."


def after_comparison(document: Record, files: Sequence[Path] = ()) -> Iterator[str]:
    """Next steps after a comparison."""
    study = document["study"]
    if waits(document):
        yield while_it_waits(document, files)
        return
    if document["p"] is None:
        yield "With sd or repeats in the table the size of the misfit can be judged."
    elif fails(document["p"]) or any(fails(place["p"]) for place in document["where"]):
        yield f"{command('discover', study, files=files)} asks which effect is missing."
    elif is_untested(document):
        yield "Measurements at other conditions would test the model."
    else:
        yield "These measurements leave nothing to explain; other conditions test the model harder."
    yield f"{command('report', study)} draws model and measurements on one page."


def after_discovery(document: Record, files: Sequence[Path] = ()) -> Iterator[str]:
    """Next steps after a discovery, by its verdict."""
    study, verdict, named = document["study"], document["verdict"], document["named"]
    if waits(document):
        yield while_it_waits(document, files)
        return
    if document.get("row_off"):
        yield check_row(document["row_off"])
    if named:
        words = f"{command('adopt', study, *named, files=files)} adds {' and '.join(named)} and tests it"
        held = document["rows_hidden"]
        yield f"{words} on {held} held-out rows." if held else f"{words}; no row is held out."
    if verdict == "outside_library":
        has_law = any(clue["law"] is not None for clue in document["clues"])
        results = Path(study).with_name(f"{Path(study).stem}-results") / f"{Path(study).stem}.discover.json"
        new = command("effects", "new", "NAME", *(("--from-discovery", results) if has_law else ()))
        yield f"An effect of your own may explain it: {new}{', with the law above' if has_law else ''}."
    if verdict == "unstable":
        yield more_runs(study, files, document.get("fresh_runs"))
    yield f"{command('next', study, files=files)} proposes the measurements that would decide."
    yield f"{command('report', study)} makes the page."


def more_runs(study: str, files: Sequence[Path], fresh: Record | None) -> str:
    """How an answer that changes with the runs of the model is decided."""
    if not fresh:
        return f"More seeds decide: {command('discover', study, '--budget', 'full', files=files)}."
    if fresh["more_runs"]:
        words = f"makes {fresh['more_runs']} runs more about these explanations, and tests the answer anew"
        return f"{command('discover', study, files=files)} {words}."
    return f"The budget has no room for more runs: raise `runs` under [budget] of {study}."


def check_row(row: Record) -> str:
    """Where a row that no explanation comes near is to be checked."""
    side = "above" if row["residual_sd"] > 0.0 else "below"
    at, source = (
        f" {lead} {row[key]}" if row[key] else "" for lead, key in (("at", "setting"), ("of", "source"))
    )
    words = f"{row['observable']}{at}{source} lies {abs(row['residual_sd']):.2g} sd {side} the model"
    return f"Check one row first: {words} under every explanation."


def after_adoption(document: Record, files: Sequence[Path] = ()) -> Iterator[str]:
    """What the held-out rows said, and the study to go on with."""
    before, after = (document[key]["vault_chi2_per_row"] for key in ("base", "added"))
    rows = f"rows {unseen_words(document['vault']['opened'])}"
    if after is None or before is None:
        yield "No held-out row tests the effect: measure under further conditions before you trust it."
    elif after <= HELD_OUT_SHARE * before:
        errors = (document[key]["vault_rmse"] for key in ("base", "added"))
        yield f"The error {by_observable(*errors)} on {rows}."
    else:
        again = command("next", document["study"], files=files)
        yield f"The {rows} do not support it: go on with the old study."
        yield f"{again} proposes the measurements that would decide."
        return
    yield f"{command('compare', document['written'])} shows what is left."
    yield f"{command('report', document['study'])} makes the page."


def after_next(document: Record, files: Sequence[Path] = ()) -> Iterator[str]:
    """What to do with proposed experiments."""
    table, again = document["measurements"], command("discover", document["study"], files=files)
    if document["next_experiments"] and table.endswith(TIDY):
        yield f"Add the new rows to the table of which {table} was made, give {command('study', 'new')} on it"
        yield f"with the same options again, then {again}."
    elif document["next_experiments"]:
        yield f"Add the new rows to {table}, and give {again} again."


def after_calibration(document: Record) -> Iterator[str]:
    """Where the calibrated scene and the page are."""
    for scene in document.get("calibrated_scenes", ()):
        yield f"{command('run', scene)} runs the calibrated scene."
    yield f"{command('report', document['study'])} makes one HTML page."
    yield f"{command('view', document['study'])} shows tables, figures and heaps."


def after_report(page: str) -> str:
    """How to look at a page."""
    return f"Open {page} in a browser; it needs no server, prints, and can be mailed."
