"""What a user adds to a new study: a scene of his own, conditions that no scene has, effects in files."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.study_files.scene_templates import (
    TEMPLATES,
    USUAL_HEAP,
    Template,
    contact,
)
from taichi_erosion.evidence.data.tables.column_roles import Told
from taichi_erosion.evidence.data.tables.headings import read_heading, unit_in
from taichi_erosion.evidence.data.tables.interview import TableWishes
from taichi_erosion.evidence.data.tables.rows import NAME
from taichi_erosion.evidence.data.tables.vocabulary import plain_words
from taichi_erosion.run.checks import read_scene
from taichi_erosion.scene.load import toml_table
from taichi_erosion.scene.paths import unit_of_path

CONDITION = "conditions."
OWN = "own"  # name of the apparatus of an own scene


@dataclass(frozen=True)
class Wishes:
    """What the command line says beforehand."""

    told: Told = field(default_factory=Told)
    folder: Path | None = None
    apparatus: str | None = None  # of TEMPLATES
    closed_form: bool = False  # the reduced model answers in place of scenes
    roughness: str | None = None  # length of the bed under winds that were measured at a height
    anew: bool = False  # write a study that is there anew; else its table alone is corrected
    diameter: str | None = None  # of the grains, with its unit, where no column states it
    density: str | None = None  # of the grains, with its unit
    grains: int | None = None  # of a run
    scene: Path | None = None  # of the user's own, in place of those of TEMPLATES
    effects: tuple[Path, ...] = ()  # files with effects of the user's own
    own_conditions: Mapping[str, str] = field(default_factory=dict)  # name -> unit where its column has none

    @property
    def table(self) -> TableWishes:
        """What is said of the table."""
        if self.scene is None:
            measures = dict.fromkeys(name for each in TEMPLATES.values() for name in each.observables)
        else:
            measures = dict.fromkeys(read_scene(self.scene, ()).measure)
        own = {CONDITION + name: unit for name, unit in self.own_conditions.items()}
        return TableWishes(self.told, self.roughness, tuple(measures), own)


def with_own_conditions(wishes: Wishes) -> Wishes:
    """The wishes with conditions that are stated by a unit, `roots=kg/m3`, and those of an own scene.

    A condition that every scene has keeps its place, and takes the unit for its column. Raises BadInput.
    """
    told, own, optional = {}, dict[str, str](), set[str]()
    for name, entry in declared(wishes.scene).items():
        own[name], told[name] = str(entry.get("unit", "1")), CONDITION + name
        optional.add(name)
    measures = {} if wishes.scene is None else {name: name for name in read_scene(wishes.scene, ()).measure}
    for text, said in wishes.told.conditions.items():
        name, unit = plain_words(read_heading(text).name).replace(" ", "_"), unit_in(said)
        if unit is None or unit_of_path(said) is not None:
            told[text] = said
            continue
        if not NAME.fullmatch(name):
            raise BadInput(f"--condition {text}={said}: '{name}' is no name of letters, digits and _")
        told[text] = CONDITION + name
        own.setdefault(name, unit)
    observables = measures | dict(wishes.told.observables)
    known = frozenset((*optional, *measures)) - wishes.told.observables.keys() - wishes.told.conditions.keys()
    stated = Told(observables, told, wishes.told.units, optional=known)
    return replace(wishes, told=stated, own_conditions=own)


def undeclared(wishes: Wishes) -> dict[str, str]:
    """Names and units of conditions that no scene has by itself."""
    return {n: unit for n, unit in wishes.own_conditions.items() if unit_of_path(CONDITION + n) is None}


def declared(scene: Path | None) -> Mapping[str, Mapping[str, Any]]:
    """Conditions that a scene declares, by name."""
    return {} if scene is None else toml_table(scene).get("conditions", {}).get("extra", {})


def own_template(wishes: Wishes) -> Template:
    """The apparatus of an own scene; the friction of its grains on each other is calibrated."""
    assert wishes.scene is not None
    if lost := undeclared(wishes).keys() - declared(wishes.scene).keys():
        unit = wishes.own_conditions[name := min(lost)]
        entry = f'[conditions.extra] {name} = {{ unit = "{unit}" }}'
        raise BadInput(f"{wishes.scene}: does not declare the condition '{name}'; write {entry}")
    scene, table = read_scene(wishes.scene, ()), toml_table(wishes.scene)
    grains = table.get("grains", {})
    pair, size = "-".join([str(grains.get("material", ""))] * 2), grains.get("size", {})
    stated = table.get("contact", {}).get(pair)
    if stated is None:
        raise BadInput(f"{wishes.scene}: no contact.{pair}, whose friction a study calibrates")
    rolling = stated.get("friction_rolling") or None
    winds = [k for k, stage in enumerate(table.get("stages", ())) if "friction_velocity" in stage]
    return Template(
        scene=wishes.scene.stem,
        words="your own scene",
        observables=tuple(scene.measure),
        changes=lambda diameter, grains: {},
        parameters=contact(pair, float(stated.get("friction_sliding", 0.5)), rolling and float(rolling)),
        grains=0,
        diameter=float(size.get("diameter", USUAL_HEAP)),
        varies="diameter" in size,
        wind=tuple(f"stages.{stage}.friction_velocity" for stage in winds),
    )
