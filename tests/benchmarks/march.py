"""Speed of percuss against hand-written C and NumPy loops, as ratios measured in one run.

``python tests/benchmarks/march.py [--quick] [--json FILE]``; needs gcc. Two equal bars in impact, the second fixed
at its far end, for every pair of integrator and contact law. All contestants take turns, so that what else the
machine does falls on all alike. Times are per node and step, the best of all rounds; ratios are to the blocked C loop
of march.c, of the best times and, least, median and most, of the times of one round. Ratios of the best times follow
to the fastest C loops, which know that all elements are alike and keep no account of work and energy: two displacement
levels (`levels`), and several steps of a tile at a time (`tiled`); and to NumPy with ``out=``.
"""

from __future__ import annotations

import argparse
import ctypes
import functools
import itertools
import json
import os
import platform
import statistics
import subprocess
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import percuss

HERE = Path(__file__).resolve().parent

INTEGRATORS = ("central-difference", "wu-predictor-corrector")
LAWS: dict[str, Any] = {
    "penalty": {"name": "penalty", "beta_s": 0.25},
    "bipenalty": {"name": "bipenalty", "beta_s": 0.25, "ratio": 1.0},
    "lagrange": "lagrange",
}
# elements a bar: largest ratio to the blocked C loop, steps of a timed run in C and percuss, and in NumPy
SIZES = {100: (2.5, 1_000_000, 20_000), 10**4: (1.5, 20_000, 4_000), 10**6: (1.5, 500, 101)}
LENGTH, YOUNG, DENSITY, VELOCITY, COURANT = 10.0, 100.0, 0.01, 0.1, 0.5
BETA_S = 0.25
EVERY = 100
SAME = 1e-9  # of the peak force

Run = Callable[[int, int], tuple[float, Any]]  # (steps, record every) -> (seconds, forces)


class Contact(ctypes.Structure):
    """``struct contact`` of march.c."""

    _fields_ = [(name, ctypes.c_double) for name in ("dt", "stiffness", "mass", "inverse_mass_a", "inverse_mass_b")]


@dataclass(frozen=True)
class Bars:
    """Two equal bars as plain numbers."""

    elements: int

    @property
    def nodes(self) -> int:
        """Nodes of one bar."""
        return self.elements + 1

    @property
    def h(self) -> float:
        """Length of an element."""
        return LENGTH / self.elements

    @property
    def dt(self) -> float:
        """Time step."""
        return COURANT * self.h / (YOUNG / DENSITY) ** 0.5

    @property
    def mass(self) -> Any:
        """Nodal masses of both bars."""
        mass = np.full(2 * self.nodes, DENSITY * self.h)
        mass[[0, self.nodes - 1, self.nodes, -1]] /= 2.0
        return mass

    @property
    def velocity(self) -> Any:
        """Velocity at the start: the first bar moves."""
        v = np.zeros(2 * self.nodes)
        v[: self.nodes] = VELOCITY
        return v

    def contact(self) -> Contact:
        """Return penalty stiffness and the mass of ratio 1, eps_s / omega^2 with omega = 2c/h."""
        stiffness = BETA_S * YOUNG / self.h
        omega = 2.0 * (YOUNG / DENSITY) ** 0.5 / self.h
        inverse = 2.0 / (DENSITY * self.h)
        return Contact(self.dt, stiffness, stiffness / omega**2, inverse, inverse)


def aligned(values: Any) -> Any:
    """Return a copy that starts on a cache line, as an allocation by hand would."""
    raw = np.empty(values.size + 8)
    start = (-raw.ctypes.data % 64) // 8
    out = raw[start : start + values.size]
    out[:] = values
    return out


def pointer(array: Any) -> ctypes.c_void_p:
    """Return the address of an array as C takes it."""
    return ctypes.c_void_p(array.ctypes.data)


# ---------------------------------------------------------------------------------------------- contestants


def compile_c(folder: Path) -> ctypes.CDLL:
    """Compile march.c with the machine's own instructions."""
    library = folder / "march.so"
    flags = ["-O3", "-march=native", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, str(HERE / "march.c"), "-o", str(library)], check=True)
    return ctypes.CDLL(str(library))


