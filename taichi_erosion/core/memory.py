"""Fields of a CPU as NumPy sees them: in the memory where they lie, without a kernel in between.

Taichi lays the dense fields of one tree out without gaps that it would not tell: the cells of a block follow
each other, the fields that share a block lie side by side in every cell. Taichi is asked for the address of
one field of each tree, and all others follow from it. A view is good until the device is stopped: what is to
be kept longer has to be copied.
"""

import ctypes
from collections.abc import Callable
from dataclasses import dataclass, field
from math import prod
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.ti import impl, ti

NUMPY_TYPES = {"f32": np.float32, "f64": np.float64, "i32": np.int32}


def is_host() -> bool:
    """Whether fields lie in the memory of the program itself."""
    return impl.current_cfg().arch in (ti.x64, ti.arm64)


def inner_shape(field: Any) -> tuple[int, ...]:
    """Shape of one element of a field."""
    if not hasattr(field, "n"):
        return ()
    return (field.n,) if field.m == 1 else (field.n, field.m)


@ti.kernel
def ask_address(
    # in
    field: ti.template(),
) -> ti.u64:
    """Address of the first element of a field, counted from 0 here whatever the field's offset."""
    return ti.get_addr(field, ti.Vector([0 for _ in ti.static(range(len(field.shape)))]))


def distance_from_root(node: Any) -> int:
    """Bytes from the beginning of a tree to the first number of a node."""
    distance = 0
    while node is not None:
        distance += node.offset_bytes_in_parent_cell
        node = node.parent
    return distance


def strides_of(shape: tuple[int, ...], step: int) -> tuple[int, ...]:
    """Bytes from one place to the next along every axis, the last one the fastest."""
    return tuple(step * prod(shape[axis + 1 :]) for axis in range(len(shape)))


@dataclass(frozen=True)
class Places:
    """What has been found out since the device was started."""

    trees: dict[int, int] = field(default_factory=dict)  # address by number of the tree
    views: WeakKeyDictionary[Any, NDArray[Any]] = field(default_factory=WeakKeyDictionary)  # by field


def remember_places() -> Callable[[Any], NDArray[Any]]:
    """`memory`, which asks Taichi once for every tree, and looks at every field once."""
    known: WeakKeyDictionary[Any, Places] = WeakKeyDictionary()  # by run of the device

    def memory(field: Any) -> NDArray[Any]:
        """View of all numbers of a field: its own shape, then that of one element."""
        places = known.setdefault(impl.get_runtime(), Places())
        if field not in places.views:
            impl.get_runtime().materialize()
            node = field.snode.ptr
            tree = node.get_snode_tree_id()
            if tree not in places.trees:
                places.trees[tree] = ask_address(field) - distance_from_root(node)
            places.views[field] = view(field, places.trees[tree] + distance_from_root(node))
        return places.views[field]

    return memory


def view(field: Any, start: int) -> NDArray[Any]:
    """Numbers of a field whose first one lies at an address."""
    shape, inner, cell = field.shape, inner_shape(field), field.snode.ptr.parent.cell_size_bytes
    number_type = np.dtype(NUMPY_TYPES[str(field.dtype)])
    strides = (*strides_of(shape, cell), *strides_of(inner, number_type.itemsize))
    extent = (prod(shape) - 1) * cell + prod(inner) * number_type.itemsize
    numbers = (ctypes.c_char * extent).from_address(start)
    return np.ndarray((*shape, *inner), number_type, numbers, strides=strides)


memory = remember_places()
