"""The result of a run: its summary, histories, true errors and notes, put together."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.certificate import cause
from percuss.compiling import Stopwatch
from percuss.jsonable import plain
from percuss.results import energy_growth, ledger, true_error
from percuss.results.exact import exact_solution, sampled
from percuss.results.provenance import machine, plugins_used
from percuss.results.result import Result
from percuss.solver.bodies import stress_field
from percuss.solver.march import GROWTH, March, Outcome
from percuss.solver.model import Model, resolved_methods
from percuss.solver.recording import field_elements
from percuss.solver.stop import Stop

AGAINST, NOT_VALID = "the certificate says no", "not a valid result"  # begin the notes that a table must show too


def _where_stopped(model: Model, stop: Stop | None, known: dict[str, Any]) -> dict[str, Any] | None:
    """Return step, time, node and likely cause of a run that was stopped, None of one that was not."""
    if stop is None:
        return None
    body = model.body_of(stop.node)
    return {
        "step": stop.step,
        "time": stop.step * model.dt,
        "node": stop.node,
        "body": body.name,
        "node_in_body": stop.node - body.start,
        "position": [float(x) for x in model.nodes[stop.node]],
        "what": stop.what,
        "cause": cause.likely_cause(stop, known),
    }


def result_of(march: March, outcome: Outcome, known: dict[str, Any]) -> Result:
    """Return the result of a march that was made, or refused.

    Parameters
    ----------
    march, outcome
        The march, and what it left.
    known
        The certificate of the run.
    """
    model = march.model
    rows = outcome.records
    back = np.argsort(np.array(march.order, dtype=np.int64))  # from the order of the loop to that of the case
    dim = march.dim
    probes = model.case.record.probes
    names = (
        [str(a) for a in probes]
        if probes is not None
        else list(dict.fromkeys(str(a) for c in model.case.contacts.values() for a in c.sides))
    )
    arrays: dict[str, Any] = {
        "time": outcome.time[:rows],
        "time_half": outcome.time[:rows] + march.stepper.energy_at * model.dt,
        "contact_force": outcome.record.multiplier[:rows][:, back],
        "gap": outcome.record.gap[:rows][:, back],
        "displacement": outcome.record.displacement[:rows].reshape(rows, len(names), dim),
        "velocity": outcome.record.velocity[:rows].reshape(rows, len(names), dim),
        **ledger.energies(outcome),
    }
    end = outcome.record.end_force[:rows][:, back]
    if end.size and not np.isnan(outcome.points.end_stiffness).all():
        arrays["contact_force_end"] = end
    watch = Stopwatch()
    solution, true_errors = _true_errors(march, outcome, arrays)
    outcome.seconds["exact"] = watch.lap()
    grown = energy_growth.growth_summary(march, outcome, known, ledger.largest(outcome))
    accounts = {
        "energy": ledger.energy_summary(march, outcome),
        "momentum": ledger.momentum_summary(march, outcome),
    }
    if accounts["energy"]["ledger_closed"] is False and grown["kept"]:
        grown["kept"] = None  # the work of contacts is then not what the energy of the bodies gained
    notes = [*model.case.notes, *_warnings(march, outcome, known), *energy_growth.growth_notes(march, outcome, grown)]
    notes += [f"{NOT_VALID}: {words}" for words in ledger.open_accounts(accounts)]
    summary = {
        "status": outcome.status,
        "stop": _where_stopped(march.model, outcome.stop, known),
        "steps": outcome.done,
        "nodes": model.n_nodes,
        "dt": model.dt,
        "end": outcome.done * model.dt,
        "courant": model.courant,
        "certificate": known,
        "contacts": ledger.contact_summary(march, outcome),
        **accounts,
        "energy_growth": grown,
        **true_errors,
        "compiled": outcome.kernels.compiled,
        "compiled_why": list(outcome.kernels.reasons),
        "notes": notes,
        "seconds": outcome.seconds,
    }
    provenance = {
        **machine(),
        "case": model.case.data,
        "resolved": resolved_methods(model),
        "plugins": plugins_used(model.case),
    }
    coordinates = {"contact": [m.name for m in model.contact_pairs], "probe": names}
    result = Result(arrays, coordinates, _fields(march, outcome), plain(summary), plain(provenance))
    result.solution = solution
    return result


def _warnings(march: March, outcome: Outcome, known: dict[str, Any]) -> list[str]:
    """Return what a reader of the result must know: what would have stopped it, had the case not only warned."""
    said = []
    if known["stable"] == "no" and outcome.done > 0:
        said.append(f"{AGAINST}, and the run was made all the same (on_unstable: warn): {known['why']}")
    if known["stable"] == "marginal":
        said.append("at the critical step the highest frequency of the bars may grow with time, with no bound")
    said += march.model.ignored_couplings()
    if march.record.every > 1 and march.model.contact_pairs:
        said.append("true errors of the contact force need `record.every: 1`")
    if march.model.multistage:
        name = march.model.case.method.integrator.name
        said.append(
            f"energy_error is what {name} itself takes from the energy or adds to it; energies are those at t_n+1"
        )
    total = march.boundary.totals[0]
    allowed = GROWTH * (total.began_with + total.largest_work) + march.noise()
    if outcome.status != "unstable" and not total.contact_work <= allowed:
        work = f"{total.contact_work:.6g}"
        said.append(f"{NOT_VALID}: contact added an energy of {work}, far above all that was put in")
    return said


def _true_errors(march: March, outcome: Outcome, arrays: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Hold a run against the exact solution of its case; its histories join `arrays`.

    Returns
    -------
    solution
        None where there is none.
    entries
        Of the summary: ``exact``, ``exact_reason`` and ``exact_covered``.
    """
    model, record = march.model, outcome.record
    if outcome.done == 0:
        return None, true_error.verdict(None, "the run did not get beyond its first step")
    solution, name, reason = exact_solution(model, (outcome.done + 1) * model.dt)
    if solution is None:
        return None, true_error.verdict(None, reason)
    names = [contact_pair.name for contact_pair in model.contact_pairs]
    # what the impulse lambda dt is the force of: the step around t_n, or in stages the one behind it
    middle = arrays["time"] + (march.stepper.energy_at - 0.5) * model.dt
    arrays |= sampled(solution, names, arrays["time"], middle, model.dt)
    contacts = {
        name: true_error.contact_errors(
            solution.contacts[name],
            middle,
            arrays["contact_force"][:, k],
            arrays["contact_force_exact"][:, k],
            model.dt,
            solution.reached,
            every=record.every,
        )
        for k, name in enumerate(names)
    }
    displacement = outcome.final_displacement.reshape(-1, march.dim)
    errors = {
        "solution": name,
        "reached": solution.reached,
        "fronts": solution.fronts,
        "contacts": contacts,
        "displacement_error": true_error.displacement_error(model, solution, displacement, outcome.done * model.dt),
        "fragile": None,
    }
    return solution, true_error.verdict(errors, reason)


def _fields(march: March, outcome: Outcome) -> dict[str, Any]:
    record, model, dim = outcome.record, march.model, march.dim
    if record.field_every == 0:
        return {}
    taken = outcome.done // record.field_every + 1 if outcome.status == "done" else outcome.done // record.field_every
    if taken == 0:  # stopped before the first snapshot
        return {}
    u = record.field[:taken].reshape(taken, -1, 2, dim)
    first = field_elements(model)
    stress = np.empty(u.shape[:2])
    for body in model.bodies.values():
        mine = (first >= body.start) & (first < body.stop)
        stress[:, mine] = stress_field(body, first[mine] - body.start, u[:, mine])
    return {
        "time": np.arange(taken) * record.field_every * model.dt,
        "body": [model.body_of(int(node)).name for node in first],
        "position": 0.5 * (model.nodes[first] + model.nodes[first + 1]),
        "stress": stress,
    }
