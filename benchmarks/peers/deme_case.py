"""A bed in DEM-Engine 3 on an NVIDIA card: `python -m benchmarks.peers.deme_case CASE WARM_UP STEPS [TILES]`.

CASE is a bed such as cases/bed10k.npz; TILES copies lie along x and as many along y. The last line is JSON.

DEM-Engine has no periodic boundaries. Grains within two diameters of the sides are fixed, so that all others
have the neighbours of the periodic bed; what is found is of the others. Its law is Hertz' with Mindlin's
history and a Coulomb cap. As radius of a contact it takes that of the circle in which two spheres cut each
other, sqrt(2 R* d), where Hertz has sqrt(R* d). All stiffnesses are then too large by sqrt(2), so Young's
modulus is entered over sqrt(2). Rolling friction is a torque Crr F R of constant size against the rotation,
without a spring, R the radius of the grain: Crr is mu_r R* / R. Forces are in single precision.
"""

import json
import sys
import time
from math import pi, sqrt
from typing import Any

import deme  # pyright: ignore[reportMissingImports]
import numpy as np

from benchmarks.peers.cases import Bed, tiled

FREE, FIXED = 0, 1  # families of grains
FIXED_BAND = 2.0  # width along the sides over the diameter [1]
SPEED_MARGIN = 0.1  # m s-1, above the highest speed, in the search for pairs; the default is 3
LEAST_FORCE = 1e-9  # N, of a contact; a grain weighs 1e-5 N


def materials(solver: Any, case: Any) -> tuple[Any, Any]:
    """Grains and floor."""
    elastic = {"E": case["young"] / sqrt(2.0), "nu": case["poisson"], "CoR": case["restitution"]}
    grain = solver.LoadMaterial(elastic | {"mu": case["friction"], "Crr": 0.5 * case["friction_rolling"]})
    pair = {"mu": case["friction_wall"], "Crr": case["friction_rolling"]}
    floor = solver.LoadMaterial(elastic | pair)
    for name, value in pair.items():
        solver.SetMaterialPropertyPair(name, grain, floor, value)
    return grain, floor


def start(case: Any, tiles: int) -> tuple[Any, int]:
    """A solver that is ready, and the number of its free grains."""
    bed, diameter = tiled(Bed(case["position"], tuple(case["period"])), (tiles, tiles)), case["diameter"]
    place, period = bed.position[:, :2], np.array(bed.period)
    aside = np.minimum(place, period - place).min(axis=1)
    family = np.where(aside < FIXED_BAND * diameter, FIXED, FREE)
    solver = deme.DEMSolver([0])
    solver.SetVerbosity("WARNING")
    solver.UseFrictionalHertzianModel()
    grain, floor = materials(solver, case)
    sphere = solver.LoadSphereType(case["density"] * pi / 6.0 * diameter**3, 0.5 * diameter, grain)
    solver.AddClumps(sphere, bed.position.tolist()).SetFamilies(family.tolist())
    solver.AddBCPlane([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], floor)
    high = np.append(period, bed.position[:, 2].max() + 10.0 * diameter) + diameter
    solver.InstructBoxDomainDimension(*((-diameter, float(side)) for side in high))
    solver.SetFamilyFixed(FIXED)
    solver.DisableContactBetweenFamilies(FIXED, FIXED)
    solver.SetGravitationalAcceleration([0.0, 0.0, -case["gravity"]])
    solver.SetTimeStepSize(case["time_step"])
    solver.SetExpandSafetyAdder(SPEED_MARGIN)
    solver.SetCollectAccRightAfterForceCalc(True)  # faster, by its documentation
    solver.Initialize()
    return solver, int(np.count_nonzero(family == FREE))


def contact_ends(solver: Any) -> int:
    """Contacts between grains, each counted at its free grains."""
    found = solver.GetContactDetailedInfo(LEAST_FORCE)
    grains = np.array(found.GetContactType()) == "SS"
    families = np.array([found.GetAOwnerFamily(), found.GetBOwnerFamily()])
    return int(np.count_nonzero(families[:, grains] == FREE))


def main(name: str, warm_up: str, steps: str, tiles: str = "1") -> None:
    """Time one window."""
    with np.load(name) as arrays:
        case = {key: value if value.ndim else float(value) for key, value in arrays.items()}
    step, (solver, grains) = case["time_step"], start(case, int(tiles))
    solver.DoDynamicsThenSync((int(warm_up) - 0.5) * step)  # half a step less: rounding must not add one
    ready, before = time.perf_counter(), solver.GetSimTime()
    solver.DoDynamicsThenSync((int(steps) - 0.5) * step)
    seconds, done = time.perf_counter() - ready, round((solver.GetSimTime() - before) / step)
    ends = contact_ends(solver)
    rates = {"grain_steps_per_s": grains * done / seconds, "contact_steps_per_s": 0.5 * ends * done / seconds}
    figures = rates | {"contacts_per_grain": ends / grains, "steps": done}
    sys.stdout.write("\n" + json.dumps(figures) + "\n")
    sys.stdout.flush()


main(*sys.argv[1:])
