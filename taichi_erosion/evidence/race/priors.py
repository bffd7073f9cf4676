"""Priors and limits of the race: every number of the inference stands here, once, with its reason.

P(nothing) = nothing; P(all sets of k + 1 effects) = step P(all sets of k); sets of one size share alike; what
no list holds has `unlisted`, of which mechanisms, where the model declares some, have all but step. A scale
sigma of a block of errors is half-Cauchy or half-normal, in units of the standard error of a row; a strength
psi and a factor f of the scatter are log-normal.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Priors:
    """What is assumed before a table is read; `decision.sensitivity` halves and doubles it."""

    nothing: float = 0.5  # as likely as not
    unlisted: float = 0.15  # that something is missing that is not in the list
    step: float = 0.25  # of one more effect
    typical: float = 2.0 / 3.0  # strength expected, over the scale of its prior
    spread: float = 0.8  # sd of ln strength: one in twelve above three times what is expected
    dose: float = 1.0  # half-Cauchy of ln(1 + dose)
    near: float = 0.25  # half-Cauchy of levels and sources, twice as wide of groups; half-normal of set-ups
    small: float = 0.4  # half-normal of a smooth discrepancy, in every hypothesis
    large: float = 2.0  # half-Cauchy of one that is unlisted
    doubt: float = 0.35  # sd of ln of the scatter over what is stated: preparations differ more than repeats


PRIORS = Priors()
MOST = 4  # effects at once: more rows than a table has would be needed to tell five
BAD_ROW, BAD_SD = 0.01, (10.0, 100.0)  # chance that a row is bad by each size: its sd over its own
SLIP = 0.001  # chance that a value is ten times too large, and that it is ten times too small
LENGTH = 0.5  # of a smooth discrepancy, over the range of a condition
SURE = 0.9  # probability from which a thing is said
ADEQUATE = 0.01  # chance of a misfit from which rows do not refute an explanation
SHARED, STRAIGHT = 0.95, 0.9  # of a condition that imitates an effect: share of its change, correlation
FAMILYWISE = 0.02  # chance below which the best of all candidates is no accident
CARRIED = 5  # likely explanations, mechanisms or laws that get slopes of their own
DRAWS, SEED = 2000, 0  # of everything that is drawn: the same table has the same answer
KEEP = 0.01  # probability from which a hypothesis is worth another run of the model
