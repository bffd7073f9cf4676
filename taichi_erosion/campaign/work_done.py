"""Share of a campaign's work that is done, also within runs that have not ended.

A run's own limits of time are far above what it takes: a heap comes to rest long before. Its share is
therefore counted by time too. If ln T is normal with mean ln T_e and standard deviation s, a run that has
taken t without an end has done, on average over the possible T,

    E[t / T | T > t] = x exp(s^2 / 2) Phi(-(ln x + s^2) / s) / Phi(-ln x / s),    x = t / T_e

T_e is the work of its batch times the pace: seconds of one worker per grain-step, of the runs that have
ended. Before the first of them s is larger: the pace is then a usual one.
"""

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import erfc, exp, log, sqrt

from taichi_erosion.campaign.request import START, WORTH_A_START, RunRequest

GUESSED = 0.7  # sd of ln T before a run has ended: a factor of two to either side [1]
KNOWN = 0.3  # once runs have ended [1]
LONGEST = 5.0  # T / T_e beyond which a run counts as good as ended [1]


def pace(wanted: Mapping[str, RunRequest], done: Mapping[str, float]) -> float:
    """Seconds of one worker per unit of work, of runs that ended here; without any as fast as usual."""
    work = sum(wanted[key].work for key in done)
    spent = sum(done.values())
    return spent / work if work > 0.0 and spent > 0.0 else START / WORTH_A_START


def share_by_time(elapsed: float, spread: float) -> float:
    """Share of its work that a run has done after so many times its expected duration, not yet ended [1].

    `spread`: standard deviation of the logarithm of its duration.
    """
    if elapsed <= 0.0:
        return 0.0
    x = min(elapsed, LONGEST)
    return x * exp(0.5 * spread**2) * above(log(x) / spread + spread) / above(log(x) / spread)


def above(z: float) -> float:
    """Probability of a standard normal number above z."""
    return 0.5 * erfc(z / sqrt(2.0))


@dataclass
class WorkDone:
    """Work of a campaign: what there is, what has ended, and what is under way here."""

    wanted: Mapping[str, RunRequest]  # by key
    work: float  # grain-steps of the runs that did not stand in the ledger
    ended: dict[str, float]  # wall time [s] of runs that have ended
    limits: dict[str, float] = field(default_factory=dict)  # share of a run by its own limits of time [1]
    begun: dict[str, tuple[float, float]] = field(default_factory=dict)  # clock [s], work of the batch
    reported: float = 0.0  # largest share reported; a batch that ends between two polls does not take it back

    def begin(self, keys: Iterable[str]) -> None:
        """Runs start as one batch."""
        batch = list(keys)
        whole = sum(self.wanted[key].work for key in batch)
        self.begun |= dict.fromkeys(batch, (time.monotonic(), whole))

    def end(self, key: str, wall_s: float | None = None) -> None:
        """A run has ended, or is no longer under way."""
        self.limits.pop(key, None)
        self.begun.pop(key, None)
        if wall_s:
            self.ended[key] = wall_s

    def share(self, left: Iterable[str]) -> float:
        """Share that is done [1], given the runs that are left; never less than before."""
        now, second = time.monotonic(), pace(self.wanted, self.ended)
        rest = sum(self.wanted[key].work * (1.0 - self.share_of(key, now, second)) for key in left)
        self.reported = max(self.reported, 1.0 - rest / self.work if self.work else 1.0)
        return self.reported

    def share_of(self, key: str, now: float, second: float) -> float:
        """Share of a run that is done [1], by its own limits and by the time that it has taken."""
        start, whole = self.begun.get(key, (now, 0.0))
        by_time = share_by_time((now - start) / (START + second * whole), KNOWN if self.ended else GUESSED)
        return max(self.limits.get(key, 0.0), by_time)
