"""Device state of the grains of all replicas.

Every replica owns a block of `capacity` places on each of two sides. A rebuild sorts the grains in space and
moves them to the other side; `Replicas.side` says which one is valid. A grain is addressed by
`side_block(...) + rank`, its rank being its place in the sorted order; `ident` is its row in the GrainTable.

Positions are split as x = origin + shift: `origin` is exact (f64) and changes at a rebuild only, `shift` is
the small displacement since then, so that single precision resolves overlaps of a millionth of a radius.
"""

from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record, is_host_memory

REBUILD = 1  # of Replicas.need: a grain has left its skin
STOP = 2  # of Replicas.need: two bodies overlap beyond the limit
REACH_FIELDS = ("before_low", "before_high", "after_low", "after_high")  # of Replicas
CACHE_PADDING = 64  # numbers: four cache lines, so that writing the one in the middle disturbs no other
ARRIVAL_SLOT = CACHE_PADDING // 2  # the one in the middle


@device_record
class Grains:
    """Sorted grains; two sides of `capacity` places a replica, forces on one side only."""

    capacity: int
    origin: Any  # f64 vec3 [m]
    shift: Any  # vec3 [m]
    velocity: Any  # vec3 [m s-1], half a step before the position
    spin: Any  # vec3 [rad s-1], likewise
    radius: Any  # [m]
    mass_inverse: Any  # [kg-1]
    extent: Any  # radius and skin [m]
    skin_squared: Any  # square of the skin [m2], the displacement beyond which a rebuild is due
    material: Any  # i32
    ident: Any  # i32
    force: Any  # vec3 [N], one buffer a partition: (partition * replicas + replica) * capacity + rank
    torque: Any  # vec3 [N m], likewise
    acceleration: Any  # vec3 [m s-2] at the last step, by rank
    spin_rate: Any  # vec3 [rad s-2] at the last step, by rank


@device_record
class Source:
    """The GrainTable on the device: where each grain starts and at which step it is released."""

    position: Any  # f64 vec3 [m]
    velocity: Any  # vec3 [m s-1]
    spin: Any  # vec3 [rad s-1]
    radius: Any  # [m]
    mass_inverse: Any  # [kg-1]
    material: Any  # i32
    release_step: Any  # i32
    body: Any  # i32, clump of the sphere; the sphere's own row where there are no clumps


@device_record
class Replicas:
    """One row a replica: clock, counters, box and faults."""

    count: int
    side: Any  # i32, 0 or 1
    partitions: Any  # i32, number of partitions of the grains
    released: Any  # i32, grains simulated
    removes: Any  # i32, 1 where grains outside the box are taken out, 0 where one stops the replica
    leaving: Any  # i32, grains that the present rebuild takes out
    removed: Any  # i32, grains taken out so far
    total: Any  # i32, rows of the GrainTable
    step: Any  # i32
    stale: Any  # i32, 1 where the host asks for a rebuild
    steps_left: Any  # i32, steps to do in this launch
    rebuilds: Any  # i32
    pair_row: Any  # i32, row of Materials of all pairs of grains, or -1 where grains differ in material
    status: Any  # i32, core.snapshot.Status
    time_step: Any  # [s]
    gravity: Any  # vec3 [m s-2]
    low: Any  # f64 vec3 [m], outside below
    high: Any  # f64 vec3 [m], outside above
    period: Any  # f64 vec3 [m], 0 where open
    skin_least: Any  # skin of a resting grain over its radius [1]
    skin_most: Any  # largest skin [m]
    cell_reach: Any  # radius and skin up to which adjacent cells hold all partners [m]
    extent_most: Any  # largest radius and skin [m]
    crowded: Any  # i32, 1 where too many grains reach further
    skin_time: Any  # time that a moving grain should stay within its skin [s]
    reach: Any  # gap up to which a contact may act [m]
    met_reach: Any  # by how much it is less between grains that have not touched [m]
    wall_travel: Any  # bound on how far any wall has moved since the rebuild [m]
    overlap_limit: Any  # overlap over the smaller radius [1]
    need: Any  # i32 [replica, partition]: REBUILD or STOP, written while integrating only
    short: Any  # i32 [replica, partition]: list entries wanted beyond the capacity
    wall_short: Any  # i32 [replica, partition]: wall entries wanted beyond the capacity
    before_low: Any  # i32 [replica, partition]: lowest rank before its own that its forces reach
    before_high: Any  # i32 [replica, partition]: one past the highest rank before its own that they reach
    after_low: Any  # i32 [replica, partition]: lowest rank behind its own that its forces reach
    after_high: Any  # i32 [replica, partition]: one past the highest rank behind its own that they reach
    fault_grain: Any  # i32 [replica, partition]
    fault_partner: Any  # i32 [replica, partition]
    fault_value: Any  # [replica, partition]
    bounds: Any  # i32 [replica, partition]: first rank of each partition, and one past the last of all
    arrivals: Any  # i32 [replica, place]: workers that reached the barrier, at `ARRIVAL_SLOT` alone
    spins_most: Any  # i32, spins at a barrier of a step after which a worker of the team counts as late
    late: Any  # i32, 1 where a worker was late in this launch
    pause: Any  # i32, 1 where this launch ends after the next step


