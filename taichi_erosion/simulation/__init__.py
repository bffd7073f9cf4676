"""The coupled step and how it is assembled."""

from taichi_erosion.simulation.advance import advance, failure_of
from taichi_erosion.simulation.assemble import Simulation, assemble, reuse_or_assemble
from taichi_erosion.simulation.contact_network import contact_network
from taichi_erosion.simulation.control import (
    move_surface,
    remove_surface,
    set_contacts,
    set_replica_effects,
    set_replica_gravity,
)
from taichi_erosion.simulation.readback import (
    count_waiting_spheres,
    energy_sums,
    energy_totals,
    removed_spheres,
    share_of_grains_in_contact,
    snapshot,
    wall_poses,
)
from taichi_erosion.simulation.saved_state import export_bed, export_state, import_bed, import_state
from taichi_erosion.simulation.scene_setup import device_effects, effective_scene, prepare
from taichi_erosion.simulation.wind_driver import air_profile, friction_velocity, set_upflow, spin_up_wind
