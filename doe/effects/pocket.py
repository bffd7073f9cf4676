"""A grain in a pocket under wind: the smallest scene in which an effect moves a threshold, with its answer.

The grain lies in a groove across the wind, between two smooth planes that rise by the angle a with
tan(a) = 1 / (2 sqrt(2)): as steep as the saddle over which a grain leaves its place on three equal ones. The
air is laminar, u = u*^2 z / nu, and the patch so large that one grain does not slow it. The grain leaves when
what draws it along the downwind plane exceeds what holds it,

    D cos(a) + L sin(a) = W (cos(t) sin(a) + sin(t) cos(a)) + P sin(2 a)

with D the drag [N], L all forces upwards on it, W the weight less buoyancy, t the slope of the bed, uphill
positive, and P the pull-off force of the upwind plane; the bonds of a cement hold at both planes, along the
way. D follows from the law with two limits at the mean wind over the sphere. What pulls is written here a
second time, from the papers.

The wind begins at once with SOFTLY of its speed. A bond that stretches without loss swings then to twice
its rest length and breaks at half its strength: the work of a constant force F over s is F s = k s^2 / 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import asin, cos, hypot, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root_scalar

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.effect import Effect, read_effect_entries
from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.effect_library import load_library
from taichi_erosion.scene import Scene, parse_scene
from taichi_erosion.scene.preparation.sizes import nominal_diameter
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    effective_scene,
    export_bed,
    import_bed,
    prepare,
    snapshot,
    spin_up_wind,
)
from tests.verification.reference.flow import Stream, two_limits

Floats = NDArray[np.float64]

STEEP = asin(1.0 / 3.0)  # rise of the planes [rad]
PATCH = 150.0  # length and width of the patch in diameters [1]
LID = 60.0  # height of the lid in diameters [1]
RESTITUTION = 0.01  # nearly critical damping: a wind that begins at once does not shake the grain off [1]
CALM = 0.02  # s, in which the grain finds its place
SOFTLY, SOFT_START = 0.95, 0.01  # share of the wind that blows first [1], and how long [s]
YOUNG = 3e6  # Pa: the grain at rest sinks in by less than 1e-3 radii
OVERLAP = 0.9  # of the radius: a grain that a storm throws against the plane is of no interest [1]
SLOWEST, FASTEST = 0.02, 3.0  # winds that are bisected [m s-1]
HALVINGS = 12  # so that a threshold is known to 0.12 %
HOLD = 0.2  # s from rest in which the grain must leave
LOOKS = 20  # at each grain during a hold
GONE = 0.3  # of a diameter that it has then risen or moved [1]
LAWS = Laws(drag="two_limits")
SWINGING = ("surface_crust",)  # bonds that stretch without loss


@dataclass(frozen=True)
class Pocket:
    """One grain, its circumstances, and the effects on it."""

    diameter: float = 2.5e-4  # m
    density: float = 2650.0  # kg m-3
    conditions: tuple[tuple[str, float], ...] = ()
    effect: str = ""  # empty: the bare model
    entries: tuple[tuple[str, float], ...] = (("strength", 1.0),)
    seed: int = 1


def pocket_scene(case: Pocket) -> Scene:
    """The scene of a case, before its effect has changed it."""
    d = case.diameter
    middle, apex = 0.5 * PATCH * d, 0.5 * d * (1.0 - 1.0 / cos(STEEP))
    planes = {
        name: {
            "shape": "plane",
            "material": "sand",
            "point": (middle, 0.0, apex),
            "normal": (face * sin(STEEP), 0.0, cos(STEEP)),
        }
        for name, face in (("upwind", 1.0), ("downwind", -1.0))
    }
    table: dict[str, Any] = {
        "scene": {"kind": "threshold", "title": "a grain in a pocket"},
        "conditions": dict(case.conditions),
        "run": {"overlap_limit": OVERLAP},
        "grains": {"count": 1, "material": "sand", "size": {"law": "monodisperse", "diameter": d}},
        "materials": {"sand": {"density": case.density, "young_modulus": YOUNG, "poisson_ratio": 0.25}},
        "contact": {"sand-sand": {"restitution": RESTITUTION, "friction_sliding": 0.0}},
        "geometry": planes,
        "fill": {"law": "positions", "grains": [{"position": (middle, middle, 0.5 * d)}]},
        "wind": {
            "length": PATCH * d,
            "width": PATCH * d,
            "height": LID * d,
            "surface": 0.0,
            "closure": "none",
            "drag": "two_limits",
        },
        "stages": [{"name": "blow", "until": "time", "duration_max": HOLD}],
    }
    if case.effect:
        table["effects"] = {case.effect: dict(case.entries)}
    return parse_scene(table, "pocket")


def measured_thresholds(cases: Sequence[Pocket]) -> Floats:
    """Friction velocity above which each grain leaves its pocket [m s-1]."""
    return leaving_winds([(pocket_scene(case), case.seed) for case in cases], LAWS)


def leaving_winds(scenes: Sequence[tuple[Scene, int]], laws: Laws, hold: float = HOLD) -> Floats:
    """Friction velocity above which the first grain of each scene leaves its place [m s-1].

    Each scene comes with its seed; winds blow for `hold` [s] from rest and are bisected, all scenes at once.
    """
    library = load_library()
    setups = [prepare(scene, seed, library) for scene, seed in scenes]
    sim = assemble(setups, laws, Numerics(threads=1))
    advance(sim, [CALM] * len(scenes))
    beds = [export_bed(sim, replica) for replica in range(len(scenes))]
    low, high = np.full(len(scenes), np.log(SLOWEST)), np.full(len(scenes), np.log(FASTEST))
    for trial in range(HALVINGS):
        winds = 0.5 * (low + high)
        left = blow(sim, beds, np.exp(winds), CALM + trial * (hold + SOFT_START), hold)
        high = np.where(left, winds, high)
        low = np.where(left, low, winds)
    stop_device()
    return np.exp(0.5 * (low + high))


def blow(
    sim: Simulation, beds: Sequence[dict[str, Any]], winds: Floats, began: float, hold: float
) -> NDArray[np.bool_]:
    """Which grains leave from rest while a wind of their own blows; those are caught before they fly far."""
    left = np.zeros(len(beds), dtype=bool)
    for replica, wind in enumerate(winds):
        import_bed(sim, replica, beds[replica])
        spin_up_wind(sim, replica, SOFTLY * float(wind), anew=True)
    for look in range(LOOKS + 1):
        advance(sim, [began + look / LOOKS * hold + SOFT_START] * len(beds))
        if look == 0:
            for replica, wind in enumerate(winds):
                spin_up_wind(sim, replica, float(wind))
        for replica in map(int, np.flatnonzero(~left)):
            if has_left(sim, replica):
                left[replica] = True
                import_bed(sim, replica, beds[replica])
                spin_up_wind(sim, replica, SLOWEST, anew=True)
    return left


def has_left(sim: Simulation, replica: int) -> bool:
    """Whether the grain is away from its pocket."""
    state, start = snapshot(sim, replica), sim.setups[replica].grains.position[0]
    moved = state.position[0] - start
    return hypot(moved[0], moved[2]) > GONE * 2.0 * state.radius[0]


def expected_threshold(case: Pocket) -> float:
    """Friction velocity at which the forces on the grain balance [m s-1]."""
    library = load_library()
    before = pocket_scene(case)
    after = effective_scene(before, library)

    share = SOFTLY if case.effect in SWINGING else 1.0

    def excess(wind: float) -> float:
        return excess_force(case, after, share * wind, library)

    return float(root_scalar(excess, bracket=(SLOWEST, FASTEST), xtol=1e-7).root)


def excess_force(case: Pocket, scene: Scene, wind: float, library: dict[str, Effect]) -> float:
    """Force along the downwind plane that is left when the grain just leaves [N]."""
    assert scene.wind is not None
    air, d = scene.wind, nominal_diameter(scene.grains)
    solid = scene.materials["sand"].density
    mean = (wind * air.partition) ** 2 * 0.5 * d / air.viscosity
    stream = Stream(mean, d, air.density, air.viscosity * air.density)
    weight = pi / 6.0 * d**3 * (solid - air.density) * scene.gravity.magnitude
    along, _, down = scene.gravity.direction
    held = weight * (-down * sin(STEEP) - along * cos(STEEP)) / hypot(along, down)
    pull, lift = acting_forces(case, solid * pi / 6.0 * d**3, stream, library)
    return two_limits(stream) * cos(STEEP) + lift * sin(STEEP) - held - pull * sin(2.0 * STEEP)


def acting_forces(
    case: Pocket, mass: float, stream: Stream, library: dict[str, Effect]
) -> tuple[float, float]:
    """Pull-off force of a plane and force upwards of the effect of a case [N]."""
    if case.effect not in FORCES:
        return 0.0, 0.0
    params, strength = read_effect_entries(library[case.effect], dict(case.entries))
    pull, lift = FORCES[case.effect](params, dict(case.conditions), mass, stream)
    squared = case.effect == "image_charge"  # whose strength multiplies the charge
    share = 0.5 if case.effect in SWINGING else 1.0
    return share * strength * (strength if squared else 1.0) * pull, strength * lift


def adhesion(params: Any, conditions: dict[str, float], mass: float, stream: Stream) -> tuple[float, float]:
    """Kok & Renno (2009): beta d for a grain, shared by three contacts in a pocket; a plane pulls twice."""
    return 2.0 * params.beta * stream.diameter / sqrt(6.0), 0.0


def bridge(params: Any, conditions: dict[str, float], mass: float, stream: Stream) -> tuple[float, float]:
    """Smooth bridge of a sphere and a plane, 4 pi R gamma cos(theta), times the share of rough grains."""
    free = max(conditions.get("moisture", 0.0) - params.adsorbed, 0.0)
    smooth = 2.0 * pi * stream.diameter * params.surface_tension * cos(params.contact_angle)
    return smooth * min(params.wet_fraction * (100.0 * free) ** params.exponent, 1.0), 0.0


def image(params: Any, conditions: dict[str, float], mass: float, stream: Stream) -> tuple[float, float]:
    """Coulomb's force between a charge and its image at the distance of a diameter."""
    return 8.9875518e9 * (params.charge * mass / stream.diameter) ** 2, 0.0


