"""Answers of the race to the commands on a study."""
