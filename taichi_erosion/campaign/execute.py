"""Which runs go together as one batch.

A free worker takes 1/W of what is left of one group (guided self-scheduling): long batches first, where the
start of an ensemble costs little, short ones at the end, so that all workers finish together. A batch is not
larger than WORK_MOST, for that is what a killed worker loses, and holds enough to be worth its start.

Reference: Polychronopoulos & Kuck (1987), IEEE Trans. Comput. C-36, 1425.

Carrying out a campaign: lease runs, hand them out in batches, write results down, wait for other parents.

Local worker processes by default; the workers of a Dask cluster where a scheduler is named. This is the only
module that knows Dask.
"""

import time
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_erosion.campaign.ledger import (
    LEASE,
    Ledger,
    add_requests,
    beat,
    lease_runs,
    read_results,
    record_result,
    record_worker_death,
    release_leases,
    release_stale_leases,
    unfinished,
)
from taichi_erosion.campaign.pool import Batch, Event, Pool, named_work, start_pool
from taichi_erosion.campaign.request import WORTH_A_START, RunRequest, RunResult
from taichi_erosion.core.device import usable_cores
from taichi_erosion.core.errors import BadInput

WORK_MOST = 3e9  # grain-steps of a batch: about ten minutes of one core
RUNS_MOST = 64  # of a batch: more make an ensemble no cheaper to start, but its fields larger


