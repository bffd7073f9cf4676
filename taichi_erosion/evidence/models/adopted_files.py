"""Files that an adoption writes: the study in which the effects belong to the model, and its scenes.

They are named by the study and by all effects, and carry the mark of the study (`core/files.py`):

    STUDY_with_EFFECT[_and_EFFECT].toml              beside the study
    SCENE_STUDY_with_EFFECT[_and_EFFECT].toml        beside each scene
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os.path import relpath
from pathlib import Path

from taichi_erosion.campaign.study_file import value_at_keys, with_entry
from taichi_erosion.core.effect_file import EffectFile, effect_in
from taichi_erosion.core.files import mark_toml, refuse_foreign_file, remove_mark, write_atomic
from taichi_erosion.evidence.data.problem import REACH
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.models.simulator import refusal_of_number
from taichi_erosion.evidence.record import Interval
from taichi_erosion.execution.checks import read_scene, scene_effect_files
from taichi_erosion.scene.load import read_text_of_file
from taichi_erosion.tables.number_words import round_number


@dataclass(frozen=True)
class Adoption:
    """What an adoption states: new effects, strengths of all that act, calibrated numbers by path."""

    effects: Sequence[str]
    strengths: Mapping[str, Interval]
    numbers: Mapping[str, Interval]


def adopted_study_path(study: Path, effects: Sequence[str]) -> Path:
    return study.with_name(f"{study.stem}_with_{'_and_'.join(effects)}.toml")


def paths_before_and_after(study: Study, effects: Sequence[str]) -> list[tuple[Path, Path]]:
    """The study and its scenes, each with the file that an adoption makes of it."""
    adopted = adopted_study_path(study.path, effects)
    names = sorted({each.scene for each in study.file.observables.values() if each.scene})
    scenes = [study.path.parent / name for name in names]
    after = [scene.with_name(f"{scene.stem}_{adopted.stem}.toml") for scene in scenes]
    return [(study.path, adopted), *zip(scenes, after, strict=True)]


def refuse_foreign_files(study: Study, effects: Sequence[str], force: bool = False) -> None:
    """Raise BadInput where an adoption would replace a file that is not its own."""
    for _, path in paths_before_and_after(study, effects):
        refuse_foreign_file(path, study.path, force)


def write_adopted_files(study: Study, adoption: Adoption, force: bool = False) -> list[Path]:
    """Write the study in which the effects are adopted, then its scenes; returns these files."""
    refuse_foreign_files(study, adoption.effects, force)
    (_, adopted), *scenes = paths_before_and_after(study, adoption.effects)
    write_atomic(adopted, mark_toml(adopted, study.path, adopted_study_text(study, adoption)))
    tables = [read_scene(scene, (), study.effect_files) for scene, _ in scenes]
    of_scenes = (file for one in tables for file in scene_effect_files(one))
    files = dict.fromkeys((*study.effect_files, *of_scenes))
    acting = [file for file in files if effect_in(file).name in adoption.strengths]
    return [adopted, *(write_adopted_scene(scene, path, study, adoption, acting) for scene, path in scenes)]


def add_effect_files_to_text(text: str, section: str, folder: Path, files: Sequence[EffectFile]) -> str:
    """A TOML text of a folder that names effect files too, by paths relative to the folder."""
    entries = list(value_at_keys(tomllib.loads(text), (section, "effect_files")) or ())
    there = {(folder / name).resolve() for name in entries}
    missing = [relpath(file.path, folder.resolve()) for file in files if file.path not in there]
    return with_entry(text, (section, "effect_files"), [*entries, *missing]) if missing else text


def adopted_study_text(study: Study, adoption: Adoption) -> str:
    text = remove_mark(read_text_of_file(study.path, str(study.path)))
    text = with_entry(text, ("study", "follows"), study.path.name)
    text = add_effect_files_to_text(text, "study", study.path.parent, study.effect_files)
    listed = {candidate.name: candidate for candidate in study.problem.candidates}
    for effect in adoption.effects:
        strength = adoption.strengths[effect]
        text = with_estimate(text, ("adopted", effect, "strength"), strength)
        if effect in listed:
            scale, most = listed[effect].prior_scale, listed[effect].maximum
            if round_number(strength.value) > most:
                scale, most = most, REACH * most
            text = with_entry(text, ("adopted", effect, "prior_scale"), scale)
            text = with_entry(text, ("adopted", effect, "max"), most)
    return text


def write_adopted_scene(
    scene: Path, path: Path, study: Study, adoption: Adoption, more: Sequence[EffectFile]
) -> Path:
    """Write a scene with the effects, their more, and those calibrated numbers that it has."""
    text = remove_mark(read_text_of_file(scene, str(scene)))
    text = add_effect_files_to_text(text, "scene", scene.parent, more)
    for name, strength in adoption.strengths.items():
        text = with_estimate(text, ("effects", name, "strength"), strength)
    for name, number in adoption.numbers.items():
        if refusal_of_number(scene, name, round_number(number.value), study.effect_files) is None:
            text = with_estimate(text, tuple(name.split(".")), number)
    return write_atomic(path, mark_toml(path, study.path, text))


def with_estimate(text: str, keys: tuple[str, ...], number: Interval) -> str:
    """A TOML text with a calibrated number, and its 90 % interval in a comment beside it."""
    comment = f"calibrated: {number.low:.4g} to {number.high:.4g}, 90 %"
    return with_entry(text, keys, round_number(number.value), comment)
