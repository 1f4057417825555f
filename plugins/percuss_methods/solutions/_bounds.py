"""The bounds of an exact solution: its memory, counted from its pieces, and its processor time, measured on the way."""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

from percuss import progress

if TYPE_CHECKING:
    from collections.abc import Iterator

    from percuss import ContactProblem

GIGABYTE = 1e9


class OutOfTimeError(Exception):
    """The end of a computation that has used up its processor time; its text states the need."""


class Meter:
    """The processor time of this thread since the meter was made.

    Parameters
    ----------
    most_seconds
        Processor time after which `tell` raises an `OutOfTimeError`.
    """

    def __init__(self, most_seconds: float) -> None:
        self._most = most_seconds
        self._began = time.thread_time()

    def tell(self, share: float) -> None:
        """Report the finished share of the work, and end work that has taken too long."""
        progress(share)
        seconds = time.thread_time() - self._began
        if seconds > self._most:
            to_the_end = f", {two_digits(seconds / share)} s or more to the end" if share > 0.0 else ""
            raise OutOfTimeError(
                f"it takes more than {self._most:g} s of processor time{to_the_end} (method.solution.most_seconds)"
            )

    @contextmanager
    def stopped(self) -> Iterator[None]:
        """Count no time inside this context, such as that of compiling."""
        before = time.thread_time()
        yield
        self._began += time.thread_time() - before


def memory_of(bars: int, junctions: int, capacity: float, terms: int, marks: float) -> float:
    """Return the memory [bytes] of the histories of a chain and of their largest use, the accounts of its energy.

    Parameters
    ----------
    bars, junctions
        Number of bars, with two histories of waves each, and of junctions, with one of the force each.
    capacity
        Number of pieces for which each history has room.
    terms
        Coefficients of a piece.
    marks
        Number of pieces of all histories, each of which begins a piece of the accounts; many begin at the same time.
    """
    return 8.0 * (capacity * (2 * bars * (terms + 1) + junctions * (terms + 2)) + marks * (11 * terms + 4))


def least_memory(problem: ContactProblem, end: float) -> float:
    """Return a lower bound of the memory [bytes] of a solution up to `end`.

    A junction is computed by at most two transits of its bars at a time, and each time has a piece of the force.
    """
    shortest = min(body.length / (body.wave_modulus / body.material.rho) ** 0.5 for body in problem.bodies.values())
    pieces = end / (2.0 * shortest)
    return memory_of(len(problem.bodies), len(problem.bodies) + 1, pieces, 2, 2.0 * pieces)


def memory_of_load(pieces: float, bars: int) -> float:
    """Return the memory [bytes] of the waves of a curved load: each piece leaves, arrives, and presses."""
    return memory_of(bars, bars + 1, pieces, 8, 4.0 * pieces)


def too_large(most: float, needed: str) -> str:
    """Return in words that a solution would take more than `most` bytes, and what it needs."""
    return f"it takes more than {most / GIGABYTE:g} GB of memory, {needed} (method.solution.most_memory)"


def two_digits(number: float) -> str:
    """Return a number in words, with two digits that count."""
    return f"{float(f'{number:.2g}'):g}"
