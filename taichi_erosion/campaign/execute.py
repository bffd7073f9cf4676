"""Execution of a campaign: lease runs, submit them in batches, record results, wait for other parents.

Local worker processes by default; the workers of a Dask cluster where a scheduler is named. This is the only
module that imports Dask.

A free worker takes 1/W of what is left of one group (guided self-scheduling): long batches first, where the
start of an ensemble costs little, short ones at the end, so that all workers finish together. A batch is not
larger than WORK_MOST, for that is what a killed worker loses, and holds enough to be worth its start. On a
graphics processor one worker holds the device, and its batches are as large as memory allows.

Reference: Polychronopoulos & Kuck (1987), IEEE Trans. Comput. C-36, 1425.
"""

import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from taichi_erosion.campaign import ledger as ledgers
from taichi_erosion.campaign.ledger import Ledger, finished_runs, unfinished
from taichi_erosion.campaign.pool import (
    Batch,
    Event,
    Payloads,
    Pool,
    named_work,
    refuse_missing_devices,
    start_pool,
)
from taichi_erosion.campaign.request import WORTH_A_START, Report, RunRequest, RunResult
from taichi_erosion.campaign.work_done import WorkDone
from taichi_erosion.core.device import usable_cores
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Arch

WORK_MOST = 3e9  # grain-steps of a batch: about ten minutes of one core
SIMULATE = "taichi_erosion.campaign.request:simulating"
HEARTBEAT = ledgers.LEASE / 6.0  # s between two renewals of the leases
POLL = 0.2  # s that a poll of the workers takes at most
END_READ = 1.0  # s for the last message of a batch, whose runs another parent may have made
CONNECT = 20.0  # s until a scheduler that does not answer is an error
QUEUE = 2  # batches in flight per Dask worker: one runs, one waits beside it


