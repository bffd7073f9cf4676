"""Fields of the grain decomposition: flags, forces by list entry, reverse lists, and the barrier.

A pair has one entry in the list of its first grain (`grains.neighbour_list`). The reverse list of a grain
names the entries in which it is the second. Each grain sums its forces over its own entries and then over its
reverse list, in the order of the entries: the sum is the same whenever it is repeated.
"""

from math import isqrt
from typing import Any

from taichi_erosion.core.device import multiprocessor_count
from taichi_erosion.core.engine import engine_name
from taichi_erosion.core.ti import memfence, ti
from taichi_erosion.core.transfer import device_record, is_host_memory
from taichi_erosion.grains.partition import CPU_CHUNK
from taichi_erosion.grains.state import ARRIVAL_SLOT, CACHE_PADDING, arrays
from taichi_erosion.simulation.capacities import Capacities

NO_FAULT = 2**31 - 1  # of `faulty`
SHAPES = ((128, 1), (256, 1), (512, 2))  # threads of a block, and blocks that a multiprocessor holds

Stage = tuple[tuple[Any, ...], ...]  # tasks side by side: whether it acts, function, threads a replica


@device_record
class GrainBuffers:
    """Fields of all replicas; a chunk is a run of grains or cells that one thread sums."""

    grain_chunk: int  # grains of a chunk
    grain_chunks: int  # a replica
    cell_chunks: int  # a replica, at most
    blocks: int  # of threads; on a CPU a block is one worker
    block: int  # threads of a block
    lanes: int  # iterations of a kernel's loop that make one thread
    arrivals: Any  # i32, blocks that have reached the barrier, at `ARRIVAL_SLOT` alone
    pending: Any  # i32 [1], 1 where a replica waits for lists, an exchange or its end
    listing: Any  # i32 [1], 1 where lists are renewed now
    exchanging: Any  # i32 [1], 1 where a replica exchanges now
    running: Any  # i32 [1], replicas that have steps to do
    renewing: Any  # i32 by replica, 1 where its lists are renewed now
    stepping: Any  # i32 by replica, 1 where the coming step may advance it
    moving: Any  # i32 by replica, 1 where this step advances it
    step: Any  # i32 by replica, number of this step
    last: Any  # i32 by replica, 1 where this step is the last of the launch
    lost: Any  # i32 by replica, 1 + largest rank of a grain at a place that is not allowed; 0: none
    faulty: Any  # i32 by replica, first grain with too large an overlap; beyond all grains: at a wall
    cells: Any  # i32 by replica, cells in use
    cell_chunk: Any  # i32 by replica, cells of a chunk
    low: Any  # f64 vec3 by replica and chunk of grains, corner of the box around them [m]
    high: Any  # f64 vec3 likewise [m]
    total: Any  # f64 vec3 likewise, sum of positions [m]
    squares: Any  # f64 vec3 likewise, sum of their squares [m2]
    cell_sums: Any  # i32 by replica and chunk of cells
    listed: Any  # i32 by replica, places of entries in use
    force: Any  # vec3 by replica and entry, on the first grain [N]; zero where the two do not interact
    torque: Any  # vec3 likewise, on the first grain [N m]
    back: Any  # vec3 likewise, opposite of that on the second grain [N m]
    acts: Any  # i32 by replica and entry, 1 where they are not zero
    partners: Any  # i32 by replica and grain: entries in which it is the second
    partner_entry: Any  # i32 by replica and place in the reverse lists, laid out as the entries: entry
    walled: Any  # i32 by replica, grains near walls
    listed_walls: Any  # i32 by replica, entries of its wall list
    walled_rank: Any  # i32 by replica and place: rank of a grain near a wall, in no order
    overlap: Any  # by replica and grain: overlap where it is too large, over the size of the pair [1]
    partner: Any  # i32 by replica and grain: that partner, as `Replicas.fault_partner`


def allocate_buffers(capacities: Capacities, workers: int) -> GrainBuffers:
    """Fields for an ensemble, and the threads of its launches: `workers` on a CPU."""
    count, grains = capacities.replicas, capacities.grains
    grain_chunk = isqrt(grains) + 1
    cell_chunks = isqrt(capacities.cells) + 1
    grain_chunks = -(-grains // grain_chunk)
    blocks, block, lanes = workers, 1, CPU_CHUNK
    if not is_host_memory():
        threads, most, lanes = count * capacities.pairs, multiprocessor_count(), 1
        fitting = [shape for shape in SHAPES if shape[0] * shape[1] * most >= threads]
        block, resident = (fitting or SHAPES[-1:])[0]
        blocks = min(-(-threads // block), most * (resident if engine_name() == "taichi" else 1))
    table = arrays(CACHE_PADDING, i32="arrivals") | arrays(1, i32="pending listing exchanging running")
    flags = "renewing stepping moving step last lost faulty cells cell_chunk listed walled listed_walls"
    table |= arrays(count, i32=flags)
    table |= arrays(count * grain_chunks, f64x3="low high total squares")
    table |= arrays(count * cell_chunks, i32="cell_sums")
    table |= arrays(count * grains, i32="walled_rank partner partners", real="overlap")
    table |= arrays(count * capacities.pairs, realx3="force torque back", i32="acts partner_entry")
    return GrainBuffers(grain_chunk, grain_chunks, cell_chunks, blocks, block, lanes, **table)


@ti.func
def barrier(buffers_out: ti.template(), thread, phase):
    """Wait until all threads have arrived and see what the others wrote; returns the number of the next one.

    All blocks are resident at once.
    """
    (arrivals_out,) = ti.static((buffers_out.arrivals,))
    if ti.static(buffers_out.block > 1):
        ti.simt.block.sync()
    if thread % buffers_out.block == 0:
        if ti.static(buffers_out.block > 1):
            memfence()
        ti.atomic_add(arrivals_out[ARRIVAL_SLOT], 1)
        # an atomic read: a plain one may be hoisted out of the loop
        while ti.atomic_add(arrivals_out[ARRIVAL_SLOT], 0) < phase * buffers_out.blocks:
            pass
        if ti.static(buffers_out.block > 1):
            memfence()
    if ti.static(buffers_out.block > 1):
        ti.simt.block.sync()
    return phase + 1


@ti.func
def insertion_sort(numbers_out: ti.template(), begin, count, stride):
    """Sort a few numbers, `stride` places apart, by insertion."""
    for n in range(1, count):
        number = numbers_out[begin + n * stride]
        m = n
        while m > 0 and numbers_out[begin + (m - 1) * stride] > number:
            numbers_out[begin + m * stride] = numbers_out[begin + (m - 1) * stride]
            m -= 1
        numbers_out[begin + m * stride] = number
