"""A body from a mesh file of gmsh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np

from percuss import REFERENCE_CELLS, Doc, Gt, Mesh, MeshFile, OptionError, ReferenceCell, Region, Shape, Unit
from percuss_methods.shapes._cuts import cut

if TYPE_CHECKING:
    from percuss import Floats, Integers

TURNED = {"triangle": [0, 2, 1], "quad": [0, 3, 2, 1], "tetra": [0, 2, 1, 3], "hexahedron": [4, 5, 6, 7, 0, 1, 2, 3]}
FLAT = 1e-9  # of the size of the body or, for volumes, of a cell; and of unit vectors, below which a region is plane
SKIN = "skin"


@dataclass(frozen=True)
class MeshFromFile(Shape):
    """The triangles, quadrilaterals, tetrahedra or hexahedra of a mesh file of gmsh, version 2.2 or 4.1.

    Formula: ``x = x_0 + scale x_file``, where x_0 is the place `at` of the body.

    Regions are the physical groups of edges or faces; if they are not all of the boundary, it is the region `skin`. A
    group with facets inside the body is none.
    With `refine`, a whole number, each edge is cut into as many equal parts. New nodes lie on the facets of the file:
    a finer mesh does not come nearer to a round body.
    """

    name = "mesh"
    summary = "A body from a mesh file of gmsh"
    examples = ({"file": "example.msh"}, {"file": "example.msh", "scale": 0.5, "part": "plate"})
    file: Annotated[MeshFile, Doc("file of gmsh, .msh of version 2.2 or 4.1")]
    scale: Annotated[float, Gt(0), Unit("1"), Doc("factor on the positions in the file")] = 1.0
    part: Annotated[str, Doc("physical group of the cells of the body; all cells if left out")] = ""

    def __post_init__(self) -> None:
        path, nodes, groups = self.file.path, self.file.nodes, self.file.groups
        if self.part and not set(groups.get(self.part, {})) & TURNED.keys():
            known = [name for name, parts in groups.items() if set(parts) & TURNED.keys()]
            message = f"expected a physical group of cells of {path}, found '{self.part}'"
            raise OptionError(f"{message}; it has {', '.join(known) or 'none'}", "part")
        if len(self._kinds) != 1:
            what = f"{' and '.join(self._kinds)} cells" if self._kinds else "no cells that fill a body"
            raise OptionError(f"expected cells of one kind, found {what}: {path}", "file")
        if self.dimension() == 2 and np.ptp(nodes[:, 2]) > FLAT * np.ptp(nodes, axis=0).max():
            raise OptionError(f"expected cells in a plane of constant z, found a surface in space: {path}", "file")
        corners = nodes[self._cells]
        if (flat := ~(_volumes(corners, self.cell) > FLAT).all(axis=1)).any():
            x = ", ".join(f"{value:.6g}" for value in corners[flat][0].mean(axis=0))
            what = f"{flat.sum()} of {flat.size} that are flat or fold over, the first about ({x})"
            raise OptionError(f"expected cells with a volume, convex at each corner, found {what}: {path}", "file")

    @cached_property
    def _kinds(self) -> list[str]:
        """Kinds of the cells of the body: those of three dimensions where there are any."""
        kinds = [kind for kind in TURNED if kind in (self.file.groups[self.part] if self.part else self.file.cells)]
        return [kind for kind in kinds if kind in {"tetra", "hexahedron"}] or kinds

    @property
    def cell(self) -> str:  # type: ignore[override]
        """Kind of cells."""
        return self._kinds[0]

    @cached_property
    def _cells(self) -> Integers:
        """The cells of the body, each of which counts its nodes so that its volume is positive."""
        cells = self.file.cells[self.cell]
        cells = cells[self.file.groups[self.part][self.cell]] if self.part else cells
        # A cell in two groups stands twice in a file of version 2.2.
        cells = cells[np.sort(np.unique(np.sort(cells, axis=1), axis=0, return_index=True)[1])]
        turned = _volumes(self.file.nodes[cells], self.cell).sum(axis=1) < 0.0
        return np.where(turned[:, None], cells[:, TURNED[self.cell]], cells)

    @cached_property
    def _boundary(self) -> Integers:
        """The faces that belong to one cell alone, (faces, nodes of a face)."""
        faces = self._cells[:, self._reference.facets].reshape(-1, self._reference.facets.shape[1])
        _, inverse, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
        single: Integers = faces[count[inverse.ravel()] == 1]
        return single

    @cached_property
    def _groups(self) -> dict[str, Integers]:
        """Numbers of the faces of the boundary in each group that has no other facets."""
        return {name: facets for name, facets in self._all_groups.items() if (facets >= 0).all()}

    @cached_property
    def no_regions(self) -> dict[str, str]:  # type: ignore[override]
        """Groups with facets inside the body."""
        counts = {name: int((facets < 0).sum()) for name, facets in self._all_groups.items()}
        return {
            name: f"{count} of {self._all_groups[name].size} facets of this group are not on its boundary"
            for name, count in counts.items()
            if count
        }

    @cached_property
    def _all_groups(self) -> dict[str, Integers]:
        """Numbers of the faces of the boundary in each group of facets, -1 for a facet that is none of them."""
        kind, known = (
            self._reference.kind_of_facet,
            {tuple(row): k for k, row in enumerate(np.sort(self._boundary, axis=1).tolist())},
        )
        own = np.isin(np.arange(len(self.file.nodes)), self._cells)
        found = {}
        for name, parts in self.file.groups.items():
            if kind in parts:
                facets = np.sort(self.file.cells[kind][parts[kind]], axis=1)
                facets = facets[own[facets].all(axis=1)] if self.part else facets  # others are of other parts
                if len(facets):
                    once = dict.fromkeys(map(tuple, facets.tolist()))  # gmsh may write a facet of a group twice
                    found[name] = np.array([known.get(row, -1) for row in once])
        return found

    @property
    def regions(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the groups of facets, and `skin` unless they are all of the boundary."""
        grouped = np.concatenate([np.zeros(0, dtype=np.int64), *self._groups.values()])
        whole = len(np.unique(grouped)) == len(self._boundary)
        return tuple(self._groups) if whole or SKIN in self._groups else (*self._groups, SKIN)

    @property
    def _reference(self) -> ReferenceCell:
        """The kind of its cells."""
        return REFERENCE_CELLS[self.cell]

    def dimension(self) -> int:
        """Return 2 or 3."""
        return self._reference.corners.shape[1]

    def element_count(self, refine: float) -> int:
        """Return the number of cells."""
        return len(self._cells) * int(refine) ** self.dimension()

    def mesh(self, at: Floats, refine: float) -> Mesh:
        """Return the mesh of the file, moved by `at`.

        Raises
        ------
        OptionError
            If `refine` is no whole number.
        """
        if refine < 1 or refine % 1:
            raise OptionError(f"expected a whole number for a mesh from a file, found {refine:g}", "file")
        kind, side, cells = self.cell, self._reference.kind_of_facet, self._cells
        used = np.unique(cells)
        number = np.zeros(len(self.file.nodes), dtype=np.int64)
        number[used] = np.arange(len(used))
        nodes = at + self.scale * self.file.nodes[used, : self.dimension()]
        nodes, parts = cut(nodes, {kind: number[cells], side: number[self._boundary]}, int(refine))
        groups = {SKIN: np.arange(len(self._boundary)), **self._groups}
        facets = {name: np.concatenate(parts[side][groups[name]]) for name in self.regions}
        regions = {name: _region(nodes, of_region, side) for name, of_region in facets.items()}
        return Mesh(nodes, {kind: np.concatenate(parts[kind])}, regions)


def _region(nodes: Floats, facets: Integers, kind: str) -> Region:
    """Return a region of facets, with the vector out of the body if it is plane."""
    a, b = nodes[facets[:, 1]] - nodes[facets[:, 0]], nodes[facets[:, -1]] - nodes[facets[:, 0]]
    out = np.cross(a, b) if nodes.shape[1] == 3 else np.stack([a[:, 1], -a[:, 0]], axis=1)
    out /= np.linalg.norm(out, axis=1)[:, None]
    plane = np.abs(out - out[0]).max() < FLAT
    return Region(tuple(np.unique(facets).tolist()), out[0] if plane else np.zeros(nodes.shape[1]), {kind: facets})


def _volumes(corners: Floats, kind: str) -> Floats:
    """Return the signed volumes that the edges at the corners of each cell span, (cells, corners), its size being 1."""
    beside = REFERENCE_CELLS[kind].beside
    dim = beside.shape[1]
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        size = np.abs(corners - corners[:, :1]).max(axis=(1, 2))
        unit = (corners - corners[:, :1])[..., :dim] / size[:, None, None]
        volumes: Floats = np.linalg.det(unit[:, beside] - unit[:, : len(beside), None])
    return volumes
