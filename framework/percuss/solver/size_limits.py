"""What numbers and sizes can be computed with: beyond, a case is refused before anything overflows or fills memory."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import InputError, TooLargeError

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.case.specs import BodySpec
    from percuss.methods.interfaces import Mesh
    from percuss.solver.entities import Body

__all__ = ["check_step", "checked", "memory", "meshed", "steps"]

LEAST, MOST = 1e-100, 1e100  # products of three such numbers are numbers still
UNITS = "Choose units in which lengths, masses and times are nearer to 1."
NODE = 400  # bytes that a node takes, certificate and march together
MOST_STEPS = 2**40
SHARE = 0.8  # of the memory that a run may take


def memory() -> int | None:
    """Return how much memory [bytes] this process may use at most, None where the system does not tell."""
    found = []
    with contextlib.suppress(AttributeError, OSError, ValueError):
        found.append(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    with contextlib.suppress(OSError, ValueError):
        found.append(int(Path("/sys/fs/cgroup/memory.max").read_text(encoding="ascii")))
    return min((one for one in found if one > 0), default=None)


def fits(size: float) -> bool:
    """Return whether a number of bytes fits into the memory that a run may take."""
    most = memory()
    return most is None or size <= SHARE * most


def in_words(size: float) -> str:
    """Return a number of bytes in words."""
    power = min(int(math.log(max(size, 1.0), 1024)), 8)
    return f"{size / 1024**power:.3g} {('bytes', 'KiB', 'MiB', 'GiB', 'TiB', 'PiB', 'EiB', 'ZiB', 'YiB')[power]}"


def in_this_machine() -> str:
    """Return in words how much memory there is."""
    most = memory()
    return f"and there are {in_words(most)}" if most is not None else "more than there is"


def meshed(case: Case, spec: BodySpec) -> Mesh:
    """Return the mesh of a body, refused where its nodes would not fit into memory.

    Raises
    ------
    InputError
        Where it says so.
    """
    at = np.asarray(spec.at, dtype=float)
    path: tuple[str, ...] = ("bodies", spec.name)
    found = f"more in body '{spec.name}' than the machine can hold"
    try:
        count = spec.shape.mesh(at, 1).lengths.size * case.refine if case.refine > 1 else 0
        size = float(NODE) * count * at.size
        if fits(size):
            return spec.shape.mesh(at, case.refine)
        path, found = (
            ("refine",),
            f"{count:.4g} in body '{spec.name}', which take {in_words(size)}, {in_this_machine()}",
        )
    except MemoryError:
        pass
    raise TooLargeError([case.problem(path, f"expected elements that fit into memory, found {found}", "Take fewer.")])


def checked(case: Case, make: Callable[[], dict[str, Body]]) -> dict[str, Body]:
    """Return the bodies that `make` makes, refused where numbers of theirs cannot be computed with.

    Raises
    ------
    InputError
        With one mistake a body.
    """
    problems = []
    with np.errstate(all="ignore"):
        bodies = make()
    for name, body in bodies.items():
        h = body.mesh.lengths
        numbers: dict[str, Any] = {
            "an element length": h,
            "a mass of a node": body.mass,
            "a stiffness EA/h": body.stiffness,
            "a frequency 2c/h": body.frequency,
            "a velocity": np.abs(body.velocity[body.velocity != 0]),
        }
        for what, values in numbers.items():
            odd = np.flatnonzero(~((values >= LEAST) & (values <= MOST)))
            if odd.size:
                value = float(values[odd[0]])
                message, advice = f"expected {what} between {LEAST:g} and {MOST:g}, found {value:.6g}", UNITS
                if not value > 0 and _size_is_usual(body):
                    message, advice = _not_positive(case, body, what, int(odd[0]), value)
                problems.append(case.problem(("bodies", name), message, advice))
                break
    if problems:
        raise InputError(problems)
    return bodies


def _size_is_usual(body: Body) -> bool:
    """Return whether mass, stiffness and frequency of the body's elements can be computed with as the case has them."""
    material, h = body.spec.material, body.mesh.lengths
    sizes = [
        h,
        material.rho * body.spec.area * h,
        material.modulus * body.spec.area / h,
        2.0 * math.sqrt(material.modulus / material.rho) / h if material.modulus > 0 < material.rho else 0.0 * h,
    ]
    return all(bool(((size >= LEAST) & (size <= MOST)).all()) for size in sizes)


def _not_positive(case: Case, body: Body, what: str, place: int, value: float) -> tuple[str, str]:
    """Return message and advice for a number that must be greater than 0, by the method that gives it."""
    if what == "a mass of a node":
        by = f"the mass '{case.method.mass.name}'"
        message = f"expected a mass greater than 0 at every node, found {value:.6g} at node {place}, from {by}"
        return message, "An explicit scheme divides by the mass of each free node: take another `method.mass`."
    by = f"the element '{body.spec.element.name}'"
    return f"expected {what} greater than 0, found {value:.6g} in element {place}, from {by}", "Take another element."


def check_step(case: Case, dt: float) -> None:
    """Refuse a step that cannot be computed with.

    Raises
    ------
    InputError
        Where it is out of bounds.
    """
    if not LEAST <= dt <= MOST:
        which = "step" if case.time.step is not None else "courant"
        message = f"expected a time step between {LEAST:g} and {MOST:g}, found {dt:.6g}"
        advice = "A step is stable up to about the Courant number 1." if dt > MOST else UNITS
        raise InputError([case.problem(("time", which), message, advice)])


def steps(case: Case, dt: float) -> int:
    """Return how many steps reach the end of a run or just pass it, refused where they cannot be counted.

    Raises
    ------
    InputError
        Where they are too many.
    """
    count = (case.time.end or 0.0) / dt * (1.0 - 1e-12) - 1e-9
    if count > MOST_STEPS:
        message = f"expected at most {MOST_STEPS} steps, found {count:.3g}"
        raise InputError([case.problem(("time",), message, "Lengthen the step.")])
    return max(1, math.ceil(count))
