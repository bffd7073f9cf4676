"""A condition is converted to the unit of the place that it sets, whatever unit its column has."""

from collections.abc import Iterator
from dataclasses import fields
from math import pi
from pathlib import Path
from typing import Any

import pytest

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.core.errors import BadInput
from taichi_erosion.effects import load_library
from taichi_erosion.evidence.data.measured import read_table, study_measurements
from taichi_erosion.evidence.models.table_columns import place_units
from taichi_erosion.scene.paths import options, scene_schema, unit_of_path

# unit of a place -> three columns of a table: their unit, the number there, and the number at the place
COLUMNS: dict[str, tuple[tuple[str, float, float], ...]] = {
    "1": (("1", 0.25, 0.25), ("%", 25.0, 0.25), ("‰", 250.0, 0.25)),
    "kg kg-1": (("kg/kg", 0.02, 0.02), ("%", 2.0, 0.02), ("g/kg", 20.0, 0.02)),
    "m": (("m", 0.5, 0.5), ("µm", 250.0, 2.5e-4), ("inch", 2.0, 0.0508)),
    "s": (("s", 3.0, 3.0), ("ms", 5.0, 5e-3), ("min", 2.0, 120.0)),
    "s-1": (("s-1", 3.0, 3.0), ("1/min", 120.0, 2.0), ("kHz", 2.0, 2e3)),
    "K": (("K", 290.0, 290.0), ("°C", 20.0, 293.15), ("degF", 50.0, 283.15)),
    "Pa": (("Pa", 3.0, 3.0), ("hPa", 1013.0, 101300.0), ("bar", 2.0, 2e5)),
    "Pa m-1": (("Pa/m", 3.0, 3.0), ("hPa/km", 3.0, 0.3), ("kPa m-1", 2.0, 2e3)),
    "deg": (("deg", 10.0, 10.0), ("rad", pi / 6.0, 30.0), ("°", -5.0, -5.0)),
    "rad": (("rad", 0.5, 0.5), ("deg", 90.0, pi / 2.0), ("mrad", 20.0, 0.02)),
    "deg s-1": (("deg/s", 10.0, 10.0), ("rad/s", pi, 180.0), ("rpm", 1.0, 6.0)),
    "rad s-1": (("rad/s", 3.0, 3.0), ("deg s-1", 180.0, pi), ("rpm", 30.0, pi)),
    "m s-1": (("m/s", 3.0, 3.0), ("km/h", 36.0, 10.0), ("cm s^-1", 45.0, 0.45)),
    "m s-2": (("m/s2", 9.81, 9.81), ("cm s-2", 981.0, 9.81), ("mm/s^2", 500.0, 0.5)),
    "m2 s-1": (("m2/s", 1.5e-5, 1.5e-5), ("mm2/s", 15.0, 1.5e-5), ("cm^2 s^-1", 0.15, 1.5e-5)),
    "kg m-3": (("kg/m3", 2650.0, 2650.0), ("g/cm3", 2.65, 2650.0), ("t m-3", 2.65, 2650.0)),
    "J m-2": (("J/m2", 0.1, 0.1), ("mJ/m^2", 72.0, 0.072), ("N/m", 0.07, 0.07)),
    "N m-1": (("N/m", 0.07, 0.07), ("mN/m", 72.8, 0.0728), ("dyn/cm", 72.8, 0.0728)),
    "C kg-1": (("C/kg", 6e-5, 6e-5), ("µC/kg", 60.0, 6e-5), ("nC/g", 60.0, 6e-5)),
    "V m-1": (("V/m", 1e5, 1e5), ("kV/m", 100.0, 1e5), ("V/cm", 1e3, 1e5)),
    "s m-1": (("s/m", 3.0, 3.0), ("ms/mm", 2.0, 2.0), ("s mm-1", 0.01, 10.0)),
}
NO_NUMBER = ("unit of the observable", "m, m, any mass", "m per file unit", "unit")  # no column can set these
KEYS = {"contact": "soil-steel", "effects": "liquid_bridge"}  # names that stand for any key of a table


