"""Sealed cases on scenes: where truths lie, and the word on an answer."""

import json
import random
from collections.abc import Sequence
from pathlib import Path

import pytest

from doe.sealed.studies import Case, SealedSet, judged, make, opened, seal, truth_file
from taichi_erosion.core.errors import BadInput

WATER, ROLLING = "liquid_bridge", "rolling_resistance"


def draw(generator: random.Random) -> list[Case]:
    return [{"number": 0, "effects": {WATER: generator.random()}, "outside": None}]


def sealed_set(folder: Path, measured: list[tuple[Sequence[Case], int]]) -> SealedSet:
    return SealedSet(folder / "work", folder, draw, lambda cases, seed: measured.append((cases, seed)))


def test_truths_lie_outside_and_every_set_has_its_own(tmp_path):
    place = sealed_set(tmp_path, [])
    first, second = tmp_path / "first", tmp_path / "second"
    seal(place, first)
    digest = place.digest.read_text()
    seal(place, second)
    assert place.digest.read_text() != digest
    assert opened(place, second)[0] != json.loads(truth_file(first).read_text())["cases"]
    with pytest.raises(BadInput, match="not the ones that were sealed"):
        opened(place, first)
    with pytest.raises(BadInput, match="drawn already"):
        seal(place, second)


def test_laboratories_are_measured_with_another_seed_than_drew_them(tmp_path):
    measured: list[tuple[Sequence[Case], int]] = []
    place, secret = sealed_set(tmp_path, measured), tmp_path / "secret"
    seal(place, secret)
    make(place, secret)
    cases, seed = opened(place, secret)
    assert measured == [(cases, seed + 1)]
    assert not any("seed" in path.name or path.suffix == ".json" for path in place.folder.rglob("*"))


@pytest.mark.parametrize(
    ("effects", "verdict", "named", "group", "word"),
    [
        ((), "none_detected", (), (), "right"),
        ((), "present", (WATER,), (), "false alarm"),
        ((), "outside_library", (), (), "false alarm"),
        ((WATER,), "present", (WATER,), (), "right"),
        ((WATER,), "group", (), (WATER, ROLLING), "in the group"),
        ((WATER,), "present", (WATER, ROLLING), (), "partly"),
        ((WATER,), "present", (ROLLING,), (), "wrong"),
        ((WATER,), "outside_library", (), (), "wrong"),
        ((WATER,), "none_detected", (), (), "silent"),
        ((WATER, ROLLING), "present", (WATER, ROLLING), (), "right"),
        ((WATER, ROLLING), "present", (WATER,), (), "partly"),
        ((WATER, ROLLING), "group", (WATER,), (ROLLING, "dry_adhesion"), "in the group"),
    ],
)
def test_a_group_or_a_superset_is_not_the_exact_name(effects, verdict, named, group, word):
    case: Case = {"effects": dict.fromkeys(effects, 1.0), "outside": None}
    assert judged(case, verdict, set(named), set(group)) == word


@pytest.mark.parametrize(
    ("verdict", "named", "word"),
    [("outside_library", (), "right"), ("none_detected", (), "silent"), ("present", (WATER,), "wrong")],
)
def test_what_no_candidate_describes_is_told_as_such(verdict, named, word):
    case: Case = {"effects": {}, "outside": "restitution that falls with moisture"}
    assert judged(case, verdict, set(named), set()) == word
