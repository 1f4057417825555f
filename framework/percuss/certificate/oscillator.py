"""The stability limit of a scheme; of a multi-stage scheme from its amplification of single oscillators."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.methods.interfaces import Integrator, Stages
from percuss.step.integrator_check import plain_step

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats

# Growth in a step up to which it counts as round-off.
GROWTH_TOLERANCE = 1e-9
OSCILLATORS = 1001


def oscillating(system: Any, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to the accelerations of oscillators, whose squared frequencies are in `system`."""
    a[:] = -system[0] * u


def oscillating_internally(system: Any, stage: int, u: Floats, f: Floats) -> None:
    """Set `f` to the internal forces of oscillators over their masses."""
    f[:] = system[0] * u


def amplification(integrator: Integrator, stages: Stages, dt: float, squares: Floats) -> Any:
    """Return the amplification matrices of single oscillators for the states (u, dt v, dt^2 kept), (Z, m, m).

    Parameters
    ----------
    integrator, stages, dt
        The scheme and its step.
    squares : (Z,) array
        ``(omega dt)^2`` of each oscillator.
    """
    step = plain_step(integrator, oscillating, oscillating_internally)
    size = 2 + integrator.kept
    out = np.zeros((squares.size, size, size))
    scale = dt ** -np.concatenate([[0.0, 1.0], np.full(integrator.kept, 2.0)])
    for k in range(size):
        state = np.zeros((size, squares.size))
        state[k] = scale[k]
        step(stages.numbers, (squares / dt**2,), state[0], state[1], state[2:], dt)
        out[:, :, k] = (state / scale[:, None]).T
    return out


def limit_ratio(model: Model) -> float:
    """Return the largest stable omega dt of the scheme of a model over that of central difference, which is 2."""
    integrator, stages = model.case.method.integrator, model.stages
    if stages is None:
        return model.facts.limit_ratio
    return _limit_ratio(integrator, stages, model.dt)


@functools.lru_cache(maxsize=1024)
def _limit_ratio(integrator: Integrator, stages: Stages, dt: float) -> float:
    def radius(squares: Floats) -> Floats:
        with np.errstate(all="ignore"):
            matrices = amplification(integrator, stages, dt, squares)
            matrices = np.where(np.isfinite(matrices), matrices, 1e3)
            radii: Floats = np.abs(np.linalg.eigvals(matrices)).max(axis=1)
            return radii

    grid = np.geomspace(1e-3, 1e3, OSCILLATORS)
    unstable = np.flatnonzero(radius(grid) > 1.0 + GROWTH_TOLERANCE)
    if unstable.size == 0:
        return 0.5 * float(np.sqrt(grid[-1]))
    if unstable[0] == 0:
        return 0.0
    lo, hi = grid[unstable[0] - 1], grid[unstable[0]]
    while hi - lo > 1e-13 * hi:
        middle = 0.5 * (lo + hi)
        lo, hi = (lo, middle) if radius(np.array([middle]))[0] > 1.0 + GROWTH_TOLERANCE else (middle, hi)
    return 0.5 * float(np.sqrt(lo))
