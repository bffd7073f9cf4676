"""Checkpoints of a run at intervals of simulated time (`--checkpoint FILE --every T`)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.recording.checkpoint import save_checkpoint
from taichi_erosion.run.ensemble_loop import EnsembleRun
from taichi_erosion.run.resume import run_state
from taichi_erosion.run.stages import ROUNDING, whole_intervals
from taichi_erosion.simulation import export_state


@dataclass
class Checkpointer:
    """Writer of the checkpoints of a run; as a callback it saves whenever an interval is over."""

    path: Path
    interval: float  # simulated s; see run.CHECKPOINT_INTERVAL
    meta: dict[str, Any]
    saved: int = 0  # intervals that have a checkpoint

    def __call__(self, ensemble: EnsembleRun) -> None:
        """Save when due; where that fails the checkpoint before stays, and the run goes on with a warning."""
        if ensemble.time >= (self.saved + 1) * self.interval * (1.0 - ROUNDING):
            self.saved = whole_intervals(ensemble.time, self.interval)
            try:
                self.save(ensemble)
            except BadInput as error:
                ensemble.states[0].warn(str(error))

    def save(self, ensemble: EnsembleRun) -> None:
        """Write device state and run state. Raises BadInput where the disk refuses."""
        arrays, meta = run_state(ensemble)
        save_checkpoint(self.path, export_state(ensemble.sim) | arrays, self.meta | meta)
