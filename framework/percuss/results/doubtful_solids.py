"""Why the mesh or the motion of a solid makes its result doubtful: sentences for `check` and for the notes of a run."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import percent
from percuss.mesh.body import in_space
from percuss.mesh.cells import cells_of, is_solid, pieces_of
from percuss.methods.interfaces import REFERENCE_CELLS

if TYPE_CHECKING:
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers


NO_PIECES = np.zeros(0, dtype=np.int64)
MOST_TURNED = 0.05  # rad, which stretches a body of small strains by 0.12 %
NEARLY_INCOMPRESSIBLE = 3.79  # modulus of longitudinal waves over Young's at a Poisson's ratio of .45
SLENDER = 5.0  # length over thickness of a body that is expected to bend
MOST_TOO_STIFF = 0.1  # in bending


def why_in_pieces(body: Body) -> str:
    """Return that the mesh of a solid is in pieces without a common node; empty if it is in one."""
    counts = np.bincount(pieces_of(body.mesh)) if is_solid(body.spec.element) else NO_PIECES
    if counts.size < 2:
        return ""
    return (
        f"body '{body.name}' is in {counts.size} pieces without a common node, which move each for itself: the "
        f"smallest has {counts.min()} of {counts.sum()} cells"
    )


def in_brackets(point: Floats) -> str:
    """Return a place in words."""
    return f"({', '.join(f'{value + 0.0:.6g}' for value in point)})"


def why_too_stiff(body: Body) -> str:
    """Return why the cells of a body are stiffer than the body itself; empty if no reason is known."""
    element, said = body.spec.element, f"body '{body.name}' is"
    if not getattr(element, "locks", False):
        return ""
    material = body.spec.material
    if material.stress is not None and body.modulus / material.modulus > NEARLY_INCOMPRESSIBLE:
        return f"{said} almost incompressible, where {element.name} locks: it is too stiff"
    long = _length_of_cells_over_thickness(body)
    # Cells that cannot bend shear instead: G (l/h)^2 / E of plane stress, and G / E is a quarter at least.
    share = long**2 / 4.0
    if not share > MOST_TOO_STIFF:
        return ""
    return (
        f"{said} slender, and its cells are {long:.2g} times as long as it is thick: if it bends, {element.name} "
        f"locks, and it is too stiff by {percent(share, 2)} or more"
    )


def _length_of_cells_over_thickness(body: Body) -> float:
    """Return the mean length of cells along a body over its thickness; 0 of a body that is not slender."""
    nodes = body.mesh.nodes - body.mesh.nodes.mean(axis=0)
    along = nodes @ np.linalg.eigh(nodes.T @ nodes)[1]  # the last axis is that of its length
    extents = np.ptp(along, axis=0)
    if getattr(body.spec.element, "about_axis", False) or extents[-1] < SLENDER * extents.min():
        return 0.0
    return float(np.ptp(along[cells_of(body.mesh), -1], axis=1).mean() / extents.min())


def why_it_must_not_turn(body: Body, angle: float) -> str:
    """Return why a body that turns by an angle [rad] does not move as a real one; empty if the angle is small."""
    if not body.of_small_strains or not abs(angle) > MOST_TURNED:
        return ""
    return (
        f"The strains of body '{body.name}' are linear. Its turn of {abs(angle):.2g} rad is seen as a stretch of "
        f"{percent(math.hypot(1.0, angle) - 1.0, 2)}: the result is wrong. Use a material for large rotations."
    )


def turned_by(body: Body, displacement: Floats) -> float:
    """Return the angle by which displacements of its nodes, (nodes, dim), turn a body in the mean [rad]."""
    arm, mass = in_space(body.mesh.nodes - body.centre), body.mass
    inertia = mass @ (arm**2).sum(axis=1) * np.eye(3) - np.einsum("n,ni,nj->ij", mass, arm, arm)
    return float(np.linalg.norm(np.linalg.solve(inertia, mass @ np.cross(arm, in_space(displacement)))))


def why_inside_out(body: Body, displacement: Floats, time: float) -> str:
    """Return which cells of a solid a displacement of its nodes turns inside out; empty if none."""
    if not is_solid(body.spec.element):
        return ""
    ((kind, cells),) = body.mesh.cells.items()
    corners = (body.mesh.nodes + displacement)[cells]
    if not (turned := _inside_out(corners, REFERENCE_CELLS[kind].beside)).any():
        return ""
    return (
        f"body '{body.name}' has cells turned inside out, {turned.sum()} of {turned.size} at t = {time:.4g}, the "
        f"first about {in_brackets(corners[turned][0].mean(axis=0))}: no body moves so. Take a lower velocity or "
        "load, or a stiffer material"
    )


def _inside_out(corners: Floats, beside: Integers) -> Any:
    """Return for cells, (cells, nodes, dim), whether each is turned inside out at a corner (`ReferenceCell.beside`)."""
    x = np.moveaxis(corners, 2, 0)
    a, b, *c = (x[:, :, beside[:, k]] - x[:, :, : len(beside)] for k in range(beside.shape[1]))
    volumes = a[0] * b[1] - a[1] * b[0]  # quicker than the determinants of LAPACK
    if c:
        volumes = volumes * c[0][2] + (a[1] * b[2] - a[2] * b[1]) * c[0][0] + (a[2] * b[0] - a[0] * b[2]) * c[0][1]
    return ~(volumes > 0.0).all(axis=1)
