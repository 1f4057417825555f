"""The contact problem that a model discretises, as exact solutions receive it."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.prisms import ROUND_OFF, NotARowOfPrisms, check_faces, prisms_of
from percuss.methods.interfaces import BodyEnd, ContactProblem, ProblemBody, ProblemContact, ProblemLoad
from percuss.methods.plugin_calls import read_only

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from percuss.case.specs import LoadSpec
    from percuss.contact.model import Model
    from percuss.contact.prisms import Prism
    from percuss.methods.interfaces import Floats


def contact_problem(model: Model) -> ContactProblem | str:
    """Return the mechanical problem of a case, without its mesh, its step and its methods; or why it is none of bars.

    Solids are in it where they are prisms that move along their axis.
    """
    try:
        prisms = prisms_of(model)
        problem = ContactProblem(
            bodies=MappingProxyType({name: _body(prism) for name, prism in prisms.items()}),
            contacts=tuple(_contacts(model, prisms)),
            fixed=tuple(_fixed(prisms)),
            loads=tuple(_loads(model, prisms)),
        )
        for probe in model.case.recorded_ends:
            if region := getattr(probe, "region", ""):
                prisms[probe.body].check_recorded(region)
    except NotARowOfPrisms as reason:
        return str(reason)
    return problem


def _body(prism: Prism) -> ProblemBody:
    body = prism.body
    return ProblemBody(
        name=body.name,
        shape=body.spec.shape,
        material=body.spec.material,
        area=prism.area,
        length=prism.length,
        direction=read_only(prism.axis),
        velocity=read_only(body.velocity),
        modulus=prism.modulus,
    )


def _contacts(model: Model, prisms: Mapping[str, Prism]) -> Iterator[ProblemContact]:
    """Yield the contacts of ends, or of faces that cover each other, and those with walls across the axis."""
    points = model.contact_points
    for number, (name, spec) in enumerate(model.case.contacts.items()):
        sides = tuple((prisms[side.body], side.region) for side in spec.sides)
        ends = tuple(BodyEnd(prism.body.name, prism.at_start(region, "in contact")) for prism, region in sides)
        gaps, (front, _) = points.gap[points.contact == number], sides[0]
        if np.ptp(gaps) > ROUND_OFF * min(prism.length for prism, _ in sides):
            raise NotARowOfPrisms(f"the gap of contact '{name}' differs from place to place")
        if not front.body.is_bar:
            check_faces(name, sides)
        normal = -front.axis if ends[0].at_start else front.axis
        yield ProblemContact(name, ends, read_only(normal), float(gaps[0]))


def _fixed(prisms: Mapping[str, Prism]) -> Iterator[BodyEnd]:
    """Yield the ends that are held along the axis."""
    for name, prism in prisms.items():
        for region, along in prism.body.spec.supports:
            part = 1.0 if along is None else abs(prism.axis[along])
            if part > ROUND_OFF:
                end = BodyEnd(name, prism.at_start(region, "held along the axis"))
                if part < 1.0 - ROUND_OFF:
                    raise NotARowOfPrisms(f"'{name}.{region}' is held in a direction oblique to the axis")
                yield end


def _loads(model: Model, prisms: Mapping[str, Prism]) -> Iterator[ProblemLoad]:
    """Yield the loads on ends and on whole bodies, in the order of the case."""
    bodies = list(prisms.values())
    for spec in model.case.loads.values():
        forces = [one for one in model.loads.on_nodes if one.load is spec]
        drives = [one.direction for one in model.loads.constraints if one.load is spec]
        # A pressure or a traction is the force of its area.
        quantity = spec.acts_as if spec.acts_as in {"velocity", "acceleration"} else "force"
        at_ends = ((prisms[address.body], address.region) for address in spec.on if address.region)
        ends = {(prism.body.name, prism.at_start(region, "loaded")): (prism, region) for prism, region in at_ends}
        for end, (prism, region) in ends.items():
            nodes = [node for node, _ in prism.body.places(region)]
            vector = np.sum([one.force for one in forces if one.node in nodes], axis=0) if forces else drives[0]
            if quantity == "acceleration":  # the forces contain the masses of the nodes, a part of the mesh
                vector = vector / model.bodies.mass[nodes].sum()
            yield _load(spec, prism, BodyEnd(*end), quantity, vector)
        for force in model.loads.body_forces:
            if force.load is spec:
                yield _load(spec, bodies[force.body], None, "acceleration", force.acceleration)


def _load(spec: LoadSpec, prism: Prism, end: BodyEnd | None, quantity: Any, vector: Floats) -> ProblemLoad:
    along = read_only(prism.along(vector, spec.name))
    return ProblemLoad(spec.name, spec.load, prism.body.name, end, quantity, along, spec.start, spec.stop)
