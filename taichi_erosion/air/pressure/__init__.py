"""Pressure."""