def blocked_c(library: ctypes.CDLL, bars: Bars, integrator: str, law: str) -> Run:
    """Displacement and velocity in place, block by block, a mass a node and a stiffness an element."""
    run = library[f"blocked_{integrator}_{law}".replace("-", "_")]
    n, contact = bars.nodes, bars.contact()
    start, w = bars.velocity, aligned(bars.dt / bars.mass)
    u, v = aligned(start), aligned(start)
    k = aligned(np.full(2 * bars.elements, YOUNG / bars.h))

    def march(steps: int, every: int) -> tuple[float, Any]:
        u[:], v[:] = 0.0, start
        out = np.zeros(-(-steps // every))
        arrays = [pointer(a) for a in (u, v, w, k)]
        began = time.perf_counter()
        run(
            ctypes.c_long(n), *arrays, ctypes.byref(contact),
            ctypes.c_long(steps), ctypes.c_long(every), pointer(out),
        )  # fmt: skip
        return time.perf_counter() - began, out

    return march


def levels_c(library: ctypes.CDLL, form: str, bars: Bars, integrator: str, law: str) -> Run:
    """Two displacement levels on uniform bars: `levels` by one step, `tiled` by several steps of a tile at a time."""
    run = library[f"{form}_{integrator}_{law}".replace("-", "_")]
    n, contact = bars.nodes, bars.contact()
    start = -bars.dt * bars.velocity
    p, q = aligned(start), aligned(start)

    def march(steps: int, every: int) -> tuple[float, Any]:
        p[:], q[:] = start, 0.0
        out = np.zeros(-(-steps // every))
        began = time.perf_counter()
        run(
            ctypes.c_long(n), pointer(p), pointer(q), ctypes.c_double(COURANT**2), ctypes.byref(contact),
            ctypes.c_long(steps), ctypes.c_long(every), pointer(out),
        )  # fmt: skip
        return time.perf_counter() - began, out

    return march


def numpy_loop(bars: Bars, integrator: str, law: str) -> Run:
    """Whole-array NumPy with ``out=``; the element that would join the bars has no stiffness."""
    c, n, dt = bars.contact(), bars.nodes, bars.dt
    a, b = n - 1, n
    s = c.inverse_mass_a + c.inverse_mass_b
    wu = integrator == "wu-predictor-corrector"
    w, start = dt / bars.mass, bars.velocity
    k = np.full(2 * n - 1, YOUNG / bars.h)
    k[a] = 0.0
    u, v, work = start.copy(), start.copy(), np.zeros(2 * n)
    axial = np.zeros(2 * n + 1)
    inner, right, left, ahead, behind = axial[1:-1], axial[1:], axial[:-1], u[1:], u[:-1]

    def force_of(gap: float, acceleration: float, predicted: float) -> float:
        if law == "lagrange":
            return max(0.0, -predicted / (dt**2 * s))
        seen = predicted if wu else gap
        if not seen < 0.0:
            return 0.0
        if law == "penalty":
            return -c.stiffness * seen
        push = -c.stiffness * seen - (0.0 if wu else c.mass * acceleration)
        return push / (1.0 + c.mass * s)

    def march(steps: int, every: int) -> tuple[float, Any]:
        u[:], v[:] = 0.0, start
        out = np.zeros(-(-steps // every))
        began = time.perf_counter()
        for step in range(steps):
            gap, rate = u.item(b) - u.item(a), v.item(b) - v.item(a)
            np.subtract(ahead, behind, out=inner)
            np.multiply(inner, k, out=inner)
            np.subtract(right, left, out=work)
            np.multiply(work, w, out=work)
            np.add(v, work, out=v)
            v[-1] = 0.0
            np.multiply(v, dt, out=work)
            np.add(u, work, out=u)
            force = force_of(gap, (v.item(b) - v.item(a) - rate) / dt, u.item(b) - u.item(a))
            if force != 0.0:
                v[a] -= w[a] * force
                u[a] -= dt * w[a] * force
                v[b] += w[b] * force
                u[b] += dt * w[b] * force
            if step % every == 0:
                out[step // every] = force
        return time.perf_counter() - began, out

    return march


def case(elements: int, integrator: str, law: str, steps: int, every: int) -> dict[str, Any]:
    """Return the same bars as a case of percuss."""
    bar = {
        "bar": {"length": LENGTH, "elements": elements},
        "material": {"young": YOUNG, "density": DENSITY},
        "area": 1.0,
    }
    return {
        "percuss": 1,
        "bodies": {"left": {**bar, "velocity": VELOCITY}, "right": {**bar, "at": LENGTH, "fixed": ["right"]}},
        "contacts": {"tip": {"between": ["left.right", "right.left"]}},
        "method": {"integrator": integrator, "contact": LAWS[law]},
        "time": {"steps": steps, "courant": COURANT},
        "record": {"every": every},
    }


def with_percuss(bars: Bars, integrator: str, law: str, others: dict[str, float]) -> Run:
    """Return percuss's own loop; what else a run takes is put into `others`."""

    @functools.cache
    def load(steps: int, every: int) -> Any:
        return percuss.load(case(bars.elements, integrator, law, steps, every))

    def march(steps: int, every: int) -> tuple[float, Any]:
        result = percuss.run(load(steps, every))
        if not result.summary["compiled"]:
            raise SystemExit(f"percuss did not compile: {result.summary['compiled_why']}")
        seconds = result.summary["seconds"]
        others.update({key: min(others.get(key, np.inf), value) for key, value in seconds.items() if key != "march"})
        return seconds["march"], result.arrays["contact_force"][: -(-steps // every), 0]

    return march


# ---------------------------------------------------------------------------------------------- comparison


def same_forces(forces: dict[str, Any], what: str) -> float:
    """Return the largest difference from the blocked C loop over the peak; refuse one that matters."""
    reference = forces["C"]
    peak = np.abs(reference).max()
    if not peak > 0.0:
        raise SystemExit(f"{what}: no contact force, nothing to compare")
    worst = 0.0
    for name, values in forces.items():
        common = min(values.size, reference.size)
        if not np.abs(reference[:common]).max() > 0.0:
            raise SystemExit(f"{what}: {name} ran too few steps to meet a contact force")
        apart = float(np.abs(values[:common] - reference[:common]).max() / peak)
        if not apart <= SAME:
            raise SystemExit(f"{what}: forces of {name} and C differ by {apart:.3g} of the peak")
        worst = max(worst, apart)
    return worst


def compare(
    library: ctypes.CDLL,
    elements: int,
    integrator: str,
    law: str,
    *,
    rounds: int,
    share: float,
    every: int = EVERY,
) -> dict[str, Any]:
    """Let all contestants march in turns; return times per node and step, and ratios."""
    target, steps, numpy_steps = SIZES[elements]
    steps = max(int(steps * share), 2 * EVERY)
    numpy_steps = min(max(int(numpy_steps * share), EVERY + 1), steps)
    bars = Bars(elements)
    others: dict[str, float] = {}
    contestants: dict[str, tuple[Run, int]] = {
        "C": (blocked_c(library, bars, integrator, law), steps),
        "percuss": (with_percuss(bars, integrator, law, others), steps),
        "levels": (levels_c(library, "levels", bars, integrator, law), steps),
        "tiled": (levels_c(library, "tiled", bars, integrator, law), steps),
        "numpy": (numpy_loop(bars, integrator, law), numpy_steps),
    }
    first = time.perf_counter()
    contestants["percuss"][0](2, 1)
    first = time.perf_counter() - first
    others.clear()
    seconds: dict[str, list[float]] = defaultdict(list)
    forces = {}
    for turn in range(rounds):
        names = list(contestants)
        for name in names if turn % 2 == 0 else reversed(names):
            run, count = contestants[name]
            time.sleep(0.1)  # threads of the linear algebra library, once woken, spin a while on the other cores
            took, forces[name] = run(count, every)
            seconds[name].append(took / count)
    differ = same_forces(forces, f"{integrator} x {law}, {elements} elements")
    ratios = [mine / c for mine, c in zip(seconds["percuss"], seconds["C"], strict=True)]
    best = {name: min(values) for name, values in seconds.items()}
    return {
        "elements": elements,
        "integrator": integrator,
        "law": law,
        "every": every,
        "steps": steps,
        "ns_per_step": {name: value * 1e9 for name, value in best.items()},
        "ns_per_node_step": {name: value * 1e9 / (2 * bars.nodes) for name, value in best.items()},
        "ratio": {
            "of_best": best["percuss"] / best["C"],
            "min": min(ratios),
            "median": statistics.median(ratios),
            "max": max(ratios),
        },
        "to_levels": best["percuss"] / best["levels"],
        "to_tiled": best["percuss"] / best["tiled"],
        "to_numpy": best["percuss"] / best["numpy"],
        "spread": {name: max(values) / min(values) for name, values in seconds.items()},
        "target": target,
        "forces_differ": differ,
        "first_run_s": first,
        "outside_march_s": others,
    }


HEAD = (
    f"{'':>8} {'':<44} | {'ns a node and step':^39} | {'ratio to C':^32} | {'ratio to':^20} | {'C':>6} | seconds\n"
    f"{'elements':>8} {'pair':<44} | {'percuss':>8} {'C':>7} {'levels':>7} {'tiled':>6} {'NumPy':>7} | "
    f"{'best':>5} {'least':>6} {'median':>6} {'most':>5} {'target':>6} | {'levels':>6} {'tiled':>6} {'NumPy':>6} | "
    f"{'spread':>6} | {'first':>5} {'build':>5} {'compile':>7}"
)


def line(row: dict[str, Any]) -> str:
    """Return a row of the table."""
    ns, ratio, others = row["ns_per_node_step"], row["ratio"], row["outside_march_s"]
    mark = " " if row["every"] != EVERY or ratio["of_best"] <= row["target"] else "!"
    pair = f"{row['integrator']} x {row['law']}"
    if row["every"] != EVERY:
        pair = f"{row['integrator']}, every {row['every']} step"
    return (
        f"{row['elements']:>8} {pair:<44} | {ns['percuss']:8.3f} {ns['C']:7.3f} {ns['levels']:7.3f} {ns['tiled']:6.3f} "
        f"{ns['numpy']:7.2f} | {ratio['of_best']:5.2f} {ratio['min']:6.2f} {ratio['median']:6.2f} "
        f"{ratio['max']:5.2f} {row['target']:5.1f}{mark} | {row['to_levels']:6.2f} {row['to_tiled']:6.2f} "
        f"{row['to_numpy']:6.2f} | {row['spread']['C']:6.2f} | "
        f"{row['first_run_s']:5.2f} {others['build']:5.3f} {others['compile']:7.4f}"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="shorter runs, fewer rounds")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write all that was measured")
    parser.add_argument("--elements", type=int, nargs="+", choices=list(SIZES), default=list(SIZES))
    parser.add_argument("--rounds", type=int, help="rounds a row; 7, or 3 with --quick")
    args = parser.parse_args()
    rounds = args.rounds or (3 if args.quick else 7)
    share = 0.25 if args.quick else 1.0
    rows = []
    print(f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, best of {rounds} rounds")
    print(HEAD)
    with tempfile.TemporaryDirectory() as folder:
        library = compile_c(Path(folder))
        for elements in args.elements:
            for integrator, law in itertools.product(INTEGRATORS, LAWS):
                rows.append(compare(library, elements, integrator, law, rounds=rounds, share=share))
                print(line(rows[-1]), flush=True)
        for elements in args.elements:
            if elements <= 10**4:
                pair = (INTEGRATORS[1], "bipenalty")
                rows.append(compare(library, elements, *pair, rounds=rounds, share=share / 4, every=1))
                print(line(rows[-1]), flush=True)
    judged = [row for row in rows if row["every"] == EVERY]
    above = sum(row["ratio"]["of_best"] > row["target"] for row in judged)
    differ = max(row["forces_differ"] for row in rows)
    print(f"{above} of {len(judged)} pairs above target; all forces agree to {differ:.0e} of their peak")
    if args.json:
        args.json.write_text(json.dumps({"rows": rows}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
