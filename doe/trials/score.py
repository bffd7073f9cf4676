"""Scores of trials, printed as tables: shares and medians with 95 % bounds beside their targets.

    python -m doe.trials.score                       every trial
    python -m doe.trials.score TRIAL... [SET...]     some trials, or some of their sets

Bounds of shares are those of Clopper and Pearson, of medians the order statistics between which they lie with
95 %; a target is met where the bound on its side is.
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from math import inf, nan

import numpy as np
from scipy import stats

from doe.common.command import words
from doe.trials.metrics import (
    DISTINCT,
    HEADER,
    IDENTIFIABLE,
    MOST_TOLD,
    NONE,
    OUTSIDE,
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
from doe.trials.tables.outcome import table_metrics
from taichi_erosion.tables.number_words import markdown_table

BINS = 10  # of probabilities


def reduced_metrics(cases: Cases) -> Iterator[Metric]:
    """Cases of the closed-form model by kind, then what all of them have."""
    nulls = of_kind(cases, "null")
    yield share("nulls: any name", [bool(c.told) for c in nulls], "<= 0.02")
    yield share("nulls: not in the list", [c.flagged for c in nulls], "<= 0.03")
    yield share("nulls: any mechanism", [bool(c.mechanisms) for c in nulls], "<= 0.02")
    yield from listed_metrics(cases)
    yield from unlisted_metrics(of_kind(cases, "unlisted"))
    yield from mechanism_metrics([c for c in of_kind(cases, "mechanism") if c.ratio >= STRONG])
    false = [bool(c.named - c.acting) for c in cases if c.kind not in ("impossible", "mechanism")]
    yield share("possible, no mechanism: a name that does not act", false, "<= 0.03")
    yield calibration(cases)
    yield share("90 % interval of a named strength", held(cases, "strengths"), ">= 0.85")
    yield share("90 % interval of a calibrated number", held(cases, "parameters"), ">= 0.85")
    yield from vault_metrics(cases)
    yield median("settings of the model", [c.answer.get("settings") for c in cases])
    yield median("runs", [c.answer.get("runs") for c in cases])
    yield median("seconds of one core", [c.answer["seconds"] for c in cases])
    yield from disturbance_metrics([c for c in cases if "disturbance" in c.truth])


def held(cases: Cases, what: str) -> list[bool]:
    """Intervals of all cases; a strength of another law than the effect's has no true value."""
    formed = [c for c in cases if what != "strengths" or c.truth.get("disturbance") != "form"]
    return [hit for case in formed for hit in case.intervals(what)]


def listed_metrics(cases: Cases) -> Iterator[Metric]:
    """Listed effects act, alone or together."""
    singles = [c for c in of_kind(cases, "single") if c.separation >= DISTINCT]
    for low, high, text, target in (
        (STRONG, inf, "single, ratio >= 7, distinct", ">= 0.93"),
        (IDENTIFIABLE, STRONG, "single, ratio 4.5 to 7, distinct", ">= 0.8"),
    ):
        some = [c for c in singles if low <= c.ratio < high]
        yield share(f"{text}: named alone", [c.exact for c in some], target if low >= STRONG else "")
        yield share(f"{text}: named or in the group", [c.held for c in some], target)
        yield share(f"{text}: not in the list", [c.flagged for c in some], "<= 0.03")
    for kind in ("pair", "triple", "four"):
        some = [c for c in of_kind(cases, kind) if c.ratio >= STRONG and c.separation >= DISTINCT]
        yield share(f"{kind}, ratios >= 7, distinct: exact", [c.exact for c in some], ">= 0.85")
        yield share(f"{kind}, ratios >= 7, distinct: one right", [bool(c.told & c.acting) for c in some])
        yield share(f"{kind}, ratios >= 7, distinct: none false", [c.told <= c.acting for c in some])
    poor = [c for c in of_kind(cases, "impossible") if c.separation < DISTINCT]
    yield share("impossible: no lone name", [c.answer["verdict"] != "present" for c in poor], ">= 0.9")


