"""Fields of the grain decomposition: forces by list entry, reverse lists, counts, and queues of replicas.

A pair has one entry in the list of its first grain (`grains.neighbour_list`). The reverse list of a grain
names the entries in which it is the second. Each grain sums its forces over its own entries and then over its
reverse list, in the order of the entries: the sum is the same whenever it is repeated.
"""

from math import isqrt
from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record
from taichi_erosion.grains.state import arrays, block
from taichi_erosion.simulation.capacities import Capacities

NO_FAULT = 2**31 - 1  # of `faulty`

Stages = tuple[tuple[Any, ...], ...]  # device functions of a stage, and how many threads it takes a replica


@device_record
class GrainBuffers:
    """Fields of all replicas; a chunk is a run of grains or cells that one thread sums."""

    grain_chunk: int  # grains of a chunk
    grain_chunks: int  # a replica
    cell_chunk: int  # cells of a chunk
    cell_chunks: int  # a replica
    queued: Any  # i32 [1], replicas whose lists or reverse lists are made now
    queue: Any  # i32 by place in the queue: replica
    linked: Any  # i32 by replica, 1 where the reverse lists belong to the neighbour lists
    stepping: Any  # i32 by replica, 1 where the coming step advances it
    listed: Any  # i32 by replica, entries of its neighbour lists
    before: Any  # i32 by replica, grains before this release
    wide: Any  # i32 by replica, grains whose skin reaches beyond adjacent cells
    lost: Any  # i32 by replica, 1 + largest rank of a grain at a place that is not allowed; 0: none
    faulty: Any  # i32 by replica, first entry with too large an overlap; beyond all entries: rank at a wall
    cells: Any  # i32 by replica, cells in use
    low: Any  # f64 vec3 by replica and chunk of grains, corner of the box around them [m]
    high: Any  # f64 vec3 likewise [m]
    total: Any  # f64 vec3 likewise, sum of positions [m]
    squares: Any  # f64 vec3 likewise, sum of their squares [m2]
    cell_sums: Any  # i32 by replica and chunk of cells
    pair_sums: Any  # i32 by replica and chunk of grains
    wall_sums: Any  # i32 likewise
    force: Any  # vec3 by replica and entry, on the first grain [N]
    torque: Any  # vec3 likewise, on the first grain [N m]
    back: Any  # vec3 likewise, opposite of that on the second grain [N m]
    level: Any  # by replica and entry: 0 without a force, else 1, and the overlap [1] where too large
    partner_entry: Any  # i32 by replica and place in the reverse lists: entry, from 0 in each replica
    start: Any  # i32 by replica and grain: first place in its reverse list
    stop: Any  # i32 likewise, one past the last
    wall_overlap: Any  # by replica and grain: overlap with a wall where it is too large, over the radius [1]
    wall: Any  # i32 by replica and grain: that wall, as `Replicas.fault_partner`


def chunk_size(numbers: int) -> int:
    """Power of two near the root of how many numbers are summed: chunks and their numbers are alike many."""
    return 1 << (isqrt(max(numbers - 1, 1))).bit_length()


def allocate_buffers(capacities: Capacities) -> GrainBuffers:
    """Fields for an ensemble."""
    count, grains, pairs = capacities.replicas, capacities.grains, capacities.pairs
    grain_chunk, cell_chunk = chunk_size(grains), chunk_size(capacities.cells)
    grain_chunks, cell_chunks = -(-grains // grain_chunk), -(-capacities.cells // cell_chunk)
    table = arrays(1, i32="queued")
    table |= arrays(count, i32="queue linked stepping listed before wide lost faulty cells")
    table |= arrays(count * grain_chunks, f64x3="low high total squares", i32="pair_sums wall_sums")
    table |= arrays(count * cell_chunks, i32="cell_sums")
    table |= block(count * pairs, realx3="force torque back") | arrays(count * pairs, real="level")
    table |= arrays(count * pairs, i32="partner_entry")
    table |= arrays(count * grains, i32="start stop wall", real="wall_overlap")
    return GrainBuffers(grain_chunk, grain_chunks, cell_chunk, cell_chunks, **table)


@ti.func
def sum_chunk(numbers: ti.template(), sums_out: ti.template(), first, count, place, k, size):
    """Sum of chunk k of `count` numbers from `first` on, `size` to a chunk, written to `place` + k."""
    total = 0
    for n in range(k * size, ti.min((k + 1) * size, count)):
        total += numbers[first + n]
    sums_out[place + k] = total


@ti.func
def sum_before(sums: ti.template(), place, k):
    """Sum of the first k sums of chunks from `place` on."""
    total = 0
    for n in range(place, place + k):
        total += sums[n]
    return total


@ti.func
def sort_run(numbers_out: ti.template(), begin, end):
    """Sort a short run of numbers by insertion."""
    for n in range(begin + 1, end):
        number = numbers_out[n]
        m = n
        while m > begin and numbers_out[m - 1] > number:
            numbers_out[m] = numbers_out[m - 1]
            m -= 1
        numbers_out[m] = number