def cement(params: Any, conditions: dict[str, float], mass: float, stream: Stream) -> tuple[float, float]:
    """Strength of two necks of radius b d along the way of the grain, which rises by x d till they break."""
    along = 2.0 * params.tensile_strength * pi * (params.neck * stream.diameter) ** 2
    return along / sin(2.0 * STEEP), 0.0


def field_lift(params: Any, conditions: dict[str, float], mass: float, stream: Stream) -> tuple[float, float]:
    """Lift of a conducting sphere on a conducting plane: 4 pi eps0 R^2 E0^2 (zeta(3) + 1/6)."""
    return 0.0, 1.3687236 * (0.5 * stream.diameter * params.field) ** 2 / 8.9875518e9


def wall_lift(params: Any, conditions: dict[str, float], mass: float, stream: Stream) -> tuple[float, float]:
    """Zeng et al. (2009): C_L = 3.663 / (Re^2 + 0.1173)^0.22."""
    coefficient = 3.663 / (stream.reynolds**2 + 0.1173) ** 0.22
    return 0.0, pi / 8.0 * stream.density * (stream.diameter * stream.slip) ** 2 * coefficient


FORCES = {
    "dry_adhesion": adhesion,
    "liquid_bridge": bridge,
    "image_charge": image,
    "surface_crust": cement,
    "electric_field": field_lift,
    "shear_lift": wall_lift,
}


def saddle_ratio(slope: float) -> float:
    """Threshold force on a slope [deg] over that on level ground: cos(t) + sin(t) / tan(a)."""
    angle = np.radians(slope)
    return float(cos(angle) + sin(angle) * 2.0 * sqrt(2.0))
