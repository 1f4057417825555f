"""What a run takes, estimated from the numbers of its elements, steps and records: time of its steps, and memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

from percuss.march.recording import bytes_of_snapshots, record_shapes
from percuss.mesh.size_limits import bytes_of_nodes

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.mesh.body import Body

# Seconds on one core of a machine of 2023; the tests allow a factor of 3.
START = 5e-4  # what precedes and follows the steps
STEP, CONTACT_POINT = 2e-7, 8e-8  # of each evaluation of the forces
SOLID_POINT = 12e-9  # a quadrature point of a body that is no bar
LINEAR_BAR, STAGE_OF_BAR = 0.7e-9, 3e-9  # a two-node element: in a leap-frog step, in a stage of other schemes
POINT_OF_BAR = 6e-9  # a quadrature point of other elements of bars


def seconds_of_steps(model: Model) -> float:
    """Return roughly how long the compiled steps of a run take [s].

    A recorded step computes the energies, which costs as much as the forces. A material with a kernel of its own may
    take longer, and so do sweeps over contact points that share nodes, of which nobody knows how many there will be.
    """
    bodies = sum(body.volumes.size * _seconds_of_point(body, model) for body in model.bodies.values())
    evaluations = len(model.tables) * model.steps
    points = STEP + CONTACT_POINT * len(model.contact_points)
    return START + evaluations * (bodies + points) + record_shapes(model).rows * bodies


def seconds_in_solids(model: Model) -> float:
    """Return roughly how long one evaluation of the forces takes in all bodies that are no bars [s]."""
    return SOLID_POINT * sum(body.volumes.size for body in model.bodies.values() if body.mesh.line is None)


def _seconds_of_point(body: Body, model: Model) -> float:
    if body.mesh.line is None:
        return SOLID_POINT
    if body.of_cells or body.why_not_linear:
        return POINT_OF_BAR
    return LINEAR_BAR if model.stages is None else STAGE_OF_BAR


def bytes_of_run(model: Model) -> float:
    """Return roughly the memory of certificate, run and records [bytes], beside that of the program itself."""
    shapes = record_shapes(model)
    bodies = model.bodies.values()
    nodes = sum(bytes_of_nodes(body.mass.size, model.dim, of_bar=body.mesh.line is not None) for body in bodies)
    return nodes + shapes.bytes_of_histories + bytes_of_snapshots(*shapes.field)
