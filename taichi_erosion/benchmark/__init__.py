"""Speed: grain-steps per second of standard cases, with the time split by stage.

Times are wall times of one sitting: only ratios taken side by side carry over to another machine.
"""

from taichi_erosion.benchmark.cases import run_benchmarks
from taichi_erosion.benchmark.rates import bed_window, funnel_window, numerics, touching_pairs, window_rate
from taichi_erosion.benchmark.setups import LAWS, bed_setup

__all__ = [
    "LAWS",
    "bed_setup",
    "bed_window",
    "funnel_window",
    "numerics",
    "run_benchmarks",
    "touching_pairs",
    "window_rate",
]
