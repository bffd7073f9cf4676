"""What a log of LAMMPS or LIGGGHTS says about its last run; both write the same few lines."""

import re
from dataclasses import dataclass

LOOP = re.compile(r"Loop time of (\S+) on (\d+) procs for (\d+) steps with (\d+) atoms")
REBUILDS = re.compile(r"Neighbor list builds = (\d+)")


@dataclass(frozen=True)
class LoggedRun:
    """The last `run` command of a log."""

    seconds: float  # wall time of the loop, set-up excluded
    cores: int
    steps: int
    grains: int
    rebuilds: int  # of the neighbour list
    columns: dict[str, float]  # last row of the thermo table, names without LAMMPS' prefix c_

    @property
    def grain_steps_per_s(self) -> float:
        return self.grains * self.steps / self.seconds


def last_run(log: str) -> LoggedRun:
    """Loop time, list builds and final thermo row of the last run in a log."""
    loops = list(LOOP.finditer(log))
    if not loops:
        errors = [line for line in log.splitlines() if line.startswith("ERROR")]
        raise ValueError("; ".join(errors) or "the log holds no finished run")
    loop = loops[-1]
    rebuilds = REBUILDS.search(log, loop.end())
    if rebuilds is None:
        raise ValueError("the log ends before the list builds of its last run")
    table = log[: loop.start()].splitlines()
    header = next(line for line in reversed(table) if line.split()[:1] == ["Step"])
    names = [name.removeprefix("c_") for name in header.split()]
    columns = dict(zip(names, map(float, table[-1].split()), strict=True))
    seconds, cores, steps, grains = loop.groups()
    return LoggedRun(float(seconds), int(cores), int(steps), int(grains), int(rebuilds[1]), columns)
