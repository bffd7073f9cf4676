"""Fills the tables of the page on speed: `python docs/bench.py`, on a machine that does nothing else."""

from pathlib import Path

from taichi_erosion.benchmark import run_benchmarks
from taichi_erosion.report.speed import publish

if __name__ == "__main__":
    publish(run_benchmarks(), Path(__file__).resolve().parent)
