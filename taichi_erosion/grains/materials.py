"""Contact parameters on the device: one row a replica and pair of materials."""

from math import isqrt, pi, sqrt
from typing import Any

import numpy as np

from taichi_erosion.core.setup import ContactTable, Floats, material_pair_rows
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record, record_members, upload

TSUJI = 2.0 * sqrt(5.0 / 6.0)  # factor of the damping force of a Hertz contact [1], Tsuji et al. (1992)
RESTITUTION_LEAST = 1e-6  # stands for every smaller restitution [1]; log(0) has no value


@device_record
class Materials:
    """Contact rows; `rows` of them a replica, those of `core.setup.pair_row` with `count` materials.

    A replica with fewer materials has the first ones; rows of the others are zero and never read.
    """

    count: int
    rows: int
    young: Any  # effective Young's modulus E* [Pa]
    shear: Any  # effective shear modulus G* [Pa]
    damping: Any  # 2 sqrt(5/6) beta sqrt(2 E*): times sqrt(a m*) it is the normal damping constant
    shear_damping: Any  # tangential over normal damping constant, sqrt(4 G* / E*) [1]
    friction_sliding: Any  # [1]
    friction_rolling: Any  # [1]
    rolling_damping: Any  # share of the critical value [1]
    adhesion: Any  # pi times surface energy [J m-2]
    effects: Any  # 1 where pair effects act, else 0


def allocate_materials(replicas: int, materials: int) -> Materials:
    rows = materials * (materials + 1) // 2
    names = record_members(Materials)[2:]
    return Materials(materials, rows, **{name: ti.field(float, shape=replicas * rows) for name in names})


def damping_ratio(restitution: Floats) -> Floats:
    """Damping over critical damping that gives a Hertz contact its restitution [1].

    beta = -ln e / sqrt(ln^2 e + pi^2); exact for F = k d^1.5 + c d^0.25 v.
    Reference: Tsuji, Tanaka & Ishida (1992), Powder Technology 71, 239; Antypov & Elliott (2011), EPL 94,
    50004.
    """
    logarithm = np.log(np.maximum(restitution, RESTITUTION_LEAST))
    return -logarithm / np.sqrt(logarithm**2 + pi**2)


def replica_columns(materials: Materials, table: ContactTable) -> dict[str, Floats]:
    """Columns of Materials of one replica, from what a scene states."""
    columns = {
        "young": table.young_effective,
        "shear": table.shear_effective,
        "damping": TSUJI * damping_ratio(table.restitution) * np.sqrt(2.0 * table.young_effective),
        "shear_damping": np.sqrt(4.0 * table.shear_effective / table.young_effective),
        "friction_sliding": table.friction_sliding,
        "friction_rolling": table.friction_rolling,
        "rolling_damping": table.rolling_damping,
        "adhesion": pi * table.surface_energy,
        "effects": table.effects,
    }
    count = (isqrt(8 * len(table.restitution) + 1) - 1) // 2  # materials of the table, from its pairs
    rows = material_pair_rows(count, materials.count)
    whole = {name: np.zeros(materials.rows) for name in columns}
    for name, values in columns.items():
        whole[name][rows] = values
    return whole


def upload_materials(materials: Materials, tables: list[ContactTable], first: int = 0) -> None:
    """Write the contact tables of replicas to the device, from one replica on."""
    columns = [replica_columns(materials, table) for table in tables]
    upload(
        [(getattr(materials, name), np.concatenate([c[name] for c in columns])) for name in columns[0]],
        first * materials.rows,
    )


@ti.func
def pair_row(materials: ti.template(), r, i, j):
    """Row of replica r for materials i and j; `core.setup.pair_row` on the device."""
    low = ti.min(i, j)
    high = ti.max(i, j)
    return r * materials.rows + low * materials.count - low * (low - 1) // 2 + high - low
