"""What was found about a study, kept in its results folder: one JSON document for every question asked.

What was found, as plain tables that JSON can hold: the documents of the command line.
"""

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from math import nan
from pathlib import Path
from typing import Any, Literal

import numpy as np

from taichi_erosion import __version__
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file, write_atomic
from taichi_erosion.evidence.data.findings import Adoption, Comparison, Discovery, Experiment, VaultErrors
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.measures.result import without_nan

Question = Literal["compare", "discover", "adopt", "next", "rounds"]
LADDER = "ladder.json"  # errors after each adoption, shared by the studies that follow one another
ROUNDS: Question = "rounds"  # no question: what the rounds of simulations were about


def result_file(folder: Path, stem: str, question: str) -> Path:
    """Where the answer to a question lies; studies that follow one another share a folder."""
    return folder / f"{stem}.{question}.json"


def keep(folder: Path, stem: str, question: Question, document: dict[str, Any]) -> Path:
    """Keep an answer in place of an earlier one."""
    text = json.dumps(document, indent=1, allow_nan=False)
    return write_atomic(result_file(folder, stem, question), (text + "\n").encode())


def recall(folder: Path, stem: str, question: Question) -> dict[str, Any] | None:
    """The last answer to a question, None if it has not been asked."""
    return read_document(result_file(folder, stem, question))


def read_document(file: Path) -> dict[str, Any] | None:
    """A document that was kept, None if there is none; raises BadInput for a damaged one."""
    if not file.exists():
        return None
    try:
        document = json.loads(read_text_file(file))
    except (ValueError, OSError) as error:
        raise BadInput(f"{file}: cannot be read ({error}); remove it and ask again") from None
    if not isinstance(document, dict):
        raise BadInput(f"{file}: holds no result; remove it and ask again")
    return document


def extend_ladder(folder: Path, rung: dict[str, Any]) -> None:
    """Add a rung to the error ladder; adopting the same effects again replaces it and all above it."""
    kept = [r for r in ladder(folder) if len(r["effects"]) < len(rung["effects"])]
    text = json.dumps({"rungs": [*kept, rung]}, indent=1, allow_nan=False)
    write_atomic(folder / LADDER, (text + "\n").encode())


def ladder(folder: Path) -> list[dict[str, Any]]:
    """Rungs of the error ladder, from the model as it came to the last adoption."""
    document = read_document(folder / LADDER)
    return [] if document is None else list(document.get("rungs", []))


LIBRARIES = ("numpy", "scipy")
Document = dict[str, Any]


def plain(value: Any) -> Any:
    """A nested value with lists for arrays and tuples, plain numbers for NumPy's, None for NaN."""
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(entry) for entry in value]
    return without_nan(value)


def record(found: Any) -> Any:
    """A dataclass of findings as plain tables."""
    return plain(asdict(found))


def study_document(study: Study) -> Document:
    """What every document says about its study."""
    return {
        "study": str(study.path),
        "title": study.file.study.title,
        "model": study.model,
        "measurements": study.file.study.measurements,
        "digest": study.digest[:12],
        "seed": study.file.study.seed,
        "adopted": list(study.file.adopted),
        "candidates": [candidate.name for candidate in study.problem.candidates],
        "units": dict(
            zip(study.problem.measurements.observable, study.problem.measurements.unit, strict=True)
        ),
        "notes": list(study.notes),
        "rows_visible": study.problem.measurements.size - len(study.problem.vault.rows),
        "rows_hidden": len(study.problem.vault.rows),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Versions that a finding depends on."""
    own = {"taichi_erosion": __version__, "python": platform.python_version()}
    return own | {name: version(name) for name in LIBRARIES}


def compare_document(study: Study, found: Comparison) -> Document:
    """The document of `compare --json`, and the rows that figures are drawn from."""
    return study_document(study) | record(found)


def discover_document(study: Study, found: Discovery, vault: Document | None = None) -> Document:
    """The document of `discover --json`; `vault` are the errors that an earlier `adopt` showed."""
    document = study_document(study) | record(found)
    document["vault"] = vault or document["vault"]
    return document


def adopt_document(study: Study, found: Adoption, opened: int, successor: str) -> Document:
    """The document of `adopt --json`: errors on fitted and held-out rows, and the study written."""
    control = found.random_wrong or found.best_wrong
    wrong = control.vault_chi2 if control else nan
    vault = VaultErrors(opened, found.base.vault_chi2, found.added.vault_chi2, wrong)
    document = study_document(study) | record(found)
    document |= {"vault": record(vault), "written": successor}
    return document | plain({"chi2_before": found.base.chi2, "chi2_after": found.added.chi2})


def next_document(study: Study, found: Sequence[Experiment]) -> Document:
    """The document of `next --json`."""
    return study_document(study) | {"next_experiments": [record(experiment) for experiment in found]}


def without_rows(document: Document) -> Document:
    """A document as printed: what figures are drawn from stays in the results folder."""
    hidden = ("rows", "rows_before", "rows_after", "vault_rows")
    return {
        key: without_rows(entry) if isinstance(entry, dict) else entry
        for key, entry in document.items()
        if key not in hidden
    }
