"""Limits of the time step, the step chosen, adhesion numbers: whatever a run prints about its own numbers."""

from collections.abc import Iterator
from itertools import combinations
from math import hypot, pi, radians, sqrt, tan
from typing import Any

import numpy as np

from taichi_erosion.scene.preparation import contacts, sizes
from taichi_erosion.scene.preparation.fill import fall_time, highest_start, inlet_mesh, mesh_volume, saved_bed
from taichi_erosion.scene.preparation.walls import bounding_box_of_wall, distance_to_wall
from taichi_erosion.scene.schema.geometry import Funnel, Plane
from taichi_erosion.scene.schema.grains import Bed, Positions, Pour
from taichi_erosion.scene.schema.scene import Scene

SOLID_FRACTION = 0.6  # of a poured heap [1]
COORDINATION = 6.0  # contacts of a grain in a heap; with the solid fraction sigma_t = 2.7 gamma / d [1]
HEAP_SLOPE = radians(30.0)  # slope by which the height of a heap is estimated [rad]
TEAR_OFF = 1.19055  # separation at which a JKR contact breaks, in L^2 / R* [1]
WORK_OF_SEPARATION = 3.34129  # from first touch to tear-off, in pi gamma L^2 [1]
BOND_WARNED = 50.0  # Bond number above which adhesion outweighs any weight here [1]
STRESS_WARNED = 0.3  # cohesion over the stress at the base of the heap [1]
OUTLET_LEAST = 5.0  # largest grains that the outlet of a funnel should be wide [1]
HERTZ_SHARE = 0.1  # of the duration of an impact at the expected speed: ten steps in a contact [1]
NECK_SHARE = 0.1  # of the time in which grains cross the range of adhesion [1]
DUST = 2e-5  # m, diameter below which a grain is carried in suspension (docs/physics.md)
SPEED_SHARE = 0.05  # of the smallest radius that a grain may move in one step [1]


def jkr_length_scale(energy: float, radius: float, young: float) -> float:
    """Length scale of a JKR contact [m]:  L = (pi gamma R*^2 / E*)^(1/3)."""
    return (pi * energy * radius**2 / young) ** (1.0 / 3.0)


def jkr_tear_off_distance(energy: float, radius: float, young: float) -> float:
    """Separation at which a JKR contact breaks [m]:  1.19055 L^2 / R*."""
    return TEAR_OFF * jkr_length_scale(energy, radius, young) ** 2 / radius


def jkr_sticking_speed(energy: float, radius: float, young: float, mass: float) -> float:
    """Speed below which an otherwise elastic impact sticks [m s-1].

    m* v_s^2 / 2 = 3.34129 pi gamma L^2,  so  e(v) = sqrt(1 - (v_s / v)^2)
    gamma surface energy [J m-2], m* reduced mass [kg], L contact length [m].
    Reference: Thornton & Ning (1998), Powder Technology 99, 154.
    """
    return sqrt(2.0 * WORK_OF_SEPARATION * pi * energy * jkr_length_scale(energy, radius, young) ** 2 / mass)


