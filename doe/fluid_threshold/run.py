"""The wind that starts beds of sand of five diameters, under drag alone and with forces on a grain at rest.

python -m doe.fluid_threshold.run            every case that has no beds yet; writes beds.csv
python -m doe.fluid_threshold.run CASE...    some anew: hindered/0.25, forces/0.25, bare/0.25, ...
python -m doe.fluid_threshold.run --page     only the table of README.md and the figure, from beds.csv

`scenes/wind_threshold.toml` with nearly uniform quartz instead of the published soil: sizes, stiffness and
patch in diameters, the time until grains sleep with the root of the diameter. `forces` are drag near the
wall, torque of the shear, lift, gusts and dry adhesion, with the pull of a whole grain in every contact;
`hindered` has these and the law of drag for grains among others, `two_limits_hindered`; `whole` has this law
and adhesion at its published size, which the contacts of a grain share; `longer` has that and 1.5 s in which
a bed may start in place of 0.3 s; `wall` has that and gusts as short as near a wall, `wall_slow` three times
as long; `wall_alone` is `wall` by the drag of a grain alone; `bare` has drag alone. All cases have the same
seeds.
"""

from collections.abc import Sequence

from doe.common.beds import read_beds, simulate, write_beds
from doe.common.command import words
from doe.fluid_threshold.cases import SCENE, TABLE, case_of, names
from doe.fluid_threshold.page import publish


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for, then fill the page."""
    if list(asked) != ["--page"]:
        done = {bed.case for bed in read_beds(TABLE)}
        for name in asked or [name for name in names() if name not in done]:
            write_beds(TABLE, simulate(SCENE, case_of(name)), names())
    publish()


if __name__ == "__main__":
    main(words(__doc__))
