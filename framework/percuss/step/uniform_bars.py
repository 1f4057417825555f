"""The bars of equal elements of a model, which the time loop advances itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.record_arrays import record_array
from percuss.methods.blame import is_third_party
from percuss.step.uniform_rows import UNIFORM_BAR

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.contact.model_arrays import ModelArrays
    from percuss.mesh.body import Body


def uniform_bars(model: ModelArrays, boundary_nodes: Sequence[int]) -> Any:
    """Return the bodies of a model as records `UNIFORM_BAR`; none if there is a body of another kind.

    Parameters
    ----------
    model
        The model of the run.
    boundary_nodes
        The nodes at which contacts, loads, supports or probes act.
    """
    bodies = list(model.bodies.values())
    ends = {node for body in bodies for node in (body.start, body.stop - 1)}
    bars = []
    if (
        model.dim == 1
        and not model.multistage
        and not model.viscosity
        and not model.own_steps
        and not model.implicit
        and not model.body_forces
        and not model.shifts
        and ends.issuperset(boundary_nodes)
        and all(map(_is_uniform, bodies))
    ):
        for body in bodies:
            mass, inner = body.mass, body.mass[body.mass.size // 2]
            rate = model.dt * body.stiffness[0] / inner
            shares = inner / mass[0] - 1.0, inner / mass[-1] - 1.0
            bars.append((body.start, body.stop, rate, *shares, inner, mass[0], mass[-1], body.stiffness[0]))
    return record_array(bars, UNIFORM_BAR)


def _is_uniform(body: Body) -> bool:
    """Return whether a body is linear, with two-node elements of one stiffness and inner nodes of one mass.

    The kernels of a third-party plug-in are called in every step, whatever they declare: the run shows what they
    compute.
    """
    if body.mesh.cells:
        return False
    stiffness, inner_mass = body.stiffness, body.mass[1:-1]
    return not (
        body.why_not_linear
        or body.ends_without_mass
        or body.inverse.size
        or any(is_third_party(type(part).__module__) for part in (body.spec.element, body.spec.material))
        or np.any(stiffness != stiffness[0])
        or np.any(inner_mass != inner_mass[:1])
    )
