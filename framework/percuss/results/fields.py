"""The fields of a run: stresses of bars, and all that the snapshots of other bodies show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from percuss.jsonable import Entries
from percuss.march.march import March, Outcome
from percuss.march.recording import field_nodes, recorded_elements
from percuss.mesh.cells import cells_of
from percuss.mesh.stresses import stress_field

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats


WITH_FRICTION = ("point_traction", "point_slip", "point_status")
# Row and column of the components of a stress that are kept, by the number of dimensions.
STRESSES = {2: [(0, 0), (1, 1), (0, 1)], 3: [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]}


def component_names(dim: int) -> list[str]:
    """Return the names of the components of a stress that are kept, as ``xx``."""
    return [f"{'xyz'[i]}{'xyz'[j]}" for i, j in STRESSES[dim]]


def in_parts(recorded: Floats, shapes: Sequence[tuple[int, ...]]) -> list[Floats]:
    """Return the columns of an array, (records, columns), in parts that have the given shapes in each record."""
    parts = np.split(recorded, np.cumsum([math.prod(shape) for shape in shapes]), axis=1)
    return [part.reshape(len(recorded), *shape) for part, shape in zip(parts, shapes, strict=False)]


def fields_of(march: March, outcome: Outcome) -> Entries:
    """Return the fields of a run at its snapshots; empty if it has none (`percuss.Result.field_arrays`)."""
    record, model = outcome.record, march.model
    if record.field_every == 0:
        return {}
    snapshots = outcome.done // record.field_every + (outcome.status == "done")
    if snapshots == 0:  # stopped before the first snapshot
        return {}
    made = _of_bars if model.bodies.of_lines else _of_surfaces
    return {"time": np.arange(snapshots) * record.field_every * model.dt, **made(model, outcome, snapshots)}


def _of_bars(model: Model, outcome: Outcome, snapshots: int) -> Entries:
    """Return the stress along bars."""
    recorded = list(zip(model.bodies.values(), recorded_elements(model).values(), field_nodes(model), strict=True))
    shapes = [(*nodes.shape, model.dim) for _, _, nodes in recorded]
    state_shapes = [(each.size, body.volumes.shape[1], body.spec.material.state) for body, each, _ in recorded]
    displacements = in_parts(outcome.record.field[:snapshots], shapes)
    states = in_parts(outcome.histories.get("field_state", np.zeros((snapshots, 0)))[:snapshots], state_shapes)
    stress, positions = [], []
    names: list[str] = []
    for (body, elements, nodes), u, state in zip(recorded, displacements, states, strict=True):
        stress.append(stress_field(body, elements, u, state)[0])
        names += [body.name] * elements.size
        positions.append(model.bodies.nodes[nodes[:, :2]].mean(axis=1))  # the ends come first
    return {"body": names, "position": np.concatenate(positions), "stress": np.concatenate(stress, axis=1)}


def _of_surfaces(model: Model, outcome: Outcome, snapshots: int) -> Entries:
    """Return mesh, motion, stresses and contact pressures of bodies that are no bars."""
    shape, bodies = (snapshots, -1, model.dim), list(model.bodies.values())
    displacement = outcome.record.field[:snapshots].reshape(shape)
    corners = max(cells_of(body.mesh).shape[1] for body in bodies)
    fields, cells, plastic = [], [], []
    shapes = [(body.count, body.volumes.shape[1], body.spec.material.state) for body in bodies]
    recorded = outcome.histories.get("field_state", np.zeros((snapshots, 0)))[:snapshots]
    for body, states in zip(bodies, in_parts(recorded, shapes), strict=True):
        numbers = np.arange(body.count)
        nodes = body.element_nodes(numbers)
        fields.append(stress_field(body, numbers, displacement[:, nodes], states, model.dt))
        at = body.spec.material.plastic_in
        points = states[..., at] if at is not None else np.full(states.shape[:-1], np.nan)
        plastic.append(np.einsum("tcp,cp->tc", points, body.volumes) / body.volumes.sum(axis=1))
        cells.append(np.pad(nodes, ((0, 0), (0, corners - nodes.shape[1])), constant_values=-1))
    tensor, volumes = (np.concatenate(one, axis=1) for one in zip(*fields, strict=True))
    place = model.bodies.nodes
    middle = [place[body.element_nodes(np.arange(body.count))].mean(axis=1) for body in bodies]
    return {
        "body": [body.name for body in bodies for _ in range(body.count)],
        "position": np.concatenate(middle),
        "stress": tensor[..., *np.array(STRESSES[model.dim]).T],
        "von_mises": von_mises(tensor),
        **({} if np.isnan(volumes).all() else {"volume_ratio": volumes}),
        **({} if np.isnan(strains := np.concatenate(plastic, axis=1)).all() else {"plastic_strain": strains}),
        "cell_nodes": np.concatenate(cells),
        "node_body": [body.name for body in bodies for _ in range(body.mass.size)],
        "node_position": place,
        "displacement": displacement,
        "velocity": outcome.histories["field_velocity"][:snapshots].reshape(shape),
        **_of_points(model, displacement, outcome.histories, snapshots),
    }


def _of_points(model: Model, displacement: Floats, histories: Mapping[str, Floats], snapshots: int) -> Entries:
    """Return contact, area, normal, position and pressure of the contact points; empty if none are asked for.

    With friction they have traction, slide and status too.
    """
    points = model.contact_points
    if not points or not model.case.record.pressure:
        return {}
    firsts = [model.bodies[model.case.contacts[name].sides[0].body] for name in points.names]
    start, stop = np.array([(first.start, first.stop) for first in firsts])[points.point].T
    places, sums = np.zeros((len(points), len(displacement), model.dim)), np.zeros(len(points))
    for k in np.flatnonzero((start <= points.node) & (points.node < stop)):
        node, p = points.node[k], points.point[k]
        places[p] -= points.share[k] * (model.bodies.nodes[node] + displacement[:, node])
        sums[p] -= points.share[k]
    places /= sums[:, None, None]
    return {
        "point_contact": list(points.names),
        "point_area": points.weight,
        "point_normal": points.normal,
        "point_position": places.transpose(1, 0, 2),
        "contact_pressure": histories["field_pressure"][:snapshots],
        **{name: histories[name][:snapshots] for name in WITH_FRICTION if name in histories},
    }


def von_mises(stress: Floats) -> Floats:
    """Return the equivalent stress of von Mises of stresses, (..., 3, 3)."""
    mean = np.trace(stress, axis1=-2, axis2=-1)[..., None, None] / 3.0
    equivalent: Floats = np.sqrt(1.5 * ((stress - mean * np.eye(3)) ** 2).sum(axis=(-2, -1)))
    return equivalent
