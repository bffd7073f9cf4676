"""Text of a study and of a tidy table that `study new` writes."""

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass, field

from taichi_erosion.evidence.answers.study_files.scene_templates import Calibrated
from taichi_erosion.evidence.data.tables.spreadsheet import Cells

READ = "its cells when `study new` read it"
FRACTION = 0.3  # of the groups in the vault


@dataclass(frozen=True)
class StudyText:
    """Entries of a study."""

    observables: Mapping[str, str]  # name -> scene, without its ending; empty: the model answers
    conditions: Mapping[str, str]  # column -> places
    parameters: tuple[Calibrated, ...]
    logarithmic: frozenset[str] = frozenset()  # observables above zero everywhere
    candidates: tuple[str, ...] = ()  # empty: all of the library
    model: str = ""
    units: Mapping[str, str] = field(default_factory=dict)  # of the model's values, by observable
    title: str = ""
    measurements: str = ""
    made_from: str = ""  # table of the laboratory, relative to the study
    made_from_digest: str = ""  # of its cells
    assumed: tuple[str, ...] = ()
    drawn_from: str = ""  # digest of the table from which the rows of the vault are drawn


ANGLES = ("repose_angle", "cone_angle", "angle_of_repose", "dynamic_angle", "sliding_angle")


def study_text(study: StudyText) -> str:
    """A study file."""
    lines = [f"# ./erosion compare {study.title}.toml", "", "[study]", f"title = {quoted(study.title)}"]
    lines += [f"measurements = {quoted(study.measurements)}"]
    if study.made_from:
        lines += [f"made_from = {quoted(study.made_from)}"]
        lines += [f"made_from_digest = {quoted(study.made_from_digest)}  # {READ}"]
    lines += [f"model = {quoted(study.model)}"] if study.model else []
    if study.assumed:
        lines += ['notes = """', "Assumed, because the table does not say it:"]
        lines += [f"- {words.replace(chr(34), chr(39))}" for words in study.assumed] + ['"""']
    for name, scene in study.observables.items():
        lines += ["", f"[observables.{name}]"]
        lines += [f'scene = "{scene}.toml"'] if scene else []
        lines += [f"unit = {quoted(study.units[name])}"] if name in study.units else []
        lines += ['transform = "log"'] if name in study.logarithmic and name not in ANGLES else []
    lines += ["", "[conditions]", *(f"{name} = {quoted(paths)}" for name, paths in study.conditions.items())]
    for number in study.parameters:
        lines += ["", f"[parameters.{quoted(number.path)}]    # {number.why}"]
        lines += [f"start = {number.start:g}", f"low = {number.low:g}", f"high = {number.high:g}"]
        lines += [f"prior_sd_log = {number.sd_log:g}"]
    if study.model:
        lines += [line for name in study.candidates for line in ("", f"[candidates.{name}]")]
    else:
        named = json.dumps(list(study.candidates)) if study.candidates else '"all"'
        lines += ["", "[candidates]", f"effects = {named}"]
    lines += [
        "",
        "[vault]",
        f"fraction = {FRACTION:g}    # of the set-ups, held out until an effect is adopted",
    ]
    if study.drawn_from:
        lines += [f"drawn_from = {quoted(study.drawn_from)}    # the table when its rows were drawn"]
    return "\n".join(lines) + "\n"


def quoted(text: str) -> str:
    """A TOML string."""
    return json.dumps(text, ensure_ascii=False)


def table_text(cells: Cells) -> str:
    """A tidy table as a CSV file."""
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(row for _, row in cells.rows)
    return text.getvalue()
