"""Records of answers, as varied as they come, made by hand: of heaps and thresholds of a soil."""

from dataclasses import replace
from math import nan

import numpy as np

from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.race import record
from taichi_erosion.evidence.race.record import (
    DecisionPart,
    EffectPart,
    Interval,
    LevelPart,
    NumberPart,
    PlacePart,
)
from taichi_erosion.evidence.words.vocabulary import Vocabulary
from taichi_erosion.scene.schema.units import Scale

UNITS = TableUnits(
    {"repose_angle": Scale("deg"), "radius_90": Scale("mm", 1e-3), "threshold_u_star": Scale("cm/s", 0.01)},
    {"moisture": Scale("%", 0.01), "diameter": Scale("um", 1e-6), "angularity": Scale("1")},
)
TITLES = {
    "liquid_bridge": "capillary bridges between moist grains",
    "rolling_resistance": "rolling resistance of angular grains",
    "rolling_friction": "a factor of rolling friction",
    "contact_pull": "a pull between touching grains",
    "side_walls": "side walls of a narrow apparatus",
}
VOC = Vocabulary(
    "lab.toml",
    lambda *words: f"`./erosion {' '.join(words)}`",
    UNITS,
    TITLES,
    {"rolling_friction": "factor minus one", "contact_pull": "pull over the weight of a grain"},
    "lab-results/lab.discover.json",
    "lab_adopted.toml",
)
UNKNOWN = Interval(nan, nan, nan)

NONE = DecisionPart(
    "none_detected", (), (), (), {"none": 0.94, "liquid_bridge": 0.04, "outside_library": 0.02}, 0.6
)
EFFECTS = {
    "liquid_bridge": EffectPart("excluded", 0.04, Interval(0.04, 0.0, 0.15), 0.18, -2.3, 0.2, 0.2),
    "rolling_resistance": EffectPart("open", 0.02, Interval(0.3, 0.02, 0.9), 1.4, -1.1, 0.6, 0.8),
    "side_walls": EffectPart("untestable", 0.01, UNKNOWN, 3.0, -0.1, 0.99, 3.0),
    "dry_cohesion": EffectPart("open", 0.02, Interval(0.2, 0.01, 0.7), 1.1, -0.6, 0.9, 0.7, ("side_walls",)),
}
SLIDING, ROLLING = "contact.soil-soil.friction_sliding", "contact.soil-soil.friction_rolling"
NUMBERS = {
    SLIDING: NumberPart(0.5, Interval(0.515, 0.482, 0.551), Interval(0.514, 0.481, 0.55), 0.08, False),
    ROLLING: NumberPart(0.1, Interval(0.122, 0.06, 0.21), Interval(0.121, 0.06, 0.209), 0.4, False),
}
MOVED = NUMBERS | {
    SLIDING: NumberPart(0.5, Interval(0.684, 0.651, 0.712), Interval(0.52, 0.48, 0.56), 0.1, False)
}
MEASURED = np.array([33.1, 38.0, 0.0512])
ROWS = record.RowsPart(
    ("repose_angle", "repose_angle", "radius_90"),
    {"moisture": np.array([0.0, 0.05, 0.05])},
    *(MEASURED, MEASURED, MEASURED),
    np.array([0.5, 0.5, 5e-4]),
    np.array([33.0, 37.6, 0.0509]),
    np.array([33.0, 37.9, 0.0511]),
)
GOOD = record.FitPart(33, 34.2, 33.9, 0.41, 0.42, 0.35)
BAD = record.FitPart(33, 171.6, 35.0, 1e-17, 0.37, 3e-9)
COST = record.CostPart(412, 6592, 1.2, "", 7)
WET = PlacePart("repose_angle", "moisture", 1, 2e-12)

null = record.Record(NONE, EFFECTS, NUMBERS, (), (), (), GOOD, (), ROWS, COST)


def present(strength: Interval, chance: float = 0.99) -> EffectPart:
    """A named effect."""
    return EffectPart("present", chance, strength, nan, 41.3, 0.25, 0.1)


def decided(verdict, named=(), group=(), mechanisms=(), **probabilities: float) -> DecisionPart:
    """A decision that something is missing."""
    shares = {key.replace("__", "+"): p for key, p in probabilities.items()}
    unlisted = shares.get("outside_library", 0.0)
    return DecisionPart(verdict, named, group, mechanisms, shares, 1e-4, unlisted=unlisted)


