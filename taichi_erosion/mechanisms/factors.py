"""Mechanisms that change a number: of contacts, of grains, of the wind, or the reading of an instrument."""

from collections.abc import Callable, Iterator
from functools import partial
from math import inf
from typing import Any

from taichi_erosion.core.effect import Check, Conditions, Probe
from taichi_erosion.scene import Scene
from taichi_erosion.scene import change as changes
from taichi_erosion.scene.schema.grains import Contact, Material

Change = Callable[[Scene, float], Scene]  # (scene, factor) -> changed scene
LEAST = 0.01  # smallest factor: a dose below -1 does not turn a sign [1]
HALF = "half the strength is half the dose"
PARTNERS = {False: "each other", True: "walls"}  # of grains in a contact
MOST = {"restitution": 1.0}  # that a number of contacts can be [1]
SAMPLE_PAIRS = {False: "sand-sand", True: "sand-steel"}  # of the sample scene; True: with a wall
SAMPLE_WIND = {"length": 0.02, "width": 0.01, "height": 0.05, "partition": 0.5}


def dose_factor(strength: float, dose: float) -> float:
    """Factor 1 + strength dose, at least LEAST [1]."""
    return max(1.0 + strength * dose, LEAST)


def scale_number(change: Change, params: Any, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with a number multiplied by 1 + strength D."""
    return scene if strength * params.dose == 0.0 else change(scene, dose_factor(strength, params.dose))


def scale_contact_number(entry: str, walls: bool, scene: Scene, factor: float) -> Scene:
    """The scene with one number of the chosen contacts multiplied."""

    def change(contact: Contact) -> Contact:
        return contact.model_copy(update={entry: min(factor * getattr(contact, entry), MOST.get(entry, inf))})

    return changes.with_contacts(scene, change, walls)


def change_rolling(walls: bool, params: Any, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene with rolling friction times 1 + strength D, or with strength D `reference` where it is 0.

    The elastic-plastic law comes with it where the scene has none; its other contacts then roll freely.
    """
    if strength * params.dose == 0.0:
        return scene
    bare = scene.laws.rolling == "none"
    factor = dose_factor(strength, params.dose)
    friction = max(strength * params.dose, 0.0) * params.reference

    def change(contact: Contact) -> Contact:
        before = 0.0 if bare else contact.friction_rolling
        after = factor * before if before > 0.0 else friction / contact.rolling_radius_ratio
        return contact.model_copy(update={"friction_rolling": after})

    if bare:
        with_law = changes.with_section(scene, "laws", rolling="elastic_plastic")
        free = {"friction_rolling": 0.0}
        scene = changes.with_contacts(with_law, lambda contact: contact.model_copy(update=free), not walls)
    return changes.with_contacts(scene, change, walls)


def contact_checks(entry: str, walls: bool, params: Any, probe: Probe) -> Iterator[Check]:
    """Checks of every factor of contacts; then of the bound of restitution, or of a law of rolling."""
    bare, rough = changes.sample_scene(), changes.sample_scene(laws={"rolling": "constant_torque"})
    target, other = SAMPLE_PAIRS[walls], SAMPLE_PAIRS[not walls]
    numbers = {pair: getattr(contact, entry) for pair, contact in rough.contact.items()}

    def new_value(pair: str, scene: Scene, strength: float = 1.0, **more: float) -> float:
        changed = probe(params(dose=0.5, **more), {}, scene=scene, strength=strength)
        return getattr(changed.contact[pair], entry)

    yield Check("a dose of 0.5 is a factor of 1.5", new_value(target, rough), 1.5 * numbers[target])
    yield Check(HALF, new_value(target, rough, 0.5), 1.25 * numbers[target])
    yield Check("other contacts stay", new_value(other, rough), numbers[other])
    if entry == "restitution":
        yield Check("a restitution of 1 is the largest", new_value(target, rough, 40.0), 1.0)
    if entry == "friction_rolling":
        force = new_value(target, bare, reference=0.2)
        law = probe(params(), {}, scene=bare).laws.rolling
        yield Check("a scene without rolling friction gets the reference", force, 0.1)
        yield Check("with the law of type C", float(law == "elastic_plastic"), 1.0)
        yield Check("its other contacts still roll freely", new_value(other, bare), 0.0)


def scale_stress(scene: Scene, factor: float) -> Scene:
    """The scene with more or less stress on its patch."""
    if scene.wind is None:
        return scene
    return changes.with_section(scene, "wind", partition=scene.wind.partition * factor**0.5)


def stress_checks(params: Any, probe: Probe) -> Iterator[Check]:
    windy = changes.sample_scene(wind=SAMPLE_WIND)

    def partition(dose: float, strength: float = 1.0) -> float:
        return probe(params(dose=dose), {}, scene=windy, strength=strength).wind.partition

    still = changes.sample_scene()
    yield Check("a dose of -0.36 leaves 0.8 of u*", partition(-0.36), 0.4)
    yield Check(HALF, partition(-0.72, 0.5), 0.4)
    yield Check("a dose of 0.44 is 1.2 times u*", partition(0.44), 0.6)
    yield Check("without wind nothing changes", float(probe(params(), {}, scene=still) == still), 1.0)


def scale_material(entry: str, power: float, scene: Scene, factor: float) -> Scene:
    """The scene with a number of the grains multiplied, and a step shorter by a power of the factor."""

    def change(material: Material) -> Material:
        name = entry if getattr(material, entry) is not None else "shear_modulus"
        return material.model_copy(update={name: factor * getattr(material, name)})

    return changes.with_shorter_step(changes.with_grain_material(scene, change), factor**power)


def material_checks(entry: str, power: float, dose: float, params: Any, probe: Probe) -> Iterator[Check]:
    sample = changes.sample_scene()

    def new_value(name: str, strength: float = 1.0) -> float:
        scene = probe(params(dose=dose), {}, scene=sample, strength=strength)
        return getattr(scene.materials[name], entry)

    sand, steel = (getattr(sample.materials[name], entry) for name in ("sand", "steel"))
    step = probe(params(dose=dose), {}, scene=sample).run.time_step
    yield Check(f"a dose of {dose:g} is a factor of {1.0 + dose:g}", new_value("sand"), (1.0 + dose) * sand)
    yield Check(HALF, new_value("sand", 0.5), (1.0 + 0.5 * dose) * sand)
    yield Check("walls keep theirs", new_value("steel"), steel)
    yield Check("the time step shortens", step, 1e-6 * (1.0 + dose) ** power)


def gain_checks(params: Any, probe: Probe) -> Iterator[Check]:
    def reading(dose: float, strength: float = 1.0) -> float:
        return probe(params(dose=dose), {}, observable="flux", value=0.02, strength=strength)

    yield Check("a dose of 0.5 is a gain of 1.5", reading(0.5), 0.03)
    yield Check(HALF, reading(0.5, 0.5), 0.025)
    yield Check("a dose of -0.2 loses a fifth", reading(-0.2), 0.016)


def offset_checks(params: Any, probe: Probe) -> Iterator[Check]:
    def reading(dose: float, strength: float = 1.0) -> float:
        instrument = params(dose=dose, scale=2.0)
        return probe(instrument, {}, observable="repose_angle", value=30.0, strength=strength)

    yield Check("a dose of 4 is four times the scale", reading(4.0), 38.0, rtol=1e-9)
    yield Check(HALF, reading(4.0, 0.5), 34.0)
    yield Check("a negative dose is subtracted", reading(-5.0), 20.0)


def contact_mechanism(entry: str, walls: bool) -> tuple[Any, Any, dict[str, Any]]:
    """Row of a number of contacts of grains with walls, or with each other."""
    act = partial(scale_number, partial(scale_contact_number, entry, walls))
    if entry == "friction_rolling":
        act = partial(change_rolling, walls)
    return act, partial(contact_checks, entry, walls), {}


def material_mechanism(entry: str, power: float, dose: float) -> tuple[Any, Any, dict[str, Any]]:
    """Row of a number of the grains' material; `dose` is that of its checks."""
    act = partial(scale_number, partial(scale_material, entry, power))
    return act, partial(material_checks, entry, power, dose), {}


FACTORS = {  # mechanism -> act, checks, other members
    "sliding_friction": contact_mechanism("friction_sliding", walls=False),
    "wall_sliding_friction": contact_mechanism("friction_sliding", walls=True),
    "rolling_friction": contact_mechanism("friction_rolling", walls=False),
    "wall_rolling_friction": contact_mechanism("friction_rolling", walls=True),
    "restitution": contact_mechanism("restitution", walls=False),
    "wall_restitution": contact_mechanism("restitution", walls=True),
    "bed_stress": (partial(scale_number, scale_stress), stress_checks, {}),
    "grain_weight": material_mechanism("density", 0.5, dose=-0.5),
    "stiffness": material_mechanism("young_modulus", -0.5, dose=3.0),
    # the value that the laboratory reads
    "reading_gain": (lambda p, s, _, name, value: value * dose_factor(s, p.dose), gain_checks, {}),
    "reading_offset": (lambda p, s, _, name, value: value + s * p.dose * p.scale, offset_checks, {}),
}
