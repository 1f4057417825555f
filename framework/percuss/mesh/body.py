"""A body of a model: its mesh, its masses and the properties of its elements."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.lapack import lapack
from percuss.mesh.banded_matrices import column, highest_eigenvalue, pencil_bands, sparse
from percuss.mesh.cell_stiffness import stiffness_of_cells
from percuss.mesh.cells import axial_matrices, cells_of, element_masses, has_cells, lumping_of, modulus_of
from percuss.mesh.surfaces import BodySurface, surface_of
from percuss.methods.interfaces import BodyMesh, Floats, Integers, LoadedEnd, Mesh

if TYPE_CHECKING:
    from percuss.case.specs import BodySpec


@dataclass(frozen=True)
class Body:
    """One body: its mesh, masses and element properties, and its range of nodes in the model."""

    name: str
    number: int
    spec: BodySpec
    mesh: Mesh
    start: int  # its first node
    mass: Floats  # (nodes,), 0 at an end in contact that the mass method leaves without mass
    stiffness: Floats  # (n,) EA/h
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
    def count(self) -> int:
        """Number of its elements."""
        return self.frequency.size

    @property
    def in_a_row(self) -> int:
        """Number of elements in a row: of a bar all of them, of any other body those along the side of a cube."""
        return self.count if self.mesh.line is not None else max(1, round(self.count ** (1 / self.mesh.nodes.shape[1])))

    @property
    def shortest(self) -> float:
        """Length of the shortest element; of other cells the side of a cube of the smallest volume [length]."""
        if self.mesh.line is not None:
            return float(self.mesh.lengths.min())
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

    @property
    def ends_without_mass(self) -> dict[int, int]:
        """The node beside each end without mass."""
        ends = ((self.start, self.start + 1), (self.stop - 1, self.stop - 2))
        return {node: beside for node, beside in ends if self.mass[node - self.start] == 0.0}

    def carrier(self, node: int) -> int:
        """Return the node with mass that carries a node: itself, or the one beside an end without mass."""
        return self.ends_without_mass.get(node, node)

    @property
    def highest_frequency(self) -> float:
        """Highest angular frequency of the body without supports, of single elements with a diagonal mass [1/time]."""
        if self.inverse.size == 0:
            return float(self.frequency.max())
        inverse, stiffness = pencil_bands(self.inverse, self.axial_band)

        def definite(square: float) -> bool:
            return lapack().dpbtrf(square * inverse - stiffness, lower=1)[1] == 0  # type: ignore[no-any-return]

        # The quotient of stiffness and mass of a single direction is no larger than the eigenvalue.
        return math.sqrt(highest_eigenvalue(float((stiffness[0] / inverse[0]).max()), definite))

    def response(self, node: int) -> dict[int, float]:
        """Return the accelerations by a unit force on a node with mass, by node, that of the node itself first."""
        if self.inverse.size == 0:
            return {node: 1.0 / float(self.mass[node - self.start])}
        entries = column(self.inverse, node - self.start)
        return {self.start + row: value for row, value in entries.items()}

    def node(self, region: str) -> int:
        """Return the node of the model at an end of a body along a line."""
        return self.start + self.mesh.regions[region].nodes[0]

    def places(self, region: str) -> list[tuple[int, float]]:
        """Return the nodes of the model in a region of the boundary, each with its share in the area."""
        if self.mesh.line is not None:
            return [(self.node(region), 1.0)]
        found = self.surface(region)
        return list(zip(found.surface.nodes.tolist(), found.shares.tolist(), strict=True))

    def middle(self, region: str) -> Floats:
        """Return the middle of a region of the boundary at the start, (dim,)."""
        places = [node - self.start for node, _ in self.places(region)]
        shares = np.array([share for _, share in self.places(region)])
        middle: Floats = shares @ self.mesh.nodes[places]
        return middle

    @property
    def extent(self) -> Floats:
        """First and last node of a bar; the corners of least and largest coordinates of any other body, (2, dim)."""
        nodes = self.mesh.nodes
        return nodes[[0, -1]] if self.mesh.line is not None else np.array([nodes.min(axis=0), nodes.max(axis=0)])

    def surface(self, region: str) -> BodySurface:
        """Return the surface at a region of the boundary of a body that is no line."""
        if region not in self._surfaces:
            self._surfaces[region] = surface_of(self.view, region, self.start, self.volumes_of_cells)
        return self._surfaces[region]

    @cached_property
    def _surfaces(self) -> dict[str, BodySurface]:
        return {}

    @property
    def volumes_of_cells(self) -> Floats:
        """Volume of each element, (n,) [length^3]."""
        return element_masses(self.spec.element, self.view, 1.0)

    def loaded_end(self, node: int) -> LoadedEnd:
        """Return the properties of the end at a node."""
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

    def element_nodes(self, elements: Integers) -> Integers:
        """Return the nodes of the model that elements of the body have, (elements, nodes of an element)."""
        return self.start + cells_of(self.mesh)[elements]

    def stiffness_matrix(self) -> Any:
        """Return the stiffness about rest as a sparse array, (nodes * dim, nodes * dim) [force/length]."""
        if self.mesh.line is None:
            return stiffness_of_cells(self.spec.element, self.spec.material, self.view)
        from scipy.sparse import kron

        return kron(sparse(self.axial_band), np.outer(self.mesh.direction, self.mesh.direction))

    @cached_property
    def axial_band(self) -> Floats:
        """The stiffness along the body with a linear material, a banded matrix (`percuss.mesh.banded_matrices`)."""
        if not self.of_cells:
            band = np.zeros((2, self.mass.size))
            band[0, :-1] += self.stiffness
            band[0, 1:] += self.stiffness
            band[1, :-1] = -self.stiffness
            return band
        element: Any = self.spec.element
        matrices, shape, scale = axial_matrices(element, self.view, self.spec.material.modulus)
        cells = cells_of(self.mesh)
        count = cells.shape[1]
        band = np.zeros((count, self.mass.size))
        for a in range(count):
            np.add.at(band[0], cells[:, a], scale * matrices[shape, a, a])
            for b in range(count):
                below = cells[:, b] - cells[:, a]  # rows below the diagonal, of cell nodes in any order
                rows = np.flatnonzero(below > 0)
                np.add.at(band, (below[rows], cells[rows, a]), scale[rows] * matrices[shape[rows], b, a])
        return band
