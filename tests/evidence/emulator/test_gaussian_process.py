"""Surfaces through scattered values: what they recover, how sure they say they are, where they are exact."""

from dataclasses import replace

import numpy as np

from taichi_erosion.evidence.emulator.emulator import strength_position
from taichi_erosion.evidence.emulator.gaussian_process import ActiveInputs, Points, fit_gaussian_process

READS = ActiveInputs(
    conditions=np.array([[True, False], [True, True], [True, False]]), numbers=np.ones((3, 2), bool)
)
SCATTER = 0.2


def strengths(points: Points) -> np.ndarray:
    """Strengths over the expected ones, from their places."""
    return 0.5 * np.sinh(0.5 * points.psi)


def law(points: Points) -> np.ndarray:
    """A value that bends in one number, with one effect that saturates and grows with a condition."""
    x, c, psi = points.x, points.c, strengths(points)
    acting = 1.5 * np.tanh(0.7 * psi[:, 0]) * (1.0 + 0.4 * c[:, 1])
    return 3.0 + 0.5 * x[:, 0] - 0.8 * x[:, 1] + 0.1 * x[:, 1] ** 2 + 0.3 * c[:, 0] + acting


def drawn(generator: np.random.Generator, count: int, effect: int | None) -> Points:
    psi = np.zeros((count, 2))
    if effect is not None:
        psi[:, effect] = strength_position(generator.uniform(0.3, 2.5, count))
    c = np.column_stack([generator.choice([-1.0, 1.0], count), generator.uniform(-1.5, 1.5, count)])
    return Points(generator.uniform(-2.0, 2.0, (count, 2)), c, psi)


def joined(*parts: Points) -> Points:
    return Points(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("x", "c", "psi")))


def test_a_number_of_an_effect_moves_nothing_without_it_and_is_learnt_with_it():
    own = replace(READS, numbers=np.array([[True, False], [True, True], [True, True]]))
    generator = np.random.default_rng(9)
    known = joined(drawn(generator, 40, None), drawn(generator, 40, 0))

    def world(points: Points) -> np.ndarray:
        return points.x[:, 0] + strengths(points)[:, 0] * (1.0 + 0.3 * points.x[:, 1])

    surface = fit_gaussian_process(known, world(known) + 0.1 * generator.standard_normal(80), own)
    bare, acting = drawn(generator, 30, None), drawn(generator, 30, 0)
    moved = Points(bare.x + np.array([0.0, 2.0]), bare.c * np.array([1.0, -3.0]), bare.psi)
    assert np.array_equal(surface.mean(bare), surface.mean(moved)), "nor does a condition that it alone reads"
    # 0.3 psi x reaches 1.5; a surface blind to the number would be off by 0.6 in the mean square
    assert np.sqrt(np.mean((surface.mean(acting) - world(acting)) ** 2)) < 0.2


def test_what_two_effects_do_together_is_learnt_from_runs_with_both():
    generator = np.random.default_rng(8)
    parts = [drawn(generator, 20, None), drawn(generator, 15, 0), drawn(generator, 15, 1)]
    both = drawn(generator, 20, 0)
    both.psi[:, 1] = strength_position(generator.uniform(0.3, 2.5, 20))
    asked = Points(both.x + 0.1, both.c, both.psi)

    def world(points: Points) -> np.ndarray:
        return law(points) - 0.5 * strengths(points).prod(axis=1)

    blind = fit_gaussian_process(joined(*parts), world(joined(*parts)), READS)
    seeing = fit_gaussian_process(joined(*parts, both), world(joined(*parts, both)), READS)
    errors = [np.sqrt(np.mean((surface.mean(asked) - world(asked)) ** 2)) for surface in (blind, seeing)]
    assert errors[1] < 0.3 * errors[0]


