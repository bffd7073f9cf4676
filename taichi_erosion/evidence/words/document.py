"""The record of an answer as a JSON document: plain tables, null for what is not known."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from typing import Any

import numpy as np

from taichi_erosion.evidence.race.record import EffectPart, HeldOutPart, Record

Document = dict[str, Any]


def document(record: Record) -> Document:
    """Keys of the contract; `chi2` is a total, and per row where the name says so."""
    decided, fit, cost, parts = record.decided, record.fit, record.cost, asdict(record)
    chi2 = {"before": fit.chi2_before, "after": fit.chi2_after}
    found = {key: parts[key] for key in ("where", "repeats", "rows")}
    found |= {key: parts["decided"][key] for key in ("verdict", "named", "group", "probabilities")}
    found |= {
        "p": decided.familywise,
        "effects": {name: effect(part) for name, part in record.effects.items()},
        "parameters": {path: each | each.pop("now") for path, each in parts["numbers"].items()},
        "levels": [each | each.pop("size") for each in parts["levels"]],
        "errors": [each | each.pop("size") for each in parts["errors"]],
        "n": fit.n,
        **{f"chi2_{key}": value for key, value in chi2.items()},
        **{f"chi2_per_row_{key}": value / max(fit.n, 1) for key, value in chi2.items()},
        "p_misfit": fit.p_before,
        "p_misfit_after": fit.p_after,
        "p_lack_of_fit": fit.p_lack_of_fit,
        "vault": None if record.held_out is None else vault(record.held_out),
        "next_experiments": parts["experiments"],
        "mechanisms": mechanisms(record, parts["law"]),
        "runs": cost.runs,
        "settings": cost.settings,
        "stopped": cost.stopped,
        "wall_s": cost.seconds,
        "seed": cost.seed,
    }
    return plain_value(found)


def effect(part: EffectPart) -> Document:
    """One candidate; the upper end of an excluded strength is what 95 % lie below."""
    found, strength = asdict(part), part.strength
    high = part.limit if part.status == "excluded" else strength.high
    return found | {"strength": strength.value, "strength_low": strength.low, "strength_high": high}


def vault(held: HeldOutPart) -> Document:
    """Errors of the held-out rows: totals, and per row."""
    found = {key: getattr(held, key) for key in ("opened", "n", "p_after", "adopted")}
    for key, value in {"before": held.before, "after": held.after, "wrong_effect": held.wrong}.items():
        found |= {f"chi2_{key}": held.n * value, f"chi2_per_row_{key}": value}
    return found


def mechanisms(record: Record, law: Document | None) -> Document:
    """Mechanisms of which one acts, best first; the one with a law has its doses and that law."""
    found: Document = {
        name: {"probability": record.decided.probabilities.get(name, 0.0), "doses": [], "law": None}
        for name in record.decided.mechanisms
    }
    if law is not None:
        doses = [{"conditions": at, "dose": dose["value"]} | dose for at, dose in law["doses"]]
        powers = law["exponents"].items()
        ends = {end: {name: power[end] for name, power in powers} for end in ("low", "high")}
        law |= {"exponents": {name: power["value"] for name, power in powers}} | ends
        own = {key: law[key] for key in law if key not in ("mechanism", "doses", "template", "sizes")}
        found[law["mechanism"]] = (
            {"probability": 0.0} | found.get(law["mechanism"], {}) | {"doses": doses, "law": own}
        )
    return found


def plain_value(value: Any) -> Any:
    """A nested value with lists for arrays and tuples, None for numbers that are not finite."""
    if isinstance(value, np.ndarray | np.generic):
        return plain_value(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain_value(entry) for key, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain_value(entry) for entry in value]
    return None if isinstance(value, float) and not isfinite(value) else value
