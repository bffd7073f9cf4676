"""Files that an adoption writes: the study in which the effects belong to the model, and its scenes.

They are named by the study and by all effects, and carry the mark of the study (`core/files.py`):

    STUDY_with_EFFECT[_and_EFFECT].toml              beside the study
    SCENE_STUDY_with_EFFECT[_and_EFFECT].toml        beside each scene
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os.path import relpath
from pathlib import Path
from typing import Protocol

from taichi_erosion.campaign.study_file import entry, with_entry
from taichi_erosion.core.effect_loading import effect_in
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import marked_toml, refuse_foreign, without_mark, write_atomic
from taichi_erosion.core.foreign_code import EffectFile, read_effect_files
from taichi_erosion.evidence.data.problem import stronger_candidate
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.run.checks import read_scene
from taichi_erosion.scene.load import file_text

DIGITS = 6  # of a calibrated number


class Estimate(Protocol):
    """A number with its 90 % interval."""

    @property
    def value(self) -> float: ...
    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...


@dataclass(frozen=True)
class Adopted:
    """What an adoption states: new effects, strengths of all that act, calibrated numbers by path."""

    effects: Sequence[str]
    strengths: Mapping[str, Estimate]
    numbers: Mapping[str, Estimate]


def adopted_path(study: Path, effects: Sequence[str]) -> Path:
    """Study in which the effects are adopted; the name of the old study holds those of earlier ones."""
    return study.with_name(f"{study.stem}_with_{'_and_'.join(effects)}.toml")


def scene_path(scene: Path, adopted: Path) -> Path:
    """Scene of an adopted study, beside the old scene."""
    return scene.with_name(f"{scene.stem}_{adopted.stem}.toml")


def scenes_of(study: Study) -> list[Path]:
    """Scenes that answer a study."""
    folder = study.path.parent
    return [folder / name for name in sorted({e.scene for e in study.file.observables.values() if e.scene})]


def refuse_foreign_files(study: Study, effects: Sequence[str], force: bool = False) -> None:
    """Raise BadInput where an adoption would replace a file that is not its own."""
    adopted = adopted_path(study.path, effects)
    for path in (adopted, *(scene_path(scene, adopted) for scene in scenes_of(study))):
        refuse_foreign(path, study.path, force)


def write_adopted_files(study: Study, found: Adopted, force: bool = False) -> list[Path]:
    """Write the study in which the effects are adopted, then its scenes; returns these files."""
    effects = found.effects
    refuse_foreign_files(study, effects, force)
    adopted = adopted_path(study.path, effects)
    write_atomic(adopted, marked_toml(adopted, study.path, study_text(study, found)))
    scenes, own = scenes_of(study), files_of(study, found)
    return [adopted, *(write_scene(scene, scene_path(scene, adopted), study, found, own) for scene in scenes)]


def files_of(study: Study, found: Adopted) -> list[EffectFile]:
    """Files of acting effects, which the study or one of its scenes names."""
    named = [file for scene in scenes_of(study) for file in named_in(scene)]
    files = dict.fromkeys((*study.effect_files, *named))
    return [file for file in files if effect_in(file).name in found.strengths]


def named_in(scene: Path) -> Sequence[EffectFile]:
    """Effect files that a scene names."""
    names = entry(file_text(scene, str(scene)), ("scene", "effect_files")) or ()
    return read_effect_files(names, scene.parent, str(scene))


def with_effect_files(text: str, section: str, folder: Path, files: Sequence[EffectFile]) -> str:
    """A TOML text of a folder that names effect files too, by paths relative to the folder."""
    stated = list(entry(text, (section, "effect_files")) or ())
    there = {(folder / name).resolve() for name in stated}
    missing = [relpath(file.path, folder.resolve()) for file in files if file.path not in there]
    return with_entry(text, (section, "effect_files"), [*stated, *missing]) if missing else text


def study_text(study: Study, found: Adopted) -> str:
    """Text of the study with the effects under [adopted], below the calibrated numbers as comments."""
    text = without_mark(file_text(study.path, str(study.path)))
    text = with_entry(text, ("study", "follows"), study.path.name)
    text = with_effect_files(text, "study", study.path.parent, study.effect_files)
    candidates = {candidate.name: candidate for candidate in study.problem.candidates}
    for effect in found.effects:
        strength = rounded(found.strengths[effect].value)
        text = with_entry(text, ("adopted", effect, "strength"), strength)
        if effect in candidates:
            listed = candidates[effect]
            allowed = stronger_candidate(listed) if strength > listed.maximum else listed
            text = with_entry(text, ("adopted", effect, "prior_scale"), allowed.prior_scale)
            text = with_entry(text, ("adopted", effect, "max"), allowed.maximum)
    names = " and ".join(found.effects)
    head = f"{HEAD} from {study.path.name}: the model has {names} now. Calibrated with it:\n"
    numbers = {**found.numbers, **found.strengths}
    lines = "".join(
        f"#   {name} = {number.value:.4g} ({interval(number)})\n" for name, number in numbers.items()
    )
    return head + lines + without_head(text)


HEAD = "# Written by `adopt`"  # first words of the comment that lists the calibrated numbers


def without_head(text: str) -> str:
    """The text without the calibrated numbers of an earlier adoption."""
    lines = text.splitlines(keepends=True)
    if not (lines and lines[0].startswith(HEAD)):
        return text
    rest = 1
    while rest < len(lines) and lines[rest].startswith("#   "):
        rest += 1
    return "".join(lines[rest:])


def write_scene(scene: Path, path: Path, study: Study, found: Adopted, own: Sequence[EffectFile]) -> Path:
    """Write a scene with the effects, their files, and those calibrated numbers that it has."""
    text = without_head(without_mark(file_text(scene, str(scene))))
    text = with_effect_files(text, "scene", scene.parent, own)
    for name, strength in found.strengths.items():
        text = with_entry(text, ("effects", name, "strength"), rounded(strength.value), calibrated(strength))
    for name, number in found.numbers.items():
        value = rounded(number.value)
        if takes(scene, name, value, study.effect_files):
            text = with_entry(text, tuple(name.split(".")), value, calibrated(number))
    names = " and ".join(found.effects)
    head = f"{HEAD} from {scene.name} and {study.path.name}: {names} acts; the calibrated numbers are set.\n"
    return write_atomic(path, marked_toml(path, study.path, head + text))


def takes(scene: Path, number: str, value: float, files: Sequence[EffectFile]) -> bool:
    """Whether a scene has a number; the scenes of a study need not have all of them."""
    try:
        read_scene(scene, (f"{number}={value!r}",), tuple(files))
    except BadInput:
        return False
    return True


def calibrated(number: Estimate) -> str:
    """Comment beside a calibrated number."""
    return f"calibrated: {interval(number)}"


def interval(number: Estimate) -> str:
    """90 % interval of a calibrated number."""
    return f"{number.low:.4g} to {number.high:.4g}, 90 %"


def rounded(value: float) -> float:
    """A calibrated number without meaningless digits."""
    return float(f"{value:.{DIGITS}g}")
