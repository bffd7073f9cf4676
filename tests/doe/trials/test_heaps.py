"""Laboratories that simulate: what is hidden in them, and how they differ from the study."""

import random
from collections import Counter
from math import pi

import pytest

from doe.trials.heaps import OTHER_LAWS, SAME_LAWS, SCENE, orders, surface_energy
from doe.trials.lammps import DRAWN
from taichi_erosion.grains.laws import jkr
from taichi_erosion.run.checks import read_scene


def kinds(cases) -> Counter[str]:
    return Counter("outside" if case["outside"] else str(len(case["effects"])) for case in cases)


@pytest.mark.parametrize(
    ("place", "wanted"),
    [
        (SAME_LAWS, {"0": 6, "1": 12, "2": 4, "outside": 2}),
        (OTHER_LAWS, {"0": 3, "1": 5, "2": 2, "outside": 2}),
        (DRAWN, {"0": 4, "1": 8, "2": 2, "outside": 2}),
    ],
)
def test_every_set_hides_what_its_page_says(place, wanted):
    drawn = place.draw(random.Random(1))
    assert kinds(drawn) == wanted
    assert [case["number"] for case in drawn] == list(range(len(drawn)))
    assert drawn != place.draw(random.Random(2))


def test_a_perturbed_laboratory_differs_from_the_study_in_every_law():
    study = read_scene(SCENE, ()).model_dump()
    for case in OTHER_LAWS.draw(random.Random(3)):
        told = orders(case, 1.5e-3, 0.0, 0.0)
        scene = read_scene(SCENE, told).model_dump()
        for law in ("normal", "rolling", "friction_cap"):
            assert scene["laws"][law] != study["laws"][law]
        assert scene["run"]["time_step"] < 0.7 * study["run"]["time_step"]
        assert scene["fill"]["pitch"] > study["fill"]["pitch"]


def test_the_pull_of_jkr_is_the_stated_share_of_a_weight():
    diameter, share = 1.5e-3, 0.03
    weight = 2500.0 * 9.81 * pi / 6.0 * diameter**3
    pull = 3.0 * pi * surface_energy(share, diameter) * diameter / 4.0
    assert pull == pytest.approx(share * weight, rel=1e-12)
    assert "3 pi gamma R*" in (jkr.__doc__ or "")
