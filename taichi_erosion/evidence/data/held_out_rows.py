"""The vault: measurements held out until an effect is adopted, and the count of its openings.

The split follows from the table alone: units of hold-out are drawn in the order of a digest of their
content, so that neither the order of rows nor a second try moves it. A table that is corrected later keeps
the digest from which its rows were drawn (`drawn_from`): the rows of that draw stay what they were, and what
came later, such as measurements that were proposed, is fitted, unless its unit is held out or nothing was.
"""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.comparison_rows import condition_groups
from taichi_erosion.evidence.data.problem import Bools, Floats, Integers, Measurements
from taichi_erosion.evidence.data.tables.rows import row_sources
from taichi_erosion.tables.number_words import count_noun

FEWEST_GROUPS = 5  # per observable; with fewer, holding out a whole one would leave too little to fit
SPARE = 3  # rows beyond the calibrated numbers: for an effect, a level, and one that can contradict
FEWEST_UNITS = 4  # of an observable; with fewer nothing of it is held out
DIGITS = 9  # of a number in the digest, the same after a change of units
COUNTER = "vault.json"

Unit = tuple[str, ...]  # what identifies a unit of hold-out


def draw_vault(
    measurements: Measurements,
    fraction: float,
    ranges: Mapping[str, Sequence[float]],
    drawn_from: str | None = None,
    sources: Sequence[str] = (),
    least: int = 0,
) -> tuple[Integers, str]:
    """Rows of the vault, and a sentence about their choice. Raises BadInput.

    `drawn_from` is the digest of the table from which rows were drawn first; None: of this table. As many
    rows under different conditions stay visible as `least` says.
    """
    inside = rows_in_named_ranges(measurements, ranges, sources)
    counts = count_units(measurements, measurements.group, ~inside)
    by_group = bool(counts) and min(counts.values()) >= FEWEST_GROUPS
    numbers = [[f"{x:.{DIGITS}g}" for x in column] for column in measurements.conditions.values()]
    cells = [*zip(*numbers, strict=True)] if numbers else [()] * measurements.size
    units: list[Unit] = [(group,) for group in measurements.group] if by_group else cells
    digest = table_digest(measurements)
    earlier = drawn_from not in (None, digest) and fraction > 0.0
    visible, settled = earlier_vault(measurements, units) if earlier else (np.zeros_like(inside), frozenset())
    order = [unit for unit in dict.fromkeys(units) if unit not in settled and not visible.any()]
    order.sort(key=lambda unit: sha256(f"{drawn_from or digest}|{unit}".encode()).hexdigest())
    ends = units_at_ends(measurements, units, ~inside)
    order.sort(key=lambda unit: unit in ends)  # those come last
    vault_units = draw_vault_units(measurements, order, units, ~inside, visible, fraction, least)
    among = np.array([unit in vault_units for unit in units], dtype=np.bool_) & ~inside
    hidden = inside | visible | among
    if hidden.all():
        raise BadInput("vault: fraction, ranges and sources hold out every row; leave some to fit")
    pool = {units[i] for i in np.flatnonzero((visible | among) & ~inside).tolist()}
    condition_text = measurements.table_units.condition_text
    spans = {name: " to ".join(condition_text(name, end) for end in ends) for name, ends in ranges.items()}
    named = "".join(f", and {name} from {span}" for name, span in spans.items())
    named += "".join(f", and all rows of {name}" for name in sources)
    if earlier:
        named += "; earlier rows stay what they were, new ones are fitted but under held-out conditions"
    return np.flatnonzero(hidden), split_sentence(len(pool), by_group, named, int(hidden.sum()), len(units))


def earlier_vault(measurements: Measurements, units: Sequence[Unit]) -> tuple[Bools, frozenset[Unit]]:
    """Rows that stay held out, with those new to their units, and the units that were drawn before."""
    pairs = list(zip(units, measurements.drawn or ("",) * measurements.size, strict=True))
    hidden = {unit for unit, was in pairs if was == "held out"}
    stays = [was == "held out" or (not was and unit in hidden) for unit, was in pairs]
    return np.array(stays, dtype=np.bool_), frozenset(unit for unit, was in pairs if was)


