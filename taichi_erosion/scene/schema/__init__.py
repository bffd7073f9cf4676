"""Sections of a scene file as frozen records, each number with unit and range, each rule beside its field."""
