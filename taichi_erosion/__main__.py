"""`python -m taichi_erosion`."""

import sys

from taichi_erosion.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
