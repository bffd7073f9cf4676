"""State of the coupling on the device: sums of the grains per cell of air, and the exchange of momentum."""

from collections.abc import Sequence
from math import prod
from typing import Any

from taichi_erosion.air.grid import Air, allocate_air
from taichi_erosion.core.air_setup import AirSetup
from taichi_erosion.core.effect import compile_grain_type
from taichi_erosion.core.setup import Laws, Setup
from taichi_erosion.core.transfer import device_record, upload, write_field
from taichi_erosion.coupling.drag import drag_law
from taichi_erosion.grains.state import arrays, block


@device_record
class PartitionSums:
    """Sums over the grains of one part in one cell of air: place (part * replicas + r, cell).

    A part is a partition of the grains, or a chunk of equally many that one thread sums.
    """

    parts: int  # most of a replica
    chunk: int  # grains of a chunk; 0: parts are partitions
    volume: Any  # of grains [m3]
    rate: Any  # sum of m b [kg s-1]
    drag_source: Any  # vec3, sum of m b v [N]
    impulse: Any  # vec3, momentum that drag has given to grains since the last exchange [N s]
    volume_flow: Any  # sum of V v_z [m4 s-1]


@device_record
class Exchange:
    """Interval, parameters and state of the exchange, one row a replica."""

    look_steps: Any  # i32, time steps between two exchanges
    last_exchange: Any  # i32, step of the last exchange with a grid of air, -1 before the first
    seed: Any  # i32, of random numbers
    surface: Any  # height of the undisturbed bed [m]
    through_flow: Any  # superficial velocity of air that rises through the bed [m s-1]
    residual_momentum: Any  # vec3 (replica, cell), lost by the air and not yet received by its grains [N s]
    rise_velocity: Any  # (replica, layer), vertical velocity of the air between the grains [m s-1]
    pressure_lift: Any  # (replica, layer), pressure gradient that carries grains, upwards [Pa m-1]


@device_record
class CouplingState:
    """The air and its exchange with the grains; the three flags are compiled in."""

    has_air: bool  # whether there is air
    has_through_flow: bool  # whether air rises through the bed
    host_driven: bool  # whether the host drives the exchange, since the air is a grid
    air: Air | None
    sums: PartitionSums
    exchange: Exchange
    drag_law: Any  # ti.func, see coupling.drag
    grain_type: Any


def upload_exchange_settings(exchange: Exchange, setups: Sequence[Setup]) -> None:
    """Interval and parameters of the exchange of every replica; none has exchanged yet."""
    names = ("look_steps", "seed", "surface", "through_flow")
    upload([(getattr(exchange, name), [getattr(s.coupling, name) for s in setups]) for name in names])
    write_field(exchange.last_exchange, -1)


def allocate_coupling(setups: Sequence[Setup], laws: Laws, parts: int, chunk: int = 0) -> CouplingState:
    """Coupling of all replicas on the device; all setups have air, or none has.

    Grains are summed in so many `parts`: partitions, or chunks of `chunk` grains.
    """
    airs: list[AirSetup] = [s.air for s in setups if s.air is not None]
    layers = airs[0].cells[2] if airs else 1
    cells = prod(airs[0].cells) if airs else 1
    replicas = len(setups)
    law = drag_law(laws.drag)
    by_replica = arrays(replicas, i32="look_steps last_exchange seed", f64="surface through_flow")
    by_layer = arrays((replicas, layers), f64="rise_velocity pressure_lift")
    by_cell = arrays((replicas, cells), f64x3="residual_momentum")
    exchange = Exchange(**by_replica, **by_layer, **by_cell)
    upload_exchange_settings(exchange, setups)
    most = parts if airs else 1
    sums = block((replicas * most, cells), f64="volume rate volume_flow", f64x3="drag_source impulse")
    return CouplingState(
        has_air=bool(airs),
        has_through_flow=any(s.coupling.rising or s.coupling.through_flow != 0.0 for s in setups),
        host_driven=any(air.cells[:2] != (1, 1) for air in airs),
        air=allocate_air(airs) if airs else None,
        sums=PartitionSums(most, chunk, **sums),
        exchange=exchange,
        drag_law=law,
        grain_type=compile_grain_type(law),
    )
