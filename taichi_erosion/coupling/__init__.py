"""Air felt by grains, and grains felt by air."""
