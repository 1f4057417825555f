"""The contact laws of a model: what they receive of their points over the whole run, and the laws bound to these."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.options import PER_AREA, options_of
from percuss.contact.bound_law import BoundLaw, bind_law
from percuss.errors import Problem, refuse_if_any
from percuss.methods.blame import said_by
from percuss.methods.interfaces import ContactLaw, ContactPoints
from percuss.methods.plugin_calls import read_only

if TYPE_CHECKING:
    from percuss.contact.model import Model


def points_of_law(model: Model, where: Sequence[int], dt: float) -> ContactPoints:
    """Return the properties of the contact points `where` that a law receives for a time step `dt`."""
    points, at = model.contact_points, list(where)
    delassus, sums = model.largest_delassus

    def column(values: Any) -> Any:
        return read_only(values[at])

    return ContactPoints(
        names=tuple(points.names[p] for p in at),
        stiffness=column(points.stiffness),
        frequency=column(points.frequency),
        mass=column(points.mass),
        equal_sides=column(points.equal_sides),
        delassus=column(delassus),
        coupling=column(sums / delassus),
        weight=column(points.weight),
        limits=lambda: column(model.stiffness_limits(dt)),
    )


def bind_laws(model: Model, dt: float) -> tuple[BoundLaw, ...]:
    """Return the laws of a run bound for a time step: linear laws before laws with a kernel, in the order of points.

    Raises
    ------
    InputError
        If the options of a law do not fit, or a kernel that solves coupled contacts together has only some of them.
    """
    groups: dict[ContactLaw, list[int]] = {}
    for p, law in enumerate(model.contact_points.laws):
        groups.setdefault(law, []).append(p)
    problems: list[Problem] = []
    laws = []
    for law, where in groups.items():
        try:
            laws.append(bind_law(law, tuple(where), points_of_law(model, where, dt), dt))
        except ValueError as error:
            problems.append(model.case.problem(("method", "contact"), said_by(error)))
    refuse_if_any(problems)
    coupled = [bound_law for bound_law in laws if bound_law.linear is None and bound_law.law.uses_coupling]
    refuse_if_any([problem for bound_law in coupled for problem in _shared_with_others(model, bound_law)])
    return tuple(sorted(laws, key=lambda bound_law: (bound_law.linear is None, bound_law.where)))


def laws_at(model: Model, dt: float) -> tuple[BoundLaw, ...]:
    """Return the laws of the whole run bound for a time step, in the order of `Model.laws`."""
    return model.whole.laws if dt == model.whole.dt else bind_laws(model.whole, dt)


def _shared_with_others(model: Model, bound_law: BoundLaw) -> Iterator[Problem]:
    """Yield each contact that shares an end with one of a law, whose kernel solves them together, and has another.

    The kernel would not know its force.
    """
    points, name, where = model.contact_points, bound_law.law.name, set(bound_law.where)
    shared = {q: p for p, q in coupled_points(model) if p in where and q not in where}
    for q, p in sorted(shared.items()):
        found = points.laws[q].name if points.laws[q].name != name else "other options"
        message = (
            f"expected {name} with the options of contact '{points.names[p]}', as both act on one end and the kernel "
            f"of {name} solves all contacts there together; found {found}"
        )
        advice = "Give both the same law and options, or take laws without such a kernel."
        yield model.case.problem(("contacts", points.names[q]), message, advice, any_inside=True)


def coupled_points(model: Model) -> list[tuple[int, int]]:
    """Return the pairs of contact points that are coupled at some time of the run, each both ways, in order."""
    pairs: set[tuple[int, int]] = set()
    for rows in model.rows.values():
        one = np.repeat(np.arange(rows.delassus.size), np.diff(rows.other_start))
        pairs.update(zip(one.tolist(), rows.other.tolist(), strict=True))
    return sorted(pairs)


# ------------------------------------------------------------------------------------------------ what is told of laws


def parameters(model: Model) -> dict[str, dict[str, float]]:
    """Return, for each contact, the name of its law and its resolved parameters, those of its first point.

    Where an option of a law is per area, as in a case with bodies that are no bars, so is its parameter. What the law
    calls a total is summed over the points.
    """
    points = model.contact_points
    found: dict[str, dict[str, Any]] = {
        name: {"law": law.name} for name, law in zip(points.names, points.laws, strict=True)
    }
    for bound_law in model.laws:
        where, options = bound_law.where, options_of(type(bound_law.law))
        for name, value in bound_law.resolved.items():
            per_area = name in options and options[name].unit in PER_AREA
            for point, number in zip(where, np.broadcast_to(value, (len(where),)), strict=True):
                area = float(points.weight[point]) if per_area else 1.0
                of_contact = found[points.names[point]]
                if name in bound_law.law.totals:
                    of_contact[name] = of_contact.get(name, 0.0) + float(number)
                of_contact.setdefault(name, float(number) / area)
    return found


def ignored_couplings(model: Model) -> list[str]:
    """Return one sentence for contacts at each end, or coupled by the mass, if the kernel of a law ignores that."""
    ignoring = [one for one in model.laws if one.linear is None and not one.law.uses_coupling]
    if not ignoring:
        return []
    points = model.contact_points
    at_node: dict[int, dict[int, None]] = {}
    for node, p in zip(points.node.tolist(), points.point.tolist(), strict=True):
        at_node.setdefault(node, {})[p] = None  # once, also where it has room for more nodes
    coupled = {tuple(near): "share an end" for near in at_node.values() if len(near) > 1}
    apart = (
        (p, q) for p, q in coupled_points(model) if p < q and set(points.nodes_of(p)).isdisjoint(points.nodes_of(q))
    )
    coupled |= dict.fromkeys(apart, "are coupled by the mass of a body")
    sentences = []
    for bound_law in ignoring:
        for near, how in coupled.items():
            if set(bound_law.where).isdisjoint(near):
                continue
            named = list(dict.fromkeys(f"'{points.names[p]}'" for p in near))
            where = "at that end " if how == "share an end" else ""
            which, each = f"contacts {', '.join(named)} {how}", "contacts"
            if len(named) == 1:
                which, each = f"points of the contact {named[0]} share nodes", "points"
            sentences.append(
                f"{which}, and the kernel of law {bound_law.law.name} sees each of its {each} by itself: it "
                f"ignores what the others {where}press in the same step (it does not declare `uses_coupling`)"
            )
    return list(dict.fromkeys(sentences))
