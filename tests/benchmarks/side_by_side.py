"""Two blocks in the plane and a ball on a wall: percuss and other programs, in one table.

    python tests/benchmarks/side_by_side.py [--programs NAME ...] [--python NAME=PATH ...] [--cases CASE ...]
        [--keep FOLDER] [--repeats N] [--write]

All programs have the nodes, cells, densities and time step of percuss; where a method takes longer steps, its row says
so. For other programs, the wall under the ball is a block whose nodes are all held. A program gives the momentum of the
struck body after each step, the second of the blocks or the ball, along the direction of impact, and the final
displacement and velocity of all nodes. From these percuss computes alike for all:

- the force, as change of momentum over a step, its peak, and its mean, as impulse over contact time;
- the contact time, as the time of the steps whose force is above a thousandth of the known peak;
- the restitution, from the impulse and the masses;
- the energy at the end over that at the start, with the lumped masses and the stiffness of percuss;
- the true error of the force in L1, each force against the mean exact force of its step, where that is known.

The time of an element-step is the CPU time of all steps over their number and the number of elements, with one thread;
that of CalculiX is the time of its whole run.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import percuss
from percuss.blas import ONE_THREAD, one_blas_thread
from percuss.certificate import verdict
from percuss.march.march import March
from percuss.results.exact import exact_solution
from percuss.results.true_error import contact_errors

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
import pages

HERE = Path(__file__).resolve().parent

CASES = {
    "blocks": HERE / "programs" / "blocks.yaml",
    "ball": HERE.parents[1] / "cases" / "ball-on-wall-3d.yaml",
}
STEP: dict[str, dict[str, Any]] = {"blocks": {}, "ball": {"time.courant": 0.8}}  # which all programs can take
TITLES = {"blocks": "Two blocks in the plane", "ball": "A quarter of a ball on a wall"}
AXIS = {"blocks": 0, "ball": 2}  # direction of the impact
HEAD = (
    "program", "method", "mean force", "peak", "contact time", "restitution", "energy kept", "force L1",
    "ns per element-step",
)  # fmt: skip
LOW = 0.06  # height up to which the surface of the ball can meet the wall
WALL = (-0.25, 0.75)  # sides of the wall, along x and y, around the place of contact of the ball
WALL_CELLS = ([0, 1, 3, 7], [0, 5, 1, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 6, 4, 7])  # of a cube
LONGEST = 600  # seconds of a run of another program


class Known(NamedTuple):
    """Peak of the force and duration of the contact, exact or converged, as the case says."""

    peak: float
    duration: float


KNOWN = {"blocks": Known(0.025, 2.0), "ball": Known(0.00343795, 11.5356)}
SMALL = 1e-3  # of the known peak: less is no contact
CENTRAL = {"integrator": "central-difference", "contact": "penalty"}
OWN: dict[str, dict[str, dict[str, Any]]] = {
    "blocks": {"Wu's predictor-corrector, Lagrange, mortar (defaults)": {},
               "central difference, penalty, mortar": CENTRAL},
    "ball": {"Wu's predictor-corrector, Lagrange at nodes (of the case)": {},
             "central difference, penalty, Gauss points": {**CENTRAL, "pairing": "gauss-points"}},
}  # fmt: skip


class Program(NamedTuple):
    """Another program: its script, how it is installed, and each of its methods in words, by case and name."""

    script: str
    install: str
    methods: dict[str, dict[str, str]]


PROGRAMS = {
    "calculix": Program(
        "solids_with_calculix.py",
        "apt-get install calculix-ccx",
        {
            "blocks": {
                "implicit-penalty": "implicit (HHT, alpha 0), penalty from face to face",
                "explicit-penalty": "explicit, penalty from node to face",
                "explicit-massless": "explicit, massless contact",
            },
            "ball": {"implicit-penalty": "implicit (HHT, alpha 0, 16 steps in one), penalty from face to face"},
        },
    ),
    "fedoo": Program(
        "solids_with_fedoo.py",
        "pip install fedoo",
        {
            "blocks": {"explicit-penalty": "explicit (central difference), penalty from node to segment"},
            "ball": {"explicit-penalty": "explicit (central difference), penalty from node to facet"},
        },
    ),
    "akantu": Program(
        "solids_with_akantu.py",
        "pip install 'percuss[side-by-side]'",
        {
            "blocks": {"explicit-penalty": "explicit (central difference), penalty from node to segment, both ways"},
            "ball": {"explicit-penalty": "explicit (central difference), penalty from node to facet"},
        },
    ),
    "kratos": Program(
        "solids_with_kratos.py",
        "pip install KratosContactStructuralMechanicsApplication KratosLinearSolversApplication",
        {
            "blocks": {
                "implicit-alm": "implicit (Bossak), augmented Lagrangian, mortar",
                "implicit-penalty": "implicit (Bossak), penalty, mortar",
                "explicit-penalty": "explicit (central difference), penalty, mortar",
            },
            "ball": {
                "implicit-alm": "implicit (Bossak, 32 steps in one), augmented Lagrangian, mortar",
                "explicit-penalty": "explicit (central difference), penalty, mortar",
            },
        },
    ),
}


class Row(NamedTuple):
    """One line of the table; `told` stands for the numbers where there are none."""

    case: str
    program: str
    method: str
    mean: float = np.nan
    peak: float = np.nan
    contact_time: float = np.nan
    restitution: float = np.nan
    energy: float = np.nan
    force_error: float | None = None
    element_step: float = np.nan
    told: str = ""


def model_of(case: str, method: dict[str, Any]) -> Any:
    """Return the model of a case of percuss with a method."""
    changed = {f"method.{key}": value for key, value in method.items()}
    return verdict.settled(percuss.load(CASES[case], {**changed, **STEP[case]})).model


def problem_of(case: str, model: Any) -> dict[str, Any]:
    """Return the impact in the words of the scripts (`programs`)."""
    bodies = []
    fixed = []
    for body in model.bodies.values():
        ((_, cells),) = body.mesh.cells.items()
        material = body.spec.material
        bodies.append(
            {
                "name": body.name, "young": material.modulus, "poisson": material.poisson, "density": material.rho,
                "first_node": body.start, "nodes": body.mesh.nodes.tolist(),
                "cells": (cells + body.start).tolist(), "velocity": body.velocity.tolist(),
            }
        )  # fmt: skip
        for region, axis in body.spec.supports:
            nodes = [body.start + node for node in body.mesh.regions[region].nodes]
            fixed += [[node, k] for node in nodes for k in (range(model.bodies.dim) if axis is None else [axis])]
    sides = {"blocks": ("left.right", "right.left"), "ball": ("ball.skin",)}[case]
    surfaces = []
    for side in sides:
        name, _, region = side.partition(".")
        body = model.bodies[name]
        (facets,) = body.mesh.regions[region].facets.values()
        if case == "ball":  # the rest of its surface stays away from the wall
            facets = facets[(body.mesh.nodes[facets, AXIS[case]] < LOW).all(axis=1)]
        surfaces.append((facets + body.start).tolist())
    nodes = int(model.bodies.mass.size)
    struck = [bodies[-1]["first_node"], nodes]
    if case == "ball":  # other programs meet the wall as a block of tetrahedra, all of whose nodes are held
        bodies.append({**bodies[0], "name": "wall", "first_node": nodes, "velocity": [0.0] * 3,
                       "nodes": [[WALL[k & 1], WALL[k >> 1 & 1], float(k >> 2) - 1.0] for k in range(8)],
                       "cells": [[nodes + k for k in cell] for cell in WALL_CELLS]})  # fmt: skip
        fixed += [[nodes + node, axis] for node in range(8) for axis in range(3)]
        surfaces.append([[nodes + 4, nodes + 5, nodes + 7], [nodes + 4, nodes + 7, nodes + 6]])
    return {
        "case": case, "axis": AXIS[case], "bodies": bodies, "fixed": sorted(fixed), "surfaces": surfaces,
        "struck": struck, "mass": model.bodies.mass.tolist(), "dt": model.dt, "steps": model.steps,
    }  # fmt: skip


def judged(case: str, model: Any, moment: Any, force: Any) -> dict[str, Any]:
    """Return what a force history shows; `moment` has the middles of the steps over which the forces act."""
    first = next(iter(model.bodies.values()))
    approach = abs(float(first.velocity[AXIS[case]]))
    inverse = sum(1.0 / float(body.mass.sum()) for body in model.bodies.values())
    known = KNOWN[case]
    middle = np.abs(moment / known.duration - 0.5) < 0.4
    shown = {
        "mean": float(force[middle].mean()),
        "peak": float(force.max()),
        "contact_time": float((force > SMALL * known.peak).sum()) * model.dt,
        "restitution": float(force.sum()) * model.dt * inverse / approach - 1.0,
    }
    solution, _, _ = exact_solution(model, (model.steps + 1) * model.dt)
    if solution is not None:
        (contact,) = solution.contacts.values()
        exact = contact.mean_force(moment - 0.5 * model.dt, moment + 0.5 * model.dt)
        errors = contact_errors(contact, moment, force, exact, model.dt, solution.reached, every=1)
        shown["force_error"] = errors["force_error_l1"] or np.nan
    return shown


def with_percuss(case: str, name: str, repeats: int) -> Row:
    """Return the row of a method of percuss."""
    method = OWN[case][name]
    changed = {f"method.{key}": value for key, value in method.items()}
    result = percuss.run(percuss.load(CASES[case], {**changed, **STEP[case], "record.every": 1}))
    model = model_of(case, method)
    march = March(model)
    march.compile()
    seconds = np.inf
    for _ in range(repeats):
        march = march.again()
        started = time.process_time()
        march.run(None)
        seconds = min(seconds, time.process_time() - started)
    histories = result.histories
    (force,) = histories["contact_force"].values.reshape(len(histories["time"]), -1).T
    energy = result.summary["energy"]
    return Row(
        case,
        f"percuss {percuss.__version__}",
        name,
        **judged(case, model, histories["time"].values, force),
        energy=energy["final"] / energy["initial"],
        element_step=seconds / model.steps / sum(body.count for body in model.bodies.values()),
    )


def called(python: str, script: str, *arguments: str, longest: float | None = None) -> subprocess.CompletedProcess[str]:
    """Return the finished process of a script with one thread of BLAS, ended after `longest` seconds."""
    environment = os.environ | ONE_THREAD
    command = [python, str(HERE / "programs" / script), *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, env=environment, check=False, timeout=longest)
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command, 1, "", f"it took more than {longest:.0f} s")
    except OSError as error:
        return subprocess.CompletedProcess(command, 1, "", str(error))


def pythons_of(parser: argparse.ArgumentParser, pairs: Iterable[str], names: Collection[str]) -> dict[str, str]:
    """Return the Python of each program that pairs NAME=PATH name; end with exit code 2 where one is wrong."""
    found = {}
    for pair in pairs:
        name, _, path = pair.partition("=")
        if name not in names or not path:
            parser.error(f"expected NAME=PATH with a name among {', '.join(names)}, found {pair!r}")
        found[name] = path
    return found


def last_line(done: subprocess.CompletedProcess[str]) -> str:
    """Return the last line that a failed process wrote."""
    return ((done.stderr + done.stdout).strip().splitlines() or ["no message"])[-1].strip()


def energy_of(model: Any, displacement: Any, velocity: Any) -> float:
    """Return the kinetic and the elastic energy of a state."""
    energy = 0.5 * float(model.bodies.mass @ (velocity**2).sum(axis=1))
    for body in model.bodies.values():
        own = displacement[body.start : body.stop].ravel()
        energy += 0.5 * float(own @ (body.stiffness_matrix() @ own))
    return energy


def others(case: str, name: str, python: str, keep: Path) -> Iterator[Row]:
    """Yield a row for each method of another program, whose input stays in a folder of its own below `keep`."""
    program = PROGRAMS[name]
    done = called(python, program.script, "--version")
    version = done.stdout.split()[-1] if done.returncode == 0 else ""
    model = model_of(case, {})
    for method, words in program.methods[case].items():
        folder = keep / f"{case}-{name}-{method}"
        folder.mkdir(parents=True, exist_ok=True)
        problem = folder / "problem.json"
        problem.write_text(json.dumps(problem_of(case, model)), encoding="utf-8")
        shutil.copy(HERE / "programs" / program.script, folder)
        if not version:
            yield Row(case, name, words, told=f"not installed: {program.install}")
            continue
        (folder / "result.json").unlink(missing_ok=True)
        done = called(python, program.script, str(problem), str(folder), method, longest=LONGEST)
        if done.returncode:
            yield Row(case, f"{name} {version}", words, told=f"failed: {last_line(done)}")
            continue
        found = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        momentum = np.array(found["momentum"])
        own = slice(model.bodies.mass.size)  # without the wall
        displacement, velocity = np.array(found["displacement"])[own], np.array(found["velocity"])[own]
        if not (np.isfinite(momentum).all() and np.isfinite(displacement).all() and np.isfinite(velocity).all()):
            yield Row(case, f"{name} {version}", words, told="the motion is not finite")
            continue
        force = np.diff(momentum) / model.dt
        moment = (np.arange(force.size) + 0.5) * model.dt
        start = energy_of(model, 0.0 * displacement, np.concatenate([b.nodal_velocity for b in model.bodies.values()]))
        yield Row(
            case,
            f"{name} {version}",
            words,
            **judged(case, model, moment, force),
            energy=energy_of(model, displacement, velocity) / start,
            element_step=found["seconds"]
            / found.get("steps", model.steps)
            / sum(body.count for body in model.bodies.values()),
        )


def table(rows: list[Row]) -> str:
    """Return the rows as tables of Markdown, one for each case."""
    parts = []
    for case, (peak, duration) in KNOWN.items():
        known = f"{'exact' if case == 'blocks' else 'converged'}: peak {peak:.6g}, contact time {duration:.6g}"
        lines = []
        for row in rows:
            if row.case != case:
                continue
            if row.told:
                numbers = [row.told.replace("|", "/"), *[""] * 6]
            else:
                error = "" if row.force_error is None else f"{row.force_error:.1%}"
                numbers = [
                    f"{row.mean:.4g}", f"{row.peak:.4g}", f"{row.contact_time:.4g}", f"{row.restitution:.4f}",
                    f"{row.energy:.2%}", error, f"{1e9 * row.element_step:.0f}",
                ]  # fmt: skip
            lines.append((row.program, row.method, *numbers))
        parts.append(f"{TITLES[case]} ({known})\n\n{pages.table(HEAD, lines)}")
    return "\n".join(parts)


def rows_of(cases: list[str], names: list[str], pythons: dict[str, str], keep: Path, repeats: int) -> list[Row]:
    """Return all rows: those of percuss and of the named programs."""
    rows = []
    for case in cases:
        rows += [with_percuss(case, name, repeats) for name in OWN[case]]
        for name in names:
            rows += others(case, name, pythons.get(name, sys.executable), keep)
    return rows


@one_blas_thread()
def main() -> None:
    """Print the table; keep the input of each program in a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", nargs="*", choices=PROGRAMS, default=list(PROGRAMS))
    parser.add_argument("--python", nargs="+", default=[], metavar="NAME=PATH", help="the Python of a program")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--keep", type=Path, default=Path("side-by-side"), help="folder of the inputs and results")
    parser.add_argument("--repeats", type=int, default=5, help="runs of percuss, of which the fastest counts")
    parser.add_argument("--write", action="store_true", help="write the table into tests/README.md")
    given = parser.parse_args()
    pythons = pythons_of(parser, given.python, PROGRAMS)
    text = table(rows_of(given.cases, given.programs, pythons, given.keep.resolve(), given.repeats))
    text += f"\n{pages.made_here()}\n"
    print(text, end="")
    if given.write:
        pages.write("solids side by side", f"\n{text}")


if __name__ == "__main__":
    main()
