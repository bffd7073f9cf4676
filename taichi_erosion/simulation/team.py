"""Team size: how many workers share a replica while other programs use the cores.

Workers of a team wait for each other at every step. A worker that waits for a core keeps its team waiting, so
on a busy machine a team can be slower than one worker alone. With x the share of time in which a team of s
workers is not complete, it does s (1 - x) times the work of one worker, and one of s - 1 does s - 1 times: a
worker is left out where x > 1 / s. x is seen as processor time that launches did not get.

After a while half of those that are left out come back. Where they leave again at once, the while doubles.
Partitions of a replica belong to it and not to workers, so no size changes a result.
"""

import time
from dataclasses import dataclass

WINDOW = 0.2  # s of launches after which a team is judged
LOST_MOST = 0.1  # s of a core that a window may lose before it is judged early
WAIT_LEAST, WAIT_MOST = 0.5, 60.0  # s before a larger team is tried
RELAPSE = 1.0  # s within which a team that shrinks again has grown too early
SPINS = 100_000  # of a wait for a partner, about a millisecond: longer than a step differs between partners
SPIN_SECONDS = 1e-8  # of one spin, by order of magnitude


@dataclass
class Team:
    """Workers that are left out of every team, and what decides on it."""

    absent: int = 0
    adapts: bool = True
    wall: float = 0.0  # s of launches since the last judgement
    processor_time: float = 0.0  # processor time of them [s]
    has_late_worker: bool = False  # whether a worker came late in one of them
    shrink_time: float = 0.0  # when a worker was left out last [s]
    growth_time: float = -WAIT_MOST  # when a worker came back last [s]
    wait: float = WAIT_LEAST  # s before a larger team is tried
    worker_seconds: float = 0.0  # of all launches
    seconds: float = 0.0  # of all launches


def mean_team_size(team: Team) -> dict[str, float]:
    """Mean number of workers of all teams, by its name in a result; nothing where no team could run."""
    return {"threads_mean": round(team.worker_seconds / team.seconds, 2)} if team.seconds else {}


def team_size(team: Team, most: int) -> int:
    """Workers of a team of the coming launch, of which there are at most `most`."""
    return max(most - team.absent, 1)


def most_barrier_spins(pace: float) -> int:
    """Spins at a barrier of a step after which a partner counts as late, at `pace` steps a second."""
    half_step = 0.5 / (pace * SPIN_SECONDS) if pace > 0.0 else 0.0
    return int(min(max(SPINS, half_step), 2**30))


def record_launch(team: Team, teams: int, size: int, wall: float, processor_time: float) -> None:
    """Add a launch of so many teams of `size` workers, its time and processor time [s]."""
    team.worker_seconds += wall * size * teams
    team.seconds += wall
    team.wall += wall
    team.processor_time += processor_time


def adapt_team_size(team: Team, teams: int, size: int, most: int, late: bool) -> None:
    """Leave a worker out of every team, or take some back, by what the last launches got of the cores."""
    now = time.perf_counter()
    team.absent = min(team.absent, most - 1)
    team.has_late_worker |= late
    idle = teams * size * team.wall - team.processor_time
    if size > 1 and (team.wall >= WINDOW or idle >= LOST_MOST * teams):
        if team.has_late_worker and idle * size > teams * team.wall:
            # those left out come back later where the last one came back too early
            team.wait = min(2.0 * team.wait, WAIT_MOST) if now - team.growth_time < RELAPSE else WAIT_LEAST
            team.absent += min(max(round(idle / (teams * team.wall)), 1), size - 1)
            team.shrink_time = now
        reset_launch_window(team)
    if 0 < team.absent and size < most and now - max(team.shrink_time, team.growth_time) >= team.wait:
        team.absent //= 2
        team.growth_time = now
        reset_launch_window(team)


def reset_launch_window(team: Team) -> None:
    """Forget the launches that have been judged."""
    team.wall, team.processor_time, team.has_late_worker = 0.0, 0.0, False
