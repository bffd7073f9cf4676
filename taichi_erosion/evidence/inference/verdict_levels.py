"""Significance levels, priors, odds and display thresholds of the evidence loop, each stated once.

Figures "t0" are those of the 3000 sealed cases of the reduced model (`doe/trials`, 1393 of them with nothing
missing and the scatter as stated); "watched" those of 272 such nulls and 109 single effects among the first
600 cases of family 5000, from which the tests draw. Probabilities and shares [1] unless a unit is given.

Why the misfit level is 0.01: a misfit is looked for in the whole and in every place, and the least of these
chances decides. On the watched nulls it lies below 0.05 in 9 % (24) and below 0.01 in 3 % (9); of the single
effects, weak ones included, 46 % (50) and 34 % (37) show at these levels. A model that lacks nothing must not
be called wrong one time in eleven, so the stricter level holds, and it is one level for verdict, text and
page: what `compare` calls a disagreement is what `discover` counts as one.
"""

MISFIT_LEVEL = 0.01  # chance of a misfit, in the whole or (Holm-adjusted) in one place
FAMILYWISE_LEVEL = 0.05  # of the strongest candidate; t0: 4.0 % of nulls, all 244 singles above 4.5 sd
NOISE_LEVEL = 0.05  # chance below which stated scatter and scatter between repeats disagree
REJECTION_LEVEL = 1e-3  # chance of what a hypothesis leaves, below which it counts as "not in the list"
SECOND_EFFECT_LEVEL = 0.2  # chance of what a single effect leaves, below which a second is searched
LEAST_P = 1e-16  # written as "p <"; below, rounding decides

PRIOR_NONE = 0.50  # t0: nothing missing in 0.51 of the cases, calibration error of the likeliest 0.022
PRIOR_OUTSIDE = 0.15  # something missing that no candidate describes; t0: 0.12
PRIOR_SETS = (0.06, 0.02, 0.007)  # two, three, four candidates at once, each shared by all such sets
MOST_EFFECTS = 1 + len(PRIOR_SETS)  # of a set that is searched
PRIOR_BEYOND = 0.05  # share of the prior of a set that lets its strengths exceed the largest of the list
PRIOR_LEVEL = 0.15  # an instrument or the code is off at all conditions alike, asked where the model fails
PRIOR_RANGE = 0.05  # nothing is missing, but a calibrated number lies beyond its range
PRIOR_LEVEL_EACH = 0.3  # of one observable where any level is off
ODDS_SOURCE = 0.3  # prior odds of an unstated error by source over stated errors, where two sources are given
ODDS_BATCH = 0.2  # of one by batch
ODDS_SCATTER = 0.2  # of scatter that differs between observables or grows along a condition
ODDS_ROW = 0.01  # of a row to be off, each
ACCOUNT_BEHIND = 3.0  # ln evidence behind stated errors at which an account of errors is left aside
ACCOUNT_FAR = 7.0  # the same behind the best account of errors: less than 0.1 % of the probability
LEAST_ROWS = 12  # from which errors that nobody stated are estimated
MOST_ACCOUNTS = 2  # accounts of errors beside stated ones and free levels that are fitted anew
PRIOR_REMAINDER = 0.10  # share of a single's prior that allows a smooth remainder beside it

# The next two were 0.4 and 0.5 while sets that no step of the search reaches were not fitted. With those, an
# effect that explains as much has 1.4 times the odds to act, and "none" a sixth less: these decide as before.
NONE_LIMIT = 0.33  # probability of "none" for a name; t0: with p, 0.6 % of nulls and all singles above 4.5 sd
ALONE = 0.6  # probability that an effect named alone must have
SURE = 0.8  # share of the named probability from which one effect stands alone; t0: 366 of 374 act
MEMBER_LEVEL = 0.01  # family-wise p of a third or fourth effect beside the others
MEMBER_BEHIND = 3.0  # ln evidence behind the best effect in one place of a set, up to which another is told
CREDIBLE = 0.9  # probability that a group holds; t0: 39 of 45 groups hold all that acts, 41 some of it
POSITIVE_ODDS = 3.0  # of an effect over the bare model, above which it is not told as excluded
NAME_ODDS = 3.0  # of a name that leaves a misfit over "not in the list"; t0: 2 of 133 unlisted misnamed
RIVAL_MISFIT = 3.0  # misfit behind the best below which another effect explains as well
UNSTABLE = 0.5  # probability of a rival on half of the seeds that withdraws a name; t0: 0 of 203 singles
EMULATOR_LEVEL = 0.01  # chance of a gap between fresh runs and their emulator, below which it is off
EXPLAINED_SHARE = 0.85  # of the misfit, from which an effect with a smooth remainder is still named
TESTABLE_POWER = 0.8  # from which silence means absence; t0: 5 of 710 silences hid an effect above 4.5 sd
TESTABLE_SHARE = 0.5  # of the candidates, below which silence means nothing

