"""What was found about a study, kept in its results folder: one JSON document for every question asked."""

import json
from pathlib import Path
from typing import Any, Literal

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.plain_file import plain_text
from taichi_erosion.recording.whole_file import write_whole

Question = Literal["compare", "discover", "adopt", "next", "rounds"]
LADDER = "ladder.json"  # errors after each adoption, shared by the studies that follow one another
ROUNDS: Question = "rounds"  # no question: what the rounds of simulations were about


def result_file(folder: Path, stem: str, question: str) -> Path:
    """Where the answer to a question lies; studies that follow one another share a folder."""
    return folder / f"{stem}.{question}.json"


def keep(folder: Path, stem: str, question: Question, document: dict[str, Any]) -> Path:
    """Keep an answer in place of an earlier one."""
    text = json.dumps(document, indent=1, allow_nan=False)
    return write_whole(result_file(folder, stem, question), (text + "\n").encode())


def recall(folder: Path, stem: str, question: Question) -> dict[str, Any] | None:
    """The last answer to a question, None if it has not been asked."""
    return read_document(result_file(folder, stem, question))


def read_document(file: Path) -> dict[str, Any] | None:
    """A document that was kept, None if there is none; raises BadInput for a damaged one."""
    if not file.exists():
        return None
    try:
        document = json.loads(plain_text(file))
    except (ValueError, OSError) as error:
        raise BadInput(f"{file}: cannot be read ({error}); remove it and ask again") from None
    if not isinstance(document, dict):
        raise BadInput(f"{file}: holds no result; remove it and ask again")
    return document


def climb(folder: Path, rung: dict[str, Any]) -> None:
    """Add a rung to the error ladder; adopting the same effects again replaces it and all above it."""
    kept = [r for r in ladder(folder) if len(r["effects"]) < len(rung["effects"])]
    text = json.dumps({"rungs": [*kept, rung]}, indent=1, allow_nan=False)
    write_whole(folder / LADDER, (text + "\n").encode())


def ladder(folder: Path) -> list[dict[str, Any]]:
    """Rungs of the error ladder, from the model as it came to the last adoption."""
    document = read_document(folder / LADDER)
    return [] if document is None else list(document.get("rungs", []))
