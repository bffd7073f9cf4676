"""A misspelled name, or a part of one, is answered with the name that may have been meant."""

import pytest

from taichi_erosion.core.errors import did_you_mean, nearest
from taichi_erosion.scene.schema.grains import Contact

DOTTED = ["contact.sand-sand.friction_sliding", "contact.sand-sand.friction_rolling", "grains.count"]


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("restituton", "restitution"),
        ("friktion", "friction_sliding"),
        ("rolling", "friction_rolling"),
        ("energie", "surface_energy"),
        ("banana", None),
    ],
)
def test_the_name_that_is_near_as_a_whole_or_in_a_part(word, name):
    assert nearest(word, Contact.model_fields) == name


def test_the_parts_of_dotted_names_count():
    assert did_you_mean("rolling", DOTTED) == f"; did you mean {DOTTED[1]}?"
    assert did_you_mean("banana", DOTTED) == ""
