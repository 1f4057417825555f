"""Cells whose volume strain is the mean over the cell, by the gradient of the energy; for any strain.

The material sees ``k F``, ``k = (Jm / J)^(1/3)``, at each point, J = det F there and Jm the volume of the cell over
that at the start. With its stress P and ``m = k P : F / 3``, the mean of the Kirchhoff stress, the force on node a is
``-sum V (k P - m F^-T + p dJ/dF) grad N_a``, ``p = sum(V m) / sum(V J)``: minus the slope of the stored energy. Where a
volume is not positive the material sees F.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from percuss import stress_3d
from percuss_methods.elements._full_cell import plane_gradient, solid_gradient

if TYPE_CHECKING:
    from percuss import Floats

THIRD = 1.0 / 3.0
NEAR_ONE = 0.04  # so far from 1 the series is right to the last digits
SERIES = tuple(float(one) for one in np.cumprod([1.0, *(-(k + THIRD) / (k + 1) for k in range(10))])[::-1])


class Kept(NamedTuple):
    """What the kernel keeps of the points of the cell that it works on; of tensors n components, row by row.

    In the plane and about an axis the components are xx, xy, yx, yy and that across.
    """

    gradients: Floats  # (points, n) F
    stresses: Floats  # (points, n) volume times k P - m F^-T
    scales: Floats  # (points,) J, then k


class MeanDilatation:
    """What cells with a mean volume strain have in common: the stress in space, at points of one volume strain."""

    dimension = 3
    isochoric = True
    components: ClassVar[int]  # of a tensor, that are kept
    references = (
        "Nagtegaal, Parks, Rice: On numerically accurate finite element solutions in the fully plastic range, Comput. "
        "Methods Appl. Mech. Engrg. 4 (1974), doi 10.1016/0045-7825(74)90032-2",
        "Simo, Taylor, Pister: Variational and projection methods for the volume constraint in finite deformation "
        "elasto-plasticity, Comput. Methods Appl. Mech. Engrg. 51 (1985), doi 10.1016/0045-7825(85)90033-7",
    )

    def rule(self) -> Kept:
        """Return room for the points of a cell."""
        size = len(self.weights), self.components
        return Kept(np.zeros(size), np.zeros(size), np.zeros(size[0]))


def set_scales(of_points: Floats, mean: float) -> None:
    """Replace the J of each point by the cube root of ``mean / J``, where all are near 1 by its series."""
    over, far = 1.0 / mean, 0.0
    for q in range(of_points.size):
        far += (of_points[q] * over - 1.0) ** 2
    if far < NEAR_ONE * NEAR_ONE:
        for q in range(of_points.size):
            x, root = of_points[q] * over - 1.0, 0.0
            for coefficient in SERIES:
                root = root * x + coefficient
            of_points[q] = root
    else:
        for q in range(of_points.size):
            of_points[q] = np.cbrt(mean / of_points[q])


# ---------------------------------------------------------------------------------------- in the plane, about an axis


def flat_forces(
    kept: Kept, material: Any, first: int, geometry: Floats, displacement: Floats, force: Floats, around: int
) -> None:
    """Set `force` to the forces of a cell in plane strain, or of a ring where `around` is not 0."""
    points, count, last = geometry.shape[0], displacement.shape[0], geometry.shape[1] - 1
    volume, whole, total, inside_out = 0.0, 0.0, 0.0, False
    for q in range(points):
        xx, xy, yx, yy = plane_gradient(geometry[q], displacement)
        hoop = 1.0
        if around > 0:
            for a in range(count):
                hoop += displacement[a, 0] * geometry[q, around + a]
        xx, yy = 1.0 + xx, 1.0 + yy
        j = (xx * yy - xy * yx) * hoop
        f = kept.gradients[q]
        f[0], f[1], f[2], f[3], f[4] = xx, xy, yx, yy, hoop
        kept.scales[q] = j
        inside_out = inside_out or j <= 0.0
        volume += geometry[q, last] * j
        whole += geometry[q, last]
    if inside_out:
        kept.scales[:] = 1.0
    else:
        set_scales(kept.scales, volume / whole)
    for q in range(points):
        xx, xy, yx, yy, hoop = kept.gradients[q]
        weight, scale = geometry[q, last], kept.scales[q]
        gradient = (scale * xx - 1.0, scale * xy, 0.0, scale * yx, scale * yy - 1.0, 0.0, 0.0, 0.0, scale * hoop - 1.0)
        p = stress_3d(material, first + q, gradient)
        m = scale * THIRD * (p[0] * xx + p[1] * xy + p[3] * yx + p[4] * yy + p[8] * hoop)
        total += weight * m
        area = xx * yy - xy * yx
        of_stress, less = weight * scale, weight * m / (area * hoop)
        of_mean, s = less * hoop, kept.stresses[q]
        s[0], s[1] = of_stress * p[0] - of_mean * yy, of_stress * p[1] + of_mean * yx
        s[2], s[3] = of_stress * p[3] + of_mean * xy, of_stress * p[4] - of_mean * xx
        s[4] = of_stress * p[8] - less * area
    p_mean = total / volume
    for a in range(count):
        force[a, 0] = force[a, 1] = 0.0
    for q in range(points):
        f, s, more = kept.gradients[q], kept.stresses[q], p_mean * geometry[q, last]
        across = more * f[4]
        xx, xy, yx, yy = s[0] + across * f[3], s[1] - across * f[2], s[2] - across * f[1], s[3] + across * f[0]
        hoop = s[4] + more * (f[0] * f[3] - f[1] * f[2])
        for a in range(count):
            by_x, by_y = geometry[q, 2 * a], geometry[q, 2 * a + 1]
            force[a, 0] -= xx * by_x + xy * by_y
            force[a, 1] -= yx * by_x + yy * by_y
            if around > 0:
                force[a, 0] -= hoop * geometry[q, around + a]


def plane_forces(
    rule: Kept,
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - the volumes contain it
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the forces of a cell in plane strain."""
    flat_forces(rule, material, first, geometry, displacement, force, 0)


