"""What a surface energy means for grains of this size: numbers to print beside it."""

from dataclasses import dataclass
from math import pi, radians, sqrt, tan

from taichi_erosion.scene.contacts import contact_of, surface_energy, young_effective
from taichi_erosion.scene.schema import Scene
from taichi_erosion.scene.sizes import mean_cube, nominal_diameter

SOLID_FRACTION = 0.6  # of a poured heap [1]
COORDINATION = (
    6.0  # contacts of a grain in a heap [1]; solid fraction times it is 3.6, as in sigma_t = 2.7 gamma / d
)
HEAP_SLOPE = radians(30.0)  # slope by which the height of a heap is estimated [rad]
TEAR_OFF = 1.19055  # separation at which a JKR contact breaks, in L^2 / R* [1]
WORK_OF_SEPARATION = 3.34129  # from first touch to tear-off, in pi gamma L^2 [1]
BOND_WARNED = 50.0  # Bond number above which grains hang together against any weight here [1]
STRESS_WARNED = 0.3  # cohesion over the stress at the base of the heap [1]


@dataclass(frozen=True)
class Adhesion:
    """Adhesion between two grains of the nominal diameter."""

    surface_energy: float  # J m-2, as simulated
    pull_off_force: float  # N, 3 pi gamma R*
    bond_number: float  # pull-off force over weight [1]
    tensile_strength: float  # Pa, sigma_t = 3/4 phi Z gamma / d
    sticking_speed: float  # m s-1, below it an impact does not part again
    tear_off_distance: float  # m
    cohesion_over_heap_stress: float  # sigma_t tan(phi_i) / (rho_b g H) [1]


def contact_length(energy: float, radius: float, young: float) -> float:
    """Length scale of a JKR contact [m]:  L = (pi gamma R*^2 / E*)^(1/3)."""
    return (pi * energy * radius**2 / young) ** (1.0 / 3.0)


def tear_off_distance(energy: float, radius: float, young: float) -> float:
    """Separation at which a JKR contact breaks [m]:  1.19055 L^2 / R*."""
    return TEAR_OFF * contact_length(energy, radius, young) ** 2 / radius


def sticking_speed(energy: float, radius: float, young: float, mass: float) -> float:
    """Speed below which an otherwise elastic impact sticks [m s-1].

    m* v_s^2 / 2 = 3.34129 pi gamma L^2,  so  e(v) = sqrt(1 - (v_s / v)^2)
    gamma surface energy [J m-2], m* reduced mass [kg], L contact length [m].
    Reference: Thornton & Ning (1998), Powder Technology 99, 154.
    """
    return sqrt(2.0 * WORK_OF_SEPARATION * pi * energy * contact_length(energy, radius, young) ** 2 / mass)


def heap_height(scene: Scene) -> float:
    """Height of a cone of all grains at 30 degrees [m]:  V = pi H^3 / (3 tan^2)."""
    volume = scene.grains.count * pi / 6.0 * mean_cube(scene.grains.size) / SOLID_FRACTION
    return (3.0 * volume * tan(HEAP_SLOPE) ** 2 / pi) ** (1.0 / 3.0)


def adhesion(scene: Scene) -> Adhesion | None:
    """Adhesion numbers of grain against grain; None where nothing sticks.

    Bo = 3 pi gamma R* / (m g);  sigma_t = (3/4) phi Z gamma / d  (Rumpf 1962 with the JKR pull-off force).
    """
    name = scene.grains.material
    material, contact = scene.materials[name], contact_of(scene, name, name)
    energy = surface_energy(contact, material, material) if contact and scene.laws.normal == "jkr" else 0.0
    if energy <= 0.0:
        return None
    diameter, gravity = nominal_diameter(scene.grains.size), scene.gravity.magnitude
    radius, mass = 0.25 * diameter, material.density * pi / 6.0 * diameter**3
    young = young_effective(material, material)
    strength = 0.75 * SOLID_FRACTION * COORDINATION * energy / diameter
    heap_stress = SOLID_FRACTION * material.density * gravity * heap_height(scene)
    friction = contact.friction_sliding if contact else 0.0
    pull = 3.0 * pi * energy * radius
    return Adhesion(
        surface_energy=energy,
        pull_off_force=pull,
        bond_number=pull / (mass * gravity) if gravity > 0.0 else 0.0,
        tensile_strength=strength,
        sticking_speed=sticking_speed(energy, radius, young, 0.5 * mass),
        tear_off_distance=tear_off_distance(energy, radius, young),
        cohesion_over_heap_stress=strength * friction / heap_stress if gravity > 0.0 else 0.0,
    )


def adhesion_warnings(scene: Scene, sticking: Adhesion | None) -> list[str]:
    """Sentences about adhesion that cannot be what was meant."""
    if sticking is None:
        return []
    lines = []
    if sticking.bond_number > BOND_WARNED:
        lines.append(
            f"Bond number {sticking.bond_number:.3g} exceeds {BOND_WARNED:g}: "
            "a grain carries that many weights; the surface energy is a fitted constant of this grain size, "
            "not a soil property"
        )
    if sticking.cohesion_over_heap_stress > STRESS_WARNED and scene.scene.kind in (
        "repose",
        "collapse",
        "lifting",
    ):
        lines.append(
            f"cohesion is {sticking.cohesion_over_heap_stress:.3g} of the stress under the heap, "
            f"above {STRESS_WARNED:g}: a heap of this size need not fail at any angle"
        )
    return lines
