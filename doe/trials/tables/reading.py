"""Whether a table was read as it is meant: values, limits, scatter, conditions and repeats, set by set.

Both sides are brought to one form: under every set of conditions the mean, the standard deviation of single
repeats and their number, whether the table has repeats or their mean.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import isclose, isnan, nan, sqrt
from typing import Any

from doe.trials.tables.words import QUANTITIES

VALUE_NEAR, SD_NEAR, UNIT_FACTOR = 2e-4, 5e-3, 0.05  # relative; of a wrong unit at least
Row = Mapping[str, Any]
Summary = tuple[float, float, int, int]  # mean, sd, repeats, values below the limit
Sets = dict[tuple[str, ...], dict[str, list[Row]]]  # by observable and conditions, then by soil or set-up


def misread(truth: Mapping[str, Any], tidy: Sequence[Row]) -> list[str]:
    """What was misread: observable, condition, repeat, value, unit, limit, sd; nothing where all is right."""
    meant, read = (sets(rows, truth["conditions"]) for rows in (truth["readings"], tidy))
    if meant.keys() != read.keys():
        same = {place[0] for place in meant} == {place[0] for place in read}
        return ["condition" if same else "observable"]
    found, ratios = list[str](), list[float]()
    for place, soils in meant.items():
        if len(soils) != len(read[place]):
            found.append("repeat")
            continue
        parts = (sorted(map(summary, each.values()), key=str) for each in (soils, read[place]))
        for one, other in zip(*parts, strict=True):
            found += differences(one, other)
            ratios += [other[0] / one[0]] * (one[0] > 0.0 and other[0] > 0.0)
    unit = ratios and not isclose(ratios[0], 1.0, rel_tol=UNIT_FACTOR)
    if unit and all(isclose(ratio, ratios[0], rel_tol=0.01) for ratio in ratios):
        found = ["unit", *(kind for kind in found if kind not in ("value", "sd"))]
    return list(dict.fromkeys(found))


def sets(rows: Iterable[Row], names: Sequence[str]) -> Sets:
    """Rows by their place; a condition counts to five digits, and `nan` where none is known."""
    found: Sets = {}
    for row in rows:
        at = (f"{row['at'].get(name, nan) + 0.0:.5g}" for name in names)
        label = row["soil"] if "soil" in row else row["set_up"]
        found.setdefault((row["observable"], *at), {}).setdefault(label, []).append(row)
    return found


def summary(rows: Sequence[Row]) -> Summary:
    """Mean, standard deviation of single repeats, repeats, and those below the limit, or 0."""
    below = [row["below"] if "below" in row else row["kind"] != "exact" for row in rows]
    exact = [row for row, own in zip(rows, below, strict=True) if not own and row["value"]]
    lost = len(rows) - len(exact)
    if len(exact) == 1 and exact[0]["sd"] is not None:
        return exact[0]["value"], exact[0]["sd"], exact[0]["n"] or 1, lost
    counts = [row["n"] or 1 for row in exact]
    total = sum(counts)
    mean = sum(n * row["value"] for n, row in zip(counts, exact, strict=True)) / total if total else nan
    squares = 0.0
    for n, row in zip(counts, exact, strict=True):
        own = nan if row["sd"] is None and n > 1 else row["sd"] or 0.0
        squares += (n - 1) * own**2 + n * (row["value"] - mean) ** 2
    return mean, sqrt(squares / (total - 1)) if total > 1 else nan, total, lost


def differences(meant: Summary, read: Summary) -> list[str]:
    """Kinds in which two summaries differ; a number that is none agrees with none."""

    def near(k: int, relative: float) -> bool:
        both = isnan(meant[k]) and isnan(read[k])
        return both or isclose(meant[k], read[k], rel_tol=relative, abs_tol=1e-9)

    value, sd = ["value"] * (not near(0, VALUE_NEAR)), not near(1, SD_NEAR) or meant[2] != read[2]
    return value + ["sd"] * sd + ["limit"] * (meant[3] != read[3])


def is_told(kind: str, truth: Mapping[str, Any], assumed: Sequence[str]) -> bool:
    """Whether what was misread stands among what was assumed: a unit, or a column that is not used."""
    style, sign = truth["style"], "unit" if kind == "unit" else "not used"
    names = truth["observables" if kind in ("unit", "observable") else "conditions"]
    texts = [style["names"].get(name, name) for name in names] + [QUANTITIES[n]["plain"] for n in names]
    texts = [style["soil"]] if kind == "repeat" else texts
    return any(text and text in words and sign in words for text in texts for words in assumed)
