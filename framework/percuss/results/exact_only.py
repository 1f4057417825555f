"""The exact solution of a case alone, without a march."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from percuss.blas import one_blas_thread
from percuss.case.case import Case
from percuss.contact.contact_problem import contact_problem
from percuss.errors import wrong_input
from percuss.jsonable import Entries, plain
from percuss.march.model_of_case import model_of
from percuss.march.recording import refuse_large
from percuss.mesh.body import Body
from percuss.mesh.spots import shares_at
from percuss.methods.interfaces import Exact, Floats, ProblemBody
from percuss.results.exact import ROUND_OFF, exact_solution
from percuss.results.provenance import components_used, provenance_of
from percuss.results.result import Result
from percuss.results.true_error import summary_entries

SAMPLES = 2001  # of each history
FIELD_POINTS = 200  # points of the stress field per bar


@one_blas_thread()
@np.errstate(all="ignore")  # an overflow is told as what it makes of the solution
def run_exact(case: Case) -> Result:
    """Return forces, gaps, motion and stresses of the exact solution of a case, up to the time that it reaches.

    Raises
    ------
    InputError
        If no registered solution covers the case.
    """
    started = time.perf_counter()
    model = model_of(case)
    refuse_large(case, case.record.fields, FIELD_POINTS * len(model.bodies))
    solution, name, reason = exact_solution(model, case.time.end or model.steps * model.dt)
    if solution is None:
        raise wrong_input(case.origin.name, f"no exact solution covers this case: {reason}")
    problem: Any = contact_problem(model)
    bars: Mapping[str, ProblemBody] = problem.bodies
    facts: Any = {"solution": name, "fronts": solution.fronts, "reached": solution.reached}
    t, contacts = np.linspace(0.0, solution.reached, SAMPLES), [solution.contacts[name] for name in case.contacts]
    motion = {
        quantity: np.zeros((t.size, len(case.recorded_ends), model.dim)) for quantity in ("displacement", "velocity")
    }
    for k, address in enumerate(case.recorded_ends):
        bar, body = bars[address.body], model.bodies[address.body]
        x = np.full(t.shape, _place(body, address, bar))
        for quantity, values in motion.items():
            values[:, k] = np.outer(getattr(solution, quantity)(body.name, x, t), bar.direction)
    arrays = {
        "time": t,
        "contact_force": np.array([contact.force(t) for contact in contacts]).reshape(len(contacts), t.size).T,
        "gap": np.array([contact.gap(t) for contact in contacts]).reshape(len(contacts), t.size).T,
        **motion,
    }
    starts = {name: _start(model.bodies[name], bar) for name, bar in bars.items()}
    summary = {
        "status": "interrupted" if reason else "done",
        "end": solution.reached,
        "contacts": {name: _contact(solution, name) for name in case.contacts},
        **summary_entries(facts, reason),
        "notes": list(case.notes),
        "seconds": {"total": time.perf_counter() - started},
    }
    provenance = provenance_of(model, components_used(case, solution=name))
    provenance["geometry"]["bodies"] = {
        name: [starts[name].tolist(), (starts[name] + bar.length * bar.direction).tolist()]
        for name, bar in bars.items()
    }
    coordinates = {"contact": list(case.contacts), "probe": [str(address) for address in case.recorded_ends]}
    fields = _fields(solution, bars, starts, case.record.fields)
    return Result(arrays, coordinates, fields, plain(summary), provenance, solution)


def _place(body: Body, probe: Any, bar: ProblemBody) -> float:
    """Return the place of a probe along a body; nan of a side, which is at no one place."""
    if not probe.region:
        along, _ = body.along(bar.direction)
        return sum(share * float(along[node - body.start]) for node, share in shares_at(body, probe))
    outward = sum(float(vector @ bar.direction) for _, vector in body.outward(probe.region))
    return np.nan if abs(outward) < 1e-9 * bar.area else bar.length if outward > 0.0 else 0.0


def _start(body: Body, bar: ProblemBody) -> Floats:
    """Return a node at the start of a body along the line, (dim,)."""
    start: Floats = body.mesh.nodes[np.argmin(body.mesh.nodes @ bar.direction)]
    return start


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


def _fields(solution: Exact, bars: Mapping[str, ProblemBody], starts: Mapping[str, Floats], snapshots: int) -> Entries:
    """Return the stress field at the times of the snapshots that a run would take; empty if it takes none."""
    if not snapshots:
        return {}
    t, share = np.linspace(0.0, solution.reached, snapshots), (np.arange(FIELD_POINTS) + 0.5) / FIELD_POINTS
    at = {name: share * bar.length for name, bar in bars.items()}
    stresses = [solution.stress(name, *np.broadcast_arrays(x[None, :], t[:, None])) for name, x in at.items()]
    return {
        "time": t,
        "body": [name for name in bars for _ in share],
        "position": np.concatenate([starts[name] + x[:, None] * bars[name].direction for name, x in at.items()]),
        "stress": np.concatenate(stresses, axis=1),
    }
