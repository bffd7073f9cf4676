"""Vocabulary shared by every room: units, device set-up, what one replica holds, snapshots."""
