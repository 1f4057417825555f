"""Plasticity of metals at any strain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, NamedTuple

from percuss import Doc, Ge, Gt, Unit
from percuss_methods.materials._hyperelastic import Hyperelastic

if TYPE_CHECKING:
    from percuss import Floats

SWEEPS = 8  # of Jacobi's rotations, whose error squares in each
NO_MORE = 1e-34  # square of what is off the diagonal over that on it
SMALL = 5e-4  # half of the square of a tensor up to which the series are right to the last digits
# Coefficients of the powers of X in threes (1, X, X^2 times X^9, X^6, X^3, 1), of ln(I + X) and of exp(X).
LOGARITHM = tuple(tuple((-1.0) ** (k + 1) / k if k else 0.0 for k in (n, n + 1, n + 2)) for n in (9, 6, 3, 0))
EXPONENTIAL = tuple(tuple(1.0 / math.factorial(k) for k in (n, n + 1, n + 2)) for n in (6, 3, 0))


@dataclass(frozen=True)
class J2Plastic(Hyperelastic):
    """Elastic in logarithmic strain, plastic by von Mises with linear isotropic hardening.

    Formula: ``b = F C_p^-1 F^T``, ``eps = ln(b) / 2``, ``tau = K tr(eps) I + s``, ``s = 2 G dev(eps)``, ``q = sqrt(3/2)
    |s|``, ``P = tau F^-T``. Where ``q > Y + H alpha`` the plastic strain alpha grows by ``dg = (q - Y - H alpha) / (3 G
    + H)``, s becomes ``s (1 - 3 G dg / q)`` along the same axes, and ``C_p^-1 = F^-1 b F^-T``.

    The return is exact for the strain of a step, and the state turns with the body. Stored is the elastic energy ``K
    tr(eps)^2 / 2 + |s|^2 / (4 G)``; all of the plastic work is dissipated, that of hardening too.
    """

    name = "j2-plastic"
    summary = "Elastic in logarithmic strain, plastic by von Mises with linear hardening"
    references = (
        "Simo: Algorithms for static and dynamic multiplicative plasticity that preserve the classical return mapping "
        "schemes of the infinitesimal theory, Comput. Methods Appl. Mech. Engrg. 99 (1992), "
        "doi 10.1016/0045-7825(92)90123-2",
    )
    examples = (
        {"young": 100.0, "density": 1.0, "poisson": 0.3, "yield_stress": 0.5},
        {"young": 100.0, "density": 1.0, "poisson": 0.3, "yield_stress": 0.5, "hardening": 5.0},
    )
    state = 9  # C_p^-1 - I (xx, yy, zz, xy, xz, yz), alpha, energy stored and energy dissipated per volume
    stored_in = 7
    dissipated_in = 8
    plastic_in = 6

    yield_stress: Annotated[float, Gt(0), Unit("force/length^2"), Doc("Y, at which plastic strain begins")]
    hardening: Annotated[float, Ge(0), Unit("force/length^2"), Doc("H, plastic modulus")] = 0.0

    def solid_parameters(self, plane: str) -> tuple[float, ...]:
        """Return K, G, Y and H."""
        first, second = Hyperelastic.solid_parameters(self, plane)
        return first + 2.0 * second / 3.0, second, self.yield_stress, self.hardening

    def wave_modulus(self, plane: str) -> float:
        """Return K + 4 G / 3."""
        bulk, shear, _, _ = self.solid_parameters(plane)
        return bulk + 4.0 * shear / 3.0

    @staticmethod
    def stress_3d(parameters: Floats, gradient: tuple[float, ...], before: Floats, after: Floats) -> tuple[float, ...]:
        """Return P of a displacement gradient, row by row, and set plastic strain and energies."""
        shear, limit, hardening = parameters[1], parameters[2], parameters[3]
        tried = trial(shear, gradient, before)
        more, excess = 0.0, tried.size - limit - hardening * before[6]
        if excess > 0.0:
            more = excess / (3.0 * shear + hardening)
            after[8] = before[8] + more * (limit + hardening * (before[6] + 0.5 * more))
        return returned(parameters[0], shear, tried, more, before, after)


Nine = tuple[float, float, float, float, float, float, float, float, float]
Six = tuple[float, float, float, float, float, float]
Three = tuple[float, float, float]


class Trial(NamedTuple):
    """A point where nothing flows in a step."""

    f: Nine
    volume: float  # trace of the logarithmic strain
    twice: Six  # twice its deviator: xx, yy, zz, xy, xz, yz
    square: float  # half of the sum of the squares of `twice`
    size: float  # q


def trial(shear: float, gradient: tuple[float, ...], before: Floats) -> Trial:
    """Return a point where nothing flows in a step."""
    f = (
        1.0 + gradient[0], gradient[1], gradient[2], gradient[3], 1.0 + gradient[4], gradient[5], gradient[6],
        gradient[7], 1.0 + gradient[8],
    )  # fmt: skip
    c = before[0], before[1], before[2], before[3], before[4], before[5]
    trace, twice = logarithm(pushed(f, shifted(1.0, c)))
    square = half_square(twice)
    return Trial(f, 0.5 * trace, twice, square, shear * math.sqrt(3.0 * square))


def returned(bulk: float, shear: float, tried: Trial, more: float, before: Floats, after: Floats) -> tuple[float, ...]:
    """Return P, row by row, where the plastic strain grows by `more`, and set the state but for what is dissipated."""
    volume, twice, left, back = tried.volume, tried.twice, 1.0, inverse(tried.f)
    if more > 0.0:
        left = 1.0 - 3.0 * shear * more / tried.size
        flowed = pushed(back, scaled(math.exp(2.0 * volume / 3.0), exponential(scaled(left, twice))))
        flowed = shifted(-1.0, flowed)
        for k in range(6):
            after[k] = flowed[k]
        after[6] = before[6] + more
    after[7] = 0.5 * (bulk * volume * volume + shear * left * left * tried.square)
    t = shifted(bulk * volume, scaled(shear * left, twice))
    return (
        t[0] * back[0] + t[3] * back[1] + t[4] * back[2], t[0] * back[3] + t[3] * back[4] + t[4] * back[5],
        t[0] * back[6] + t[3] * back[7] + t[4] * back[8], t[3] * back[0] + t[1] * back[1] + t[5] * back[2],
        t[3] * back[3] + t[1] * back[4] + t[5] * back[5], t[3] * back[6] + t[1] * back[7] + t[5] * back[8],
        t[4] * back[0] + t[5] * back[1] + t[2] * back[2], t[4] * back[3] + t[5] * back[4] + t[2] * back[5],
        t[4] * back[6] + t[5] * back[7] + t[2] * back[8],
    )  # fmt: skip


# --------------------------------------------------------------------------------------------- functions of tensors


def logarithm(tensor: Six) -> tuple[float, Six]:
    """Return trace and deviator of the logarithm of a symmetric tensor that is positive."""
    mean = (tensor[0] + tensor[1] + tensor[2]) / 3.0
    x = shifted(-1.0, scaled(1.0 / mean, tensor))
    half = half_square(x)
    if half < SMALL:
        found = series(LOGARITHM, half, determinant(x), x)
        return 3.0 * math.log(mean) + found[0] + found[1] + found[2], deviator(found)
    values, axes = principal(tensor)
    a, b, c = math.log(values[0]), math.log(values[1]), math.log(values[2])
    return a + b + c, deviator(composed((a, b, c), axes))


def exponential(tensor: Six) -> Six:
    """Return the exponential of a symmetric tensor without a trace."""
    half = half_square(tensor)
    if half < SMALL:
        return series(EXPONENTIAL, half, determinant(tensor), tensor)
    values, axes = principal(tensor)
    return composed((math.exp(values[0]), math.exp(values[1]), math.exp(values[2])), axes)


def series(coefficients: tuple[Three, ...], half: float, det: float, x: Six) -> Six:
    """Return a polynomial of a tensor X without a trace: ``X^3 = half X + det I``; its coefficients in threes."""
    p = q = r = 0.0  # p I + q X + r X^2
    for a, b, c in coefficients:
        p, q, r = a + det * p + half * det * r, b + half * p + det * q + half * half * r, c + half * q + det * r
    return (
        p + q * x[0] + r * (x[0] * x[0] + x[3] * x[3] + x[4] * x[4]),
        p + q * x[1] + r * (x[3] * x[3] + x[1] * x[1] + x[5] * x[5]),
        p + q * x[2] + r * (x[4] * x[4] + x[5] * x[5] + x[2] * x[2]),
        q * x[3] + r * (x[0] * x[3] + x[3] * x[1] + x[4] * x[5]),
        q * x[4] + r * (x[0] * x[4] + x[3] * x[5] + x[4] * x[2]),
        q * x[5] + r * (x[3] * x[4] + x[1] * x[5] + x[5] * x[2]),
    )


def half_square(t: Six) -> float:
    """Return half of the sum of the squares of all nine components."""
    return 0.5 * (t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) + t[3] * t[3] + t[4] * t[4] + t[5] * t[5]


def determinant(t: Six) -> float:
    """Return the determinant of a symmetric tensor."""
    return t[0] * (t[1] * t[2] - t[5] * t[5]) - t[3] * (t[3] * t[2] - t[5] * t[4]) + t[4] * (t[3] * t[5] - t[1] * t[4])


def scaled(by: float, t: Six) -> Six:
    """Return the multiple of a tensor."""
    return by * t[0], by * t[1], by * t[2], by * t[3], by * t[4], by * t[5]


def shifted(by: float, t: Six) -> Six:
    """Return a tensor with `by` more on its diagonal."""
    return t[0] + by, t[1] + by, t[2] + by, t[3], t[4], t[5]


def deviator(t: Six) -> Six:
    """Return a tensor without its trace."""
    return shifted(-(t[0] + t[1] + t[2]) / 3.0, t)


def pushed(f: Nine, c: Six) -> Six:
    """Return F C F^T of a symmetric C: xx, yy, zz, xy, xz, yz."""
    a_x, a_y, a_z = row(f[0], f[1], f[2], c), row(f[3], f[4], f[5], c), row(f[6], f[7], f[8], c)
    return (
        a_x[0] * f[0] + a_x[1] * f[1] + a_x[2] * f[2], a_y[0] * f[3] + a_y[1] * f[4] + a_y[2] * f[5],
        a_z[0] * f[6] + a_z[1] * f[7] + a_z[2] * f[8], a_x[0] * f[3] + a_x[1] * f[4] + a_x[2] * f[5],
        a_x[0] * f[6] + a_x[1] * f[7] + a_x[2] * f[8], a_y[0] * f[6] + a_y[1] * f[7] + a_y[2] * f[8],
    )  # fmt: skip


def row(x: float, y: float, z: float, c: Six) -> tuple[float, float, float]:
    """Return the product of a row and a symmetric tensor."""
    return x * c[0] + y * c[3] + z * c[4], x * c[3] + y * c[1] + z * c[5], x * c[4] + y * c[5] + z * c[2]


def inverse(f: Nine) -> Nine:
    """Return the inverse of a tensor, row by row."""
    xx, xy, xz = f[4] * f[8] - f[5] * f[7], f[2] * f[7] - f[1] * f[8], f[1] * f[5] - f[2] * f[4]
    yx, yy, yz = f[5] * f[6] - f[3] * f[8], f[0] * f[8] - f[2] * f[6], f[2] * f[3] - f[0] * f[5]
    zx, zy, zz = f[3] * f[7] - f[4] * f[6], f[1] * f[6] - f[0] * f[7], f[0] * f[4] - f[1] * f[3]
    over = 1.0 / (f[0] * xx + f[1] * yx + f[2] * zx)
    return over * xx, over * xy, over * xz, over * yx, over * yy, over * yz, over * zx, over * zy, over * zz


def composed(values: tuple[float, float, float], axes: Nine) -> Six:
    """Return the symmetric tensor of principal values and axes, which are the columns."""
    a, b, c = values
    return (
        a * axes[0] * axes[0] + b * axes[1] * axes[1] + c * axes[2] * axes[2],
        a * axes[3] * axes[3] + b * axes[4] * axes[4] + c * axes[5] * axes[5],
        a * axes[6] * axes[6] + b * axes[7] * axes[7] + c * axes[8] * axes[8],
        a * axes[0] * axes[3] + b * axes[1] * axes[4] + c * axes[2] * axes[5],
        a * axes[0] * axes[6] + b * axes[1] * axes[7] + c * axes[2] * axes[8],
        a * axes[3] * axes[6] + b * axes[4] * axes[7] + c * axes[5] * axes[8],
    )


def rotation(one: float, other: float, off: float) -> tuple[float, float]:
    """Return cosine and sine of the rotation that makes a symmetric tensor of two rows diagonal."""
    if off == 0.0:
        return 1.0, 0.0
    half = 0.5 * (other - one) / off
    slope = math.copysign(1.0, half) / (abs(half) + math.sqrt(half * half + 1.0))
    cosine = 1.0 / math.sqrt(1.0 + slope * slope)
    return cosine, slope * cosine


def turned(c: float, s: float, one: float, other: float) -> tuple[float, float]:
    """Return two components after a rotation with a cosine and a sine."""
    return c * one - s * other, s * one + c * other


def principal(tensor: Six) -> tuple[tuple[float, float, float], Nine]:
    """Return principal values and axes, as columns, of a symmetric tensor, by Jacobi's rotations."""
    xx, yy, zz, xy, xz, yz = tensor
    ax, ay, az, bx, by, bz, cx, cy, cz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for _ in range(SWEEPS):
        if xy * xy + xz * xz + yz * yz <= NO_MORE * (xx * xx + yy * yy + zz * zz):
            break
        c, s = rotation(xx, yy, xy)
        xx, yy = c * c * xx - 2.0 * c * s * xy + s * s * yy, s * s * xx + 2.0 * c * s * xy + c * c * yy
        xy, (xz, yz) = 0.0, turned(c, s, xz, yz)
        (ax, ay), (bx, by), (cx, cy) = turned(c, s, ax, ay), turned(c, s, bx, by), turned(c, s, cx, cy)
        c, s = rotation(xx, zz, xz)
        xx, zz = c * c * xx - 2.0 * c * s * xz + s * s * zz, s * s * xx + 2.0 * c * s * xz + c * c * zz
        xz, (xy, yz) = 0.0, turned(c, s, xy, yz)
        (ax, az), (bx, bz), (cx, cz) = turned(c, s, ax, az), turned(c, s, bx, bz), turned(c, s, cx, cz)
        c, s = rotation(yy, zz, yz)
        yy, zz = c * c * yy - 2.0 * c * s * yz + s * s * zz, s * s * yy + 2.0 * c * s * yz + c * c * zz
        yz, (xy, xz) = 0.0, turned(c, s, xy, xz)
        (ay, az), (by, bz), (cy, cz) = turned(c, s, ay, az), turned(c, s, by, bz), turned(c, s, cy, cz)
    return (xx, yy, zz), (ax, ay, az, bx, by, bz, cx, cy, cz)