def adhesion_numbers_of_kind(scene: Scene, name: str) -> dict[str, float] | None:
    """Adhesion numbers of two grains of the nominal diameter of one kind; None without adhesion.

    Bo = 3 pi gamma R* / (m g);  sigma_t = (3/4) phi Z gamma / d  (Rumpf 1962 with the JKR pull-off force);
    the stress under a cone of all grains at 30 degrees, of height H:  V = pi H^3 / (3 tan^2).
    """
    material, contact = scene.materials[name], scene.contact_of_materials(name, name)
    if contact is None or contact.surface_energy <= 0.0 or scene.laws.normal != "jkr":
        return None
    energy = contacts.simulated_surface_energy(scene.grains, contact, material, material)
    diameter, gravity = sizes.nominal_diameter(scene.grains.parts[name].size), scene.gravity.magnitude
    radius, mass = 0.25 * diameter, material.density * pi / 6.0 * diameter**3
    young = contacts.effective_young_modulus(material, material)
    strength = 0.75 * SOLID_FRACTION * COORDINATION * energy / diameter
    volume = scene.grains.count * pi / 6.0 * sizes.scene_mean_cubed_diameter(scene) / SOLID_FRACTION
    height = (3.0 * volume * tan(HEAP_SLOPE) ** 2 / pi) ** (1.0 / 3.0)
    heap_stress = SOLID_FRACTION * material.density * gravity * height
    pull, cohesion = 3.0 * pi * energy * radius, strength * contact.friction_sliding
    return {
        "surface_energy": energy,  # J m-2, as simulated
        "pull_off_force": pull,  # N, 3 pi gamma R*
        "bond_number": pull / (mass * gravity) if gravity > 0.0 else 0.0,  # pull-off force over weight [1]
        "tensile_strength": strength,  # Pa, sigma_t
        "sticking_speed": jkr_sticking_speed(energy, radius, young, 0.5 * mass),  # m s-1
        "tear_off_distance": jkr_tear_off_distance(energy, radius, young),  # m
        # sigma_t tan(phi_i) / (rho_b g H) [1]
        "cohesion_over_heap_stress": cohesion / heap_stress if gravity > 0.0 else 0.0,
    }


def adhesion_warnings(scene: Scene, sticking: dict[str, float] | None) -> Iterator[str]:
    if sticking is None:
        return
    bond, stress = sticking["bond_number"], sticking["cohesion_over_heap_stress"]
    if bond > BOND_WARNED:
        note = "a grain carries that many weights; the surface energy is a fitted constant of this grain size"
        yield f"Bond number {bond:.3g} exceeds {BOND_WARNED:g}: {note}, not a soil property"
    if scene.scene.kind in ("repose", "collapse", "lifting") and stress > STRESS_WARNED:
        note = f"above {STRESS_WARNED:g}: a heap of this size need not fail at any angle"
        yield f"cohesion is {stress:.3g} of the stress under the heap, {note}"


def outlet_warnings(scene: Scene) -> Iterator[str]:
    """Sentences about funnels in which grains may arch: spheres jam orifices up to five diameters wide.

    Reference: Zuriguel et al. (2005), Phys. Rev. E 71, 051303.
    """
    largest = sizes.size_range(scene.grains)[1]
    planes = [name for name, wall in scene.geometry.items() if isinstance(wall, Plane)]
    funnels = ((name, wall) for name, wall in sorted(scene.geometry.items()) if isinstance(wall, Funnel))
    for name, wall in funnels:
        if (ratio := 2.0 * wall.outlet_radius / largest) < OUTLET_LEAST:
            reason = f"below {OUTLET_LEAST:g} grains may arch, and the funnel does not empty"
            yield f"geometry.{name}: the outlet is {ratio:.2g} of the largest grains wide; {reason}"
        for plane in planes:
            if distance_to_wall(scene, plane, np.array([wall.outlet]))[0] < 0.0:
                yield f"geometry.{name}: the outlet lies behind the plane '{plane}'"


def inlet_warnings(scene: Scene) -> Iterator[str]:
    """Sentences about inlets that cannot keep their rate: layers of grains fall clear of each other."""
    width = sizes.scene_mean_cubed_diameter(scene) ** (1.0 / 3.0)
    for path, inlet in scene.fill.parts.items() if isinstance(scene.fill, Pour) else ():
        mesh = inlet_mesh(scene, path, inlet)
        clear = fall_time(inlet, 0.5 * sizes.size_range(scene.grains)[1], scene.gravity.magnitude, mesh)
        room = mesh_volume(mesh) / width**3 if inlet.mesh else inlet.area(width) / (0.25 * pi * width**2)
        most = inlet.coverage * room / clear
        mean = scene.grain_density * pi / 6.0 * width**3
        rate = inlet.rate or (inlet.mass_rate or 0.0) / mean
        if rate > 1.2 * most:
            words = f"about {most:.3g} grains a second pass, not {rate:.3g}"
            yield f"{path}: {words}; make it wider, faster or raise its coverage"


