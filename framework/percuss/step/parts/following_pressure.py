"""Pressure that follows: the forces of a pressure on the facets of a region as they are before each step.

The force of a facet is the integral of minus the pressure times its normal, so of a closed surface all forces together
vanish, wherever it is. The pressure is a force per present area.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from percuss.errors import Problem
from percuss.record_arrays import Records
from percuss.step.actions import AFTER_STEP, BULK, Action
from percuss.step.part import Part, Setting
from percuss.step.records import Loads

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Array, Floats, Integers

GAUSS = 0.5773502691896258  # of two points, 1 over the root of 3


class Pressed(NamedTuple):
    """The regions on which pressures follow."""

    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    loads: Loads
    now: Records  # percuss.step.records.NOW
    start: Floats  # (nodes, dim) places at t = 0 of the nodes of these regions
    place: Integers  # (nodes,) first boundary degree of freedom
    axis: Integers  # (nodes,) of the force in `Loads.axes`
    column: Integers  # (nodes,) of its amplitude
    facets: Integers  # (F, k) nodes
    width: Integers  # (F,) number of its nodes
    section: Floats  # (F,) thickness; 0 of a ring about the axis x = 0
    impulse: Floats  # (dim,) of these forces so far


class FollowingPressure(Part[Pressed]):
    """The part of a step with pressures that follow."""

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None without such a pressure."""
        model, step = setting.model, setting.step
        forces = [(i, one) for i, one in enumerate(model.loads.nodal_forces) if one.load.follows]
        if not forces:
            return None
        dim, records = model.dim, step.loads.nodal_forces
        nodes = {(one.load.name, one.node): k for k, (_, one) in enumerate(forces)}
        facets, sections = [], []
        for spec in {one.load.name: one.load for _, one in forces}.values():
            for address in spec.on:
                body = model.bodies[address.body]
                surface = body.surface(address.region).surface
                own = [nodes[spec.name, node] for node in surface.nodes.tolist()]
                facets += np.array(own, dtype=np.int64)[surface.facets].tolist()
                ring = body.view.plane == "axisymmetric"
                sections += [0.0 if ring else body.spec.section] * len(surface.facets)
        width = np.array([len(one) for one in facets], dtype=np.int64)
        whole = np.zeros((len(facets), int(width.max())), dtype=np.int64)
        for row, facet in zip(whole, facets, strict=True):
            row[: len(facet)] = facet
        numbers = [one.node for _, one in forces]
        data = Pressed(
            boundary=step.boundary, loads=step.loads, now=step.now, start=model.bodies.nodes[numbers],
            place=np.array([setting.place[node] for node in numbers], dtype=np.int64),
            axis=np.array([records[i].axis for i, _ in forces], dtype=np.int64),
            column=np.array([one.column for _, one in forces], dtype=np.int64),
            facets=whole, width=width, section=np.array(sections),
            impulse=np.zeros(dim) if before is None else before.data.impulse,
        )  # fmt: skip
        return cls(data)

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        yield Action(BULK, follow, self.data, order=-1)
        yield Action(AFTER_STEP, add_impulse, self.data)

    def changing_arrays(self) -> list[Array]:
        """Return the impulse."""
        return [self.data.impulse]

    def impulse(self) -> Floats:
        """Return the impulse of these pressures so far, (dim,)."""
        return self.data.impulse


# ------------------------------------------------------------------------------------------------------------- kernels


