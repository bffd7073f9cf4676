"""How the thresholds of motion of a bed under wind are looked for."""

from taichi_erosion.scene.schema_field import Part, number
from taichi_erosion.scene.schema_wind import FASTEST_FRICTION

LONGEST_HOLD = 1e3  # s


class Threshold(Part):
    """A ramp, then winds from rest on either side of where it ended, then transport that is slowed down.

    A grain has rolled when it has moved over the bed by `distance`, and has left the bed when it has risen by
    `distance` above its place at rest. The bed moves when `share` of as many grains as one layer holds, at
    least one, have left it.
    """

    share: float = number(0.01, "1", "share of the surface grains that must move", 1e-6, 1.0)
    distance: float = number(1.0, "1", "distance over the nominal diameter that counts as moved", 0.01, 100.0)
    first: float | None = number(
        None,
        "m s-1",
        "u* at which the ramp begins; left out: 0.08 sqrt((s - 1) g d)",
        1e-3,
        FASTEST_FRICTION,
    )
    rise: float = number(0.04, "1", "share by which u* grows from step to step", 1e-3, 1.0)
    rise_hold: float = number(0.02, "s", "duration of a step of the ramp", 1e-6, LONGEST_HOLD)
    hold: float = number(0.3, "s", "time from rest in which grains must leave the bed", 1e-6, LONGEST_HOLD)
    levels: int = number(2, "1", "halvings of a step of the ramp to which winds are bisected", 0, 20)
    excess: float = number(
        1.2, "1", "u* of the transport that is slowed down, over the fluid threshold", 1.0, 10.0
    )
    transport: float | None = number(
        None,
        "m s-1",
        "u* of that transport; given: nothing is looked for but where it ceases",
        1e-3,
        FASTEST_FRICTION,
    )
    spin_up: float = number(0.3, "s", "time in which that transport develops", 1e-6, LONGEST_HOLD)
    fall: float = number(0.07, "1", "share by which u* falls from step to step", 1e-3, 0.5)
    fall_hold: float = number(0.25, "s", "duration of such a step", 1e-6, LONGEST_HOLD)
    ceased: float = number(
        0.01, "1", "flux over that of the start below which transport has ceased", 1e-6, 0.5
    )
    fetch: float = number(7.0, "m", "distance from the inlet of the tunnel that is compared", 0.01, 1e4)
