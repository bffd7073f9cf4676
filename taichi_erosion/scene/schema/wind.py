"""Wind over a periodic patch of grains: one column of cells, or a grid; and the search for thresholds."""

from collections.abc import Iterator
from typing import Literal

from taichi_erosion.core.air_setup import Closure
from taichi_erosion.core.setup import Coupling, DragLaw, Laws
from taichi_erosion.scene.schema.fields import FARTHEST, Section, entry, extent, number

COLUMNS_MOST = 256  # along either side of a patch
COLUMNS_LEAST = 4  # in each direction of a grid: fewer carry no wave
LONGEST_HOLD = 1e3  # longest time that a search for thresholds may hold a wind [s]
FASTEST_FRICTION = 10.0  # largest friction velocity that a scene may name [m s-1]


class Wind(Section):
    """Periodic patch of a bed under wind: one column of air cells, driven by the stress at its lid, or many.

    The patch reaches from 0 to `length` downwind and from 0 to `width` across; heights count from 0. On
    several columns a large-eddy closure resolves the gusts that the patch has room for.
    """

    length: float = extent(..., "period downwind")
    width: float = extent(..., "period across")
    height: float = extent(..., "height of the lid", high=FARTHEST)
    friction_velocity: float = number(0.0, "m s-1", "u* at the start", 0.0, FASTEST_FRICTION)
    partition: float = number(1.0, "1", "friction velocity at the patch over the stated one", 1e-3, 1.0)
    density: float = number(1.225, "kg m-3", "density of the air", 1e-3, 1e3)
    viscosity: float = number(1.46e-5, "m2 s-1", "kinematic viscosity of the air", 1e-8, 1.0)
    drag: DragLaw = entry(Laws.drag, "law of drag on a grain")
    columns: tuple[int, int] = number((1, 1), "1", "columns of cells downwind and across", 1, COLUMNS_MOST)
    closure: Closure = entry(
        "mixing_length", "turbulence closure; smagorinsky, or none, lets a grid have eddies"
    )
    drive: Literal["lid", "gradient"] = entry(
        "lid", "what gives the bed its stress: that of the lid, or a mean pressure gradient"
    )
    stir: float = number(1.0, "1", "deviation of the first velocities of a grid, over u*", 0.0, 10.0)
    turnovers: float = number(
        10.0, "1", "growth time of eddies when wind sets in, times u* over the height above the bed", 0.0, 1e3
    )
    surface: float | None = number(
        None, "m", "height of the bed; left out: what the grains fill at a solid share of 0.6", 0.0, 1e4
    )
    cell: float | None = number(None, "m", "finest layer of air; left out: a quarter diameter", 1e-7, 1e4)
    growth: float = number(1.15, "1", "widening of a layer over the one below, above the bed", 1.0001, 2.0)
    look_steps: int = number(
        Coupling.look_steps, "1", "time steps of the grains between two exchanges with the air", 1, 10_000
    )
    sleep_after: float | None = number(
        None, "s", "time at rest after which deep grains sleep; left out: none does", 1e-6, 1e3
    )
    sleep_share: float = number(
        Coupling.sleep_share, "1", "share of its weight that disturbs a grain that sleeps", 1e-4, 1.0
    )
    through_flow: float = number(0.0, "m s-1", "superficial velocity of air up the bed", -100.0, 100.0)

    def contradictions(self) -> Iterator[str]:
        if self.surface is not None and self.surface >= self.height:
            yield "surface must lie below height: the lid is inside the bed"


class Threshold(Section):
    """A ramp, then winds from rest on either side of where it ended, then transport that is slowed down.

    A grain has rolled when it has moved over the bed by `distance`, and has left the bed when it has risen by
    `distance` above its place at rest. The bed moves when `share` of as many grains as one layer holds, at
    least one, have left it. Over a periodic patch the first that flies sets off the others where it lands;
    without landings the wind alone is counted.
    """

    later = ("steady_air", "landings")
    share: float = number(0.01, "1", "share of the surface grains that must move", 1e-6, 1.0)
    distance: float = number(1.0, "1", "distance over the nominal diameter that counts as moved", 0.01, 100.0)
    first: float | None = number(
        None, "m s-1", "u* at which the ramp begins; left out: 0.08 sqrt((s - 1) g d)", 1e-3, FASTEST_FRICTION
    )
    rise: float = number(0.04, "1", "share by which u* grows from step to step", 1e-3, 1.0)
    rise_hold: float = number(0.02, "s", "duration of a step of the ramp", 1e-6, LONGEST_HOLD)
    hold: float = number(0.3, "s", "time from rest in which grains must leave the bed", 1e-6, LONGEST_HOLD)
    levels: int = number(2, "1", "halvings of a step of the ramp to which winds are bisected", 0, 20)
    excess: float = number(1.2, "1", "u* before the slowdown over the fluid threshold", 1.0, 10.0)
    transport: float | None = number(
        None, "m s-1", "u* of that transport; given: only its end is searched for", 1e-3, FASTEST_FRICTION
    )
    spin_up: float = number(0.3, "s", "time in which that transport develops", 1e-6, LONGEST_HOLD)
    fall: float = number(0.07, "1", "share by which u* falls from step to step", 1e-3, 0.5)
    fall_hold: float = number(0.25, "s", "duration of such a step", 1e-6, LONGEST_HOLD)
    ceased: float = number(0.01, "1", "share of the first flux at which transport has ceased", 1e-6, 0.5)
    steady_air: bool = entry(
        False, "transport that starts and falls: as a stage's steady_air, at every check"
    )
    landings: bool = entry(True, "grains that left a bed at rest land on it; false: they are carried off")
    fetch: float = number(6.0, "m", "distance from the inlet of the tunnel that is compared", 0.01, 1e4)
    speed_ratio: float | None = number(
        None, "1", "u*/U of a tunnel of one's own, in place of the built-in map", 1e-3, 0.5
    )
