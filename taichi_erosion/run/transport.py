"""What a recording shows of grains under wind: the wind's profile, and what it carries."""

import numpy as np

from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.wind_bed import Patch, flux_of
from taichi_erosion.recording import stream
from taichi_erosion.recording.wind import log_profile
from taichi_erosion.run.observables import patch_of
from taichi_erosion.scene import Scene
from taichi_erosion.simulation import Simulation, air_profile, friction_velocity


def log_transport(
    recording: stream.Recording, scene: Scene, sim: Simulation, replica: int, state: Snapshot
) -> None:
    """Write the profile of the wind and the curves of `transport_of` at the time of the latest frame."""
    if scene.wind is None:
        return
    air = air_profile(sim, replica)
    log_profile(recording, air.velocity[:, 0], air.face)
    values = transport_of(state, patch_of(scene))
    stream.log_transport(recording, values | {"friction_velocity": friction_velocity(sim, replica)})


def transport_of(state: Snapshot, patch: Patch) -> dict[str, float]:
    """Flux [kg m-1 s-1], and the share of the grains that fly: that are above the bed [1]."""
    flying = float(np.mean(state.position[:, 2] > patch.clear)) if len(state.position) else 0.0
    return {"flux": flux_of(state, patch), "flying": flying}
