"""What a worker of a campaign of scenes does: a batch is one ensemble on one thread."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.pool import RunFunction, Share, Tell
from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.ensemble import ReplicaRequest, run_replicas_after
from taichi_erosion.scene import Scene
from taichi_erosion.scene.load import parse_scene
from taichi_erosion.simulation import Simulation

THREADS = 1  # a batch is one of several that run beside each other


@contextmanager
def simulating() -> Iterator[RunFunction]:
    """A run function for the scenes of `request.request_of`; its ensembles take each other's fields over."""
    kept: Simulation | None = None

    def simulate_batch(payloads: list[dict[str, Any]], tell: Tell, share: Share) -> None:
        nonlocal kept
        parts = [part_of(payload) for payload in payloads]
        numerics = Numerics("cpu", THREADS, parts[0].scene.run.precision)
        before, kept = kept, None  # what breaks off is of no use to the next
        kept = run_replicas_after(before, parts, numerics, tell, lambda done, _: share(done))

    yield simulate_batch
    stop_device()


def part_of(payload: dict[str, Any]) -> ReplicaRequest:
    """One replica from its payload."""
    record = payload.get("record")
    return ReplicaRequest(
        scene=scene_of(payload),
        seed=payload["seed"],
        record=Path(record) if record else None,
        properties=payload.get("properties"),
    )


def scene_of(payload: dict[str, Any]) -> Scene:
    """The scene of a payload, which was validated when it was asked for."""
    return parse_scene(payload["scene"], "scene of the campaign", Path(payload["folder"]))
