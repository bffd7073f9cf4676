"""A question put to a study: at once where a function answers, in rounds of simulations where scenes do."""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, TypeVar

from taichi_erosion.evidence import results
from taichi_erosion.evidence.findings import Adoption, Comparison, Discovery, HypothesisFit
from taichi_erosion.evidence.problem import Progress
from taichi_erosion.evidence.rehearsal import next_round, on_surfaces, rehearsal_of
from taichi_erosion.evidence.scales import EFFECTS, STRENGTH
from taichi_erosion.evidence.study import Study
from taichi_erosion.evidence.surface_plan import Explanation

MOST_EXPLANATIONS = 3  # about which a round simulates
BudgetName = Literal["quick", "full"]
Found = TypeVar("Found")


def answered(
    study: Study,
    effects: Sequence[str],
    budget: BudgetName,
    progress: Progress,
    question: Callable[[Study], Found],
    about: Callable[[Found], list[Explanation]],
    ahead: bool = False,
) -> tuple[Found, Study]:
    """The answer, and the study as it was when it was given.

    Scenes are simulated about what each answer leaves standing, and the question is put again. `ahead` also
    simulates conditions that were not measured but could be.
    """
    rehearsal = rehearsal_of(study, effects, budget, ahead)
    if rehearsal is None:
        return question(study), study
    for _ in range(rehearsal.amount.rounds):
        ready = on_surfaces(rehearsal, progress)
        rehearsal = next_round(rehearsal, about(question(ready)))
    ready = on_surfaces(rehearsal, progress)
    return question(ready), ready


def last_budget(study: Study) -> BudgetName:
    """How much the last discovery of a study of scenes spent; its runs are there already."""
    if study.file.study.model is not None:
        return study.problem.budget.name
    last = results.recall(study.results, study.path.stem, "discover")
    return "full" if last is not None and last.get("budget") == "full" else "quick"


def about_comparison(found: Comparison) -> list[Explanation]:
    """The calibrated bare model."""
    return [explanation({name: fitted.value for name, fitted in found.parameters.items()}, {})]


def about_discovery(found: Discovery) -> list[Explanation]:
    """The likeliest explanations, the bare model among them."""
    bare = [survivor for survivor in found.survivors if not survivor.names]
    others = [survivor for survivor in found.survivors if survivor.names]
    return [
        explanation(survivor.parameters, survivor.strengths)
        for survivor in [*bare, *others][:MOST_EXPLANATIONS]
    ]


def about_adoption(found: Adoption) -> list[Explanation]:
    """The model before and after, and with the controls."""
    fits: list[HypothesisFit | None] = [found.base, found.added, found.best_wrong, found.random_wrong]
    return [
        explanation(
            {name: fitted.value for name, fitted in fit.parameters.items()},
            {name: fitted.value for name, fitted in fit.strengths.items()},
        )
        for fit in fits
        if fit is not None
    ]


def explanation(parameters: Mapping[str, float], strengths: Mapping[str, float]) -> Explanation:
    """Calibrated numbers and strengths; the strength of an adopted effect may stand among the numbers."""
    numbers, effects = {}, dict(strengths)
    for name, value in parameters.items():
        if name.startswith(EFFECTS) and name.endswith(STRENGTH):
            effects[name[len(EFFECTS) : -len(STRENGTH)]] = value
        else:
            numbers[name] = value
    return Explanation(numbers, effects)
