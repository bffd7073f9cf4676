import numpy as np
from recorded_heaps import MOVING, heap_snapshot, moved

from taichi_erosion.recording.static_grains import (
    CREEP,
    REWRITE_INTERVAL,
    StaticGrains,
    is_static,
    update_static_grains,
)

FALLING = len(heap_snapshot().ident) - 1  # row of the grain in the air


def settled() -> StaticGrains:
    """The bed of the heap while its last grain falls."""
    static_grains, is_new = update_static_grains(StaticGrains.empty(), heap_snapshot(3), MOVING)
    assert is_new
    return static_grains


def test_the_first_bed_holds_every_grain_but_the_falling_one():
    assert settled().ident.tolist() == list(range(FALLING))


def test_a_heap_at_rest_is_not_written_again_until_its_turn():
    static_grains, written = settled(), []
    for _ in range(REWRITE_INTERVAL):
        static_grains, is_new = update_static_grains(static_grains, heap_snapshot(3), MOVING)
        written.append(is_new)
    assert written == [False] * (REWRITE_INTERVAL - 1) + [True]


def test_a_grain_that_starts_to_move_leaves_the_bed_at_once():
    static_grains, is_new = update_static_grains(
        settled(), moved(heap_snapshot(3), 7, speed=2.0 * MOVING), MOVING
    )
    assert is_new
    assert 7 not in static_grains.ident


def test_a_grain_that_creeps_slowly_leaves_the_bed_once_it_has_gone_far():
    radius = heap_snapshot().radius[7]
    near, _ = update_static_grains(
        settled(), moved(heap_snapshot(3), 7, distance=0.9 * CREEP * radius), MOVING
    )
    far, _ = update_static_grains(
        settled(), moved(heap_snapshot(3), 7, distance=1.1 * CREEP * radius), MOVING
    )
    assert 7 in near.ident
    assert 7 not in far.ident


def test_a_grain_that_came_to_rest_stays_mobile_until_the_bed_is_due():
    static_grains = settled()
    landed = moved(heap_snapshot(0), FALLING)
    for _ in range(REWRITE_INTERVAL - 1):
        static_grains, _ = update_static_grains(static_grains, landed, MOVING)
        assert not is_static(static_grains, landed)[FALLING]
    static_grains, _ = update_static_grains(static_grains, landed, MOVING)
    assert is_static(static_grains, landed)[FALLING]


def test_grains_that_are_released_later_do_not_disturb_the_bed():
    full = heap_snapshot(3)
    names = ("position", "velocity", "spin", "radius", "mass", "contacts", "ident")
    first = type(full)(**{**vars(full), **{name: getattr(full, name)[:50] for name in names}})
    static_grains, _ = update_static_grains(StaticGrains.empty(), first, MOVING)
    static_grains, is_new = update_static_grains(static_grains, full, MOVING)
    assert not is_new
    np.testing.assert_array_equal(np.flatnonzero(is_static(static_grains, full)), np.arange(50))
