"""The stability limit of a multi-stage scheme, from its amplification of single oscillators."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.methods import slots
from percuss.methods.interfaces import Integrator, Stages
from percuss.solver.compiler.specialise import Specialiser

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats
from percuss.solver.integrator_check import kernel_of

GROWS = 1e-9  # of a step: a smaller growth is round-off
OSCILLATORS = 1001


def oscillating(system: Any, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to that of oscillators whose squared frequencies `system` holds."""
    a[:] = -system[0] * u


def amplification(integrator: Integrator, stages: Stages, dt: float, squares: Floats) -> Any:
    """Return the amplification matrices of oscillators, (Z, m, m) of the states (u, dt v, dt^2 kept).

    Parameters
    ----------
    integrator, stages, dt
        The scheme and its step.
    squares : (Z,) array
        ``(omega dt)^2`` of each oscillator.
    """
    step = Specialiser({slots.accelerations: oscillating}, jit=False).bind(kernel_of(integrator))
    size = 2 + integrator.kept
    out = np.zeros((squares.size, size, size))
    scale = dt ** -np.concatenate([[0.0, 1.0], np.full(integrator.kept, 2.0)])
    for k in range(size):
        state = np.zeros((size, squares.size))
        state[k] = scale[k]
        u, v, kept = state[0].copy(), state[1].copy(), state[2:].copy()
        step(stages.numbers, (squares / dt**2,), u, v, kept, dt)
        out[:, :, k] = (np.stack([u, v, *kept]) / scale[:, None]).T
    return out


def reach(integrator: Integrator, stages: Stages | None, dt: float) -> float:
    """Return the largest omega dt up to which a scheme is stable, over 2: that of central difference."""
    if stages is None:
        return 1.0
    try:
        return _reach(integrator, stages, dt)
    except TypeError:  # options that have no hash
        return _reach.__wrapped__(integrator, stages, dt)


@functools.lru_cache(maxsize=1024)
def _reach(integrator: Integrator, stages: Stages, dt: float) -> float:

    def radius(squares: Floats) -> Floats:
        with np.errstate(all="ignore"):
            matrices = amplification(integrator, stages, dt, squares)
            matrices = np.where(np.isfinite(matrices), matrices, 1e3)
            found: Floats = np.abs(np.linalg.eigvals(matrices)).max(axis=1)
            return found

    grid = np.geomspace(1e-3, 1e3, OSCILLATORS)
    grows = np.flatnonzero(radius(grid) > 1.0 + GROWS)
    if grows.size == 0:
        return 0.5 * float(np.sqrt(grid[-1]))
    if grows[0] == 0:
        return 0.0
    lo, hi = grid[grows[0] - 1], grid[grows[0]]
    while hi - lo > 1e-13 * hi:
        middle = 0.5 * (lo + hi)
        if middle in (lo, hi):
            break
        if radius(np.array([middle]))[0] > 1.0 + GROWS:
            hi = middle
        else:
            lo = middle
    return 0.5 * float(np.sqrt(lo))
