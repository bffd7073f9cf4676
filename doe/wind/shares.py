"""What each force takes off the fluid threshold, by switching it off; and what other criteria make of it.

python -m doe.wind.shares            all cases; writes shares.csv beside this file, bed by bed
python -m doe.wind.shares CASE...    some of them

`python -m doe.wind.run --page` then fills the tables of README.md.
All cases have the same five beds of `scenes/wind_threshold.toml`, so that the ratio of two cases is taken bed
by bed. A case is named by its effects, joined by +; `none` has none of them.
"""

from collections.abc import Sequence
from functools import cache
from itertools import combinations
from pathlib import Path

from doe.common.beds import Bed, found_in, paired_ratio, pooled, read_beds, shown, simulate, write_beds
from doe.common.cases import DRAG_ALONE, ROOT, Case, settings
from doe.common.command import words
from doe.wind.extremes import Watch, criterion_threshold
from taichi_erosion.measures.threshold import Bracket
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.scene import Scene, load_scene
from taichi_erosion.scene.preparation.sizes import nominal_diameter

SCENE = "scenes/wind_threshold.toml"
TABLE = Path(__file__).with_name("shares.csv")
FORCES = {
    "near_wall_drag": "drag near the wall",
    "rotational_drag": "torque of the shear",
    "shear_lift": "lift",
    "turbulent_gusts": "gusts",
}
NONE = "none"
BEDS = 5
SHORTER = 0.1  # s: a third of the hold of the scene, against which the extrapolation is checked
MEMORY = 0.02  # s, correlation time of gusts: attempts of a grain are as many
FLOOR = 1.0  # m2
SEVERAL = (  # criteria: words, share of the surface grains or one grain, area [m2], time [s]
    ("one percent of the surface grains in 5 s", 0.01, FLOOR, 5.0),
    ("a tenth of the surface grains in 5 s", 0.1, FLOOR, 5.0),
    ("the first grain of 1 m2 in a minute", 0.0, FLOOR, 60.0),
)


def names() -> list[str]:
    """All forces, all but one, one alone, none; and drag and torque of a grain at rest."""
    forces = list(FORCES)
    sizes = (len(forces), len(forces) - 1, 1)
    chosen = [each for size in sizes for each in combinations(forces, size)]
    return ["+".join(each) for each in [*chosen, tuple(forces[:2])]] + [NONE]


def case_of(name: str, hold: float) -> Case:
    """Orders of a case."""
    effects = [] if name == NONE else name.split("+")
    orders = [f"effects.{effect}.strength=1" for effect in effects]
    return Case("shares", name, settings(DRAG_ALONE, *orders, *other_hold(hold)), BEDS)


def other_hold(hold: float) -> tuple[str, ...]:
    """Order of a hold that is not the scene's [s]."""
    return () if hold == scene().threshold.hold else (f"threshold.hold={hold:g}",)


@cache
def scene() -> Scene:
    """The scene of all cases."""
    return load_scene(ROOT / SCENE)


def brackets(beds: Sequence[Bed], case: str, hold: float) -> dict[int, Bracket]:
    """Brackets of a case by seed."""
    return found_in([bed for bed in beds if bed.hold == hold]).get(case, {})


def share_table(beds: Sequence[Bed], hold: float) -> str:
    """Threshold of every case, and what switching its missing force on takes off."""
    whole = brackets(beds, names()[0], hold)
    over = "over that with all forces, bed by bed"
    header = ("forces beside drag", "beds", "fluid threshold u* [m/s]", over)
    rows = []
    for name in names():
        found = brackets(beds, name, hold)
        if not found:
            continue
        ratio, factor, count = paired_ratio(found, whole)
        cell = "1" if found == whole else f"{ratio:.2f} ({ratio / factor:.2f} to {ratio * factor:.2f})"
        rows.append((words_of(name), str(count), shown(pooled(found)), cell))
    return markdown_table(header, rows)


def words_of(name: str) -> str:
    """Forces of a case in words."""
    effects = [] if name == NONE else name.split("+")
    missing = [label for effect, label in FORCES.items() if effect not in effects]
    if not missing:
        return "all"
    if len(missing) == 1:
        return f"all but {missing[0]}"
    return " and ".join(FORCES[effect] for effect in effects) or "none"


def criteria_table(beds: Sequence[Bed], hold: float) -> str:
    """The threshold with all forces by other criteria, under both laws; a shorter hold simulated too."""
    found = list(brackets(beds, names()[0], hold).values())
    patch = patch_watch(hold)
    asked = [("two grains of the patch in 0.3 s, as in the scene", patch)]
    for label, share, area, time in SEVERAL:
        asked.append((label, Watch(area, time, max(1, round(share * area / diameter() ** 2)))))
    shorter = Watch(patch.area, SHORTER, patch.count)
    asked.append((f"two grains of the patch in {SHORTER:g} s", shorter))
    simulated = list(brackets(beds, names()[0], SHORTER).values())
    header = ("criterion", "Weibull's law: u* [m/s]", "log-normal law: u* [m/s]", "simulated: u* [m/s]")
    rows = []
    attempts = 1.0 / (diameter() ** 2 * MEMORY)  # of a surface grain, one a gust [m-2 s-1]
    for label, watch in asked:
        laws = [criterion_threshold(label, found, patch, watch, n) for n in (None, attempts)]
        direct = {patch: found, shorter: simulated}.get(watch, [])
        rows.append((label, *map(shown, laws), shown(pooled(dict(enumerate(direct)))) if direct else ""))
    return markdown_table(header, rows)


def patch_watch(hold: float) -> Watch:
    """Criterion of the scene's trials."""
    setting, wind = scene().threshold, scene().wind
    assert wind is not None
    area = wind.length * wind.width
    return Watch(area, hold, max(1, round(setting.share * area / diameter() ** 2 + 0.5)))


def diameter() -> float:
    """Nominal diameter of the grains [m]."""
    return nominal_diameter(scene().grains.size)


def tables() -> dict[str, str]:
    """Tables of README.md by name, from shares.csv."""
    beds, hold = read_beds(TABLE), scene().threshold.hold
    return {"shares": share_table(beds, hold), "criteria": criteria_table(beds, hold)}


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for."""
    asked_for = [(name, scene().threshold.hold) for name in asked or names()]
    if not asked or names()[0] in asked:
        asked_for.append((names()[0], SHORTER))
    for name, hold in asked_for:
        write_beds(TABLE, simulate(SCENE, case_of(name, hold)), names())


if __name__ == "__main__":
    main(words(__doc__))
