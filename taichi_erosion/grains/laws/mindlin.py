"""Mindlin: tangential spring without slip, with a dashpot, up to Coulomb's limit of friction.

    F_t = -8 G* a xi - c_t v_t            while 8 G* a |xi| <= mu F_cap,      c_t = c_n sqrt(4 G*/E*)
    F_t = -mu F_cap xi/|xi|               beyond, xi shortened to that limit

xi is the tangential displacement since engagement [m], a the contact radius [m], G* the effective shear
modulus [Pa], c_n the normal damping constant [kg s-1], mu the coefficient of sliding friction [1]. A
sliding contact has no dashpot: it would load the spring backwards at first touch, where the cap is still
zero. The cap uses the elastic force, without damping, so that a sliding impact exchanges exactly mu (1 + e)
m v_n.

Reference: Mindlin & Deresiewicz (1953), J. Appl. Mech. 20, 327; Tsuji et al. (1992), Powder Technology 71,
239.
"""

from taichi_erosion.core.ti import ti

STIFFNESS_LEAST = 1e-30  # keeps the spring of a contact of no depth finite [N m-1]


@ti.func
def tangential_force(materials: ti.template(), row, contact: ti.template(), displacement, dt):
    """Tangential force on grain i [N] and the tangential displacement after the step [m]."""
    stiffness = 8.0 * materials.shear[row] * contact.contact_radius
    tangential = contact.velocity - contact.velocity.dot(contact.normal) * contact.normal
    stretched = displacement + tangential * dt
    stretched -= stretched.dot(contact.normal) * contact.normal
    force = -stiffness * stretched
    limit = materials.friction_sliding[row] * contact.cap_force
    damping = materials.shear_damping[row] * contact.damping * contact.root_contact_radius
    size_squared = force.norm_sqr()
    if size_squared > limit * limit:
        force *= limit / ti.sqrt(size_squared)
        stretched = force * (-1.0 / ti.max(stiffness, STIFFNESS_LEAST))
    else:
        force -= damping * tangential
    return force, stretched
