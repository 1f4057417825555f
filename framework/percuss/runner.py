"""Run a case: model, march, accounts, result."""

from __future__ import annotations

import threading
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss import growth, ledger, truth
from percuss.case.arguments import expect_case
from percuss.certificate import cause, verdict
from percuss.errors import RunError
from percuss.result import Result, machine
from percuss.solver import size_limits
from percuss.solver.bodies import stress_field
from percuss.solver.compiler.compiling import Stopwatch
from percuss.solver.march import GROWTH, March, Outcome, Progress
from percuss.solver.model import Model, resolved_methods
from percuss.solver.recording import field_elements
from percuss.solver.stop import NOT_STARTED, Stop

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.case.case import Case


REPEATS, REPEATING = 5, 0.3  # how often a march is made of which the time is asked, within so many seconds
MARCHING = threading.Lock()  # of a process: one march is timed at a time

AGAINST, NOT_VALID = "the certificate says no", "not a valid result"  # begin the notes that a table must show too


def run(
    case: Case,
    overrides: Mapping[str, Any] | None = None,
    *,
    compiled: bool = True,
    nudge: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Run a case and return its result.

    Parameters
    ----------
    case
        A case from `percuss.load`.
    overrides
        Dotted path to value; the same paths and checks as ``--set``.
    compiled
        Whether to compile the time loop; without, the same loop runs as plain Python.
    nudge
        Whether to run a twin whose first body is a hair thicker, to see if the answer hangs on round-off
        (``summary["exact"]["fragile"]``).
    progress
        Called with (steps done, steps in all) now and then.

    Returns
    -------
    Result
        Its `status` is ``interrupted`` where Ctrl-C ended the run early.

    Raises
    ------
    InputError
        If the case or an override is wrong.
    RefusedPair
        If the integrator and a contact law make no sense together.
    RunError
        If the certificate forbids the run, or it went unstable or non-finite; its `result` holds what was computed.
    """
    watch = Stopwatch()
    expect_case("percuss.run", case, overrides=overrides)
    case = case.with_overrides(overrides) if overrides else case
    return _run(case, watch, compiled=compiled, nudge=nudge, progress=progress)


def timed_run(case: Case, *, nudge: bool = False, repeats: int | None = None) -> Result:
    """Run a case as a row of a study: its march is repeated, and the least of the times counts.

    No other thread of this process marches meanwhile: one that did would lengthen the time.

    Parameters
    ----------
    case
        The case.
    nudge
        As of `run`.
    repeats
        How often to march; None: until `REPEATS` marches are made or `REPEATING` seconds have passed.
    """
    return _run(case, Stopwatch(), nudge=nudge, repeats=repeats, timed=True)


def _run(
    case: Case,
    watch: Stopwatch,
    *,
    compiled: bool = True,
    nudge: bool = False,
    progress: Progress | None = None,
    repeats: int | None = 1,
    timed: bool = False,
) -> Result:
    march = March(size_limits.recordable(verdict.settled(case)), compiled=compiled)
    seconds = march.seconds
    seconds["build"] = watch.lap()
    known = verdict.certificate(march.model)
    seconds["certificate"] = watch.lap()
    if known["stable"] == "no" and case.time.on_unstable == "stop":
        outcome = march.refuse(cause.not_started(march.model, known))
    else:
        marginal = known["stable"] == "marginal"
        march.settle()  # compiles before the march of this process begins, for which other threads wait
        with MARCHING if timed else nullcontext():
            outcome = march.run(progress, marginal=marginal)
            if timed and outcome.status == "done":
                _repeat(march, outcome, repeats, marginal=marginal)
    watch.lap()
    with np.errstate(all="ignore") if outcome.status == "unstable" else nullcontext():  # the stop tells what overflowed
        result = _result(march, outcome, known)
    if nudge and result.summary["exact"] is not None and outcome.status != "unstable":
        try:
            with MARCHING if timed else nullcontext():  # it is not timed, and must not disturb one that is
                twin = run(truth.nudged(case, march.model.courant), compiled=compiled)
        except RunError as error:  # a hair's breadth decides whether it blows up
            twin = error.result
        result.summary["exact"]["fragile"] = truth.is_fragile(result, twin)
    result.summary["seconds"] |= {"compile": watch.compiled(), "total": watch.total()}
    if outcome.status == "unstable":
        raise RunError(stop_message(result.summary["stop"]), result)
    return result


def _repeat(march: March, outcome: Outcome, repeats: int | None, *, marginal: bool) -> None:
    """March again from the beginning, and keep the least time; Ctrl-C meanwhile is told as if it were of the run."""
    most = REPEATS if repeats is None else repeats
    spent = outcome.seconds["march"]
    for _ in range(most - 1):
        if repeats is None and spent > REPEATING:
            return
        again = March(march.model, kernels=march.kernels).run(marginal=marginal)
        if again.status == "interrupted":
            outcome.status = "interrupted"
            return
        spent += again.seconds["march"]
        outcome.seconds["march"] = min(outcome.seconds["march"], again.seconds["march"])


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


def stop_message(stop: Mapping[str, Any]) -> str:
    """Return the words for a run that was stopped: what, step, time, node and likely cause."""
    when = f"stopped at step {stop['step']}, time {stop['time']:.9g}"
    return (
        f"{'not started' if stop['what'] == NOT_STARTED else when}, node {stop['node']} "
        f"(node {stop['node_in_body']} of body '{stop['body']}'): {stop['what']}\n"
        f"  likely cause: {stop['cause']}"
    )


def _result(march: March, outcome: Outcome, known: dict[str, Any]) -> Result:
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
        "time_half": outcome.time[:rows] + march.energy_at * model.dt,
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
    grown = growth.growth_summary(march, outcome, known, ledger.largest(outcome))
    accounts = {
        "energy": ledger.energy_summary(march, outcome),
        "momentum": ledger.momentum_summary(march, outcome),
    }
    if accounts["energy"]["ledger_closed"] is False and grown["kept"]:
        grown["kept"] = None  # the work of contacts is then not what the energy of the bodies gained
    notes = [*model.case.notes, *_warnings(march, outcome, known), *growth.growth_notes(march, outcome, grown)]
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
    coordinates = {"contact": [m.name for m in model.meetings], "probe": names}
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
    if march.record.every > 1 and march.model.meetings:
        said.append("true errors of the contact force need `record.every: 1`")
    if march.staged:
        name = march.model.case.method.integrator.name
        said.append(
            f"energy_error is what {name} itself takes from the energy or adds to it; energies are those at t_n+1"
        )
    total = march.few.totals[0]
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
        return None, truth.verdict(None, "the run did not get beyond its first step")
    solution, name, reason = truth.exact_solution(model, (outcome.done + 1) * model.dt)
    if solution is None:
        return None, truth.verdict(None, reason)
    names = [meeting.name for meeting in model.meetings]
    # what the impulse lambda dt is the force of: the step around t_n, or in stages the one behind it
    middle = arrays["time"] + (march.energy_at - 0.5) * model.dt
    arrays |= truth.sampled(solution, names, arrays["time"], middle, model.dt)
    contacts = {
        name: truth.contact_errors(
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
        "displacement_error": truth.displacement_error(model, solution, displacement, outcome.done * model.dt),
        "fragile": None,
    }
    return solution, truth.verdict(errors, reason)


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


def plugins_used(case: Case) -> dict[str, dict[str, str]]:
    """Return, for every component of a case, the distribution, version and file it comes from."""
    method = case.method
    parts: list[Any] = [method.integrator, method.contact, method.mass]
    parts += [part for body in case.bodies.values() for part in (body.shape, body.material, body.element)]
    parts += [contact.law for contact in case.contacts.values()]
    parts += [load.load for load in case.loads.values()]
    out = {}
    for part in parts:
        source = case.registry.sources[part.family, part.name]
        out[f"{part.family}/{part.name}"] = {
            "distribution": source.distribution,
            "version": source.version,
            "file": source.file,
        }
    return dict(sorted(out.items()))


def plain(value: Any) -> Any:
    """Return `value` in the terms of JSON: numbers that are not finite become None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value if isinstance(value, (str, int, float, bool)) or value is None else str(value)
