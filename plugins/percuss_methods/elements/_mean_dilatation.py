"""Cells whose volume strain is the mean over the cell, by the gradient of the energy; for any strain.

The material sees ``k F``, ``k = (Jm / J)^(1/3)``, at each point, J = det F there and Jm the volume of the cell over
that at the start. With its stress P and ``m = k P : F / 3``, the mean of the Kirchhoff stress, the force on node a is
``-sum V (k P + (p - m) F^-T) grad N_a``, ``p = J sum(V m) / (Jm sum V)``: minus the slope of the stored energy. Where a
volume is not positive the material sees F.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss import stress_3d
from percuss_methods.elements._full_cell import plane_gradient, solid_gradient

if TYPE_CHECKING:
    from percuss import Floats

THIRD = 1.0 / 3.0


class MeanDilatation:
    """What cells with a mean volume strain have in common: the stress in space, at points of one volume strain."""

    dimension = 3
    isochoric = True
    references = (
        "Nagtegaal, Parks, Rice: On numerically accurate finite element solutions in the fully plastic range, Comput. "
        "Methods Appl. Mech. Engrg. 4 (1974), doi 10.1016/0045-7825(74)90032-2",
        "Simo, Taylor, Pister: Variational and projection methods for the volume constraint in finite deformation "
        "elasto-plasticity, Comput. Methods Appl. Mech. Engrg. 51 (1985), doi 10.1016/0045-7825(85)90033-7",
    )


def mean_volume(volume: float, whole: float, least: float) -> float:
    """Return the mean of J over a cell; 0 where it is not positive at a point."""
    return volume / whole if least > 0.0 else 0.0


def scaled(material: Any, point: int, f: tuple[float, ...], scale: float) -> tuple[float, ...]:
    """Return the scaled stress at ``scale F``, row by row, and its product with F over 3, the mean of tau."""
    gradient = (
        scale * f[0] - 1.0, scale * f[1], scale * f[2], scale * f[3], scale * f[4] - 1.0, scale * f[5], scale * f[6],
        scale * f[7], scale * f[8] - 1.0,
    )  # fmt: skip
    p = stress_3d(material, point, gradient)
    a, b, c, d, e = scale * p[0], scale * p[1], scale * p[2], scale * p[3], scale * p[4]
    g, h, k, m = scale * p[5], scale * p[6], scale * p[7], scale * p[8]
    mean = a * f[0] + b * f[1] + c * f[2] + d * f[3] + e * f[4] + g * f[5] + h * f[6] + k * f[7] + m * f[8]
    return a, b, c, d, e, g, h, k, m, THIRD * mean


# ---------------------------------------------------------------------------------------- in the plane, about an axis


def flat(of_point: Floats, displacement: Floats, around: int) -> tuple[float, float, float, float, float]:
    """Return F in the plane, (xx, xy, yx, yy), and across it: 1, or around the axis from entry `around` on."""
    xx, xy, yx, yy = plane_gradient(of_point, displacement)
    hoop = 1.0
    if around > 0:
        for a in range(displacement.shape[0]):
            hoop += displacement[a, 0] * of_point[around + a]
    return 1.0 + xx, xy, yx, 1.0 + yy, hoop


def flat_forces(material: Any, first: int, geometry: Floats, displacement: Floats, force: Floats, around: int) -> None:
    """Set `force` to the forces of a cell in plane strain, or of a ring where `around` is not 0."""
    count, last = displacement.shape[0], geometry.shape[1] - 1
    volume, whole, least, mean = 0.0, 0.0, 1.0, 0.0
    for a in range(count):
        force[a, 0] = force[a, 1] = 0.0
    for q in range(geometry.shape[0]):
        xx, xy, yx, yy, hoop = flat(geometry[q], displacement, around)
        j = (xx * yy - xy * yx) * hoop
        least = min(least, j)
        volume += geometry[q, last] * j
        whole += geometry[q, last]
    ratio = mean_volume(volume, whole, least)
    for q in range(geometry.shape[0]):
        xx, xy, yx, yy, hoop = flat(geometry[q], displacement, around)
        area = xx * yy - xy * yx
        scale = np.cbrt(ratio / (area * hoop)) if ratio > 0.0 else 1.0
        p = scaled(material, first + q, (xx, xy, 0.0, yx, yy, 0.0, 0.0, 0.0, hoop), scale)
        weight, less = -geometry[q, last], p[9] / area
        mean -= weight * p[9]
        rows = p[0] - less * yy, p[1] + less * yx, p[3] + less * xy, p[4] - less * xx, p[8] - p[9] / hoop
        spread(geometry[q], force, rows, weight, around)
    for q in range(geometry.shape[0]):
        xx, xy, yx, yy, hoop = flat(geometry[q], displacement, around)
        weight = -mean * geometry[q, last] * hoop / volume  # of dJ / dF
        spread(geometry[q], force, (yy, -yx, -xy, xx, (xx * yy - xy * yx) / hoop), weight, around)


def spread(of_point: Floats, force: Floats, p: tuple[float, ...], weight: float, around: int) -> None:
    """Add `weight` times P grad N_a to the forces, P as xx, xy, yx, yy and across."""
    for a in range(force.shape[0]):
        by_x, by_y = of_point[2 * a], of_point[2 * a + 1]
        force[a, 0] += weight * (p[0] * by_x + p[1] * by_y)
        force[a, 1] += weight * (p[2] * by_x + p[3] * by_y)
        if around > 0:
            force[a, 0] += weight * p[4] * of_point[around + a]


def plane_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - the volumes contain it
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the forces of a cell in plane strain."""
    flat_forces(material, first, geometry, displacement, force, 0)


