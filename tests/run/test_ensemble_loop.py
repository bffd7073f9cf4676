"""What a command loads, for which every start pays."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DEAR = ["scipy." + name for name in ("special", "ndimage", "spatial", "optimize", "stats")]
DEAR += ["rerun", "matplotlib"]
HEAVY = ["taichi", "rerun", "statsmodels", "scipy", "matplotlib", "numpy"]
QUESTION = """
import sys
from taichi_erosion.cli.main import main
{code}
print([name for name in {forbidden} if name in sys.modules], file=sys.stderr)
"""


@pytest.mark.parametrize(
    ("code", "forbidden", "printed"),
    [
        ("main(['run', '--help'])", HEAVY, "--set"),
        ("main(['run', 'scenes/incline.toml', '--check'])", ["taichi"], "valid"),
        ("import taichi_erosion.run.ensemble_loop", DEAR, ""),
    ],
    ids=["help", "check", "run before its first step"],
)
def test_no_dear_library_is_loaded_before_it_is_needed(code, forbidden, printed):
    words = [sys.executable, "-c", QUESTION.format(code=code, forbidden=forbidden)]
    told = subprocess.run(words, capture_output=True, text=True, check=True, cwd=ROOT)
    assert printed in told.stdout
    assert told.stderr == "[]\n"
