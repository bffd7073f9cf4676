"""Single grains that fly, bounce and roll under one effect, beside an independent integration or a formula.

A grain leaves the bed and hops through the wind; the same hop is integrated by SciPy from the forces as the
papers give them, in the wind that the simulation had. A grain falls on a plate at several speeds. A grain on
a tilted plane rolls, or does not.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import atan, cos, exp, pi, sin, sqrt, tanh
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.effect import read_effect_entries
from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.core.snapshot import AirProfile
from taichi_erosion.effect_library import load_library
from taichi_erosion.scene import Scene, laws, parse_scene
from taichi_erosion.simulation import (
    advance,
    air_profile,
    assemble,
    effective_scene,
    prepare,
    snapshot,
    spin_up_wind,
)
from tests.verification.reference.flow import Stream, two_limits

Floats = NDArray[np.float64]

DIAMETER, DENSITY = 2.5e-4, 2650.0  # m, kg m-3: quartz sand
AIR, VISCOSITY = 1.225, 1.46e-5  # kg m-3, m2 s-1
GRAVITY = 9.81  # m s-2
WIND = 0.4  # friction velocity [m s-1]
START = (0.5, 1.0)  # velocity of the grain along the wind and upwards [m s-1]
SPIN = 600.0  # rad s-1, forwards, as impacts on a bed give
YOUNG = 1e6  # Pa
MASS = DENSITY * pi / 6.0 * DIAMETER**3  # kg
FLIGHT, SAMPLES = 0.15, 150  # s, 1: until the grain is on its way down
DROPS = (0.1, 0.3, 1.0, 3.0)  # m s-1
SLOPES = 0.8 + 0.01 * np.arange(41)  # tan of the slope over the rolling friction that should hold [1]
ROLL = 0.2  # s
ROLLED = 1e-4  # rad, beyond what the spring of a grain at rest bends (Ai et al. 2011): about mu_r


@dataclass(frozen=True)
class Hop:
    """What is compared of a hop."""

    height: float  # m above the start
    length: float  # m until the top
    spin: float  # rad s-1 at the top


def one_grain(position: Sequence[float], velocity: Sequence[float], **sections: Any) -> dict[str, Any]:
    """Table of a scene of one grain above a plane."""
    grain = {"position": tuple(position), "velocity": tuple(velocity), "spin": (0.0, SPIN, 0.0)}
    table: dict[str, Any] = {
        "scene": {"kind": "saltation", "title": "one grain"},
        "grains": {"count": 1, "material": "sand", "size": {"law": "monodisperse", "diameter": DIAMETER}},
        "materials": {"sand": {"density": DENSITY, "young_modulus": YOUNG, "poisson_ratio": 0.25}},
        "contact": {"sand-sand": {"restitution": 1.0, "friction_sliding": 0.0}},
        "geometry": {"floor": {"shape": "plane", "material": "sand"}},
        "fill": {"law": "positions", "grains": [grain]},
        "stages": [{"name": "go", "until": "time", "duration_max": FLIGHT}],
    }
    return table | sections


def hop_scene(effect: str) -> Scene:
    """A grain that leaves the bed under an effect, or under none where the name is empty."""
    wind = {
        "length": 0.5,
        "width": 0.02,
        "height": 0.15,
        "surface": 0.0,
        "drag": "two_limits",
        "density": AIR,
        "viscosity": VISCOSITY,
        "friction_velocity": WIND,
        "look_steps": 1,
    }
    effects = {effect: {"strength": 1.0}} if effect else {}
    table = one_grain(
        (0.02, 0.01, DIAMETER), (START[0], 0.0, START[1]), wind=wind, effects=effects, run={"time_step": 1e-5}
    )
    return parse_scene(table, "hop")


def simulated_hops(effects: Sequence[str]) -> tuple[list[Hop], AirProfile]:
    """Hops under each effect, and the wind they were in."""
    library = load_library()
    sim = assemble(
        [prepare(hop_scene(name), 1, library) for name in effects],
        Laws(drag="two_limits"),
        Numerics(threads=1, precision="f64"),
    )
    for replica in range(len(effects)):
        spin_up_wind(sim, replica, WIND, anew=True)
    wind, paths = air_profile(sim, 0), []
    for time in np.linspace(0.0, FLIGHT, SAMPLES + 1)[1:]:
        advance(sim, [float(time)] * len(effects))
        paths.append([snapshot(sim, replica) for replica in range(len(effects))])
    stop_device()
    tops = [max((row[k] for row in paths), key=lambda s: s.position[0, 2]) for k in range(len(effects))]
    return [Hop(s.position[0, 2] - DIAMETER, s.position[0, 0] - 0.02, s.spin[0, 1]) for s in tops], wind


Push = Callable[[float, float, Floats, float, float, Any], tuple[float, float, float]]


def expected_hop(effect: str, wind: AirProfile) -> Hop:
    """The same hop by SciPy, sampled at the same times."""
    centre = 0.5 * (wind.face[1:] + wind.face[:-1])
    params, _ = read_effect_entries(load_library()[effect], {}) if effect else (None, 0.0)

    def rates(time: float, state: Floats) -> list[float]:
        _, height, along, upwards, spin = state
        air = float(np.interp(height, centre, wind.velocity[:, 0]))
        shear = (float(np.interp(height + 1e-6, centre, wind.velocity[:, 0])) - air) / 1e-6
        slip = np.array([air - along, -upwards])
        speed = max(float(np.hypot(*slip)), 1e-12)
        drag = two_limits(Stream(speed, DIAMETER, AIR, AIR * VISCOSITY)) / speed
        force_x, force_z, twist = (
            PUSHES[effect](height, spin, slip, speed, shear, params) if effect else (0.0, 0.0, 0.0)
        )
        weight = GRAVITY * (1.0 - AIR / DENSITY)
        return [
            along,
            upwards,
            (drag * slip[0] + force_x) / MASS,
            (drag * slip[1] + force_z) / MASS - weight,
            twist / (0.1 * MASS * DIAMETER**2),
        ]

    times = np.linspace(0.0, FLIGHT, SAMPLES + 1)
    start = [0.0, DIAMETER, START[0], START[1], SPIN]
    path = solve_ivp(rates, (0.0, FLIGHT), start, t_eval=times, rtol=1e-8, atol=1e-10, max_step=1e-4).y
    top = int(np.argmax(path[1]))
    return Hop(path[1, top] - DIAMETER, path[0, top], path[4, top])


def magnus(height: float, spin: float, slip: Floats, speed: float, shear: float, params: Any) -> Any:
    """Loth (2008) on Rubinow & Keller (1961): (pi/8) rho d^3 C w x (v - u)."""
    relative = spin - 0.5 * shear
    reynolds, turn = speed * DIAMETER / VISCOSITY, abs(relative) * DIAMETER / speed
    factor = 1.0 - (0.675 + 0.15 * (1.0 + tanh(0.28 * (turn - 2.0)))) * tanh(0.18 * sqrt(reynolds))
    lift = pi / 8.0 * AIR * DIAMETER**3 * factor * relative
    return -lift * slip[1], lift * slip[0], 0.0


def spin_drag(height: float, spin: float, slip: Floats, speed: float, shear: float, params: Any) -> Any:
    """Dennis et al. (1980): pi mu d^3 w at small Re_w, beyond it a coefficient over rho (d/2)^5 w^2 / 2."""
    relative = spin - 0.5 * shear
    reynolds = DIAMETER**2 * abs(relative) / VISCOSITY
    if reynolds < 32.0:
        return 0.0, 0.0, -pi * AIR * VISCOSITY * DIAMETER**3 * relative
    coefficient = 6.45 / sqrt(reynolds) + 32.1 / reynolds
    return 0.0, 0.0, -(coefficient / 32.0) * AIR * DIAMETER**5 * abs(relative) * relative


def field(height: float, spin: float, slip: Floats, speed: float, shear: float, params: Any) -> Any:
    """Pull of the bed on a charged grain in flight; near the bed a sphere on a conducting plane."""
    aloft = min(max((height - 0.5 * DIAMETER) / DIAMETER, 0.0), 1.0)
    lift = 1.3687236 * (0.5 * DIAMETER * params.field) ** 2 / 8.9875518e9
    pull = params.charge * MASS * params.field * exp(-height / params.scale_height)
    return 0.0, (1.0 - aloft) * lift - aloft * pull, 0.0


def wall_drag(height: float, spin: float, slip: Floats, speed: float, shear: float, params: Any) -> Any:
    """Zeng et al. (2009) over Schiller & Naumann, less one, times the drag of the hop."""
    gap, reynolds = max(height / DIAMETER - 0.5, 0.0), speed * DIAMETER / VISCOSITY
    creeping = 1.0 + 0.138 * exp(-2.0 * gap) + 9.0 / (16.0 * (1.0 + 2.0 * gap))
    share = 0.15 - 0.046 * (1.0 - 0.16 * gap**2) * exp(-0.7 * gap)
    power = 0.687 + 0.066 * (1.0 - 0.76 * gap**2) * exp(-(gap**0.9))
    more = creeping * (1.0 + share * reynolds**power) / (1.0 + 0.15 * reynolds**0.687) - 1.0
    drag = more * two_limits(Stream(speed, DIAMETER, AIR, AIR * VISCOSITY)) / speed
    return drag * slip[0], drag * slip[1], 0.0


def saffman(height: float, spin: float, slip: Floats, speed: float, shear: float, params: Any) -> Any:
    """Saffman (1965) with Mei's (1992) factor, fading into the law of Zeng et al. (2009) on the bed."""
    reynolds = speed * DIAMETER / VISCOSITY
    ratio = 0.5 * abs(shear) * DIAMETER / speed
    curb = 0.3314 * sqrt(ratio)
    factor = (
        (1.0 - curb) * exp(-reynolds / 10.0) + curb if reynolds <= 40.0 else 0.0524 * sqrt(ratio * reynolds)
    )
    free = 1.615 * DIAMETER**2 * AIR * sqrt(VISCOSITY * abs(shear)) * factor * np.sign(shear)
    along = slip[0] * DIAMETER / VISCOSITY
    bed = pi / 8.0 * AIR * DIAMETER**2 * slip[0] * abs(slip[0]) * 3.663 / (along**2 + 0.1173) ** 0.22
    near = 1.0 - min(max((height - 0.5 * DIAMETER) / DIAMETER, 0.0), 1.0)
    return -(1.0 - near) * free * slip[1], (1.0 - near) * free * slip[0] + near * bed, 0.0


