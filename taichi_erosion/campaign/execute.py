"""Execution of a campaign: lease runs, submit them in batches, record results, wait for other parents.

Local worker processes by default; the workers of a Dask cluster where a scheduler is named.

A free worker takes 1/W of what is left of one group (guided self-scheduling): long batches first, where the
start of an ensemble costs little, short ones at the end, so that all workers finish together. A batch is not
larger than WORK_MOST, for that is what a killed worker loses, and holds enough to be worth its start. On a
graphics processor one worker holds the device, and its batches are as large as memory allows.

Progress counts a run that is under way as min(t / T, NEARLY) of its work, with t the time since it began and
T the work of its batch times the pace: seconds of one worker per grain-step, of the runs that have ended.

Reference: Polychronopoulos & Kuck (1987), IEEE Trans. Comput. C-36, 1425.
"""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from taichi_erosion.campaign import ledger as ledgers
from taichi_erosion.campaign import pool as pools
from taichi_erosion.campaign.ledger import Ledger, finished_runs, unfinished_runs
from taichi_erosion.campaign.request import START, WORTH_A_START, RunRequest, RunResult
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Arch, usable_cores
from taichi_erosion.execution import Report

WORK_MOST = 3e9  # grain-steps of a batch: about ten minutes of one core
SIMULATE = "taichi_erosion.campaign.request:simulation_function"
HEARTBEAT = ledgers.LEASE / 6.0  # s between two renewals of the leases
POLL = 0.2  # s that a poll of the workers takes at most
NEARLY = 0.95  # of its work, most that a run counts which has not ended [1]


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


def seconds_per_work(requests: Mapping[str, RunRequest], wall_times: Mapping[str, float]) -> float:
    """Seconds of one worker per unit of work, of runs that ended; without any as fast as usual."""
    work, seconds = sum(requests[key].work for key in wall_times), sum(wall_times.values())
    return seconds / work if work > 0.0 and seconds > 0.0 else START / WORTH_A_START


@dataclass
class Campaign:
    requests: dict[str, RunRequest]  # by key
    ledger: Ledger
    pool: pools.Pool
    progress: Report | None
    work: float  # grain-steps of the runs that did not stand in the ledger
    starts: dict[str, tuple[float, float]] = field(default_factory=dict)  # clock [s], work of the batch
    share: float = 0.0  # largest share reported; a batch that dies does not take it back
    heartbeat: float = field(default_factory=time.monotonic)  # time of the last heartbeat


def run_requests(
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
    by_key = {request.key: request for request in requests}
    ledgers.add_requests(ledger, list(by_key.values()))
    ledgers.release_stale_leases(ledger)
    if remaining := unfinished_runs(ledger, list(by_key)):
        archs: set[Arch] = {by_key[key].arch for key in remaining if by_key[key].arch != "cpu"}
        if scheduler:
            pool = pools.start_cluster_pool(function, ledger.folder, scheduler)
        else:
            pools.refuse_missing_devices(archs)
            count = 1 if archs else min(len(remaining), workers or usable_cores())
            pool = pools.start_pool(function, ledger.folder, count)
        campaign = Campaign(by_key, ledger, pool, progress, sum(by_key[key].work for key in remaining))
        try:
            while remaining := unfinished_runs(ledger, list(by_key)):  # here or at another parent
                submit_batches(campaign, remaining)
                for outcome in pool.finished_batches(POLL):
                    record_batch_outcome(campaign, outcome)
                if time.monotonic() - campaign.heartbeat > HEARTBEAT:
                    campaign.heartbeat = time.monotonic()
                    ledgers.renew_leases(ledger)
                    ledgers.release_stale_leases(ledger)
                report_progress(campaign, list(remaining))
            report_progress(campaign, [])
        finally:
            pool.close()
            with suppress(BadInput):  # a ledger that cannot be written has raised before; its leases lapse
                ledgers.release_leases(ledger, ledger.owner)
    return ledgers.read_results(ledger, [request.key for request in requests])


def submit_batches(campaign: Campaign, remaining: dict[str, tuple[str, int]]) -> None:
    """Lease batches for free workers; runs that another parent leases are tried again later."""
    waiting = [campaign.requests[key] for key, (state, _) in remaining.items() if state == "waiting"]
    deaths = {key: deaths for key, (_, deaths) in remaining.items()}
    while waiting and campaign.pool.count_free_slots():
        batch = next_batch(waiting, deaths, campaign.pool.worker_count)
        waiting = [request for request in waiting if request not in batch]
        leased = set(ledgers.lease_runs(campaign.ledger, [request.key for request in batch]))
        batch = [request for request in batch if request.key in leased]
        if batch:
            keys, payloads = zip(*((request.key, request.payload) for request in batch), strict=True)
            campaign.pool.submit_batch(pools.Batch(keys, payloads))
            whole = sum(request.work for request in batch)
            campaign.starts |= dict.fromkeys(keys, (time.monotonic(), whole))


def record_batch_outcome(campaign: Campaign, outcome: pools.FinishedBatch) -> None:
    """Enter what came of a batch in the ledger; runs that ended without a record go back."""
    ledger, keys = campaign.ledger, outcome.batch.keys
    for place, record in outcome.records:
        ledgers.record_result(ledger, keys[place], record)
    without_record = list(unfinished_runs(ledger, keys))
    for key in without_record:
        campaign.starts.pop(key, None)
    if outcome.reason and not outcome.is_worker_dead and len(keys) == 1 and without_record:
        ledgers.record_result(ledger, keys[0], {"failure": outcome.reason})
    elif without_record:
        ledgers.record_worker_death(ledger, without_record, outcome.reason or "it gave no result")


def report_progress(campaign: Campaign, remaining: Sequence[str]) -> None:
    """Report how many runs have ended, and the share of the work that is done."""
    if campaign.progress is None:
        return
    requests = campaign.requests
    now = time.monotonic()
    rest = 0.0
    second = seconds_per_work(requests, finished_runs(campaign.ledger, list(requests)))
    for key in remaining:
        start, whole = campaign.starts.get(key, (now, 0.0))
        by_time = min((now - start) / (START + second * whole), NEARLY)
        rest += requests[key].work * (1.0 - by_time)
    campaign.share = max(campaign.share, 1.0 - rest / campaign.work)
    campaign.progress(campaign.share, f"{len(requests) - len(remaining)} of {len(requests)} runs")
