"""The record of an answer as a JSON document: plain tables, null for what is not known."""

from dataclasses import asdict
from math import nan
from typing import Any

from taichi_erosion.evidence.race.record import EffectPart, HeldOutPart, Interval, Record
from taichi_erosion.measures.result import without_nan


def document(record: Record) -> dict[str, Any]:
    """Keys of the contract; `chi2` is a total, and per row where the name says so."""
    decided, fit, cost, parts = record.decided, record.fit, record.cost, asdict(record)
    columns = parts["rows"] | {
        key: parts["rows"][key].tolist() for key in ("measured", "low", "high", "sd", "before", "after")
    }
    columns["conditions"] = {name: column.tolist() for name, column in record.rows.conditions.items()}
    found = {"where": parts["where"], "repeats": parts["repeats"], "rows": columns}
    found |= {key: parts["decided"][key] for key in ("verdict", "named", "group", "probabilities")}
    found |= {
        "p": decided.familywise,
        "effects": {name: effect(part) for name, part in record.effects.items()},
        "parameters": {path: each | each.pop("now") for path, each in parts["numbers"].items()},
        "levels": [each | each.pop("size") for each in parts["levels"]],
        "errors": [each | each.pop("size") for each in parts["errors"]],
        "n": fit.n,
        "chi2_before": fit.chi2_before,
        "chi2_after": fit.chi2_after,
        "chi2_per_row_before": fit.chi2_before / max(fit.n, 1),
        "chi2_per_row_after": fit.chi2_after / max(fit.n, 1),
        "p_misfit": fit.p_before,
        "p_misfit_after": fit.p_after,
        "p_lack_of_fit": fit.p_lack_of_fit,
        "vault": None if record.held_out is None else vault(record.held_out),
        "next_experiments": parts["experiments"],
        "mechanisms": mechanisms(record),
        "fresh_runs": parts["fresh"],
        "runs": cost.runs,
        "settings": cost.settings,
        "stopped": cost.stopped,
        "wall_s": cost.seconds,
        "seed": cost.seed,
    }
    return without_nan(found)


def effect(part: EffectPart) -> dict[str, Any]:
    """One candidate; an excluded one lies between 0 and what 95 % lie below."""
    told = Interval(nan, 0.0, part.limit) if part.status == "excluded" else part.strength
    return asdict(part) | {"strength": told.value, "strength_low": told.low, "strength_high": told.high}


def vault(held: HeldOutPart) -> dict[str, Any]:
    """Errors of the held-out rows: totals, and per row."""
    found = {key: getattr(held, key) for key in ("opened", "n", "p_after", "adopted", "wrong_effect")}
    for key, value in (("before", held.before), ("after", held.after), ("wrong_effect", held.wrong)):
        found |= {f"chi2_{key}": held.n * value, f"chi2_per_row_{key}": value}
    return found


def mechanisms(record: Record) -> dict[str, Any]:
    """Mechanisms, and what has a law, by name: probability, doses, law."""
    names = (*record.decided.mechanisms, *([record.law.mechanism] if record.law else []))
    shares = record.decided.probabilities
    found: dict[str, Any] = {n: {"probability": shares.get(n, 0.0), "doses": [], "law": None} for n in names}
    if record.law is not None:
        law, powers = asdict(record.law), record.law.exponents.items()
        doses = [{"conditions": at, "dose": dose["value"], **dose} for at, dose in law.pop("doses")]
        ends = {"exponents": "value", "low": "low", "high": "high"}
        law |= {key: {name: getattr(power, end) for name, power in powers} for key, end in ends.items()}
        found[record.law.mechanism] |= {"doses": doses, "law": law}
    return found