PUSHES: dict[str, Push] = {
    "magnus_lift": magnus,
    "rotational_drag": spin_drag,
    "electric_field": field,
    "shear_lift": saffman,
    "near_wall_drag": wall_drag,
}


def simulated_bounces() -> tuple[Floats, Floats]:
    """Restitution of a grain on a plate at the speeds DROPS, bare and under `restitution_speed`."""
    library, setups = load_library(), []
    for effects in ({}, {"restitution_speed": {"strength": 1.0}}):
        for speed in DROPS:
            table = one_grain(
                (0.0, 0.0, 0.502 * DIAMETER),
                (0.0, 0.0, -speed),
                effects=effects,
                gravity={"magnitude": 0.0},
                run={"time_step": 2e-7, "overlap_limit": 0.9},
            )
            setups.append(prepare(parse_scene(table, "bounce"), 1, library))
    sim = assemble(setups, Laws(), Numerics(threads=1, precision="f64"))
    advance(sim, [2e-3] * len(setups))
    after = np.array([snapshot(sim, k).velocity[0, 2] for k in range(len(setups))])
    stop_device()
    ratio = after.reshape(2, -1) / np.array(DROPS)
    return ratio[0], ratio[1]


def expected_bounces() -> Floats:
    """Ramirez et al. (1999): e = 1 - q x + (3/5) q^2 x^2, x = (v / v_r)^(1/5)."""
    params = load_library()["restitution_speed"].params()
    loss = params.loss * (np.array(DROPS) / params.speed) ** 0.2
    return 1.0 - loss + 0.6 * loss**2


