"""Ends that meet although no contact is declared between them, and ends in contact that have slid off each other.

A contact of two ends knows their distance along its normal alone, and bodies without a contact do not know each other:
in both cases a run goes on with forces that no body would feel.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from percuss.contact.model import Model
from percuss.contact.points import TOUCHING
from percuss.jsonable import Entries
from percuss.march.march import March, Outcome
from percuss.march.recording import probe_nodes
from percuss.mesh.body import Body
from percuss.methods.interfaces import Floats
from percuss.results.encounters_of_solids import foreseen_of_solids, notes_of_solids

NOT_DECLARED = "no contact is declared between them"


class End(NamedTuple):
    """An end of a body: its address in a case, its node in the model, its normal out of the body and its position."""

    name: str
    body: Body
    node: int
    outward: Floats
    position: Floats


def _ends(model: Model) -> Iterator[End]:
    """Yield the ends of all bodies."""
    for body in model.bodies.values():
        for region, (nodes, outward, _) in body.mesh.regions.items():
            if len(nodes) == 1:
                yield End(f"{body.name}.{region}", body, body.start + nodes[0], outward, body.mesh.nodes[nodes[0]])


def _touching(end: End) -> float:
    """Return the distance below which another end touches an end."""
    return TOUCHING * float(end.body.mesh.lengths[end.body.end_element(end.node)])


def undeclared_pairs(model: Model) -> list[tuple[End, End, float]]:
    """Return the neighbouring ends on one line that face each other without a contact, and their initial distance.

    Ends that both have a contact with another partner are left out: several experiments may lie on one line.
    """
    in_contact, ends, pairs = set(model.contact_points.node.tolist()), list(_ends(model)), []
    outward, position = (np.array([getattr(end, name) for end in ends]) for name in ("outward", "position"))
    for end in ends:
        if next(part for part in end.outward.tolist() if abs(part) > 1e-9) < 0.0:  # the other end of a pair
            continue
        along = (position - end.position) @ end.outward
        beside = np.linalg.norm(position - end.position - np.outer(along, end.outward), axis=1)
        on_line = beside < 1e-6 * float(end.body.mesh.lengths.sum())
        facing = on_line & (outward @ end.outward < 1e-9 - 1.0) & (along >= -_touching(end))
        if facing.any():
            nearest = int(np.where(facing, along, np.inf).argmin())
            other, gap = ends[nearest], float(along[nearest])
            if other.body is not end.body and not {end.node, other.node} <= in_contact:
                pairs.append((end, other, 0.0 if gap <= _touching(end) else gap))
    return pairs


def expected_meetings(model: Model) -> list[str]:
    """Return one sentence for each meeting that no contact will see, if bodies keep their first velocities.

    Of bars those are pairs of ends without a contact that touch or meet.
    """
    if not model.bodies.of_lines:
        return foreseen_of_solids(model)
    sentences = []
    for end, other, gap in undeclared_pairs(model):
        closing = float(end.outward @ (end.body.velocity - other.body.velocity))
        if gap == 0.0:
            sentences.append(f"{end.name} and {other.name} touch, and {NOT_DECLARED}")
        elif closing * model.steps * model.dt > gap:
            sentences.append(
                f"{end.name} and {other.name} will meet at time {gap / closing:.6g} if their bodies keep their first "
                f"velocities, and {NOT_DECLARED}"
            )
    return sentences


def encounters(march: March, outcome: Outcome, arrays: Entries) -> list[str]:
    """Return notes on bodies that passed through each other, and on contacts that pressed beside their ends.

    They are seen where the motion of the ends is recorded, and at the end of the run.
    """
    model = march.model
    if outcome.done == 0:
        return []
    if not model.bodies.of_lines:
        return notes_of_solids(march, outcome) if outcome.status != "unstable" else []
    notes = []
    for end, other, gap in undeclared_pairs(model):
        depth = -float((gap + _relative(march, outcome, arrays, end.node, other.node) @ end.outward).min())
        if depth > _touching(end):
            notes.append(f"{end.name} passes through {other.name}, by {depth:.3g} at most: {NOT_DECLARED}")
    points = model.contact_points
    for p in np.flatnonzero(~points.at_wall).tolist() if model.dim > 1 else ():
        normal, nodes = points.normal[p], points.nodes_of(p)
        relative = _relative(march, outcome, arrays, *nodes)
        beside = np.linalg.norm(relative - np.outer(relative @ normal, normal), axis=1)
        pressing = arrays["contact_force"][-beside.size :, p] != 0.0
        # The faces are taken as squares: they have no point in common beyond half the sum of their sides.
        width = 0.5 * sum(model.bodies.at(node).spec.section ** 0.5 for node in nodes)
        if (off := np.flatnonzero(pressing & (beside > width))).size:
            since = arrays["time"][-beside.size :][off[0]]
            notes.append(
                f"contact '{points.names[p]}' presses from time {since:.6g} on although its ends have slid off each "
                f"other: they are {beside[off].max():.3g} apart sideways, and {width:.3g} wide; a contact of two ends "
                "knows only their distance along its normal"
            )
    return notes


def _relative(march: March, outcome: Outcome, arrays: Entries, first: int, second: int) -> Floats:
    """Return the displacement of one node relative to another where it is known, (times, dim)."""
    probes = [node for (node, _), *_ in probe_nodes(march.model)]
    if first in probes and second in probes:
        of_probes = {node: arrays["displacement"][:, probes.index(node)] for node in (first, second)}
        relative: Floats = of_probes[second] - of_probes[first]
        return relative
    last: Floats = outcome.final_displacement.reshape(-1, march.dim)
    return last[[second]] - last[[first]]
