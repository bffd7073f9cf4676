"""Thresholds and flux of one's own sand by one command, beside published formulas and a table."""
