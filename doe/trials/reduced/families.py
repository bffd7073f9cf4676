"""Trials on the reduced model by name: a seed and a number make a case."""

import pickle
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from doe.trials.answers import answered
from doe.trials.reduced import beyond, clean, disturbed, smooth
from doe.trials.reduced.oracle import difficulty
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.models.table_columns import NewConditions

LEAST_RATIO, TRIES = 7.0, 500  # of every effect in `several`; draws until one is as clear
SEVERAL = ("pair", "triple", "four")
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

    def write(self, place: Path) -> None:
        """The file that the solver is given."""
        write_atomic(place.with_suffix(".pickle"), pickle.dumps((self.problem, self.asked)))

    def answer(self, number: int) -> dict[str, Any]:
        """What the program says of it now."""
        return answered(self.problem, number, self.asked)

    def row(self, answer: dict[str, Any]) -> dict[str, Any]:
        """Truth and difficulty beside an answer."""
        return {"truth": self.truth, "difficulty": self.difficulty(), "answer": answer}


def clean_case(seed: int, number: int) -> Drawn:
    case = clean.draw_case(seed, number)
    return Drawn(case.problem, asdict(case.truth), lambda: difficulty(case))


def disturbed_case(seed: int, number: int) -> Drawn:
    return told(disturbed.draw_case(f"{seed:x}", number, NULLS))


def several_case(seed: int, number: int) -> Drawn:
    """A disturbed case of two to four effects, of which each could be seen."""
    for turn in range(TRIES):
        case = disturbed.draw_case(f"{seed:x}/{turn}", number, 0.0)
        if case.truth.kind not in SEVERAL:
            continue
        if difficulty(disturbed.undisturbed(case), apart=False)["ratio"] >= LEAST_RATIO:
            return told(case)
    raise RuntimeError(f"no design in {TRIES} shows every effect")


def told(case: clean.Case) -> Drawn:
    """A disturbed case, as hard as if it were not disturbed."""
    plain = disturbed.undisturbed(case)
    return Drawn(case.problem, asdict(case.truth), lambda: difficulty(plain))


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
