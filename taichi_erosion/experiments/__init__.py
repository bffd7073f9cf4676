"""Designs, analysis of variance and response surfaces; statistics that never saw a simulation.

`design_table` (factors, runs, CSV), `design` (the designs offered), `terms` and `fit` (the model and its
quality), `anova` (significance, effects, reduction), `optimise`, `confirm`; `audit/` checks published tables.
"""
