"""Speed of bodies in two and three dimensions against SciPy's product and plain serial kernels, measured in one run.

    python tests/benchmarks/cells.py [--rounds N] [--most N] [--write]

A free block of squares, triangles, cubes or tetrahedra with a linear material is marched by percuss, on one core and on
two, and by a loop compiled with numba that has slopes and weights stored, and for each cell gathers, computes and adds
up forces, in the order of the cells; it knows element and material, records nothing and knows neither contact nor load.
SciPy's product is that of the stiffness of the block alone, without the update of its nodes. A run of percuss records
its energies twice, at its start and its end, which takes as long as some steps and is counted. All take turns; a round
gives their CPU times, of two threads the time by the clock. Medians of all rounds are printed, the spread of percuss
over SciPy, and the exponent p with which the time of a step grows, as n^p. The limit is the time in
which one core reads the rows and reads and writes the vectors of a step once, at the speed of a large copy.

Each size has a process of its own. Its set-up is the model and the arrays of the march, its certificate is counted in
steps, and its peak memory is what they and the march have added, for each element. Cells with one point are measured
against the plain kernel of the full rule.

Last, the share of contact: two blocks of 220 x 220 squares that meet face to face are marched with their contact and
without, in turns.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np

import percuss
from percuss.blas import one_blas_thread
from percuss.certificate import verdict
from percuss.march.march import March
from percuss.march.recording import recordable
from percuss.threads import most

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from scale import peak_memory

import pages

SIZES = {100: 20_000, 10**4: 400, 10**5: 100, 10**6: 100}  # elements of a block: steps of a round
SLOW = 2  # hexahedra take so many times fewer steps
COPIED = 200_000_000  # bytes, far more than any cache
HEAD = (
    "cells", "elements", "plain", "SciPy's product", "percuss", "limit", "two threads",
    "set-up [us]", "certificate [steps]", "bytes", "percuss over SciPy",
)  # fmt: skip
SAME = 1e-9  # of the largest displacement
SIDE = 220  # squares along a side of each of the two blocks that meet


# -------------------------------------------------------------------------------------------------- plain kernels


@numba.njit
def plain_quad4(
    cells: Any, slopes: Any, weights: Any, first: float, second: float, inverse: Any, u: Any, v: Any, f: Any,
    dt: float, steps: int,
) -> None:  # fmt: skip
    """March quadrilaterals with Lame's constants `first` and `second`."""
    for _ in range(steps):
        f[:] = 0.0
        for e in range(cells.shape[0]):
            a, b, c, d = cells[e, 0], cells[e, 1], cells[e, 2], cells[e, 3]
            ax, ay, bx, by = u[a, 0], u[a, 1], u[b, 0], u[b, 1]
            cx, cy, dx, dy = u[c, 0], u[c, 1], u[d, 0], u[d, 1]
            fax = fay = fbx = fby = fcx = fcy = fdx = fdy = 0.0
            for q in range(4):
                s = slopes[e, q]
                xx = ax * s[0, 0] + bx * s[1, 0] + cx * s[2, 0] + dx * s[3, 0]
                yy = ay * s[0, 1] + by * s[1, 1] + cy * s[2, 1] + dy * s[3, 1]
                xy = ax * s[0, 1] + bx * s[1, 1] + cx * s[2, 1] + dx * s[3, 1]
                xy += ay * s[0, 0] + by * s[1, 0] + cy * s[2, 0] + dy * s[3, 0]
                weight, mean = weights[e, q], first * (xx + yy)
                pxx, pyy = weight * (mean + 2.0 * second * xx), weight * (mean + 2.0 * second * yy)
                pxy = weight * second * xy
                fax -= pxx * s[0, 0] + pxy * s[0, 1]
                fay -= pxy * s[0, 0] + pyy * s[0, 1]
                fbx -= pxx * s[1, 0] + pxy * s[1, 1]
                fby -= pxy * s[1, 0] + pyy * s[1, 1]
                fcx -= pxx * s[2, 0] + pxy * s[2, 1]
                fcy -= pxy * s[2, 0] + pyy * s[2, 1]
                fdx -= pxx * s[3, 0] + pxy * s[3, 1]
                fdy -= pxy * s[3, 0] + pyy * s[3, 1]
            f[a, 0] += fax
            f[a, 1] += fay
            f[b, 0] += fbx
            f[b, 1] += fby
            f[c, 0] += fcx
            f[c, 1] += fcy
            f[d, 0] += fdx
            f[d, 1] += fdy
        for i in range(u.shape[0]):
            for k in range(2):
                v[i, k] += dt * inverse[i] * f[i, k]
                u[i, k] += dt * v[i, k]


