"""Trials on the reduced model by name: a seed and a number make a case."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

from doe.trials.reduced import beyond, clean, disturbed, several, smooth
from doe.trials.reduced.oracle import difficulty
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.models.new_conditions import NewConditions

LEAST_RATIO = 7.0  # of every effect in the designs of `several`
NULLS = 0.45  # share of disturbed cases in which nothing is missing
MIX = ("disturbed", "beyond", "clean", "disturbed", "several")  # of the family `reduced`, in turn
DISCREPANCIES = (0.0, 0.5, 1.0, 2.0)  # rms over the standard error of a row


@dataclass(frozen=True)
class Drawn:
    """What the solver is given, what is hidden, and how hard that is to see."""

    problem: Problem
    truth: dict[str, Any]
    difficulty: Callable[[], dict[str, Any]] = dict
    asked: NewConditions | None = None  # where values are asked


def clean_case(seed: int, number: int) -> Drawn:
    case = clean.draw_case(seed, number)
    return Drawn(case.problem, asdict(case.truth), lambda: difficulty(case))


def disturbed_case(seed: int, number: int) -> Drawn:
    case = disturbed.draw_case(f"{seed:x}", number, NULLS)
    plain = disturbed.undisturbed(case)
    return Drawn(case.problem, asdict(case.truth), lambda: difficulty(plain))


def several_case(seed: int, number: int) -> Drawn:
    """Kinds in turn."""
    kind = list(several.KINDS)[number % len(several.KINDS)]
    case = several.draw_several(seed, number, kind, LEAST_RATIO)
    return Drawn(case.problem, asdict(case.truth), lambda: difficulty(case))


def beyond_case(seed: int, _number: int) -> Drawn:
    problem, truth = beyond.draw(seed)
    return Drawn(problem, asdict(truth), lambda: {"ratio": beyond.ratio(problem, truth)})


def intervals_case(seed: int, number: int) -> Drawn:
    """Sizes of a smooth discrepancy in turn."""
    size = DISCREPANCIES[number % len(DISCREPANCIES)]
    case = smooth.draw(seed, size)
    told = {"mean": case.truth.tolist(), "measured": case.measured.tolist(), "parameters": case.numbers}
    return Drawn(
        case.problem, {"discrepancy": size, **told}, asked=NewConditions(case.observable, case.conditions)
    )


def reduced_case(seed: int, number: int) -> Drawn:
    """Families in turn."""
    turn, place = divmod(number, len(MIX))
    drawn = FAMILIES[MIX[place]](seed, turn)
    return replace(drawn, truth={"family": MIX[place], **drawn.truth})


FAMILIES: dict[str, Callable[[int, int], Drawn]] = {
    "reduced": reduced_case,
    "clean": clean_case,
    "disturbed": disturbed_case,
    "several": several_case,
    "beyond": beyond_case,
    "intervals": intervals_case,
}
