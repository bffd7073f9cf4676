"""Soil wind erosion: grains, air, and the effects between them."""

__version__ = "0.1.0"
