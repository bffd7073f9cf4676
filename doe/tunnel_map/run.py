"""The map u*(U) of the working section; writes map.csv and variants.csv beside this file.

python -m doe.tunnel_map.run
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from doe.common.command import words
from doe.common.tables import write_lines
from taichi_erosion.air.grid import allocate_air
from taichi_erosion.air.readback import air_snapshot
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import AirSetup
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import Numerics
from taichi_erosion.measures.boundary_layer import (
    Profile,
    boundary_layer_thickness,
    displacement_thickness,
    flat_plate_thickness,
    free_stream_speed_by_coles,
    momentum_thickness,
    wind_profile_at,
)
from taichi_erosion.scene.load import load_air_scene
from taichi_erosion.scene.preparation.air import build_air

FOLDER = Path(__file__).parent
SCENE = FOLDER.parent.parent / "scenes" / "tunnel_section.toml"
SPEEDS = (5.0, 5.5, 6.0, 6.5, 7.0, 7.5, 9.0, 11.0, 13.0)  # m s-1; the last ones for thresholds beyond 7.5
VARIED = 6.5  # m s-1, the speed at which choices are varied
PLACE, SHIFT = 6.0, 1.0  # m from the inlet where the bed is, and how far the start of the layer may lie off
PASSAGES = 2.5  # lengths of the section that the wind aloft travels
CELLS, COARSE = (96, 1, 40), (48, 1, 20)
SHARES = (0.075, 0.10)  # outer mixing length over the thickness, beside the scene's 0.09
ROUGHNESS_FACTORS = (0.5, 2.0)
PLANE = ("air.sides.y_low.kind=symmetry", "air.sides.y_high.kind=symmetry")


def flat_plate_friction(speed: float, thick: float, roughness: float, viscosity: float) -> float:
    """Friction velocity under a wind aloft [m s-1]: the inverse of `free_stream_speed_by_coles`."""
    friction = 0.04 * speed
    for _ in range(50):  # gains a digit a round
        friction *= speed / free_stream_speed_by_coles(friction, thick, roughness, viscosity)
    return friction


def setup_at(speed: float, cells: tuple[int, int, int] = CELLS, *more: str) -> AirSetup:
    """The plane of symmetry of the section under a wind [m s-1]."""
    orders = (f"air.inlet.speed={speed}", f"air.cells={list(cells)}", *PLANE, *more)
    scene = load_air_scene(SCENE, orders)
    return build_air(scene, scene.run.seed)


def variants() -> dict[str, AirSetup]:
    """The section with one choice changed, on the same cells."""
    base = setup_at(VARIED)
    found = {
        f"length_share {share}": setup_at(VARIED, CELLS, f"air.length_share={share}") for share in SHARES
    }
    bed = base.sides["z_low"]
    for factor in ROUGHNESS_FACTORS:
        rough = replace(bed, roughness=factor * bed.roughness)
        found[f"roughness x {factor}"] = replace(base, sides=base.sides | {"z_low": rough})
    return found


def settled(setups: Sequence[AirSetup], places: Sequence[float]) -> list[list[Profile]]:
    """Profiles at some places [m] when the wind has passed PASSAGES times, one list a setup."""
    start_device(Numerics())
    air = allocate_air(setups)
    length = setups[0].high[0]
    steps = [PASSAGES * length / (speed_of(setup) * setup.time_step) for setup in setups]
    advance_air(air, round(max(steps)))
    states = [air_snapshot(air, replica) for replica in range(len(setups))]
    return [[wind_profile_at(state, place) for place in places] for state in states]


def speed_of(setup: AirSetup) -> float:
    """Wind at the inlet [m s-1]."""
    assert setup.inlet_shape is not None
    return float(setup.inlet_shape.max())


def uncertainty_rows(base: Sequence[Profile], changed: dict[str, Profile]) -> list[dict[str, float | str]]:
    """What every choice changes in u*, relative to the base."""
    known = base[1].friction_velocity
    starts = {"layer starts 1 m later": base[0], "layer starts 1 m earlier": base[2]}
    felt = {name: profile.friction_velocity for name, profile in (changed | starts).items()}
    return [
        {"choice": name, "friction_velocity": wind, "relative_change": wind / known - 1.0}
        for name, wind in felt.items()
    ]


def relative_uncertainty(rows: Sequence[dict[str, float | str]]) -> float:
    """Root of the sum of squares of the larger change of each choice [1]."""
    largest: dict[str, float] = {}
    for row in rows:
        choice, change = str(row["choice"]), abs(float(row["relative_change"]))
        kind = choice.split()[0]
        largest[kind] = max(largest.get(kind, 0.0), change)
    return float(np.sqrt(sum(change**2 for change in largest.values())))


def map_row(speed: float, profile: Profile, share: float, roughness: float) -> dict[str, float]:
    """One row of the map."""
    plate = flat_plate_thickness(speed, PLACE, profile.viscosity)
    return {
        "speed": speed,
        "place": PLACE,
        "friction_velocity": profile.friction_velocity,
        "friction_velocity_sd": share * profile.friction_velocity,
        "ratio": profile.friction_velocity / speed,
        "wind_aloft": profile.wind_aloft,
        "layer_thickness": boundary_layer_thickness(profile),
        "displacement_thickness": displacement_thickness(profile),
        "momentum_thickness": momentum_thickness(profile),
        "plate_thickness": plate,
        "plate_friction_velocity": flat_plate_friction(speed, plate, roughness, profile.viscosity),
    }


def main() -> None:
    """Run all speeds and variants as one ensemble, the coarse grid apart."""
    changed = variants()
    places = (PLACE - SHIFT, PLACE, PLACE + SHIFT)
    found = settled([*map(setup_at, SPEEDS), *changed.values()], places)
    coarse = settled([setup_at(VARIED, COARSE, "air.lowest=0.008")], (PLACE,))[0][0]
    profiles = dict(zip(SPEEDS, found, strict=False))
    varied = {name: rows[1] for name, rows in zip(changed, found[len(SPEEDS) :], strict=True)}
    choices = uncertainty_rows(profiles[VARIED], varied | {"half the cells": coarse})
    share = relative_uncertainty(choices)
    roughness = setup_at(VARIED).sides["z_low"].roughness
    write_lines(FOLDER / "variants.csv", choices, digits=6)
    rows = [map_row(s, found[1], share, roughness) for s, found in profiles.items()]
    write_lines(FOLDER / "map.csv", rows, digits=6)


if __name__ == "__main__":
    words(__doc__)
    main()
