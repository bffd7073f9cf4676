"""Survey of one's own sand under wind: both thresholds and the flux, simulated, beside published formulas.

One sand, one contact, one drag law and the same forces: `scenes/quartz_wind.toml` for both thresholds and
`scenes/quartz_flux.toml` for the flux, with the diameter and the density of the sand.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf, isfinite, nan, sqrt
from pathlib import Path
from typing import Any

import tomlkit

from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.core.files import make_parent_folder, mark_toml, refuse_foreign_file, write_atomic
from taichi_erosion.evidence.answers.scene_templates import set_scene_entry
from taichi_erosion.evidence.data.measured import read_measured_table, value_unit_factor
from taichi_erosion.execution import Report, RunOptions, run_scene
from taichi_erosion.measures.result import Measurement, as_record
from taichi_erosion.measures.shortfalls import LEAST_BEDS
from taichi_erosion.measures.threshold import pool_beds
from taichi_erosion.measures.wind_formulas import FLUID, FLUX, IMPACT, QUARTZ, Sand, flux_by, iversen_white
from taichi_erosion.scene.load import SCENES
from taichi_erosion.scene.physical_ranges import USUAL
from taichi_erosion.scene.schema.units import parse_unit
from taichi_erosion.tables.number_words import round_number

SCENE = SCENES / "quartz_wind.toml"
REFERENCE = 2.5e-4  # m, diameter of the grains of both scenes
USUAL_WINDS = (1.2, 1.6, 2.1)  # over the fluid threshold of Iversen & White, where none is stated [1]
STRONGER, LEAST_START = 1.45, 2.2  # wind that starts transport, over that measured and over the threshold [1]
LID, LID_PER_WIND = 0.06, 0.35  # m; m over (m s-1)^2, of u*: a few times the highest hops
BLOW, BLOW_PER_WIND = 1.0, 2.6  # s; s over m s-1, of u*: fifteen hops
LEAST_WIND, MOST_WIND = 0.05, 2.0  # m s-1, of u*
SAME_WIND = 0.02  # of u*, within which a row of a table belongs to a simulated wind [1]
MOST_BEDS = 40  # to which beds are added for a precision
THRESHOLD_SECONDS, FLUX_SECONDS = 170.0, 30.0  # of one core for one bed of 0.25 mm, and for one in one wind
Fluxes = tuple[tuple[float, float, float, str], ...]  # u*, flux, its sd, source; SI units


@dataclass(frozen=True)
class Survey:
    """What is asked: a sand, friction velocities, and what was measured."""

    sand: Sand
    winds: tuple[float, ...]  # m s-1, of u*
    moisture: float = 0.0  # kg kg-1
    beds: int = 3
    measured: Fluxes = ()
    precision: float = inf  # of a threshold, to which beds are added: that of its 95 % interval, relative [1]
    precise: str = "fluid_threshold"

    def __post_init__(self) -> None:
        if self.moisture > USUAL["conditions.moisture"][1]:
            raise BadInput(f"--moisture: soil holds no {self.moisture:.0%} of its dry mass; write 1% for 1 %")

    def core_minutes(self, beds: int) -> tuple[float, ...]:
        """Estimated cost of every scene, with this number of beds for the thresholds.

        A bed is watched for as long whatever its grains, in steps that grow with them.
        """
        threshold = beds * THRESHOLD_SECONDS * sqrt(REFERENCE / self.sand.diameter)
        return *[self.beds * FLUX_SECONDS / 60.0] * len(self.winds), threshold / 60.0

    def flux_at(self, wind: float) -> dict[str, Any]:
        """Measured flux in one wind [m s-1], as scenes state it; empty where the table has none."""
        rows = [row for row in self.measured if abs(row[0] - wind) <= SAME_WIND * wind]
        if not rows:
            return {}
        _, fluxes, sds, sources = zip(*rows, strict=True)
        sd = {"sd": sds[0]} if len(rows) == 1 and isfinite(sds[0]) else {}
        return {"value": sum(fluxes) / len(rows), **sd, "n": len(rows), "source": "; ".join({*sources})[:500]}


def survey_winds(text: str | None, sand: Sand, measured: Fluxes) -> tuple[float, ...]:
    """Friction velocities of a list `0.3,0.4`, else those of a table, else usual ones. Raises BadInput."""
    if text is None:
        usual = (round(over * iversen_white(sand), 2) for over in USUAL_WINDS)
        return tuple(sorted({row[0] for row in measured} or usual))
    try:
        winds = tuple(float(part.removesuffix("m/s")) for part in text.split(","))
    except ValueError:
        raise BadInput(f"--wind '{text}': write friction velocities in m/s, such as 0.3,0.4,0.5") from None
    if not all(LEAST_WIND <= wind <= MOST_WIND for wind in winds):
        message = f"write u* of {LEAST_WIND:g} to {MOST_WIND:g} m/s, not the speed of the wind"
        raise BadInput(f"--wind {text}: {message}: in a tunnel u* is about 0.04 to 0.05 of that")
    return winds


def flux_by_wind(path: Path) -> Fluxes:
    """Fluxes of a table by friction velocity. Raises BadInput where there are none."""
    table = read_measured_table(path)
    places = [k for k, name in enumerate(table.conditions) if name in ("friction_velocity", "u_star")]
    rows = [row for row in table.rows if row.observable == "flux" and not row.censored]
    if not places or not rows:
        raise BadInput(
            f"{path}: holds no flux by friction velocity, such as columns 'u* [m/s]', 'flux [g/(m s)]'"
        )
    speed = parse_unit(table.units[places[0]] or "m/s").factor
    scaled = ((value_unit_factor(row, "kg/(m s)", str(path)), row) for row in rows)
    return tuple((speed * r.conditions[places[0]], k * r.value, k * r.sd, r.source) for k, r in scaled)


def survey_scenes(survey: Survey) -> dict[str, str]:
    """Scene files of a survey by name: the flux in every wind, which takes less, then the thresholds."""
    winds = {**{f"flux_{wind:g}": wind for wind in survey.winds}, "thresholds": None}
    return {name: survey_scene_text(survey, wind) for name, wind in winds.items()}


def survey_scene_text(survey: Survey, wind: float | None) -> str:
    """Scene of the thresholds, or of the flux in one wind [m s-1]; heavier grains are stiffer."""
    path, sand = SCENE if wind is None else SCENE.with_name("quartz_flux.toml"), survey.sand
    document: Any = tomlkit.parse(path.read_text(encoding="utf-8"))
    d, modulus = sand.diameter, float(document["materials"]["sand"]["shear_modulus"])
    sizes = {"median": round_number(d, 3), "low": round_number(0.8 * d, 3), "high": round_number(1.25 * d, 3)}
    stiffness = modulus * max(d / REFERENCE * sand.density / QUARTZ, 1.0)
    changes: dict[str, Any] = {
        "run.replicas": survey.beds,
        "grains.size": {"law": "lognormal", "sigma_log": 0.1, **sizes},
        "materials.sand.density": sand.density,
        "materials.sand.shear_modulus": round_number(stiffness, 3),
    }
    if survey.moisture > 0.0:
        changes |= {"conditions.moisture": survey.moisture, "effects.liquid_bridge": {"strength": 1.0}}
    for name, value in (changes | ({} if wind is None else wind_changes(survey, wind))).items():
        set_scene_entry(document, name.split("."), value)
    text = "\n" + tomlkit.dumps(document)
    return text[text.index("\n[") + 1 :].rstrip() + "\n"  # comments above describe the program's own scene


def wind_changes(survey: Survey, wind: float) -> dict[str, Any]:
    """Entries of a wind [m s-1]: hops grow with its square, their durations with it."""
    measured, start = survey.flux_at(wind), max(STRONGER * wind, LEAST_START * iversen_white(survey.sand))
    return {
        "wind.height": round_number(max(LID, LID_PER_WIND * wind**2), 3),
        "stages.1.friction_velocity": round_number(start, 3),
        "stages.2.friction_velocity": wind,
        "stages.3.duration_max": round_number(max(BLOW, BLOW_PER_WIND * wind), 3),
        **({"measured.flux": measured} if measured else {}),
    }


def run_survey(
    survey: Survey, folder: Path, force: bool, report: Report
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Write and run the scenes of a survey, one after the other; yields name and document of each."""
    texts = {folder / f"{name}.toml": text for name, text in survey_scenes(survey).items()}
    for path in texts:
        refuse_foreign_file(path, SCENE, force)
    costs = survey.core_minutes(MOST_BEDS if isfinite(survey.precision) else survey.beds)
    for number, (path, text) in enumerate(texts.items()):

        def part(share: float, words: str, number: int = number, name: str = path.stem) -> None:
            report((sum(costs[:number]) + share * costs[number]) / sum(costs), f"{name}: {words}")

        make_parent_folder(path)
        write_atomic(path, mark_toml(path, SCENE, text))
        yield path.stem, run_beds(path, survey, survey.precision if path.stem == "thresholds" else inf, part)


