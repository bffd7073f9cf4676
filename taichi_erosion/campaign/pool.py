"""Local worker processes: each takes batches through a pipe and sends every record as soon as it is there.

Workers are spawned, never forked: Taichi does not survive a fork. A worker whose parent has died ends at
once. The work of a worker is named "module:function": a context manager that gives a `RunFunction`, entered
when the worker starts and left when it has nothing more to do.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from importlib import import_module
from multiprocessing.connection import Connection, wait
from typing import Any, Literal, Protocol

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Arch, Numerics

Payloads = list[dict[str, Any]]
SendRecord = Callable[[int, dict[str, Any]], None]  # (place in the batch, record)
SendShare = Callable[[float], None]  # share of the batch that is done [1]
RunFunction = Callable[[Payloads, SendRecord, SendShare], None]
Work = Callable[[], AbstractContextManager[RunFunction]]

END_WAIT = 20.0  # s that a worker is given to end


@dataclass(frozen=True)
class Batch:
    """Runs that one worker does together."""

    keys: tuple[str, ...]
    payloads: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class Event:
    """Message of a pool about a batch.

    record: of the run at `place`; share: of the batch that is done; ended: all records are sent;
    raised: the run function raised an error (`reason`); died: the worker is gone (`reason`).
    """

    kind: Literal["record", "share", "ended", "raised", "died"]
    batch: Batch
    place: int = 0
    record: dict[str, Any] = field(default_factory=dict)
    share: float = 0.0
    reason: str = ""


class Pool(Protocol):
    """Workers that run batches."""

    @property
    def workers(self) -> int: ...

    def free(self) -> int:
        """Batches that could be submitted now."""
        ...

    def submit(self, batch: Batch) -> None: ...

    def events(self, timeout: float) -> list[Event]:
        """New messages, after a wait of up to `timeout` seconds for the first."""
        ...

    def close(self) -> None:
        """End all workers; unfinished batches are dropped."""
        ...


def named_work(name: str) -> Work:
    """The context manager of "module:function". Raises BadInput where there is none."""
    module, _, function = name.partition(":")
    try:
        return getattr(import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise BadInput(f"work '{name}' must be MODULE:FUNCTION ({error})") from None


def worker_main(connection: Connection, name: str) -> None:
    """Main loop of a worker: batches in, records out, until the pipe or the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to decide
    threading.Thread(target=end_with_parent, daemon=True).start()
    with named_work(name)() as run:
        while True:
            try:
                payloads = connection.recv()
            except (EOFError, OSError):
                return
            run_batch(connection, run, payloads)


def run_batch(connection: Connection, run: RunFunction, payloads: Payloads) -> None:
    """Run one batch and send its records."""
    try:
        run(
            payloads,
            lambda place, record: connection.send(("record", place, record)),
            lambda share: connection.send(("share", share)),
        )
        connection.send(("ended", ""))
    except Exception as error:
        with suppress(OSError):  # the parent may be gone
            connection.send(("raised", f"{type(error).__name__}: {error}"))


def end_with_parent() -> None:
    """Leave when the parent is gone: nobody would read the results."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@dataclass
class Worker:
    """One worker process, seen from its parent."""

    process: Any
    connection: Any  # end of a pipe
    batch: Batch | None = None


def start_worker(function: str) -> Worker:
    """Spawn a worker."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=worker_main, args=(theirs, function), daemon=True)
    process.start()
    theirs.close()
    return Worker(process, ours)


@dataclass
class LocalPool:
    """Worker processes of this machine; one that dies is replaced."""

    function: str
    processes: list[Worker]

    @property
    def workers(self) -> int:
        return len(self.processes)

    def free(self) -> int:
        """Workers without a batch."""
        return sum(worker.batch is None for worker in self.processes)

    def submit(self, batch: Batch) -> None:
        """Send a batch to a free worker."""
        worker = next(worker for worker in self.processes if worker.batch is None)
        worker.batch = batch
        with suppress(OSError):  # it has died since; `events` reports it
            worker.connection.send(list(batch.payloads))

    def events(self, timeout: float) -> list[Event]:
        """Messages of all workers; a worker counts as dead once all it had sent is read."""
        busy = {worker.connection: worker for worker in self.processes if worker.batch is not None}
        if not busy:
            time.sleep(timeout)
        return [event for pipe in wait(list(busy), timeout) for event in self.pending_events(busy[pipe])]

    def pending_events(self, worker: Worker) -> list[Event]:
        """All messages that wait in the pipe of one worker."""
        events = [self.next_event(worker)]
        while worker.batch is not None and events[-1].kind != "died" and worker.connection.poll():
            events.append(self.next_event(worker))
        return events

    def next_event(self, worker: Worker) -> Event:
        """Next message of one worker; its death where the pipe is closed."""
        batch = worker.batch
        assert batch is not None
        try:
            kind, *content = worker.connection.recv()
        except (EOFError, OSError):
            return self.replace_worker(worker, batch)
        if kind == "record":
            return Event(kind, batch, place=content[0], record=content[1])
        if kind == "share":
            return Event(kind, batch, share=content[0])
        worker.batch = None
        return Event(kind, batch, reason=content[0])

    def replace_worker(self, worker: Worker, batch: Batch) -> Event:
        """Put a new worker in the place of a dead one."""
        worker.process.join(END_WAIT)
        code = worker.process.exitcode or 0
        reason = f"killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        worker.connection.close()
        self.processes[self.processes.index(worker)] = start_worker(self.function)
        return Event("died", batch, reason=reason)

    def close(self) -> None:
        """End all workers; those without a batch by themselves, since they may have something to put away."""
        for worker in self.processes:
            if worker.batch is None:
                worker.connection.close()
            else:
                worker.process.terminate()
        for worker in self.processes:
            worker.process.join(END_WAIT)
            if worker.process.is_alive():
                worker.process.kill()
            worker.connection.close()


def device_fault(arch: Arch) -> str | None:
    """Why a device cannot be used, None where it can."""
    from taichi_erosion.core.device import start_device, stop_device

    try:
        start_device(Numerics(arch))
    except BadInput as error:
        return str(error)
    stop_device()
    return None


def refuse_missing_devices(archs: Iterable[Arch]) -> None:
    """Raise BadInput for a device that workers of this machine could not use.

    Another process looks: a device that is started here would end what this process has on one.
    """
    for arch in archs:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as looking:
            if fault := looking.submit(device_fault, arch).result():
                raise BadInput(fault)


def start_pool(function: str, workers: int) -> LocalPool:
    """Spawn the workers."""
    return LocalPool(function, [start_worker(function) for _ in range(workers)])
