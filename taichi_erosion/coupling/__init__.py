"""The air felt by grains, and the grains felt by air."""
