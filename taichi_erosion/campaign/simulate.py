"""The run function of a campaign of scenes: a batch is one ensemble on one thread."""

from pathlib import Path
from typing import Any

from taichi_erosion.campaign.workers import Share, Tell
from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.ensemble import Part, play_ensemble
from taichi_erosion.scene import Scene
from taichi_erosion.scene.load import parse_scene

THREADS = 1  # a batch is one of several that run beside each other


def simulate_batch(payloads: list[dict[str, Any]], tell: Tell, share: Share) -> None:
    """Simulate the scenes of `request.request_of`."""
    parts = [part_of(payload) for payload in payloads]
    precision = parts[0].scene.run.precision
    play_ensemble(parts, Numerics("cpu", THREADS, precision), tell, lambda done, _: share(done))


def part_of(payload: dict[str, Any]) -> Part:
    """One replica from its payload."""
    record = payload.get("record")
    return Part(
        scene=scene_of(payload),
        seed=payload["seed"],
        record=Path(record) if record else None,
        properties=payload.get("properties"),
    )


def scene_of(payload: dict[str, Any]) -> Scene:
    """The scene of a payload, which was validated when it was asked for."""
    return parse_scene(payload["scene"], "scene of the campaign", Path(payload["folder"]))
