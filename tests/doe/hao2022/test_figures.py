"""Figures of the published study."""

import numpy as np

from doe.hao2022.figures import half_normal_scores


def test_half_normal_scores_of_noise_lie_on_a_line():
    sizes = np.sort(np.abs(np.random.default_rng(3).normal(size=2000)))
    # the largest of 2000 scatters most; without the last percent the order statistics are within 0.1
    assert np.max(np.abs(sizes - half_normal_scores(2000))[:1980]) < 0.1
