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
from percuss.mesh.cells import cells_of, has_cells, mesh_of_element
from percuss.mesh.loads import ROUND_OFF
from percuss.methods.blame import breach
from percuss.methods.interfaces import OptionError
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.case.specs import BodySpec
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Mesh

BYTES_PER_NODE = 400  # of bars, for the certificate and the run together, for each node and dimension
BYTES_PER_SOLID_NODE = 12_000  # of bodies in two dimensions, roughly; most are factors of the certificate
# In three dimensions the factors fill up, the more the larger the body is: n nodes take this many bytes times n^(5/3).
BYTES_IN_SPACE = 330
# A larger body in three dimensions is not factored: that takes minutes. Its run alone takes so many bytes a node.
MOST_FACTORED, BYTES_OF_RUN = 20_000, 10_000
MOST_STEPS = 2**40
OUT_OF_PLANE = (0.0, 0.0, 1.0)
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


def fits_in_memory(size: float) -> bool:
    """Return whether `size` bytes fit into the memory that a run may use."""
    if size <= ALWAYS_FITS:
        return True
    limit = memory()
    return limit is None or size <= MEMORY_SHARE * limit


def bytes_in_words(size: float) -> str:
    """Return a number of bytes as text with its unit, such as 1.5 GiB."""
    power = min(int(math.log(max(size, 1.0), 1024)), 8)
    return f"{size / 1024**power:.3g} {('bytes', 'KiB', 'MiB', 'GiB', 'TiB', 'PiB', 'EiB', 'ZiB', 'YiB')[power]}"


def memory_in_words() -> str:
    """Return the text for the available memory that ends an error message."""
    limit = memory()
    return f"and there are {bytes_in_words(limit)}" if limit is not None else "more than there is"


def bytes_of_nodes(count: float, dim: int, *, of_bar: bool) -> float:
    """Return the memory [bytes] that certificate and run take for `count` nodes of a body."""
    if of_bar:
        return count * BYTES_PER_NODE * dim
    if dim == 2:
        return count * BYTES_PER_SOLID_NODE
    return count * BYTES_OF_RUN if count > MOST_FACTORED else BYTES_IN_SPACE * count ** (5.0 / 3.0)


def mesh_of_body(case: Case, spec: BodySpec) -> Mesh:
    """Return the mesh of a body, or refuse it if its nodes do not fit into memory.

    Raises
    ------
    InputError
        If the nodes do not fit into memory.
    """
    start = np.asarray(spec.at, dtype=float)
    body = ("bodies", spec.name)
    path: tuple[str, ...] = ("refine",) if case.refine > 1 else body
    amount = f"more in body '{spec.name}' than the machine can hold"
    try:
        count = answer(spec.shape, "element_count", case.refine)
        if count is None:
            dim = start.size if type(spec.shape).cell != "line" else 1
            count = len(cells_of(answer(spec.shape, "mesh", start, 1))) * case.refine**dim if case.refine > 1 else 0
        nodes = {"triangle": 0.5, "tetra": 0.25}.get(spec.shape.cell, 1.0)  # for each element
        if has_cells(spec.element) and spec.shape.cell == "line":
            nodes = answer(spec.element, "reference_nodes").size - 1
        size = bytes_of_nodes(count * nodes, start.size, of_bar=spec.shape.cell == "line")
        path = path if fits_in_memory(size / case.refine) else body
        if fits_in_memory(size):
            mesh = answer(spec.shape, "mesh", start, case.refine)
            if missing := [name for name in spec.shape.regions if name not in mesh.regions]:
                raise breach(spec.shape, "mesh", f"mesh returned no region '{missing[0]}', which `regions` names")
            if spec.shape.cell not in mesh.cells:
                kinds = ", ".join(mesh.cells)
                raise breach(spec.shape, "mesh", f"mesh returned {kinds} cells, and `cell` says {spec.shape.cell}")
            _check_cells(case, spec, mesh)
            mesh = mesh_of_element(spec.element, mesh)
            return mesh.turned(math.radians(spec.angle), spec.axis or OUT_OF_PLANE) if spec.angle else mesh
        amount = f"{count:.4g} in body '{spec.name}', which take {bytes_in_words(size)}, {memory_in_words()}"
    except OptionError as error:
        raise InputError([case.problem(("refine",), str(error), "")]) from error
    except MemoryError:
        pass
    raise TooLargeError([case.problem(path, f"expected elements that fit into memory, found {amount}", "Take fewer.")])


