"""A body of a model in any dimension: its mesh, its masses and the properties of its elements."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import percent
from percuss.mesh.cell_stiffness import stiffness_of_cells
from percuss.mesh.cells import cells_of, element_masses, has_cells, inside_out, is_solid, modulus_of, modulus_of_bar
from percuss.mesh.seams import in_brackets, seams
from percuss.mesh.surfaces import BodySurface, surface_of
from percuss.methods.interfaces import BodyMesh, Floats, Integers, Mesh

if TYPE_CHECKING:
    from percuss.case.specs import BodySpec


MOST_TURNED = 0.05  # rad, which stretches a body of small strains by 0.12 %
NEARLY_INCOMPRESSIBLE = 3.79  # modulus of longitudinal waves over Young's at a Poisson's ratio of .45
SLENDER = 5.0  # length over thickness of a body that is expected to bend
MOST_TOO_STIFF = 0.1  # in bending


def in_space(vectors: Floats) -> Floats:
    """Return vectors in one to three dimensions as vectors in three, (n, 3)."""
    whole = np.zeros((len(vectors), 3))
    whole[:, : vectors.shape[1]] = vectors
    return whole


@dataclass(frozen=True)
class Body:
    """One body: its mesh, masses and element properties, and its range of nodes in the model."""

    name: str
    number: int
    spec: BodySpec
    mesh: Mesh
    start: int  # its first node
    mass: Floats  # (nodes,), 0 at an end of a bar in contact that the mass method leaves without mass
    frequency: Floats  # (n,) highest of the element, 2c/h of a two-node bar
    volumes: Floats  # (n, points) of the quadrature points, one of a two-node element
    velocity: Floats  # (dim,)
    may_lack_mass: Any  # (n + 1,), whether a node is an end in contact at which nothing else acts
    inverse: Floats  # (k + 1, nodes) bands of M^-1 where the mass couples nodes, (0, nodes) where it is diagonal

    @property
    def why_not_linear(self) -> str:
        """The reason why internal forces are not proportional to displacements; empty for a linear body."""
        parts = (("material", self.spec.material), ("element", self.spec.element))
        nonlinear = [f"{kind} {part.name}" for kind, part in parts if not part.linear]
        if not nonlinear:
            return ""
        verb = "does" if len(nonlinear) == 1 else "do"
        return f"body '{self.name}' is not linear: its {' and its '.join(nonlinear)} {verb} not declare `linear = True`"

    @property
    def centre(self) -> Floats:
        """Its centre of mass at the start, (dim,)."""
        centre: Floats = self.mass @ self.mesh.nodes / self.mass.sum()
        return centre

    @property
    def nodal_velocity(self) -> Floats:
        """Velocity of its nodes at t = 0, (nodes, dim)."""
        velocity = np.tile(self.velocity, (self.mass.size, 1))
        if np.any(self.spec.spin):
            spin = self.spec.spin if isinstance(self.spec.spin, tuple) else (0.0, 0.0, self.spec.spin)
            velocity += np.cross(spin, in_space(self.mesh.nodes - self.centre))[:, : self.velocity.size]
        return velocity

    @property
    def of_small_strains(self) -> bool:
        """Whether it is no bar and takes displacements as small, as it is linear: it stretches where it should turn."""
        return is_solid(self.spec.element) and not self.why_not_linear

    def turned_by(self, displacement: Floats) -> float:
        """Return the angle by which displacements of its nodes turn it in the mean, (nodes, dim) [rad]."""
        arm, mass = in_space(self.mesh.nodes - self.centre), self.mass
        inertia = mass @ (arm**2).sum(axis=1) * np.eye(3) - np.einsum("n,ni,nj->ij", mass, arm, arm)
        return float(np.linalg.norm(np.linalg.solve(inertia, mass @ np.cross(arm, in_space(displacement)))))

    def why_it_must_not_turn(self, angle: float) -> str:
        """Why a motion that turns it by an angle is not that of a real body; empty if the angle is small [rad]."""
        if not self.of_small_strains or not abs(angle) > MOST_TURNED:
            return ""
        return (
            f"body '{self.name}' turns by {abs(angle):.2g} rad, but its strains hold for small rotations: the turn "
            f"lengthens it by {percent(math.hypot(1.0, angle) - 1.0, 2)}, and its spin is not that of a real body"
        )

    @property
    def why_too_stiff(self) -> str:
        """Why its cells are stiffer than the body that they stand for; empty if no reason is known."""
        element, said = self.spec.element, f"body '{self.name}' is"
        if not getattr(element, "locks", False):
            return ""
        if self.modulus / modulus_of_bar(self.spec.material) > NEARLY_INCOMPRESSIBLE:
            return f"{said} almost incompressible, where {element.name} locks: it is too stiff"
        long = self.length_of_cells_over_thickness
        # Cells that cannot bend shear instead: G (l/h)^2 / E of plane stress, and G / E is a quarter at least.
        share = long**2 / 4.0
        if not share > MOST_TOO_STIFF:
            return ""
        return (
            f"{said} slender, and its cells are {long:.2g} times as long as it is thick: if it bends, {element.name} "
            f"locks, and it is too stiff by {percent(share, 2)} or more"
        )

    def why_inside_out(self, displacement: Floats, time: float) -> str:
        """Which of its cells a displacement of its nodes turns inside out; empty if none, and of a bar."""
        if not is_solid(self.spec.element):
            return ""
        corners = (self.mesh.nodes + displacement)[cells_of(self.mesh)]
        if not (turned := inside_out(corners)).any():
            return ""
        return (
            f"body '{self.name}' has cells turned inside out, {turned.sum()} of {turned.size} at t = {time:.4g}, the "
            f"first about {in_brackets(corners[turned][0].mean(axis=0))}: no body moves so. Take a lower velocity or "
            "load, or a stiffer material"
        )

    @cached_property
    def why_not_joined(self) -> list[str]:
        """Where its mesh is not joined, as at a crack: one sentence for each kind of place."""
        return [f"body '{self.name}' {words}" for words in seams(self.mesh)] if is_solid(self.spec.element) else []

    @property
    def length_of_cells_over_thickness(self) -> float:
        """Mean length of its cells along it over its thickness; 0 of a body that is not slender."""
        nodes = self.mesh.nodes - self.mesh.nodes.mean(axis=0)
        along = nodes @ np.linalg.eigh(nodes.T @ nodes)[1]  # the last axis is that of its length
        extents = np.ptp(along, axis=0)
        if getattr(self.spec.element, "about_axis", False) or extents[-1] < SLENDER * extents.min():
            return 0.0
        return float(np.ptp(along[cells_of(self.mesh), -1], axis=1).mean() / extents.min())

    @property
    def count(self) -> int:
        """Number of its elements."""
        return self.frequency.size

    @property
    def recorded_elements(self) -> Integers:
        """Numbers of the elements whose stress snapshots have: all."""
        return np.arange(self.count)

    @property
    def recorded_nodes(self) -> Integers:
        """Nodes of the model whose displacement snapshots have: all, (nodes, 1)."""
        return np.arange(self.start, self.stop)[:, None]

    @property
    def in_a_row(self) -> int:
        """Number of elements in a row: those along the side of a cube of as many, of a bar all of them."""
        side: float = self.count ** (1 / self.mesh.nodes.shape[1])
        return max(1, round(side))

    @property
    def shortest(self) -> float:
        """Side of a cube of the smallest volume of a cell, of a bar the length of its shortest element [length]."""
        dim = self.mesh.nodes.shape[1]
        return float((self.volumes_of_cells.min() / self.spec.section) ** (1.0 / dim))

    @property
    def view(self) -> BodyMesh:
        """The body as its element receives it."""
        return BodyMesh(self.mesh, self.spec.section, self.spec.plane_of(self.mesh.nodes.shape[1]))

    @property
    def of_cells(self) -> bool:
        """Whether the element of the body sees one cell at a time, `percuss.CellElement`; if not, the body is a row."""
        return has_cells(self.spec.element)

    @property
    def modulus(self) -> float:
        """The largest tangent modulus, of a longitudinal wave in a body that is no bar [force/length^2]."""
        return modulus_of(self.spec.material, self.view)

    @property
    def stop(self) -> int:
        """The number after the body's last node."""
        return self.start + self.mass.size

    def places(self, region: str) -> list[tuple[int, float]]:
        """Return the nodes of the model in a region of the boundary, each with its share in the area."""
        found = self.surface(region)
        return list(zip(found.surface.nodes.tolist(), found.shares.tolist(), strict=True))

    def outward(self, region: str) -> list[tuple[int, Floats]]:
        """Return the nodes of the model in a region, each with the area that belongs to it along its normal."""
        found = self.surface(region)
        return list(zip(found.surface.nodes.tolist(), found.outward, strict=True))

    def area_of(self, region: str) -> float:
        """Return the area of a region of the boundary [length^2]."""
        return float(self.surface(region).surface.areas.sum())

    def middle(self, region: str) -> Floats:
        """Return the middle of a region of the boundary at the start, (dim,)."""
        places = [node - self.start for node, _ in self.places(region)]
        shares = np.array([share for _, share in self.places(region)])
        middle: Floats = shares @ self.mesh.nodes[places]
        return middle

    def along(self, axis: Floats) -> tuple[Floats, Floats]:
        """Return the distances of the nodes from the start of the body along an axis, and the length of each, (n,)."""
        place = self.mesh.nodes @ axis
        return place - place.min(), self.mass * float(np.ptp(place)) / float(self.mass.sum())

    @property
    def extent(self) -> Floats:
        """The corners of least and of largest coordinates, of a bar its first and last node, (2, dim)."""
        return np.array([self.mesh.nodes.min(axis=0), self.mesh.nodes.max(axis=0)])

    def surface(self, region: str) -> BodySurface:
        """Return the surface at a region of the boundary."""
        if region not in self._surfaces:
            self._surfaces[region] = surface_of(self.view, region, self.start, self.volumes_of_cells)
        return self._surfaces[region]

    @cached_property
    def _surfaces(self) -> dict[str, BodySurface]:
        return {}

    @cached_property
    def volumes_of_cells(self) -> Floats:
        """Volume of each element, (n,) [length^3]."""
        return element_masses(self.spec.element, self.view, 1.0)

    def element_nodes(self, elements: Integers) -> Integers:
        """Return the nodes of the model that elements of the body have, (elements, nodes of an element)."""
        return self.start + cells_of(self.mesh)[elements]

    def stiffness_matrix(self) -> Any:
        """Return the stiffness about rest as a sparse array, (nodes * dim, nodes * dim) [force/length]."""
        return stiffness_of_cells(self.spec.element, self.spec.material, self.view)

    @property
    def highest_frequency(self) -> float:
        """Highest angular frequency of a single element [1/time]."""
        return float(self.frequency.max())

    def carrier(self, node: int) -> int:
        """Return the node with mass that carries a node: itself."""
        return node

    def response(self, node: int) -> dict[int, float]:
        """Return the accelerations by a unit force on a node with mass, by node, that of the node itself first."""
        return {node: 1.0 / float(self.mass[node - self.start])}

    @property
    def sizes(self) -> dict[str, Floats]:
        """What must lie within the limits of numbers, by name."""
        return {"a volume": self.volumes_of_cells}