@numba.njit
def plain_tri3(
    cells: Any, slopes: Any, weights: Any, first: float, second: float, inverse: Any, u: Any, v: Any, f: Any,
    dt: float, steps: int,
) -> None:  # fmt: skip
    """March triangles with Lame's constants `first` and `second`."""
    for _ in range(steps):
        f[:] = 0.0
        for e in range(cells.shape[0]):
            a, b, c, s = cells[e, 0], cells[e, 1], cells[e, 2], slopes[e, 0]
            xx = u[a, 0] * s[0, 0] + u[b, 0] * s[1, 0] + u[c, 0] * s[2, 0]
            yy = u[a, 1] * s[0, 1] + u[b, 1] * s[1, 1] + u[c, 1] * s[2, 1]
            xy = u[a, 0] * s[0, 1] + u[b, 0] * s[1, 1] + u[c, 0] * s[2, 1]
            xy += u[a, 1] * s[0, 0] + u[b, 1] * s[1, 0] + u[c, 1] * s[2, 0]
            weight, mean = weights[e, 0], first * (xx + yy)
            pxx, pyy = weight * (mean + 2.0 * second * xx), weight * (mean + 2.0 * second * yy)
            pxy = weight * second * xy
            f[a, 0] -= pxx * s[0, 0] + pxy * s[0, 1]
            f[a, 1] -= pxy * s[0, 0] + pyy * s[0, 1]
            f[b, 0] -= pxx * s[1, 0] + pxy * s[1, 1]
            f[b, 1] -= pxy * s[1, 0] + pyy * s[1, 1]
            f[c, 0] -= pxx * s[2, 0] + pxy * s[2, 1]
            f[c, 1] -= pxy * s[2, 0] + pyy * s[2, 1]
        for i in range(u.shape[0]):
            for k in range(2):
                v[i, k] += dt * inverse[i] * f[i, k]
                u[i, k] += dt * v[i, k]


def plain_solid(nodes: int, points: int) -> Any:
    """Return the march of cells in three dimensions; the compiler knows how many nodes and points they have."""

    @numba.njit
    def march(
        cells: Any, slopes: Any, weights: Any, first: float, second: float, inverse: Any, u: Any, v: Any, f: Any,
        dt: float, steps: int,
    ) -> None:  # fmt: skip
        own, forces = np.empty((nodes, 3)), np.empty((nodes, 3))
        for _ in range(steps):
            f[:] = 0.0
            for e in range(cells.shape[0]):
                for a in range(nodes):
                    for k in range(3):
                        own[a, k] = u[cells[e, a], k]
                        forces[a, k] = 0.0
                for q in range(points):
                    s = slopes[e, q]
                    xx = yy = zz = xy = yz = zx = 0.0
                    for a in range(nodes):
                        x, y, z = own[a, 0], own[a, 1], own[a, 2]
                        xx += x * s[a, 0]
                        yy += y * s[a, 1]
                        zz += z * s[a, 2]
                        xy += x * s[a, 1] + y * s[a, 0]
                        yz += y * s[a, 2] + z * s[a, 1]
                        zx += z * s[a, 0] + x * s[a, 2]
                    weight, mean = weights[e, q], first * (xx + yy + zz)
                    pxx, pyy = weight * (mean + 2.0 * second * xx), weight * (mean + 2.0 * second * yy)
                    pzz, pxy = weight * (mean + 2.0 * second * zz), weight * second * xy
                    pyz, pzx = weight * second * yz, weight * second * zx
                    for a in range(nodes):
                        forces[a, 0] -= pxx * s[a, 0] + pxy * s[a, 1] + pzx * s[a, 2]
                        forces[a, 1] -= pxy * s[a, 0] + pyy * s[a, 1] + pyz * s[a, 2]
                        forces[a, 2] -= pzx * s[a, 0] + pyz * s[a, 1] + pzz * s[a, 2]
                for a in range(nodes):
                    for k in range(3):
                        f[cells[e, a], k] += forces[a, k]
            for i in range(u.shape[0]):
                for k in range(3):
                    v[i, k] += dt * inverse[i] * f[i, k]
                    u[i, k] += dt * v[i, k]

    return march


PLAIN = {"quad4": plain_quad4, "tri3": plain_tri3, "hex8": plain_solid(8, 8), "tet4": plain_solid(4, 1)}
ELEMENTS = {**{name: name for name in PLAIN}, "quad4-one-point": "quad4", "hex8-one-point": "hex8"}  # and their cells


# ---------------------------------------------------------------------------------------------------------- cases


def block(across: int, up: int, cells: str, at: float, velocity: Sequence[float]) -> dict[str, Any]:
    """Return a block of squares, or of triangles, two in each square."""
    return {
        "block": {"size": [1.0, up / across], "elements": [across, up], "cells": cells},
        "at": [at, 0.0],
        "material": {"young": 1.0, "density": 1.0, "poisson": 0.3},
        "velocity": list(velocity),
    }


