"""Scenes from which `study new` makes that of a table: one of the program's own for every kind of apparatus.

A template says what it measures, which grains and lengths it is given, which numbers of its contacts are
calibrated, and which places a column sets. Lengths and times count in grain diameters, so that a table may
hold many diameters.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, sqrt
from statistics import median
from typing import Any

import tomlkit

from taichi_erosion.campaign.study_file import set_entry_comment
from taichi_erosion.evidence.data.tables.column_roles import AIR
from taichi_erosion.measures.shortfalls import LEAST_ROWS, POURED_LEAST, grain_count
from taichi_erosion.scene.checks import LID_LEAST, REST_LEAST
from taichi_erosion.scene.load import SCENES, read_toml
from taichi_erosion.scene.schema.scene import Gravity
from taichi_erosion.tables.headings import DIAMETER, FRICTION_VELOCITY, GRAIN_CONTACT, GRAIN_DENSITY

LID = 1.5 * LID_LEAST  # height of the lid in largest diameters: a bed of up to ten, and hops above it [1]
REST = 1.5 * REST_LEAST  # of sqrt(d / g) of the largest grains, at rest for so long before they sleep [1]
SOFT = 2e6  # shear modulus of soil [Pa] in heaps that are lifted or poured: doe/heap_size
FLATTER = 0.8  # of the smallest measured angle, down to which a heap is large enough for its measure [1]
USUAL_HEAP, USUAL_SAND = 2e-3, 2.5e-4  # grain diameters where the table states none [m]
Changes = Mapping[str, Any]  # dotted path -> value; None: the entry is left out


@dataclass(frozen=True)
class CalibratedNumber:
    """A number that is calibrated: its prior is lognormal around `start`, cut at `low` and `high`."""

    path: str
    start: float
    low: float
    high: float
    sd_log: float
    why: str


ALIKE = "diameter moisture slope angularity fetch width turbulence spread air_density".split()
READS = {  # place -> condition of the closed form
    **{f"conditions.{name}": name for name in ALIKE},
    **{place: place.removeprefix("conditions.") for place in AIR},
    **{DIAMETER: "diameter", GRAIN_DENSITY: "grain_density", FRICTION_VELOCITY: "u_star"},
    "conditions.roughness_density": "roughness",
}
INCLUDES = {"conditions.air_density": AIR, "conditions.pressure": ("conditions.altitude",)}  # counts these
THRESHOLD = CalibratedNumber("threshold_coefficient", 0.1, 0.04, 0.2, 0.2, "Bagnold's coefficient")
SLIDING = CalibratedNumber("friction_sliding", 0.5, 0.1, 1.2, 0.2, "grain on grain")
ROLLING = CalibratedNumber("friction_rolling", 0.1, 0.005, 0.8, 0.6, "shape of the grains")
FLUX = CalibratedNumber("flux_coefficient", 2.5, 0.3, 20.0, 0.5, "of the flux above the threshold")
EXPONENT = CalibratedNumber("flux_exponent", 2.4, 1.7, 3.8, 0.2, "2 after Ungar & Haff, 3 after Owen")
CLOSED_FORM_NUMBERS = {"repose_angle": [SLIDING, ROLLING], "threshold_u_star": [THRESHOLD]}
CLOSED_FORM_NUMBERS |= {"flux": [THRESHOLD, FLUX, EXPONENT]}


@dataclass(frozen=True)
class Template:
    scene: str  # name among the program's scenes
    words: str
    observables: tuple[str, ...]
    parameters: tuple[CalibratedNumber, ...]
    grains: int  # of the program's scene
    diameter: float  # where the table states none [m]
    varies: bool = True  # whether a column may set the diameter of its grains
    rows: float = 0.0  # rows of grains on the flank that its angle needs; 0: it measures none
    wind: tuple[str, ...] = ()  # places that a column of friction velocities sets beside its condition
    changes: Callable[[float, int], Changes] = lambda diameter, grains: {}  # grain diameter [m], grains

    @property
    def grain_material_pair(self) -> str:
        """Pair of materials of grains on each other, as scenes name it."""
        return self.parameters[0].path.split(".")[1]

    @property
    def grain_density_path(self) -> str:
        return f"materials.{self.grain_material_pair.partition('-')[0]}.density"

    @property
    def usual_grain_density(self) -> float:
        """Density of the grains of the program's scene [kg m-3]."""
        materials = read_toml(SCENES / f"{self.scene}.toml")["materials"]
        return float(materials[self.grain_density_path.split(".")[1]]["density"])


