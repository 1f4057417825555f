"""Assembly of the result of a run: summary, histories, true errors and notes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from percuss.case.quantities import percent
from percuss.certificate.verdict import Certificate
from percuss.contact.laws import ignored_couplings
from percuss.contact.model import Model
from percuss.contact.pairs import unlike_sides
from percuss.contact.sliding import late_corners, normals_of_the_start
from percuss.jit import Stopwatch
from percuss.jsonable import Entries, plain
from percuss.march.march import CONTACT_WORK_GROWTH, March, Outcome
from percuss.march.stop import Stop, likely_cause
from percuss.methods.interfaces import Exact, Floats
from percuss.results import ledger, true_error
from percuss.results.doubts import doubts, slow_step
from percuss.results.exact import ROUND_OFF, exact_solution
from percuss.results.fields import fields_of, in_parts
from percuss.results.provenance import components_used, provenance_of, resolved_methods
from percuss.results.result import Result
from percuss.results.summary import EnergySummary, ExactEntries, ExactErrors, StopSummary, StretchEntries, Summary

if TYPE_CHECKING:
    from percuss.results.reference import FinerRun

# Notes that begin with these words are also shown in the row of the run in a table.
AGAINST_CERTIFICATE, NOT_VALID = "the certificate says unstable", "not a valid result"


def _stop_entry(model: Model, stop: Stop | None, certificate: Certificate) -> StopSummary | None:
    """Return step, time, node and likely cause of a stopped run, or None if the run was not stopped."""
    if stop is None:
        return None
    body = model.bodies.at(stop.node)
    cure = f": {certificate['cure']}" if certificate["cure"] else ""
    return {
        "step": stop.step,
        "time": stop.step * model.dt,
        "node": stop.node,
        "body": body.name,
        "node_in_body": stop.node - body.start,
        "position": [float(x) for x in model.bodies.nodes[stop.node]],
        "what": stop.what,
        "cause": likely_cause(stop, certificate["stable"], f"{certificate['why']}{cure}"),
    }


def result_of(march: March, outcome: Outcome, certificate: Certificate) -> Result:
    """Return the result of a march that was run or refused.

    Parameters
    ----------
    march, outcome
        The march and its outcome.
    certificate
        Certificate of the run.
    """
    model, record_count = march.model, outcome.records
    probe_names = list(map(str, model.case.recorded_ends))
    time = outcome.time[:record_count]
    arrays = {"time": time, "time_half": time + march.stepper.energy_at * model.dt}
    arrays |= {name: getattr(outcome.record, name)[:record_count] for name in ("contact_force", "gap")}
    arrays["gap"][np.isinf(arrays["gap"])] = np.nan  # of a contact whose points meet nothing
    for name in ("displacement", "velocity"):
        arrays[name] = getattr(outcome.record, name)[:record_count].reshape(record_count, len(probe_names), march.dim)
    energies = ledger.energies(march, outcome)
    arrays |= energies | _contact_states(march, outcome)
    if "contact_area" in outcome.histories:
        arrays["contact_area"] = outcome.histories["contact_area"][:record_count]
    arrays |= ledger.of_friction(outcome)
    if "support_force" in outcome.histories:
        arrays["support_force"] = outcome.histories["support_force"][:record_count]
    end_force = outcome.record.end_force[:record_count]
    if end_force.size and not np.isnan(outcome.law.end_stiffness).all():
        arrays["contact_force_end"] = end_force
    watch = Stopwatch()
    solution, true_errors = _true_errors(march, outcome, arrays)
    outcome.seconds["exact"] = watch.lap()
    largest_energy = ledger.largest(outcome)
    growth = ledger.growth_summary(march, outcome, certificate, largest_energy)
    energy = ledger.energy_summary(march, outcome, energies, largest_energy)
    if energy["ledger_closed"] is False and growth["kept"]:
        # with an open ledger the contact work is not the energy gained by the bodies, so nothing can be verified
        growth["kept"] = None
    notes = [
        *model.case.notes,
        *unlike_sides(model.case, model.bodies),
        *late_corners(model.case, model.bodies),
        *normals_of_the_start(model.case, model.bodies),
        *_warnings(march, outcome, certificate, energy),
        *doubts(march, outcome, arrays),
        *slow_step(model, certificate),
        *ledger.growth_notes(march, outcome, growth),
        *ledger.renewal_notes(march, outcome, largest_energy),
        *ledger.hourglass_notes(arrays, march.noise),
    ]
    summary: Summary = {
        "status": outcome.status,
        "stop": _stop_entry(model, outcome.stop, certificate),
        "steps": outcome.done,
        "stages": len(model.tables),
        "nodes": model.bodies.n_nodes,
        "dt": model.dt,
        "end": outcome.done * model.dt,
        "courant": model.courant,
        "certificate": certificate,
        "fragile": None,
        "contacts": ledger.contact_summary(march, outcome),
        "bodies": ledger.bodies_summary(march, outcome),
        "energy": energy,
        **ledger.supports_summary(march, outcome),
        "momentum": ledger.momentum_summary(march, outcome, largest_energy),
        "angular_momentum": ledger.angular_momentum_summary(march, outcome, largest_energy),
        "energy_growth": growth,
        **stretch_summary(outcome),
        **true_errors,
        "compiled": outcome.kernels.compiled,
        "compiled_why": list(outcome.kernels.reasons),
        "threads": march.arrays.threads if outcome.kernels.compiled else 1,
        "notes": notes,
        "seconds": outcome.seconds,
    }
    wrong = (*ledger.open_accounts(summary), *ledger.gains_by_friction(model.case.contacts, arrays, largest_energy))
    notes += [f"{NOT_VALID}: {words}" for words in wrong]
    errors = true_errors["exact"] or true_errors["exact_covered"]
    components = components_used(model.case, solution=errors["solution"] if errors else None)
    provenance = provenance_of(model, components, resolved=resolved_methods(model))
    coordinates = {"contact": list(model.case.contacts), "probe": probe_names}
    if supports := model.loads.supports:
        coordinates["support"] = supports
    if "contact_state" in arrays and not model.bodies.of_lines:
        coordinates["point"] = list(model.contact_points.names)
    return Result(arrays, coordinates, fields_of(march, outcome), plain(summary), provenance, solution)


def stretch_summary(outcome: Outcome) -> StretchEntries:
    """Return the cell of finite strain whose frequency came nearest to what the step allows; nothing without any."""
    if "stretch" not in outcome.histories:
        return {}
    stretch, cell, time, at_start, courant = outcome.histories["stretch"].tolist()
    body = str(outcome.histories["stretched_body"][0])
    return {
        "stretch": {
            "largest": stretch, "body": body, "cell": int(cell), "time": time, "courant": at_start,
            "courant_stretched": courant,
        }
    }  # fmt: skip


def _warnings(march: March, outcome: Outcome, certificate: Certificate, energy: EnergySummary) -> list[str]:
    """Return warnings about a run: doubtful stability, ignored couplings, missing errors, energy added by contact."""
    warnings, model = [], march.model
    if certificate["stable"] == "no" and outcome.done > 0:
        warnings.append(
            f"{AGAINST_CERTIFICATE}, and the case asks to run all the same (on_unstable: warn): {certificate['why']}"
        )
    if certificate["stable"] == "marginal":
        warnings.append("at the critical step the highest frequency of a body may grow with time, with no bound")
    if (stretch := stretch_summary(outcome).get("stretch")) and stretch["courant_stretched"] > max(1.0, model.courant):
        warnings.append(
            f"the step became too long for cell {stretch['cell']} of body '{stretch['body']}', at time "
            f"{stretch['time']:.6g}: its Courant number was {stretch['courant_stretched']:.3g}"
        )
    warnings += ignored_couplings(model)
    if march.arrays.why_one:
        warnings.append(f"one thread made the steps of large solids: {march.arrays.why_one}")
    name = march.model.case.method.integrator.name
    if march.arrays.record.every > 1 and march.model.contact_points:
        warnings.append("true errors of the contact force need `record.every: 1`")
    if march.model.multistage:
        warnings.append(
            f"energy_error is what {name} itself takes from the energy or adds to it; energies are those at t_n+1"
        )
    bodies_error = energy["bodies_error"] or 0.0
    lost = march.model.why("lost energy")
    if lost and bodies_error > ledger.BODIES_TOLERANCE:
        warnings.append(f"{lost} {percent(bodies_error)} of the largest energy")
    total = march.totals
    allowed = CONTACT_WORK_GROWTH * (total.began_with + total.largest_work) + march.noise
    if outcome.status != "unstable" and not total.contact_work <= allowed:
        work = f"{total.contact_work:.6g}"
        warnings.append(f"{NOT_VALID}: contact added an energy of {work}, far above all that was put in")
    return warnings


def _true_errors(march: March, outcome: Outcome, arrays: Entries) -> tuple[Exact | None, ExactEntries]:
    """Return the exact solution of a case and the errors of its run; add the histories that judge it to `arrays`.

    Where no exact solution covers the case, a finer run may stand for it, if the case asks for one.

    Returns
    -------
    solution
        Exact solution; None if no registered solution covers the case or the run made no step.
    entries
        Entries of the summary: ``exact``, ``exact_reason``, ``exact_covered`` and ``estimated``.
    """
    model, end = march.model, (outcome.done + 1) * march.model.dt
    if outcome.done == 0:
        return None, true_error.summary_entries(None, "the run did not get beyond its first step")
    ended_here = true_error.summary_entries(None, true_error.ENDED_BY_CTRL_C)
    if outcome.status == "interrupted" and outcome.done == model.steps:
        return None, ended_here
    estimated = None
    try:
        solution, name, reason = exact_solution(model, end)
        if reason and model.case.reference is not None and outcome.status != "interrupted":
            from percuss.results.reference import finer_runs

            finer = finer_runs(model, march.threads)
            if isinstance(finer, str):
                reason = f"{reason}; {finer}"
            else:
                solution = None  # one that ends before the run does would judge another part of it
                estimated = _estimates(finer, march, outcome, arrays)
    except KeyboardInterrupt:
        outcome.status = "interrupted"
        return None, ended_here
    errors = None
    if solution is not None:
        moved = outcome.final_displacement.reshape(-1, march.dim)
        errors, force, gap = _errors(solution, name, march, outcome, arrays["time"], arrays["contact_force"], moved)
        arrays |= {"contact_force_exact": force, "gap_exact": gap}
    return solution, true_error.summary_entries(errors, reason, estimated)


def _estimates(finer: Sequence[FinerRun], march: March, outcome: Outcome, arrays: Entries) -> ExactErrors:
    """Return the errors of a run against one or two finer runs; add the histories of the first to `arrays`.

    Of two, ``apart`` has the errors of the second against the first, on the steps and nodes of the run: runs whose
    errors differ by less are not told apart.
    """
    time, ran = arrays["time"], arrays["contact_force"]
    moved = outcome.final_displacement.reshape(-1, march.dim)
    first, *others = finer
    name = " and ".join(judge.name for judge in finer)
    estimated, force, gap = _errors(first, name, march, outcome, time, ran, moved)
    arrays |= {"contact_force_finer": force, "gap_finer": gap}
    for second in others:
        estimated["second"], force, _ = _errors(second, second.name, march, outcome, time, ran, moved)
        there = second.displacement_of(march.model, outcome.done * march.model.dt)
        estimated["apart"], _, _ = _errors(first, first.name, march, outcome, time, np.nan_to_num(force), there)
    return estimated


def _errors(
    judge: Exact | FinerRun, name: str, march: March, outcome: Outcome, time: Floats, ran: Floats, moved: Floats | None
) -> tuple[ExactErrors, Floats, Floats]:
    """Return the errors of contact forces `ran` and of displacements `moved`, and forces and gaps of their judge.

    The impulse lambda dt acts over the step around t_n, in a multi-stage scheme over that from t_n to t_n+1. Forces and
    gaps are nan after the time that the judge has reached.
    """
    model, middle, half = march.model, time + march.stepper.force_at * march.model.dt, 0.5 * march.model.dt
    covered = middle + half <= judge.reached * (1.0 + ROUND_OFF)
    force, gap = (np.full((time.size, len(model.case.contacts)), np.nan) for _ in range(2))
    contacts, every = {}, outcome.record.every
    for k, contact in enumerate(model.case.contacts):
        known = judge.contacts[contact]
        # The impulse lambda dt is that over a step, and so is the mean force of the judge.
        force[covered, k] = known.mean_force(middle[covered] - half, middle[covered] + half)
        gap[covered, k] = known.gap(time[covered])
        contacts[contact] = true_error.contact_errors(
            known, middle, ran[:, k], force[:, k], model.dt, judge.reached, every=every
        )
    end, displacement_error = outcome.done * model.dt, None
    if isinstance(judge, Exact):
        displacement_error = true_error.displacement_error(model, judge, moved, end) if moved is not None else None
    else:
        displacement_error = judge.displacement_error(model, moved, end) if moved is not None else None
        for of_contact in contacts.values():  # the peak of a finer run has an overshoot of its own
            of_contact["overshoot"] = None
    errors: ExactErrors = {
        "solution": name,
        "reached": judge.reached,
        "fronts": judge.fronts,
        "contacts": contacts,
        "displacement_error": displacement_error,
    }
    return errors, force, gap


def _contact_states(march: March, outcome: Outcome) -> dict[str, Floats]:
    """Return the recorded state variables of the contact laws, and the energy that they have dissipated.

    Returns
    -------
    dict
        ``contact_state``, (records, points, state variables), nan where a point has fewer than another, and
        ``contact_dissipation``, (records,), if a law knows it; empty if no law has state variables.
    """
    laws = [bound_law for bound_law in march.arrays.kernel_laws if bound_law.law.state > 0]
    if not laws:
        return {}
    records = outcome.histories["contact_state"][: outcome.records]
    most = max(bound_law.law.state for bound_law in laws)
    states = np.full((outcome.records, len(march.model.contact_points), most), np.nan)
    dissipated = np.zeros(outcome.records)
    parts = in_parts(records, [(len(bound_law.where), bound_law.law.state) for bound_law in laws])
    for bound_law, of_law in zip(laws, parts, strict=True):
        law, where = bound_law.law, list(bound_law.where)
        states[:, where, : law.state] = of_law
        if law.dissipated_in is not None:
            dissipated += of_law[:, :, law.dissipated_in].sum(axis=1)
    known = any(bound_law.law.dissipated_in is not None for bound_law in laws)
    return {"contact_state": states, **({"contact_dissipation": dissipated} if known else {})}
