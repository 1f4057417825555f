"""Reading of the mesh files of gmsh that a case names."""

from __future__ import annotations

import contextlib
import io
import tempfile
from pathlib import Path

import numpy as np

from percuss.case.csv_file import UnusableFileError, read_bytes
from percuss.errors import PercussError
from percuss.methods.interfaces import Integers, MeshFile

ENCODING = "latin-1"  # in which every byte is a letter, so that a binary file is kept as a text
KINDS = ("line", "triangle", "quad", "tetra", "hexahedron", "vertex")
GMSH = "Save it by gmsh as .msh, version 2.2 or 4.1."


def read_mesh(path: str, folder: Path) -> str:
    """Return the bytes of a mesh file as letters; it may hold more than text.

    Raises
    ------
    UnusableFileError
        If there is no such file, or it is far too large.
    """
    return read_bytes(path, folder, "a mesh", "Name a file of gmsh.").decode(ENCODING)


def mesh_in(text: str, path: str) -> MeshFile:
    """Return the mesh in the bytes of a file, as letters.

    Raises
    ------
    UnusableFileError
        If it is no mesh of gmsh of version 2.2 or 4.1, or is damaged, or has cells that percuss has no element for.
    PercussError
        If the reader of meshes is not installed.
    """
    try:
        import meshioplusplus
    except ImportError:
        raise PercussError("mesh files need meshioplusplus: pip install 'percuss[mesh]'") from None
    if not text.startswith("$MeshFormat"):
        raise UnusableFileError(f"expected a mesh of gmsh, found a file that begins otherwise: {path}", GMSH)
    version = text[11:].split(maxsplit=1)[:1]
    if version not in (["2.2"], ["4.1"]):
        found = version[0][:20] if version else "nothing"
        raise UnusableFileError(f"expected version 2.2 or 4.1 of a mesh of gmsh, found {found}: {path}", GMSH)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "mesh.msh"
        copy.write_bytes(text.encode(ENCODING))
        said = io.StringIO()  # The reader prints doubts, as of a section without an end, and goes on.
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                read = meshioplusplus.read(str(copy), file_format="gmsh")
            nodes = np.array(read.points, dtype=float)
            blocks = [(block.type, np.array(block.data, dtype=np.int64)) for block in read.cells]
            sets = {str(name): list(rows) for name, rows in read.cell_sets.items() if not name.startswith("gmsh:")}
        except Exception as error:  # noqa: BLE001 - the reader raises all kinds of errors for damaged files
            why = " ".join(str(error).split())[:200]
            raise UnusableFileError(f"damaged mesh of gmsh: {path}: {why or type(error).__name__}", GMSH) from None
    if "Warning: " in said.getvalue():
        doubt = said.getvalue().partition("Warning: ")[2].split("\n")[0]
        raise UnusableFileError(f"damaged mesh of gmsh: {path}: {doubt}", GMSH)
    return _checked(path, nodes, blocks, sets)


def _checked(
    path: str, nodes: np.ndarray, blocks: list[tuple[str, Integers]], sets: dict[str, list[Integers | None]]
) -> MeshFile:
    """Return the mesh with the cells of each kind together.

    Raises
    ------
    UnusableFileError
        If a number is not finite, a cell names a node that is not there, or a kind of cells is not known.
    """
    foreign = sorted({kind for kind, _ in blocks if kind not in KINDS})
    if foreign:
        known = ", ".join(KINDS[1:-1])
        message = f"expected cells of first order ({known}), found {', '.join(foreign)}: {path}"
        raise UnusableFileError(message, "Mesh it with elements of order 1.")
    if nodes.ndim != 2 or nodes.shape[1] != 3 or not len(nodes) or not np.isfinite(nodes).all():
        raise UnusableFileError(f"damaged mesh of gmsh: {path}: its nodes are not finite positions", GMSH)
    if not all(rows.size and rows.min() >= 0 and rows.max() < len(nodes) for _, rows in blocks):
        raise UnusableFileError(f"damaged mesh of gmsh: {path}: a cell names a node that is not there", GMSH)
    kinds = list(dict.fromkeys(kind for kind, _ in blocks))
    cells = {kind: np.concatenate([rows for name, rows in blocks if name == kind]) for kind in kinds}
    first, begun = dict.fromkeys(kinds, 0), []
    for kind, rows in blocks:
        begun.append(first[kind])
        first[kind] += len(rows)
    groups: dict[str, dict[str, Integers]] = {}
    for name, parts in sets.items():
        for (kind, rows), start, part in zip(blocks, begun, parts, strict=False):
            chosen = np.zeros(0, dtype=np.int64) if part is None else np.array(part, dtype=np.int64).ravel()
            if chosen.size and chosen.min() >= 0 and chosen.max() < len(rows):
                kept = groups.setdefault(name, {})
                kept[kind] = np.concatenate([kept.get(kind, chosen[:0]), start + chosen])
    return MeshFile(path, nodes, cells, groups)
