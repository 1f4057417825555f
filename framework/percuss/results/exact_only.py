"""The exact solution of a case as a result of its own, without methods, time step or elements."""

from __future__ import annotations

import itertools
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from percuss.blas import one_blas_thread
from percuss.case.case import Case
from percuss.contact.contact_problem import contact_problem
from percuss.contact.model import Model
from percuss.errors import wrong_input
from percuss.jsonable import Data, Entries, plain
from percuss.listeners import progress
from percuss.march.model_of_case import model_of
from percuss.march.recording import refuse_large
from percuss.mesh.body import Body
from percuss.mesh.spots import shares_at
from percuss.methods.interfaces import Exact, Floats, ProblemBody
from percuss.results.exact import ROUND_OFF, exact_solution
from percuss.results.provenance import components_used, provenance_of
from percuss.results.result import Result
from percuss.results.true_error import summary_entries

SAMPLES, FEWEST_SAMPLES = 2001, 101
# Seconds that the energies of all samples may take, and that those of a front and of a bar take at one time. They are
# numbers and no measurements, so that a solution has the same samples on every machine.
ENERGY_SECONDS, SECONDS_PER_FRONT, SECONDS_PER_BAR = 10.0, 0.3e-6, 40e-6
FEWER = "the histories have fewer samples than usual, as so many waves or bars make their energies slow to compute"
FIELD_POINTS = 200  # points of the stress field per bar


def load_for_exact(path: str | Path, overrides: Data | None = None, *, plugins: Sequence[str | Path] = ()) -> Case:
    """Return a case whose file may leave out the elements and the time step; see `percuss.load`."""
    from percuss.case.case import load, registry_of
    from percuss.case.source import Source

    source = Source.read(path)
    bodies = source.get(("bodies",))
    registry = registry_of(source, tuple(Path(file) for file in plugins))
    names = bodies if isinstance(bodies, Mapping) else ()
    for name, shape in itertools.product(names, registry.names("shapes")):
        section = source.get(("bodies", name, shape))
        mesh_defaults = dict(registry.get("shapes", shape).without_mesh)  # type: ignore[attr-defined]
        if isinstance(section, Mapping) and not set(mesh_defaults) <= set(section):
            source = source.replaced(("bodies", name, shape), {**mesh_defaults, **section})
    section = source.get(("time",))
    if isinstance(section, Mapping) and not {"courant", "step"} & set(section):
        source = source.replaced(("time",), {**section, "courant": 1})
    return load(source, overrides, plugins=plugins)


@one_blas_thread()
@np.errstate(all="ignore")  # an overflow is told as what it makes of the solution
def run_exact(case: Case) -> Result:
    """Return the exact solution of a case up to its end, or up to the time that the solution reaches.

    Raises
    ------
    InputError
        If no registered solution covers the case.
    """
    started = time.perf_counter()
    model = model_of(case)
    refuse_large(case, case.record.fields, FIELD_POINTS * len(model.bodies))
    end = case.time.end if case.time.end is not None else model.steps * model.dt
    solution, name, reason = exact_solution(model, end)
    if solution is None:
        raise wrong_input(case.origin.name, f"no exact solution covers this case: {reason}")
    solved = time.perf_counter() - started
    names = list(model.case.contacts)
    arrays = _histories(model, solution, names)
    facts: Any = {"solution": name, "fronts": solution.fronts, "reached": solution.reached}
    summary = {
        "status": "interrupted" if reason else "done",
        "end": solution.reached,
        "contacts": {contact: _contact(solution, contact) for contact in names},
        "energy": _energy(solution, arrays),
        "momentum": _momentum(model, solution),
        **summary_entries(facts, reason),
        "notes": [*case.notes, *([FEWER] if arrays["time"].size < SAMPLES else [])],
        "seconds": {"total": time.perf_counter() - started, "exact": solved},
    }
    # Methods from single files change nothing, but without them nobody can read the case again.
    of_files = [key for key in components_used(case) if not case.registry.sources[key].distribution]
    components = sorted({*components_used(case, methods=False, solution=name), *of_files})
    provenance = provenance_of(model, components)
    provenance["geometry"]["bodies"] = {
        body.name: [_start(model, body).tolist(), (_start(model, body) + body.length * body.direction).tolist()]
        for body in _bars(model).values()
    }
    coordinates = {"contact": names, "probe": [str(address) for address in case.recorded_ends]}
    return Result(arrays, coordinates, _field(model, solution), plain(summary), provenance, solution)


def _bars(model: Model) -> Mapping[str, ProblemBody]:
    """Return the bodies as bars, of a case that an exact solution covers."""
    problem: Any = contact_problem(model)
    bodies: Mapping[str, ProblemBody] = problem.bodies
    return bodies


def _place(body: Body, probe: Any, bar: ProblemBody) -> float:
    """Return the place of a probe along a body; nan of a side, which is at no one place."""
    if not probe.region:
        along, _ = body.along(bar.direction)
        return sum(share * float(along[node - body.start]) for node, share in shares_at(body, probe))
    outward = sum(float(vector @ bar.direction) for _, vector in body.outward(probe.region))
    return np.nan if abs(outward) < 1e-9 * bar.area else bar.length if outward > 0.0 else 0.0


def _start(model: Model, bar: ProblemBody) -> Floats:
    """Return a node at the start of a body along the line, (dim,)."""
    nodes = model.bodies[bar.name].mesh.nodes
    start: Floats = nodes[np.argmin(nodes @ bar.direction)]
    return start


