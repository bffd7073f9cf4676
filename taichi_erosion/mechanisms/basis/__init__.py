"""Basis of mechanisms, one file each."""
