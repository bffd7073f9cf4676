"""Sand under wind under the drag of grains among others; writes drag_laws.csv here.

python -m doe.wind.drag_laws           every case that has no rows yet
python -m doe.wind.drag_laws CASE...   some anew: flux/0.4123, impact/0.24, "forces/all forces", ...

The cases of `run.py` and `saturated.py` with `two_limits_hindered` in place of the `two_limits` of the scene,
with which flux.csv, saturated.csv and fluid.csv were simulated: the winds of Creyssels et al. (2009), four
winds over each sand, and the published soil with some forces and all. `all_forces` are some of the sands with
all forces of the fluid thresholds of ../fluid_threshold/, dry adhesion and gusts of 20 ms among them, in the
winds of the same sand without. `python -m doe.wind.run --page` then fills the tables of docs/threshold.md.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from doe.common.cases import Case, perform, read_rows, settings
from doe.common.command import words
from doe.wind.blown_sand import ALL_FORCES, BARE
from doe.wind.run import ADHESION, BEDS, DIAMETERS, FLUID, SALTATION, fluid_cases, flux_cases
from doe.wind.saturated import Blown
from doe.wind.saturated import cases as saturated_cases
from doe.wind.shares import FORCES, words_of
from tests.verification.reference.hopping import Sand

TABLE = Path(__file__).with_name("drag_laws.csv")
LAW = 'wind.drag="two_limits_hindered"'
SOIL = "forces"  # group of the published soil
WITH_FORCES = (0.24e-3,)  # m, sands that are also blown with all forces
ORDERS = (*(f"effects.{force}.strength=1" for force in FORCES), ADHESION)
SETS = (  # of forces beside drag
    *(tuple(one for one in FORCES if one != other) for other in FORCES),
    ("near_wall_drag",),
    ("near_wall_drag", "rotational_drag"),
)

Named = dict[str, tuple[str, list[Case]]]  # scene and cases of every name


def cases() -> Named:
    """All cases by the name with which they are asked for."""
    named: Named = {f"flux/{case.label}": (SALTATION, [hindered(case)]) for case in flux_cases()}
    for diameter in DIAMETERS:
        blown = Blown(BARE, Sand(diameter), (LAW,))
        named[blown.name] = (SALTATION, list(saturated_cases(blown)))
    for diameter in WITH_FORCES:
        blown = Blown(ALL_FORCES, Sand(diameter), (*ORDERS, LAW))
        named[blown.name] = (SALTATION, list(saturated_cases(blown)))
    soil = [case for case in fluid_cases() if case.group == SOIL] + list(share_cases())
    return named | {f"{SOIL}/{case.label}": (FLUID, [hindered(case)]) for case in soil}


def share_cases() -> Iterator[Case]:
    """The published soil with other sets of forces, as in `shares.py`."""
    for effects in SETS:
        orders = (f"effects.{effect}.strength=1" for effect in effects)
        yield Case(SOIL, words_of("+".join(effects)), settings(*orders), BEDS)


def hindered(case: Case) -> Case:
    """The case under the drag of grains among others."""
    return replace(case, order=case.order + settings(LAW))


def fresh(asked: Sequence[str]) -> Iterator[tuple[str, list[Case]]]:
    """Scene and cases of the names asked for; with none, of what has no rows yet."""
    done = {(row.group, row.label) for row in read_rows(TABLE)} if TABLE.exists() else set()
    for name, (scene, named) in cases().items():
        if not asked:
            yield scene, [case for case in named if (case.group, case.label) not in done]
        elif name in asked:
            yield scene, named


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for."""
    for scene, chosen in fresh(asked):
        perform(scene, chosen, TABLE)


if __name__ == "__main__":
    main(words(__doc__))
