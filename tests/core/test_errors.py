"""A misspelled name, or a part of one, is answered with the name that may have been meant."""

from taichi_erosion.core.errors import did_you_mean, nearest_word
from taichi_erosion.scene.schema.grains import Contact

DOTTED = ["contact.sand-sand.friction_sliding", "contact.sand-sand.friction_rolling", "grains.count"]


def test_the_name_that_is_near_as_a_whole_or_in_a_part():
    near = {"restituton": "restitution", "friktion": "friction_sliding", "rolling": "friction_rolling"}
    near |= {"energie": "surface_energy", "banana": None}
    assert {word: nearest_word(word, Contact.model_fields) for word in near} == near
    assert did_you_mean("rolling", DOTTED) == f"; did you mean {DOTTED[1]}?"
    assert did_you_mean("banana", DOTTED) == ""
