"""Cell-steps per second of air: a wind tunnel, and boxes of wind over a rough floor on growing grids."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_erosion.air.grid import allocate_air
from taichi_erosion.air.step import STAGES, advance_air
from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, AirSide, log_profile, stretched_faces
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import Numerics
from taichi_erosion.scene.build.air import build_air
from taichi_erosion.scene.load import parse_air_scene

AIR = {  # of the box of wind, SI units
    "height": 0.4,
    "lowest": 2e-3,
    "roughness": 1e-4,
    "friction_velocity": 0.3,
    "density": 1.2,
    "viscosity": 1.5e-5,
    "courant": 1.0,
}
AIR_LAYERS, AIR_COLUMNS = 32, (16, 32, 64)
AIR_UNTIMED, AIR_STEPS = 2, 5  # steps before the clock starts, and timed ones
TUNNEL: dict[str, Any] = {  # scenes/tunnel_section.toml
    "scene": {"kind": "tunnel"},
    "run": {"duration": 3.2, "averaging": 0.2, "courant": 1.0},
    "air": {
        "extents": [7.2, 0.6, 1.0],
        "cells": [96, 8, 40],
        "lowest": 4e-3,
        "both_ends": True,
        "density": 1.2,
        "viscosity": 1.5e-5,
        "closure": "mixing_length",
        "advection": "limited",
        "implicitness": 1.0,
        "length_share": 0.09,
        "sides": {
            "x_low": {"kind": "inlet"},
            "x_high": {"kind": "outlet"},
            "y_low": {"kind": "rough", "roughness_length": 0.0},
            "y_high": {"kind": "symmetry"},
            "z_low": {"kind": "rough", "roughness_length": 8.3e-6},
            "z_high": {"kind": "rough", "roughness_length": 0.0},
        },
        "inlet": {"law": "uniform", "speed": 6.5},
    },
}


@dataclass(frozen=True)
class AirCase:
    """A flow that is timed."""

    name: str
    setup: AirSetup


def air_setup(columns: int) -> AirSetup:
    """A square box of wind over a rough floor, under a lid that drives it; cells widen upwards."""
    faces = stretched_faces(0.0, AIR["height"], AIR_LAYERS, AIR["lowest"])
    ends = {"z_low": AirSide("rough", roughness=AIR["roughness"]), "z_high": AirSide("stress")}
    wind = log_profile(0.5 * (faces[1:] + faces[:-1]), AIR["friction_velocity"], AIR["roughness"], 0.4)
    rng = np.random.Generator(np.random.Philox(columns))
    stirred = rng.normal(0.0, AIR["friction_velocity"], (3, columns, columns, AIR_LAYERS))
    stirred[0] += wind
    side = AIR["height"]
    return AirSetup(
        cells=(columns, columns, AIR_LAYERS),
        low=(0.0, 0.0, 0.0),
        high=(side, side, side),
        faces_z=faces,
        sides={name: ends.get(name, AirSide()) for name in SIDES},
        density=AIR["density"],
        viscosity=AIR["viscosity"],
        time_step=AIR["courant"] * side / columns / float(wind.max()),
        model=AirModel(closure="smagorinsky"),
        friction_velocity=AIR["friction_velocity"],
        start=stirred,
    )


def box_of_wind(columns: int) -> AirCase:
    """The box on so many columns a side."""
    return AirCase(f"air, {columns} x {columns} x {AIR_LAYERS} cells", air_setup(columns))


def tunnel_section() -> AirCase:
    """The working section of a wind tunnel."""
    setup = build_air(parse_air_scene(TUNNEL), 0)
    return AirCase("tunnel section, {} x {} x {} cells".format(*setup.cells), setup)


def air_case(case: AirCase, threads: int) -> dict[str, Any]:
    """Cells advanced by one step a second, and iterations of a pressure solve, on one grid of air."""
    workers = start_device(Numerics("cpu", threads, "f64"))
    air = allocate_air([case.setup])
    advance_air(air, AIR_UNTIMED)
    start = time.perf_counter()
    iterations = advance_air(air, AIR_STEPS)
    seconds = time.perf_counter() - start
    rate_of_cells = air.cells[0] * air.cells[1] * air.cells[2] * AIR_STEPS / seconds
    solves = len(STAGES[case.setup.model.scheme]) * AIR_STEPS
    return {
        "case": case.name,
        "threads": threads,
        "precision": "f64",
        "M cell-steps/s": 1e-6 * rate_of_cells,
        "per core": 1e-6 * rate_of_cells / min(threads, workers),
        "pressure iterations": iterations / solves,
    }