def run_beds(path: Path, survey: Survey, precision: float, report: Report) -> dict[str, Any]:
    """Run a scene; groups of beds with fresh seeds follow, up to MOST_BEDS, until a threshold is precise."""
    count, beds, most = 0, survey.beds, MOST_BEDS if isfinite(precision) else survey.beds

    def report_part(share: float, words: str) -> None:
        report((count + share * beds) / max(most, beds), words)

    document = run_scene(path, RunOptions(no_record=True, progress=report_part))
    while (count := count + beds) < MOST_BEDS and relative_half_width(document, survey.precise) > precision:
        seed, beds = document["seed"] + count, min(survey.beds, MOST_BEDS - count)
        with suppress(SimulationStopped):  # of all beds of a group, which then adds nothing
            more = run_scene(path, RunOptions(seed=seed, replicas=beds, no_record=True, progress=report_part))
            replicas = [*document["replicas"], *more["replicas"]]
            document |= {"replicas": replicas, "wall_s": document["wall_s"] + more["wall_s"]}
            for name in document["measures"]:  # shortfalls belong to sets of beds
                records = [bed["measures"][name] for bed in replicas if name in bed["measures"]]
                single = [Measurement(**m | {"value": m["value"] or nan, "shortfalls": ()}) for m in records]
                document["measures"][name] = as_record(pool_beds(single))
    return document


