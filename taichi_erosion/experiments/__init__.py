"""Designs, analysis of variance and response surfaces; statistics that never saw a simulation."""