def case_of(bodies: dict[str, Any], contacts: dict[str, Any], steps: int) -> percuss.Case:
    """Return a case that records its first and its last step."""
    return percuss.load({
        "percuss": 1,
        "bodies": bodies,
        "contacts": contacts,
        "method": {"integrator": "central-difference"},
        "time": {"courant": 0.5, "steps": steps},
        "record": {"every": steps, "probes": []},
    })  # fmt: skip


def free_block(elements: int, element: str, steps: int) -> percuss.Case:
    """Return the case of a block that turns, is stretched by this, and touches nothing."""
    cells = ELEMENTS[element]
    if cells in {"quad4", "tri3"}:
        side = math.isqrt(elements)
        body = {**block(side, side if cells == "quad4" else side // 2, cells, 0.0, (0.1, -0.1)), "spin": 0.1}
    else:
        side = round((elements if cells == "hex8" else elements / 6) ** (1 / 3))
        body = {**block(side, side, cells, 0.0, (0.1, -0.1, 0.05)), "spin": [0.1, 0.05, -0.1], "at": [0.0, 0.0, 0.0]}
        body["block"] = {"size": [1.0] * 3, "elements": [side] * 3, "cells": cells}
    return case_of({"block": {**body, "element": element}}, {}, steps)


def two_blocks(steps: int, *, in_contact: bool) -> percuss.Case:
    """Return the case of two blocks that meet face to face, with their contact or without."""
    bodies = {
        "left": block(SIDE, SIDE, "quad4", 0.0, (0.1, 0.0)),
        "right": block(SIDE, SIDE, "quad4", 1.0, (-0.1, 0.0)),
    }
    return case_of(bodies, {"seam": {"between": ["left.right", "right.left"]}} if in_contact else {}, steps)


# ----------------------------------------------------------------------------------------------------- contestants


def march_of(model: Any, threads: int = 1) -> Callable[[], tuple[float, Any]]:
    """Return a march of percuss, whose calls return its time [s], of several threads by the clock, and its outcome."""
    clock = time.process_time if threads == 1 else time.perf_counter

    def march() -> tuple[float, Any]:
        made = March(recordable(model), threads=threads)
        made.compile()
        began = clock()
        outcome = made.run(None, marginal=False)
        seconds = clock() - began
        if outcome.status != "done" or not outcome.kernels.compiled:
            raise SystemExit(f"the run is {outcome.status}, compiled: {outcome.kernels.compiled}")
        return seconds, outcome

    return march


def plain_march(model: Any, cells: str, steps: int) -> Callable[[], tuple[float, Any]]:
    """Return a march of the plain kernels, whose calls return its time [s] and the displacements."""
    body = model.bodies["block"]
    geometry = body.spec.element.geometry(body.view)
    dim = model.dim
    slopes = np.ascontiguousarray(geometry[..., :-1]).reshape(*geometry.shape[:2], -1, dim)
    weights = np.ascontiguousarray(geometry[..., -1])
    numbers = np.ascontiguousarray(next(iter(body.mesh.cells.values())))
    constants, inverse = body.spec.material.solid_parameters("strain" if dim == 2 else ""), 1.0 / body.mass

    def march(count: int = steps) -> tuple[float, Any]:
        u, f, v = np.zeros((body.mass.size, dim)), np.zeros((body.mass.size, dim)), body.nodal_velocity.copy()
        began = time.process_time()
        PLAIN[cells](numbers, slopes, weights, *constants, inverse, u, v, f, model.dt, count)
        return time.process_time() - began, u

    march(0)  # compiles
    return march


def scipy_product(model: Any, steps: int) -> Callable[[], float]:
    """Return what multiplies the stiffness of a block with a motion, whose calls return the time of a product [s]."""
    stiffness = model.bodies["block"].stiffness_matrix().tocsr()
    motion = np.random.default_rng(0).standard_normal(stiffness.shape[0])

    def product() -> float:
        began = time.process_time()
        for _ in range(steps):
            stiffness @ motion
        return (time.process_time() - began) / steps

    return product


def bandwidth() -> float:
    """Return how many bytes one core reads and writes in a second."""
    there, here = np.zeros(COPIED // 8), np.ones(COPIED // 8)
    times = []
    for _ in range(5):
        began = time.perf_counter()
        np.copyto(there, here)
        times.append(time.perf_counter() - began)
    return 2.0 * COPIED / min(times)


def bytes_of_step(body: Any) -> int:
    """Return the bytes that a step reads and writes once: rows, displacement, velocity, force and inverse mass."""
    rows = body.stiffness_rows
    return int(sum(array.nbytes for array in rows) + 7 * 8 * body.mesh.nodes.size)  # three of them are written too


@one_blas_thread()
def measured(cells: str, elements: int, rounds: int) -> dict[str, Any]:
    """Return elements, times of each round for an element and step [s], and what a block of this size costs beside."""
    steps = SIZES[elements] // (SLOW if ELEMENTS[cells] == "hex8" else 1)
    march_of(settled(free_block(100, cells, 1)))()  # what is imported and compiled is not memory of a size
    before, began = peak_memory(), time.process_time()
    model = settled(free_block(elements, cells, steps))
    March(recordable(model))
    set_up, began = time.process_time() - began, time.process_time()
    verdict.verdict_alone(model)
    judged = time.process_time() - began
    ours, both = march_of(model), march_of(model, threads=min(2, most()))
    count = model.bodies["block"].count
    displacement = ours()[1].final_displacement
    memory = (peak_memory() - before) / count
    full = ELEMENTS[cells]
    plain = plain_march(model if full == cells else settled(free_block(elements, full, steps)), full, steps)
    expected = plain()[1].ravel()
    if full == cells and not np.abs(displacement - expected).max() <= SAME * np.abs(expected).max():
        raise SystemExit("percuss and the plain kernels do not march alike")
    product, each = scipy_product(model, max(1, steps // 4)), steps * count
    both()
    times = [(plain()[0] / each, product() / count, ours()[0] / each, both()[0] / each) for _ in range(rounds)]
    limit = bytes_of_step(model.bodies["block"]) / bandwidth() / count
    step = statistics.median(row[2] for row in times) * count
    found = {"elements": count, "times": times, "bytes": memory, "limit": limit}
    return found | {"set_up": set_up / count, "certificate": judged / step}


def settled(case: percuss.Case) -> Any:
    """Return the model of a case."""
    return verdict.settled(case)[0]


def in_child(cells: str, elements: int, rounds: int) -> dict[str, Any]:
    """Return what `measured` finds in a process of its own."""
    command = [sys.executable, __file__, "--one", cells, str(elements), str(rounds)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@one_blas_thread()
def share_of_contact(rounds: int, steps: int = 40) -> list[float]:
    """Return the share of the contact in a step of two blocks, of each round."""
    marches = [march_of(settled(two_blocks(steps, in_contact=in_contact))) for in_contact in (True, False)]
    for march in marches:
        march()
    shares = []
    for _ in range(rounds):
        (with_contact, _), (without, _) = (march() for march in marches)
        shares.append(1.0 - without / with_contact)
    return shares


def spread(values: Sequence[float]) -> str:
    """Return median, least and most."""
    return f"{statistics.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"


def main() -> None:
    """Print a table of times, and the share of contact."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--most", type=int, default=10**6, help="largest size")
    parser.add_argument("--write", action="store_true", help="write the table into tests/README.md")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        cells, elements, rounds = given.one
        print(json.dumps(measured(cells, int(elements), int(rounds))))
        return
    print("  ".join(f"{name:>15}" for name in HEAD))
    rows: list[tuple[str, ...]] = []
    for cells in ELEMENTS:
        sizes, steps = [], []
        for size in (one for one in SIZES if one <= given.most):
            found = in_child(cells, size, given.rounds)
            plain, scipy, ours, both = (statistics.median(column) * 1e9 for column in zip(*found["times"], strict=True))
            numbers = (plain, scipy, ours, found["limit"] * 1e9, both)
            numbers_in_words = (f"{one:.3g}" for one in (*numbers, found["set_up"] * 1e6))
            of_scipy = spread([row[2] / row[1] for row in found["times"]])
            rows.append((cells, str(found["elements"]), *numbers_in_words, *in_steps(found), of_scipy))
            print("  ".join(f"{cell:>15}" for cell in rows[-1]), flush=True)
            sizes.append(found["elements"])
            steps.append(ours * found["elements"])
        exponent = np.polyfit(np.log(sizes), np.log(steps), 1)[0] if sizes[1:] else math.nan
        print(f"{cells:>16}: a step grows as n^{exponent:.2f}")
    share = f"Share of the contact of two blocks of {SIDE} x {SIDE} squares: {spread(share_of_contact(given.rounds))}."
    print(share)
    if given.write:
        pages.write("cells", f"\n{pages.table(HEAD, rows)}\n{share} {pages.made_here()}\n")


def in_steps(found: dict[str, Any]) -> tuple[str, str]:
    """Return the certificate in steps, and the bytes of an element."""
    return f"{found['certificate']:.1f}", f"{found['bytes']:.0f}"


if __name__ == "__main__":
    main()
