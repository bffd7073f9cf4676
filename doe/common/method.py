"""The method that a table of results was made with."""

import subprocess
from pathlib import Path


def method_commit() -> str:
    """Commit that answers, with a mark where the tree differs from it."""
    words = ["git", "describe", "--always", "--dirty", "--abbrev=10", "--exclude=*"]
    done = subprocess.run(words, cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
    return done.stdout.strip()
