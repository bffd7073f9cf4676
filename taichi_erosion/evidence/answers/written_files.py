"""Files of a new study: tidy table, scenes, study. They are written together, or not at all.

Where the study is there already, its tidy table is written anew; the study and its scenes stay as the user
has changed them. Rows keep what they became when rows were drawn for the vault (`held_out_rows.py`).
"""

import json
import shlex
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.campaign.study_file import with_entry
from taichi_erosion.core.effect_file import effect_in
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.check_study import check_study
from taichi_erosion.evidence.answers.scene_templates import CalibratedNumber
from taichi_erosion.evidence.answers.set_up import refuse_unknown_scatter
from taichi_erosion.evidence.data.held_out_rows import rows_in_named_ranges
from taichi_erosion.evidence.data.measured import AMOUNTS, read_measured_table
from taichi_erosion.evidence.data.problem import Drawn
from taichi_erosion.evidence.data.tables.rows import Table, tidy_table_cells
from taichi_erosion.evidence.emulator.design import why_effect_cannot_act
from taichi_erosion.evidence.emulator.training_runs import study_scenes
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.load_study import Study, load_study
from taichi_erosion.evidence.models.simulator import dotted_paths
from taichi_erosion.scene.load import read_text_of_file
from taichi_erosion.scene.physical_ranges import ANGLE, OBSERVED
from taichi_erosion.scene.schema.units import conversion_factor, parse_unit
from taichi_erosion.tables.number_words import toml_key

Document = dict[str, Any]
TIDY = "_tidy.csv"  # end of the name of a tidy table, which so is another one than that of the laboratory's
READ = "its cells when `study new` read it"
LINEAR = 0.1  # of the least amount, below which its scale is linear
FRACTION = 0.3  # of the groups in the vault
LEAST_SHIFT = 1e-3  # between the shifts of two rows, below which an effect is not seen [1] or [deg]
SHIFTED = {"threshold_u_star": {"threshold"}, "flux": {"threshold", "flux"}, "repose_angle": {"repose"}}
EXPECTED_AS = {  # observable -> the one of which the literature tells the effects: a steeper heap is higher
    **dict.fromkeys(("angle_of_repose", "cone_angle", "dynamic_angle", "runout_radius"), "repose_angle"),
    **dict.fromkeys(("pile_height", "centroid_height", "radius_90", "column_height"), "repose_angle"),
    **dict.fromkeys(("threshold_wind_speed", "rolling_onset"), "threshold_u_star"),
    **dict.fromkeys(("impact_threshold", "impact_threshold_linear"), "threshold_u_star"),
    "flux_height": "flux",
}


@dataclass(frozen=True)
class Content:
    """What a new study compares with its table."""

    observables: Mapping[str, str]  # name -> file of its scene; empty: the model answers
    conditions: Mapping[str, str]  # column -> places
    parameters: Sequence[CalibratedNumber]
    scenes: Mapping[str, str] = field(default_factory=dict)  # of its own: name -> text
    model: str = ""
    shared: Mapping[str, str] = field(default_factory=dict)  # observable -> entry of its error between codes


@dataclass(frozen=True)
class StudyFiles:
    folder: Path
    stem: str  # name of the laboratory's table, without its ending
    rows: Table
    content: Content
    made_from: str  # table of the laboratory, relative to the study
    digest: str  # of its cells
    assumptions: Sequence[str]
    effect_files: Sequence[str]  # with effects of the user's own, relative to the study

    @property
    def study_path(self) -> Path:
        return self.folder / f"{self.stem}.toml"

    @property
    def table(self) -> Path:
        return self.folder / f"{self.stem}{TIDY}"

    @property
    def scene_texts(self) -> dict[Path, str]:
        return {self.folder / f"{name}.toml": text for name, text in self.content.scenes.items()}


def write_study_files(files: StudyFiles, anew: bool) -> Document:
    """Write a study, or the table alone of one that is there, unless `anew`; the document says what it holds.

    Raises BadInput where a file of another origin would be replaced, or where the study does not fit its
    table; then nothing is written.
    """
    before, paths = None, [files.study_path, files.table, *files.scene_texts]
    if files.study_path.exists() and files.table.exists():
        before = load_study(files.study_path)
        if before.file.study.made_from != files.made_from:
            raise BadInput(f"{files.study_path}: is a study of another table; name another folder with --out")
    if before is None and (there := [path for path in paths if path.exists()]):
        raise BadInput(f"{there[0]}: exists; remove it, or name another folder with --out")
    rows, changes = list[Drawn](row.draw for row in files.rows.rows), {}
    if before is not None:
        table = read_measured_table(files.table, files.table.name)
        rows, changes = carry_over_vault(before, table, files.rows)
    with restore_files_on_refusal(paths):
        write_tidy_table(files, rows)
        if before is None or anew:
            write_study_and_scenes(files, "" if before is None else before.vault_digest)
        else:
            paths = paths[:2]
            text = read_text_of_file(files.study_path, str(files.study_path))
            text = with_entry(text, ("study", "made_from_digest"), files.digest, READ)
            write_atomic(files.study_path, text.encode())
            add_candidates_of_new_rows(files, before)
        study = load_study(files.study_path)
        refuse_unknown_scatter(study)
        write_tidy_table(files, vault_draw_of_rows(study, files.rows))
        document = check_study(files.study_path)
    return {"written": list(map(str, paths)), **document, **changes}


