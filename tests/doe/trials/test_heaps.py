"""Laboratories that simulate: what is hidden in them, and how they differ from the study."""

import random
from collections import Counter
from math import exp, pi

import pytest

from doe.trials.heaps import OTHER_LAWS, SCENE, orders, surface_energy
from doe.trials.lammps import BEYOND, DIAMETERS, LAWS, grains_of
from taichi_erosion.execution.checks import read_scene
from taichi_erosion.grains.laws import jkr


@pytest.mark.parametrize(
    ("place", "wanted"),
    [(OTHER_LAWS, {"0": 3, "1": 5, "2": 2, "outside": 2}), (BEYOND, {"0": 4, "1": 4, "2": 2, "outside": 6})],
)
def test_every_set_hides_what_its_page_says(place, wanted):
    drawn = place.draw(random.Random(1))
    assert Counter("outside" if case["outside"] else str(len(case["effects"])) for case in drawn) == wanted
    assert [case["number"] for case in drawn] == list(range(len(drawn)))
    assert drawn != place.draw(random.Random(2))


def test_a_perturbed_laboratory_differs_from_the_study_in_every_law():
    study = read_scene(SCENE, ()).model_dump()
    for case in OTHER_LAWS.draw(random.Random(3)):
        scene = read_scene(SCENE, orders(case, 1.5e-3, 0.0, 0.0)).model_dump()
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


def test_laws_outside_the_list_change_what_the_truth_says_and_nothing_else():
    for case in BEYOND.draw(random.Random(4)):
        dry = grains_of(case, DIAMETERS[0], 0.0, 0.0)
        for at in ((2, 0.0, 0.0), (1, 0.015, 0.0), (1, 0.0, 1.0)) if case["outside"] else ():
            there = grains_of(case, at[0] * DIAMETERS[0], *at[1:])
            axis = ("diameter", "moisture", "angularity")[[at[0] == 2, *(x > 0 for x in at[1:])].index(True)]
            for number in ("sliding", "rolling"):
                factor = getattr(there, number) / getattr(dry, number)
                along = [ln for key, axis_of, ln in LAWS[case["outside"]] if (key, axis_of) == (number, axis)]
                assert factor == pytest.approx(exp(case["size"] * sum(along)))
            assert there.pull_d == dry.pull_d == there.spread == 0.0
        assert abs(abs(case["sliding"] / 0.52 - 1.0) - 0.1) < 0.01
        assert case["stiffness"] > 1.4
