"""Eddies that a grid of air resolves over a patch; writes eddies.csv and gusts.csv beside this file.

python -m doe.wind.gusts eddies LABEL SETTING...    air over the resting bed: does its turbulence last?
python -m doe.wind.gusts below ARM U_STAR SEED...   grains under one wind: how many leave their places?

LABEL is free; SETTINGs change `scenes/gusty_patch.toml`. ARM is `eddies` (the scene as it is), `calm` (the
same grid under a mixing length, which no eddy survives) or `column` (a single column of air under its lid).
"""

import csv
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from doe.common.command import words
from taichi_erosion.air.readback import face_velocities
from taichi_erosion.air.step import advance_active
from taichi_erosion.core.setup import Floats, Numerics
from taichi_erosion.coupling.grid_exchange import match_air_to_grains
from taichi_erosion.run.threshold_search import periodic_displacement
from taichi_erosion.scene import build_setup, laws, load_scene
from taichi_erosion.simulation import Simulation, advance, assemble, failure, snapshot, spin_up_wind

FOLDER = Path(__file__).parent
SCENE = FOLDER.parents[1] / "scenes" / "gusty_patch.toml"
WIND = 0.4  # m s-1, u* of the flows without moving grains
SETTLE = 0.03  # s, in still air
TURNOVERS, SAMPLES = 20.0, 10  # length of a flow over H/u*, samples in each of them
WATCH, CHECK = 0.15, 5e-3  # s: how long grains are watched, and how often
MOVED = 0.5  # diameters from its place by which a grain has moved
DIAMETER = 0.25e-3  # m
ARMS = {
    "eddies": (),
    "calm": ("wind.closure=mixing_length",),
    "column": ("wind.columns=[1,1]", "wind.closure=mixing_length", "wind.drive=lid", "wind.look_steps=20"),
}


def patch(orders: Sequence[str], seed: int) -> Simulation:
    """The scene at rest in still air, on one thread."""
    scene = load_scene(SCENE, orders)
    sim = assemble([build_setup(scene, seed)], laws(scene), Numerics("cpu", 1))
    advance(sim, [SETTLE])
    return sim


def profiles(sim: Simulation) -> tuple[Floats, ...]:
    """Layer by layer: mean wind, deviations of u, v, w [m s-1], stress of eddies over rho [m2 s-2]."""
    assert sim.coupling.air is not None
    u, v, w = face_velocities(sim.coupling.air, 0)
    along, across = 0.5 * (u[1:] + u[:-1]), 0.5 * (v[:, 1:] + v[:, :-1])
    upward, mean = 0.5 * (w[:, :, 1:] + w[:, :, :-1]), along.mean(axis=(0, 1))
    parts = (part.std(axis=(0, 1)) for part in (along, across, upward))
    return mean, *parts, -((along - mean) * upward).mean(axis=(0, 1))


def eddies(label: str, orders: Sequence[str]) -> Iterator[dict[str, Any]]:
    """The flow over the resting bed, turnover by turnover."""
    sim = patch((*orders, "wind.turnovers=0.0"), 1)
    air, setup = sim.coupling.air, sim.setups[0].air
    assert air is not None
    assert setup is not None
    spin_up_wind(sim, 0, WIND)
    height, unit = setup.high[2] - setup.ground, setup.viscosity / WIND
    above = 0.5 * (setup.faces_z[1:] + setup.faces_z[:-1]) - setup.ground
    every = max(int(height / WIND / SAMPLES / setup.time_step), 1)
    for turnover in range(int(TURNOVERS)):
        found = []
        for _ in range(SAMPLES):
            for _ in range(every):
                advance_active(air, 1, sim.chunk)
            match_air_to_grains(sim.world, sim.coupling, 1, sim.chunk)
            found.append(profiles(sim))
        mean, *deviation, stress = np.mean(found, axis=0)
        yield {
            "label": label,
            "turnover": turnover + 1,
            "cells": "x".join(map(str, setup.cells)),
            "length": setup.high[0] / unit,
            "width": setup.high[1] / unit,
            "height": height / unit,
            "u_lid": mean[-1] / WIND,
            **{f"sigma_{axis}": part.max() / WIND for axis, part in zip("uvw", deviation, strict=True)},
            "eddy_stress": stress.max() / WIND**2,
            "sigma_u_bed": float(np.interp(0.5 * DIAMETER, above, deviation[0])) / WIND,
        }


def below(arm: str, wind: float, seed: int) -> dict[str, Any]:
    """How many grains of one bed leave their places under one wind."""
    sim = patch(ARMS[arm], seed)
    setup = sim.setups[0]
    spin_up_wind(sim, 0, wind)
    place, size, period = snapshot(sim, 0).position, 2.0 * setup.grains.radius, np.array(setup.period[:2])
    rolled = risen = np.zeros(len(place), bool)
    flux, gusts = [], []
    for check in range(1, round(WATCH / CHECK) + 1):
        advance(sim, [SETTLE + check * CHECK])
        state = snapshot(sim, 0)
        moved = periodic_displacement(state.position, place, period)
        rolled = rolled | (np.hypot(moved[:, 0], moved[:, 1]) > MOVED * size.mean())
        risen = risen | (moved[:, 2] > MOVED * size.mean())
        flux.append(float((state.mass * state.velocity[:, 0]).sum() / period.prod()))
        if sim.coupling.host_driven:
            gusts.append(profiles(sim)[1].max() / wind)
    stopped = failure(sim, 0)
    return {
        "arm": arm,
        "u_star": wind,
        "seed": seed,
        "grains": len(place),
        "rolled": int(rolled.sum()),
        "risen": int(risen.sum()),
        "flux": float(np.mean(flux)),
        "sigma_u": float(np.mean(gusts)) if gusts else 0.0,
        "note": "" if stopped is None else stopped.status.name.lower(),
    }


def note(name: str, row: dict[str, Any]) -> None:
    """Add a row to a table."""
    path = FOLDER / name
    fresh = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(row), lineterminator="\n")
        if fresh:
            table.writeheader()
        table.writerow(
            {key: f"{value:.4g}" if isinstance(value, float) else value for key, value in row.items()}
        )


def main(asked: Sequence[str]) -> None:
    """What the command line asks for."""
    match asked:
        case ["eddies", label, *orders]:
            for row in eddies(label, orders):
                note("eddies.csv", row)
        case ["below", arm, wind, *seeds]:
            for seed in seeds:
                note("gusts.csv", below(arm, float(wind), int(seed)))
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main(words(__doc__))
