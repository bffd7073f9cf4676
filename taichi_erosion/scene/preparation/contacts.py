"""Contact parameters of every pair of materials, from the scene's tables."""

import numpy as np

from taichi_erosion.core.setup import ContactTable, pair_row
from taichi_erosion.scene.schema.grains import Contact, Grains, Material
from taichi_erosion.scene.schema.scene import Scene

STICKING_EXPONENT = 0.4  # gamma_r / gamma = (E_r / E)^(2/5) keeps the sticking speed; Haervig et al. (2017)
NEVER_READ = Contact(restitution=1.0, friction_sliding=0.0, rolling_damping=0.0)  # wall against wall


def materials_used(scene: Scene) -> list[str]:
    """Names of the materials of grains and walls, in alphabetical order."""
    return sorted({*scene.grains.parts} | scene.wall_material_names)


def shear_modulus(material: Material) -> float:
    """G [Pa] as given, or E / (2 (1 + nu))."""
    if material.shear_modulus is not None:
        return material.shear_modulus
    return (material.young_modulus or 0.0) / (2.0 * (1.0 + material.poisson_ratio))


def young_modulus(material: Material) -> float:
    """E [Pa] as given, or 2 G (1 + nu)."""
    if material.young_modulus is not None:
        return material.young_modulus
    return 2.0 * (material.shear_modulus or 0.0) * (1.0 + material.poisson_ratio)


def effective_young_modulus(a: Material, b: Material) -> float:
    """E* [Pa]:  1/E* = (1 - nu_a^2) / E_a + (1 - nu_b^2) / E_b."""
    return 1.0 / (plane_compliance(a, young_modulus(a)) + plane_compliance(b, young_modulus(b)))


def plane_compliance(material: Material, young: float) -> float:
    """Compliance (1 - nu^2) / E [Pa-1]."""
    return (1.0 - material.poisson_ratio**2) / young


def effective_shear_modulus(a: Material, b: Material) -> float:
    """G* [Pa]:  1/G* = (2 - nu_a) / G_a + (2 - nu_b) / G_b."""
    return 1.0 / ((2.0 - a.poisson_ratio) / shear_modulus(a) + (2.0 - b.poisson_ratio) / shear_modulus(b))


def unsoftened_modulus(material: Material) -> float:
    """Young's modulus before softening [Pa]."""
    if material.softening is None:
        return young_modulus(material)
    modulus = material.shear_modulus or material.young_modulus or 1.0
    return young_modulus(material) * material.softening.true_modulus / modulus


def simulated_surface_energy(grains: Grains, contact: Contact, a: Material, b: Material) -> float:
    """Surface energy as simulated [J m-2]: as stated, times the scales of coarse graining and of softening.

    Coarse graining has its rule (`CoarseGraining`). Softening keeps the sticking speed by

    gamma_r = gamma (E*_r / E*)^(2/5),  E* from the true moduli, E*_r from the softened ones.
    Reference: Haervig et al. (2017), Powder Technology 319, 472.
    """
    rules = {m.softening.rule for m in (a, b) if m.softening is not None}
    energy = contact.surface_energy * grains.adhesion_scale
    if "sticking_velocity" not in rules:
        return energy
    true = 1.0 / (plane_compliance(a, unsoftened_modulus(a)) + plane_compliance(b, unsoftened_modulus(b)))
    return energy * (effective_young_modulus(a, b) / true) ** STICKING_EXPONENT


def contact_table(scene: Scene) -> ContactTable:
    """One row for every pair of used materials, rolling friction over R*; rows of two walls are not read."""
    names = materials_used(scene)
    rows = {}
    for i, name in enumerate(names):
        for j, other in enumerate(names[i:], start=i):
            contact = scene.contact_of_materials(name, other) or NEVER_READ
            a, b = scene.materials[name], scene.materials[other]
            rows[pair_row(i, j, len(names))] = (
                effective_young_modulus(a, b),
                effective_shear_modulus(a, b),
                contact.restitution,
                contact.friction_sliding,
                contact.friction_rolling * contact.rolling_radius_ratio,
                contact.rolling_damping,
                simulated_surface_energy(scene.grains, contact, a, b),
                float(contact.acted_on),
            )
    return ContactTable(*np.array([rows[row] for row in range(len(rows))]).T)