def _check_cells(case: Case, spec: BodySpec, mesh: Mesh) -> None:
    """Refuse cells of a solid of which no element can compute the volume: one too small or too large in a direction."""
    if mesh.line is not None:
        return
    extents = np.ptp(mesh.nodes[cells_of(mesh)], axis=1)
    if (outside := ~within_limits(extents)).any():
        value = float(extents[outside][0])
        message = f"expected cells of a size between {SMALLEST_NUMBER:g} and {LARGEST_NUMBER:g}, found {value:.6g}"
        raise InputError([case.problem(("bodies", spec.name, spec.shape.name), message, UNITS, any_inside=True)])


def within_limits(values: Any) -> Any:
    """Return which of the values can be computed with."""
    return (values >= SMALLEST_NUMBER) & (values <= LARGEST_NUMBER)


def check_bodies(case: Case, bodies: Sequence[Body]) -> None:
    """Refuse bodies of which one of the quantities is out of bounds.

    Element lengths, masses, stiffnesses, frequencies and velocities other than zero have to lie within the bounds.

    Raises
    ------
    InputError
        With one problem for each body that is out of bounds.
    """
    problems = []
    for body in bodies:
        quantities: dict[str, Any] = {
            **(
                {"an element length": body.mesh.lengths, "a stiffness EA/h": body.stiffness}
                if body.is_bar
                else {"a volume": body.volumes_of_cells}
            ),
            "a mass of a node": np.where(body.may_lack_mass & (body.mass == 0.0), LARGEST_NUMBER, body.mass),
            "a frequency 2c/h": body.frequency,
            "a velocity": np.abs(body.velocity[body.velocity != 0]),
        }
        for quantity, values in quantities.items():
            inside = within_limits(values)
            if not inside.all():
                first = int(np.argmin(inside))
                value = float(values[first])
                message = f"expected {quantity} between {SMALLEST_NUMBER:g} and {LARGEST_NUMBER:g}, found {value:.6g}"
                advice = UNITS
                if not value > 0 and _sizes_within_limits(body):
                    message, advice = _not_positive_message(case, body, quantity, first, value)
                own = ("velocity",) if quantity == "a velocity" else ()
                problems.append(case.problem(("bodies", body.name, *own), message, advice, any_inside=True))
                break
    refuse_if_any(problems)


def _sizes_within_limits(body: Body) -> bool:
    """Return whether length, mass, stiffness and frequency, computed from the case alone, lie within the bounds.

    If they do, a number that is not positive comes from the method for the mass or the element.
    """
    if body.mesh.line is None:
        return True
    material, h = body.spec.material, body.mesh.lengths
    sizes = [
        h,
        material.rho * body.spec.section * h,
        material.modulus * body.spec.section / h,
        2.0 * math.sqrt(material.modulus / material.rho) / h if material.modulus > 0 < material.rho else 0.0 * h,
    ]
    return all(bool(within_limits(size).all()) for size in sizes)


def _not_positive_message(case: Case, body: Body, quantity: str, index: int, value: float) -> tuple[str, str]:
    """Return message and advice for a number that must be greater than 0, naming the method that returned it."""
    if quantity == "a mass of a node":
        source = f"the mass '{case.method.mass.name}'"
        message = f"expected a mass greater than 0 at every node, found {value:.6g} at node {index}, from {source}"
        return message, "An explicit scheme divides by the mass of each free node: take another `method.mass`."
    source = f"the element '{body.spec.element.name}'"
    return (
        f"expected {quantity} greater than 0, found {value:.6g} in element {index}, from {source}",
        "Take another element.",
    )


def check_step(case: Case, dt: float) -> None:
    """Refuse a time step outside the bounds for numbers.

    Raises
    ------
    InputError
        If `dt` is out of bounds.
    """
    if not SMALLEST_NUMBER <= dt <= LARGEST_NUMBER:
        key = "step" if case.time.step is not None else "courant"
        message = f"expected a time step between {SMALLEST_NUMBER:g} and {LARGEST_NUMBER:g}, found {dt:.6g}"
        advice = "A step is stable up to about the Courant number 1." if dt > LARGEST_NUMBER else UNITS
        raise InputError([case.problem(("time", key), message, advice)])


def step_count(case: Case, dt: float) -> int:
    """Return the number of steps that reach or just pass the end of the run, or refuse more than `MOST_STEPS`.

    Raises
    ------
    InputError
        If there are too many steps.
    """
    count = (case.time.end or 0.0) / dt * (1.0 - ROUND_OFF) - 1e-9
    if count > MOST_STEPS:
        message = f"expected at most {MOST_STEPS} steps, found {count:.3g}"
        raise InputError([case.problem(("time",), message, "Lengthen the step.", any_inside=True)])
    return max(1, math.ceil(count))
