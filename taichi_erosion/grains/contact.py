"""Contact force: normal law, tangential law and rolling resistance, put together.

    F_n = F_el(d) - c_n v_n,              c_n = 2 sqrt(5/6) beta sqrt(2 E* a m*)

The normal force is not clipped at zero: clipping would change the restitution.

Reference: Tsuji et al. (1992), Powder Technology 71, 239.
"""

from types import ModuleType
from typing import Any

from taichi_erosion.core.setup import Laws
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record
from taichi_erosion.grains.laws import (
    hertz,
    jkr,
    rolling_constant_torque,
    rolling_elastic_plastic,
    rolling_none,
)
from taichi_erosion.grains.laws.mindlin import tangential_force

ROLLING_INERTIA = 1.4  # (I + m R^2) / (m R^2) of a sphere [1]

ROLLING: dict[str, ModuleType] = {
    "none": rolling_none,
    "constant_torque": rolling_constant_torque,
    "elastic_plastic": rolling_elastic_plastic,
}


@device_record
class ContactLaws:
    """Device functions of a run, one per slot."""

    normal_force: Any
    normal_energy: Any
    rolling_torque: Any
    rolling_constant: Any
    rolling_energy: Any
    adhesive: bool  # whether contacts act across a gap
    zero_force_gap: Any  # host function (pi gamma, E*, R*) -> gap [m]
    contact_type: Any  # struct type of one contact, in the run's precision


def contact_struct_type() -> Any:
    """Struct of one contact: what the laws read."""
    real3 = ti.types.vector(3, float)
    return ti.types.struct(
        normal=real3,  # unit vector from the partner to grain i [1]
        velocity=real3,  # of grain i relative to the partner, at the contact [m s-1]
        rolling_velocity=real3,  # spin of i relative to the partner, without twist [rad s-1]
        root_radius=float,  # square root of the effective radius [m^0.5]
        damping=float,  # normal damping constant over sqrt(a) [kg s-1 m-0.5]
        rolling_damping=float,  # rolling damping constant over sqrt(a) [N m s m-0.5]
        elastic=float,  # normal force without damping [N]
        contact_radius=float,  # a [m]
        root_contact_radius=float,  # sqrt(a) [m^0.5]
        cap_force=float,  # force that caps friction and rolling [N]
    )


def compile_contact_laws(laws: Laws) -> ContactLaws:
    """Device functions of the laws that a run names; the choices of adhesion concern JKR alone."""
    rolling = ROLLING[laws.rolling]
    adhesive = laws.normal == "jkr"
    normal = jkr if adhesive else hertz
    branch = jkr.compile_jkr(laws.adhesion_branch, laws.friction_cap) if adhesive else hertz.normal_force
    return ContactLaws(
        normal_force=branch,
        normal_energy=hertz.normal_energy,  # of the repulsive spring alone: that of a neck is not counted
        rolling_torque=rolling.rolling_torque,
        rolling_constant=rolling.rolling_constant,
        rolling_energy=rolling.rolling_energy,
        adhesive=adhesive,
        zero_force_gap=normal.zero_force_gap,
        contact_type=contact_struct_type(),
    )


@ti.func
def contact_force(
    laws: ti.template(), materials: ti.template(), row, contact: ti.template(), tangential, rolling, dt
):
    """Force on grain i, its tangential part [N], rolling torque [N m], and both displacements after the step.

    `tangential` and `rolling` are the displacements before it [m], [rad].
    """
    friction, tangential_after = tangential_force(materials, row, contact, tangential, dt)
    turned = rolling + contact.rolling_velocity * dt
    turned -= turned.dot(contact.normal) * contact.normal
    torque, rolling_after = laws.rolling_torque(materials, row, contact, turned)
    damping = contact.damping * contact.root_contact_radius
    force = (contact.elastic - damping * contact.velocity.dot(contact.normal)) * contact.normal + friction
    return force, friction, torque, tangential_after, rolling_after
