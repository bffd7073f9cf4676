"""Records of answers, as varied as they come, made by hand: of heaps and thresholds of a soil."""

from dataclasses import replace
from math import inf, nan

import numpy as np

from taichi_erosion.evidence import record
from taichi_erosion.evidence.answers.summary import mechanism_parts
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.record import EffectPart, Interval, LevelPart, ParameterPart, PlacePart
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
    "side_walls": "side walls close together",
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
SHARES = {"none": 0.94, "liquid_bridge": 0.04, "outside_library": 0.02}
EFFECTS = {
    "liquid_bridge": EffectPart("excluded", 0.04, 0.04, 0.0, 0.15, 0.18, -2.3, 0.2, 0.2),
    "rolling_resistance": EffectPart("open", 0.02, 0.3, 0.02, 0.9, 1.4, -1.1, 0.6, 0.8),
    "side_walls": EffectPart("untestable", 0.01, nan, nan, nan, inf, -0.1, 0.99, inf),
    "dry_cohesion": EffectPart("open", 0.02, 0.2, 0.01, 0.7, 1.1, -0.6, 0.9, 0.7, ("side_walls",)),
}
SLIDING, ROLLING = "contact.soil-soil.friction_sliding", "contact.soil-soil.friction_rolling"
NUMBERS = {
    SLIDING: ParameterPart(0.514, 0.481, 0.55, 0.5, Interval(0.515, 0.482, 0.551), 0.08, False),
    ROLLING: ParameterPart(0.121, 0.06, 0.209, 0.1, Interval(0.122, 0.06, 0.21), 0.4, False),
}
MOVED = NUMBERS | {SLIDING: ParameterPart(0.52, 0.48, 0.56, 0.5, Interval(0.684, 0.651, 0.712), 0.1, False)}
MEASURED = np.array([33.1, 38.0, 0.0512])
ROWS = record.RowsPart(
    ("repose_angle", "repose_angle", "radius_90"),
    {"moisture": np.array([0.0, 0.05, 0.05])},
    *(MEASURED, MEASURED, MEASURED),
    np.array([0.5, 0.5, 5e-4]),
    np.array([33.0, 37.6, 0.0509]),
    np.array([33.0, 37.9, 0.0511]),
)
MISFITS = ("chi2_before", "chi2_after", "p_misfit", "p_misfit_after", "p_lack_of_fit")
GOOD = dict(zip(MISFITS, (34.2, 33.9, 0.41, 0.42, 0.35), strict=True))
BAD = dict(zip(MISFITS, (171.6, 35.0, 1e-17, 0.37, 3e-9), strict=True))
WET, DRY = PlacePart("repose_angle", "moisture", 1, 2e-12), {"moisture": 0.0}

null = record.Record(
    **{"verdict": "none_detected", "probabilities": SHARES, "p": 0.6, "effects": EFFECTS},
    **{"mechanisms": {}, "parameters": NUMBERS, "levels": (), "errors": (), "repeats": (), "where": ()},
    **{"rows": ROWS, "settings": 412, "runs": 6592, "wall_s": 1.2, "seed": 7, "n": 33} | GOOD,
)


def present(strength: Interval, chance: float = 0.99) -> EffectPart:
    return EffectPart("present", chance, *vars(strength).values(), nan, 41.3, 0.25, 0.1)


def decided(verdict, named=(), group=(), mechanisms=(), **probabilities: float) -> dict:
    """Fields of a decision that something is missing."""
    shares = {key.replace("__", "+"): p for key, p in probabilities.items()}
    decision = record.DecisionPart(
        verdict=verdict,
        **{"named": named, "group": group, "acting_mechanisms": mechanisms},
        **{"probabilities": shares, "p": 1e-4, "unlisted": shares.get("outside_library", 0.0)},
    )
    return vars(decision) | {"mechanisms": mechanism_parts(decision)}


