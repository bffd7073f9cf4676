"""What was found, as plain tables that JSON can hold: the documents of the command line."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from math import nan
from typing import Any

import numpy as np

from taichi_erosion import __version__
from taichi_erosion.evidence.findings import (
    Adoption,
    Comparison,
    Discovery,
    Experiment,
    VaultErrors,
)
from taichi_erosion.evidence.study import Study
from taichi_erosion.measures.result import without_nan

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
