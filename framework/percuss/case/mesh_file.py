"""Reading of the mesh files of gmsh that a case names."""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from percuss.case.csv_file import UnusableFileError, read_bytes
from percuss.methods.interfaces import Integers, MeshFile
from percuss.process import processes_with

ENCODING = "latin-1"  # in which every byte is a letter, so that a binary file is kept as a text
DIMENSIONS = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2, "tetra": 3, "hexahedron": 3}
GMSH = "Save it by gmsh as .msh, version 2.2 or 4.1."
PARAMETRIC = "Save it without parametric coordinates: gmsh writes them with Mesh.SaveParametric."
FOREIGN = {
    "$ParametricNodes": ("parametric coordinates", PARAMETRIC),
    "$PartitionedEntities": (
        "partitions",
        "Save it without partitions: it is one body, and percuss runs in one process.",
    ),
}
SHARED = "Of several groups that share cells, version 4.1 is read with the first alone: save version 2.2."
SAVE_ALL = (
    "No cell has a group. Where gmsh saves all cells (Mesh.SaveAll), version 2.2 loses the groups: switch it off."
)
# Results on nodes and elements, which a mesh may have beside it, also of some nodes alone.
DATA = re.compile(r"^\$((?:Node|Element|ElementNode)Data)\r?\n.*?^\$End\1\s*", re.DOTALL | re.MULTILINE)
# Without it the reader tries a damaged file again by a second one, which believes any number in it: a wrong node number
# takes gigabytes.
ONE_READER = {"MESHIOPLUSPLUS_STRICT_CORE": "1"}
READER_SAYS = re.compile(r".*\(gmsh: (?:meshio\+\+: )?(?:Gmsh: )?(.*)\)", re.DOTALL)  # the rest names the copy


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
        If it is no mesh of gmsh of version 2.2 or 4.1, or is damaged, or has cells that percuss has no element for, or
        if the reader of meshes is not installed.
    """
    try:
        import meshioplusplus
    except ImportError:
        message = f"expected the package meshioplusplus, which reads meshes, found none: {path}"
        raise UnusableFileError(message, "Install it: pip install 'percuss[mesh]'.") from None
    if not text.startswith("$MeshFormat"):
        raise UnusableFileError(f"expected a mesh of gmsh, found a file that begins otherwise: {path}", GMSH)
    version = text[11:].split(maxsplit=1)[:1]
    if version not in (["2.2"], ["4.1"]):
        found = version[0][:20] if version else "nothing"
        raise UnusableFileError(f"expected version 2.2 or 4.1 of a mesh of gmsh, found {found}: {path}", GMSH)
    for section, (found, advice) in FOREIGN.items():
        if section in text:
            raise UnusableFileError(f"expected a mesh of gmsh without {found}: {path}", advice)
    said = io.StringIO()  # The reader prints doubts, as of a section without an end, and goes on.
    with _as_file(DATA.sub("", text).encode(ENCODING)) as file:
        try:
            with processes_with(ONE_READER), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                read = meshioplusplus.read(file, file_format="gmsh")
            nodes = np.array(read.points, dtype=float)
            blocks = [(block.type, np.array(block.data, dtype=np.int64)) for block in read.cells]
            sets = {str(name): list(rows) for name, rows in read.cell_sets.items() if not name.startswith("gmsh:")}
            tags = [np.array(of_block) for of_block in read.cell_data.get("gmsh:physical", ())]
        except Exception as error:  # noqa: BLE001 - the reader raises all kinds of errors for damaged files
            reason = READER_SAYS.fullmatch(str(error))
            why = f": {' '.join(reason[1].split())[:200]}" if reason else ""
            advice = PARAMETRIC if "parametric" in why else GMSH
            raise UnusableFileError(f"cannot read this mesh of gmsh: {path}{why}", advice) from None
    if "Warning: " in said.getvalue():
        doubt = said.getvalue().partition("Warning: ")[2].split("\n")[0]
        raise UnusableFileError(f"damaged mesh of gmsh: {path}: {doubt}", GMSH)
    names = {str(name): (tag, dim) for name, (tag, dim) in read.field_data.items()}
    _add_turned(sets, names, [kind for kind, _ in blocks], tags)
    lost = [name for name, (_, dim) in names.items() if dim and name not in sets]
    if lost:
        message = f"expected cells in each physical group, found none in '{lost[0]}': {path}"
        advice = "Leave out its name, or give it cells." if version == ["2.2"] else SHARED
        raise UnusableFileError(message, advice if any(of_block.any() for of_block in tags) else SAVE_ALL)
    return _checked(path, nodes, blocks, sets)


def _add_turned(
    sets: dict[str, list[Any]], names: Mapping[str, tuple[int, int]], kinds: list[str], tags: list[Integers]
) -> None:
    """Add to the groups the cells that are turned around in them: version 4.1 negates the number of the group."""
    for name, (tag, dim) in names.items():
        for k, (kind, of_block) in enumerate(zip(kinds, tags, strict=False)):
            if DIMENSIONS.get(kind) == dim and (turned := np.flatnonzero(of_block == -tag)).size:
                rows = sets.setdefault(name, [None] * len(kinds))
                rows[k] = turned if rows[k] is None else np.union1d(rows[k], turned)


@contextlib.contextmanager
def _as_file(content: bytes) -> Iterator[str]:
    """Give the path of a file with some content for a while, as the reader takes no less."""
    with contextlib.ExitStack() as files:
        try:
            copy = Path(files.enter_context(tempfile.TemporaryDirectory())) / "mesh.msh"
            copy.write_bytes(content)
        except OSError as error:
            message = f"expected a folder with room for a temporary copy of the mesh, found none: {error}"
            raise UnusableFileError(message, "Name one by the variable TMPDIR of the environment.") from None
        yield str(copy)


def _checked(
    path: str, nodes: np.ndarray, blocks: list[tuple[str, Integers]], sets: dict[str, list[Integers | None]]
) -> MeshFile:
    """Return the mesh with the cells of each kind together.

    Raises
    ------
    UnusableFileError
        If a number is not finite, a cell names a node that is not there, or a kind of cells is not known.
    """
    foreign = sorted({kind for kind, _ in blocks if kind not in DIMENSIONS})
    if foreign:
        known = ", ".join(kind for kind, dim in DIMENSIONS.items() if dim > 1)
        message = f"expected cells of first order ({known}), found {', '.join(foreign)}: {path}"
        other = [kind for kind in foreign if kind.rstrip("0123456789") not in DIMENSIONS]
        advice = f"percuss has no element for {other[0]}: mesh it without." if other else ""
        raise UnusableFileError(message, advice or "Mesh it with elements of order 1.")
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
