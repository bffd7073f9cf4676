"""Errors that nobody stated, and answers repeated under changed assumptions."""
