"""Mechanisms: places in the model at which something can be missing, without a claim about its cause."""
