"""The evidence loop as commands ask for it: a study file in, a document out, kept in the results folder."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence import results
from taichi_erosion.evidence.adopt import adopt
from taichi_erosion.evidence.compare import compare
from taichi_erosion.evidence.discover import discover
from taichi_erosion.evidence.documents import (
    Document,
    adopt_document,
    compare_document,
    discover_document,
    next_document,
    plain,
)
from taichi_erosion.evidence.findings import Adoption, HypothesisFit
from taichi_erosion.evidence.problem import Laboratory, Progress
from taichi_erosion.evidence.propose import next_experiments, propose
from taichi_erosion.evidence.study import Study, load_study
from taichi_erosion.evidence.successor import write_successor
from taichi_erosion.evidence.vault import openings, record_opening

BudgetName = Literal["quick", "full"]


@dataclass
class Voice:
    """One line of progress for two tellers: the statistics, and the simulations that they wait for."""

    progress: Progress
    words: str = ""
    share: float = 0.0

    def tell(self, words: str, share: float) -> None:
        """What the statistics are doing, and how far they are."""
        self.words, self.share = words, share
        self.progress(words, share)

    def tell_runs(self, _share: float, words: str) -> None:
        """How far the simulations of the present step are."""
        self.progress(f"{self.words}: {words}", self.share)


@contextmanager
def opened(path: Path, voice: Voice, budget: BudgetName | None = None) -> Iterator[Study]:
    """A study whose runs are safe in its store when the block is left, however it is left."""
    study = load_study(path, budget, voice.tell_runs)
    try:
        yield study
    finally:
        study.store.commit()


def compare_study(path: Path, progress: Progress) -> Document:
    """Where the model fails."""
    voice = Voice(progress)
    with opened(path, voice) as study:
        document = compare_document(study, compare(study.problem, voice.tell))
        results.keep(study.results, path.stem, "compare", document)
        return document


def discover_study(path: Path, budget: BudgetName | None, progress: Progress) -> Document:
    """Which effect is missing."""
    voice = Voice(progress)
    with opened(path, voice, budget) as study:
        found = discover(study.problem, study.file.study.seed, study.problem.budget, voice.tell)
        if study.file.study.model is not None:  # a scene would have to be simulated under every condition
            experiments = next_experiments(study.problem, found, laboratory_of(study))
            found = replace(found, next_experiments=tuple(experiments))
        adopted = results.recall(study.results, path.stem, "adopt")
        seen = adopted["vault"] if adopted and adopted.get("digest") == study.digest[:12] else None
        document = discover_document(study, found, seen)
        document["budget"] = study.problem.budget.name
        results.keep(study.results, path.stem, "discover", document)
        return document


def adopt_study(path: Path, effect: str, progress: Progress) -> Document:
    """The error before and after an effect is added, on data that no fit has seen; writes the new study."""
    voice = Voice(progress)
    with opened(path, voice) as study:
        names = [candidate.name for candidate in study.problem.candidates]
        if effect not in names:
            raise BadInput(f"{path}: {effect} is no candidate; there are: {', '.join(names) or 'none'}")
        found = adopt(study.problem, effect, study.file.study.seed, voice.tell)
        count = openings(study.results, study.digest)
        if len(study.problem.vault.rows):
            count = record_opening(study.results, study.digest, effect)
        successor = write_successor(study, found)
        document = adopt_document(study, found, count, str(successor))
        results.keep(study.results, path.stem, "adopt", document)
        climb(study, found)
        return document


def next_study(path: Path, progress: Progress) -> Document:
    """The experiments that would decide."""
    voice = Voice(progress)
    with opened(path, voice) as study:
        _, experiments = propose(study.problem, laboratory_of(study), study.file.study.seed, voice.tell)
        document = next_document(study, experiments)
        results.keep(study.results, path.stem, "next", document)
        return document


def laboratory_of(study: Study) -> Laboratory:
    """What could be measured next, as the study states it."""
    said = study.file.laboratory
    return Laboratory(ranges=dict(said.ranges), costs=dict(said.costs), repeats=said.repeats)


def climb(study: Study, found: Adoption) -> None:
    """Put the adoption on the error ladder, above the model that it started from."""
    before = list(study.file.adopted)
    if not results.ladder(study.results):
        results.climb(study.results, rung(before, found.base))
    results.climb(study.results, rung([*before, found.effect], found.added))


def rung(effects: list[str], fit: HypothesisFit) -> Document:
    """One rung: the errors per row with some effects in the model."""
    return plain(
        {
            "effects": effects,
            "chi2_fitted": fit.chi2,
            "chi2_held_out": fit.vault_chi2,
            "rmse_held_out": fit.vault_rmse,
        }
    )
