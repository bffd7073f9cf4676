"""Optional physics, one effect per file."""
