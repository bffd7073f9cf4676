"""Designs, analysis of variance and response surfaces; statistics that never saw a simulation.

`design` (factors, runs, CSV, the designs offered), `fit` (terms of a model and its quality), `anova`
(significance, effects, reduction), `optimise`, `confirm`; `published` and `audit` check published tables.
"""