single = replace(
    null,
    decided=decided("present", ("liquid_bridge",), none=1e-9, liquid_bridge=0.97, outside_library=0.03),
    effects=EFFECTS | {"liquid_bridge": present(Interval(0.92, 0.71, 1.18))},
    numbers=MOVED,
    fit=BAD,
    where=(WET,),
)
pair = replace(
    single,
    decided=decided(
        "present", ("liquid_bridge", "rolling_resistance"), liquid_bridge__rolling_resistance=0.95
    ),
    effects=EFFECTS
    | {
        "liquid_bridge": present(Interval(0.92, 0.71, 1.18)),
        "rolling_resistance": present(Interval(2.8, 1.9, 3.1)),
        "dry_cohesion": replace(
            EFFECTS["dry_cohesion"], status="better_but_not_sufficient", log_bayes_factor=12.4
        ),
    },
    where=(WET, PlacePart("repose_angle", "angularity", 1, 3e-5), PlacePart("radius_90", "level", -1, 0.2)),
)
group = replace(
    single,
    decided=decided(
        "group", (), ("dry_cohesion", "side_walls"), dry_cohesion=0.55, side_walls=0.4, none=0.05
    ),
    effects=EFFECTS
    | {
        "dry_cohesion": replace(present(Interval(0.8, 0.5, 1.1), 0.55), status="open", alike=("side_walls",)),
        "side_walls": replace(present(Interval(1.3, 0.7, 1.9), 0.4), status="open", alike=("dry_cohesion",)),
    },
    experiments=tuple(
        record.ExperimentPart(
            observable,
            {"moisture": 0.0, "diameter": d},
            {"dry_cohesion": dry, "side_walls": walls},
            chance,
            cost,
        )
        for observable, d, dry, walls, chance, cost in (
            ("repose_angle", 1e-4, Interval(41.2, 39.8, 42.5), Interval(36.1, 35.0, 37.3), 0.86, 1.0),
            ("threshold_u_star", 2e-4, Interval(0.31, 0.29, 0.33), Interval(0.25, 0.24, 0.26), 0.97, 3.0),
        )
    ),
)
outside = replace(
    single,
    decided=decided("outside_library", outside_library=0.96, none=1e-6, liquid_bridge=0.04),
    effects=EFFECTS
    | {"liquid_bridge": replace(EFFECTS["liquid_bridge"], status="better_but_not_sufficient")},
    fit=replace(BAD, chi2_after=140.0, p_after=1e-9),
    numbers=MOVED | {ROLLING: replace(MOVED[ROLLING], at_end=True)},
)
LAW = record.LawPart(
    "rolling_friction",
    ("moisture",),
    "power",
    "0.8 (moisture / 0.05)^1.2",
    '0.8 * (at["moisture"] / 0.05) ** 1.2',
    {"a": Interval(0.81, 0.62, 1.04), "p": Interval(1.2, 0.9, 1.5)},
    {"moisture": Interval(1.2, 0.9, 1.5)},
    (({"moisture": 0.01}, Interval(0.12, 0.02, 0.25)), ({"moisture": 0.05}, Interval(0.8, 0.6, 1.0))),
    0.92,
    "{a} (moisture / {c})^{p}",
    {"c": ("moisture", 0.05)},
)
mechanism = replace(
    single,
    decided=decided(
        "outside_library", (), (), ("rolling_friction",), rolling_friction=0.96, outside_library=0.04
    ),
    effects=EFFECTS,
    law=LAW,
)
mechanisms = replace(
    mechanism,
    decided=decided(
        "outside_library",
        (),
        (),
        ("rolling_friction", "contact_pull"),
        rolling_friction=0.6,
        contact_pull=0.38,
    ),
)
HUMP = tuple((w, Interval(a, a - 0.8, a + 0.8)) for w, a in ((0.0, 0.0), (0.02, 9.1), (0.05, 3.2)))
curved = replace(
    outside, curves=(record.CurvePart("repose_angle", "moisture", "offset", "peak", 0.02, HUMP),)
)
contradicted = replace(
    single,
    decided=replace(decided("none_detected", liquid_bridge=0.97, none=1e-9), refuted=("liquid_bridge",)),
)
level = replace(
    mechanism,
    levels=(
        LevelPart("radius_90", "offset", Interval(0.6e-3, 0.4e-3, 0.8e-3), 0.99),
        LevelPart("repose_angle", "offset", Interval(-0.1, -0.4, 0.2), 0.1),
    ),
    errors=(record.ErrorPart("source", "repose_angle", "laboratory B", Interval(-3.0, -4.1, -2.0)),),
)
typo = replace(
    null,
    repeats=(record.RepeatPart("repose_angle", (17, 18), 30.2, 17),),
    errors=(record.ErrorPart("row", "repose_angle", "17", Interval(30.0, 29.0, 31.0)),),
    fit=replace(GOOD, p_lack_of_fit=0.4),
)
stopped = replace(
    single,
    decided=decided("none_detected", liquid_bridge=0.7, none=0.05, outside_library=0.25),
    effects=EFFECTS | {"liquid_bridge": replace(present(Interval(0.9, 0.4, 1.5), 0.7), status="open")},
    cost=replace(COST, settings=600, stopped="budget"),
)
HELD = record.HeldOutPart(12, 5.6, 1.1, 0.35, 5.1, 1, ("liquid_bridge",), "side_walls")
adopted = replace(single, held_out=HELD)
still_fails = replace(single, held_out=replace(HELD, after=2.9, p_after=5e-14, opened=3))
fitted_fails = replace(adopted, fit=replace(BAD, chi2_after=80.0, p_after=1e-6))
refuted = replace(adopted, held_out=replace(HELD, after=6.3, p_after=1e-20))

DISCOVERIES = {
    "null": null,
    "single": single,
    "pair": pair,
    "group": group,
    "outside": outside,
    "mechanism": mechanism,
    "mechanisms": mechanisms,
    "curved": curved,
    "contradicted": contradicted,
    "level": level,
    "typo": typo,
    "stopped": stopped,
    "named_and_typo": replace(single, repeats=typo.repeats),
    "not_testable": replace(null, decided=replace(NONE, verdict="not_testable"), fit=replace(GOOD, n=4)),
    "unstable": replace(
        single, decided=replace(single.decided, verdict="unstable", named=(), group=("liquid_bridge",))
    ),
}
ADOPTIONS = {"adopted": adopted, "still_fails": still_fails, "fitted_fails": fitted_fails, "refuted": refuted}
