"""What grains and air share on the device: what grains put into each layer of air, and when they look."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from taichi_erosion.air.assemble import allocate_air
from taichi_erosion.air.state import Air
from taichi_erosion.core.air_setup import AirSetup
from taichi_erosion.core.effect import grain_type
from taichi_erosion.core.setup import Laws, Setup
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import upload
from taichi_erosion.coupling.drag import DRAG

real = ti.f64


@dataclass(frozen=True, eq=False)
class Layers:
    """Sums over the grains of one partition in one layer of air: place (partition * replicas + r, layer)."""

    volume: Any  # of grains [m3]
    rate: Any  # sum of m b [kg s-1]
    pull: Any  # vec3, sum of m b v [N]
    given: Any  # vec3, momentum that drag has given to grains since the last look [N s]
    flow: Any  # sum of V v_z [m4 s-1]


@dataclass(frozen=True, eq=False)
class Exchange:
    """One row a replica: how often grains look at the air, and what air and grains owe each other."""

    look_steps: Any  # i32, time steps from one look to the next
    seed: Any  # i32, of random numbers
    surface: Any  # height of the undisturbed bed [m]
    through_flow: Any  # superficial velocity of air that rises through the bed [m s-1]
    owed: Any  # vec3 (replica, layer), momentum that the air has lost and its grains have not yet got [N s]
    rise: Any  # (replica, layer), vertical velocity of the air between the grains [m s-1]
    lift: Any  # (replica, layer), pressure gradient that carries grains, upwards [Pa m-1]


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Everything around the grains; `windy` and `rising` are compiled in."""

    windy: bool  # whether there is air
    rising: bool  # whether air rises through the bed
    air: Air | None
    layers: Layers
    exchange: Exchange
    drag_rate: Any  # ti.func of coupling.drag
    grain_type: Any


def allocate_layers(replicas: int, partitions: int, layers: int) -> Layers:
    """Fields of one buffer a partition."""
    table: dict[str, Any] = {name: ti.field(real) for name in ("volume", "rate", "flow")}
    table |= {name: ti.Vector.field(3, real) for name in ("pull", "given")}
    ti.root.dense(ti.ij, (replicas * partitions, layers)).place(*table.values())
    return Layers(**table)


def allocate_exchange(replicas: int, layers: int) -> Exchange:
    """Fields by replica."""
    table: dict[str, Any] = {name: ti.field(ti.i32, shape=replicas) for name in ("look_steps", "seed")}
    table |= {name: ti.field(real, shape=replicas) for name in ("surface", "through_flow")}
    table |= {name: ti.field(real, shape=(replicas, layers)) for name in ("rise", "lift")}
    table["owed"] = ti.Vector.field(3, real, shape=(replicas, layers))
    return Exchange(**table)


def surround(setups: Sequence[Setup], laws: Laws, partitions: int) -> Surroundings:
    """Put the air on the device; all setups have air, or none has."""
    airs: list[AirSetup] = [s.air for s in setups if s.air is not None]
    layers = airs[0].cells[2] if airs else 1
    exchange = allocate_exchange(len(setups), layers)
    looks = [s.coupling for s in setups]
    upload(
        [
            (exchange.look_steps, [look.look_steps for look in looks]),
            (exchange.seed, [look.seed for look in looks]),
            (exchange.surface, [look.surface for look in looks]),
            (exchange.through_flow, [look.through_flow for look in looks]),
        ]
    )
    return Surroundings(
        windy=bool(airs),
        rising=any(look.rising or look.through_flow != 0.0 for look in looks),
        air=allocate_air(airs) if airs else None,
        layers=allocate_layers(len(setups), partitions, layers),
        exchange=exchange,
        drag_rate=DRAG[laws.drag],
        grain_type=grain_type(),
    )
