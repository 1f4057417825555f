"""The bars of equal elements of a model, which the time loop advances itself."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.methods.blame import is_third_party
from percuss.methods.interfaces import BodyMesh, Mesh
from percuss.solver.bodies import ElementProbe
from percuss.solver.compiled.uniform_bars import UNIFORM_BAR
from percuss.solver.record_arrays import record_array

if TYPE_CHECKING:
    from collections.abc import Sequence

    from percuss.methods.interfaces import Element, Material
    from percuss.solver.entities import Body
    from percuss.solver.model import Model

SAME_FORCE = 1e-12  # largest relative difference between the force of an element and that of a spring


def uniform_bars(model: Model, boundary_nodes: Sequence[int]) -> Any:
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
    kinds = {(type(body.spec.element), type(body.spec.material)): body for body in bodies}
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
        and all(map(_acts_as_spring, kinds.values()))
    ):
        for body in bodies:
            mass, inner = body.mass, body.mass[body.mass.size // 2]
            rate = model.dt * body.stiffness[0] / inner
            shares = inner / mass[0] - 1.0, inner / mass[-1] - 1.0
            bars.append((body.start, body.stop, rate, *shares, inner, mass[0], mass[-1], body.stiffness[0]))
    return record_array(bars, UNIFORM_BAR)


def _is_uniform(body: Body) -> bool:
    """Return whether a body is linear, with two-node elements of one stiffness and inner nodes of one mass."""
    if body.mesh.cells:
        return False
    stiffness, inner_mass = body.stiffness, body.mass[1:-1]
    return not (
        body.why_not_linear
        or body.ends_without_mass
        or body.inverse.size
        or np.any(stiffness != stiffness[0])
        or np.any(inner_mass != inner_mass[:1])
    )


def _acts_as_spring(body: Body) -> bool:
    """Return whether the elements of a body act as springs of the declared stiffness.

    The kernels of a third-party plug-in are called in every step, whatever they declare: the run shows what they
    compute.
    """
    spec, length = body.spec, float(body.mesh.lengths[0])
    if is_third_party(type(spec.element).__module__) or is_third_party(type(spec.material).__module__):
        return False
    return _is_spring(spec.element, spec.material, spec.area, length, float(body.stiffness[0]))


@functools.lru_cache(maxsize=256)
def _is_spring(element: Element, material: Material, area: float, length: float, stiffness: float) -> bool:
    mesh = Mesh(np.array([[0.0], [length]]), np.array([length]), np.ones(1), {})
    probe = ElementProbe(element, material, BodyMesh(mesh, area))
    forces = np.array([probe.force(0, displacement) for displacement in length * np.eye(2)])
    expected = stiffness * length * np.array([[-1.0, 1.0], [1.0, -1.0]])
    return bool(np.all(np.abs(forces - expected) <= SAME_FORCE * np.abs(expected)))
