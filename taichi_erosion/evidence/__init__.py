"""Measured values beside a model: where it fails, and which effect would close the gap."""