def ring_forces(
    rule: Kept,
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - the volumes contain the circumference
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the forces of a ring."""
    flat_forces(rule, material, first, geometry, displacement, force, 2 * displacement.shape[0])


# -------------------------------------------------------------------------------------------------------- in space


def slope_of_volume(f: Floats) -> tuple[float, ...]:
    """Return dJ / dF, row by row, and J."""
    xx, xy, xz = f[4] * f[8] - f[5] * f[7], f[5] * f[6] - f[3] * f[8], f[3] * f[7] - f[4] * f[6]
    yx, yy, yz = f[2] * f[7] - f[1] * f[8], f[0] * f[8] - f[2] * f[6], f[1] * f[6] - f[0] * f[7]
    zx, zy, zz = f[1] * f[5] - f[2] * f[4], f[2] * f[3] - f[0] * f[5], f[0] * f[4] - f[1] * f[3]
    return xx, xy, xz, yx, yy, yz, zx, zy, zz, f[0] * xx + f[1] * xy + f[2] * xz


def solid_forces(
    rule: Kept,
    material: Any,
    first: int,
    section: float,  # noqa: ARG001 - it is 1
    geometry: Floats,
    displacement: Floats,
    force: Floats,
) -> None:
    """Set `force` to the forces of a cell in space."""
    points, count, last = geometry.shape[0], displacement.shape[0], geometry.shape[1] - 1
    volume, whole, total, inside_out = 0.0, 0.0, 0.0, False
    for q in range(points):
        h = solid_gradient(geometry[q], displacement)
        f = 1.0 + h[0], h[1], h[2], h[3], 1.0 + h[4], h[5], h[6], h[7], 1.0 + h[8]
        for k in range(9):
            rule.gradients[q, k] = f[k]
        j = slope_of_volume(f)[9]
        rule.scales[q] = j
        inside_out = inside_out or j <= 0.0
        volume += geometry[q, last] * j
        whole += geometry[q, last]
    if inside_out:
        rule.scales[:] = 1.0
    else:
        set_scales(rule.scales, volume / whole)
    for q in range(points):
        f = rule.gradients[q]
        weight, scale = geometry[q, last], rule.scales[q]
        gradient = (
            scale * f[0] - 1.0, scale * f[1], scale * f[2], scale * f[3], scale * f[4] - 1.0, scale * f[5],
            scale * f[6], scale * f[7], scale * f[8] - 1.0,
        )  # fmt: skip
        p = stress_3d(material, first + q, gradient)
        c = slope_of_volume(f)
        m = p[0] * f[0] + p[1] * f[1] + p[2] * f[2] + p[3] * f[3] + p[4] * f[4]
        m = scale * THIRD * (m + p[5] * f[5] + p[6] * f[6] + p[7] * f[7] + p[8] * f[8])
        total += weight * m
        of_stress, of_mean = weight * scale, -weight * m / c[9]
        for k in range(9):
            rule.stresses[q, k] = of_stress * p[k] + of_mean * c[k]
    p_mean = total / volume
    for a in range(count):
        force[a, 0] = force[a, 1] = force[a, 2] = 0.0
    for q in range(points):
        s, c, more = rule.stresses[q], slope_of_volume(rule.gradients[q]), p_mean * geometry[q, last]
        xx, xy, xz = s[0] + more * c[0], s[1] + more * c[1], s[2] + more * c[2]
        yx, yy, yz = s[3] + more * c[3], s[4] + more * c[4], s[5] + more * c[5]
        zx, zy, zz = s[6] + more * c[6], s[7] + more * c[7], s[8] + more * c[8]
        for a in range(count):
            by_x, by_y, by_z = geometry[q, 3 * a], geometry[q, 3 * a + 1], geometry[q, 3 * a + 2]
            force[a, 0] -= xx * by_x + xy * by_y + xz * by_z
            force[a, 1] -= yx * by_x + yy * by_y + yz * by_z
            force[a, 2] -= zx * by_x + zy * by_y + zz * by_z
