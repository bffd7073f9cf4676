"""Coarse-grained fields of the grains: solid fraction, density, velocity, kinetic and contact stress.

    rho(r)      = sum_i m_i psi(r - r_i),       rho V(r) = sum_i m_i v_i psi(r - r_i)
    sigma_k(r)  = sum_i m_i (v_i - V)(v_i - V) psi(r - r_i)
    sigma_c(r)  = sum_ij f_ij b_ij int_0^1 psi(r - r_i + s b_ij) ds
    t(r)        = sum_iw f_iw psi(r - c_iw)

f_ij is the force on grain i [N], b_ij leads from grain j, or from the point c_iw on a wall, to grain i [m].
Stresses [Pa] are positive where they press. psi is a Gaussian of width w [m], a product over x, y and z;
along an axis without coordinates it is averaged over an extent. For any w mass and momentum are kept:

    d(rho V)/dt + div(rho V V + sigma_k + sigma_c) = t + rho g + forces of air and of single grains

The integral over s is a Gauss-Legendre sum, exact to 1e-9 of the largest stress.

Reference: Goldhirsch (2010), Granular Matter 12, 239; Weinhart et al. (2012), Granular Matter 14, 289.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, pi, sqrt

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import ContactNetwork, GrainFields, Snapshot
from taichi_erosion.measures.result import Measurement, no_measurement

AXES = "xyz"
CHUNK = 2048  # points that are spread at once
LEAST_NODES, NODES_PER_WIDTH = 6, 2.0  # of the sum over s, the second for every width between two centres [1]
MIDDLE = (25.0, 75.0)  # of the heights of grains, between which a bed is measured [%]
THINNEST = 1e-6  # of the largest density: less has no velocity [1]


@dataclass(frozen=True)
class Kernel:
    """Coordinates at which fields are wanted, and what spreads the grains."""

    at: Mapping[str, Floats]  # m, by axis in order of x, y, z
    width: float  # m, standard deviation along every axis
    extent: Mapping[str, float]  # m, of every axis that is left out
    period: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, 0 where open

    def kernel_sum(self, place: Floats, weight: Floats) -> Floats:
        """Sum of weights [n, ...] at places [n, 3] m by the kernel, per m3: [*shape of coordinates, ...]."""
        inner, letters = weight.shape[1:], AXES[: len(self.at)]
        flat = weight.reshape(len(weight), int(np.prod(inner)))
        total = np.zeros((*map(len, self.at.values()), flat.shape[1]))
        form = ",".join(f"n{letter}" for letter in letters) + f",nk->{letters}k"
        for first in range(0, len(place), CHUNK):
            part = slice(first, first + CHUNK)
            factors = [self.kernel_along_axis(name, place[part, AXES.index(name)]) for name in self.at]
            total += np.einsum(form, *factors, flat[part], optimize=True)
        total /= np.prod([self.extent[name] for name in AXES if name not in self.at])
        return total.reshape(*total.shape[:-1], *inner)

    def kernel_along_axis(self, name: str, place: Floats) -> Floats:
        """The kernel along one axis, [n, coordinates] m-1, with the images of a period."""
        away, period = self.at[name] - place[:, None], self.period[AXES.index(name)]
        images = [0.0]
        if period > 0.0:
            away -= period * np.round(away / period)
            reach = ceil(6.0 * self.width / period)
            images = [period * k for k in range(-reach, reach + 1)]
        scaled = ((away + image) / self.width for image in images)
        return np.sum([np.exp(-0.5 * one**2) for one in scaled], axis=0) / (sqrt(2.0 * pi) * self.width)


def coarse_grain(state: Snapshot, network: ContactNetwork, kernel: Kernel) -> GrainFields:
    """Fields of single spheres; those of a clump would count its overlaps twice."""
    mass, momentum = state.mass, state.mass[:, None] * state.velocity
    volume = 4.0 / 3.0 * pi * state.radius**3
    columns = [volume[:, None], mass[:, None], momentum]
    columns.append((momentum[:, :, None] * state.velocity[:, None, :]).reshape(-1, 9))
    sums = kernel.kernel_sum(state.position, np.concatenate(columns, axis=1))
    density = sums[..., 1]
    dense = (density > THINNEST * density.max(initial=0.0))[..., None]
    momentum = sums[..., 2:5]
    velocity = np.divide(momentum, density[..., None], np.full_like(momentum, np.nan), where=dense)
    mean = np.nan_to_num(velocity)
    kinetic = sums[..., 5:].reshape(*density.shape, 3, 3)
    kinetic = kinetic - mean[..., :, None] * sums[..., None, 2:5]
    walls = network.second < 0
    foot = (network.centre - network.branch)[walls]
    return GrainFields(
        state.time,
        kernel.at,
        kernel.width,
        solid_fraction=sums[..., 0],
        density=density,
        velocity=velocity,
        kinetic_stress=kinetic,
        contact_stress=contact_stress(network, kernel),
        wall_force=kernel.kernel_sum(foot, network.force[walls]),
    )


def contact_stress(network: ContactNetwork, kernel: Kernel) -> Floats:
    """Stress that the contacts carry along their branches [Pa], [*shape, 3, 3]."""
    far = float(np.linalg.norm(network.branch, axis=1).max(initial=0.0))
    nodes, weights = np.polynomial.legendre.leggauss(LEAST_NODES + ceil(NODES_PER_WIDTH * far / kernel.width))
    carried = network.force[:, :, None] * network.branch[:, None, :]
    parts = (
        kernel.kernel_sum(network.centre - 0.5 * (1.0 + node) * network.branch, 0.5 * weight * carried)
        for node, weight in zip(nodes, weights, strict=True)
    )
    return np.sum(list(parts), axis=0)


def mean_over_middle_of_bed(name: str, state: Snapshot, fields: GrainFields, values: Floats) -> Measurement:
    """Mean of a pure number over the middle of a bed, and its standard deviation along the height."""
    values = values.ravel()
    low, high = np.percentile(state.position[:, 2], MIDDLE) if len(state.mass) else (0.0, 0.0)
    rows = np.flatnonzero((fields.at["z"] >= low) & (fields.at["z"] <= high))
    if len(rows) < 2 or not np.isfinite(values[rows]).all():
        return no_measurement(name, "1", "the bed is thinner than a grain, or nothing presses in its middle")
    details = {"height": fields.at["z"].tolist(), "profile": values.tolist(), "width": fields.width}
    return Measurement(name, float(values[rows].mean()), float(values[rows].std()), "1", details=details)


def solid_fraction(state: Snapshot, fields: GrainFields) -> Measurement:
    """Solid fraction in the middle of a bed [1]."""
    return mean_over_middle_of_bed("solid_fraction", state, fields, fields.solid_fraction)


def lateral_stress_ratio(state: Snapshot, fields: GrainFields) -> Measurement:
    """Horizontal over vertical stress in the middle of a bed [1], K0 of a bed at rest."""
    stress = fields.contact_stress + fields.kinetic_stress
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = 0.5 * (stress[..., 0, 0] + stress[..., 1, 1]) / stress[..., 2, 2]
    return mean_over_middle_of_bed("lateral_stress_ratio", state, fields, ratio)
