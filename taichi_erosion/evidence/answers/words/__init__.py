"""Sentences that commands, last lines and pages share; they load no other room."""