def unlisted_metrics(unlisted: Cases) -> Iterator[Metric]:
    """An effect acts that is not in the list."""
    clear = [c for c in unlisted if min(c.ratio, c.separation) >= STRONG]
    apart = [c for c in unlisted if c.separation >= DISTINCT]
    yield share("unlisted, ratio and separation >= 7: flagged", [c.flagged for c in clear], ">= 0.85")
    yield share("unlisted, separation >= 3: named, > 0.9", [c.misnamed for c in apart], "<= 0.03")
    yield share("the same, with a strength that varies", [bool(c.varying) for c in apart])


def mechanism_metrics(cases: Cases) -> Iterator[Metric]:
    """A mechanism acts strongly, with a dose that no listed effect has."""
    text, right = "mechanism, ratio >= 7", [c.truth["name"] in c.mechanisms for c in cases]
    few = [hit and len(c.mechanisms) <= MOST_TOLD for hit, c in zip(right, cases, strict=True)]
    yield share(f"{text}: told first", [c.mechanisms[:1] == (c.truth["name"],) for c in cases])
    yield share(f"{text}: alone or in a group of at most three", few, ">= 0.8")
    alone = [len(c.mechanisms) == 1 and not hit for hit, c in zip(right, cases, strict=True)]
    yield share(f"{text}: a wrong one alone", alone, "<= 0.05")
    yield share(f"{text}: a listed effect named", [bool(c.named) for c in cases])
    yield share("power laws: exponent in its 90 % interval", [hit for c in cases for hit in exponent(c)])


def exponent(case: Case) -> list[bool]:
    """Whether the interval of the exponent holds the truth; empty without a power of that mechanism."""
    truth, told = case.truth, case.answer.get("powers", {}).get(case.truth["condition"])
    if truth["form"] != "power" or told is None or case.answer["law"] != truth["name"]:
        return []
    return [told[1] <= truth["exponent"] * (1.0 if truth["condition"] == "moisture" else -1.0) <= told[2]]


def calibration(cases: Cases) -> Metric:
    """Expected calibration error of the probability of the likeliest claim.

    The claims are: nothing is missing; these effects act, alone or with others; something outside the list
    is. Impossible designs are left out: a twin of the truth cannot be told from it.
    """
    given, true = [], []
    for case in (
        c for c in cases if c.kind not in ("impossible", "mechanism") and "probabilities" in c.answer
    ):
        probability = case.answer["probabilities"]
        top = max(probability, key=lambda name: probability[name])
        if top in (NONE, OUTSIDE):
            given.append(probability[top])
            true.append(case.kind == ("null" if top == NONE else "unlisted"))
        else:
            acting = set(top.split("+"))
            given.append(sum(p for names, p in probability.items() if acting <= set(names.split("+"))))
            true.append(acting <= case.acting)
    cell = np.minimum((np.array(given) * BINS).astype(int), BINS - 1)
    gaps = np.bincount(cell, np.array(given) - np.array(true, dtype=float))
    error = float(np.abs(gaps).sum()) / max(len(given), 1)
    return Metric("calibration error of the likeliest", error, nan, nan, len(given), "<= 0.05")


def vault_metrics(cases: Cases) -> Iterator[Metric]:
    """Held-out misfit with a right name and with a random wrong effect, over that of the bare model."""
    strong = [c for c in cases if c.ratio >= STRONG and (c.exact or c.truth.get("name") in c.mechanisms[:1])]
    known = [(c, *c.answer["vault"]) for c in strong if (c.answer.get("vault") or [None])[0] is not None]
    right = [after / before for c, before, after, _ in known if not c.mechanisms]
    yield median("held-out misfit after / before, right names", right, "<= 0.5")
    beyond = [after / before for c, before, after, _ in known if c.mechanisms]
    yield median("the same, right mechanism first", beyond, "<= 0.5")
    wrong = [(b, a, w) for c, b, a, w in known if w is not None and not c.mechanisms]
    yield median("the same, random wrong effect", [w / b for b, _, w in wrong], ">= 0.9")
    yield share("right name beats a random wrong effect", [a < w for _, a, w in wrong], ">= 0.85")


