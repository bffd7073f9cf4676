"""Transfer of numbers between Taichi fields and NumPy.

On a CPU a field is read and written in place, through a NumPy view of its buffer, and nothing is compiled for
it. Taichi lays the dense fields of one tree out without hidden gaps: the cells of a block follow each other,
the fields of a block lie side by side in every cell. So the address of one field per tree gives all others. A
view is valid until the device is stopped; what outlives it has to be copied.

On another device Taichi would compile one copy kernel for every field. A group of fields of equal length goes
through one kernel and one f64 table instead, which holds f32 and i32 values exactly.
"""

import ctypes
from collections.abc import Iterator
from dataclasses import dataclass, fields
from math import prod
from typing import Any, TypeVar, dataclass_transform
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.ti import impl, ti

Kind = TypeVar("Kind")

MEMBERS = "device_members"  # attribute of a class of device records: names of the members
NUMPY_TYPES = {"f32": np.float32, "f64": np.float64, "i32": np.int32}


def is_host_memory() -> bool:
    return impl.current_cfg().arch in (ti.x64, ti.arm64)


def element_shape(field: Any) -> tuple[int, ...]:
    if not hasattr(field, "n"):
        return ()
    return (field.n,) if field.m == 1 else (field.n, field.m)


@ti.kernel
def field_address(field: ti.template()) -> ti.u64:
    """Address of the first element of a field, whatever the offset of its indices."""
    return ti.get_addr(field, ti.Vector([0 for _ in ti.static(range(len(field.shape)))]))


def byte_offset_from_root(node: Any) -> int:
    """Bytes from the start of a tree to the first number of a node."""
    distance = 0
    while node is not None:
        distance += node.offset_bytes_in_parent_cell
        node = node.parent
    return distance


Views = WeakKeyDictionary[Any, NDArray[Any]]  # by field
# by Taichi runtime, one a start of the device: addresses by number of the tree, and views
FOUND: WeakKeyDictionary[Any, tuple[dict[int, int], Views]] = WeakKeyDictionary()


def field_view(field: Any) -> NDArray[Any]:
    """In-place view of all numbers of a field on a CPU: its own shape, then that of one element."""
    trees, views = FOUND.setdefault(impl.get_runtime(), ({}, Views()))
    if field not in views:
        impl.get_runtime().materialize()
        node = field.snode.ptr
        tree = node.get_snode_tree_id()
        if tree not in trees:
            trees[tree] = field_address(field) - byte_offset_from_root(node)
        element, size = (NUMPY_TYPES[str(field.dtype)], element_shape(field)), node.parent.cell_size_bytes
        cell = np.dtype({"names": ["field"], "formats": [element], "itemsize": size})
        buffer = ctypes.c_char * (prod(field.shape) * size)
        cells = buffer.from_address(trees[tree] + byte_offset_from_root(node))
        views[field] = np.ndarray(field.shape, cell, cells)["field"]
    return views[field]


@dataclass_transform(frozen_default=True, eq_default=False)
def device_record(kind: type[Kind]) -> type[Kind]:
    """Class of a record that kernels take as one argument; its members are annotated and given once.

    The class is made like a dataclass but is none: quadrants takes the members of a dataclass apart.
    """
    record: Any = dataclass(frozen=True, eq=False)(kind)
    setattr(record, MEMBERS, tuple(entry.name for entry in fields(record)))
    delattr(record, "__dataclass_fields__")
    return record


def record_members(record: Any) -> tuple[str, ...]:
    """Names of the members of a device record or of its class, empty for anything else."""
    return getattr(record, MEMBERS, ())


def device_fields(owner: Any) -> Iterator[Any]:
    """All fields of a device record, those of nested records included."""
    for name in record_members(owner):
        value = getattr(owner, name)
        if record_members(value):
            yield from device_fields(value)
        elif hasattr(value, "dtype") and hasattr(value, "shape"):
            yield value


def table_layout(fields: list[Any]) -> tuple[tuple[Any, int, int, int], ...]:
    """Field, first column of the table, rows and columns of one element; a scalar has 0 rows."""
    rows, first = [], 0
    for one in fields:
        shape = (*element_shape(one), 1, 1)[:2] if hasattr(one, "n") else (0, 1)
        rows.append((one, first, *shape))
        first += max(shape[0], 1) * shape[1]
    return tuple(rows)