def rayleigh_time(radius: float, density: float, shear: float, poisson: float) -> float:
    """Time in which a Rayleigh wave crosses half the surface of a sphere [s].

    T_R = pi R sqrt(rho / G) / (0.1631 nu + 0.8766)
    R radius [m], rho density [kg m-3], G shear modulus [Pa], nu Poisson ratio [1].
    Reference: Thornton & Randall (1988), in Micromechanics of Granular Materials, 133;
    Li, Xu & Thornton (2005), Powder Technology 160, 219.
    """
    return pi * radius * sqrt(density / shear) / (0.1631 * poisson + 0.8766)


def impact_duration(mass: float, radius: float, young: float, speed: float) -> float:
    """Duration of an elastic impact [s].

    t_c = 2.8683 (m*^2 / (R* E*^2 v))^(1/5)
    m* reduced mass [kg], R* reduced radius [m], E* effective modulus [Pa], v speed [m s-1].
    Reference: Johnson (1985), Contact Mechanics, eq. (11.24).
    """
    return 2.8683 * (mass**2 / (radius * young**2 * speed)) ** 0.2


def impact_overlap(mass: float, radius: float, young: float, speed: float) -> float:
    """Deepest overlap of an elastic impact [m].

    delta = (15 m* v^2 / (16 sqrt(R*) E*))^(2/5);  symbols as in `impact_duration`.
    Reference: Johnson (1985), Contact Mechanics, eq. (11.23).
    """
    return (15.0 * mass * speed**2 / (16.0 * sqrt(radius) * young)) ** 0.4


def smallest_radii(scene: Scene) -> dict[str, float]:
    """Radius of the smallest contact sphere that the scene can make [m], by material of the grains."""
    clump = scene.grains.clump
    share = min(radius for _, radius in sizes.spheres_of_clump(clump)) if clump else sizes.SPHERE_REACH
    least = {name: sizes.size_range(part.size)[0] for name, part in scene.grains.parts.items()}
    if isinstance(scene.fill, Positions):
        rows = [(grain.kind or scene.grains.material or "", grain.diameter) for grain in scene.fill.grains]
        placed = {name: low for name, low in least.items() if any(kind == name for kind, _ in rows)}
        least = {name: min(d or low for kind, d in rows if kind == name) for name, low in placed.items()}
    return {name: low * share for name, low in least.items()}


def grain_rayleigh_time(scene: Scene) -> float:
    """Rayleigh time of the contact sphere for which it is shortest [s]; walls do not vibrate."""
    pairs = ((radius, scene.materials[name]) for name, radius in smallest_radii(scene).items())
    return min(rayleigh_time(r, m.density, contacts.shear_modulus(m), m.poisson_ratio) for r, m in pairs)


def time_step(scene: Scene) -> float:
    """The time step of the scene [s]: as stated, or a share of the Rayleigh time."""
    if scene.run.time_step is not None:
        return scene.run.time_step
    return scene.run.time_step_fraction * grain_rayleigh_time(scene)


def largest_expected_speed(scene: Scene) -> float:
    """Largest speed to expect [m s-1]: free fall from the highest start to the lowest wall, and moving walls.

    v = sqrt(v_0^2 + 2 g h)
    """
    top = highest_start(scene, 0.5 * sizes.size_range(scene.grains)[1])
    bottom = min((float(bounding_box_of_wall(scene, name)[0, 2]) for name in scene.geometry), default=top)
    fall = 2.0 * scene.gravity.magnitude * max(top - bottom, 0.0)
    speeds = [sqrt(initial_grain_speed(scene) ** 2 + fall)]
    for stage in scene.stages:
        for name, order in stage.move.items():
            arm = float(abs(bounding_box_of_wall(scene, name) - order.centre).max())
            servo = 0.0 if order.force is None else order.fastest
            servo += 0.0 if order.torque is None else order.fastest * arm
            for row in order.table or [(0.0, *order.velocity, *order.spin)]:
                speeds.append(hypot(*row[1:4]) + hypot(*row[4:7]) * arm + servo)
    return max(speeds)


