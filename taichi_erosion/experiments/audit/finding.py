"""One thing that is wrong, or that a reader should know."""

from dataclasses import dataclass
from math import nan
from typing import Literal

Kind = Literal[
    "unbalanced",  # a factor is not as often high as low
    "not orthogonal",  # factors cannot be told apart
    "cell",  # one cell whose change mends the design
    "level",  # a level that stands alone
    "lack of fit",  # the model misses the means of its points
    "curvature",  # the centre lies off the plane
    "number",  # a printed number that the table does not give
    "sum",  # printed parts that do not add up
    "heading",  # a column that holds something else
    "sign",  # a coefficient of the opposite sign
    "coding",  # levels whose order is reversed
    "target",  # wished for, but not reached by the fitted surface
    "optimum",  # the published optimum against the recomputed one
    "same point",  # one point, two results
    "prediction",  # a run that the fitted surface contradicts
    "setting",  # something that cannot be examined
]


@dataclass(frozen=True)
class Finding:
    """A finding; row counts from 1 below the heading, 0 where none is meant."""

    kind: Kind
    sentence: str
    table: str = ""
    column: str = ""
    row: int = 0
    printed: str = ""
    found: float = nan