def new_field(kind: str, **shape: Any) -> Any:
    """Field of a kind such as `i32`, `real` (the run's precision), `f64x3` (vectors of three)."""
    dtype: Any = {"i32": ti.i32, "real": float, "f64": ti.f64}[kind.partition("x")[0]]
    size = kind.partition("x")[2]
    if size and shape and not is_host_memory():
        shape["layout"] = ti.Layout.SOA
    return ti.Vector.field(int(size), dtype, **shape) if size else ti.field(dtype, **shape)


def block(shape: int | tuple[int, int], **kinds: str) -> dict[str, Any]:
    """Fields by name, stored together place by place: names of each kind, in the order of storage.

    On a graphics processor every component is an array by itself: neighbouring threads read neighbouring
    numbers.
    """
    if not is_host_memory():
        return arrays(shape, **kinds)
    table = {name: new_field(kind) for kind, names in kinds.items() for name in names.split()}
    ti.root.dense(ti.i if isinstance(shape, int) else ti.ij, shape).place(*table.values())
    return table


def arrays(shape: int | tuple[int, int], **kinds: str) -> dict[str, Any]:
    """Fields by name, each stored by itself: names of each kind."""
    return {name: new_field(kind, shape=shape) for kind, names in kinds.items() for name in names.split()}


def allocate_grains(replicas: int, partitions: int, capacity: int) -> Grains:
    """Fields of `replicas` blocks; what the force loop reads lies together in memory."""
    places = 2 * replicas * capacity
    hot = block(places, realx3="shift velocity spin", real="radius mass_inverse skin_squared")
    cold = block(places, f64x3="origin", real="extent")
    labels = block(places, i32="material ident")
    sums = block(partitions * replicas * capacity, realx3="force torque")
    rates = block(replicas * capacity, realx3="acceleration spin_rate")
    return Grains(capacity, **hot, **cold, **labels, **sums, **rates)


def allocate_source(replicas: int, capacity: int) -> Source:
    """Fields of the GrainTables, by replica and row."""
    places = replicas * capacity
    moves = block(places, realx3="velocity spin", real="radius mass_inverse")
    return Source(
        **block(places, f64x3="position"), **moves, **block(places, i32="material release_step body")
    )


def allocate_replicas(count: int, partitions: int) -> Replicas:
    signals = "status spins_most late pause"  # the last three of a team
    counts = "released removes leaving removed"
    skins = "skin_least skin_most skin_time cell_reach extent_most reach met_reach wall_travel"
    table = arrays(
        count,
        i32=f"side partitions stale crowded {counts} total step steps_left rebuilds pair_row {signals}",
        real=f"time_step {skins} overlap_limit",
        realx3="gravity",
        f64x3="low high period",
    )
    shared = f"need short wall_short fault_grain fault_partner {' '.join(REACH_FIELDS)}"
    table |= arrays((count, partitions), i32=shared, real="fault_value")
    table |= arrays((count, partitions + 1), i32="bounds") | arrays((count, CACHE_PADDING), i32="arrivals")
    return Replicas(count, **table)


@ti.func
def side_start(record: ti.template(), r, side):
    """First place of one side of replica r: of the grains, or the first entry of a list."""
    return (2 * r + side) * record.capacity


@ti.func
def first_force_place(grains: ti.template(), replicas: ti.template(), r, p):
    """First place of the force buffer of partition p of replica r."""
    return (p * replicas.count + r) * grains.capacity
