"""Ctrl-C, termination and a closed terminal are heard between checks, where device and play agree.

A signal that the program was started to ignore, as `nohup` and background jobs have it, stays ignored.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@dataclass
class Interruption:
    """Signals that have arrived; a second one is not waited for."""

    arrived: list[int] = field(default_factory=list)

    def note(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal: remember the first, obey the second at once."""
        self.arrived.append(number)
        if len(self.arrived) > 1:
            self.obey()

    def obey(self) -> None:
        """Raise what the first signal stands for, if one has arrived."""
        if self.arrived:
            raise KeyboardInterrupt if self.arrived[0] == signal.SIGINT else SystemExit(128 + self.arrived[0])


@contextmanager
def deferred() -> Iterator[Interruption]:
    """Collect signals instead of obeying them; only the main thread may ask for signals."""
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    heeded = [number for number in SIGNALS if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, interruption.note) for number in heeded}
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
