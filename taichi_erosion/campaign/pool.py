"""Local worker processes: each takes batches through a pipe and tells every result as soon as it is there.

Workers are spawned, never forked: Taichi does not survive a fork. A worker whose parent has died ends at
once. What a worker does is named "module:function": a context manager that gives a `RunFunction`, entered
when the worker starts and left when it has nothing more to do.
"""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field
from importlib import import_module
from multiprocessing.connection import Connection, wait
from typing import Any, Literal, Protocol

from taichi_erosion.core.errors import BadInput

Tell = Callable[[int, dict[str, Any]], None]  # (place in the batch, record)
Share = Callable[[float], None]  # share of the batch that is done [1]
RunFunction = Callable[[list[dict[str, Any]], Tell, Share], None]  # (payloads, tell, share)
Work = Callable[[], AbstractContextManager[RunFunction]]

PATIENCE = 5.0  # s that a worker is given to end


@dataclass(frozen=True)
class Batch:
    """Runs that one worker does together."""

    keys: tuple[str, ...]
    payloads: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class Event:
    """What a pool has to say about a batch.

    told: `record` of the run at `place`; share: of the batch is done; ended: all is told; broken: the run
    function raised (`reason`); died: its worker is gone (`reason`).
    """

    kind: Literal["told", "share", "ended", "broken", "died"]
    batch: Batch
    place: int = 0
    record: dict[str, Any] = field(default_factory=dict)
    share: float = 0.0
    reason: str = ""


class Pool(Protocol):
    """Where batches are worked off."""

    @property
    def workers(self) -> int:
        """Batches that are worked on at the same time."""
        ...

    def free(self) -> int:
        """Batches that could be handed in now."""
        ...

    def submit(self, batch: Batch) -> None:
        """Hand in a batch."""
        ...

    def events(self, timeout: float) -> list[Event]:
        """What has happened, waiting up to `timeout` seconds for something."""
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


def serve(connection: Connection, name: str) -> None:
    """Life of a worker: batches in, records out, until the pipe or the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to decide
    threading.Thread(target=end_with_parent, daemon=True).start()
    with named_work(name)() as run:
        while True:
            try:
                payloads = connection.recv()
            except (EOFError, OSError):
                return
            obey(connection, run, payloads)


def obey(connection: Connection, run: RunFunction, payloads: list[dict[str, Any]]) -> None:
    """Work one batch off."""
    try:
        run(
            payloads,
            lambda place, record: connection.send(("told", place, record)),
            lambda share: connection.send(("share", share)),
        )
        connection.send(("ended",))
    except Exception as error:
        with suppress(OSError):  # where the parent is gone nobody would hear it
            connection.send(("broken", f"{type(error).__name__}: {error}"))


def end_with_parent() -> None:
    """Leave when the parent is gone: nobody would hear the results."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@dataclass
class Worker:
    """One worker process as its parent sees it."""

    process: Any
    connection: Any  # end of a pipe
    batch: Batch | None = None


def start_worker(function: str) -> Worker:
    """Spawn a worker."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs, function), daemon=True)
    process.start()
    theirs.close()
    return Worker(process, ours)


@dataclass
class LocalPool:
    """Worker processes of this machine; one that dies is replaced."""

    function: str
    crew: list[Worker]

    @property
    def workers(self) -> int:
        """Number of processes."""
        return len(self.crew)

    def free(self) -> int:
        """Workers without a batch."""
        return sum(worker.batch is None for worker in self.crew)

    def submit(self, batch: Batch) -> None:
        """Give a batch to a free worker."""
        worker = next(worker for worker in self.crew if worker.batch is None)
        worker.batch = batch
        try:
            worker.connection.send(list(batch.payloads))
        except OSError:
            pass  # it has died since; `events` will say so

    def events(self, timeout: float) -> list[Event]:
        """Messages of all workers; a worker counts as dead once all it had sent is read."""
        busy = {worker.connection: worker for worker in self.crew if worker.batch is not None}
        if not busy:
            time.sleep(timeout)
        return [event for pipe in wait(list(busy), timeout) for event in self.all_heard(busy[pipe])]

    def all_heard(self, worker: Worker) -> list[Event]:
        """Everything that waits in the pipe of one worker."""
        events = self.heard(worker)
        while worker.batch is not None and events[-1].kind != "died" and worker.connection.poll():
            events += self.heard(worker)
        return events

    def heard(self, worker: Worker) -> list[Event]:
        """What one worker says next; its end where the pipe is closed."""
        batch = worker.batch
        assert batch is not None
        try:
            kind, *words = worker.connection.recv()
        except (EOFError, OSError):
            return [self.replaced(worker, batch)]
        if kind == "told":
            return [Event("told", batch, place=words[0], record=words[1])]
        if kind == "share":
            return [Event("share", batch, share=words[0])]
        worker.batch = None
        return [Event(kind, batch, reason=words[0] if words else "")]

    def replaced(self, worker: Worker, batch: Batch) -> Event:
        """Put a new worker in the place of a dead one."""
        worker.process.join(PATIENCE)
        code = worker.process.exitcode or 0
        reason = f"killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        worker.connection.close()
        self.crew[self.crew.index(worker)] = start_worker(self.function)
        return Event("died", batch, reason=reason)

    def close(self) -> None:
        """End all workers; those without a batch by themselves, since they may have something to put away."""
        for worker in self.crew:
            if worker.batch is None:
                worker.connection.close()
            else:
                worker.process.terminate()
        for worker in self.crew:
            worker.process.join(PATIENCE)
            if worker.process.is_alive():
                worker.process.kill()
            worker.connection.close()


def start_pool(function: str, workers: int) -> LocalPool:
    """Spawn the workers."""
    return LocalPool(function, [start_worker(function) for _ in range(workers)])
