"""Sentences of the evidence commands: the only place where they are made."""
