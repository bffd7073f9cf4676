"""Mechanisms that act like what is missing: their doses under every condition, and the law of the doses."""