def initial_grain_speed(scene: Scene) -> float:
    """Speed with which grains start [m s-1]; three standard deviations where it is random."""
    fill = scene.fill
    if isinstance(fill, Positions):
        return max(hypot(*grain.velocity) for grain in fill.grains)
    if isinstance(fill, Bed):
        return float(np.linalg.norm(saved_bed(scene, fill, scene.run.seed)["velocity"], axis=1).max())
    if isinstance(fill, Pour):
        return max(each.speed for each in fill.parts.values())
    return 3.0 * fill.speed_sd * sqrt(scene.gravity.magnitude * sizes.nominal_diameter(scene.grains))


def smallest_grains_of_kinds(scene: Scene) -> Iterator[tuple[str, float, float, float]]:
    """Of the smallest grains of each kind: material, radius [m], mass [kg], effective modulus [Pa]."""
    for name, radius in smallest_radii(scene).items():
        material = scene.materials[name]
        mass = material.density * 4.0 / 3.0 * pi * radius**3
        yield name, radius, mass, contacts.effective_young_modulus(material, material)


def time_step_limits(scene: Scene) -> dict[str, float | None]:
    """Limits of the time step [s]; None where one does not apply."""
    speed, least = largest_expected_speed(scene), list(smallest_grains_of_kinds(scene))
    times: dict[str, float | None] = dict.fromkeys(("rayleigh_time", "hertz", "jkr_neck", "speed"))
    times["rayleigh_time"] = grain_rayleigh_time(scene)
    if speed > 0.0:
        impacts = (impact_duration(0.5 * mass, 0.5 * r, young, speed) for _, r, mass, young in least)
        times["hertz"] = HERTZ_SHARE * min(impacts)
        times["jkr_neck"] = neck_crossing_time(scene, speed)
        times["speed"] = SPEED_SHARE * min(radius for _, radius, _, _ in least) / speed
    return times


def neck_crossing_time(scene: Scene, speed: float) -> float | None:
    """Shortest time to cross the range of adhesion, over all adhesive pairs with a grain in them [s].

    dt = 0.1 * 1.19055 L^2 / (R* v),  L = (pi gamma R*^2 / E*)^(1/3);  R* = R/2 between equal grains, R at a
    wall.
    """
    radii, times = smallest_radii(scene), []
    pairs = [(grain, other) for grain in radii for other in contacts.materials_used(scene)]
    for grain, other in pairs if scene.laws.normal == "jkr" else []:
        contact, radius = scene.contact_of_materials(grain, other), radii[grain]
        a, b = scene.materials[grain], scene.materials[other]
        energy = contacts.simulated_surface_energy(scene.grains, contact, a, b) if contact else 0.0
        reduced = [radius] if other in scene.wall_material_names else []
        reduced += [radius * radii[other] / (radius + radii[other])] if other in radii else []
        for size in reduced if energy > 0.0 else []:
            times.append(jkr_tear_off_distance(energy, size, contacts.effective_young_modulus(a, b)) / speed)
    return NECK_SHARE * min(times) if times else None


def time_step_warnings(chosen: float, limit: dict[str, float | None]) -> Iterator[str]:
    """Sentences about limits that the chosen step exceeds; the Rayleigh limit is a refusal, not a warning."""
    reasons = {
        "hertz": "an impact at the expected speed is resolved by fewer than 10 steps",
        "jkr_neck": "grains cross the range of adhesion in fewer than 10 steps: only resting contacts stick",
        "speed": f"a grain can move more than {SPEED_SHARE:g} radii in one step",
    }
    for name, text in reasons.items():
        bound = limit[name]
        if bound and chosen > bound:
            yield f"time step {chosen:.3g} s exceeds {bound:.3g} s: {text}"


def softening_sentences(scene: Scene) -> Iterator[str]:
    """Softened materials: by how much, and which quantity is kept."""
    for name, material in sorted(scene.materials.items()):
        if material.softening is not None:
            simulated = material.shear_modulus or material.young_modulus or 1.0
            ratio = material.softening.true_modulus / simulated
            quantity = material.softening.rule.replace("_", " ")
            rule = f"(rule '{material.softening.rule}')"
            yield f"{name}: stiffness divided by {ratio:.3g}, {quantity} kept {rule}"