SEPARATION = 3.0  # sd between two hypotheses below which they form a group: Phi(3 / 2) = 93 % separated
ABSORBED = 0.8  # share of a signature that calibration imitates, from which the two are hardly separable
UNRESOLVED_NOISE = 0.7  # share of noise in a signature from which it is not used at all
NOISE_LIMIT = 0.1  # share of noise in a signature from which more seeds are needed

EFFECTIVE = 0.5  # prior sd by which effects move a number, from which it is read as effective
NEAR_START = 1.0  # prior sd from its start, within which a number that effects moved back is not effective
UNIDENTIFIED = 0.9  # share of the interval of its prior, from which a number is not identified
CORRELATED = 0.9  # correlation of two numbers from which it is told: sd of either given the other below 0.44
INTERVAL_TAIL = 0.05  # to either side; t0: such intervals hold 0.920 of strengths, 0.889 of parameters
HELD_OUT_MISFIT = 2.0  # per held-out row, from which the bare model fails there
HELD_OUT_SHARE = 0.5  # of that misfit left, above which a name is refuted; t0: right names leave 0.096
SECOND_TERM = 0.05  # share of the misfit that a second term of a law must explain on left-out groups

CONSISTENT_MISFIT = 3.0  # per degree of freedom, above which no model is called consistent, whatever p is
ONE_ROW = (
    0.4  # share of the misfit in one row, from which the row is told; all 12 tables with a bad cell had more
)
ROW_OFF = (
    4.0  # sd under every explanation, from which a row is to be checked first; by chance 1 row of 16,000
)
ROW_ALONE = 2.0  # times as far off as the next row
TOLD_LEVEL = 0.5  # probability from which an offset of an observable is told
SETTLED_NAME = 0.9  # probability of listed effects from which free levels are tried alone first
SETTLED_BEHIND = 5.0  # ln evidence by which levels alone must be behind to be left at that
SURE_LEVEL = 0.95  # probability from which an offset is told without it
LEVEL_ODDS = 0.5  # probability of free levels from which they are part of the calibration
LAW_SHARE = 0.1  # of the misfit of left-out groups, from which a law is told as a hypothesis
MECHANISM_GAIN = 3.0  # ln Bayes factor against the bare model, from which a mechanism explains a misfit
MECHANISM_BEHIND = 3.0  # the same behind a free smooth discrepancy of every observable, at most
MECHANISM_ODDS = 20.0  # of the best mechanism over another, up to which the two are one group
CHALLENGE_LEVEL = 0.05  # chance of what a name leaves, below which mechanisms of scenes get runs
NUMBER_SHARE = 0.5  # of the misfit, from which a calibrated number is told that would have to vary
UNVISITED = 0.02  # estimated probability of sets that were not fitted, from which it is told
REPORTED_RIVAL = 1e-3  # probability from which another explanation is reported
REPORTED_CLOSEST = 0.5  # share of the misfit, from which an explanation that does not suffice is reported
PLAUSIBLE = 0.01  # probability from which an explanation is carried to the next experiment
DECIDED = 0.9  # probability at which an explanation has won
DECIDING = 0.2  # chance of a set of experiments below which it is said to decide nothing
STABLE = 1.0  # share of repeats with other seeds that agree, below which this is reported


def fails(p: float | None) -> bool:
    """Whether a misfit of this chance counts as one; an unknown chance (None, NaN) never does."""
    return p is not None and p < MISFIT_LEVEL


def least_rows(calibrated: int) -> int:
    """Least number of rows under different conditions that can tell one effect from another.

    An explanation holds the calibrated numbers and the strength of one effect; that the level of an
    observable is off instead is one number more. Only what is left after these can contradict an explanation:
    at least one row.
    """
    return calibrated + 3


def too_few_rows(rows: int, calibrated: int) -> bool:
    """Whether rows are so few that every explanation describes them, whatever they say."""
    return rows < least_rows(calibrated)


def least_odds(bare: bool) -> float:
    """Odds that a name needs over the bare model, or over an explanation without it."""
    return (1.0 - NONE_LIMIT) / NONE_LIMIT if bare else SURE / (1.0 - SURE)


def p_text(p: float, digits: int = 2) -> str:
    """A probability in words."""
    number = p_number(p, digits)
    return f"p {number}" if number.startswith("<") else f"p = {number}"


def p_number(p: float, digits: int = 3) -> str:
    """A probability; one too small to be computed is not called zero."""
    return f"{p:.{digits}g}" if p >= LEAST_P else f"< {LEAST_P:g}"