def add_candidates_of_new_rows(files: StudyFiles, before: Study) -> None:
    """Add effects of the closed form that new rows can show, where all that old rows show are candidates."""
    listed, study = before.problem.candidate_names, load_study(files.study_path)
    acting = varying_formula_effects(study) if files.content.model else []
    new = [name for name in acting if name not in listed]
    if new and {*listed} == {*varying_formula_effects(before)}:
        text = read_text_of_file(files.study_path, str(files.study_path))
        text = with_entry(text, ("candidates", "effects"), [*listed, *new])
        for name in reduced.LARGEST.keys() & {*new}:
            text = with_entry(text, ("candidates", name, "max"), reduced.LARGEST[name])
        write_atomic(files.study_path, text.encode())


def carry_over_vault(study: Study, before: Table, after: Table) -> tuple[list[Drawn], dict[str, Document]]:
    """What rows became when those of the earlier table of a study were drawn for the vault; what changed.

    A row is known by its set-up, else by its value, else by its place in a table of equal length.
    """
    places: list[int | None] = [None] * len(after.rows)
    unmatched = set(range(len(before.rows)))
    for name in ("group", "value"):
        free, keys = defaultdict[Any, list[int]](list), list[list[Any]]()
        for rows in (before.rows, after.rows):  # equal also where a condition is not known
            keys.append([(row.observable, getattr(row, name), *map(str, row.conditions)) for row in rows])
        for place in sorted(unmatched):
            free[keys[0][place]].append(place)
        for k, key in enumerate(keys[1]):
            if places[k] is None and free[key]:
                places[k] = free[key].pop(0)
        unmatched -= {*places}
    if len(before.rows) == len(after.rows):
        places = [k if place is None and k in unmatched else place for k, place in enumerate(places)]
    extras = ("vault", "source")  # what the vault makes of a row, and its place in the file
    tables = map(tidy_table_cells, (before, after))
    was, now = ([{n: x for n, x in row.items() if x and n not in extras} for row in rows] for rows in tables)
    trios = zip(after.rows, now, places, strict=True)
    lines = [row.line for row, cells, place in trios if place is None or was[place] != cells]
    removed = len(before.rows) - sum(place is not None for place in places)
    changes = {"lines": list(dict.fromkeys(lines)), "removed": removed}
    draw = vault_draw_of_rows(study, before)
    return ["" if place is None else draw[place] for place in places], {"changes": changes}


def write_tidy_table(files: StudyFiles, drawn: Sequence[Drawn]) -> None:
    """Write the tidy table, with what became of every row when rows were drawn for the vault."""
    import pandas as pd

    rows = tuple(replace(row, draw=was) for row, was in zip(files.rows.rows, drawn, strict=True))
    cells = pd.DataFrame(tidy_table_cells(replace(files.rows, rows=rows)))
    write_atomic(files.table, cells.to_csv(index=False, lineterminator="\n").encode())


def vault_draw_of_rows(study: Study, table: Table) -> list[Drawn]:
    """What became of every row of a study's tidy table when rows were drawn for the vault.

    Nothing is told of rows that the study does not use, and of those that a stated range or source holds out.
    """
    used = [k for k, row in enumerate(table.rows) if row.observable in study.file.observables]
    hidden = set(study.problem.vault.rows.tolist())
    vault = study.file.vault
    inside = rows_in_named_ranges(study.problem.measurements, vault.ranges, vault.sources)
    rows: list[Drawn] = [""] * len(table.rows)
    for k, row in enumerate(used):
        rows[row] = "" if inside[k] else "held out" if k in hidden else "fitted"
    return rows


@contextmanager
def restore_files_on_refusal(paths: Sequence[Path]) -> Iterator[None]:
    """Files that are as before where the block refuses what it is given (BadInput)."""
    before = {path: path.read_bytes() if path.is_file() else None for path in paths}
    folder = next((path.parent for path in paths if not path.parent.exists()), None)
    try:
        yield
    except BadInput:
        for path, content in before.items():
            if content is not None:
                write_atomic(path, content)
            elif path.is_file():
                path.unlink()
        if folder is not None and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        raise


def write_study_and_scenes(files: StudyFiles, drawn_from: str) -> None:
    """Write the scenes and a study whose candidates can act."""
    for path, text in files.scene_texts.items():
        write_atomic(path, text.encode())
    write_atomic(files.study_path, study_text(files, (), drawn_from).encode())
    study = load_study(files.study_path)
    acting = varying_formula_effects(study) if files.content.model else plausible_candidates(study)
    write_atomic(files.study_path, study_text(files, acting, drawn_from or study.digest).encode())


