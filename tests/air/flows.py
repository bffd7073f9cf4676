"""Small columns of air for the tests of the air room."""

from typing import Any

import numpy as np

from taichi_erosion.air.grid import Air
from taichi_erosion.core.air_setup import AirModel, AirSetup, AirSide, SideKind, bed_faces, log_profile
from tests.verification.small_scenes import box, centres, sides

FRICTION = 0.3  # m s-1
DENSITY = 1.2  # kg m-3
BED = 2e-3  # m, height of the bed
LID = 0.05  # m


def column(floor: SideKind = "wall", exchange: bool = True, **words: Any) -> AirSetup:
    faces = bed_faces(0.0, BED, LID, 1e-4, 1.2)
    usual: dict[str, Any] = {
        "faces_z": faces,
        "sides": sides(z_low=AirSide(floor, roughness=1e-5), z_high=AirSide("stress")),
        "density": DENSITY,
        "viscosity": 1.5e-5,
        "time_step": 1e-3,
        "model": AirModel("mixing_length", "central", "euler", exchange),
        "friction_velocity": FRICTION,
        "start": log_profile(centres(faces), FRICTION, 1e-5, 0.4),
        "implicitness": 1.0,
    }
    return box((1, 1, len(faces) - 1), (0.01, 0.01, LID), **usual | words)


def put_grains(air: Air, setup: AirSetup, coefficient: float, force: float) -> None:
    """A bed of solid share 0.6 up to BED that resists by `coefficient` and pushes by `force`."""
    inside = setup.faces_z[1:] <= BED * (1.0 + 1e-9)
    for field, value, elsewhere in (
        (air.void_fraction, 0.4, 1.0),
        (air.exchange_coefficient, coefficient, 0.0),
        (air.exchange_force, force, 0.0),
    ):
        values = field.to_numpy()
        layer = np.where(inside, value, elsewhere)
        (values[..., 0] if values.ndim == 5 else values)[:, 1, 1, 1:-1] = layer
        field.from_numpy(values)


def wind(air: Air, replica: int = 0) -> np.ndarray:
    """u of the column by layer."""
    return air.velocity_x.to_numpy()[replica, 1, 1, 1:-1]
