"""The contact problem that a model discretises, as exact solutions receive it."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from percuss.contact.prisms import prism_problem
from percuss.methods.interfaces import BodyEnd, ContactProblem, ProblemBody, ProblemContact, ProblemLoad
from percuss.methods.plugin_calls import read_only

if TYPE_CHECKING:
    from percuss.case.specs import LoadSpec
    from percuss.contact.model import Model
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats


def contact_problem(model: Model) -> ContactProblem | str:
    """Return the mechanical problem of a case, without its mesh, its step and its methods; or why it is none of bars.

    Bodies that are no bars are in it where they are prisms that move along their axis.
    """
    if not model.bodies.of_lines:
        return prism_problem(model)
    bodies, points = list(model.bodies.values()), model.contact_points
    loads = []
    for nodal_force in model.loads.on_nodes:
        vector = nodal_force.force
        if nodal_force.load.acts_as == "acceleration":  # the force contains the mass of the node, a part of the mesh
            vector = vector / model.bodies.mass[nodal_force.node]
        loads.append(_load(nodal_force.load, vector, _end_of(model, nodal_force.node)))
    loads += [
        _load(constraint.load, constraint.direction, _end_of(model, constraint.node))
        for constraint in model.loads.constraints
        if constraint.load is not None
    ]
    loads += [
        _load(body_force.load, body_force.acceleration, bodies[body_force.body].name)
        for body_force in model.loads.body_forces
    ]
    fixed = [_end_of(model, constraint.node) for constraint in model.loads.constraints if constraint.load is None]
    order = {name: number for number, name in enumerate(model.case.loads)}
    return ContactProblem(
        bodies=MappingProxyType({body.name: _body(body) for body in bodies}),
        contacts=tuple(
            ProblemContact(
                name,
                tuple(_end_of(model, node) for node in points.nodes_of(p)),
                read_only(points.normal[p]),
                float(points.gap[p]),
            )
            for p, name in enumerate(points.names)
        ),
        fixed=tuple(dict.fromkeys(fixed)),
        loads=tuple(sorted(loads, key=lambda load: order[load.name])),
    )


def _body(body: Body) -> ProblemBody:
    return ProblemBody(
        name=body.name,
        shape=body.spec.shape,
        material=body.spec.material,
        area=body.spec.section,
        length=float(body.mesh.lengths.sum()),
        direction=read_only(body.mesh.direction),
        velocity=read_only(body.velocity),
    )


def _load(spec: LoadSpec, vector: Floats, place: BodyEnd | str) -> ProblemLoad:
    end = place if isinstance(place, BodyEnd) else None
    quantity: Any = spec.acts_as if end is not None else "acceleration"
    return ProblemLoad(
        name=spec.name,
        load=spec.load,
        body=place if isinstance(place, str) else place.body,
        end=end,
        acts_as="force" if quantity in {"pressure", "traction"} else quantity,  # whose vector has the area in it
        vector=read_only(vector),
        start=spec.start,
        stop=spec.stop,
    )


def _end_of(model: Model, node: int) -> BodyEnd:
    body = model.bodies.at(node)
    return BodyEnd(body.name, node == body.start)
