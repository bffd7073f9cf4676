"""Factors of numbers of a scene, from a dose: shared by the mechanisms that multiply one number."""

from collections.abc import Callable

from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import with_section
from taichi_erosion.scene.schema.grains import Contact

Change = Callable[[Contact], Contact]

LEAST = 0.01  # smallest factor: a dose below -1 does not turn a sign [1]


def factor_of(strength: float, dose: float) -> float:
    """Factor 1 + strength dose, at least LEAST [1]."""
    return max(1.0 + strength * dose, LEAST)


def with_contact_factor(
    scene: Scene, number: str, factor: float, *, walls: bool, most: float = float("inf")
) -> Scene:
    """The scene with one number of contacts multiplied: those of grains with walls, or with each other."""

    def changed(contact: Contact) -> Contact:
        return contact.model_copy(update={number: min(factor * getattr(contact, number), most)})

    return with_chosen_contacts(scene, changed, walls=walls)


def with_chosen_contacts(scene: Scene, change: Change, *, walls: bool) -> Scene:
    """The scene with contacts of grains with walls changed, or those of grains with each other."""
    grain = scene.grains.material
    contacts = {
        pair: change(contact) if contact.acted_on and is_chosen(pair, grain, walls) else contact
        for pair, contact in scene.contact.items()
    }
    return scene.model_copy(update={"contact": contacts})


def with_rolling_factor(
    scene: Scene, strength: float, dose: float, reference: float, *, walls: bool
) -> Scene:
    """The scene with rolling friction times 1 + strength dose, or with strength dose reference where it is 0.

    The elastic-plastic law comes with it where the scene has none; its other contacts then roll freely.
    """
    if strength * dose == 0.0:
        return scene
    bare = scene.laws.rolling == "none"
    factor, added = factor_of(strength, dose), max(strength * dose, 0.0) * reference

    def rolling(contact: Contact) -> Contact:
        before = 0.0 if bare else contact.friction_rolling
        after = factor * before if before > 0.0 else added / contact.rolling_share
        return contact.model_copy(update={"friction_rolling": after})

    def free(contact: Contact) -> Contact:
        return contact.model_copy(update={"friction_rolling": 0.0})

    if bare:
        with_law = with_section(scene, "laws", rolling="elastic_plastic")
        scene = with_chosen_contacts(with_law, free, walls=not walls)
    return with_chosen_contacts(scene, rolling, walls=walls)


def is_chosen(pair: str, grain: str, walls: bool) -> bool:
    """Whether a pair of materials is a contact of grains with a wall, or with each other."""
    if pair == f"{grain}-{grain}":
        return not walls
    return walls and grain in pair.split("-")
