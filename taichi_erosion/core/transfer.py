"""Moving numbers between fields and NumPy, many fields in one launch.

Taichi compiles one kernel for every field that is copied by itself; here a whole group of fields of equal length goes
through one kernel and one f64 table, which holds f32 and i32 values exactly.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.ti import ti


def components(field: Any) -> list[Any]:
    """Scalar fields that a field consists of, row by row for a matrix."""
    if not hasattr(field, "n"):
        return [field]
    if field.m == 1:
        return [field.get_scalar_field(i) for i in range(field.n)]
    return [field.get_scalar_field(i, j) for i in range(field.n) for j in range(field.m)]


@ti.kernel
def write_rows(
    # parameters
    first: ti.i32,
    # in
    table: ti.types.ndarray(dtype=ti.f64, ndim=2),
    # out
    fields_out: ti.template(),
):
    for i in range(table.shape[0]):
        for k in ti.static(range(len(fields_out))):
            fields_out[k][first + i] = ti.cast(table[i, k], fields_out[k].dtype)


@ti.kernel
def read_rows(
    # parameters
    first: ti.i32,
    # in
    fields: ti.template(),
    # out
    table_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    for i in range(table_out.shape[0]):
        for k in ti.static(range(len(fields))):
            table_out[i, k] = ti.cast(fields[k][first + i], ti.f64)


def upload(pairs: list[tuple[Any, Any]], first: int = 0) -> None:
    """Write arrays of equal length to fields, from place `first` on: pairs of (field, array)."""
    rows = len(np.asarray(pairs[0][1]))
    if rows:
        table = np.concatenate([np.asarray(values, np.float64).reshape(rows, -1) for _, values in pairs], axis=1)
        write_rows(first, np.ascontiguousarray(table), tuple(c for field, _ in pairs for c in components(field)))


def download(fields: list[Any], first: int, rows: int) -> list[NDArray[np.float64]]:
    """Read `rows` places of several fields from place `first` on; vectors become [rows, n], matrices [rows, n, m]."""
    parts = [components(field) for field in fields]
    table = np.zeros((rows, sum(map(len, parts))))
    if rows:
        read_rows(first, tuple(c for part in parts for c in part), table)
    splits = np.split(table, np.cumsum([len(p) for p in parts])[:-1], axis=1)
    return [split.reshape(rows, *inner_shape(field)) for split, field in zip(splits, fields, strict=True)]


def inner_shape(field: Any) -> tuple[int, ...]:
    """Shape of one element of a field."""
    if not hasattr(field, "n"):
        return ()
    return (field.n,) if field.m == 1 else (field.n, field.m)
