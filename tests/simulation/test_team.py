"""Sizes of teams: a worker is left out where it costs more than it gives, and is tried again."""

import pytest

from taichi_erosion.simulation import team as module
from taichi_erosion.simulation.team import Team, adapt_team_size, most_barrier_spins, record_launch, team_size

LAUNCH = 0.22  # s, beyond the window of a judgement


class Machine:
    """Cores with a clock, on which launches of one team run."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.team = 100.0, Team()
        monkeypatch.setattr(module.time, "perf_counter", lambda: self.now)

    def launches(self, seconds: float, free: float, most: int = 2, late: bool = True) -> None:
        """Launches for a time while `free` cores are to be had."""
        for _ in range(round(seconds / LAUNCH)):
            size = team_size(self.team, most)
            self.now += LAUNCH
            record_launch(self.team, 1, size, LAUNCH, LAUNCH * min(size, free))
            adapt_team_size(self.team, 1, size, most, late and size > free)


@pytest.mark.parametrize(
    ("seconds", "free", "late", "left_out"),
    [
        (10.0, 2.0, True, 0),  # every worker has a core
        (10.0, 1.0, False, 0),  # they end early because their share is done
        # two that are complete for the share free - 1 of the time do 2 (free - 1) of what one does: 1.2, 0.8
        *((LAUNCH, free, True, left_out) for free, left_out in ((1.6, 0), (1.4, 1), (1.0, 1), (0.2, 1))),
    ],
)
def test_a_worker_is_left_out_where_two_do_less_than_one(seconds, free, late, left_out, monkeypatch):
    machine = Machine(monkeypatch)
    machine.launches(seconds, free, late=late)
    assert machine.team.absent == left_out


def test_many_workers_are_left_out_at_once(monkeypatch):
    machine = Machine(monkeypatch)
    machine.launches(LAUNCH, free=9.0, most=16)
    assert team_size(machine.team, 16) == 9
    machine.launches(10.0, free=16.0, most=16)
    assert team_size(machine.team, 16) == 16


def test_a_program_that_comes_and_goes_is_met_less_and_less_often(monkeypatch):
    machine, met = Machine(monkeypatch), []
    for _ in range(60):  # the program leaves both cores for 0.5 s, then takes one for 0.5 s
        machine.launches(0.5, free=2.0)
        met.append(machine.team.absent == 0)
        machine.launches(0.5, free=1.0)
    assert 2 <= sum(met[:30]) <= 10
    assert sum(met[30:]) <= 2


def test_larger_teams_are_tried_less_and_less_often_and_come_back_for_good(monkeypatch):
    machine = Machine(monkeypatch)
    sizes = []
    for _ in range(round(600.0 / LAUNCH)):
        machine.launches(LAUNCH, free=1.0)
        sizes.append(machine.team.absent == 0)
    # after 1/2, 1, 2, 4, 8, 16, 32, then every 60 s of ten minutes
    assert 14 <= sum(sizes) <= 18
    machine.launches(module.WAIT_MOST + 1.0, free=2.0)
    assert machine.team.absent == 0


def test_a_result_says_how_many_threads_were_at_work(monkeypatch):
    machine = Machine(monkeypatch)
    assert module.mean_team_size(machine.team) == {}
    machine.launches(4 * LAUNCH, free=1.0)
    assert module.mean_team_size(machine.team) == {"threads_mean": 1.25}  # two in the first of four launches


def test_a_partner_is_late_after_a_millisecond_or_half_a_step():
    assert most_barrier_spins(0.0) == most_barrier_spins(1e4) == module.SPINS
    assert most_barrier_spins(10.0) == pytest.approx(0.05 / module.SPIN_SECONDS)
