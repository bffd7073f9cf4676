"""The evidence loop as commands ask for it: a study file in, a document out, kept in the results folder."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from threadpoolctl import threadpool_limits

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers import documents as results
from taichi_erosion.evidence.answers.adopt import adopt
from taichi_erosion.evidence.answers.adopted_study import write_adopted_study
from taichi_erosion.evidence.answers.compare import compare
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.answers.documents import (
    Document,
    adopt_document,
    compare_document,
    discover_document,
    next_document,
    plain,
)
from taichi_erosion.evidence.answers.next_experiments import next_experiments, propose
from taichi_erosion.evidence.answers.refinement_rounds import (
    Asked,
    BudgetName,
    about_adoption,
    about_comparison,
    about_discovery,
    answered,
    due_before_outside,
    last_budget,
)
from taichi_erosion.evidence.data.findings import Adoption, Comparison, Discovery, Experiment, HypothesisFit
from taichi_erosion.evidence.data.held_out_rows import openings, record_opening
from taichi_erosion.evidence.data.problem import Laboratory, Progress
from taichi_erosion.evidence.emulator.design import RefinementPoint
from taichi_erosion.evidence.models.load_study import Study, load_study


@contextmanager
def opened(path: Path, budget: BudgetName | None = None) -> Iterator[Study]:
    """A study whose runs are safe in its store when the block is left, however it is left.

    Matrices are multiplied on one thread: on several their last bits would depend on how many there are, and
    with them which runs are asked for next.
    """
    with threadpool_limits(1, user_api="blas"):
        study = load_study(path, budget)
        try:
            yield study
        finally:
            study.store.commit()


def compare_study(path: Path, progress: Progress) -> Document:
    """Where the model fails."""
    start = perf_counter()
    with opened(path) as study:
        budget = last_budget(study)

        def question(ready: Study) -> Comparison:
            return compare(ready.problem, progress, ready.file.study.seed)

        found, ready = answered(study, budget, Asked("compare", question, about_comparison), progress)
        return kept(ready, "compare", compare_document(ready, found), start)


def discover_study(path: Path, budget: BudgetName | None, progress: Progress) -> Document:
    """Which effect is missing."""
    start = perf_counter()
    with opened(path, budget) as study:
        seed, spent = study.file.study.seed, study.problem.budget.name

        def question(ready: Study) -> Discovery:
            return discover(ready.problem, seed, ready.problem.budget, progress)

        asked = Asked("discover", question, about_discovery, names_of(study), due=due_before_outside)
        found, ready = answered(study, spent, asked, progress)
        if study.file.study.model is not None or not study.file.laboratory.ranges:
            experiments = next_experiments(ready.problem, found, laboratory_of(ready))
            found = replace(found, next_experiments=tuple(experiments))
        adopted = results.recall(study.results, path.stem, "adopt")
        seen = adopted["vault"] if adopted and adopted.get("digest") == study.digest[:12] else None
        document = discover_document(ready, found, seen) | {"budget": spent}
        return kept(ready, "discover", document, start)


def adopt_study(path: Path, effect: str, progress: Progress) -> Document:
    """The error before and after an effect is added, on data that no fit has seen; writes the new study."""
    start = perf_counter()
    with opened(path) as study:
        names, seed = names_of(study), study.file.study.seed
        if effect not in names:
            raise BadInput(f"{path}: {effect} is no candidate; there are: {', '.join(names) or 'none'}")

        def question(ready: Study) -> Adoption:
            return adopt(ready.problem, effect, seed, progress)

        asked = Asked(f"adopt {effect}", question, about_adoption, names)
        found, ready = answered(study, last_budget(study), asked, progress)
        count = openings(study.results, study.digest)
        if len(study.problem.vault.rows):
            count = record_opening(study.results, study.digest, effect)
        successor = write_adopted_study(study, found)
        document = adopt_document(ready, found, count, str(successor))
        extend_ladder(study, found)
        return kept(ready, "adopt", document, start)


def next_study(path: Path, progress: Progress) -> Document:
    """The experiments that would decide."""
    start = perf_counter()
    with opened(path) as study:
        seed, budget = study.file.study.seed, last_budget(study)

        def question(ready: Study) -> tuple[Discovery, list[Experiment]]:
            return propose(ready.problem, laboratory_of(ready), seed, progress)

        def about(found: tuple[Discovery, list[Experiment]]) -> list[RefinementPoint]:
            return about_discovery(found[0])

        asked = Asked("next", question, about, names_of(study), ahead=True)
        found, ready = answered(study, budget, asked, progress)
        return kept(ready, "next", next_document(ready, found[1]), start)


def kept(study: Study, question: results.Question, document: Document, start: float) -> Document:
    """A document in the results folder, with what all of it has cost."""
    if study.simulations is not None:
        document |= {"runs": study.simulations, "wall_s": perf_counter() - start}
    results.keep(study.results, study.path.stem, question, document)
    return document


def names_of(study: Study) -> list[str]:
    """Candidates of a study."""
    return [candidate.name for candidate in study.problem.candidates]


def laboratory_of(study: Study) -> Laboratory:
    """What could be measured next, as the study states it."""
    said = study.file.laboratory
    return Laboratory(ranges=dict(said.ranges), costs=dict(said.costs), repeats=said.repeats)


def extend_ladder(study: Study, found: Adoption) -> None:
    """Put the adoption on the error ladder, above the model that it started from."""
    before = list(study.file.adopted)
    if not results.ladder(study.results):
        results.extend_ladder(study.results, rung(before, found.base))
    results.extend_ladder(study.results, rung([*before, found.effect], found.added))


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
