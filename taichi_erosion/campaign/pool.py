"""Workers that run batches: processes of this machine, or those of a Dask cluster.

A local worker enters every record in the ledger as soon as it is there; a Dask worker, which may not see the
file, returns all of a batch at its end. Processes are spawned, never forked: Taichi does not survive a fork.
A process whose parent has died ends at once. The work of a worker is named "module:function": a context
manager that gives a `RunFunction`, entered when the worker starts and left when it has nothing more to do.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass, field
from importlib import import_module
from multiprocessing import connection
from multiprocessing.util import Finalize
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.ledger import Ledger, open_ledger, record_result
from taichi_erosion.campaign.request import Payloads, RunFunction
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Arch, Numerics

Records = list[tuple[int, dict[str, Any]]]  # place in the batch, record

END_WAIT = 20.0  # s that a worker is given to end
LAST_BATCH = 1.0  # s for the end of a batch whose runs are all recorded
CONNECT = 20.0  # s until a scheduler that does not answer is an error
QUEUE = 2  # batches in flight per Dask worker: one runs, one waits beside it
SPAWN = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class Batch:
    """Runs that one worker does together."""

    keys: tuple[str, ...]
    payloads: Payloads


@dataclass(frozen=True)
class FinishedBatch:
    """A batch that has ended, the records that it returned, and why it broke off, if it did."""

    batch: Batch
    records: Records = field(default_factory=list)
    reason: str = ""
    is_worker_dead: bool = False  # the worker is gone


def import_work_context(name: str) -> Callable[[], AbstractContextManager[RunFunction]]:
    module, _, function = name.partition(":")
    return getattr(import_module(module), function)


WORKER: list[tuple[RunFunction, Ledger]] = []  # of this process, where it is a local worker


def start_local_worker(name: str, folder: Path) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to decide
    threading.Thread(target=exit_with_parent, daemon=True).start()
    left_at_end = ExitStack()
    WORKER.append((left_at_end.enter_context(import_work_context(name)()), open_ledger(folder)))
    Finalize(None, left_at_end.close, exitpriority=0)


def exit_with_parent() -> None:
    """Leave when the parent is gone: nobody would go on with the results."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def run_in_local_worker(batch: Batch) -> Records:
    ((run, ledger),), records = WORKER, Records()

    def store_record(place: int, record: dict[str, Any]) -> None:
        records.append((place, record))
        with suppress(BadInput):  # the parent enters it again and says why that fails
            record_result(ledger, batch.keys[place], record)

    run(batch.payloads, store_record)
    return records


def run_on_dask(name: str, batch: Batch) -> Records:
    records: Records = []
    with import_work_context(name)() as run:
        run(batch.payloads, lambda place, record: records.append((place, record)))
    return records


@dataclass
class Pool:
    """Workers, and the batches that they are at: local processes, or the cluster of a Dask client."""

    function: str
    folder: Path  # of the ledger
    client: Any = None
    processes: dict[Executor, Any] = field(default_factory=dict)  # one an executor
    in_flight: dict[Future[Records], tuple[Batch, Executor | None]] = field(default_factory=dict)

    @property
    def worker_count(self) -> int:
        """Number of workers; of a cluster at least one is expected to come."""
        return max(len(self.client.nthreads()), 1) if self.client else len(self.processes)

    def count_free_slots(self) -> int:
        """Batches that could be submitted now."""
        return max((QUEUE if self.client else 1) * self.worker_count - len(self.in_flight), 0)

    def spawn_worker(self) -> None:
        before = set(multiprocessing.active_children())
        executor = ProcessPoolExecutor(1, SPAWN, start_local_worker, (self.function, self.folder))
        executor.submit(os.getpid)  # an executor starts its process with its first task
        (self.processes[executor],) = set(multiprocessing.active_children()) - before

    def submit_batch(self, batch: Batch) -> None:
        if self.client:  # a task of its own, even if its payload is not
            future = self.client.get_executor(pure=False).submit(run_on_dask, self.function, batch)
            self.in_flight[future] = batch, None
            return
        busy = {executor for _, executor in self.in_flight.values()}
        executor = next(each for each in self.processes if each not in busy)
        try:
            future = executor.submit(run_in_local_worker, batch)
        except BrokenProcessPool as error:  # it has died since
            future = Future[Records]()
            future.set_exception(error)
        self.in_flight[future] = batch, executor

    def finished_batches(self, timeout: float) -> list[FinishedBatch]:
        """Batches that have ended, after a wait of up to `timeout` seconds for the first."""
        if not self.in_flight:
            time.sleep(timeout)
        futures, _ = wait(self.in_flight, timeout, FIRST_COMPLETED)
        return [self.finished_batch_of(future, *self.in_flight.pop(future)) for future in futures]

    def finished_batch_of(
        self, future: Future[Records], batch: Batch, executor: Executor | None
    ) -> FinishedBatch:
        """What came of one batch; a local worker that died is replaced."""
        try:
            return FinishedBatch(batch, future.result())
        except BrokenProcessPool:
            assert executor is not None
            executor.shutdown()  # waits until the executor has asked how its process ended
            code = self.processes.pop(executor).exitcode
            self.spawn_worker()
            reason = f"killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
            return FinishedBatch(batch, reason=reason, is_worker_dead=True)
        except Exception as error:
            name = type(error).__name__
            is_worker_dead = name in ("KilledWorker", "CancelledError", "FutureCancelledError")  # of Dask
            reason = f"lost by the cluster ({name})" if is_worker_dead else f"{name}: {error}"
            return FinishedBatch(batch, reason=reason, is_worker_dead=is_worker_dead)

    def close(self) -> None:
        """End all workers; those without a batch by themselves, since they may have something to put away."""
        wait(self.in_flight, LAST_BATCH)
        busy = {executor for future, (_, executor) in self.in_flight.items() if not future.done()}
        for executor, process in self.processes.items():
            if executor in busy:
                process.terminate()
            executor.shutdown(wait=False, cancel_futures=True)
        for process in self.processes.values():
            process.join(END_WAIT)
            process.kill()
        if self.client:  # the cluster goes on without this client's tasks
            for future in self.in_flight:
                future.cancel()
            self.client.close()


def start_pool(function: str, folder: Path, workers: int) -> Pool:
    pool = Pool(function, folder)
    for _ in range(workers):
        pool.spawn_worker()
    return pool


def start_cluster_pool(function: str, folder: Path, scheduler: str) -> Pool:
    """Workers of a cluster. Raises BadInput where no scheduler answers."""
    try:
        from distributed import Client
    except ImportError:
        raise BadInput("scheduler: needs Dask; pip install 'taichi-erosion[cluster]'") from None
    try:
        return Pool(function, folder, Client(scheduler, timeout=CONNECT, set_as_default=False))
    except (OSError, ValueError, TimeoutError) as error:
        raise BadInput(f"scheduler {scheduler}: does not answer ({error})") from None


def refuse_missing_devices(archs: Iterable[Arch]) -> None:
    """Raise BadInput for a device that workers of this machine could not use.

    Another process looks: a device that is started here would end what this process has on one.
    """
    from taichi_erosion.core.device import start_device

    for arch in archs:
        with ProcessPoolExecutor(1, SPAWN) as looking:
            looking.submit(start_device, Numerics(arch)).result()
