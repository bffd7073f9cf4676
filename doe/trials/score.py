"""Scores of trials, printed as tables: shares and medians with 95 % bounds beside their targets.

    python -m doe.trials.score                       every trial
    python -m doe.trials.score TRIAL... [SET...]     some trials, or some of their sets

Bounds of shares are those of Clopper and Pearson, of medians
the order statistics between which they lie with 95 %; a target is met where the bound on its side is.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from math import inf, isfinite, nan

import numpy as np
from scipy import stats

from doe.common.command import words
from doe.trials.metrics import (
    DISTINCT,
    HEADER,
    IDENTIFIABLE,
    STRONG,
    TAIL,
    Case,
    Cases,
    Metric,
    median,
    of_kind,
    share,
)
from doe.trials.table import read_rows, table_of
from taichi_erosion.evidence.data.findings import NONE, OUTSIDE
from taichi_erosion.evidence.data.mechanism_findings import told_members
from taichi_erosion.report.markdown import markdown_table

BINS = 10  # of probabilities
MOST_TOLD = 3  # members of a group; gain and offset of one instrument are one
SPLIT = ("disturbed", "proposals")  # trials of which a set was answered by several methods


def interval_metrics(cases: Cases, words: str = "") -> Iterator[Metric]:
    """Intervals of strengths that are told and of calibrated numbers."""
    for what, name in (("strengths", "named strength"), ("parameters", "calibrated number")):
        hits = [hit for case in cases for hit in case.intervals(what)]
        yield share(f"90 % interval of a {name}{words}", hits, ">= 0.87")


def clean_metrics(everything: Cases) -> Iterator[Metric]:
    """Errors as the inference assumes; cases that were asked for beyond the others count with pairs only."""
    cases = [case for case in everything if "further" not in case.row]
    nulls, singles, outside = (of_kind(cases, kind) for kind in ("null", "single", "outside"))
    honest = [c for c in nulls if c.honest]
    yield share("nulls, sd as stated: any name", [bool(c.told) for c in honest], "<= 0.06")
    low = [bool(c.told) for c in nulls if not c.honest]
    yield share("nulls, sd understated 1.5: any name", low, "<= 0.1")
    yield share("nulls: not in the list", [c.flagged for c in nulls], "<= 0.03")
    seen = [c for c in singles if c.ratio >= IDENTIFIABLE]
    strong = [c for c in seen if c.ratio >= STRONG and c.separation >= DISTINCT]
    middle = [c for c in seen if c.ratio < STRONG and c.separation >= DISTINCT]
    yield share("single, ratio >= 7, distinct: ranked first", [c.is_top for c in strong], ">= 0.97")
    yield share("single, ratio >= 7, distinct: named alone", [c.exact for c in strong], ">= 0.93")
    yield share("single, ratio 4.5 to 7, distinct: ranked first", [c.is_top for c in middle], ">= 0.88")
    told = [c for c in seen if c.told]
    yield share("single, ratio >= 4.5: told set holds the truth", [c.held for c in told], ">= 0.95")
    yield share("single, ratio >= 4.5: detected", [bool(c.told) for c in seen], ">= 0.88")
    yield share("single, ratio >= 4.5: not in the list", [c.flagged for c in seen], "<= 0.01")
    apart = [c for c in outside if c.separation >= DISTINCT]
    clear = [c for c in apart if c.ratio >= STRONG and c.separation >= STRONG]
    yield share("outside the list, ratio and separation >= 7: flagged", [c.flagged for c in clear], ">= 0.95")
    yield share("outside the list, separation >= 3: named, > 0.9", [c.misnamed for c in apart], "<= 0.005")
    pairs = [c for c in of_kind(everything, "pair") if c.ratio >= STRONG and c.separation >= DISTINCT]
    yield share("pair, ratios >= 7, distinct: exact", [c.named == c.acting for c in pairs], ">= 0.93")
    yield share("pair, ratios >= 7, distinct: one right", [bool(c.told & c.acting) for c in pairs], ">= 0.99")
    yield from other_clean_metrics(cases)


def other_clean_metrics(cases: Cases) -> Iterator[Metric]:
    """Designs that cannot tell, probabilities, intervals, held-out rows and time."""
    poor = [c for c in of_kind(cases, "impossible") if c.separation < DISTINCT]
    yield share("impossible: no lone name", [c.answer["verdict"] != "present" for c in poor], ">= 0.97")
    yield calibration(cases)
    right = [c for c in cases if c.honest and (c.exact or (c.kind == "null" and not c.told))]
    yield from interval_metrics(right)
    yield from vault_metrics([c for c in of_kind(cases, "single") if c.exact and c.ratio >= STRONG])
    yield median("seconds of one core", [c.answer["seconds"] for c in cases], "<= 0.3")


def calibration(cases: Cases) -> Metric:
    """Expected calibration error of the probability of the likeliest claim.

    The claims are: nothing is missing; something outside the list is; these effects act, alone or with
    others. Impossible designs are left out: a twin of the truth cannot be told from it.
    """
    given, true = [], []
    for case in (case for case in cases if case.kind != "impossible"):
        probability = case.answer["probabilities"]
        top = max(probability, key=lambda name: probability[name])
        if top in (NONE, OUTSIDE):
            given.append(probability[top])
            true.append(case.kind == ("null" if top == NONE else "outside"))
        else:
            acting = set(top.split("+"))
            given.append(sum(p for names, p in probability.items() if acting <= set(names.split("+"))))
            true.append(acting <= case.acting)
    cell = np.minimum((np.array(given) * BINS).astype(int), BINS - 1)
    gaps = np.bincount(cell, np.array(given) - np.array(true, dtype=float))
    error = float(np.abs(gaps).sum()) / max(len(given), 1)
    return Metric("calibration error of the likeliest", error, nan, nan, len(given))


def vault_metrics(cases: Cases) -> Iterator[Metric]:
    """Held-out misfit with a right name and with a random wrong effect, over that of the bare model."""
    known = [c.answer["vault"] for c in cases if c.answer["vault"][1] is not None]
    wrong = [vault for vault in known if vault[2] is not None]
    yield median("held-out misfit after / before, right name", [v[1] / v[0] for v in known], "<= 0.3")
    yield median("the same, random wrong effect", [v[2] / v[0] for v in wrong], ">= 0.9")
    yield share("right name beats a random wrong effect", [v[1] < v[2] for v in wrong], ">= 0.95")


def disturbed_metrics(cases: Cases) -> Iterator[Metric]:
    """Errors of real laboratories; the last lines are by disturbance."""
    nulls, singles = of_kind(cases, "null"), of_kind(cases, "single")
    yield share("nulls: any name", [bool(c.told) for c in nulls], "<= 0.02")
    yield share("nulls: not in the list", [c.flagged for c in nulls], "<= 0.05")
    for low, high, target in (
        (3.0, IDENTIFIABLE, ">= 0.74"),
        (IDENTIFIABLE, STRONG, ""),
        (STRONG, inf, ">= 0.95"),
    ):
        some = [c for c in singles if low <= c.ratio < high]
        words = f"single, ratio {low:g} to {high:g}" if isfinite(high) else f"single, ratio >= {low:g}"
        yield share(f"{words}: right or in the told set", [c.held for c in some], target)
        yield share(f"{words}: not in the list", [c.flagged for c in some])
    for kind in ("pair", "triple", "four"):
        some = [c for c in of_kind(cases, kind) if c.ratio >= STRONG]
        yield share(f"{kind}, ratios >= 7: exact", [c.exact for c in some], ">= 0.8")
        yield share(f"{kind}, ratios >= 7: none false", [c.told <= c.acting for c in some], ">= 0.97")
    outside = [c.flagged for c in of_kind(cases, "outside") if c.separation >= STRONG]
    yield share("not in the list, separation >= 7: flagged", outside, ">= 0.95")
    far = [c.held for c in singles if c.truth["disturbance"] == "beyond" and c.ratio >= STRONG]
    yield share("single beyond the maximum: named", far, ">= 0.9")
    formed = [c for c in cases if c.truth["disturbance"] != "form"]
    yield next(interval_metrics(formed))
    yield list(interval_metrics(cases))[1]
    yield median("seconds of one core", [c.answer["seconds"] for c in cases], "<= 0.5")
    for name in dict.fromkeys(sorted(c.truth["disturbance"] for c in cases)):
        own = [c for c in nulls if c.truth["disturbance"] == name]
        yield share(f"{name}, nulls: silent", [not c.told and not c.flagged for c in own])
        seen = [c for c in singles if c.truth["disturbance"] == name and c.ratio >= IDENTIFIABLE]
        yield share(f"{name}, singles, ratio >= 4.5: right or in the told set", [c.held for c in seen])


def several_metrics(cases: Cases) -> Iterator[Metric]:
    """Whole sets of effects, and one beyond the largest strength of its list."""
    for kind in dict.fromkeys(c.kind for c in cases):
        own = of_kind(cases, kind)
        yield share(f"{kind}: a name that does not act", [bool(c.named - c.acting) for c in own], "<= 0.03")
        if kind != "null":
            yield share(f"{kind}: exact", [c.exact for c in own], ">= 0.8")
            yield share(f"{kind}: all that acts is told", [c.held for c in own])
        yield share(f"{kind}: not in the list", [c.flagged for c in own])
    yield next(interval_metrics(cases))
    yield median("seconds of one core", [c.answer["seconds"] for c in cases])


def beyond_metrics(cases: Cases) -> Iterator[Metric]:
    """Mechanisms whose dose follows a hidden law, listed effects and nulls."""
    nulls = of_kind(cases, "null")
    listed = [c for c in of_kind(cases, "listed") if c.ratio >= STRONG]
    yield from mechanism_metrics([c for c in of_kind(cases, "outside") if c.ratio >= STRONG])
    yield share("nulls: any mechanism", [bool(mechanisms(c)) for c in nulls], "<= 0.02")
    yield share("nulls: any listed effect named", [bool(c.named) for c in nulls], "<= 0.02")
    named = [c for c in listed if c.answer["verdict"] == "present" and c.named == {c.truth["name"]}]
    yield share("listed, ratio >= 7: named", [c in named for c in listed], ">= 0.93")
    asked = [c.answer["seconds"] for c in cases if "beyond" in c.answer]
    yield median("seconds of one core, with mechanisms", asked, "<= 5")
    yield median("seconds of one core, all cases", [c.answer["seconds"] for c in cases])


def mechanisms(case: Case) -> tuple[str, ...]:
    """Mechanisms told, best first."""
    return tuple(case.answer.get("mechanisms") or ())


def mechanism_metrics(outside: Cases) -> Iterator[Metric]:
    """Strong cases in which a mechanism acts."""
    words, groups = "outside, ratio >= 7", [(c, mechanisms(c)) for c in outside]
    right = [c.truth["name"] in group for c, group in groups]
    few = [
        hit and len(told_members(group)) <= MOST_TOLD for hit, (_, group) in zip(right, groups, strict=True)
    ]
    yield share(f"{words}: asked for a mechanism", ["beyond" in c.answer for c in outside])
    yield share(f"{words}: mechanism told, alone or in a group of at most three", few, ">= 0.8")
    yield share(f"{words}: mechanism told first", [g[:1] == (c.truth["name"],) for c, g in groups])
    yield share(f"{words}: mechanism in the group told", right)
    wrong = [len(g) == 1 and not hit for hit, (_, g) in zip(right, groups, strict=True)]
    yield share(f"{words}: wrong mechanism alone", wrong, "<= 0.05")
    present = [c.answer["verdict"] == "present" for c in outside]
    alone = [hit and not g and "trend" not in c.answer for hit, (c, g) in zip(present, groups, strict=True)]
    yield share(f"{words}: a listed effect named, nothing beside it", alone)
    held = [low <= true <= high for true, low, high in filter(None, map(exponent, outside))]
    yield share("power laws, mechanism right: exponent in its 90 % interval", held, ">= 0.85")
    errors = [c.answer["held_out"] for c in outside if c.answer.get("held_out")]
    yield median(
        f"{words}: held-out misfit after / before", [after / before for before, after in errors], "<= 0.3"
    )


def exponent(case: Case) -> tuple[float, float, float] | None:
    """Exponent that acts, and the interval told; None without a power of that mechanism."""
    truth, law = case.truth, case.answer.get("law")
    told = law["exponents"].get(truth["condition"]) if law else None
    if truth["form"] != "power" or told is None or mechanisms(case)[:1] != (truth["name"],):
        return None
    sign = 1.0 if truth["condition"] == "moisture" else -1.0
    return sign * truth["exponent"], told["low"], told["high"]


def correlated_metrics(cases: Cases) -> Iterator[Metric]:
    """Rows of one run, told as such or not."""
    arms = sorted({(c.truth["correlation"], c.truth["told"]) for c in cases})
    for which, told in arms:
        own = [c for c in cases if (c.truth["correlation"], c.truth["told"]) == (which, told)]
        words = f"correlation {which:g}, {'told' if told else 'not told'}"
        nulls, singles = [c for c in own if not c.acting], [c for c in own if c.acting]
        yield share(f"{words}: nulls, any name", [bool(c.named) for c in nulls])
        yield share(f"{words}: nulls, not in the list", [c.flagged for c in nulls])
        yield share(f"{words}: singles named rightly", [c.named == c.acting for c in singles])
        yield list(interval_metrics(own, f", {words}"))[1]


def judged(case: Case) -> str:
    """One word on an answer: right, in the group, partly, silent, wrong, false alarm."""
    acting, outside = case.acting, case.truth["outside"]
    if not acting and not outside:
        return "false alarm" if case.told or case.flagged else "right"
    if outside:
        return "right" if case.flagged else "wrong" if case.told else "silent"
    if not case.told:
        return "wrong" if case.flagged else "silent"
    if case.named == acting:
        return "right"
    if case.named <= acting <= case.told:
        return "in the group"
    return "partly" if acting & case.told else "wrong"


def laboratory_metrics(cases: Cases) -> Iterator[Metric]:
    """Words on answers on heaps, and what adopting did to held-out rows."""
    known = [case for case in cases if "truth" in case.row]
    verdicts = [judged(case) for case in known]
    for word in dict.fromkeys(("right", *verdicts)):
        yield share(word, [verdict == word for verdict in verdicts])
    vaults = [c.answer["vault"] for c in cases if c.answer["vault"][0] is not None]
    yield median("held-out misfit after / before", [v[1] / v[0] for v in vaults])


def published_metrics(cases: Cases) -> Iterator[Metric]:
    """What adopting did at the source that was left out of a series."""
    errors = [c.answer for c in cases if c.answer["error_after"] is not None]
    yield share("sources left out: something named", [bool(c.named) for c in cases])
    better = [each["error_after"] < each["error_before"] for each in errors if each["adopted_as"] == "named"]
    yield share("named: error at the source falls", better)
    ratios = [e["vault"][1] / e["vault"][0] for e in errors if e["adopted_as"] == "named"]
    yield median("named: misfit a row after / before", ratios)


def coverage_metrics(cases: Cases) -> Iterator[Metric]:
    """Mean shares inside intervals by the size of a discrepancy; cases are independent, rows are not."""
    for size in sorted({c.truth["discrepancy"] for c in cases}):
        own = [inside(c) for c in cases if c.truth["discrepancy"] == size]
        for what in own[0]:
            shares = np.array([each[what] for each in own])
            half = stats.t.ppf(1.0 - TAIL, shares.size - 1) * shares.std(ddof=1) / np.sqrt(shares.size)
            ends = (float(shares.mean() - half), float(shares.mean() + half))
            yield Metric(f"discrepancy {size:g}: {what}", float(shares.mean()), *ends, shares.size)


def inside(case: Case) -> dict[str, float]:
    """Shares of true means, of new measurements, of fitted rows and of calibrated numbers that are held."""
    answer, truth = case.answer, case.truth
    if "rows" not in answer:
        return answer
    rows = np.array(answer["rows"])
    mean, single = np.array(truth["mean"]), np.array(truth["measured"])
    held = {
        "mean": np.mean((rows[:, 0] <= mean) & (mean <= rows[:, 1])),
        "measured": np.mean((rows[:, 2] <= single) & (single <= rows[:, 3])),
        "fitted": answer["fitted"],
    }
    for name, table in answer["numbers"].items():
        hits = [low <= truth["parameters"][path] <= high for path, (low, high) in table.items()]
        held[name] = np.mean(hits)
    return {name: float(value) for name, value in held.items()}


def proposal_metrics(cases: Cases) -> Iterator[Metric]:
    """Six proposed experiments against six random ones, where the first answer names nothing alone."""
    asked = [c for c in cases if {"proposed", "random"} <= set(c.answer)]
    groups = {"an effect acts": [c for c in asked if c.acting]}
    groups["nothing is missing"] = [c for c in asked if not c.acting]
    for what, some in groups.items():
        arms = {arm: [decided(c, arm) for c in some] for arm in ("before", "proposed", "random")}
        for arm, hits in arms.items():
            yield share(f"{what}, {arm}: decided rightly", hits)
        only = [
            sum(a > b for a, b in zip(arms[x], arms[y], strict=True))
            for x, y in (("proposed", "random"), ("random", "proposed"))
        ]
        yield paired_difference(f"{what}: proposed - random", only[0], only[1], len(some))


def decided(case: Case, arm: str) -> bool:
    """An answer is decided and right: it names all that acts alone, or silence means absence."""
    answer = case.answer[arm]
    if not case.acting:
        return answer["verdict"] == "none_detected"
    return answer["verdict"] == "present" and set(answer["named"]) == case.acting


def paired_difference(name: str, first: int, second: int, count: int) -> Metric:
    """Difference of two shares on the same cases: `first` have only the one, `second` only the other.

    Given how many differ, the one is right in a binomial share of them, whose bounds are those of Clopper and
    Pearson. Reference: Agresti (2013), Categorical Data Analysis, section 11.1 (McNemar's test, conditional).
    """
    differ = share("", [k < first for k in range(first + second)])
    scale = (first + second) / max(count, 1)
    low, high = ((2.0 * end - 1.0) * scale if scale else 0.0 for end in (differ.low, differ.high))
    return Metric(name, (first - second) / max(count, 1), low, high, count)


def baseline_metrics(cases: Cases) -> Iterator[Metric]:
    """What other ways say of clean cases."""
    honest = [c for c in cases if c.honest]
    nulls = of_kind(honest, "null")
    yield share("nulls: something named", [bool(c.named) for c in nulls])
    for kind, low, high in (
        ("single", 3.0, IDENTIFIABLE),
        ("single", IDENTIFIABLE, STRONG),
        ("single", STRONG, inf),
        ("pair", STRONG, inf),
    ):
        some = [c for c in of_kind(honest, kind) if low <= c.ratio < high]
        yield share(f"{kind}, ratio {low:g} to {high:g}: right name", [c.named == c.acting for c in some])
        yield share(
            f"{kind}, ratio {low:g} to {high:g}: wrong name", [bool(c.named - c.acting) for c in some]
        )
    outside = [c for c in of_kind(honest, "outside") if c.ratio >= STRONG]
    yield share("not in the list, ratio >= 7: wrong name", [bool(c.named) for c in outside])
    numbers = [h for c in honest for h in c.intervals("parameters")]
    yield share("90 % interval of a calibrated number", numbers)


TRIALS: dict[str, Callable[[Cases], Iterator[Metric]]] = {
    "clean": clean_metrics,
    "disturbed": disturbed_metrics,
    "several": several_metrics,
    "beyond": beyond_metrics,
    "correlated": correlated_metrics,
    "intervals": coverage_metrics,
    "same_laws": laboratory_metrics,
    "other_laws": laboratory_metrics,
    "lammps": laboratory_metrics,
    "published": published_metrics,
    "proposals": proposal_metrics,
    "baselines": baseline_metrics,
}


def groups_of(trial: str) -> dict[tuple[str, str], list[Case]]:
    """Cases of every set, by method where several answered it; of `published` all together."""
    found: dict[tuple[str, str], list[Case]] = {}
    for row in read_rows(table_of(trial)):
        key = (row["set"] if trial != "published" else "all", row["method"] if trial in SPLIT else "")
        found.setdefault(key, []).append(Case(row))
    return found


def main(asked: Sequence[str]) -> None:
    """Print what was asked for."""
    trials = [name for name in asked if name in TRIALS] or list(TRIALS)
    sets = [name for name in asked if name not in TRIALS]
    for trial in trials:
        for (name, method), cases in groups_of(trial).items():
            if not sets or name in sets:
                table = markdown_table(HEADER, [metric.cells() for metric in TRIALS[trial](cases)])
                sys.stdout.write(f"## {trial}, {name} {method}: {len(cases)} cases\n\n{table}\n")


if __name__ == "__main__":
    main(words(__doc__))
