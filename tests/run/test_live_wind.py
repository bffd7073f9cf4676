"""A session under wind: more wind that is ordered while it blows carries more."""

from pathlib import Path

import pytest

from taichi_erosion.recording.readback import read_series
from taichi_erosion.recording.stream import close
from taichi_erosion.run.observables import patch_of
from taichi_erosion.run.recorder import transport_of
from taichi_erosion.run.session import open_film, open_session, run_for, set_entry
from taichi_erosion.simulation import friction_velocity, snapshot

SCENE = Path(__file__).parents[2] / "scenes" / "saltation.toml"
SMALL = (
    "grains.count=160",
    "wind.length_d=10",
    "wind.width_d=8",
    "wind.height=0.02",
    "run.check_interval=2e-3",
    "record.every=2e-3",
)


def flux(session) -> float:
    return transport_of(snapshot(session.sim, 0), patch_of(session.scene))["flux"]


def test_wind_that_is_raised_while_it_blows_carries_more_and_compiles_nothing(tmp_path: Path) -> None:
    session = open_session(SCENE, SMALL)
    film = open_film(session, tmp_path / "wind.rrd")
    set_entry(session, "wind.friction_velocity", "0.05")  # far below the threshold of such sand
    run_for(session, 0.004)
    world, calm = session.sim.world, flux(session)
    assert set_entry(session, "wind.friction_velocity", "1.0").endswith("at once")
    assert friction_velocity(session.sim, 0) == pytest.approx(1.0, rel=1e-6)  # kept in single precision
    run_for(session, 0.004)
    assert session.sim.world is world
    # what moves in the calm are grains that still settle, which dies away; the wind pulls on
    assert flux(session) > 3.0 * abs(calm)
    times, recorded = read_series(close(film.recording), "transport/flux")
    assert recorded[-1] == recorded.max() > 0.0
    assert times[-1] == pytest.approx(0.008, abs=2.0 * session.time_step)
