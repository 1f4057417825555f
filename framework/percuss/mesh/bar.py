"""A bar: a body along a line, with what only such a body has."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.lapack import lapack
from percuss.mesh.banded_matrices import column, highest_eigenvalue, pencil_bands, sparse
from percuss.mesh.body import Body
from percuss.mesh.cell_stiffness import cell_stiffness
from percuss.mesh.cells import cells_of, lumping_of
from percuss.methods.interfaces import LoadedEnd

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers


@dataclass(frozen=True)
class Bar(Body):
    """A body along a line; its surface is its two ends."""

    stiffness: Floats  # (n,) EA/h

    @property
    def in_a_row(self) -> int:
        """Number of its elements."""
        return self.count

    @property
    def shortest(self) -> float:
        """Length of the shortest element [length]."""
        return float(self.mesh.lengths.min())

    @property
    def extent(self) -> Floats:
        """First and last node, (2, dim)."""
        return self.mesh.nodes[[0, -1]]

    @property
    def recorded_elements(self) -> Integers:
        """Numbers of the elements whose stress snapshots have: at most 400, evenly spaced."""
        return np.unique(np.linspace(0, self.count - 1, min(self.count, 400)).round()).astype(np.int64)

    @property
    def recorded_nodes(self) -> Integers:
        """Nodes of the model whose displacement snapshots have, (elements, nodes of an element)."""
        return self.element_nodes(self.recorded_elements)

    @property
    def sizes(self) -> dict[str, Floats]:
        """What must lie within the limits of numbers, by name."""
        return {"an element length": self.mesh.lengths, "a stiffness EA/h": self.stiffness}

    def places(self, region: str) -> list[tuple[int, float]]:
        """Return the node of the model at an end, with its share in the area."""
        return [(self.node(region), 1.0)]

    def along(self, axis: Floats) -> tuple[Floats, Floats]:  # noqa: ARG002 - its own
        """Return the distances of the nodes from the first one, and half of the lengths beside each."""
        spacing = self.mesh.lengths
        if self.of_cells:
            spacing = np.diff((self.mesh.nodes - self.mesh.nodes[0]) @ self.mesh.direction)
        places, lengths = np.concatenate([[0.0], np.cumsum(spacing)]), np.zeros(spacing.size + 1)
        lengths[:-1] += 0.5 * spacing
        lengths[1:] += 0.5 * spacing
        return places, lengths

    def outward(self, region: str) -> list[tuple[int, Floats]]:
        """Return the node of the model at an end, with the cross-section along the axis out of the bar."""
        return [(self.node(region), self.spec.section * self.mesh.regions[region].outward)]

    def area_of(self, region: str) -> float:  # noqa: ARG002
        """Return the cross-section."""
        return self.spec.section

    def stiffness_matrix(self) -> Any:
        """Return the stiffness with a linear material as a sparse array, (nodes * dim, nodes * dim) [force/length]."""
        from scipy.sparse import kron

        return kron(sparse(self.axial_band), np.outer(self.mesh.direction, self.mesh.direction))

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
        """Highest angular frequency of a single element, or of the whole bar if its mass couples nodes [1/time]."""
        if self.inverse.size == 0:
            return super().highest_frequency
        inverse, stiffness = pencil_bands(self.inverse, self.axial_band)

        def definite(square: float) -> bool:
            return lapack().dpbtrf(square * inverse - stiffness, lower=1)[1] == 0  # type: ignore[no-any-return]

        # The quotient of stiffness and mass of a single direction is no larger than the eigenvalue.
        return math.sqrt(highest_eigenvalue(float((stiffness[0] / inverse[0]).max()), definite))

    def response(self, node: int) -> dict[int, float]:
        """Return the accelerations by a unit force on a node with mass, by node, that of the node itself first."""
        if self.inverse.size == 0:
            return super().response(node)
        entries = column(self.inverse, node - self.start)
        return {self.start + row: value for row, value in entries.items()}

    def node(self, region: str) -> int:
        """Return the node of the model at an end."""
        return self.start + self.mesh.regions[region].nodes[0]

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

    @cached_property
    def axial_band(self) -> Floats:
        """The stiffness along the body with a linear material, a banded matrix (`percuss.mesh.banded_matrices`)."""
        if not self.of_cells:
            band = np.zeros((2, self.mass.size))
            band[0, :-1] += self.stiffness
            band[0, 1:] += self.stiffness
            band[1, :-1] = -self.stiffness
            return band
        found = cell_stiffness(self.spec.element, self.spec.material, self.view)
        matrices, cells = found.matrices[found.kind], cells_of(self.mesh)
        band = np.zeros((cells.shape[1], self.mass.size))
        for a, b in np.ndindex(matrices.shape[1:]):
            below = cells[:, b] - cells[:, a]  # rows below the diagonal, of cell nodes in any order
            rows = np.flatnonzero(below >= 0)
            np.add.at(band, (below[rows], cells[rows, a]), matrices[rows, b, a])
        return band
