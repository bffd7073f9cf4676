"""What a run loads before its first step, for which every start pays."""

import subprocess
import sys

DEAR = (
    "scipy.special",
    "scipy.ndimage",
    "scipy.spatial",
    "scipy.optimize",
    "scipy.stats",
    "rerun",
    "matplotlib",
)
QUESTION = f"""
import sys
import taichi_erosion.cli.main, taichi_erosion.run.ensemble_loop
print([name for name in {DEAR} if name in sys.modules])
"""


def test_a_run_loads_no_dear_library_before_it_needs_it():
    told = subprocess.run([sys.executable, "-c", QUESTION], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"
