"""The basis of mechanisms: `table.toml` says what each acts on, `factors.py` and `forces.py` how.

A mechanism is an effect whose first parameter is its dose: a dimensionless number, 0 where it does nothing,
on the scale that its row states. Strength multiplies the dose. A mechanism is no candidate of a discovery
and stands in no list of effects; it is asked for by name.
"""

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import fields, make_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Effect, quantity
from taichi_erosion.core.effect_file import MEMBER, EffectFile
from taichi_erosion.scene import Scene
from taichi_erosion.scene.physical_ranges import range_at

TABLE = Path(__file__).with_name("table.toml")
DOSE = "dose"  # parameter of every mechanism
OF_WIND = ("bed_stress", "drag", "gustiness", "lift")  # that act through wind alone


@cache
def mechanism_rows() -> dict[str, dict[str, Any]]:
    """Rows of the table by the name of the mechanism; of contacts, one on each other and one on walls."""
    rows: dict[str, dict[str, Any]] = {}
    for name, row in tomllib.loads(TABLE.read_text(encoding="utf-8")).items():
        rows[name] = row | {"walls": False}
        if "walls" in row:
            rows[f"wall_{name}"] = row | {"walls": True, "title": f"{row['title']} on walls"}
    return dict(sorted(rows.items()))


@cache
def load_mechanisms() -> dict[str, Effect]:
    """All mechanisms by name, with their device functions: it imports the compiler."""
    return {name: mechanism_of_row(name, row) for name, row in mechanism_rows().items()}


def mechanism_of_row(name: str, row: Mapping[str, Any]) -> Effect:
    from taichi_erosion.mechanisms.factors import FACTORS, PARTNERS
    from taichi_erosion.mechanisms.forces import FORCES

    numbers = {DOSE: row[DOSE], **row.get("numbers", {})}
    declared = [
        (key, float, quantity(default, unit, meaning, low=low, high=high))
        for key, (default, unit, low, high, meaning) in numbers.items()
    ]
    params = make_dataclass("Params", declared, frozen=True)
    act, checks, more = (FACTORS | FORCES)[name]
    text = row["help"].format(partner=PARTNERS[row["walls"]])
    return Effect(name, row["title"], text, row["place"], params, act, partial(checks, params), **more)


def mechanism_file(name: str) -> EffectFile:
    """Effect file of a mechanism, which a run names as it names any effect file."""
    text = f"from {__name__} import load_mechanisms\n\n{MEMBER} = load_mechanisms()[{name!r}]\n"
    return EffectFile(TABLE.with_name(f"{name}.py"), text)


def dose_position(dose: Any) -> Any:
    """Place of a dose on a scale on which its range is even: sign(D) ln(1 + |D|) [1]."""
    return np.sign(dose) * np.log1p(np.abs(dose))


def dose_range(mechanism: Effect) -> tuple[float, float]:
    """Least and largest dose for which a mechanism is meant [1]."""
    declared = next(f for f in fields(mechanism.params) if f.name == DOSE).metadata
    return declared["low"], declared["high"]


def physical_doses(mechanism: Effect, scenes: Iterable[Scene]) -> tuple[float, float]:
    """Doses for which a mechanism is meant, and with which no number that it is a factor of is unusual."""
    low, high = dose_range(mechanism)
    for bare in scenes if mechanism.place == "scene" else ():
        halved = mechanism.act(mechanism.params(dose=-0.5), 1.0, {}, bare)
        for place in ("contact", "materials"):
            for name, entries in getattr(bare, place).items():
                half = getattr(halved, place)[name]
                for entry, value in entries:
                    allowed = range_at(f"{place}.{name}.{entry}")
                    if allowed is not None and value and getattr(half, entry) == 0.5 * value:
                        least, most = allowed.usual or (allowed.low, allowed.high)
                        low, high = max(low, least / value - 1.0), min(high, most / value - 1.0)
    return min(low, 0.0), max(high, 0.0)