def rows_in_named_ranges(
    measurements: Measurements, ranges: Mapping[str, Sequence[float]], sources: Sequence[str]
) -> Bools:
    """Rows whose condition lies in a named range, and those of a named source. Raises BadInput."""
    made_by = row_sources(measurements.source)
    distinct = tuple(dict.fromkeys(made_by))
    if missing := [name for name in sources if name not in distinct]:
        raise BadInput(f"vault.sources: '{missing[0]}' is not one of {', '.join(distinct)}")
    inside = np.array([name in sources for name in made_by], dtype=np.bool_)
    for name, (low, high) in ranges.items():
        column = measurements.conditions[name]
        inside |= (column >= low) & (column <= high)
    return inside


def count_units(measurements: Measurements, units: Sequence[Unit | str], rows: Bools) -> Counter[str]:
    """Number of units in which each observable was measured, among some rows."""
    pairs = {(measurements.observable[i], units[i]) for i in np.flatnonzero(rows).tolist()}
    return Counter(observable for observable, _ in pairs)


def draw_vault_units(
    measurements: Measurements,
    order: Sequence[Unit],
    units: Sequence[Unit],
    free: Bools,
    visible: Bools,
    fraction: float,
    least: int,
) -> set[Unit]:
    """Units for the vault, in an order: of every observable its fraction, as nearly as whole units allow.

    `units` are of all rows: those are `free` that no range or source holds out, `visible` those that an
    earlier version of the table held out.

    A unit stays visible without which a condition would no longer vary among the visible rows, or from 0:
    only dry heaps separate the effect of water from effects that always act. So does one without which three
    levels of a condition would be one under either of two others, such as water on grains of two sizes; or
    where fewer than `least` sets of conditions would.
    """
    cells = condition_groups(measurements)
    observables_of: dict[Unit, set[str]] = {}
    for i in np.flatnonzero(free).tolist():
        observables_of.setdefault(units[i], set()).add(measurements.observable[i])
    numbers = {unit: k for k, unit in enumerate(dict.fromkeys(units))}
    unit_of_row = np.array([numbers[unit] for unit in units])
    remaining = free & ~visible
    before, crossings = varying_pairs(measurements, remaining), crossed_levels(measurements, remaining, 3)
    among, vault_counts = (count_units(measurements, units, rows) for rows in (free, free & visible))
    quota = {name: round(fraction * n) if n >= FEWEST_UNITS else 0 for name, n in among.items()}
    vault_units: set[Unit] = set()
    for unit in (each for each in order if each in observables_of):
        without = remaining & (unit_of_row != numbers[unit])
        enough = distinct_row_count(measurements, cells, without) >= least
        enough = enough and varying_pairs(measurements, without) == before
        identified = enough and crossings <= crossed_levels(measurements, without, 2)
        if identified and all(vault_counts[name] < quota[name] for name in observables_of[unit]):
            vault_units.add(unit)
            remaining = without
            vault_counts.update(observables_of[unit])
    return vault_units


def distinct_row_count(measurements: Measurements, cells: Floats, rows: Bools) -> int:
    """Rows under different conditions; one less for each soil but the first, which has numbers of its own."""
    chosen = np.flatnonzero(rows).tolist()
    sets = {(measurements.observable[i], measurements.group[i], cells[i]) for i in chosen}
    of_group = Counter(group for group, _ in {each[1:] for each in sets})
    soils = sum(count > 1 for count in of_group.values())
    return min(len({(name, cell) for name, _, cell in sets}), len(sets) - max(soils - 1, 0))


