"""Saturated transport of sands of many diameters in steady winds; writes saturated.csv beside this file.

python doe/wind/saturated.py                every sand that has no rows yet
python doe/wind/saturated.py GROUP/SAND...  some anew, as impact/0.24 or adhesion/0.1

Four winds over each sand, as far above the one in which a single grain goes on (hopping.csv). Hops last and
rise as the wind asks: times go with u*, heights and stiffness with its square. Where grains stick with a
multiple of their weight, all goes as if they were heavier by it.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from run import ADHESION, DIAMETERS, FINE, bond_number, size_order

from taichi_erosion.campaign.cases import Case, perform, read_rows, settings
from taichi_erosion.report.blown_sand import STICKY
from taichi_erosion.verification.reference.hopping import Sand, hopping_threshold

TABLE = Path(__file__).with_name("saturated.csv")
SCENE = "scenes/saltation.toml"
BARE = "impact"  # group of the sands without adhesion, as in impact.csv
REFERENCE = 0.25e-3  # m, to which the values below belong
MODULUS, HEIGHT = 1e5, 0.05  # Pa; m, a few times the highest hops
SLEEP = 1e-3  # s at rest after which deep grains are held
STAGES = {1: 0.1, 2: 0.1, 3: 0.1, 4: 0.1, 5: 0.1, 6: 2.0}  # s: the start, four adjustments, the mean
SPEED_UP = 2.0  # wind that starts the transport, over the one that follows [1]
GRAINS = 4.0  # on the square of a diameter


@dataclass(frozen=True)
class Blow:
    """A wind and the patch of which it lifts some ten grains."""

    over: float  # friction velocity over that in which one grain goes on [1]
    length: float  # diameters
    width: float  # diameters


WINDS = (Blow(1.7, 28.0, 16.0), Blow(2.2, 28.0, 8.0), Blow(2.65, 16.0, 8.0), Blow(3.1, 16.0, 8.0))


def cases(diameter: float, sticky: bool) -> Iterator[Case]:
    """The four winds over one sand; the diameter in metres."""
    heavier = (1.0 + bond_number(diameter)) ** 0.5 if sticky else 1.0
    goes_on = heavier * hopping_threshold(Sand(diameter))
    faster = goes_on / hopping_threshold(Sand(REFERENCE))
    common = (
        size_order(diameter),
        "materials.sand.density=2650",
        f"materials.sand.shear_modulus={MODULUS * faster**2:.6g}",
        f"wind.height={HEIGHT * faster**2:.4g}",
        f"wind.sleep_after={SLEEP * faster:.4g}",
        *(f"stages.{place}.duration_max={faster * time:.5g}" for place, time in STAGES.items()),
        *([ADHESION] if sticky else []),
    )
    for blow in WINDS:
        wind = blow.over * goes_on
        winds = {place: wind for place in STAGES} | {1: SPEED_UP * goes_on * WINDS[0].over}
        orders = (
            *common,
            f"grains.count={int(GRAINS * blow.length * blow.width)}",
            f"wind.length_d={blow.length:g}",
            f"wind.width_d={blow.width:g}",
            *(f"stages.{place}.friction_velocity={speed:.5g}" for place, speed in winds.items()),
        )
        group = STICKY if sticky else BARE
        yield Case(group, f"{1e3 * diameter:g} mm, u* {wind:.3g}", settings(*orders))


def sands() -> dict[str, list[Case]]:
    """The cases of every sand, bare ones first."""
    plain = {f"{BARE}/{1e3 * d:g}": list(cases(d, sticky=False)) for d in DIAMETERS}
    return plain | {f"{STICKY}/{1e3 * d:g}": list(cases(d, sticky=True)) for d in FINE}


def main(words: Sequence[str]) -> None:
    """Simulate what was asked for."""
    done = {(row.group, row.label) for row in read_rows(TABLE)} if TABLE.exists() else set()
    for name, asked in sands().items():
        if words and name not in words:
            continue
        fresh = asked if words else [case for case in asked if (case.group, case.label) not in done]
        perform(SCENE, fresh, TABLE)


if __name__ == "__main__":
    main(sys.argv[1:])
