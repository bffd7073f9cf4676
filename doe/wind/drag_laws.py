"""Blown sand under the drag of grains among others; writes drag_laws.csv here.

python -m doe.wind.drag_laws          every wind that has no rows yet
python -m doe.wind.drag_laws WIND...  some anew, by u* in m/s

The winds of Creyssels et al. (2009) as in `run.py` and those over 0.5 mm of `saturated.py`, both with
`two_limits_hindered` in place of the `two_limits` of the scene, with which flux.csv and saturated.csv were
simulated. `python -m doe.wind.run --page` then fills the table of
docs/threshold.md.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from doe.common.cases import Case, perform, read_rows, settings
from doe.common.command import words
from doe.wind.blown_sand import BARE
from doe.wind.run import SALTATION, flux_cases
from doe.wind.saturated import Blown
from doe.wind.saturated import cases as saturated_cases
from taichi_erosion.verification.reference.hopping import Sand

TABLE = Path(__file__).with_name("drag_laws.csv")
LAW = 'wind.drag="two_limits_hindered"'
WINDS = ("0.4123", "0.6898", "0.2415", "0.3269", "0.5748", "0.4928")  # m s-1, middle and ends first
COARSE = 0.5e-3  # m


def cases() -> list[Case]:
    """All winds, in the order in which they are simulated."""
    plain = {case.label: case for case in flux_cases()}
    flux = [replace(plain[wind], order=plain[wind].order + settings(LAW)) for wind in WINDS]
    return [*flux, *saturated_cases(Blown(BARE, Sand(COARSE), (LAW,)))]


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for."""
    done = {row.label for row in read_rows(TABLE)} if TABLE.exists() else set()
    labels = {case.label: case.label.rpartition(" ")[2] for case in cases()}
    fresh = [c for c in cases() if (labels[c.label] in asked if asked else c.label not in done)]
    perform(SALTATION, fresh, TABLE)


if __name__ == "__main__":
    main(words(__doc__))
