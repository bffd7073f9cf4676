"""Rolling resistance type C: an elastic-plastic spring, at rest without rattling.

    M = -k theta - c omega       while |k theta| <= mu_r R* F
    M = -mu_r R* F theta/|theta| beyond, theta shortened to that limit, no viscous part
    k = 2.25 k_n mu_r^2 R*^2,    k_n = 2 E* a,    c = eta 2 sqrt(I k)

with theta the rolling angle since engagement without twist [rad], omega its rate, F the force that caps
friction [N], I = 1/(1/(I_i + m_i r_i^2) + 1/(I_j + m_j r_j^2)) [kg m2], eta the share of critical damping
[1].

Reference: Ai, Chen, Rotter & Ooi (2011), Powder Technology 206, 269, model C; Iwashita & Oda (1998), J. Eng.
Mech. 124, 285.
"""

from taichi_erosion.core.ti import ti

STIFFNESS_FACTOR = 2.25  # of k, Ai et al. (2011) with the spherical contact's rolling arm [1]


@ti.func
def rolling_torque(materials: ti.template(), row, contact: ti.template(), displacement):
    """Torque on grain i [N m] and rolling displacement [rad]."""
    arm = materials.friction_rolling[row] * contact.root_radius * contact.root_radius
    stiffness = (2.0 * STIFFNESS_FACTOR) * materials.young[row] * contact.contact_radius * arm * arm
    torque = -stiffness * displacement
    limit = arm * contact.cap_force
    size_squared = torque.norm_sqr()
    if size_squared > limit * limit:
        shortening = limit / ti.sqrt(size_squared)
        torque *= shortening
        displacement *= shortening
    else:
        torque -= contact.rolling_damping * contact.root_contact_radius * contact.rolling_velocity
    return torque, displacement


@ti.func
def rolling_constant(materials: ti.template(), row, root_radius, inertia):
    """Rolling damping constant over sqrt(a) [N m s m-0.5], eta 2 sqrt(I k / a)."""
    arm = materials.friction_rolling[row] * root_radius * root_radius
    stiffness_over_radius = (2.0 * STIFFNESS_FACTOR) * materials.young[row] * arm * arm
    return 2.0 * materials.rolling_damping[row] * ti.sqrt(inertia * stiffness_over_radius)


@ti.func
def rolling_energy(materials: ti.template(), row, contact_radius, root_radius, displacement):
    """Energy stored in the rolling spring [J]."""
    arm = materials.friction_rolling[row] * root_radius * root_radius
    return STIFFNESS_FACTOR * materials.young[row] * contact_radius * arm * arm * displacement.norm_sqr()
