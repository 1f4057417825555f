"""A body of a model: its mesh, its masses and the properties of its elements. A bar is a body along a line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.mesh.cell_stiffness import entries_of, entries_of_cells, rows_of_solid
from percuss.mesh.cells import cells_of, element_masses, has_cells, is_solid, lumping_of
from percuss.mesh.eigenvalues import as_bands, highest_of_bands
from percuss.mesh.surfaces import BodySurface, surface_of, whole_surface
from percuss.methods.interfaces import BodyMesh, Floats, Integers, LoadedEnd, Mesh, SolidMaterial
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from percuss.case.specs import BodySpec
    from percuss.mesh.stiffness_rows import StiffnessRows
    from percuss.methods.interfaces import Surface


TWO_NODES = np.array([[1.0, -1.0], [-1.0, 1.0]])  # stiffness of a two-node bar, over EA/h


@dataclass(frozen=True)
class Body:
    """One body: its mesh, masses and element properties, and its range of nodes in the model."""

    name: str
    number: int
    spec: BodySpec
    view: BodyMesh  # as its element receives it
    start: int  # its first node
    mass: Floats  # (nodes,), 0 at an end of a bar in contact that the mass method leaves without mass
    frequency: Floats  # (n,) highest of the element, 2c/h of a two-node bar
    volumes: Floats  # (n, points) of the quadrature points, one of a two-node element
    velocity: Floats  # (dim,)
    may_lack_mass: Any  # (n + 1,), whether a node is an end in contact at which nothing else acts
    inverse: Any  # M^-1, sparse, where the mass couples nodes; None where it is diagonal
    stiffness: Floats  # (n,) EA/h of a bar, (0,) of other bodies
    rows: StiffnessRows | None  # of a body that marches by them

    # ---------------------------------------------------------------------------------------- nodes and elements

    @property
    def is_bar(self) -> bool:
        """Whether it is along a line, with two ends as its surface."""
        return self.mesh.line is not None

    @property
    def mesh(self) -> Mesh:
        """Its mesh."""
        return self.view.mesh

    @property
    def of_cells(self) -> bool:
        """Whether the element of the body sees one cell at a time, `percuss.CellElement`; if not, the body is a row."""
        return has_cells(self.spec.element)

    @property
    def count(self) -> int:
        """Number of its elements."""
        return self.frequency.size

    @property
    def stop(self) -> int:
        """The number after the body's last node."""
        return self.start + self.mass.size

    def element_nodes(self, elements: Integers) -> Integers:
        """Return the nodes of the model that elements of the body have, (elements, nodes of an element)."""
        return self.start + cells_of(self.mesh)[elements]

    @cached_property
    def volumes_of_cells(self) -> Floats:
        """Volume of each element, (n,) [length^3]."""
        return element_masses(self.spec.element, self.view, 1.0)

    @property
    def shortest(self) -> float:
        """Side of a cube of the smallest volume of a cell, of a bar the length of its shortest element [length]."""
        if self.is_bar:
            return float(self.mesh.lengths.min())
        return float((self.volumes_of_cells.min() / self.spec.section) ** (1.0 / self.mesh.nodes.shape[1]))

    @property
    def in_a_row(self) -> int:
        """Number of elements in a row: those along the side of a cube of as many, of a bar all of them."""
        return self.count if self.is_bar else max(1, round(self.count ** (1 / self.mesh.nodes.shape[1])))

    @property
    def extent(self) -> Floats:
        """The corners of least and of largest coordinates, of a bar its first and last node, (2, dim)."""
        nodes = self.mesh.nodes
        return nodes[[0, -1]] if self.is_bar else np.array([nodes.min(axis=0), nodes.max(axis=0)])

    def along(self, axis: Floats) -> tuple[Floats, Floats]:
        """Return the distances of the nodes from the start of the body along an axis, and the length of each, (n,).

        A bar has an axis of its own.
        """
        if not self.is_bar:
            place = self.mesh.nodes @ axis
            return place - place.min(), self.mass * float(np.ptp(place)) / float(self.mass.sum())
        spacing = self.mesh.lengths
        if self.of_cells:
            spacing = np.diff((self.mesh.nodes - self.mesh.nodes[0]) @ self.mesh.direction)
        halves = np.pad(0.5 * spacing, 1)
        return np.concatenate([[0.0], np.cumsum(spacing)]), halves[:-1] + halves[1:]

    # ---------------------------------------------------------------------------------------------------- surface

    def surface(self, region: str) -> BodySurface:
        """Return the surface at a region of the boundary."""
        if region not in self._surfaces:
            self._surfaces[region] = surface_of(self.view, region, self.start, self.volumes_of_cells)
        return self._surfaces[region]

    @cached_property
    def _surfaces(self) -> dict[str, BodySurface]:
        return {}

    @cached_property
    def boundary(self) -> Surface:
        """Its whole boundary, whatever its regions are, of a body that is no bar."""
        return whole_surface(self.view, self.start)

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
        found = self.surface(region)
        middle: Floats = found.shares @ found.surface.positions
        return middle

    # ---------------------------------------------------------------------------------------- masses and velocity

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
    def ends_without_mass(self) -> dict[int, int]:
        """The node beside each end without mass, which only a bar can have."""
        ends = ((self.start, self.start + 1), (self.stop - 1, self.stop - 2))
        return {node: beside for node, beside in ends if self.mass[node - self.start] == 0.0}

    def carrier(self, node: int) -> int:
        """Return the node with mass that carries a node: itself, or the one beside an end without mass."""
        return self.ends_without_mass.get(node, node)

    def response(self, node: int) -> dict[int, float]:
        """Return the accelerations by a unit force on a node with mass, by node, that of the node itself first."""
        if self.inverse is None:
            return {node: 1.0 / float(self.mass[node - self.start])}
        row = self.inverse[[node - self.start]]
        entries = dict(zip((self.start + row.indices).tolist(), row.data.tolist(), strict=True))
        return {near: entries[near] for near in sorted(entries, key=lambda near: (abs(near - node), near < node))}

    # -------------------------------------------------------------------------------------------------- stiffness

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
    def of_small_strains(self) -> bool:
        """Whether it is no bar and takes displacements as small, as it is linear: it stretches where it should turn."""
        return is_solid(self.spec.element) and not self.why_not_linear

    @property
    def modulus(self) -> float:
        """The largest tangent modulus, of a longitudinal wave in a body that is no bar [force/length^2]."""
        material = self.spec.material
        if isinstance(material, SolidMaterial) and not self.is_bar:
            return float(answer(material, "wave_modulus", self.view.plane_of_material))
        return material.modulus

    @property
    def marches_by_rows(self) -> bool:
        """Whether its internal forces are those of `stiffness_rows`: of a linear body that is no bar."""
        return self.rows is not None

    @cached_property
    def stiffness_rows(self) -> StiffnessRows:
        """The stiffness about rest of a body that is no bar, as rows of differences."""
        return self.rows if self.rows is not None else rows_of_solid(self.spec.element, self.spec.material, self.view)

    def stiffness_matrix(self) -> Any:
        """Return the stiffness about rest as a sparse array, (nodes * dim, nodes * dim) [force/length].

        That of a bar is along it, with a linear material.
        """
        from scipy.sparse import kron

        if not self.is_bar:
            return self.stiffness_rows.matrix().tocsr()
        along = np.outer(self.mesh.direction, self.mesh.direction)
        return self.axial_stiffness if along.size == 1 else kron(self.axial_stiffness, along)

    def hold(self, motion: Floats, forces: Floats) -> None:
        """Set the forces that hold a motion about rest, of a bar along it with a linear material, (nodes * dim,)."""
        if self.is_bar:
            forces[:] = self._kept_matrix @ motion
        else:
            self.stiffness_rows.hold(motion, forces)

    @cached_property
    def _kept_matrix(self) -> Any:
        return self.stiffness_matrix()

    @property
    def highest_frequency(self) -> float:
        """Highest angular frequency of a single element, or of the whole body if its mass couples nodes [1/time]."""
        if self.inverse is None:
            return float(self.frequency.max())
        # With C = M^-1 the eigenvalues of M^-1 K are those of C K C and C, which have few diagonals.
        stiffness = self.inverse @ self.axial_stiffness @ self.inverse
        return math.sqrt(highest_of_bands(as_bands(stiffness), as_bands(self.inverse)))

    # -------------------------------------------------------------------------------------------- ends of a bar

    def node(self, region: str) -> int:
        """Return the node of the model at an end of a bar."""
        return self.start + self.mesh.regions[region].nodes[0]

    def loaded_end(self, node: int) -> LoadedEnd:
        """Return the properties of the end of a bar at a node."""
        i = self.end_element(node)
        stiffness = self.end_stiffness(node)
        impedance = 2.0 * stiffness / float(self.frequency[i])
        if self.of_cells:  # their highest frequency is not 2c/h
            material = self.spec.material
            impedance = self.spec.section * math.sqrt(material.modulus * material.rho)
        return LoadedEnd(float(self.mass[node - self.start]), stiffness, impedance)

    def end_element(self, node: int) -> int:
        """Return the number within the body of the element at an end node."""
        return 0 if node == self.start else self.stiffness.size - 1

    def end_stiffness(self, node: int) -> float:
        """Return the stiffness of the element at an end node by which contact stiffness is measured, EA/h of a bar.

        Of an element of more than two nodes it is ``m omega^2 / 2``, with m its mass at the end node and omega its
        highest frequency: for two-node bars this is EA/h, and theta, the ratio of bipenalty and the other numbers that
        laws are made of mean the same for both.
        """
        i = self.end_element(node)
        if not self.of_cells:
            return float(self.stiffness[i])
        lumping = lumping_of(self.spec.element, self.view)
        place = int(np.flatnonzero(lumping.cells[i] == node - self.start)[0])
        mass = lumping.shares[i, place] * self.spec.material.rho * self.spec.section * self.mesh.lengths[i]
        return 0.5 * float(mass) * float(self.frequency[i]) ** 2

    @property
    def axial_stiffness(self) -> Any:
        """The stiffness along a bar with a linear material, sparse, (nodes, nodes) [force/length]; it is not kept."""
        from scipy.sparse import csr_array

        values, row, column = self.axial_entries
        return csr_array((values, (row, column)), shape=(self.mass.size,) * 2)

    @property
    def axial_entries(self) -> tuple[Floats, Integers, Integers]:
        """The entries of that stiffness, those at one place to be added up, with their rows and columns."""
        if self.of_cells:
            return entries_of_cells(self.spec.element, self.spec.material, self.view)
        return entries_of(self.stiffness[:, None, None] * TWO_NODES, cells_of(self.mesh))


def turn_of(mass: Floats, arm: Floats, motion: Floats) -> Floats:
    """Return the turn of a body in the mean by displacements of its nodes, or its spin by their velocities, (3,).

    Parameters
    ----------
    mass : (nodes,) array
    arm : (nodes, dim) array
        Places about the centre of mass.
    motion : (nodes, dim) array
        Displacements or velocities.
    """
    arm = in_space(arm)
    inertia = mass @ (arm**2).sum(axis=1) * np.eye(3) - np.einsum("n,ni,nj->ij", mass, arm, arm)
    turn: Floats = np.linalg.solve(inertia, mass @ np.cross(arm, in_space(motion)))
    return turn


def in_space(vectors: Floats) -> Floats:
    """Return vectors in one to three dimensions as vectors in three, (n, 3)."""
    whole = np.zeros((len(vectors), 3))
    whole[:, : vectors.shape[1]] = vectors
    return whole