def next_batch(waiting: Sequence[RunRequest], deaths: dict[str, int], workers: int) -> list[RunRequest]:
    """Runs for a free worker. A run in which a worker died goes alone, so that it takes no other along."""
    first = waiting[0]
    if deaths[first.key]:
        return [first]
    fellows = [request for request in waiting if request.group == first.group and not deaths[request.key]]
    share = -(-len(fellows) // workers)
    work = np.cumsum([request.work for request in fellows])
    least = int(np.searchsorted(work, WORTH_A_START)) + 1
    most = int(np.searchsorted(work, WORK_MOST, side="right")) if first.arch == "cpu" else len(fellows)
    return fellows[: max(min(max(share, least), most, first.most), 1)]


@dataclass
class Campaign:
    """A campaign under way."""

    requests: dict[str, RunRequest]  # by key
    ledger: Ledger
    pool: Pool
    progress: Report | None
    work: WorkDone
    renewed: float = field(default_factory=time.monotonic)  # time of the last heartbeat


def execute(
    requests: Sequence[RunRequest],
    ledger: Ledger,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Report | None = None,
    function: str = SIMULATE,
) -> list[RunResult]:
    """Results of all requests, in their order; what stands in the ledger is not run again.

    `workers` local processes (one a core where left out, one alone where runs are made on a graphics
    processor), or the Dask cluster at the address `scheduler`. Failed runs are results with a reason. Raises
    BadInput where the ledger, the scheduler or the device cannot be used.
    """
    wanted = {request.key: request for request in requests}
    named_work(function)
    ledgers.add_requests(ledger, list(wanted.values()))
    ledgers.release_stale_leases(ledger)
    left = unfinished(ledger, list(wanted))
    if left:
        if scheduler:
            pool: Pool = DaskPool.connect(scheduler, function)
        else:
            archs: set[Arch] = {wanted[key].arch for key in left if wanted[key].arch != "cpu"}
            refuse_missing_devices(archs)
            pool = start_pool(function, 1 if archs else min(len(left), workers or usable_cores()))
        work = sum(wanted[key].work for key in left)
        done = WorkDone(wanted, work, finished_runs(ledger, list(wanted)))
        campaign = Campaign(wanted, ledger, pool, progress, done)
        try:
            run_all(campaign)
        finally:
            pool.close()
            with suppress(BadInput):  # a ledger that cannot be written has raised before; its leases lapse
                ledgers.release_leases(ledger, ledger.owner)
    return ledgers.read_results(ledger, [request.key for request in requests])


def run_all(campaign: Campaign) -> None:
    """Go on until every run has ended, here or at another parent."""
    while left := unfinished(campaign.ledger, list(campaign.requests)):
        submit_batches(campaign, left)
        for event in campaign.pool.events(POLL):
            handle_event(campaign, event)
        if time.monotonic() - campaign.renewed > HEARTBEAT:
            campaign.renewed = time.monotonic()
            ledgers.renew_leases(campaign.ledger)
            ledgers.release_stale_leases(campaign.ledger)
        report_progress(campaign, left)
    read_ends(campaign.pool)


def read_ends(pool: Pool) -> None:
    """Read that batches have ended whose runs are recorded, so that their workers end by themselves."""
    until = time.monotonic() + END_READ
    while pool.free() < pool.workers and time.monotonic() < until:
        pool.events(POLL)


def submit_batches(campaign: Campaign, left: dict[str, tuple[str, int]]) -> None:
    """Lease batches for free workers; runs that another parent leases are tried again later."""
    waiting = [campaign.requests[key] for key, (state, _) in left.items() if state == "waiting"]
    deaths = {key: deaths for key, (_, deaths) in left.items()}
    while waiting and campaign.pool.free():
        batch = next_batch(waiting, deaths, campaign.pool.workers)
        waiting = [request for request in waiting if request not in batch]
        leased = set(ledgers.lease_runs(campaign.ledger, [request.key for request in batch]))
        batch = [request for request in batch if request.key in leased]
        if batch:
            keys, payloads = zip(*((request.key, request.payload) for request in batch), strict=True)
            campaign.pool.submit(Batch(keys, payloads))
            campaign.work.begin(keys)


def handle_event(campaign: Campaign, event: Event) -> None:
    """Enter a message of the pool in the ledger; runs of a batch that ended without a record go back."""
    ledger, keys = campaign.ledger, event.batch.keys
    if event.kind == "record":
        ledgers.record_result(ledger, keys[event.place], event.record)
        campaign.work.end(keys[event.place], event.record.get("wall_s"))
        return
    without_record = list(unfinished(ledger, keys))
    if event.kind == "share":
        campaign.work.limits |= dict.fromkeys(without_record, event.share)
        return
    for key in keys:
        campaign.work.end(key)
    if event.kind == "raised" and len(keys) == 1 and without_record:
        ledgers.record_result(ledger, keys[0], {"failure": event.reason})
    else:
        ledgers.record_worker_death(ledger, without_record, event.reason or "it gave no result")


def report_progress(campaign: Campaign, left: Iterable[str]) -> None:
    """Report how many runs have ended, what they say of their device, and the share of the work done."""
    if campaign.progress is None:
        return
    rest, total = list(left), len(campaign.requests)
    notes = sorted({campaign.requests[key].note for key in rest} - {""})
    words = "; ".join([f"{total - len(rest)} of {total} runs", *notes])
    campaign.progress(campaign.work.share(rest), words)


def run_on_dask(function: str, payloads: Payloads) -> list[tuple[int, dict[str, Any]]]:
    """A batch on a Dask worker: all records at the end, with their places."""
    records: list[tuple[int, dict[str, Any]]] = []
    with named_work(function)() as run:
        run(payloads, lambda place, record: records.append((place, record)), lambda _: None)
    return records


@dataclass
class DaskPool:
    """Workers of a Dask cluster; the scheduler replaces one that is lost."""

    function: str
    client: Any
    in_flight: dict[Any, Batch] = field(default_factory=dict)  # by future

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
        """Batches that could be submitted."""
        return max(QUEUE * self.workers - len(self.in_flight), 0)

    def submit(self, batch: Batch) -> None:
        """Submit a batch; each is a task of its own even if its payload is not."""
        future = self.client.submit(run_on_dask, self.function, list(batch.payloads), pure=False)
        self.in_flight[future] = batch

    def events(self, timeout: float) -> list[Event]:
        """Messages of the batches that have come back."""
        if not any(future.done() for future in self.in_flight):
            time.sleep(timeout)
        done = [future for future in self.in_flight if future.done()]
        return [event for future in done for event in batch_events(future, self.in_flight.pop(future))]

    def close(self) -> None:
        """Leave the cluster; it goes on without this client's tasks."""
        self.client.cancel(list(self.in_flight), force=True)
        self.client.close()


def batch_events(future: Any, batch: Batch) -> list[Event]:
    """Messages of a batch that a Dask worker has finished or lost."""
    from distributed import CancelledError, KilledWorker

    try:
        records = future.result()
    except (KilledWorker, CancelledError) as error:
        return [Event("died", batch, reason=f"lost by the cluster ({type(error).__name__})")]
    except Exception as error:
        return [Event("raised", batch, reason=f"{type(error).__name__}: {error}")]
    return [
        *(Event("record", batch, place=place, record=record) for place, record in records),
        Event("ended", batch),
    ]
