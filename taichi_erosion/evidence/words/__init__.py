"""Sentences of the evidence commands: the only place where they are made; commands as the user types them."""

import os
import shlex

NAME_SWITCH = "TAICHI_EROSION_NAME"  # environment variable: set by the launcher


def shell_command(*words: object) -> str:
    """A command in backquotes, as the user called the program and as a shell takes its words."""
    program = "./erosion" if NAME_SWITCH in os.environ else "taichi-erosion"
    return f"`{program} {shlex.join(map(str, words))}`"
