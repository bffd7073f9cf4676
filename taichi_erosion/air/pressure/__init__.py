"""Pressure of the air: projection, conjugate gradients, multigrid."""