def curved(points: Points) -> np.ndarray:
    """A law that bends in every direction, and whose two effects hinder each other."""
    psi = strengths(points)
    return law(points) + 0.15 * points.x[:, 0] ** 2 - 0.1 * psi[:, 1] ** 2 - 0.2 * psi[:, 0] * psi[:, 1]


def test_a_curved_law_lies_within_the_stated_sd_as_often_as_it_should_and_is_surer_than_a_run():
    gaps: dict[str, list[np.ndarray]] = {"bare": [], "one": [], "two": []}
    misses = []
    for seed in range(12):
        generator = np.random.default_rng(100 + seed)
        known = joined(*(drawn(generator, count, k) for count, k in ((24, None), (12, 0), (12, 1))))
        runs = curved(known) + SCATTER * generator.standard_normal(known.x.shape[0])
        surface = fit_gaussian_process(known, runs, READS)
        asked = {name: drawn(generator, 40, k) for name, k in (("bare", None), ("one", 0), ("two", 0))}
        # far from any run: two effects were never tried
        asked["two"].psi[:, 1] = strength_position(generator.uniform(0.3, 2.5, 40))
        for name, points in asked.items():
            miss = surface.mean(points) - curved(points)
            gaps[name].append(miss / np.sqrt(np.diag(surface.error_cov(points))))
            misses.append(miss)
    # 90 % are wanted of 12 surfaces, whose own 40 errors hang together: about 60 independent ones, sd 4 %
    shares = {name: float(np.mean(np.abs(found) < 1.645)) for name, found in gaps.items()}
    assert all(0.78 < share <= 1.0 for share in shares.values()), shares
    assert min(np.sqrt(np.mean(np.square(found))) for found in gaps.values()) > 0.3, "no sd is far too large"
    bare, one = (np.sqrt(np.mean(np.square(misses[k::3]))) for k in (0, 1))
    assert bare < 0.8 * SCATTER
    assert one < 1.7 * SCATTER, "of which a quarter of the runs know"


def test_an_effect_that_saturates_is_predicted_within_the_stated_errors():
    """The pull of necks at 1.5 mm: ln of the height rises by 0.54 up to strength 1, and hardly beyond."""
    random, tried = np.random.default_rng(11), 0.3 + 2.7 * (np.arange(18) / 17.0) ** 1.5

    def along(strength: np.ndarray) -> Points:
        empty = np.zeros((strength.size, 0))
        return Points(empty, empty, strength_position(strength)[:, np.newaxis])

    def rise(strength: np.ndarray) -> np.ndarray:
        return 0.6 * (1.0 - np.exp(-strength / 0.42)) + 0.03 * strength

    asked, off = np.array([0.15, 0.6, 0.9, 1.2, 1.8, 2.4]), []
    nothing = ActiveInputs(np.zeros((2, 0), bool), np.zeros((2, 0), bool))
    for _ in range(8):
        known = np.concatenate([np.zeros(24), tried])
        values = rise(known) + 0.03 * random.standard_normal(known.size)
        process = fit_gaussian_process(along(known), values, nothing)
        sd = np.sqrt(np.diag(process.error_cov(along(asked))))
        off.append((process.mean(along(asked)) - rise(asked)) / sd)
    # 48 errors, of which six hang together: on strengths themselves the mean square is above 2
    assert np.sqrt(np.mean(np.square(off))) < 1.4


def test_what_a_surface_misses_of_an_effect_widens_it_there_and_not_the_bare_model():
    generator = np.random.default_rng(9)
    known = joined(drawn(generator, 40, None), drawn(generator, 40, 0))
    jumps = np.where(known.psi[:, 0] > 0.0, generator.choice([-1.0, 1.0], 80), 0.0)  # no smooth law at all
    surface = fit_gaussian_process(known, law(known) + jumps + 0.05 * generator.standard_normal(80), READS)
    bare, acting = drawn(generator, 30, None), drawn(generator, 30, 0)
    assert surface.lack_of_fit_sd(acting).mean() > 0.2
    assert surface.lack_of_fit_sd(bare).max() < 0.02
