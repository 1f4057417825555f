"""Bounds on numbers and memory: a case beyond them is refused before a number overflows or memory runs out."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.options import LARGEST_NUMBER, SMALLEST_NUMBER, UNITS
from percuss.errors import InputError, TooLargeError, refuse_if_any
from percuss.mesh.cells import cells_of, extents_of, has_cells, mesh_of_element
from percuss.methods.blame import breach
from percuss.methods.interfaces import OptionError
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.case.specs import BodySpec
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Mesh

BYTES_PER_NODE = 400  # of bars, for the certificate and the run together, for each node and dimension
BYTES_PER_SOLID_NODE = {2: 2_000, 3: 10_000}  # of the run of bodies in two and in three dimensions, at most
# Factors for the critical step of solids: those of n nodes take these bytes times n to a power, by dimension.
BYTES_OF_FACTORS = {2: (12_000.0, 1.0), 3: (330.0, 5.0 / 3.0)}
MOST_FACTORED = 20_000  # nodes of a body in three dimensions; of more, factors take minutes
OUT_OF_PLANE = (0.0, 0.0, 1.0)
BOUNDS = f"{SMALLEST_NUMBER:g} and {LARGEST_NUMBER:g}"
ALWAYS_FITS = 2.0**26  # bytes for which no machine is asked how much memory it has
MEMORY_SHARE = 0.8  # largest share of the memory that a run may use


def memory() -> int | None:
    """Return the largest memory [bytes] that this process may use, or None where the system does not report it."""
    limits = []
    with contextlib.suppress(AttributeError, OSError, ValueError):
        limits.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    with contextlib.suppress(OSError, ValueError):
        limits.append(int(Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii")))
    return min((limit for limit in limits if limit > 0), default=None)


def bytes_in_words(size: float) -> str:
    """Return a number of bytes as text with its unit, such as 1.5 GiB."""
    power = min(int(math.log(max(size, 1.0), 1024)), 8)
    return f"{size / 1024**power:.3g} {('bytes', 'KiB', 'MiB', 'GiB', 'TiB', 'PiB', 'EiB', 'ZiB', 'YiB')[power]}"


def why_too_large(size: float) -> str:
    """Return the end of a sentence: that something takes `size` bytes, and what memory there is; empty if it fits."""
    limit = memory() if size > ALWAYS_FITS else None
    if limit is None or size <= MEMORY_SHARE * limit:
        return ""
    return f"take {bytes_in_words(size)}, and there are {bytes_in_words(limit)}"


def bytes_of_nodes(count: float, dim: int, *, of_bar: bool) -> float:
    """Return the memory [bytes] that a run takes for `count` nodes of a body."""
    return count * BYTES_PER_NODE * dim if of_bar else count * BYTES_PER_SOLID_NODE[dim]


def why_not_factored(counts: Sequence[int], dim: int) -> str:
    """Return why solids of these numbers of nodes are not factored: it takes minutes, or too much memory."""
    if dim == 3 and max(counts) > MOST_FACTORED:
        return f"a body of more than {MOST_FACTORED} nodes in three dimensions is not factored"
    scale, power = BYTES_OF_FACTORS[dim]
    too_much = why_too_large(sum(scale * count**power for count in counts))
    return f"its factors {too_much}" if too_much else ""


def mesh_of_body(case: Case, spec: BodySpec) -> Mesh:
    """Return the mesh of a body, or refuse it if its nodes do not fit into memory.

    Raises
    ------
    InputError
        If the nodes do not fit into memory, or a cell is so small or large that its volume cannot be computed.
    """
    start, shape, refine = np.asarray(spec.at, dtype=float), spec.shape, case.refine
    try:
        count = answer(shape, "element_count", refine) or 0
        nodes = {"triangle": 0.5, "tetra": 0.25}.get(shape.cell, 1.0)  # for each element
        if has_cells(spec.element) and shape.cell == "line":
            nodes = answer(spec.element, "reference_nodes").size - 1
        size = bytes_of_nodes(count * nodes, start.size, of_bar=shape.cell == "line")
        if not (too_large := why_too_large(size)):
            return _mesh_of_shape(case, spec, start)
    except OptionError as error:
        raise InputError([case.problem(("refine",), str(error), "")]) from error
    path = ("refine",) if refine > 1 and not why_too_large(size / refine) else ("bodies", spec.name)
    message = f"expected elements that fit into memory, found {count:.4g} in body '{spec.name}', which {too_large}"
    raise TooLargeError([case.problem(path, message, "Take fewer.")])


def _mesh_of_shape(case: Case, spec: BodySpec, start: Floats) -> Mesh:
    """Return the mesh of a body as its shape and its element make it."""
    mesh = answer(spec.shape, "mesh", start, case.refine)
    if missing := [name for name in spec.shape.regions if name not in mesh.regions]:
        raise breach(spec.shape, "mesh", f"mesh returned no region '{missing[0]}', which `regions` names")
    if spec.shape.cell not in mesh.cells:
        kinds = ", ".join(mesh.cells)
        raise breach(spec.shape, "mesh", f"mesh returned {kinds} cells, and `cell` says {spec.shape.cell}")
    extents = extents_of(mesh.nodes, cells_of(mesh)) if mesh.line is None else np.ones(1)
    if (outside := ~within_limits(extents)).any():
        message = f"expected cells of a size between {BOUNDS}, found {extents[outside][0]:.6g}"
        raise InputError([case.problem(("bodies", spec.name, spec.shape.name), message, UNITS, any_inside=True)])
    mesh = mesh_of_element(spec.element, mesh)
    return mesh.turned(math.radians(spec.angle), spec.axis or OUT_OF_PLANE) if spec.angle else mesh


def within_limits(values: Any) -> Any:
    """Return which of the values can be computed with."""
    return (values >= SMALLEST_NUMBER) & (values <= LARGEST_NUMBER)


def check_bodies(case: Case, bodies: Sequence[Body]) -> None:
    """Refuse bodies of which one of the quantities is out of bounds.

    Element lengths, volumes, masses, stiffnesses, frequencies and velocities other than zero have to lie within the
    bounds. If one that a method returns is not positive, though the numbers before it are within their bounds, the
    method is at fault and no matter of units.

    Raises
    ------
    InputError
        With one problem for each body that is out of bounds.
    """
    problems = []
    for body in bodies:
        element = f"the element '{body.spec.element.name}'", "Take another element."
        mass = f"the mass '{case.method.mass.name}'", "An explicit scheme divides by it: take another `method.mass`."
        volumes = body.volumes_of_cells
        nodal = np.where(body.may_lack_mass & (body.mass == 0.0), LARGEST_NUMBER, body.mass)
        for quantity, values, source in (
            ("an element length", body.mesh.lengths, None) if body.is_bar else ("a volume", volumes, element),
            ("a mass of an element", body.spec.material.rho * volumes, None),
            ("a stiffness EA/h", body.stiffness, element),
            ("a mass of a node", nodal, mass),
            ("a frequency 2c/h", body.frequency, element),
            ("a velocity", np.abs(body.velocity[body.velocity != 0]), None),
        ):
            if within_limits(values).all():
                continue
            first = int(np.argmin(within_limits(values)))
            expected, advice = f"between {BOUNDS}, found {values[first]:.6g}", UNITS
            if source and not values[first] > 0:
                expected, advice = f"greater than 0, found {values[first]:.6g} at {first}, from {source[0]}", source[1]
            path = ("bodies", body.name, "velocity") if quantity == "a velocity" else ("bodies", body.name)
            problems.append(case.problem(path, f"expected {quantity} {expected}", advice, any_inside=True))
            break
    refuse_if_any(problems)
