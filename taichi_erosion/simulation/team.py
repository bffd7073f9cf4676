"""Team size: how many workers share a replica while other programs use the cores.

Workers of a team wait for each other at every step. A worker that waits for a core keeps its team waiting, so
on a busy machine a team can be slower than one worker alone. With x the share of time in which a team of s
workers is not complete, it does s (1 - x) times the work of one worker, and one of s - 1 does s - 1 times: a
worker is left out where x > 1 / s. x is seen as processor time that launches did not get.

A worker comes back once a core has been idle for a while, which doubles each time that it was too early. Idle
cores are read from /proc/stat. Where none is seen, a larger team is tried from time to time, ever less often:
a core may be busy with programs of low priority. Partitions of a replica belong to it and not to workers, so
no size changes a result.
"""

import os
import time
from dataclasses import dataclass, field
from pathlib import Path

WINDOW = 0.2  # s of launches after which a team is judged
LOST_MOST = 0.1  # s of a core that a window may lose before it is judged early
LOOK = 0.1  # s between two looks at idle cores, whose times are kept in hundredths
IDLE_MARGIN = 0.1  # share of a core by which idle cores exceed what a larger team needs [1]
IDLE_MOST = 0.95  # idle share of a core that counts as a whole one [1]
WAIT_LEAST, WAIT_MOST = 0.2, 60.0  # s that a core is idle before a worker comes back
TRIAL_LEAST = 2.0  # s, up to WAIT_MOST, that a larger team is tried after without an idle core
RELAPSE = 1.0  # s within which a team that shrinks again has grown too early
SPINS = 100_000  # of a wait for a partner, about a millisecond: longer than a step differs between partners
SPIN_SECONDS = 1e-8  # of one spin, by order of magnitude
CPU_TIMES = Path("/proc/stat")
IDLE_COLUMNS = (4, 5)  # idle, and idle while a disk works


def idle_seconds() -> float | None:
    """Time that all usable cores together have been idle since the machine started [s]; None if unknown."""
    try:
        usable = {f"cpu{core}" for core in os.sched_getaffinity(0)}
        rows = [line.split() for line in CPU_TIMES.read_text(encoding="ascii").splitlines()]
        ticks = sum(int(row[k]) for row in rows if row[0] in usable for k in IDLE_COLUMNS)
        return ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return None


@dataclass
class IdleWatch:
    """How long enough cores have been idle since a team shrank."""

    begun: float = 0.0  # s
    time: float = 0.0  # of the last look [s]
    seconds: float | None = None  # idle time of all cores then
    lasted: float = 0.0  # s

    def look(self, now: float, wanted: float) -> float:
        """Idle cores since the last look, at least LOOK ago; `wanted` of them must last."""
        passed = now - self.time
        if passed < LOOK:
            return 0.0
        seconds, before = idle_seconds(), self.seconds
        self.time, self.seconds = now, seconds
        idle = 0.0 if before is None or seconds is None else (seconds - before) / passed
        self.lasted = self.lasted + passed if idle >= wanted else 0.0
        return idle


@dataclass
class Team:
    """Workers that are left out of every team, and what decides on it."""

    left_out: int = 0
    adapts: bool = True
    wall: float = 0.0  # s of launches since the last judgement
    used: float = 0.0  # processor time of them [s]
    delayed: bool = False  # whether a worker came late in one of them
    grown: float = -WAIT_MOST  # when a worker came back last [s]
    saw_idle: bool = False  # whether it came back to an idle core
    wait: float = WAIT_LEAST  # s that a core is to be idle
    trial: float = TRIAL_LEAST  # s until a trial without an idle core
    idle: IdleWatch = field(default_factory=IdleWatch)
    worker_seconds: float = 0.0  # of all launches
    seconds: float = 0.0  # of all launches


def mean_threads(team: Team) -> dict[str, float]:
    """Mean number of workers of all teams, by its name in a result; nothing where no team could run."""
    return {"threads_mean": round(team.worker_seconds / team.seconds, 2)} if team.seconds else {}


def team_size(team: Team, most: int) -> int:
    """Workers of a team of the coming launch, of which there are at most `most`."""
    return max(most - team.left_out, 1)


def spins_most(pace: float) -> int:
    """Spins at a barrier of a step after which a partner counts as late, at `pace` steps a second."""
    half_step = 0.5 / (pace * SPIN_SECONDS) if pace > 0.0 else 0.0
    return int(min(max(SPINS, half_step), 2**30))


def note_launch(team: Team, teams: int, size: int, wall: float, used: float) -> None:
    """Add a launch of so many teams of `size` workers, its time and processor time [s]."""
    team.worker_seconds += wall * size * teams
    team.seconds += wall
    team.wall += wall
    team.used += used


def judge(team: Team, teams: int, size: int, most: int, late: bool) -> None:
    """Leave a worker out of every team, or take some back, by what the last launches got of the cores."""
    now = time.perf_counter()
    team.left_out = min(team.left_out, most - 1)
    team.delayed |= late
    lost = teams * size * team.wall - team.used
    if size > 1 and (team.wall >= WINDOW or lost >= LOST_MOST * teams):
        if team.delayed and lost * size > teams * team.wall:
            shrink(team, now, min(max(round(lost / (teams * team.wall)), 1), size - 1))
        team.wall, team.used, team.delayed = 0.0, 0.0, False
    if 0 < team.left_out and size < most:
        grow(team, teams, size, now)


def shrink(team: Team, now: float, fewer: int) -> None:
    """Leave so many more workers out; they come back later where the last one came back too early."""
    relapse = now - team.grown < RELAPSE
    if not relapse:
        team.wait, team.trial = WAIT_LEAST, TRIAL_LEAST
    elif team.saw_idle:
        team.wait = min(2.0 * team.wait, WAIT_MOST)
    else:
        team.trial = min(2.0 * team.trial, WAIT_MOST)
    team.left_out += fewer
    team.idle = IdleWatch(now, now, idle_seconds())


def grow(team: Team, teams: int, size: int, now: float) -> None:
    """Take workers back where cores have been idle for long enough."""
    wanted = teams * min(size / (size + 1) + IDLE_MARGIN, IDLE_MOST)
    idle = team.idle.look(now, wanted)
    team.saw_idle = team.idle.lasted >= team.wait
    if team.saw_idle or now - team.idle.begun >= team.trial:
        team.left_out = max(team.left_out - max(int(idle / teams + 1.0 - IDLE_MOST), 1), 0)
        team.grown = now
        team.idle = IdleWatch(now, now, idle_seconds())
        team.wall, team.used, team.delayed = 0.0, 0.0, False
