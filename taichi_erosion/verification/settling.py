"""V30: quartz spheres of 50 um to 2 mm fall through still air at their terminal velocities.

The numbers wanted are the published table's, four digits each; a second line holds the same run against the
balance of weight, buoyancy and drag, solved in NumPy. The step is a fifth to a ten-thousandth of the drag's
response, and drag is taken implicitly: what is left is rounding and the lag of the rate by one look.
"""

from collections.abc import Iterator

import numpy as np

from taichi_erosion.core.setup import Coupling, Setup
from taichi_erosion.verification.bench_run import final_states
from taichi_erosion.verification.bench_setup import Touch, contact_table, sphere_setup, spheres
from taichi_erosion.verification.claim import Outcome, below, relative
from taichi_erosion.verification.coupled_setup import GRAVITY, in_air, still_air
from taichi_erosion.verification.reference.drag import Stream, terminal_velocity

AIR = Stream(0.0, 1.0, density=1.225, viscosity=1.789e-5)
QUARTZ = 2650.0  # kg m-3
TERMINAL = {50: 0.1820, 100: 0.5815, 200: 1.4778, 250: 1.9070, 500: 3.826, 1000: 7.042, 2000: 11.34}
HEIGHT, SIDE, LAYERS = 120.0, 1.0, 30  # m, m, 1: so much air that one grain does not move it
STEP, FALL = 2e-4, 9.0  # s
START = 115.0  # m


def falling(diameter: float) -> Setup:
    """One grain high above the floor."""
    grain = spheres((0.5, 0.5, START), 0.0, 0.0, diameter / 2.0, QUARTZ * np.pi / 6.0 * diameter**3)
    touch = Touch(1e7, 1e7)
    setup = sphere_setup(grain, contact_table(touch, touch), STEP, gravity=GRAVITY)
    air = still_air(np.linspace(0.0, HEIGHT, LAYERS + 1), (SIDE, SIDE), AIR.density, AIR.viscosity)
    return in_air(setup, air, Coupling(look_steps=5), 1.0)


def terminal_velocities() -> Iterator[Outcome]:
    """V30."""
    setups = [falling(1e-6 * microns) for microns in TERMINAL]
    speeds = [-state.velocity[0, 2] for state in final_states(setups, FALL, "f64")]
    for (microns, wanted), speed in zip(TERMINAL.items(), speeds, strict=True):
        yield relative(f"terminal velocity of {microns} um quartz [m/s]", speed, wanted, 0.005, "f64")
    balance = [terminal_velocity(1e-6 * microns, QUARTZ, AIR) for microns in TERMINAL]
    error = np.array(speeds) / balance - 1.0
    yield below("terminal velocities against the balance of forces: error", error, 1e-4, "f64")