@ti.kernel
def write_rows(first: ti.i32, table: ti.types.ndarray(dtype=ti.f64, ndim=2), columns_out: ti.template()):
    for i in range(table.shape[0]):
        for column in ti.static(columns_out):
            field_out, place, rows, columns = ti.static(column)
            if ti.static(rows == 0):
                field_out[first + i] = ti.cast(table[i, place], field_out.dtype)
            for k in ti.static(range(rows * columns)):
                number = ti.cast(table[i, place + k], field_out.dtype)
                if ti.static(columns == 1):
                    field_out[first + i][k] = number
                else:
                    field_out[first + i][k // columns, k % columns] = number


@ti.kernel
def read_rows(first: ti.i32, columns_in: ti.template(), table_out: ti.types.ndarray(dtype=ti.f64, ndim=2)):
    for i in range(table_out.shape[0]):
        for column in ti.static(columns_in):
            field, place, rows, columns = ti.static(column)
            if ti.static(rows == 0):
                table_out[i, place] = ti.cast(field[first + i], ti.f64)
            for k in ti.static(range(rows * columns)):
                if ti.static(columns == 1):
                    table_out[i, place + k] = ti.cast(field[first + i][k], ti.f64)
                else:
                    table_out[i, place + k] = ti.cast(field[first + i][k // columns, k % columns], ti.f64)


def upload(pairs: list[tuple[Any, Any]], first: int = 0) -> None:
    """Write arrays of equal length to fields, from index `first` on: pairs of (field, array)."""
    rows = len(np.asarray(pairs[0][1]))
    if rows == 0:
        return
    if is_host_memory():
        for field, values in pairs:
            write_cast_numbers(field_view(field)[first : first + rows], values)
        return
    columns = [np.asarray(values, np.float64).reshape(rows, -1) for _, values in pairs]
    table = np.concatenate(columns, axis=1)
    write_rows(first, np.ascontiguousarray(table), table_layout([field for field, _ in pairs]))


def write_cast_numbers(numbers_out: NDArray[Any], values: Any) -> None:
    """Write values, cast from f64 as the device would; overflow is silent."""
    with np.errstate(over="ignore", invalid="ignore"):
        numbers_out[...] = np.asarray(values, np.float64).reshape(numbers_out.shape)


def download(fields: list[Any], first: int, rows: int) -> list[NDArray[np.float64]]:
    """Copies of `rows` elements of fields from `first` on: vectors [rows, n], matrices [rows, n, m]."""
    if is_host_memory():
        return [field_view(field)[first : first + rows].astype(np.float64) for field in fields]
    widths = [prod(element_shape(field)) for field in fields]
    table = np.zeros((rows, sum(widths)))
    if rows:
        read_rows(first, table_layout(fields), table)
    splits = np.split(table, np.cumsum(widths)[:-1], axis=1)
    return [split.reshape(rows, *element_shape(field)) for split, field in zip(splits, fields, strict=True)]


@ti.kernel
def fill_field(count: ti.i32, number: ti.f64, column_out: ti.template()):
    """Every number of a field of one axis; `count` is no constant, so that no more threads start than may."""
    for i in range(count):
        field_out, _, rows, columns = ti.static(column_out)
        if ti.static(rows == 0):
            field_out[i] = ti.cast(number, field_out.dtype)
        for k in ti.static(range(rows * columns)):
            if ti.static(columns == 1):
                field_out[i][k] = ti.cast(number, field_out.dtype)
            else:
                field_out[i][k // columns, k % columns] = ti.cast(number, field_out.dtype)


def write_field(field: Any, values: Any) -> None:
    """Write a whole field of any shape; a single number fills it."""
    if is_host_memory():
        write_cast_numbers(field_view(field), np.broadcast_to(values, field_view(field).shape))
    elif np.ndim(values) == 0 and len(field.shape) == 1:
        fill_field(field.shape[0], values, table_layout([field])[0])
    elif np.ndim(values) == 0:
        field.fill(values)
    else:
        field.from_numpy(np.asarray(values, NUMPY_TYPES[str(field.dtype)]))


def download_field(field: Any) -> NDArray[Any]:
    """Copy of a whole field of any shape, in its own type."""
    return field_view(field).copy() if is_host_memory() else field.to_numpy()
