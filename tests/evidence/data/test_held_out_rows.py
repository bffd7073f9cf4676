"""The vault: what is held out follows from the table alone, and every look into it is counted."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from doe.trials.reduced.laboratory import Readings, table_of
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.held_out_rows import count_opening, draw_vault, table_digest, vault_openings
from taichi_erosion.evidence.data.problem import Measurements

OBSERVABLES = ("repose_angle", "pile_height")


def measurements(groups: int = 20, group: str | None = None, repeats: int = 1) -> Measurements:
    """Two observables under `groups` moistures, each moisture a group of its own unless one is named."""
    k = np.repeat(np.arange(groups), repeats)
    names = tuple(group or f"heap {each}" for each in k)
    parts = zip(OBSERVABLES, np.split(np.linspace(20.0, 30.0, 2 * k.size), 2), strict=True)
    return table_of([Readings(o, {"moisture": 0.001 * k}, v, np.ones(k.size), names) for o, v in parts])


def held_out(table: Measurements, fraction: float = 0.3, **ranges) -> set[tuple[str, float]]:
    rows, _ = draw_vault(table, fraction, ranges)
    return {(table.observable[i], float(table.conditions["moisture"][i])) for i in rows}


def test_of_every_observable_the_fraction_is_held_out_in_whole_groups():
    counts = Counter(observable for observable, _ in held_out(measurements(20)))
    assert counts == {"repose_angle": 6, "pile_height": 6}
    table = measurements(20, repeats=3)
    hidden, _ = draw_vault(table, 0.3, {})
    assert not {table.group[i] for i in hidden} & set(np.delete(table.group, hidden))


@pytest.mark.parametrize(("least", "hidden"), [(0, 4), (12, 4), (14, 2), (16, 0), (99, 0)])
def test_enough_conditions_stay_visible_to_tell_effects_apart(least, hidden):
    assert draw_vault(measurements(8), 0.3, {}, least=least)[0].size == hidden
    soils = replace(measurements(8), group=("loess", "sand") * 8)  # of which one has numbers of its own
    assert draw_vault(soils, 0.3, {}, least=max(least, 1) - 1)[0].size == hidden


@pytest.mark.parametrize("first", np.linspace(20.0, 29.0, 8))
def test_the_only_moist_heaps_are_never_all_held_out(first):
    table = measurements(8)
    wet = np.array([float(name in ("heap 3", "heap 6")) for name in table.group])
    table = replace(table, value=np.linspace(first, 30.0, table.size), conditions={"moisture": 0.01 * wet})
    hidden, _ = draw_vault(table, 0.4, {})
    assert len(hidden) == 6  # 0.4 of eight heaps, for both observables
    assert np.delete(wet, hidden).any()


@pytest.mark.parametrize("first", np.linspace(20.0, 29.0, 8))
def test_heaps_at_the_ends_of_a_condition_are_held_out_last(first):
    table = replace(measurements(8), value=np.linspace(first, 30.0, 16))
    assert not {0.0, 0.007} & {w for _, w in held_out(table)}


def test_with_too_few_groups_what_was_measured_together_is_held_out_together():
    table = measurements(10, group="collapse")
    hidden = held_out(table)
    assert len(hidden) == 6
    assert {w for o, w in hidden if o == "repose_angle"} == {w for o, w in hidden if o == "pile_height"}
    assert "too few groups" in draw_vault(table, 0.3, {})[1]


def test_neither_the_order_of_rows_nor_a_second_try_moves_the_split():
    table = measurements(20)
    shuffled = table.pick_rows_at(np.random.default_rng(1).permutation(table.size))
    assert held_out(table) == held_out(table) == held_out(shuffled)
    assert table_digest(table) == table_digest(shuffled)


def test_a_named_range_is_held_out_beside_the_fraction_of_the_rest():
    hidden = held_out(measurements(20), moisture=(0.0145, 1.0))
    assert {w for _, w in hidden if w > 0.0145} == {0.001 * k for k in range(15, 20)}
    assert len(hidden) == 2 * 5 + 2 * round(0.3 * 15)


def test_every_opening_is_counted_for_its_own_table_and_a_damaged_count_is_told(tmp_path):
    assert vault_openings(tmp_path, "a") == 0
    assert [count_opening(tmp_path, "a", effect) for effect in ("x", "y")] == [1, 2]
    assert (vault_openings(tmp_path, "a"), vault_openings(tmp_path, "b")) == (2, 0)
    (tmp_path / "vault.json").write_text("[", encoding="utf-8")
    with pytest.raises(BadInput, match="damaged"):
        vault_openings(tmp_path, "a")


@pytest.mark.parametrize("first", np.linspace(20.0, 29.0, 8))
def test_water_is_seen_at_both_sizes_of_grains(first):
    table = measurements(6, group="one")
    moisture, diameter = np.tile([0.0, 0.01, 0.02], 4), np.tile(np.repeat([1.5e-3, 3e-3], 3), 2)
    value = np.linspace(first, 30.0, table.size)
    table = replace(table, value=value, conditions={"moisture": moisture, "diameter": diameter})
    hidden, _ = draw_vault(table, 0.3, {})
    assert len(hidden) == 4  # 0.3 of six heaps, for both observables
    seen = np.delete(np.arange(table.size), hidden)
    for size in (1.5e-3, 3e-3):
        assert np.unique(moisture[seen][diameter[seen] == size]).size == 2


@pytest.mark.parametrize(
    ("fraction", "words"),
    [
        (0.0, "10 of 40 rows are held out: all rows of theirs."),
        (0.4, "22 of 40 rows are held out: 6 groups, and all rows of theirs."),  # 0.4 of the 15 others
    ],
)
def test_a_source_is_held_out_whole_beside_the_fraction_of_the_others(fraction, words):
    table = measurements(20)
    made = ["theirs" if int(name.split()[1]) < 5 else "ours" for name in table.group]
    hidden, told = draw_vault(replace(table, source=tuple(made)), fraction, {}, sources=("theirs",))
    assert set(np.flatnonzero(np.array(made) == "theirs")) <= set(hidden)
    assert told == words
