"""Fills the tables of README.md from the tables of this and other studies.

python -m doe.drag_law.run
"""

from collections.abc import Iterator, Sequence
from math import isfinite
from pathlib import Path

import numpy as np

from doe.common.command import words
from doe.drag_law.claims import LAWS, Line, read_lines
from doe.drag_law.decide import NEITHER, Judged, becomes_default, judged
from doe.drag_law.loads import load_table, read_loads
from doe.drag_law.measures import NORMAL, measures
from doe.drag_law.tipping import read_tips, tip_table
from taichi_erosion.core.files import write_atomic
from taichi_erosion.report.markdown import fill_tables, markdown_table

PAGE = Path(__file__).with_name("README.md")
PERCENT = 100.0


def summary_table(found: Sequence[Judged]) -> str:
    """Every measure under both laws."""
    header = ["measure", *(f"figure, {law}" for law in LAWS), "difference", "speaks for"]
    header += [f"rows as asked for, {law}" for law in LAWS] + ["fails under"]
    rows = []
    for one in found:
        failing = [law for law in LAWS if one.fails(law)]
        cells = [one.measure.name, *(between(one.figure[law], one.intervals[law]) for law in LAWS)]
        cells += [between(one.difference[0], one.difference[1:]), one.speaks_for or NEITHER]
        cells += [f"{one.within(law)} of {one.known}" for law in LAWS]
        rows.append([*cells, " and ".join(failing) or NEITHER])
    return markdown_table(header, rows)


def between(value: float, ends: Sequence[float]) -> str:
    """A figure and its interval."""
    return f"{value:.3f} ({ends[0]:.3f} to {ends[1]:.3f})" if isfinite(value) else "not simulated"


def row_table(found: Sequence[Judged]) -> str:
    """Every row of every measure: how far the simulated number is off, with its interval."""
    rows = [cells for one in found for cells in row_cells(one)]
    return markdown_table(("measure", "row", *LAWS), rows)


def row_cells(one: Judged) -> Iterator[tuple[str, ...]]:
    """Rows of one measure."""
    for place, name in enumerate(one.measure.rows):
        yield (one.measure.name, name, *(off(one, law, place) for law in LAWS))


def off(one: Judged, law: str, place: int) -> str:
    """Simulated over wanted less one, and its interval, in percent."""
    misfit, reach = one.own[law][place], NORMAL * one.errors[law][place]
    if not isfinite(misfit):
        return ""
    middle, low, high = PERCENT * np.expm1([misfit, misfit - reach, misfit + reach])
    return f"{middle:+.0f} % ({low:+.0f} to {high:+.0f})"


def claim_table(lines: Sequence[Line]) -> str:
    """Claims of `./erosion verify` under the laws under which they were simulated here."""
    header = ("claim", "law", "what", "got", "asked for", "holds")
    rows = [
        (
            line.id,
            line.law,
            line.claim,
            f"{line.got:.4g}",
            f"{line.want:.4g} ± {line.tolerance:.3g}",
            line.passed,
        )
        for line in lines
    ]
    return markdown_table(header, rows) if rows else "Not simulated yet.\n"


def decision(found: Sequence[Judged]) -> str:
    """The answer of the rule."""
    changes, told = becomes_default(found)
    words = "becomes the default" if changes else "does not become the default"
    return f"`two_limits_hindered` {words}: {told}.\n"


def tables() -> dict[str, str]:
    """Tables of the page by name."""
    found = [judged(measure) for measure in measures()]
    return {
        "decision": decision(found),
        "measures": summary_table(found),
        "rows": row_table(found),
        "loads": load_table(read_loads()),
        "tipping": tip_table(read_tips()),
        "claims": claim_table(read_lines()),
    }


def main() -> None:
    """Fill the page."""
    write_atomic(PAGE, fill_tables(PAGE.read_text(encoding="utf-8"), tables()).encode())


if __name__ == "__main__":
    words(__doc__)
    main()
