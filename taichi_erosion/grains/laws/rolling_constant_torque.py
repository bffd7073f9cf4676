"""Rolling resistance type A: a torque of constant size against the relative rotation.

    M = -mu_r R* F omega / |omega|

with mu_r the rolling friction [1], R* the effective radius [m], F the force that caps friction [N], omega the
relative spin without its twist about the normal [rad s-1]. The torque changes sign with the motion, so grains
at rest rattle.

Reference: Ai, Chen, Rotter & Ooi (2011), Powder Technology 206, 269, model A; Zhou et al. (1999), Physica A
269, 536.
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.laws.rolling_none import rolling_constant, rolling_energy

__all__ = ["rolling_constant", "rolling_energy", "rolling_torque"]  # it has no spring

SPIN_LEAST = 1e-12  # below it there is no direction to oppose [rad s-1]


@ti.func
def rolling_torque(materials: ti.template(), row, contact: ti.template(), displacement):
    """Torque on grain i [N m] and rolling displacement [rad]."""
    limit = materials.friction_rolling[row] * contact.root_radius * contact.root_radius * contact.cap_force
    speed = contact.rolling_velocity.norm()
    return contact.rolling_velocity * (-limit / ti.max(speed, SPIN_LEAST)), displacement
