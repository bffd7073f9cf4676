"""Moving numbers between fields and NumPy, many fields in one launch.

Taichi compiles one kernel for every field that is copied by itself; here a whole group of fields of equal
length goes through one kernel and one f64 table, which holds f32 and i32 values exactly.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.ti import ti


def layout(fields: list[Any]) -> tuple[tuple[Any, int, int, int], ...]:
    """Field, first column of the table, rows and columns of one element; a scalar has no rows."""
    rows, first = [], 0
    for field in fields:
        shape = (*inner_shape(field), 1, 1)[:2] if hasattr(field, "n") else (0, 1)
        rows.append((field, first, *shape))
        first += max(shape[0], 1) * shape[1]
    return tuple(rows)


def inner_shape(field: Any) -> tuple[int, ...]:
    """Shape of one element of a field."""
    if not hasattr(field, "n"):
        return ()
    return (field.n,) if field.m == 1 else (field.n, field.m)


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
    if rows:
        columns = [np.asarray(values, np.float64).reshape(rows, -1) for _, values in pairs]
        table = np.concatenate(columns, axis=1)
        write_rows(first, np.ascontiguousarray(table), layout([field for field, _ in pairs]))


def download(fields: list[Any], first: int, rows: int) -> list[NDArray[np.float64]]:
    """Read `rows` places of several fields from `first` on: vectors as [rows, n], matrices [rows, n, m]."""
    widths = [width(field) for field in fields]
    table = np.zeros((rows, sum(widths)))
    if rows:
        read_rows(first, layout(fields), table)
    splits = np.split(table, np.cumsum(widths)[:-1], axis=1)
    return [split.reshape(rows, *inner_shape(field)) for split, field in zip(splits, fields, strict=True)]