def condition_columns_of(
    measurements: Measurements, rows: Bools
) -> Iterator[tuple[str, Bools, str, Floats, Floats]]:
    """Observable, its rows, a condition, its column and its values: each pair of them, among some rows."""
    named = np.array(measurements.observable)
    for observable in dict.fromkeys(measurements.observable):
        values = rows & (named == observable)
        for name, column in measurements.conditions.items():
            yield observable, values, name, column, np.unique(column[values & np.isfinite(column)])


def units_at_ends(measurements: Measurements, units: Sequence[Unit], rows: Bools) -> set[Unit]:
    """Units that alone hold the least or the largest value of a condition, where an effect is largest."""
    alone: set[Unit] = set()
    for _, mask, _, column, levels in condition_columns_of(measurements, rows):
        for end in (levels[0], levels[-1]) if levels.size > 1 else ():
            at_end = {units[i] for i in np.flatnonzero(mask & (column == end)).tolist()}
            alone |= at_end if len(at_end) == 1 else set()
    return alone


def varying_pairs(measurements: Measurements, rows: Bools) -> set[tuple[str, str]]:
    """Observables with the conditions that vary among some of their rows, and with those that begin at 0."""
    columns = condition_columns_of(measurements, rows)
    vary = [(observable, name, levels[0]) for observable, _, name, _, levels in columns if levels.size > 1]
    return {each[:2] for each in vary} | {(o, f"{name} from 0") for o, name, least in vary if least == 0.0}


def crossed_levels(measurements: Measurements, rows: Bools, least: int) -> set[tuple[str, str, float, str]]:
    """Observable, condition of two levels, one level, and a condition of at least so many values under it."""
    crossings: set[tuple[str, str, float, str]] = set()
    for observable, mask, name, column, levels in condition_columns_of(measurements, np.ones_like(rows)):
        for level in levels if levels.size == 2 else ():
            under = mask & rows & (column == level)
            for other, values in measurements.conditions.items():
                if np.unique(values[under & np.isfinite(values)]).size >= least:
                    crossings.add((observable, name, float(level), other))
    return crossings


def table_digest(measurements: Measurements) -> str:
    """Digest of a table, whatever the order of its rows and columns."""
    columns, lines = sorted(measurements.conditions.items()), []
    for i, value in enumerate(measurements.value):
        numbers = *(f"{name}={column[i]:.{DIGITS}g}" for name, column in columns), f"{value:.{DIGITS}g}"
        lines.append("|".join((measurements.observable[i], measurements.group[i], *numbers)))
    return sha256("\n".join(sorted(lines)).encode()).hexdigest()


def split_sentence(count: int, by_group: bool, named: str, rows: int, among: int) -> str:
    few = " of conditions (there are too few groups to hold them out whole)"
    kind = count_noun(count, "group") if by_group else f"{count_noun(count, 'set')}{few}"
    if not rows:
        return "Nothing is held out: there are too few conditions. No error on unseen data can be shown."
    words = f"{kind}{named}" if count or not named else named.removeprefix(", and ")
    return f"{rows} of {among} rows are held out: {words}."


def vault_openings(folder: Path, digest: str) -> int:
    """How often the vault has been opened whose rows were drawn from the table of this digest."""
    return len(read_openings(folder / COUNTER).get(digest, []))


def count_opening(folder: Path, digest: str, effect: str) -> int:
    """Count one more opening of the vault; returns how many there have been."""
    counter = read_openings(folder / COUNTER)
    counter.setdefault(digest, []).append(effect)
    write_atomic(folder / COUNTER, (json.dumps(counter, indent=1) + "\n").encode())
    return len(counter[digest])


def read_openings(file: Path) -> dict[str, list[str]]:
    """For every table the effects for which its vault was opened."""
    if not file.exists():
        return {}
    try:
        counter = json.loads(file.read_text(encoding="utf-8"))
        return {str(digest): [str(effect) for effect in effects] for digest, effects in counter.items()}
    except (ValueError, AttributeError, TypeError, OSError):
        raise BadInput(f"{file}: is damaged; it counts the openings of the vault") from None
