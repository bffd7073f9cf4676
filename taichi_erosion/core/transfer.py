"""Moving numbers between fields and NumPy.

On a CPU they are read and written where they lie (`core.memory`), and nothing is compiled for it. Elsewhere
Taichi would compile one kernel for every field that is copied by itself; so a whole group of fields of equal
length goes through one kernel and one f64 table, which holds f32 and i32 values exactly.
"""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.memory import NUMPY_TYPES, inner_shape, is_host, memory
from taichi_erosion.core.ti import ti


def device_fields(owner: Any) -> Iterator[Any]:
    """All fields that a record holds, in records within it too."""
    for entry in fields(owner):
        value = getattr(owner, entry.name)
        if is_dataclass(value):
            yield from device_fields(value)
        elif hasattr(value, "dtype") and hasattr(value, "shape"):
            yield value


def layout(chosen: list[Any]) -> tuple[tuple[Any, int, int, int], ...]:
    """Field, first column of the table, rows and columns of one element; a scalar has no rows."""
    rows, first = [], 0
    for field in chosen:
        shape = (*inner_shape(field), 1, 1)[:2] if hasattr(field, "n") else (0, 1)
        rows.append((field, first, *shape))
        first += max(shape[0], 1) * shape[1]
    return tuple(rows)


def width(field: Any) -> int:
    """Numbers in one element of a field."""
    return int(np.prod(inner_shape(field), dtype=int))


@ti.kernel
def write_rows(
    # parameters
    first: ti.i32,
    # in
    table: ti.types.ndarray(dtype=ti.f64, ndim=2),
    # out
    columns_out: ti.template(),
):
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
def read_rows(
    # parameters
    first: ti.i32,
    # in
    columns_in: ti.template(),
    # out
    table_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
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
    """Write arrays of equal length to fields, from place `first` on: pairs of (field, array)."""
    rows = len(np.asarray(pairs[0][1]))
    if rows == 0:
        return
    if is_host():
        for field, values in pairs:
            set_numbers(memory(field)[first : first + rows], values)
        return
    columns = [np.asarray(values, np.float64).reshape(rows, -1) for _, values in pairs]
    table = np.concatenate(columns, axis=1)
    write_rows(first, np.ascontiguousarray(table), layout([field for field, _ in pairs]))


def set_numbers(numbers_out: NDArray[Any], values: Any) -> None:
    """Write values, as f64, to numbers of any type; what does not fit becomes what the device makes of it."""
    with np.errstate(over="ignore", invalid="ignore"):
        numbers_out[...] = np.asarray(values, np.float64).reshape(numbers_out.shape)


def download(fields: list[Any], first: int, rows: int) -> list[NDArray[np.float64]]:
    """Read `rows` places of several fields from `first` on: vectors as [rows, n], matrices [rows, n, m]."""
    if is_host():
        return [memory(field)[first : first + rows].astype(np.float64) for field in fields]
    widths = [width(field) for field in fields]
    table = np.zeros((rows, sum(widths)))
    if rows:
        read_rows(first, layout(fields), table)
    splits = np.split(table, np.cumsum(widths)[:-1], axis=1)
    return [split.reshape(rows, *inner_shape(field)) for split, field in zip(splits, fields, strict=True)]


def write(field: Any, values: Any) -> None:
    """Write a whole field of any shape; one number goes everywhere."""
    if is_host():
        set_numbers(memory(field), np.broadcast_to(values, memory(field).shape))
    elif np.ndim(values) == 0:
        field.fill(values)
    else:
        field.from_numpy(np.asarray(values, NUMPY_TYPES[str(field.dtype)]))


def read(field: Any) -> NDArray[Any]:
    """Copy of a whole field of any shape, in its own type."""
    return memory(field).copy() if is_host() else field.to_numpy()
