"""Synthetic turbulence at an inlet: random waves that drift by with the mean wind (frozen turbulence).

    u'_i = s_i sqrt(6 / N) sum_n a_in cos(k_n . (x - U t) + phi_n),    a_n normal to k_n, |a_n| = 1

which has mean 0 and standard deviation s_i, and whose wave numbers are drawn from von Karman's spectrum

    E(k) ~ (k L_e)^4 / (1 + (k L_e)^2)^(17/6),    L_e = 1.339 L,    L the integral length scale [m].

Before the scaling by s the field is isotropic and free of divergence.

Reference: Kraichnan (1970), Phys. Fluids 13, 22; Pope (2000), Turbulent Flows, eq. (6.246).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichi_erosion.core.air_setup import AirSetup, InletTurbulence
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record, write_field

real = ti.f64

ENERGETIC = 1.339  # L_e over the integral length [1]
TABLE = 4096  # wave numbers tabulated between the longest and the shortest wave
LONGEST, SHORTEST = 0.05, 50.0  # wave numbers times L_e between which waves are drawn [1]


@device_record
class InletWaves:
    """Random waves of all replicas, by replica and wave."""

    number: int
    vector: Any  # vec3 [m-1]
    amplitude: Any  # vec3 [m s-1]
    phase: Any  # [rad]
    mean_speed: Any  # mean wind at the inlet [m s-1], by replica


def sample_waves(turbulence: InletTurbulence) -> tuple[Floats, Floats, Floats]:
    """Wave vectors [n, 3] in m-1, amplitudes [n, 3] in m s-1 and phases [n] of one replica."""
    random = np.random.Generator(np.random.Philox(turbulence.seed))
    count, scale = turbulence.waves, ENERGETIC * turbulence.length
    wave = np.geomspace(LONGEST, SHORTEST, TABLE)
    energy = wave**4 / (1.0 + wave**2) ** (17.0 / 6.0)
    share = np.cumsum(energy * np.gradient(wave))
    # one wave from each of `count` equal shares of the energy, so that few waves already have the spectrum
    waves = np.interp((np.arange(count) + random.random(count)) / count * share[-1], share, wave) / scale
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    normal = np.cross(direction, random.normal(size=(count, 3)))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    amplitude = np.asarray(turbulence.deviation) * np.sqrt(6.0 / count) * normal
    return waves[:, None] * direction, amplitude, random.uniform(0.0, 2.0 * np.pi, count)


def allocate_inlet_waves(setups: Sequence[AirSetup]) -> InletWaves:
    """Fields of the waves; without turbulence there is none."""
    samples = [None if s.turbulence is None else sample_waves(s.turbulence) for s in setups]
    number = max((0 if waves is None else len(waves[2]) for waves in samples), default=0)
    shape = (len(setups), max(number, 1))
    fields = InletWaves(
        number,
        vector=ti.Vector.field(3, real, shape=shape),
        amplitude=ti.Vector.field(3, real, shape=shape),
        phase=ti.field(real, shape=shape),
        mean_speed=ti.field(real, shape=shape[:1]),
    )
    if number:
        tables = [np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.zeros(shape)]
        for replica, waves in enumerate(samples):
            for table, values in zip(tables, waves or (), strict=False):
                table[replica, : len(values)] = values
        for field, table in zip((fields.vector, fields.amplitude, fields.phase), tables, strict=True):
            write_field(field, table)
        write_field(fields.mean_speed, [s.sides["x_low"].velocity[0] for s in setups])
    return fields


@ti.kernel
def update_inlet_fluctuation(air_out: ti.template()):
    """Fluctuation at every cell of the inlet at the end of the coming step."""
    (waves,) = ti.static((air_out.waves,))
    ti.loop_config(serialize=air_out.serial)
    for r, j, k in ti.ndrange(air_out.count, air_out.cells[1], air_out.cells[2]):
        y = (j + 0.5) * air_out.numbers.width[r][1]
        x = -waves.mean_speed[r] * (air_out.numbers.time[r] + air_out.numbers.time_step[r])
        position = ti.Vector([x, y, air_out.centre[r, k]])
        total = 0.0 * position
        for n in range(waves.number):
            angle = waves.vector[r, n].dot(position) + waves.phase[r, n]
            total += ti.cos(angle) * waves.amplitude[r, n]
        air_out.inlet_fluctuation[r, j, k] = total