def ring_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - the volumes contain the circumference
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the forces of a ring."""
    flat_forces(material, first, geometry, displacement, force, 2 * displacement.shape[0])


# -------------------------------------------------------------------------------------------------------- in space


def solid(of_point: Floats, displacement: Floats) -> tuple[float, ...]:
    """Return F of a point in space, row by row."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = solid_gradient(of_point, displacement)
    return 1.0 + xx, xy, xz, yx, 1.0 + yy, yz, zx, zy, 1.0 + zz


def slope_of_volume(f: tuple[float, ...]) -> tuple[float, ...]:
    """Return dJ / dF, row by row, and J."""
    xx, xy, xz = f[4] * f[8] - f[5] * f[7], f[5] * f[6] - f[3] * f[8], f[3] * f[7] - f[4] * f[6]
    yx, yy, yz = f[2] * f[7] - f[1] * f[8], f[0] * f[8] - f[2] * f[6], f[1] * f[6] - f[0] * f[7]
    zx, zy, zz = f[1] * f[5] - f[2] * f[4], f[2] * f[3] - f[0] * f[5], f[0] * f[4] - f[1] * f[3]
    return xx, xy, xz, yx, yy, yz, zx, zy, zz, f[0] * xx + f[1] * xy + f[2] * xz


def solid_forces(
    rule: Any,  # noqa: ARG001
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - it is 1
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the forces of a cell in space."""
    count, last = displacement.shape[0], geometry.shape[1] - 1
    volume, whole, least, mean = 0.0, 0.0, 1.0, 0.0
    for a in range(count):
        force[a, 0] = force[a, 1] = force[a, 2] = 0.0
    for q in range(geometry.shape[0]):
        j = slope_of_volume(solid(geometry[q], displacement))[9]
        least = min(least, j)
        volume += geometry[q, last] * j
        whole += geometry[q, last]
    ratio = mean_volume(volume, whole, least)
    for q in range(geometry.shape[0]):
        f = solid(geometry[q], displacement)
        c = slope_of_volume(f)
        scale = np.cbrt(ratio / c[9]) if ratio > 0.0 else 1.0
        p = scaled(material, first + q, f, scale)
        mean += geometry[q, last] * p[9]
        less = p[9] / c[9]
        rows = (
            p[0] - less * c[0], p[1] - less * c[1], p[2] - less * c[2], p[3] - less * c[3], p[4] - less * c[4],
            p[5] - less * c[5], p[6] - less * c[6], p[7] - less * c[7], p[8] - less * c[8],
        )  # fmt: skip
        spread_solid(geometry[q], force, rows, -geometry[q, last])
    for q in range(geometry.shape[0]):
        c = slope_of_volume(solid(geometry[q], displacement))
        spread_solid(geometry[q], force, c, -mean * geometry[q, last] / volume)


def spread_solid(of_point: Floats, force: Floats, p: tuple[float, ...], weight: float) -> None:
    """Add `weight` times P grad N_a to the forces in space."""
    for a in range(force.shape[0]):
        x, y, z = weight * of_point[3 * a], weight * of_point[3 * a + 1], weight * of_point[3 * a + 2]
        force[a, 0] += p[0] * x + p[1] * y + p[2] * z
        force[a, 1] += p[3] * x + p[4] * y + p[5] * z
        force[a, 2] += p[6] * x + p[7] * y + p[8] * z
