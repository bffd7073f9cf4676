"""No rolling resistance: contacts transmit no moment."""

from taichi_erosion.core.ti import ti


@ti.func
def rolling_torque(materials: ti.template(), row, contact: ti.template(), displacement):
    """Torque on grain i [N m] and rolling displacement [rad]."""
    return 0.0 * displacement, displacement


@ti.func
def rolling_constant(materials: ti.template(), row, root_radius, inertia):
    """Rolling damping constant over sqrt(a) [N m s m-0.5]."""
    return 0.0 * root_radius


@ti.func
def rolling_energy(materials: ti.template(), row, contact_radius, root_radius, displacement):
    """Energy stored in the rolling spring [J]."""
    return 0.0