def relative_half_width(document: Mapping[str, Any], name: str) -> float:
    """Distance of a threshold from the further end of its 95 % interval [1]; few beds are close by chance."""
    measure = document["measures"].get(name, {"n": 0})
    if measure["n"] < LEAST_BEDS or not (ends := measure["details"].get("interval")):
        return inf
    return max(ends["high"] / measure["value"] - 1.0, 1.0 - ends["low"] / measure["value"])


def survey_document(survey: Survey, runs: Mapping[str, Any], files: Sequence[Path]) -> dict[str, Any]:
    """JSON document of a survey, SI units: what was asked, formulas, documents of its runs by scene."""
    sand = survey.sand
    return {
        "sand": {"diameter": sand.diameter, "density": sand.density, "moisture": survey.moisture},
        "winds": list(survey.winds),
        "core_minutes": sum(survey.core_minutes(survey.beds)),
        "precision": {survey.precise: survey.precision} if isfinite(survey.precision) else {},
        "fluid_threshold": {source: law(sand) for source, law in FLUID.items()},
        "impact_threshold": {source: law(sand) for source, law in IMPACT.items()},
        "flux": [{source: flux_by(source, sand, wind) for source in FLUX} for wind in survey.winds],
        "measured": [survey.flux_at(wind) for wind in survey.winds],
        "runs": dict(runs),
        "written": [str(path) for path in files],
    }
