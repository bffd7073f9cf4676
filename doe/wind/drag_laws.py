"""Blown sand under the drag of grains among others; writes drag_laws.csv here.

python -m doe.wind.drag_laws          every wind that has no rows yet
python -m doe.wind.drag_laws WIND...  some anew, by u* in m/s

The winds of Creyssels et al. (2009) as in `run.py`, with `two_limits_hindered` in place of the `two_limits`
of the scene, with which flux.csv was simulated. `python -m doe.wind.run --page` then fills the table of
docs/threshold.md.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from doe.common.cases import Case, perform, read_rows, settings
from doe.common.command import words
from doe.wind.run import SALTATION, flux_cases

TABLE = Path(__file__).with_name("drag_laws.csv")
LAW = 'wind.drag="two_limits_hindered"'
WINDS = ("0.4123", "0.6898", "0.2415", "0.3269", "0.5748", "0.4928")  # m s-1, middle and ends first


def cases() -> list[Case]:
    """All winds, in the order in which they are simulated."""
    plain = {case.label: case for case in flux_cases()}
    return [replace(plain[wind], order=plain[wind].order + settings(LAW)) for wind in WINDS]


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for."""
    done = {row.label for row in read_rows(TABLE)} if TABLE.exists() else set()
    perform(SALTATION, [c for c in cases() if (c.label in asked if asked else c.label not in done)], TABLE)


if __name__ == "__main__":
    main(words(__doc__))