def _sample_count(model: Model, solution: Exact) -> int:
    """Return the number of samples: fewer where the energies of all fronts and bars at as many times take too long."""
    affordable = ENERGY_SECONDS / (SECONDS_PER_FRONT * solution.fronts + SECONDS_PER_BAR * len(model.bodies))
    return int(min(max(affordable, FEWEST_SAMPLES), SAMPLES))


def _histories(model: Model, solution: Exact, names: list[str]) -> Entries:
    """Return samples of the exact solution.

    Names are those of the histories of a run, so that both are drawn and compared alike.
    """
    t, bodies = np.linspace(0.0, solution.reached, _sample_count(model, solution)), _bars(model)
    ends = model.case.recorded_ends
    motion = {quantity: np.zeros((t.size, len(ends), model.dim)) for quantity in ("displacement", "velocity")}
    for k, address in enumerate(ends):
        body = bodies[address.body]
        x = _place(model.bodies[address.body], address, body)
        for quantity, values in motion.items():
            along = getattr(solution, quantity)(body.name, np.full(t.shape, x), t)
            values[:, k] = along[:, None] * body.direction
    energies = np.zeros((t.size, 2))
    for k, instant in enumerate(t):
        energies[k] = solution.energy(float(instant))
        progress(k / t.size)
    work = np.zeros(t.size)
    if model.case.loads:
        work = np.array([solution.work(float(instant)) for instant in t])
    total = energies.sum(axis=1)
    closure = total - total[0] - work
    largest = np.maximum.accumulate(np.maximum(np.abs(total), np.abs(work)))
    contacts = [solution.contacts[name] for name in names]
    return {
        "time": t,
        "contact_force": np.array([contact.force(t) for contact in contacts]).reshape(len(names), t.size).T,
        "gap": np.array([contact.gap(t) for contact in contacts]).reshape(len(names), t.size).T,
        **motion,
        "kinetic_energy": energies[:, 0],
        "elastic_energy": energies[:, 1],
        "external_work": work,
        "energy_error": np.divide(closure, largest, out=np.zeros_like(closure), where=largest > 0),
    }


def _contact(solution: Exact, name: str) -> Entries:
    contact, closed = solution.contacts[name], solution.contacts[name].closed
    return {
        "impulse": float(contact.impulse(np.array(solution.reached))),
        "peak_force": max(float(contact.largest_force(0.0, solution.reached)), 0.0) if closed else 0.0,
        "first_closed": closed[0][0] if closed else None,
        "last_open": closed[-1][1] if closed and closed[-1][1] < solution.reached * (1.0 - ROUND_OFF) else None,
        "closed_time": float(sum(stop - start for start, stop in closed)),
        "closed": [list(interval) for interval in closed[:100]],
    }


def _energy(solution: Exact, arrays: Entries) -> Entries:
    total = arrays["kinetic_energy"] + arrays["elastic_energy"]
    return {
        "initial": float(total[0]),
        "final": float(total[-1]),
        "max": max(float(solution.largest_energy()), float(total[0]), float(total[-1])),
        "external_work": float(solution.work(solution.reached)),
        "ledger_error": float(np.abs(arrays["energy_error"]).max()),
    }


def _momentum(model: Model, solution: Exact) -> Entries:
    """Return the momentum along the axis of the first body, the impulse of external forces, and the balance error."""
    axis = next(iter(_bars(model).values())).direction
    before, after = solution.momentum(0.0), solution.momentum(solution.reached)
    impulse = solution.impulse(solution.reached)
    scale = max(abs(before), abs(after), abs(impulse), _momentum_scale(model, solution))
    return {
        "initial": (before * axis).tolist(),
        "final": (after * axis).tolist(),
        "impulse_from_outside": (impulse * axis).tolist(),
        "error": abs(after - before - impulse) / scale if scale > 0 else 0.0,
    }


def _momentum_scale(model: Model, solution: Exact) -> float:
    """Return the scale of momentum: magnitudes of momenta or impulses, the larger, summed over all ends of the bars.

    Signed values cancel: only round-off is left of two equal bars that meet, or of a load and its support.
    """
    t = np.linspace(0.0, solution.reached, SAMPLES)
    moving = pressing = 0.0
    for name, body in _bars(model).items():
        for x in (np.zeros(t.shape), np.full(t.shape, body.length)):
            mass = float(model.bodies[name].mass.sum())
            moving += 0.5 * mass * float(np.abs(solution.velocity(name, x, t)).max())
            pressing += body.area * float(np.trapezoid(np.abs(solution.stress(name, x, t)), t))
    return max(moving, pressing)


def _field(model: Model, solution: Exact) -> Entries:
    """Return the stress field at the times of the snapshots that a run would take."""
    snapshots = model.case.record.fields
    if not snapshots:
        return {}
    t = np.linspace(0.0, solution.reached, snapshots)
    bodies: list[str] = []
    positions, stresses = [], []
    for name, body in _bars(model).items():
        x = (np.arange(FIELD_POINTS) + 0.5) / FIELD_POINTS * body.length
        bodies += [name] * x.size
        positions.append(_start(model, body) + x[:, None] * body.direction)
        stresses.append(solution.stress(name, *np.broadcast_arrays(x[None, :], t[:, None])))
    return {
        "time": t,
        "body": bodies,
        "position": np.concatenate(positions),
        "stress": np.concatenate(stresses, axis=1),
    }
