"""The study after an adoption: a file beside the old one, in which the effect belongs to the model."""

from pathlib import Path

from taichi_erosion.campaign.study_file import with_entry
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.findings import Adoption
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.scene.load import file_text

MARK = "# Written by `adopt`"  # first words of a file that may be written again
DIGITS = 6  # of a calibrated number


def write_adopted_study(study: Study, found: Adoption) -> Path:
    """Write the study in which an effect is adopted; raises BadInput rather than overwrite a user's file."""
    strength = found.added.strengths[found.effect].value
    path = study.path.with_name(f"{study.path.stem}_with_{found.effect}.toml")
    refuse_foreign(path)
    text = file_text(study.path, str(study.path))
    text = with_entry(text, ("study", "follows"), study.path.name)
    text = with_entry(text, ("adopted", found.effect, "strength"), rounded(strength))
    candidate = next((c for c in study.problem.candidates if c.name == found.effect), None)
    if candidate is not None:
        text = with_entry(text, ("adopted", found.effect, "prior_scale"), candidate.prior_scale)
        text = with_entry(text, ("adopted", found.effect, "max"), candidate.maximum)
    write_atomic(path, (head(study, found) + without_mark(text)).encode())
    for scene in sorted({entry.scene for entry in study.file.observables.values() if entry.scene}):
        write_scene(study.path.parent / scene, found)
    return path


def write_scene(scene: Path, found: Adoption) -> Path:
    """Write a scene with the effect and the calibrated numbers, beside the old one."""
    path = scene.with_name(f"{scene.stem}_with_{found.effect}.toml")
    refuse_foreign(path)
    text = file_text(scene, str(scene))
    for name, strength in found.added.strengths.items():
        text = with_entry(text, ("effects", name, "strength"), rounded(strength.value))
    for name, fitted in found.added.parameters.items():
        text = with_entry(text, tuple(name.split(".")), rounded(fitted.value))
    lead = f"{MARK} from {scene.name}: {found.effect} acts, and the calibrated numbers are set.\n"
    return write_atomic(path, (lead + without_mark(text)).encode())


def head(study: Study, found: Adoption) -> str:
    """What stands at the head of the new study."""
    numbers = {**found.added.parameters, **found.added.strengths}
    lines = [
        f"{MARK} from {study.path.name}: {found.effect} belongs to the model now. Calibrated there:",
        *(
            f"#   {name} = {fitted.value:.4g} ({fitted.low:.4g} to {fitted.high:.4g}, 90 %)"
            for name, fitted in numbers.items()
        ),
    ]
    return "\n".join(lines) + "\n"


def without_mark(text: str) -> str:
    """The text without what an earlier adoption wrote at its head."""
    lines = text.splitlines(keepends=True)
    if not (lines and lines[0].startswith(MARK)):
        return text
    rest = 1
    while rest < len(lines) and lines[rest].startswith("#   "):
        rest += 1
    return "".join(lines[rest:])


def refuse_foreign(path: Path) -> None:
    """Refuse to write over a file that this program did not make."""
    if path.exists() and not path.read_text(encoding="utf-8", errors="replace").startswith(MARK):
        raise BadInput(f"{path}: exists and was not written by `adopt`; move it away first")


def rounded(value: float) -> float:
    """A calibrated number without meaningless digits."""
    return float(f"{value:.{DIGITS}g}")
