"""Setup of one replica from a scene: grains, walls, contacts, air, limits."""