def leaves(node: dict[str, Any], path: str = "") -> Iterator[str]:
    """Dotted paths of all numbers below a node; one name for any key, one place for any component."""
    for option in options(scene_schema(), node):
        if "unit" in option:
            vector = any("items" in part or "prefixItems" in part for part in options(scene_schema(), option))
            yield f"{path}.0" if vector else path
            continue
        anything = (option.get("additionalProperties"), *option.get("patternProperties", {}).values())
        below = [*option.get("properties", {}).items(), ("0", option.get("items"))]
        for key, each in below + [(KEYS.get(path, "anything"), each) for each in anything]:
            if isinstance(each, dict):
                yield from leaves(each, f"{path}.{key}".lstrip("."))


def effect_numbers() -> Iterator[tuple[str, str]]:
    """Path and unit of every number of an effect, and of its strength."""
    for name, effect in load_library().items():
        yield f"effects.{name}.strength", "1"
        yield from ((f"effects.{name}.{f.name}", str(f.metadata["unit"])) for f in fields(effect.params))


SCENE = [(path, unit_of_path(path)) for path in dict.fromkeys(leaves(scene_schema()))]
PLACES = [(path, unit) for path, unit in (*SCENE, *effect_numbers()) if unit not in NO_NUMBER]


def study(**conditions: str) -> StudyFile:
    return StudyFile.model_validate(
        {
            "study": {"measurements": "t.csv"},
            "observables": {"pile_height": {"scene": "s.toml"}},
            "conditions": conditions,
        }
    )


def converted(folder: Path, heading: str, number: float, place: str) -> float:
    """A number of a table of one row, as the model gets it."""
    (folder / "t.csv").write_text(f"observable,value,unit,{heading}\npile_height,1,m,{number!r}\n", "utf-8")
    file, table = study(x=place), read_table(folder / "t.csv", "t.csv")
    rows, _ = study_measurements(table, file, "study.toml", place_units(file, folder / "study.toml"))
    return float(rows.conditions["x"][0])


def test_the_schema_has_paths_of_every_kind_of_unit():
    assert len(PLACES) > 250
    assert {unit for _, unit in PLACES} == set(COLUMNS), "a unit of the schema without columns to test it"


@pytest.mark.parametrize("unit", COLUMNS)
def test_every_path_is_set_in_its_own_unit_from_a_column_in_any_of_three(tmp_path, unit):
    for path in (path for path, own in PLACES if own == unit):
        for heading, number, wanted in COLUMNS[unit]:
            found = converted(tmp_path, f"x [{heading}]", number, path)
            assert found == pytest.approx(wanted, rel=1e-9), path


@pytest.mark.parametrize(
    ("heading", "place", "told"),
    [
        ("x [%]", "conditions.slope", "it sets a number in deg; give it in that unit"),
        ("x [deg]", "conditions.moisture", "it sets a number in kg kg-1"),
        ("x [m]", "grains.count", "it sets a pure number"),
        ("x [mm]", "conditions.slope, conditions.diameter", "sets places of several units"),
        ("x [mm]", "grains.size.rows", "sets what is counted in m, m, any mass, not a number"),
        ("x [V/m]", "effects.electric_field.charge", "it sets a number in C kg-1"),
    ],
)
def test_a_column_of_another_kind_than_its_place_is_refused(tmp_path, heading, place, told):
    with pytest.raises(BadInput) as caught:
        converted(tmp_path, heading, 1.0, place)
    assert told in str(caught.value)


def test_a_condition_that_a_scene_declares_has_the_unit_it_is_declared_in(tmp_path):
    (tmp_path / "s.toml").write_text('[conditions.extra]\nroots = { unit = "kg/m3" }\n', "utf-8")
    assert converted(tmp_path, "x [g/L]", 2.5, "conditions.roots") == pytest.approx(2.5)
    with pytest.raises(BadInput, match="it sets a number in kg/m3"):
        converted(tmp_path, "x [mm]", 2.5, "conditions.roots")


def test_a_model_function_gets_si_units(tmp_path):
    file = study(x="slope").model_copy(update={"study": study().study.model_copy(update={"model": "m:f"})})
    assert place_units(file, Path("study.toml")) == {}
