"""A block that slides on a rigid wall, in full matrices: its frequencies, which may be complex.

Written from the formulas alone and knowing nothing of percuss: bilinear quadrilaterals with four Gauss points, plane
strain, E = rho = 1, lumped mass. Penalties at the nodes of the bottom have the stiffness M w / h, with the modulus M of
longitudinal waves. Without them the bottom stays on the wall.
"""

from __future__ import annotations

import itertools

import numpy as np

MOST_OF_ZERO = 1e-4  # growth rate that round-off gives a frequency of 0 at most


def cell(modulus: np.ndarray, width: float, height: float) -> np.ndarray:
    """Return the stiffness of a cell, whose nodes go round against the clock."""
    stiffness = np.zeros((8, 8))
    for a, b in itertools.product((-(3.0**-0.5), 3.0**-0.5), repeat=2):
        x = np.array([-(1 - b), 1 - b, 1 + b, -(1 + b)]) / (2 * width)
        y = np.array([-(1 - a), -(1 + a), 1 + a, 1 - a]) / (2 * height)
        strain = np.zeros((3, 8))
        strain[0, ::2], strain[1, 1::2], strain[2, ::2], strain[2, 1::2] = x, y, y, x
        stiffness += strain.T @ modulus @ strain * width * height / 4
    return stiffness


def frequencies(cells: int, poisson: float, mu: float, *, penalty: bool, size: tuple[float, float] = (1.0, 0.5)):
    """Return all omega of a block of so many cells along the wall, half as many across, that slides along x."""
    along, across = cells, cells // 2
    width, height = size[0] / along, size[1] / across
    shear, first = 1 / (2 * (1 + poisson)), poisson / ((1 + poisson) * (1 - 2 * poisson))
    modulus = np.diag([2 * shear, 2 * shear, shear])
    modulus[:2, :2] += first
    count = (along + 1) * (across + 1)
    stiffness, mass = np.zeros((2 * count, 2 * count)), np.zeros(count)
    for i, j in itertools.product(range(along), range(across)):
        corner = j * (along + 1) + i
        nodes = np.array([corner, corner + 1, corner + along + 2, corner + along + 1])
        dofs = (2 * nodes[:, None] + [0, 1]).ravel()
        stiffness[np.ix_(dofs, dofs)] += cell(modulus, width, height)
        mass[nodes] += width * height / 4
    tangents = 2 * np.arange(along + 1)
    normals = tangents + 1
    kept = np.arange(2 * count)
    if penalty:
        area = np.full(along + 1, width)
        area[[0, -1]] /= 2
        spring = modulus[0, 0] * area / height
        stiffness[normals, normals] += spring
        stiffness[tangents, normals] -= mu * spring
    else:  # the wall presses with what the stiffness asks at the normals, and rubs with mu times that
        stiffness[tangents] -= mu * stiffness[normals]
        kept = np.setdiff1d(kept, normals)
    root = np.repeat(mass, 2)[kept] ** -0.5
    squares = np.linalg.eigvals(root[:, None] * stiffness[np.ix_(kept, kept)] * root)
    return np.sqrt(squares.astype(complex))


def growth_rate(cells: int, poisson: float, mu: float, *, penalty: bool) -> float:
    """Return the fastest growth rate, 0 if it is round-off."""
    rate = float(np.abs(frequencies(cells, poisson, mu, penalty=penalty).imag).max())
    return rate if rate > MOST_OF_ZERO else 0.0
