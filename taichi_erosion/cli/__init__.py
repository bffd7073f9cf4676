"""Words typed in a terminal: each command is one call into the rooms below."""