def friction_numbers(pair: str, sliding: float, rolling: float | None) -> tuple[CalibratedNumber, ...]:
    numbers = [CalibratedNumber(f"contact.{pair}.friction_sliding", sliding, 0.1, 1.2, 0.3, "grain on grain")]
    if rolling is not None:
        path = f"contact.{pair}.friction_rolling"
        why = "shape of the grains, as resistance to rolling"
        numbers.append(CalibratedNumber(path, rolling, 0.005, 0.8, 0.6, why))
    return tuple(numbers)


def lifted_cylinder_changes(diameter: float, grains: int) -> Changes:
    """Tube, plate and lift that grow with the heap."""
    size = (grains / 1500) ** (1.0 / 3.0)
    return {
        "geometry.plate.radius_d": round(40.0 * size, 1),
        "geometry.tube.radius_d": round(8.0 * size, 2),
        "geometry.tube.length_d": round(30.0 * size, 1),
        "fill.radius_d": round(8.0 * size - 0.7, 2),
        "stages.1.duration_min_d": round(500.0 * size, 1),
        "stages.1.duration_max_d": round(830.0 * size, 1),
        "stages.0.duration_min_d": 17.0,
        "stages.0.duration_max_d": round(200.0 * size, 1),
        "materials.soil.shear_modulus": SOFT,
    }


def column_collapse_changes(diameter: float, grains: int) -> Changes:
    """Tube that grows with the heap; all else counts in diameters already."""
    size = (grains / 1800) ** (1.0 / 3.0)
    return {
        "geometry.tube.radius_d": round(9.0 * size, 2),
        "geometry.tube.length_d": round(30.0 * size, 1),
        "fill.radius_d": round(9.0 * size - 0.6, 2),
        "conditions": None,
    }


def funnel_changes(diameter: float, grains: int) -> Changes:
    """The funnel as it is, higher for a larger heap, whose grains take longer to pass its outlet.

    Grains that are thrown bounce up to those that enter, and stop the run (doe/heap_size): they are poured.
    """
    size = (grains / 3000) ** (1.0 / 3.0)
    return {
        "geometry.funnel.outlet": [0.0, 0.0, round(0.032 * size, 4)],
        "fill.centre": [0.0, 0.0, round(0.032 * size + 0.065, 4)],
        "fill.speed": 0.5,
        "stages.0.duration_max": round(0.4 + 0.8 * grains / 3000, 2),
        "materials.soil.shear_modulus": SOFT,
        "materials.soil.softening": None,
        "conditions": None,
    }


HEAP = ("centroid_height", "pile_height", "radius_90", "column_height")
LENGTHS = (*HEAP, "runout_radius")  # that grow with the number of grains
TEMPLATES = {
    "cylinder": Template(
        "lifting_cylinder",
        "a cylinder that is lifted slowly",
        ("repose_angle", *LENGTHS),
        *(friction_numbers("soil-soil", 0.5, 0.1), 1500, USUAL_HEAP),
        rows=LEAST_ROWS,
        changes=lifted_cylinder_changes,
    ),
    "collapse": Template(
        "column_collapse",
        "a column whose tube vanishes",
        ("angle_of_repose", "runout_radius", *HEAP),
        *(friction_numbers("grain-grain", 0.5, 0.1), 1800, USUAL_HEAP),
        rows=LEAST_ROWS,
        changes=column_collapse_changes,
    ),
    "funnel": Template(
        "funnel_repose",
        "a funnel",
        ("repose_angle", "cone_angle", *HEAP[:3], "runout_radius"),
        *(friction_numbers("soil-soil", 0.5, 0.1), 3000, USUAL_HEAP),
        varies=False,
        rows=POURED_LEAST,
        changes=funnel_changes,
    ),
    "drum": Template(
        "rotating_drum",
        "a drum that turns slowly",
        ("dynamic_angle",),
        *(friction_numbers("soil-soil", 0.5, 0.1), 1000, 3e-3),
        varies=False,
    ),
    "threshold": Template(
        "wind_threshold",
        "a patch of bed under a wind that grows",
        ("threshold_u_star", "threshold_wind_speed", "rolling_onset"),
        *(friction_numbers("soil-soil", 0.5, 0.1), 900, USUAL_SAND),
        changes=lambda diameter, grains: {
            "materials.soil.shear_modulus": float(f"{6e4 * max(diameter / 2.8e-4, 1.0):.2g}"),  # with weight
            "run.time_step_fraction": 0.12,
            "threshold.first": None,
        },
    ),
    "impact": Template(
        "impact_threshold",
        "a patch of bed under a wind that falls",
        ("impact_threshold", "impact_threshold_linear"),
        *(friction_numbers("sand-sand", 0.5, None), 800, USUAL_SAND),
    ),
    "saltation": Template(
        "saltation",
        "a patch of bed under steady wind",
        ("flux", "flux_height"),
        (
            *friction_numbers("sand-sand", 0.5, None),
            CalibratedNumber("contact.sand-sand.restitution", 0.7, 0.3, 0.95, 0.15, "grain on grain"),
        ),
        *(800, USUAL_SAND),
        wind=("stages.2.friction_velocity",),
        changes=lambda diameter, grains: {  # likewise
            "materials.sand.shear_modulus": float(f"{2e5 * max(diameter / 2.4e-4, 1.0):.2g}")
        },
    ),
}


