"""percuss and other programs on one impact: true error, energy kept and time, in one table.

    python tests/benchmarks/side_by_side.py [--programs NAME ...] [--python NAME=PATH ...] [--refine N] [--repeats N]

The impact is that of cases/hunek.yaml: a bar hits one that is fixed at its far end. All have the same elements, lumped
masses and time step, and the spring of the `penalty` of percuss where they have a spring. The errors are those of
percuss, against the exact solution: of the contact force in L1, each force against the mean exact force of the step on
which it acts, and of the final displacement in L2. The energy is that of the bars at the end over that at the start;
leap-frog schemes have the one that they conserve, with the velocity between the last two displacements. The time of a
step is the CPU time of all steps over their number, least of the repeats, with one thread. Where a program is driven
from Python in each step, that is part of its time, and the table says so.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import percuss
from percuss.blas import ONE_THREAD, one_blas_thread
from percuss.certificate import verdict
from percuss.march.march import March
from percuss.results.exact import exact_solution
from percuss.results.true_error import contact_errors, displacement_error

HERE = Path(__file__).resolve().parent
HUNEK = HERE.parents[1] / "cases" / "hunek.yaml"
SYSTEM_PYTHON = "/usr/bin/python3"  # of packages of Debian


class Program(NamedTuple):
    """Another program: how it solves the impact, its script, how it is installed, and its usual Python."""

    method: str
    script: str
    install: str
    python: str = sys.executable


PROGRAMS = {
    "opensees": Program(
        "ExplicitDifference, spring without tension; all steps in one call, forces to a file",
        "with_opensees.py",
        "pip install 'percuss[side-by-side]'",
    ),
    "akantu": Program(
        "explicit_lumped_mass, spring; a call for each step, the spring in Python",
        "with_akantu.py",
        "pip install 'percuss[side-by-side]'",
    ),
    "siconos": Program(
        "Moreau-Jean (theta 1/2, implicit, full matrices), impact law e = 0; a call for each step",
        "with_siconos.py",
        "apt-get install python3-siconos",
        SYSTEM_PYTHON,
    ),
}
PENALTY = {"name": "penalty"}
OWN = {
    "central difference, penalty": {"integrator": "central-difference", "contact": PENALTY},
    "central difference, Lagrange multipliers": {"integrator": "central-difference", "contact": "lagrange"},
    "Wu's predictor-corrector, penalty": {"integrator": "wu-predictor-corrector", "contact": PENALTY},
}


class Row(NamedTuple):
    """One line of the table: errors and energy as fractions, CPU time of a step [s]."""

    program: str
    method: str
    force_error: float
    displacement_error: float
    energy: float
    seconds: float


def impact(refine: int, method: dict[str, Any]) -> percuss.Case:
    """Return the case of the impact with a method."""
    return percuss.load(
        HUNEK, {"method.integrator": method["integrator"], "method.contact": method["contact"], "refine": refine}
    )


def problem_of(model: Any) -> dict[str, Any]:
    """Return the impact in the words of the scripts (`programs`)."""
    bars = [
        {
            "at": float(body.mesh.nodes[0, 0]), "length": float(body.mesh.lengths.sum()),
            "elements": int(body.mesh.lengths.size), "young": body.spec.material.modulus,
            "density": body.spec.material.rho, "area": body.spec.area, "velocity": float(body.velocity[0]),
        }
        for body in model.bodies.values()
    ]  # fmt: skip
    law = model.laws[0].linear
    return {"bars": bars, "dt": model.dt, "steps": model.steps, "penalty": float(1.0 / law.sigma[0])}


def with_percuss(method: str, refine: int, repeats: int) -> Row:
    """Return the row of a method of percuss."""
    result = percuss.run(impact(refine, OWN[method]))
    model = verdict.settled(impact(refine, OWN[method])).model
    march = March(model)
    march.compile()
    seconds = np.inf
    for _ in range(max(repeats, 5)):
        march = march.again()
        started = time.process_time()
        march.run(None)
        seconds = min(seconds, time.process_time() - started)
    (contact,) = result.summary["exact"]["contacts"].values()
    energy = result.summary["energy"]
    return Row(
        f"percuss {percuss.__version__}",
        method,
        contact["force_error_l1"],
        result.summary["exact"]["displacement_error"],
        energy["final"] / energy["initial"],
        seconds / model.steps,
    )


def elastic_and_kinetic(model: Any, displacement: Any, other: Any, velocity: Any) -> float:
    """Return the kinetic energy of a velocity plus the elastic energy as a product of two displacements, or of one."""
    energy = 0.5 * float(model.bodies.mass @ velocity**2)
    for body in model.bodies.values():
        here = slice(body.start, body.stop)
        energy += 0.5 * float(body.stiffness @ (np.diff(displacement[here]) * np.diff(other[here])))
    return energy


def judged(name: str, version: str, model: Any, solution: Any, found: dict[str, Any], seconds: float) -> Row:
    """Return the row of another program, with the errors that percuss takes of its own runs."""
    dt = model.dt
    middle, force = np.array(found["time"]), np.array(found["force"])
    (contact,) = solution.contacts.values()
    exact = contact.mean_force(middle - 0.5 * dt, middle + 0.5 * dt)
    errors = contact_errors(contact, middle, force, exact, dt, solution.reached, every=1)
    u = np.array(found["displacement"])
    if "before" in found:
        before = np.array(found["before"])
        energy = elastic_and_kinetic(model, u, before, (u - before) / dt)
    else:
        energy = elastic_and_kinetic(model, u, u, np.array(found["velocity"]))
    start = 0.5 * sum(float(body.mass.sum()) * float(body.velocity @ body.velocity) for body in model.bodies.values())
    away = displacement_error(model, solution, u[:, None], model.steps * dt)
    if errors["force_error_l1"] is None or away is None:
        raise SystemExit("the impact has no contact force or no displacement at its end")
    return Row(
        f"{name} {version}",
        PROGRAMS[name].method,
        errors["force_error_l1"],
        away,
        energy / start,
        seconds / model.steps,
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


def versions(names: list[str], pythons: dict[str, str]) -> dict[str, str]:
    """Return the versions of the programs; end with exit code 2 and what to install where one is missing."""
    found, missing = {}, []
    for name in names:
        done = called(pythons[name], PROGRAMS[name].script, "--version")
        if done.returncode == 0:
            found[name] = done.stdout.split()[-1]
        else:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            missing.append(f"  {name}: {PROGRAMS[name].install}\n    {pythons[name]} says: {last}")
    if missing:
        there = " ".join(found) or "none of them"
        print(
            "These programs are missing; nothing was run. Install them, name their Python with --python NAME=PATH, or "
            f"choose with --programs those that are there ({there}):\n" + "\n".join(missing),
            file=sys.stderr,
        )
        raise SystemExit(2)
    return found


def others(names: list[str], pythons: dict[str, str], refine: int, repeats: int) -> list[Row]:
    """Return a row for each program, each of whose runs is a process of its own."""
    version = versions(names, pythons)
    model = verdict.settled(impact(refine, OWN["central difference, penalty"])).model
    solution, _, reason = exact_solution(model, (model.steps + 1) * model.dt)
    if solution is None:
        raise SystemExit(f"no exact solution: {reason}")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        problem, result = Path(folder) / "problem.json", Path(folder) / "result.json"
        problem.write_text(json.dumps(problem_of(model)), encoding="utf-8")
        for name in names:
            seconds, found = np.inf, {}
            for _ in range(repeats):
                done = called(pythons[name], PROGRAMS[name].script, str(problem), str(result))
                if done.returncode:
                    raise SystemExit(f"{name} failed:\n{done.stderr[-2000:]}")
                found = json.loads(result.read_text(encoding="utf-8"))
                seconds = min(seconds, found["seconds"])
            rows.append(judged(name, version[name], model, solution, found, seconds))
    return rows


@one_blas_thread()
def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", nargs="+", choices=PROGRAMS, default=list(PROGRAMS))
    parser.add_argument("--python", nargs="+", default=[], metavar="NAME=PATH", help="the Python of a program")
    parser.add_argument("--refine", type=int, default=1, help="elements for each one of the case")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    pythons = {name: program.python for name, program in PROGRAMS.items()} | pythons_of(parser, given.python, PROGRAMS)
    if given.refine < 1 or given.repeats < 1:
        parser.error("expected --refine and --repeats of at least 1")
    rows = others(given.programs, pythons, given.refine, given.repeats)
    rows = [*(with_percuss(method, given.refine, given.repeats) for method in OWN), *rows]
    print(f"{'program':20}{'force L1':>10}{'displ. L2':>11}{'energy':>10}{'step':>11}   method")
    for row in rows:
        print(
            f"{row.program:20}{row.force_error:10.3%}{row.displacement_error:11.3%}{row.energy:10.4%}"
            f"{1e6 * row.seconds:8.1f} us   {row.method}"
        )


if __name__ == "__main__":
    main()
