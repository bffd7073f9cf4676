"""The air over and between the grains of a periodic patch: one column of cells, or a grid of them."""

from typing import Literal

from pydantic import Field, model_validator

from taichi_erosion.core.setup import Coupling, Laws
from taichi_erosion.scene.schema_field import Part, contradiction, extent, number

Columns = tuple[int, int]
COLUMNS_MOST = 256  # along either side of a patch
FASTEST_FRICTION = 10.0  # largest friction velocity that a scene may name [m s-1]


class Wind(Part):
    """Periodic patch of a bed under wind: one column of air cells, driven by the stress at its lid, or many.

    The patch reaches from 0 to `length` downwind and from 0 to `width` across; heights count from 0. On
    several columns a large-eddy closure resolves the gusts that the patch has room for.
    """

    length: float = extent(..., "period downwind")
    width: float = extent(..., "period across")
    height: float = extent(..., "height of the lid")
    friction_velocity: float = number(0.0, "m s-1", "u* at the start", 0.0, FASTEST_FRICTION)
    partition: float = number(
        1.0, "1", "friction velocity that reaches the patch over the stated one", 1e-3, 1.0
    )
    density: float = number(1.225, "kg m-3", "density of the air", 1e-3, 1e3)
    viscosity: float = number(1.46e-5, "m2 s-1", "kinematic viscosity of the air", 1e-8, 1.0)
    drag: Literal["schiller_naumann", "two_limits", "di_felice", "gidaspow"] = Field(
        default=Laws.drag, description="law of drag on a grain"
    )
    columns: Columns = number((1, 1), "1", "columns of cells downwind and across", 1, COLUMNS_MOST)
    closure: Literal["none", "mixing_length", "smagorinsky"] = Field(
        "mixing_length", description="turbulence closure; smagorinsky, or none, lets a grid have eddies"
    )
    drive: Literal["lid", "gradient"] = Field(
        "lid", description="what gives the bed its stress: that of the lid, or a mean pressure gradient"
    )
    stir: float = number(1.0, "1", "deviation of the first velocities of a grid, over u*", 0.0, 10.0)
    turnovers: float = number(
        10.0,
        "1",
        "time for eddies to grow when wind sets in, times u* over the height above the bed",
        0.0,
        1e3,
    )
    surface: float | None = number(
        None, "m", "height of the bed; left out: what the grains fill at a solid share of 0.6", 0.0, 1e4
    )
    cell: float | None = number(None, "m", "finest layer of air; left out: a quarter diameter", 1e-7, 1e4)
    growth: float = number(1.15, "1", "widening of a layer over the one below, above the bed", 1.0001, 2.0)
    look_steps: int = number(
        Coupling.look_steps, "1", "time steps of the grains between two looks at the air", 1, 10_000
    )
    sleep_after: float | None = number(
        None,
        "s",
        "time at rest after which deep grains sleep until disturbed; left out: none does",
        1e-6,
        1e3,
    )
    sleep_share: float = number(
        Coupling.sleep_share, "1", "share of its weight that disturbs a grain that sleeps", 1e-4, 1.0
    )
    through_flow: float = number(
        0.0, "m s-1", "superficial velocity of air rising through the bed", -100.0, 100.0
    )

    @model_validator(mode="after")
    def _in_order(self) -> "Wind":
        if self.surface is not None and self.surface >= self.height:
            raise contradiction("surface must lie below height: the lid is inside the bed")
        return self