def rolling_friction_sentences(scene: Scene) -> Iterator[str]:
    """Rolling friction over R* where a rolling law acts, and what EDEM calls it.

    The limiting torque is mu F R* here, and mu F R_i on grain i in EDEM's standard model; R* = R / 2 between
    equal grains and R at a wall.
    """
    grains = set(scene.grains.parts)
    for pair, contact in sorted(scene.contact.items()):
        reduced, ends = contact.friction_rolling * contact.rolling_radius_ratio, set(pair.split("-"))
        if scene.laws.rolling == "none" or reduced == 0.0 or not ends & grains:
            continue
        full, which = (reduced / 2.0, " (equal grains)") if ends <= grains else (reduced, "")
        yield f"{pair}: friction_rolling {reduced:.3g}, which is {full:.3g} in EDEM{which}"


def grain_kind_sentences(scene: Scene) -> Iterator[str]:
    """Grains larger than the true ones, and what is kept; several kinds, and pairs whose contact is mixed."""
    if (coarse := scene.grains.coarse_graining) is not None:
        rule = f"{coarse.rule.replace('_', ' ')} kept (rule '{coarse.rule}')"
        pulls = f"surface energy and pulls between grains times {coarse.adhesion_scale:.3g}"
        yield f"{coarse.factor:.3g} times as large as the true ones, {rule}: {pulls}"
    counts = sizes.grain_count_of_kinds(scene) if scene.grains.kinds else {}
    yield from (f"{name}: {count:,} grains" for name, count in counts.items())
    for a, b in combinations(counts, 2):
        contact = scene.contact_of_materials(a, b)
        if contact is not None and not {f"{a}-{b}", f"{b}-{a}"} & set(scene.contact):
            words = f"restitution {contact.restitution:.3g}, friction_sliding {contact.friction_sliding:.3g}"
            yield f"{a}-{b}: geometric means of {a}-{a} and {b}-{b}: {words}"


def step_report(scene: Scene) -> dict[str, Any]:
    """Time step, limits, adhesion and warnings of a scene, for `run --check` and every result; SI units."""
    limit, chosen = time_step_limits(scene), time_step(scene)
    kinds = filter(None, (adhesion_numbers_of_kind(scene, name) for name in scene.grains.parts))
    sticking = max(kinds, key=lambda numbers: numbers["bond_number"], default=None)
    low, high = sizes.size_range(scene.grains)
    warnings = [*time_step_warnings(chosen, limit), *adhesion_warnings(scene, sticking)]
    return {
        "time_step": chosen,
        "time_step_over_rayleigh": chosen / grain_rayleigh_time(scene),
        "limits": limit,
        "expected_speed": largest_expected_speed(scene),
        "diameter": {"low": low, "nominal": sizes.nominal_diameter(scene.grains), "high": high},
        "steps_most": int(sum(stage.duration_max for stage in scene.stages) / chosen) + 1,
        "softening": list(softening_sentences(scene)),
        "rolling": list(rolling_friction_sentences(scene)),
        "kinds": list(grain_kind_sentences(scene)),
        "adhesion": sticking,
        "warnings": [*warnings, *outlet_warnings(scene), *inlet_warnings(scene), *entry_warnings(scene)],
    }


def entry_warnings(scene: Scene) -> Iterator[str]:
    """Sentences on entries that change nothing, or are hardly meant as they stand."""
    rolling = [pair for pair, contact in sorted(scene.contact.items()) if contact.friction_rolling]
    if rolling and scene.laws.rolling == "none":
        yield f"contact.{rolling[0]}.friction_rolling changes nothing: laws.rolling is 'none'"
    if scene.wind is None:
        return
    if (finest := sizes.size_range(scene.grains)[0]) < DUST:
        yield f"grains of {1e6 * finest:.3g} um are dust, which stays aloft: this wind is of sand that hops"
    search = next((k for k, stage in enumerate(scene.stages) if stage.until == "threshold"), 0)
    rests = search > 0 and not scene.threshold.transport
    if rests and (friction := scene.friction_velocity_of_stage(search - 1)):
        yield f"the bed settles in a wind of u* = {friction:g} m/s before its threshold is sought"
