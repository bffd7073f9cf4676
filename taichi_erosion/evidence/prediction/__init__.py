"""Predictions of a calibrated model at new conditions, with intervals that hold what is uncertain."""