def next_batch(waiting: Sequence[RunRequest], deaths: dict[str, int], workers: int) -> list[RunRequest]:
    """Runs for a free worker. A run that a worker has died of goes alone, so that it takes no other along."""
    first = waiting[0]
    if deaths[first.key]:
        return [first]
    fellows = [request for request in waiting if request.group == first.group and not deaths[request.key]]
    share = -(-len(fellows) // workers)
    work = np.cumsum([request.work for request in fellows])
    least = int(np.searchsorted(work, WORTH_A_START)) + 1
    most = int(np.searchsorted(work, WORK_MOST, side="right"))
    return fellows[: max(min(max(share, least), most, RUNS_MOST), 1)]


SIMULATE = "taichi_erosion.campaign.scene_worker:simulating"
BEAT = LEASE / 6.0  # s between signs of life
WAIT = 0.2  # s that a look at the workers takes at most
CONNECT = 20.0  # s until a scheduler that does not answer is an error
QUEUE = 2  # batches in flight per Dask worker: one runs, one waits beside it
GAIN_LEAST = 0.02  # share of the work done before the time left is worth saying [1]

Report = Callable[[float, str], None]  # (share done [1], words)


@dataclass
class Campaign:
    """A campaign under way."""

    requests: dict[str, RunRequest]  # by key
    store: Ledger
    pool: Pool
    progress: Report | None
    started: float = field(default_factory=time.monotonic)
    beaten: float = field(default_factory=time.monotonic)
    began_with: int = 0  # runs that stood in the ledger
    shares: dict[str, float] = field(default_factory=dict)  # of runs under way here [1]
    told: float = 0.0  # share that was last told; a batch that ends between two looks does not take it back


def execute(
    requests: Sequence[RunRequest],
    store: Ledger,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Report | None = None,
    function: str = SIMULATE,
) -> list[RunResult]:
    """Results of all requests, in their order; what stands in the ledger is not run again.

    `workers` local processes (one a core where left out), or the Dask cluster at the address `scheduler`.
    Failed runs are results with a reason. Raises BadInput where the ledger or the scheduler cannot be used.
    """
    wanted = {request.key: request for request in requests}
    named_work(function)
    add_requests(store, list(wanted.values()))
    release_stale_leases(store)
    left = unfinished(store, list(wanted))
    if left:
        most = min(len(left), workers or usable_cores())
        pool = DaskPool.connect(scheduler, function) if scheduler else start_pool(function, most)
        campaign = Campaign(wanted, store, pool, progress, began_with=len(wanted) - len(left))
        try:
            work_off(campaign)
        finally:
            pool.close()
            with quiet_after_failure():
                release_leases(store, store.owner)
    return read_results(store, [request.key for request in requests])


@contextmanager
def quiet_after_failure() -> Any:
    """A ledger that cannot be written has been complained about; its leases lapse by themselves."""
    try:
        yield
    except BadInput:
        return


def work_off(campaign: Campaign) -> None:
    """Go on until every run has ended, here or at another parent."""
    while left := unfinished(campaign.store, list(campaign.requests)):
        hand_out(campaign, left)
        for event in campaign.pool.events(WAIT):
            digest(campaign, event)
        if time.monotonic() - campaign.beaten > BEAT:
            campaign.beaten = time.monotonic()
            beat(campaign.store)
            release_stale_leases(campaign.store)
        tell_progress(campaign, len(left))


def hand_out(campaign: Campaign, left: dict[str, tuple[str, int]]) -> None:
    """Lease batches for free workers; runs that another parent leases are tried again later."""
    waiting = [campaign.requests[key] for key, (state, _) in left.items() if state == "waiting"]
    deaths = {key: deaths for key, (_, deaths) in left.items()}
    while waiting and campaign.pool.free():
        batch = next_batch(waiting, deaths, campaign.pool.workers)
        waiting = [request for request in waiting if request not in batch]
        mine = set(lease_runs(campaign.store, [request.key for request in batch]))
        batch = [request for request in batch if request.key in mine]
        if batch:
            keys, payloads = zip(*((request.key, request.payload) for request in batch), strict=True)
            campaign.pool.submit(Batch(keys, payloads))


def digest(campaign: Campaign, event: Event) -> None:
    """Write down what a pool says."""
    keys = event.batch.keys
    if event.kind == "told":
        record_result(campaign.store, keys[event.place], event.record)
        campaign.shares.pop(keys[event.place], None)
    elif event.kind == "share":
        told = unfinished(campaign.store, keys)
        campaign.shares |= dict.fromkeys(told, event.share)
    else:
        give_back(campaign, event, list(unfinished(campaign.store, keys)))


def give_back(campaign: Campaign, event: Event, untold: list[str]) -> None:
    """Deal with runs of a batch that came to an end without telling of them."""
    for key in event.batch.keys:
        campaign.shares.pop(key, None)
    if event.kind == "broken" and len(event.batch.keys) == 1 and untold:
        record_result(campaign.store, untold[0], {"failure": event.reason})
    else:
        record_worker_death(campaign.store, untold, event.reason or "it told of no result")


def tell_progress(campaign: Campaign, left: int) -> None:
    """Say how many runs have ended and how long the others will take at this pace."""
    if campaign.progress is None:
        return
    total = len(campaign.requests)
    done = total - left
    share = campaign.told = max(campaign.told, (done + sum(campaign.shares.values())) / total)
    gained, elapsed = share - campaign.began_with / total, time.monotonic() - campaign.started
    words = f"{done} of {total} runs"
    if gained > GAIN_LEAST:
        words += f", {duration((1.0 - share) / gained * elapsed)} left"
    campaign.progress(share, words)


def duration(seconds: float) -> str:
    """A time span in words: two digits are as much as an estimate deserves."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def perform(function: str, payloads: list[dict[str, Any]]) -> list[tuple[int, dict[str, Any]]]:
    """A batch on a Dask worker: all records at the end, with their places."""
    told: list[tuple[int, dict[str, Any]]] = []
    with named_work(function)() as run:
        run(payloads, lambda place, record: told.append((place, record)), lambda _: None)
    return told


@dataclass
class DaskPool:
    """Workers of a Dask cluster; one that is lost is the scheduler's to replace."""

    function: str
    client: Any
    flying: dict[Any, Batch] = field(default_factory=dict)  # by future

    @classmethod
    def connect(cls, scheduler: str, function: str) -> "DaskPool":
        """Join a cluster. Raises BadInput where no scheduler answers."""
        try:
            from distributed import Client
        except ImportError:
            raise BadInput("scheduler: needs Dask; pip install 'taichi-erosion[cluster]'") from None
        try:
            client = Client(scheduler, timeout=CONNECT, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise BadInput(f"scheduler {scheduler}: does not answer ({error})") from None
        return cls(function, client)

    @property
    def workers(self) -> int:
        """Workers of the cluster; at least one is expected to come."""
        return max(len(self.client.nthreads()), 1)

    def free(self) -> int:
        """Batches that could be handed in."""
        return max(QUEUE * self.workers - len(self.flying), 0)

    def submit(self, batch: Batch) -> None:
        """Hand in a batch; each is a task of its own even if its payload is not."""
        future = self.client.submit(perform, self.function, list(batch.payloads), pure=False)
        self.flying[future] = batch

    def events(self, timeout: float) -> list[Event]:
        """Batches that have come back."""
        if not any(future.done() for future in self.flying):
            time.sleep(timeout)
        landed = [future for future in self.flying if future.done()]
        return [event for future in landed for event in self.landed(future, self.flying.pop(future))]

    def landed(self, future: Any, batch: Batch) -> list[Event]:
        """What a batch has brought back."""
        from distributed import CancelledError, KilledWorker

        try:
            told = future.result()
        except (KilledWorker, CancelledError) as error:
            return [Event("died", batch, reason=f"lost by the cluster ({type(error).__name__})")]
        except Exception as error:
            return [Event("broken", batch, reason=f"{type(error).__name__}: {error}")]
        return [
            *(Event("told", batch, place=place, record=record) for place, record in told),
            Event("ended", batch),
        ]

    def close(self) -> None:
        """Leave the cluster; it goes on without this client's tasks."""
        self.client.cancel(list(self.flying), force=True)
        self.client.close()
