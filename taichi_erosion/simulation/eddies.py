"""Setting the wind of a grid of air: eddies that grow from a stirred start, or that swell with u*."""

from math import ceil

from taichi_erosion.air.observe import set_velocities
from taichi_erosion.air.stir import stirred_wind
from taichi_erosion.core.transfer import read, write
from taichi_erosion.coupling.eddies import flow_over, meet_air
from taichi_erosion.simulation.assemble import Simulation

LAUNCH_STEPS = 50  # of the air in one launch: the host hears signals between launches


def develop_eddies(sim: Simulation, replica: int, before: float, after: float, anew: bool) -> None:
    """Change the flow of a grid from one friction velocity [m s-1] at the bed to another.

    Wind that sets in is stirred and grows its eddies over grains that keep their places. A wind that changes
    keeps its eddies: all velocities grow with u*, all pressures with its square.
    """
    air, setup = sim.around.air, sim.setups[replica].air
    assert air is not None
    assert setup is not None
    if before > 0.0 or after == 0.0:
        factor = after / before if before > 0.0 else 0.0
        for field, power in (*((velocity, 1) for velocity in air.velocities), (air.pressure, 2)):
            whole = read(field)
            whole[replica] *= factor**power
            write(field, whole)
    else:
        u, v, w = stirred_wind(setup, after)
        set_velocities(air, replica, (u, v, w))
    meet_air(replica, int(anew), sim.world, sim.around)
    if before == 0.0 and after > 0.0:
        grow_eddies(sim, replica, after)


def grow_eddies(sim: Simulation, replica: int, friction_velocity: float) -> None:
    """Let the air flow over resting grains for the stated number of turnovers."""
    setup = sim.setups[replica].air
    assert setup is not None
    assert setup.stir is not None
    time = setup.stir.turnovers * (setup.high[2] - setup.ground) / friction_velocity
    left = ceil(time / setup.time_step)
    while left > 0:
        flow_over(replica, min(left, LAUNCH_STEPS), sim.world, sim.around)
        left -= LAUNCH_STEPS
