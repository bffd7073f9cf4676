"""The window in which beds that repeat one scene are measured, and its wind."""

from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.core.snapshot import AirProfile
from taichi_erosion.evidence.words.run_words import measured_value_texts, steady_window_texts
from taichi_erosion.execution.observables import MeasureInput, measure_observable
from taichi_erosion.execution.stages import ReplicaState, steady_transport_window
from taichi_erosion.measures.result import as_record
from taichi_erosion.measures.threshold import pool_beds
from taichi_erosion.scene import load_scene
from tests.measures.heaps import snapshot_of

SALTATION = Path(__file__).parents[2] / "scenes" / "saltation.toml"
SCENE, STAGE = load_scene(SALTATION), 3
FRICTION = 0.4123


def bed(shares: np.ndarray) -> ReplicaState:
    """A bed whose air carries these shares of the stress of the wind, 200 frames a second; no grain flies."""
    face = np.linspace(0.0, 0.06, 61)
    centre, nought = 0.5 * (face[1:] + face[:-1]), np.zeros(60)
    shear = shares * FRICTION**2 / SCENE.wind.viscosity
    still = np.array([[1e-4, 1e-4, 1e-4]])
    state = ReplicaState(1, stage=STAGE)
    state.frames = [snapshot_of(still, time=k / 200) for k in range(1, len(shares) + 1)]
    profiles = (np.column_stack([slope * centre, nought]) for slope in shear)
    state.airs = [AirProfile(face, v, np.ones(60), nought, np.zeros((60, 2)), nought) for v in profiles]
    return state


def test_the_wind_of_a_stage_is_that_stated_last_and_what_reaches_the_patch():
    assert SCENE.friction_velocity_of_stage(STAGE) == FRICTION  # stated by the stage before
    assert load_scene(SALTATION, ("wind.partition=0.5",)).friction_velocity_of_stage(STAGE) == 0.5 * FRICTION
    assert SCENE.friction_velocity_of_stage(0) == 0.0


def test_beds_of_one_scene_are_balanced_together_and_share_a_window():
    early = np.concatenate([np.full(60, 1.5), np.ones(240)])  # a hump of 0.3 s
    beds = [bed(1.15 * early), bed(0.85 * early)]
    together, alone, stopped = (steady_transport_window(SCENE, STAGE, some) for some in (beds, beds[:1], []))
    assert (together.lacking, bool(alone.lacking), stopped) == ((), True, None)
    assert 0.2 < together.start < 0.31  # a few frames of the hump are within 5 % of the whole
    assert together.balance == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("balance", [1.0, 1.3])
def test_a_flux_out_of_balance_is_not_compared(balance):
    state = bed(np.full(200, balance))
    window = steady_transport_window(SCENE, STAGE, [state])
    frames, airs = tuple(state.frames), tuple(state.airs)
    order = SCENE.measure["bed_stress"]
    given = MeasureInput(SCENE, order, frames[-1], frames, (), airs[-1], airs, window=window)
    found = pool_beds([measure_observable("bed_stress", given)] * 2)
    wanted = {"value": found.value, "sd": 0.1 * found.value, "n": 1}
    document = {"measures": {"bed_stress": as_record(found)}, "measured": {"bed_stress": wanted}}
    assert ("agrees" in next(measured_value_texts(document))) == (balance == 1.0)
    assert len(list(steady_window_texts(document))) == (balance == 1.0)
