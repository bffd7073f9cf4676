"""Columns of tables as a study takes them: units of the places that they set, and new conditions."""

from collections.abc import Iterator
from dataclasses import fields, replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_tables import refusal

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.core.errors import BadInput
from taichi_erosion.effect_library import load_library
from taichi_erosion.evidence.data.measured import read_measured_table, study_measurements
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.models.table_columns import condition_units, read_new_conditions
from taichi_erosion.scene.paths import options, scene_schema, unit_at_path
from tests.evidence.small_study import write_study

# unit of a place -> unit of a column, the number there, and the number at the place
COLUMNS: dict[str, tuple[str, float, float]] = {"1": ("%", 25.0, 0.25), "kg kg-1": ("g/kg", 20.0, 0.02)}
COLUMNS |= {"m": ("µm", 250.0, 2.5e-4), "K": ("°C", 20.0, 293.15), "deg": ("rad", pi / 6.0, 30.0)}
COLUMNS |= {"rad s-1": ("rpm", 30.0, pi), "J m-2": ("mN/m", 72.0, 0.072)}
MOTION = ("s, m s-1, rad s-1", "m s-1 or rad s-1")
# not set by columns
NO_NUMBER = ("unit of the observable", "m, m, any mass", "m per file unit", "unit", *MOTION)
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


# paths and units of every number of an effect, and of its strength
EFFECTS = load_library().values()
NUMBERS = [(f"effects.{e.name}.strength", "1") for e in EFFECTS]
NUMBERS += [(f"effects.{e.name}.{f.name}", f.metadata["unit"]) for e in EFFECTS for f in fields(e.params)]
SCENE = [(path, unit_at_path(path)) for path in dict.fromkeys(leaves(scene_schema()))]
PLACES = [(path, unit) for path, unit in (*SCENE, *NUMBERS) if unit not in NO_NUMBER]


def study(**conditions: str) -> StudyFile:
    sections = {"study": {"measurements": "t.csv"}, "observables": {"pile_height": {"scene": "s.toml"}}}
    return StudyFile.model_validate(sections | {"conditions": conditions})


def converted(folder: Path, heading: str, number: float, place: str) -> float:
    """A number of a table of one row, as the model gets it."""
    (folder / "t.csv").write_text(f"observable,value,unit,{heading}\npile_height,1,m,{number!r}\n", "utf-8")
    file, table = study(x=place), read_measured_table(folder / "t.csv", "t.csv")
    rows, _ = study_measurements(table, file, "study.toml", condition_units(file, folder / "study.toml"))
    return float(rows.conditions["x"][0])


def test_every_path_is_set_in_its_own_unit(tmp_path):
    assert len(PLACES) > 250
    assert {unit for _, unit in PLACES} > set(COLUMNS)
    for path, unit in PLACES:
        heading, number, wanted = COLUMNS.get(unit, (unit, 2.5, 2.5))
        assert converted(tmp_path, f"x [{heading}]", number, path) == pytest.approx(wanted, rel=1e-9), path


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
    assert told in refusal(converted, tmp_path, heading, 1.0, place)


def test_a_condition_that_a_scene_declares_has_the_unit_it_is_declared_in(tmp_path):
    (tmp_path / "s.toml").write_text('[conditions.extra]\nroots = { unit = "kg/m3" }\n', "utf-8")
    assert converted(tmp_path, "x [g/L]", 2.5, "conditions.roots") == pytest.approx(2.5)
    with pytest.raises(BadInput, match="it sets a number in kg/m3"):
        converted(tmp_path, "x [mm]", 2.5, "conditions.roots")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return load_study(write_study(tmp_path_factory.mktemp("study"), {}))


@pytest.fixture
def read(small, tmp_path):
    """Function that reads a table of new conditions of the study."""

    def found(text, measurements=small.problem.measurements):
        (tmp_path / "at.csv").write_text(text, encoding="utf-8")
        places = condition_units(small.file, small.path)
        return read_new_conditions(tmp_path / "at.csv", small.file, places, measurements, tmp_path)

    return found


def test_numbers_are_read_in_the_units_of_their_headings_else_in_those_of_the_study(read):
    found = read("Moisture [%];diameter [um]\n1,5;250\n2;300\n")
    assert found.conditions["moisture"] == pytest.approx([0.015, 0.015, 0.02, 0.02])
    assert found.conditions["diameter"] == pytest.approx([2.5e-4, 2.5e-4, 3e-4, 3e-4])
    assert found.observable == ("repose_angle", "threshold_u_star") * 2
    plain = read("moisture,diameter\n0.015,0.25\n")
    assert plain.conditions["diameter"] == pytest.approx([2.5e-4] * 2)  # the study's table has millimetres
    assert plain.scales["diameter"].unit == "mm"


def test_a_column_of_observables_says_what_is_wanted(read):
    found = read("observable,moisture,diameter [mm]\nrepose_angle,0.01,0.2\n,0.02,0.2\n")
    assert found.observable == ("repose_angle", "repose_angle", "threshold_u_star")


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("observable,moisture,diameter [mm]\nflux,0.01,0.2\n", ["row 2, observable = 'flux'; the study has"]),
        ("diameter [mm]\n0.2\n", ["no column sets moisture, which the study varies from 0 to 0.04"]),
        ("moisture,diameter [mm]\n,0.2\n0.01,fine\n0.02,\n", ["row 2", "row 3", "row 4"]),
        ("moisture,diameter [mm]\n", ["holds no conditions"]),
        ("moisture [%],diameter [mm]\n600,0.2\n", ["row 2, moisture = 600 % is 6 kg kg-1, outside [0, 5]"]),
        (
            "moisture [%],diameter [mm],grain density [g/cm3]\n1,0.2,4\n",
            ["grain density [g/cm3] is no condition of the study, which has moisture, diameter"],
        ),
    ],
)
def test_conditions_that_cannot_be_asked_are_refused_all_at_once(read, text, faults):
    with pytest.raises(BadInput) as told:
        read(text)
    assert len(told.value.faults) == len(faults)
    assert all(words in fault for words, fault in zip(faults, told.value.faults, strict=True))


def test_one_column_of_decimal_commas_is_one_column(small, read):
    table = small.problem.measurements
    constant = replace(table, conditions=table.conditions | {"diameter": np.full(table.size, 2e-4)})
    found = read("moisture [%]\n1,5\n2,25\n", constant)
    assert found.conditions["moisture"] == pytest.approx([0.015, 0.015, 0.0225, 0.0225])
