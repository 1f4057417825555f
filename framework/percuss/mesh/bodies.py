"""All bodies of a model together: their nodes, numbered one body after the other, and their masses."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import InputError, Problem, refuse_if_any
from percuss.mesh import size_limits
from percuss.mesh.body import Body
from percuss.mesh.cell_stiffness import frequencies_of_cells
from percuss.mesh.cells import volumes_of
from percuss.mesh.masses import ends_at_contacts, masses_of
from percuss.mesh.stiffness_rows import Assembly
from percuss.methods.interfaces import BodyMesh
from percuss.methods.plugin_calls import answer, read_only

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.methods.interfaces import Floats, Mesh


# The components of a position and of a force whose product less the reverse is a moment, by the dimension of space.
TURNS: dict[int, tuple[list[int], list[int]]] = {1: ([], []), 2: ([0], [1]), 3: ([1, 2, 0], [2, 0, 1])}


class Bodies(dict[str, Body]):
    """The bodies of a model by name, in the order of the case.

    Attributes
    ----------
    mass, nodes
        Masses and positions of all nodes, (nodes,) and (nodes, dim).
    n_nodes, dim
        Number of nodes and of space dimensions.
    omega
        Largest frequency of an element [1/time].
    couples_nodes
        Whether the mass of a body couples its nodes, so that M^-1 is sparse and M is full.
    why_not_linear
        The reason why internal forces are not proportional to displacements; empty where all bodies are linear.
    """

    def __init__(self, bodies: list[Body]) -> None:
        super().__init__((body.name, body) for body in bodies)
        self._in_order = bodies
        self._starts = [body.start for body in bodies]
        self.mass: Floats = read_only(np.concatenate([body.mass for body in bodies]))
        self.nodes: Floats = read_only(np.concatenate([body.mesh.nodes for body in bodies]))
        self.n_nodes, self.dim = self.nodes.shape
        self.omega = max(float(body.frequency.max()) for body in bodies)
        self.couples_nodes = any(body.inverse is not None for body in bodies)
        self.why_not_linear = "; ".join(filter(None, (body.why_not_linear for body in bodies)))

    @cached_property
    def mass_of_dofs(self) -> Floats:
        """Nodal mass of each degree of freedom, (nodes * dim,)."""
        return np.repeat(self.mass, self.dim)

    @cached_property
    def inverse_mass_of_dofs(self) -> Floats:
        """The inverse of that mass, 0 at an end without mass, (nodes * dim,)."""
        mass = self.mass_of_dofs
        return np.divide(1.0, mass, out=np.zeros_like(mass), where=mass > 0.0)

    @cached_property
    def centre(self) -> Floats:
        """The centre of mass of all bodies at the start, (dim,)."""
        centre: Floats = self.mass @ self.nodes / self.mass.sum()
        return centre

    def with_moment(self, place: Floats, force: Floats) -> Floats:
        """Return forces and their moments about the centre of mass at the start.

        Parameters
        ----------
        place, force : (..., dim) arrays
            Places at the start, and the forces, impulses or momenta there.

        Returns
        -------
        (..., dim + 0, 1 or 3) array
            In one dimension there is no moment, in two there is one.
        """
        arm, (first, second) = place - self.centre, TURNS[self.dim]
        moment = arm[..., first] * force[..., second] - arm[..., second] * force[..., first]
        return np.concatenate([force, moment], axis=-1)

    def no_impulse(self) -> Floats:
        """Return an impulse of zero, with its moment."""
        return self.with_moment(self.centre, np.zeros(self.dim))

    @cached_property
    def about_axis(self) -> bool:
        """Whether all bodies are bodies of revolution."""
        return all(body.spec.plane == "axisymmetric" for body in self.values())

    @cached_property
    def of_lines(self) -> bool:
        """Whether all bodies are along lines."""
        return all(body.is_bar for body in self.values())

    def stiffness_times(self, motion: Floats, out: Floats | None = None) -> Floats:
        """Return the forces that hold a motion about rest, K u, (nodes * dim,), in `out` where that is given."""
        forces = np.empty(motion.size) if out is None else out
        for body in self.values():
            place = slice(body.start * self.dim, body.stop * self.dim)
            body.hold(motion[place], forces[place])
        return forces

    def at(self, node: int) -> Body:
        """Return the body that contains a node."""
        return self._in_order[bisect.bisect_right(self._starts, node) - 1]

    def mobility(self, node: int) -> float:
        """Return the acceleration of a node by a unit force on it, 1/m where the mass is diagonal [1/mass]."""
        return self.at(node).response(node)[node]

    def mass_held(self, node: int) -> float:
        """Return the mass that a reaction accelerates along with a node: its own where the mass is diagonal."""
        return 1.0 / self.mobility(node) if self.couples_nodes else float(self.mass[node])

    def change_of_velocity(self, impulse: Floats, node: int) -> Floats:
        """Return the change of the velocity of a node by an impulse on it, (dim,)."""
        return impulse * self.mobility(node) if self.couples_nodes else impulse / self.mass[node]


def bodies_of(case: Case) -> Bodies:
    """Return the bodies of a case.

    Raises
    ------
    InputError
        If a body is too large, or its numbers are beyond the limits.
    """
    bodies: list[Body] = []
    in_contact = ends_at_contacts(case)
    for number, (name, spec) in enumerate(case.bodies.items()):
        mesh = size_limits.mesh_of_body(case, spec)
        view = BodyMesh(mesh, spec.section, spec.plane_of(mesh.nodes.shape[1]))
        if view.plane == "axisymmetric" and mesh.nodes[:, 0].min() < 0.0:
            message = f"expected a body at x of 0 or more, as it turns about x = 0, found {mesh.nodes[:, 0].min():.6g}"
            raise InputError([case.problem(("bodies", name, "plane"), message, "Move it to one side of the axis.")])
        velocity = np.asarray(spec.velocity, dtype=float)
        if velocity.ndim == 0:  # along the body; a body along no line has none by default
            velocity = velocity * (mesh.direction if mesh.line is not None else np.zeros(mesh.nodes.shape[1]))
        masses = masses_of(case, spec, view, in_contact.get(name, ()))
        assembly = None
        if mesh.line is None:
            if spec.element.linear and spec.material.linear and spec.material.state == 0:
                assembly = Assembly(view)
            stiffness, frequency = np.zeros(0), frequencies_of_cells(spec.element, spec.material, view, assembly)
        else:
            speed = math.sqrt(spec.material.modulus / spec.material.rho)
            stiffness = answer(spec.element, "axial_stiffness", view, spec.material.modulus)
            frequency = answer(spec.element, "highest_frequency", view, speed)
        body = Body(
            name=name,
            number=number,
            spec=spec,
            view=view,
            start=bodies[-1].stop if bodies else 0,
            mass=masses.nodal,
            frequency=frequency,
            stiffness=stiffness,
            volumes=volumes_of(spec.element, view),
            velocity=velocity,
            may_lack_mass=masses.may_be_zero,
            inverse=masses.inverse,
            rows=assembly.rows if assembly else None,
        )
        bodies.append(body)
    size_limits.check_bodies(case, bodies)
    refuse_if_any(list(_empty_regions(case, {body.name: body.mesh for body in bodies})))
    return Bodies(bodies)


def _empty_regions(case: Case, meshes: Mapping[str, Mesh]) -> Iterator[Problem]:
    """Yield the regions without a node that a case uses."""
    used: list[tuple[Any, str, str]] = []
    used += [(("bodies", name, "fixed"), name, one) for name, body in case.bodies.items() for one, _ in body.supports]
    used += [(("contacts", name), one.body, one.region) for name, spec in case.contacts.items() for one in spec.sides]
    used += [(("loads", name, "on"), one.body, one.region) for name, load in case.loads.items() for one in load.on]
    used += [(("record", "probes"), one.body, one.region) for one in case.record.probes or ()]
    for path, owner, region in used:
        if region and not meshes[owner].regions[region].nodes:
            message = f"expected a region with nodes, found none in {owner}.{region}"
            yield case.problem(path, message, f"The {case.bodies[owner].shape.name} of this body does not have it.")
