"""The one place that imports Taichi; every kernel file takes `ti` from here."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

import taichi as ti
from taichi.lang import impl

__all__ = ["impl", "ti"]