def study_text(files: StudyFiles, candidates: Sequence[str], drawn_from: str) -> str:
    """A study file; all candidates of the library where none are given."""
    content = files.content
    lines = [f"# {shlex.join(['./erosion', 'compare', files.study_path.name])}", "", "[study]"]
    lines += [f"title = {toml_string(files.stem)}", f"measurements = {toml_string(files.table.name)}"]
    lines += [f"made_from = {toml_string(files.made_from)}"]
    lines += [f"made_from_digest = {toml_string(files.digest)}  # {READ}"]
    lines += [f"model = {toml_string(content.model)}"] if content.model else []
    lines += [f"effect_files = {json.dumps(list(files.effect_files))}"] if files.effect_files else []
    if files.assumptions:
        lines += ['notes = """', "Assumed, because the table does not say it:"]
        lines += [f"- {words.replace(chr(34), chr(39))}" for words in files.assumptions] + ['"""']
    for name, scene in content.observables.items():
        limits = OBSERVED.get(name)
        lines += ["", f"[observables.{name}]"]
        lines += [f"scene = {toml_string(scene)}"] if scene else []
        lines += [f"unit = {toml_string(limits.unit)}"] if content.model and limits else []
        lines += scale_lines(files.rows, name, limits.unit if content.model and limits else "")
        lines += [content.shared[name]] if name in content.shared else []
    lines += ["", "[conditions]"]
    lines += [f"{toml_key(name)} = {toml_string(paths)}" for name, paths in content.conditions.items()]
    for number in content.parameters:
        lines += ["", f"[parameters.{toml_string(number.path)}]    # {number.why}"]
        lines += [f"start = {number.start:g}", f"low = {number.low:g}", f"high = {number.high:g}"]
        lines += [f"prior_sd_log = {number.sd_log:g}"]
    lines += ["", "[candidates]", f"effects = {json.dumps(list(candidates) or 'all')}"]
    for name in sorted(reduced.LARGEST.keys() & {*candidates}) if content.model else ():
        lines += ["", f"[candidates.{name}]", f"max = {reduced.LARGEST[name]:g}"]
    lines += ["", "[vault]"]
    lines += [f"fraction = {FRACTION:g}    # of the set-ups, held out until an effect is adopted"]
    if drawn_from:
        lines += [f"drawn_from = {toml_string(drawn_from)}    # the table when its rows were drawn"]
    return "\n".join(lines) + "\n"


def scale_lines(table: Table, name: str, unit: str) -> list[str]:
    """Entries of the comparison scale of an observable: logarithmic where it is positive, but for angles.

    An amount that a model may say is none is compared by ln(y + floor), linear below the floor: that is the
    least limit that is stated, or LINEAR of the least positive value, in `unit`; empty: in that of the table.
    """
    rows = [row for row in table.rows if row.observable == name]
    if OBSERVED.get(name) is ANGLE or any(row.value <= 0.0 for row in rows):
        return []
    if name not in AMOUNTS:
        return ['transform = "log"']
    first_unit = parse_unit(unit or rows[0].unit)
    size = [(row, (conversion_factor(parse_unit(row.unit), first_unit) or 1.0) * row.value) for row in rows]
    limit = min((value for row, value in size if row.reach == -inf), default=0.0)
    least = LINEAR * min((value for row, value in size if row.reach != -inf), default=0.0)
    return ['transform = "log_floor"', f"floor = {max(limit, least):.6g}    # below it the scale is linear"]


def toml_string(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def varying_formula_effects(study: Study) -> list[str]:
    """Effects of the closed form that are not alike in all rows of the table, as coefficients are."""
    measured = study.problem.measurements.conditions
    at = reduced.DEFAULT_COLUMNS | {model: measured[name] for name, model in study.file.conditions.items()}
    parts = set[str]().union(*(SHIFTED[name] for name in study.file.observables))
    acts = {name: vars(law(1.0, at)) for name, law in reduced.EFFECTS.items()}
    return [
        n for n, of in acts.items() if any(np.nanmax(of[p]) - np.nanmin(of[p]) > LEAST_SHIFT for p in parts)
    ]


def plausible_candidates(study: Study) -> list[str]:
    """Effects of the library that can change what is measured here.

    Where the literature does not say which observables an effect changes, it is a candidate if the table
    holds a condition that it reads; always where one is called like its number, `spread`. Where that leaves
    none, all that can act are candidates.
    """
    simulator = study.simulator
    assert simulator is not None
    scenes, measured = study_scenes(study, simulator), study.file.observables
    measured_names = {*measured, *(EXPECTED_AS[name] for name in measured if name in EXPECTED_AS)}
    for path in (path for paths in study.file.conditions.values() for path in dotted_paths(paths)):
        measured_names |= {path.removeprefix("conditions."), *path.rpartition(".")[2].split("_")}
    own_effects = {effect_in(file).name for file in study.effect_files}
    acting = (c for c in study.problem.candidates if any(why_effect_cannot_act(s, c) is None for s in scenes))
    able = [each.name for each in acting]
    effects = {name: simulator.library[name] for name in able}
    tells = {n: {*(e.expected or e.reads), *(f.name for f in fields(e.params))} for n, e in effects.items()}
    return [n for n in effects if n in own_effects or tells[n] & measured_names] or able