def templates_for(observable: str) -> list[str]:
    """Apparatus that measure an observable, the usual one first."""
    return [name for name, template in TEMPLATES.items() if observable in template.observables]


def least_grain_count(template: Template, angles: Sequence[float]) -> int:
    """Grains that a heap needs for its measure, down to somewhat flatter than the flattest measured one."""
    if not template.rows or not angles:
        return template.grains
    return max(template.grains, grain_count(template.rows, FLATTER * min(angles)))


def scene_text(
    template: Template,
    head: Mapping[str, str],
    diameters: Sequence[float],
    grains: int,
    density: float | None = None,
    own_conditions: Mapping[str, str] | None = None,
) -> str:
    """The scene of a table with grain diameters [m]; comments of what stays are kept.

    `density`: of the grains [kg m-3], heavier ones are as much stiffer; `own_conditions`: names and units of
    those to declare.
    """
    document: Any = tomlkit.parse((SCENES / f"{template.scene}.toml").read_text(encoding="utf-8"))
    document.pop("measured", None)  # another laboratory's values
    middle, largest = (float(f"{each:.4g}") for each in (median(diameters), max(diameters)))
    entries, heavier = template.changes(middle, grains), (density or 0.0) / template.usual_grain_density
    suits, wind = {"height": LID * largest, "sleep_after": REST * sqrt(largest / Gravity().magnitude)}, "wind"
    patch = {k: float(f"{v:.2g}") for k, v in suits.items() if float(document.get(wind, {}).get(k, inf)) < v}
    stiff = {p: x * max(heavier, 1.0) for p, x in entries.items() if p.endswith(".shear_modulus")}
    changes = {
        "grains.count": grains,
        **({"grains.size": {"law": "monodisperse", "diameter": middle}} if template.varies else {}),
        **entries,
        **stiff,
        **{f"scene.{key}": text for key, text in head.items()},
        **{f"{wind}.{name}": value for name, value in patch.items()},
        **({} if density is None else {template.grain_density_path: density}),
        **{f"conditions.extra.{name}": {"unit": unit} for name, unit in (own_conditions or {}).items()},
    }
    for path, value in changes.items():
        set_scene_entry(document, path.split("."), value)
    document.get("run", {}).pop("replicas", None)
    if "run" in document and not document["run"]:
        document.pop("run")
    text = "\n" + tomlkit.dumps(document)
    return text[text.index("\n[") + 1 :].rstrip() + "\n"  # comments above describe the program's own scene


def set_scene_entry(document: Any, path: Sequence[str], value: Any) -> None:
    """Set one entry of a parsed scene; None removes it."""
    *above, last = path
    holder = document
    for key in above:
        holder = holder[int(key)] if key.isdigit() else holder.setdefault(key, tomlkit.table())
    if value is None:
        holder.pop(last, None)
        return
    if last.endswith("_d"):
        holder.pop(last.removesuffix("_d"), None)  # the same in metres
    if isinstance(value, dict):
        inline = tomlkit.inline_table()
        inline.update(value)
        value = inline
    holder[last] = value
    set_entry_comment(holder[last], "")


def paths_of_place(template: Template, place: str) -> str:
    """Places of the scene that a column sets, given the one that its heading means."""
    if place == DIAMETER and not template.varies:
        return "conditions.diameter"
    if place == GRAIN_DENSITY:
        return template.grain_density_path
    if place.startswith(GRAIN_CONTACT):
        return f"contact.{template.grain_material_pair}.{place.removeprefix(GRAIN_CONTACT)}"
    if place == FRICTION_VELOCITY and template.wind:
        return ", ".join((FRICTION_VELOCITY, *template.wind))
    return place
