"""The two ways a command ends badly."""


class BadInput(Exception):
    """The user's words or files cannot be used; one line says what, where, what is allowed (exit code 2)."""


class SimulationStopped(Exception):
    """A guard ended the simulation; one line names the grains, the time, the likely cause (exit code 3)."""
