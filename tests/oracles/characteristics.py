"""Rows of uniform bars on a grid of time: waves that take whole steps from end to end, constant over each step.

Independent of percuss. A bar carries a wave p to the right and a wave q to the left: velocity p + q, compressive force
Z (p - q). What leaves one end arrives at the other one `cells` steps later, unchanged. Exact as long as contacts close
between steps; where a gap is used up within one, the mean force over the step leaves it at zero at the step's end, so
the impulses converge with the step.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

LEFT, RIGHT = 0, 1


@dataclass
class Bar:
    """A bar of `cells` steps of travel; its ends are pushed by `force` or, where given, moved with `velocity`."""

    cells: int
    impedance: float
    start: float = 0.0  # velocity at t = 0
    force: dict[int, np.ndarray] = field(default_factory=dict)  # of either end, one a step, positive to the right
    velocity: dict[int, np.ndarray] = field(default_factory=dict)


@dataclass
class Histories:
    """Forces of the contacts (contacts, steps), gaps (contacts, steps + 1), displacements (bars, 2, steps + 1)."""

    force: np.ndarray
    gap: np.ndarray
    displacement: np.ndarray
    exact: int  # steps before the first closing between two times of the grid


def march(
    bars: list[Bar], contact_pairs: list[tuple[int | None, int | None, float]], step: float, steps: int
) -> Histories:
    """Work the row off.

    A meeting is (bar whose right end, bar whose left end, gap); None is a rigid wall.
    """
    leaves = np.zeros((len(bars), 2, steps))
    force = np.zeros((len(contact_pairs), steps))
    gap = np.zeros((len(contact_pairs), steps + 1))
    gap[:, 0] = [one[2] for one in contact_pairs]
    ends = np.zeros((len(bars), 2, steps))  # velocities
    meets = {(one[side], RIGHT - side) for one in contact_pairs for side in (0, 1) if one[side] is not None}
    alone = [(b, end) for b in range(len(bars)) for end in (LEFT, RIGHT) if (b, end) not in meets]
    off = steps

    def alone_velocity(b: int, end: int, k: int) -> tuple[float, float]:
        """Return the velocity of an end where nothing touches it, and how much faster a unit force would make it."""
        bar = bars[b]
        if end in bar.velocity:
            return bar.velocity[end][k], 0.0
        push = bar.force[end][k] if end in bar.force else 0.0
        return 2.0 * arrives(b, end, k) + push / bar.impedance, 1.0 / bar.impedance

    def arrives(b: int, end: int, k: int) -> float:
        bar = bars[b]
        return leaves[b, 1 - end, k - bar.cells] if k >= bar.cells else 0.5 * bar.start

    def send(b: int, end: int, k: int, velocity: float) -> None:
        ends[b, end, k] = velocity
        leaves[b, end, k] = velocity - arrives(b, end, k)

    for k in range(steps):
        for b, end in alone:
            send(b, end, k, alone_velocity(b, end, k)[0])
        for m, (left, right, _) in enumerate(contact_pairs):
            v_left, y_left = (0.0, 0.0) if left is None else alone_velocity(left, RIGHT, k)
            v_right, y_right = (0.0, 0.0) if right is None else alone_velocity(right, LEFT, k)
            needed = v_left - v_right - gap[m, k] / step
            force[m, k] = max(0.0, needed / (y_left + y_right))
            if gap[m, k] > 1e-12 * abs(v_left - v_right) * step and needed > 1e-12 * abs(v_left - v_right):
                off = min(off, k)
            if left is not None:
                send(left, RIGHT, k, v_left - y_left * force[m, k])
            if right is not None:
                send(right, LEFT, k, v_right + y_right * force[m, k])
            gap[m, k + 1] = max(0.0, -needed * step)
    displacement = np.zeros((len(bars), 2, steps + 1))
    displacement[:, :, 1:] = np.cumsum(ends, axis=2) * step
    return Histories(force, gap, displacement, off)
