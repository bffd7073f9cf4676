"""Speed: grain-steps per second of standard cases, with the time split by stage.

Times are wall times of one sitting: only ratios taken side by side carry over to another machine.
"""

from taichi_erosion.benchmark.cases import run_benchmarks
from taichi_erosion.benchmark.rates import bed_rate, funnel_rate

__all__ = ["bed_rate", "funnel_rate", "run_benchmarks"]
