"""Cases of beds of sand under wind, whose thresholds stand bed by bed in beds.csv."""

from math import sqrt
from pathlib import Path

from doe.common.cases import DRAG_ALONE, Case, settings, size_order
from tests.verification.reference.hopping import Sand

FOLDER = Path(__file__).parent
TABLE = FOLDER / "beds.csv"
SCENE = "scenes/wind_threshold.toml"
MILLI = 1e-3
REFERENCE = 0.25e-3  # m, to which the values below belong
MODULUS, SLEEP = 6e4, 1e-3  # Pa; s at rest after which deep grains are held
SIDE, GRAINS = 14.0, 784  # of the patch in diameters: four grains on the square of a diameter
FIRST = 0.07  # of sqrt((s - 1) g d), from where winds grow [1]
FORCES = ("near_wall_drag", "rotational_drag", "shear_lift", "turbulent_gusts", "dry_adhesion")
WITH, HINDERED, BARE = "forces", "hindered", "bare"  # kinds of cases
WHOLE, LONGER = "whole", "longer"  # as HINDERED, with the adhesion of a whole grain; and watched for longer
EACH = "effects.dry_adhesion.contacts=1"  # the pull of a whole grain in every contact, as first simulated
LAW = 'wind.drag="two_limits_hindered"'
# as LONGER, with gusts that are short near the bed; and by the drag of a grain alone; and three times as long
WALL, WALL_ALONE, SLOW = "wall", "wall_alone", "wall_slow"
WALL_TIMES = {WALL: 10, WALL_ALONE: 10, SLOW: 30}  # correlation time of gusts, nu / u*^2
DIAMETERS = (1.0, 0.5, 0.25, 0.15, 0.1)  # mm
SOME = (1.0, 0.25, 0.1)  # mm, of WHOLE
MOST = (1.0, 0.5, 0.25, 0.1)  # mm, of SLOW
WATCHED = (LONGER, *WALL_TIMES)  # for longer
HOLD = 1.5  # s, in which a bed may start of these; of the others, 0.3 s
BEDS, FEWER = 5, 3  # of a case
FINE = 0.2  # mm, below which steps are so short that beds are fewer
KEPT = 1  # rounds of bisection after the step of six percent


def names() -> list[str]:
    """All cases, in the order in which they are simulated."""
    sizes = dict.fromkeys((HINDERED, WITH, BARE), DIAMETERS) | {WHOLE: SOME}
    sizes |= dict.fromkeys(WATCHED, DIAMETERS) | {SLOW: MOST}
    return [f"{kind}/{size:g}" for kind in sizes for size in sizes[kind]]


def case_of(name: str) -> Case:
    """Orders of a case."""
    kind, size = name.split("/")
    diameter = MILLI * float(size)
    ratio = diameter / REFERENCE
    first = FIRST * Sand(diameter).scale
    orders = (
        DRAG_ALONE,
        size_order(diameter),
        *(f"materials.{one}.shear_modulus={MODULUS * ratio:.6g}" for one in ("soil", "ground")),
        f"grains.count={GRAINS}",
        "fill.pitch_d=1.32",
        f"wind.sleep_after={SLEEP * sqrt(ratio):.4g}",
        f"threshold.first={first:.4g}",
        f"threshold.levels={KEPT}",
        *(f"effects.{effect}.strength=1" for effect in (FORCES if kind != BARE else ())),
        *((EACH,) if kind in (WITH, HINDERED) else ()),
        *((LAW,) if kind in (HINDERED, WHOLE, LONGER, WALL, SLOW) else ()),
        *((f"threshold.hold={HOLD:g}",) if kind in WATCHED else ()),
        *((f"effects.turbulent_gusts.wall_timescale={WALL_TIMES[kind]}",) if kind in WALL_TIMES else ()),
    )
    return Case("fluid", name, settings(*orders), FEWER if float(size) < FINE or kind in WATCHED else BEDS)