single = replace(
    null,
    **decided("present", ("liquid_bridge",), none=1e-9, liquid_bridge=0.97, outside_library=0.03),
    effects=EFFECTS | {"liquid_bridge": present(Interval(0.92, 0.71, 1.18))},
    parameters=MOVED,
    **BAD,
    where=(WET,),
)
pair = replace(
    single,
    **decided("present", ("liquid_bridge", "rolling_resistance"), liquid_bridge__rolling_resistance=0.95),
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
    **decided("group", (), ("dry_cohesion", "side_walls"), dry_cohesion=0.55, side_walls=0.4, none=0.05),
    effects=EFFECTS
    | {
        "dry_cohesion": replace(present(Interval(0.8, 0.5, 1.1), 0.55), status="open", alike=("side_walls",)),
        "side_walls": replace(present(Interval(1.3, 0.7, 1.9), 0.4), status="open", alike=("dry_cohesion",)),
    },
    next_experiments=tuple(
        record.ExperimentPart(name, DRY | {"diameter": d}, {"dry_cohesion": a, "side_walls": b}, *rest)
        for name, d, a, b, *rest in (
            ("repose_angle", 1e-4, Interval(41.2, 39.8, 42.5), Interval(36.1, 35.0, 37.3), 0.86, 1.0),
            ("threshold_u_star", 2e-4, Interval(0.31, 0.29, 0.33), Interval(0.25, 0.24, 0.26), 0.97, 3.0),
        )
    ),
)
outside = replace(
    single,
    **decided("outside_library", outside_library=0.96, none=1e-6, liquid_bridge=0.04),
    effects=EFFECTS
    | {"liquid_bridge": replace(EFFECTS["liquid_bridge"], status="better_but_not_sufficient")},
    chi2_after=140.0,
    p_misfit_after=1e-9,
    parameters=MOVED | {ROLLING: replace(MOVED[ROLLING], at_end=True)},
)
LAW = record.LawPart(
    "rolling_friction",
    ("moisture",),
    "power",
    "0.8 (moisture / 0.05)^1.2",
    '0.8 * (at["moisture"] / 0.05) ** 1.2',
    {"a": Interval(0.81, 0.62, 1.04), "p": Interval(1.2, 0.9, 1.5)},
    *({"moisture": power} for power in (1.2, 0.9, 1.5)),
    0.92,
    "{a} (moisture / {c})^{p}",
    {"c": ("moisture", 0.05)},
)
DOSES = tuple(
    record.DosePart({"moisture": w}, *sizes)
    for w, sizes in ((0.01, (0.12, 0.02, 0.25)), (0.05, (0.8, 0.6, 1.0)))
)
mechanism = replace(
    single,
    **decided("outside_library", (), (), ("rolling_friction",), rolling_friction=0.96, outside_library=0.04),
    effects=EFFECTS,
)
LAWS = {"rolling_friction": record.MechanismPart(0.96, DOSES, LAW)}
mechanism = replace(mechanism, mechanisms=LAWS)
BOTH = {"rolling_friction": 0.6, "contact_pull": 0.38}
mechanisms = replace(mechanism, **decided("outside_library", mechanisms=tuple(BOTH), **BOTH))
mechanisms = replace(mechanisms, mechanisms=mechanisms.mechanisms | LAWS)
HUMP = tuple(record.PointPart(a, a - 0.8, a + 0.8, w) for w, a in ((0.0, 0.0), (0.02, 9.1), (0.05, 3.2)))
curve = record.CurvePart("repose_angle", "moisture", "offset", "peak", 0.02, HUMP)
curved = replace(outside, curves=(curve,))
contradicted = replace(
    single, **decided("none_detected", liquid_bridge=0.97, none=1e-9) | {"refuted": ("liquid_bridge",)}
)
level = replace(
    mechanism,
    levels=(
        LevelPart(0.6e-3, 0.4e-3, 0.8e-3, "radius_90", "offset", 0.99),
        LevelPart(-0.1, -0.4, 0.2, "repose_angle", "offset", 0.1),
    ),
    errors=(record.ErrorPart(-3.0, -4.1, -2.0, "source", "repose_angle", "laboratory B"),),
)
typo = replace(
    null,
    repeats=(record.RepeatPart("repose_angle", (17, 18), 30.2),),
    errors=(record.ErrorPart(30.0, 29.0, 31.0, "row", "repose_angle", "17"),),
    p_lack_of_fit=0.4,
)
stopped = replace(
    single,
    **decided("none_detected", liquid_bridge=0.7, none=0.05, outside_library=0.25),
    effects=EFFECTS | {"liquid_bridge": replace(present(Interval(0.9, 0.4, 1.5), 0.7), status="open")},
    settings=600,
    stopped="budget",
)
HELD = record.HeldOutPart(12, 5.6, 1.1, 5.1, 0.35, nan, 1, ("liquid_bridge",), "side_walls")
adopted = replace(single, vault=HELD)
still_fails = replace(single, vault=replace(HELD, chi2_per_row_after=2.9, p_after=5e-14, opened=3))
fitted_fails = replace(adopted, chi2_after=80.0, p_misfit_after=1e-6)
refuted = replace(adopted, vault=replace(HELD, chi2_per_row_after=6.3, p_after=1e-20))

DISCOVERIES = {"null": null, "single": single, "pair": pair, "group": group, "outside": outside}
DISCOVERIES |= {"mechanism": mechanism, "mechanisms": mechanisms, "curved": curved}
DISCOVERIES |= {"contradicted": contradicted, "level": level, "typo": typo, "stopped": stopped}
DISCOVERIES |= {
    "named_and_typo": replace(single, repeats=typo.repeats),
    "not_testable": replace(null, verdict="not_testable", n=4),
    "unstable": replace(single, verdict="unstable", named=(), group=("liquid_bridge",)),
}
ADOPTIONS = {"adopted": adopted, "still_fails": still_fails, "fitted_fails": fitted_fails, "refuted": refuted}
