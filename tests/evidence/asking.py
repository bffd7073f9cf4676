"""Commands of the evidence loop, asked without a shell."""

from pathlib import Path

from taichi_erosion.evidence.answers import commands
from taichi_erosion.evidence.answers.files import Command, Reply
from taichi_erosion.evidence.models.load_study import NO_OPTIONS, StudyOptions

SILENT = ("none_detected", "not_testable")  # verdicts that name nothing


def no_progress(_: str, __: float) -> None:
    """Progress that nobody wants to see."""


def ask(command: Command, path: Path, *effects: str, options: StudyOptions = NO_OPTIONS) -> Reply:
    """The reply of a command."""
    if command == "adopt":
        return commands.adopt_study(path, effects, no_progress, options)
    asked = {"compare": commands.compare_study, "discover": commands.discover_study}
    return (asked | {"next": commands.next_study})[command](path, no_progress, options)
