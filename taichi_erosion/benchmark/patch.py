"""A patch of sand under wind: that of `scenes/saltation.toml`, and the state in which it is timed."""

from typing import Any

from taichi_erosion.benchmark.rates import Precision, numerics
from taichi_erosion.scene import build_setup, laws, parse_scene
from taichi_erosion.simulation import Simulation, advance, assemble, spin_up_wind

SEED = 1
GUST, GUST_UNTIL = 0.6, 0.1  # u* [m s-1] that starts the transport, and when it ends [s]
WIND, WIND_UNTIL = 0.4123, 0.2  # u* [m s-1] of the steady transport, and when it is timed [s]
PATCH: dict[str, Any] = {
    "scene": {"kind": "saltation"},
    "run": {"time_step_fraction": 0.25, "check_interval": 5e-3, "overlap_limit": 0.9},
    "grains": {
        "count": 800,
        "material": "sand",
        "size": {"law": "lognormal", "median": 0.242e-3, "sigma_log": 0.1, "low": 0.19e-3, "high": 0.3e-3},
    },
    "materials": {
        "sand": {
            "density": 2500.0,
            "shear_modulus": 2e5,
            "poisson_ratio": 0.25,
            "softening": {"rule": "bond_number", "true_modulus": 3e10},
        },
    },
    "laws": {"rolling": "elastic_plastic"},
    "contact": {"sand-sand": {"restitution": 0.7, "friction_sliding": 0.5, "friction_rolling": 0.0}},
    "geometry": {"ground": {"shape": "plane", "material": "sand"}},
    "wind": {
        "length_d": 25.0,
        "width_d": 8.0,
        "height": 0.06,
        "drag": "two_limits",
        "cell_d": 0.25,
        "look_steps": 20,
        "growth": 1.2,
    },
    "fill": {"law": "layers", "pitch_d": 1.32, "jitter_d": 0.03, "first_height_d": 1.0},
    "stages": [{"name": "blow", "until": "time", "duration_max": 1.0, "friction_velocity": WIND}],
}


def blowing_patch(threads: int, precision: Precision) -> Simulation:
    """The patch when grains hop over it."""
    scene = parse_scene(PATCH)
    sim = assemble([build_setup(scene, SEED)], laws(scene), numerics(threads, precision))
    for wind, until in ((GUST, GUST_UNTIL), (WIND, WIND_UNTIL)):
        spin_up_wind(sim, 0, wind)
        advance(sim, [until])
    return sim