def steepest_rest(angularity: float) -> float:
    """Steepest slope on which a grain does not roll under `rolling_resistance`, as a tangent [1]."""
    library = load_library()
    params = library["rolling_resistance"].params()
    held = SLOPES * params.friction_rolling * angularity
    scenes = [rolling_scene(angularity, float(slope)) for slope in held]
    law = laws(effective_scene(scenes[0], library))
    sim = assemble([prepare(scene, 1, library) for scene in scenes], law, Numerics(threads=1))
    advance(sim, [ROLL] * len(scenes))
    speeds = np.array([np.linalg.norm(snapshot(sim, k).velocity[0]) for k in range(len(scenes))])
    stop_device()
    return float(held[speeds < ROLLED * GRAVITY * ROLL].max(initial=0.0))


def rolling_scene(angularity: float, slope: float) -> Scene:
    """A grain on a plane whose gravity leans."""
    angle = atan(slope)
    table = one_grain(
        (0.0, 0.0, 0.5 * DIAMETER),
        (0.0, 0.0, 0.0),
        conditions={"angularity": angularity},
        effects={"rolling_resistance": {"strength": 1.0}},
        gravity={"direction": (sin(angle), 0.0, -cos(angle))},
        contact={"sand-sand": {"restitution": 0.1, "friction_sliding": 1.0, "friction_rolling": 0.0}},
    )
    table["fill"]["grains"][0]["spin"] = (0.0, 0.0, 0.0)
    return parse_scene(table, "incline")