def disturbance_metrics(cases: Cases) -> Iterator[Metric]:
    """Errors of real laboratories, one by one."""
    for name in sorted({c.truth["disturbance"] for c in cases}):
        own = [c for c in cases if c.truth["disturbance"] == name]
        silent = [not c.told and not c.flagged for c in of_kind(own, "null")]
        yield share(f"{name}, nulls: silent", silent)
        seen = [c.held for c in of_kind(own, "single") if c.ratio >= IDENTIFIABLE]
        yield share(f"{name}, singles, ratio >= 4.5: named or in the group", seen)


def judged(case: Case) -> str:
    """One word on an answer: right, in the group, partly, silent, wrong, false alarm."""
    acting, outside = case.acting, case.truth["outside"]
    if not acting and not outside:
        return "false alarm" if case.told or case.flagged else "right"
    if outside and case.mechanisms:
        true = {f"{one}_friction" for one in ("sliding", "rolling") if one in outside}
        first = {*case.mechanisms}
        return "right" if first == true else "in the group" if first & true else "wrong"
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
    verdicts = [judged(case) for case in cases]
    for word in dict.fromkeys(("right", *verdicts)):
        yield share(word, [verdict == word for verdict in verdicts])
    yield ratio_metric(cases)


def published_metrics(cases: Cases) -> Iterator[Metric]:
    """What adopting did at the source that was left out of a series."""
    yield share("sources left out: answered", [c.answer["verdict"] != "refused" for c in cases])
    yield share("sources left out: something named", [bool(c.named) for c in cases])
    yield share("sources left out: not in the list", [c.flagged for c in cases])
    known = [c.answer["vault"] for c in cases if c.named and c.answer["vault"][0] is not None]
    yield share("named: error at the source falls", [vault[1] < vault[0] for vault in known])
    yield ratio_metric([c for c in cases if c.named])


def ratio_metric(cases: Cases) -> Metric:
    """Held-out misfit with what was adopted over that of the bare model."""
    vaults = [c.answer["vault"] for c in cases if c.answer["vault"][0] is not None]
    return median("held-out misfit after / before", [vault[1] / vault[0] for vault in vaults])


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
    """Shares of true means, of new measurements and of calibrated numbers that are held."""
    rows = np.array(case.answer["rows"])
    mean, single = np.array(case.truth["mean"]), np.array(case.truth["measured"])
    return {
        "mean": float(np.mean((rows[:, 0] <= mean) & (mean <= rows[:, 1]))),
        "measured": float(np.mean((rows[:, 2] <= single) & (single <= rows[:, 3]))),
        "numbers": float(np.mean(case.intervals("parameters"))),
    }


SHARED: dict[str, Callable[[Cases], Iterator[Metric]]] = {
    "intervals": coverage_metrics,
    "other_laws": laboratory_metrics,
    "lammps": laboratory_metrics,
    "lammps_beyond": laboratory_metrics,
    "published": published_metrics,
    "tables": table_metrics,
}
TRIALS = {name: reduced_metrics for name in ("reduced", "clean", "disturbed", "several", "beyond")} | SHARED


def groups_of(trial: str) -> dict[str, list[Case]]:
    """Cases of every set."""
    found: dict[str, list[Case]] = {}
    for row in read_rows(table_of(trial)):
        found.setdefault(row["set"], []).append(Case(row))
    return found


def scores(trial: str, sets: Sequence[str] = ()) -> Iterator[str]:
    """Tables of some sets of a trial, by default of all; lines without a case are left out."""
    for name, cases in groups_of(trial).items():
        if not sets or name in sets:
            methods = ", ".join(sorted({case.row["method"] for case in cases}))
            cells = [metric.cells() for metric in TRIALS[trial](cases) if metric.count]
            table = markdown_table(HEADER, cells)
            yield f"## {trial}, {name}: {len(cases)} cases by {methods}\n\n{table}\n"


def main(asked: Sequence[str]) -> None:
    """Print what was asked for."""
    sets = [name for name in asked if name not in TRIALS]
    for trial in [name for name in asked if name in TRIALS] or TRIALS:
        for text in scores(trial, sets):
            sys.stdout.write(f"{text}\n")


if __name__ == "__main__":
    main(words(__doc__))