def follow(data: Pressed, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set the forces at amplitude 1 to those on the facets where they are."""
    axes, dim = data.loads.axes, data.start.shape[1]
    for k in range(data.axis.size):
        for d in range(dim):
            axes[data.axis[k] + d] = 0.0
    for f in range(data.width.size):
        if dim == 2:
            press_edge(data, f, u)
        else:
            press_face(data, f, u)


def at(data: Pressed, k: int, d: int, u: Floats) -> float:
    """Return a coordinate of the place of a node."""
    return data.start[k, d] + u[data.boundary[data.place[k] + d].dof]  # type: ignore[no-any-return]


def press_edge(data: Pressed, f: int, u: Floats) -> None:
    """Add the force on an edge to its nodes: half each, of a ring by the radius."""
    i, j = data.facets[f, 0], data.facets[f, 1]
    across, along = at(data, j, 1, u) - at(data, i, 1, u), at(data, j, 0, u) - at(data, i, 0, u)
    one = other = 0.5 * data.section[f]
    if data.section[f] == 0.0:
        first, last = at(data, i, 0, u), at(data, j, 0, u)
        one, other = np.pi / 3.0 * (2.0 * first + last), np.pi / 3.0 * (first + 2.0 * last)
    axes = data.loads.axes
    axes[data.axis[i]] -= one * across
    axes[data.axis[i] + 1] += one * along
    axes[data.axis[j]] -= other * across
    axes[data.axis[j] + 1] += other * along


def press_face(data: Pressed, f: int, u: Floats) -> None:
    """Add the force on a triangle or a quadrilateral to its nodes."""
    width = data.width[f]
    if width == 3:
        for d in range(3):
            p, q = (d + 1) % 3, (d + 2) % 3
            force = cross_of(data, f, 0, 1, 2, p, q, u) / 6.0
            for k in range(3):
                data.loads.axes[data.axis[data.facets[f, k]] + d] -= force
        return
    for g in range(4):
        x, y = GAUSS * (1.0 if g % 2 == 1 else -1.0), GAUSS * (1.0 if g > 1 else -1.0)
        for d in range(3):
            p, q = (d + 1) % 3, (d + 2) % 3
            a_p, a_q, b_p, b_q = 0.0, 0.0, 0.0, 0.0
            for k in range(4):
                s, t = 1.0 if k in (1, 2) else -1.0, 1.0 if k > 1 else -1.0
                by_x, by_y, node = 0.25 * s * (1.0 + t * y), 0.25 * t * (1.0 + s * x), data.facets[f, k]
                a_p += by_x * at(data, node, p, u)
                a_q += by_x * at(data, node, q, u)
                b_p += by_y * at(data, node, p, u)
                b_q += by_y * at(data, node, q, u)
            for k in range(4):
                s, t = 1.0 if k in (1, 2) else -1.0, 1.0 if k > 1 else -1.0
                share = 0.25 * (1.0 + s * x) * (1.0 + t * y)
                data.loads.axes[data.axis[data.facets[f, k]] + d] -= share * (a_p * b_q - a_q * b_p)


def cross_of(data: Pressed, f: int, a: int, b: int, c: int, p: int, q: int, u: Floats) -> float:
    """Return a component of the cross product of two edges of a facet."""
    i, j, k = data.facets[f, a], data.facets[f, b], data.facets[f, c]
    one_p, one_q = at(data, j, p, u) - at(data, i, p, u), at(data, j, q, u) - at(data, i, q, u)
    two_p, two_q = at(data, k, p, u) - at(data, i, p, u), at(data, k, q, u) - at(data, i, q, u)
    return one_p * two_q - one_q * two_p


def add_impulse(data: Pressed, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add the impulse of the step."""
    dt, loads = data.now[0].dt, data.loads
    for k in range(data.axis.size):
        for d in range(data.impulse.size):
            data.impulse[d] += dt * loads.amplitudes[data.column[k]] * loads.axes[data.axis[k] + d]


def refusals(model: Model) -> Iterator[Problem]:
    """Yield what does not go with a pressure that follows."""
    for name, spec in model.case.loads.items():
        bodies = [model.bodies[address.body] for address in spec.on] if spec.follows else []
        linear = list(dict.fromkeys(body.name for body in bodies if body.is_bar or body.of_small_strains))
        found = (
            (spec.follows and spec.acts_as != "pressure", f"`as: pressure`, found {spec.acts_as}", "Drop `follows`."),
            (bool(linear), f"bodies of finite strain, found '{', '.join(linear)}'", "Drop `follows`."),
            (
                bool(bodies) and model.multistage,
                f"a leap-frog scheme, found {model.case.method.integrator.name}",
                "Take central-difference.",
            ),
        )
        yield from model.case.first_problem(("loads", name, "follows"), found)
