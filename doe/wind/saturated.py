"""Saturated transport of sands of many diameters in steady winds; writes saturated.csv beside this file.

python -m doe.wind.saturated                every sand that has no rows yet
python -m doe.wind.saturated GROUP/SAND...  some anew, as impact/0.24 or adhesion/0.1

Four winds over each sand, as far above the one in which a single grain goes on (hopping.csv). Hops last and
rise as the wind asks: times go with u*, heights and stiffness with its square. `adhesion` has dry adhesion,
which the contacts of a grain share, in the winds of the same sand without it. One sand is blown with lighter
grains too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from doe.common.cases import Case, perform, read_rows, settings, size_order
from doe.common.command import words
from doe.wind.run import ADHESION, DIAMETERS, FINE
from doe.wind.saturated_sand import BARE, LIGHT, STICKY
from tests.verification.reference.hopping import Sand, hopping_threshold

TABLE = Path(__file__).with_name("saturated.csv")
SCENE = "scenes/saltation.toml"
REFERENCE = 0.25e-3  # m, to which the values below belong
MODULUS, HEIGHT = 1e5, 0.05  # Pa; m, a few times the highest hops
SLEEP = 1e-3  # s at rest after which deep grains are held
STAGES = {1: 0.1, 2: 0.4, 3: 2.0}  # s: the start, the saturation, the mean
SPEED_UP = 2.0  # wind that starts the transport, over the one that follows [1]
GRAINS = 4.0  # on the square of a diameter
COARSE = 0.4e-3  # m, from which adhesion is less than a tenth of the weight
CHEPIL, LIGHT_DIAMETER = 1940.0, 0.24e-3  # kg m-3, m: nearly a sand of Chepil (1945)


@dataclass(frozen=True)
class Blow:
    """A wind and the patch of which it lifts some ten grains."""

    over: float  # friction velocity over that in which one grain goes on [1]
    length: float  # diameters
    width: float  # diameters


WINDS = (Blow(1.7, 28.0, 16.0), Blow(2.2, 28.0, 8.0), Blow(2.65, 16.0, 8.0), Blow(3.1, 16.0, 8.0))


@dataclass(frozen=True)
class Blown:
    """A sand and what is added to the bare model."""

    group: str
    sand: Sand
    orders: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """As it is asked for."""
        return f"{self.group}/{1e3 * self.sand.diameter:g}"


def cases(blown: Blown) -> Iterator[Case]:
    """The four winds over one sand."""
    diameter, density = blown.sand.diameter, blown.sand.density
    goes_on = hopping_threshold(blown.sand)
    faster = goes_on / hopping_threshold(Sand(REFERENCE))
    common = (
        size_order(diameter),
        f"materials.sand.density={density:g}",
        f"materials.sand.shear_modulus={MODULUS * faster**2:.6g}",
        f"wind.height={HEIGHT * faster**2:.4g}",
        f"wind.sleep_after={SLEEP * faster:.4g}",
        *(f"stages.{place}.duration_max={faster * time:.5g}" for place, time in STAGES.items()),
        *blown.orders,
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
        yield Case(blown.group, f"{1e3 * diameter:g} mm, u* {wind:.3g}", settings(*orders))


def sands() -> dict[str, list[Case]]:
    """The cases of every sand, bare ones first."""
    asked = [
        *(Blown(BARE, Sand(d)) for d in DIAMETERS),
        *(Blown(STICKY, Sand(d), (ADHESION,)) for d in FINE if d < COARSE),
        Blown(LIGHT, Sand(LIGHT_DIAMETER, CHEPIL)),
    ]
    return {blown.name: list(cases(blown)) for blown in asked}


def main(asked: Sequence[str]) -> None:
    """Simulate the sands that were asked for."""
    done = {(row.group, row.label) for row in read_rows(TABLE)}
    for name, winds in sands().items():
        if asked and name not in asked:
            continue
        fresh = winds if asked else [case for case in winds if (case.group, case.label) not in done]
        perform(SCENE, fresh, TABLE)


if __name__ == "__main__":
    main(words(__doc__))
