"""Designs, analysis of variance and response surfaces; statistics that never saw a simulation.

- A design: `table` (factors, coded and natural units), `design` (the named ones), `generate` (their points),
  `optimal` (runs to add), `design_file` (CSV), `aliases` (what it cannot tell apart).
- Its analysis: `terms`, `fit`, `anova`, `quality`, `effects`, `reduce`, `equation`.
- What to do next: `desirability`, `optimise`, `confirm`.
- What is wrong with a published table: `audit`.
"""
