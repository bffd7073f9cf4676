"""Impossible values of a column of a table, and a unit that seems mistaken.

A column outside of the usual range that another unit would put inside has most likely the wrong unit.
"""

from collections.abc import Iterator
from math import isfinite, nan

from taichi_erosion.evidence.data.tables.rows import SOLO_ROWS, Row, Table
from taichi_erosion.scene.physical_ranges import PhysicalRange, likely_units, scale_of

NEAR_SCENE = 30.0  # factor about a scene's own number within which a column is taken as meant


def column_faults(
    table: Table, name: str, allowed: PhysicalRange | None, usual_value: float = nan, usual: bool = True
) -> Iterator[str]:
    """Impossible values of a condition or an observable, and a unit that seems mistaken, one line each.

    `usual_value` is the scene's number: a column near it is meant as it stands. `usual`: whether values
    that are possible but unusual are looked at. None is known of a place without a range.
    """
    if allowed is None:
        return
    cells = known_cells(table, name, allowed)
    wrong = [each for each in cells if not allowed.possible(each[3])]
    odd = [each for each in cells if not allowed.is_usual(each[3])]
    meanings = likely_units([value for _, value, _, _ in cells], cells[0][2] if cells else None, allowed)
    near_own = usual_value > 0.0 and all(
        usual_value / NEAR_SCENE <= used <= usual_value * NEAR_SCENE for *_, used in odd
    )
    if not wrong and usual and meanings and 2 * len(odd) > len(cells) and not near_own:
        wrong = odd
    hint = f": did you mean [{'] or ['.join(meanings)}]?" if meanings else ""
    for row, value, unit, used in wrong if len(wrong) <= SOLO_ROWS else wrong[:1]:
        stated = f"{value:g} {unit}" if unit else f"{value:g} (no unit: {allowed.unit})"
        span = f"outside [{allowed.low:g}, {allowed.high:g}]"
        outside = "which is unusual" if allowed.possible(used) else span
        more = f"; {len(wrong) - 1} rows more" if len(wrong) > SOLO_ROWS else ""
        also = f" is {used:g} {allowed.unit}" if unit not in (None, "", allowed.unit) else ""
        message = f"{name} = {stated}{also}, {outside}{more}; check number and unit{hint}"
        yield f"{table.file}: row {row.line}, {message}"


def known_cells(
    table: Table, name: str, allowed: PhysicalRange
) -> list[tuple[Row, float, str | None, float]]:
    """Rows of a condition or an observable with their values, as written and in the unit of a range."""
    if name in table.conditions:
        place = table.conditions.index(name)
        cells = [(row, row.conditions[place], table.units[place]) for row in table.rows]
    else:
        cells = [(row, row.value, row.unit) for row in table.rows if row.observable == name]
    scaled = [(row, value, unit, scale_of(unit, allowed)) for row, value, unit in cells if isfinite(value)]
    return [(row, value, unit, scale.to_use(value)) for row, value, unit, scale in scaled if scale]


def unusual_cells(table: Table, name: str, allowed: PhysicalRange | None) -> Iterator[str]:
    """Values that can be and are not usual, in words: they may be slips."""
    for row, value, unit, used in known_cells(table, name, allowed) if allowed else ():
        if allowed and not allowed.is_usual(used):
            yield f"row {row.line}, {name} = {value:g} {unit or ''} is unusual, and taken as written"
