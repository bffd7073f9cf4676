"""Intervals of calibrated numbers and strengths, averaged over all explanations of the measurements."""
