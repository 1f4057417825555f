"""Energy and momentum accounts of a run, and the error with which they close.

Energies are staggered, at t_{n+1/2}: kinetic ``v M v / 2``, elastic ``u_n K u_{n+1} / 2``. For every leap-frog method
on linear bodies the change of their sum over a step is ``lambda (g_{n+1} - g_{n-1}) / 2`` of the contacts plus
``(f_ext + reactions) (u_{n+1} - u_{n-1}) / 2``, to round-off; both works are summed in every step. Where a body is not
linear, the internal work ``f_int(u_n) (u_{n+1} - u_{n-1}) / 2`` of all bodies is summed too and takes the place of the
elastic energy, to which it is equal in linear bodies: the ledger closes to round-off whatever the material. Stored and
dissipated energy are given beside it, and differ from the internal work by an error that vanishes with the time step.
So it is where bodies have steps of their own, ``m f_int(u_n) (u_{n+1} - u_{n-1}) / 2`` over the steps in which the
forces of a body act: elastic energy is then that between the two such steps around t_{n+1/2}, along the velocities
there, and differs from the internal work where a contact or load has changed these between the two.
With a viscous leap-frog scheme the internal work contains what the scheme takes, and the energy dissipated in linear
bodies is the internal work that they do not store.

For multi-stage schemes (`percuss.step.stages`) energies are those of the state at t_{n+1}, and the
work of a force is its impulse in the step times ``(v_n + v_{n+1}) / 2``, which equals the kinetic energy it adds, to
round-off. The remaining closure error is the change of the strain energy made by the scheme: it does not vanish.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, cast

import numpy as np

from percuss.case.quantities import percent
from percuss.certificate.closed_laws import BETWEEN, BOUNDED, NEVER_GROWS
from percuss.certificate.verdict import Certificate
from percuss.contact.frictions import frictional
from percuss.contact.model import Model
from percuss.contact.moving_rows import complementary, share_of_limit
from percuss.contact.points import BY_CURRENT, BY_END, TOUCHING
from percuss.contact.sliding import slides
from percuss.jsonable import Data
from percuss.march.march import March, Outcome
from percuss.mesh.body import turn_of
from percuss.methods.interfaces import Floats
from percuss.results.summary import (
    BodySummary,
    ContactSummary,
    EnergySummary,
    GrowthSummary,
    MomentumSummary,
    SupportEntries,
)  # fmt: skip
from percuss.step.account import ROUNDING
from percuss.step.parts.moments import keeps_angular_momentum

# Allowed closure error of the ledger over the largest energy, and allowed imbalance over the momentum.
CLOSURE_TOLERANCE, MOMENTUM_TOLERANCE = 1e-9, 1e-9
# Allowed difference of the internal work and the energies that bodies store and dissipate, over the largest energy.
BODIES_TOLERANCE = 0.05
ALLOWED_HOURGLASS = 0.05  # of the largest elastic energy
TOLD_RENEWAL = 0.01  # of the largest energy
ALLOWED_GROWTH = 1e-12  # allowed energy growth over the largest energy or work, beside round-off
# Error of a step in rounding units. A gap is the sum of two displacements and a distance, each rounded to half a unit,
# and work takes the difference of two gaps: up to three units, and one more from the sums over the steps. The bound
# assumes that all these errors have the same sign.
ROUND_OFF_UNITS = 4.0
# Half a step before the other energies: the sum grows and falls with the force even where nothing is gained.
# What friction records of each contact.
OF_FRICTION = (
    "friction_work", "friction_stored", "contact_slip", "sticking_area", "sliding_area", "contact_force_vector",
)  # fmt: skip
STORED_BY_LAWS = "what laws say they store at t_n"
NOT_BALANCED = {
    "momentum": "load, support or wall, so that the forces inside the bodies do not add up to zero",
    "angular_momentum": "load, support or contact, so that the forces inside the bodies turn them",
}


def energies(march: March, outcome: Outcome) -> dict[str, Floats]:
    """Return the energies and works of a run at each record, the closure error of the ledger, and the energy growth.

    Returns
    -------
    dict
        ``kinetic_energy``, ``elastic_energy``, ``external_work``, ``contact_work``, ``contact_energy`` (stored
        in closed contacts), where a body is not linear ``internal_work``, where a material dissipates
        ``dissipated_energy``, where a body is damped ``damped_energy``, and where an element has hourglass points
        ``hourglass_energy`` [energy]; and over the largest energy so far ``energy_error``, the closure error, and
        ``energy_growth``, the growth of contact work plus contact energy since the first step; (records,) each, at
        t_{n+1/2}.
    """
    recorded = outcome.record.energy[: outcome.records]
    kinetic, elastic, external = recorded.kinetic_energy, recorded.elastic_energy, recorded.external_work
    contact, stored, internal = recorded.contact_work, recorded.contact_energy, recorded.internal_work
    sums_internal_work, energy_before = march.model.sums_internal_work, outcome.totals.energy_before
    in_bodies = internal if sums_internal_work else elastic
    before = outcome.kinetic_before if sums_internal_work else energy_before
    bodies = {"internal_work": internal} if sums_internal_work else {}
    closure = kinetic + in_bodies - before - external - contact
    works = [kinetic, elastic, external, contact]
    if friction := of_friction(outcome):
        works.append(friction["friction_work"].sum(axis=1))
        closure -= works[-1]
    if "damped_energy" in outcome.histories:
        works.append(outcome.histories["damped_energy"][: outcome.records])
        closure += works[-1]
        bodies["damped_energy"] = works[-1]
    sizes = np.max(np.abs(works), axis=0, initial=abs(energy_before))
    # Where all forces balance, nothing moves and the energies are round-off: the scale is then the energy that a force
    # would bring by itself.
    step_energy = outcome.totals.step_energy
    largest = np.maximum(np.maximum.accumulate(sizes), step_energy) if sizes.size else sizes
    growth = contact + stored - (contact + stored)[:1]
    if march.model.facts.dissipates:
        # What the work of the internal forces has not stored in linear bodies.
        bodies["dissipated_energy"] = internal - (elastic - (energy_before - outcome.kinetic_before))
    elif march.arrays.variables.dissipated.size > 0:
        bodies["dissipated_energy"] = recorded.dissipated_energy
    if any(getattr(body.spec.element, "hourglass_points", 0) for body in march.model.bodies.values()):
        bodies["hourglass_energy"] = recorded.hourglass_energy
    return {
        "kinetic_energy": kinetic,
        "elastic_energy": elastic,
        **bodies,
        "external_work": external,
        "contact_work": contact,
        "contact_energy": stored,
        "energy_error": np.divide(closure, largest, out=np.zeros_like(closure), where=largest > 0),
        "energy_growth": np.divide(growth, largest, out=np.zeros_like(growth), where=largest > 0),
    }


def of_friction(outcome: Outcome) -> dict[str, Floats]:
    """Return what friction has recorded of each contact, the energy that it has dissipated, and the work of walls."""
    if "friction_work" not in outcome.histories:
        return {}
    recorded = [*OF_FRICTION, *({"wall_work"} & outcome.histories.keys())]
    found = {name: outcome.histories[name][: outcome.records] for name in recorded}
    return {**found, "friction_dissipated": -found["friction_work"] - found["friction_stored"]}


def gains_by_friction(contacts: Iterable[str], arrays: Mapping[str, Floats], largest_energy: float) -> Iterator[str]:
    """Yield a sentence for each contact whose friction has given energy: friction only takes it.

    Before a touch there is no contact force: what the first step of a touch gives counts as growth of none, as in the
    account of the contact energy. It is half of a force times the way of the step before, in which it did not act.
    """
    if "friction_dissipated" not in arrays:
        return
    closed = arrays["contact_force"] > 0.0
    touches = closed & ~np.concatenate([np.zeros_like(closed[:1]), closed[:-1]])
    taken = np.diff(arrays["friction_dissipated"], axis=0, prepend=0.0)
    histories = np.cumsum(np.where(touches, np.maximum(taken, 0.0), taken), axis=0)
    for name, history in zip(contacts, histories.T, strict=True):
        gained = -float(np.min(history, initial=0.0))
        if gained > CLOSURE_TOLERANCE * largest_energy:
            share = percent(gained / largest_energy)
            yield f"the friction of contact '{name}' has given {share} of the largest energy, and may only take it"


def hourglass_notes(histories: Mapping[str, Floats], round_off: float) -> list[str]:
    """Return a note where hourglass energy is more than a small share of the elastic energy, of which it is part."""
    held = float(np.max(histories.get("hourglass_energy", np.zeros(0)), initial=0.0))
    elastic = float(np.max(histories["elastic_energy"], initial=round_off))
    if not held > max(ALLOWED_HOURGLASS * elastic, round_off):
        return []
    share = percent(held / elastic)
    return [f"hourglass control holds up to {share} of the largest elastic energy: a finer mesh needs less of it"]


def largest(outcome: Outcome) -> float:
    """Return the largest energy or work of a run among its records and the maxima that the time loop keeps."""
    total = outcome.totals
    energy = outcome.record.energy[: outcome.records]
    recorded = np.abs([energy.kinetic_energy, energy.elastic_energy, energy.external_work, energy.contact_work])
    largest_recorded = float(np.max(recorded, initial=0.0, where=np.isfinite(recorded)))
    return float(max(largest_recorded, total.energy_before, total.largest_work, total.step_energy))


def energy_summary(
    march: March, outcome: Outcome, histories: Mapping[str, Floats], largest_energy: float
) -> EnergySummary:
    """Return initial, final and largest energy, the works, and the largest closure error of the ledger.

    Parameters
    ----------
    march, outcome
        The run and its outcome.
    histories
        The energies and works at each record, `energies`.
    largest_energy
        The largest energy or work of the run, `largest`.

    Returns
    -------
    EnergySummary
        ``ledger_allowed`` is the allowed closure error, and ``ledger_closed`` whether the error is within it, and
        ``bodies_error`` within `BODIES_TOLERANCE`; both are None for a stopped run and for a multi-stage scheme, whose
        closure error is the energy change made by the scheme itself. ``bodies_error`` is the largest difference of the
        internal work and the energies that the bodies store and dissipate, over the largest energy; None where the
        internal work is not summed, or a material does not say what it dissipates. Where bodies have steps of their
        own it is an error of the scheme, which closed contacts may make as large as they like, and stays out of
        ``ledger_closed``.
    """
    total = histories["kinetic_energy"] + histories["elastic_energy"]
    last = {name: float(values[-1]) if values.size else 0.0 for name, values in histories.items()}
    bodies_error = _bodies_error(march, histories, largest_energy)
    agree = bool(march.model.why("lost energy")) or not (bodies_error or 0.0) > BODIES_TOLERANCE
    error = float(np.max(np.abs(histories["energy_error"]), initial=0.0))
    judged = not march.model.multistage and outcome.status != "unstable"
    allowed = _allowed(outcome, CLOSURE_TOLERANCE, largest_energy)
    summary: EnergySummary = {
        "initial": march.initial_energy,
        "final": float(total[-1]) if total.size else march.initial_energy,
        "max": float(np.max(total, initial=march.initial_energy)),
        "external_work": last["external_work"],
        "contact_work": last["contact_work"],
        "external_work_max": float(np.max(histories["external_work"], initial=0.0)),
        "contact_work_max": float(np.max(histories["contact_work"], initial=0.0)),
        "internal_work": last.get("internal_work"),
        "dissipated": last.get("dissipated_energy"),
        "bodies_error": bodies_error,
        "ledger_error": error,
        "ledger_allowed": allowed if judged else None,
        "ledger_closed": bool(error <= allowed and agree) if judged else None,
    }
    if "damped_energy" in last:
        summary["damped"] = last["damped_energy"]
    if (renewal := outcome.histories.get("renewal_so_far")) is not None:
        summary["renewal"] = float(renewal.sum()) if complementary(march.model) else None
    return summary


def _bodies_error(march: March, histories: Mapping[str, Floats], largest_energy: float) -> float | None:
    """Return the largest internal work that bodies neither store nor dissipate, over the largest energy, or None."""
    materials = [body.spec.material for body in march.model.bodies.values()]
    silent = any(material.state > 0 and material.dissipated_in is None for material in materials)
    # What a scheme dissipates is the difference itself.
    takes = march.model.facts.dissipates
    if "internal_work" not in histories or silent or takes or not largest_energy > 0.0:
        return None
    missing = histories["internal_work"] - histories["elastic_energy"]
    if "dissipated_energy" in histories:
        missing = missing - histories["dissipated_energy"]
    return float(np.max(np.abs(missing), initial=0.0)) / largest_energy


def _allowed(outcome: Outcome, tolerance: float, largest_energy: float) -> float:
    """Return an allowed error over the largest energy: a tolerance, and the round-off of all steps, which adds up."""
    round_off = ROUND_OFF_UNITS * ROUNDING * float(outcome.totals.round_off)
    return tolerance + (round_off / largest_energy if largest_energy > 0 else 0.0)


def momentum_summary(march: March, outcome: Outcome, largest_energy: float) -> MomentumSummary:
    """Return linear momentum before the first and after the last step, the impulses in between, and their balance.

    `largest_energy` is the largest energy or work of the run.

    The momenta are those at -dt/2 and t_N - dt/2, for a multi-stage scheme at 0 and t_N; the N steps in between
    contribute exactly the given impulses. The error is the imbalance over the largest impulse or momentum involved, or
    the momentum that the largest energy could bring, where loads that cancel leave none.
    ``balanced`` is whether the imbalance is round-off, None for a stopped run.
    """
    model, dim = march.model, march.dim
    velocities = outcome.starting_velocity.reshape(-1, dim), outcome.final_velocity.reshape(-1, dim)
    before, after = ((model.bodies.mass[:, None] * velocity).sum(axis=0) for velocity in velocities)
    started, moving = (float((model.bodies.mass * np.linalg.norm(velocity, axis=1)).sum()) for velocity in velocities)
    supports = np.zeros(dim)
    for constraint, reaction in zip(model.loads.constraints, outcome.reactions, strict=True):
        supports += model.dt * reaction * constraint.direction
    walls = np.zeros(dim)
    of_walls = model.contact_points.at_wall & ~model.contact_points.slides
    for p in np.flatnonzero(of_walls):
        walls -= outcome.sums.impulse[p] * model.contact_points.normal[p]
    if (along := outcome.histories.get("friction_impulse")) is not None:
        walls -= along[of_walls].sum(axis=0)
    if (pushes := outcome.histories.get("pushes")) is not None:  # those of walls stand behind those of nodes
        walls -= pushes.reshape(-1, dim)[len(march.arrays.place) :].sum(axis=0)
    loads, damping = outcome.load_impulse[:dim], _damping_impulses(march, outcome).sum(axis=0)
    closure = after - before - loads - supports - walls - damping
    if model.bodies.about_axis:  # across the axis the momentum of a ring is 0, and its hoop forces balance
        closure[0] = before[0] = after[0] = supports[0] = walls[0] = damping[0] = 0.0
    # The magnitudes are summed, as the reactions at the two ends of a stretched bar are large and cancel.
    support_impulse = model.dt * float(np.abs(outcome.reactions).sum())
    scale = max(
        moving,
        started,
        float(np.abs(outcome.sums.impulse).sum()),
        support_impulse,
        float(np.abs(loads).max(initial=0.0)),
        # Balanced forces bring no momentum: their round-off is relative to the momentum that their energy could bring.
        float(np.sqrt(2.0 * float(model.bodies.mass.sum()) * largest_energy)),
    )
    impulses = {"loads": loads, "supports": supports, "walls": walls}
    return _balance(before, after, impulses | _by_damping(model, damping), closure, scale, outcome)


def _damping_impulses(march: March, outcome: Outcome) -> Floats:
    """Return the impulse of damping on each node over the run, (nodes, dim): -alpha m times its way in the mean."""
    model, dim = march.model, march.dim
    half_step_apart = 0.5 * model.dt * (outcome.final_velocity - outcome.starting_velocity)
    way = (outcome.final_displacement - half_step_apart).reshape(-1, dim)
    impulses: Floats = -(2.0 / model.dt * (model.slowing - 1.0) * model.bodies.mass)[:, None] * way
    return impulses


def _by_damping(model: Model, impulse: Floats) -> dict[str, Floats]:
    """Return the impulse of damping by its name; nothing where no body is damped."""
    return {"damping": impulse} if (model.slowing > 1.0).any() else {}


def supports_summary(march: March, outcome: Outcome) -> SupportEntries:
    """Return the impulse of each support and drive on its body over the run; nothing of a case without any."""
    model, found = march.model, dict[str, Any]()
    for constraint, reaction in zip(model.loads.constraints, outcome.reactions, strict=True):
        impulse = found.setdefault(constraint.support, np.zeros(march.dim))
        impulse += model.dt * reaction * constraint.direction
    if model.bodies.about_axis:  # across the axis the forces on a ring cancel
        for impulse in found.values():
            impulse[0] = 0.0
    entries: Any = {
        name: {f"impulse_{axis}": float(value) for axis, value in zip("xyz", impulse, strict=False)}
        for name, impulse in found.items()
    }
    return {"supports": entries} if found else {}


def angular_momentum_summary(march: March, outcome: Outcome, largest_energy: float) -> MomentumSummary | None:
    """Return angular momentum before the first and after the last step, and the moments of impulses in between.

    All count about the centre of mass at the start. Small strains count with the places at the start, where internal
    forces of linear bodies have no moment; bodies of finite strain with the places of each step. None for bars and
    bodies of revolution.
    """
    model, dim, bodies = march.model, march.dim, march.model.bodies
    velocities = outcome.starting_velocity.reshape(-1, dim), outcome.final_velocity.reshape(-1, dim)
    if keeps_angular_momentum(model):
        return _of_finite_strain(march, outcome, velocities, largest_energy)
    if bodies.about_axis or not all(body.of_small_strains for body in bodies.values()):
        return None
    momenta = [bodies.with_moment(bodies.nodes, bodies.mass[:, None] * velocity)[:, dim:] for velocity in velocities]
    held, pressed = np.zeros((1, momenta[0].shape[1])), np.zeros((1, momenta[0].shape[1]))
    if model.loads.constraints:
        at = bodies.nodes[[constraint.node for constraint in model.loads.constraints]]
        directions = np.array([constraint.direction for constraint in model.loads.constraints])
        held = bodies.with_moment(at, model.dt * outcome.reactions[:, None] * directions)[:, dim:]
    if points := model.contact_points:
        of_points = outcome.sums.impulse[points.point][:, None] * points.value
        if (along := outcome.histories.get("friction_impulse")) is not None:
            of_points += points.share[:, None] * along[points.point]
        of_points[points.slides[points.point]] = 0.0  # whose impulses are those on nodes
        moments = bodies.with_moment(bodies.nodes[points.node], of_points)[:, dim:]
        pressed = np.stack([np.bincount(points.point, column, len(points)) for column in moments.T], axis=1)
        if points.slides.any() and outcome.done > 0:
            nodes, pushes = list(march.arrays.place), outcome.histories["pushes"].reshape(-1, dim)
            on_nodes = bodies.with_moment(bodies.nodes[nodes], pushes[: len(nodes)])
            pressed = np.concatenate([pressed, on_nodes[:, dim:]])
    before, after, supports, contacts = (moments.sum(axis=0) for moments in (*momenta, held, pressed))
    loads = outcome.load_impulse[dim:]
    damping = bodies.with_moment(bodies.nodes, _damping_impulses(march, outcome))[:, dim:].sum(axis=0)
    inertia = float(bodies.mass @ ((bodies.nodes - bodies.centre) ** 2).sum(axis=1))
    sums = [float(np.abs(moments).sum()) for moments in (*momenta, held, pressed, loads)]
    scale = max(*sums, math.sqrt(2.0 * inertia * largest_energy))
    closure = after - before - loads - supports - contacts - damping
    impulses = {"loads": loads, "supports": supports, "contacts": contacts} | _by_damping(model, damping)
    return _balance(before, after, impulses, closure, scale, outcome)


def _of_finite_strain(
    march: March, outcome: Outcome, velocities: tuple[Floats, Floats], largest_energy: float
) -> MomentumSummary | None:
    """Return the angular momentum where bodies are of finite strain, and the moments by the places of each step."""
    if "moments_of_contacts" not in outcome.histories:
        return None  # no step was made
    bodies, dim = march.model.bodies, march.dim
    displacement = outcome.final_displacement.reshape(-1, dim).copy()
    for body in bodies.values():
        if body.of_small_strains:
            displacement[body.start : body.stop] = 0.0
    places = bodies.nodes, bodies.nodes + displacement
    momenta = [
        bodies.with_moment(place, bodies.mass[:, None] * velocity)[:, dim:]
        for place, velocity in zip(places, velocities, strict=True)
    ]
    before, after = (moments.sum(axis=0) for moments in momenta)
    of_contacts, supports, loads, damping = (
        outcome.histories[name]
        for name in ("moments_of_contacts", "moment_of_supports", "moment_of_loads", "moment_of_damping")
    )
    contacts = of_contacts.sum(axis=0)
    inertia = float(bodies.mass @ ((places[1] - bodies.centre) ** 2).sum(axis=1))
    sums = [float(np.abs(moments).sum()) for moments in (*momenta, of_contacts, supports, loads)]
    closure = after - before - loads - supports - contacts - damping
    impulses = {"loads": loads, "supports": supports, "contacts": contacts} | _by_damping(march.model, damping)
    scale = max(*sums, math.sqrt(2.0 * inertia * largest_energy))
    balance = _balance(before, after, impulses, closure, scale, outcome)
    between = [spec.wall is None for spec in march.model.case.contacts.values()]
    balance["couple_of_contacts"] = of_contacts[between].sum(axis=0).tolist()
    return balance


def _balance(
    before: Floats, after: Floats, impulses: Mapping[str, Floats], closure: Floats, scale: float, outcome: Outcome
) -> MomentumSummary:
    """Return momenta, impulses by what they come from, and whether what is left of them is small on a scale."""
    imbalance = float(np.abs(closure).max())
    balance: Any = {
        "initial": before.tolist(),
        "final": after.tolist(),
        **{f"impulse_of_{name}": impulse.tolist() for name, impulse in impulses.items()},
        "error": imbalance / scale if scale > 0 else 0.0,
        "balanced": None if outcome.status == "unstable" else bool(imbalance <= MOMENTUM_TOLERANCE * scale),
    }
    return cast("MomentumSummary", balance)


def open_accounts(summary: Data) -> list[str]:
    """Return a sentence for each account of a run that does not close, energy or momentum; empty if both close.

    Parameters
    ----------
    summary
        Summary of a `percuss.Result`, or its accounts alone; an exact solution alone has none.
    """
    messages, energy = [], summary.get("energy", {})
    if energy.get("ledger_closed") is False:
        error, allowed, bodies_error = (
            energy[key] or 0.0 for key in ("ledger_error", "ledger_allowed", "bodies_error")
        )
        if bodies_error > BODIES_TOLERANCE:
            messages.append(
                f"the internal work does not agree with the energy of the bodies: {percent(bodies_error, 2)} of the "
                f"largest energy is neither stored nor dissipated, {percent(BODIES_TOLERANCE)} is allowed; force and "
                "energy of an element or a material do not belong together, or the time step is too long for them"
            )
        if not error <= allowed:
            messages.append(
                f"the energy ledger does not close: {percent(error, 2)} of the largest energy is not accounted for, "
                f"{percent(allowed, 2)} is allowed"
            )
    for name, words in NOT_BALANCED.items():
        account = summary.get(name) or {}
        if account.get("balanced") is False:
            what, error = name.replace("_", " "), percent(account["error"], 2)
            messages.append(f"{what} does not balance: {error} of it comes from no {words}")
    return messages


def ledger_words(energy: Data) -> str:
    """Return in words how well the energy ledger closes."""
    closed, error = energy["ledger_closed"], energy["ledger_error"]
    if closed is False:
        error = max(error, energy["bodies_error"] or 0.0)
        return f"ledger does NOT close: {percent(error, 2)} of the largest energy is not accounted for"
    state = "is open by" if closed is None else "closes to"
    return f"ledger {state} {percent(error, 2)} of the largest energy"


def contact_summary(march: March, outcome: Outcome) -> dict[str, ContactSummary]:
    """Return impulse, peak force, times of closing and opening, and penetration of each contact."""
    model, dt = march.model, march.model.dt
    summaries: dict[str, ContactSummary] = {}
    of_contact = model.contact_points.contact
    forces, friction = outcome.record.contact_force[: outcome.records], of_friction(outcome)
    rubs = set(frictional(model)) if friction else set()
    at_end = outcome.time[: outcome.records][-1:] == outcome.done * dt  # whether there is a record at t_N
    for number, (name, contact) in enumerate(zip(model.case.contacts, outcome.contacts, strict=True)):
        force = forces[:, number]
        last = outcome.done if at_end.any() and force[-1] != 0.0 else int(contact.last)
        first = int(contact.first) if contact.first >= 0 else last
        was_closed = last >= 0
        # Without a record at the end, what presses in the last step is taken for closed there.
        still_closed = last >= outcome.done - (0 if at_end.any() else 1)
        sums, stiffness = outcome.sums[of_contact == number], outcome.law.end_stiffness[of_contact == number]
        summaries[name] = {
            "impulse": float(sums.impulse.sum()),
            "peak_force": float(np.fmax.reduce(force, initial=contact.peak)),
            "first_closed": float(first * dt) if was_closed else None,
            "last_open": float((last + 1) * dt) if was_closed and not still_closed else None,
            "closed_time": float(contact.closed * dt),
            "penetration": {
                "largest": float(sums.deepest.max(initial=0.0)),
                "time_mean": float(contact.overlap / max(outcome.done, 1)),
                "energy": float((0.5 * np.nan_to_num(stiffness) * sums.deepest**2).sum()),
            },
        }
        for key in ("friction_work", "friction_dissipated", "friction_stored", "contact_slip") if name in rubs else ():
            summaries[name][key] = float(friction[key][-1, number]) if friction[key].size else 0.0
        if "wall_work" in friction:
            summaries[name]["wall_work"] = float(friction["wall_work"][-1:, number].sum())
        if "renewal_so_far" in outcome.histories and slides(model.case.contacts[name]):
            returned, renewal = (float(outcome.histories[key][number]) for key in ("returned", "renewal_so_far"))
            bounded = renewal if complementary(model) else None
            summaries[name] |= {"returned_points": int(returned), "renewal": bounded}
            summaries[name]["stiffness_bound"] = float(outcome.histories["stiffness"][number])
    return summaries


def renewal_notes(march: March, outcome: Outcome, largest_energy: float) -> Iterator[str]:
    """Yield notes on contacts that slide: points that came back, energy and stiffness that the renewal may bring."""
    books, points, order, model = outcome.histories, march.model.contact_points, march.arrays.order, march.model
    for number, name in enumerate(model.case.contacts if "renewal_so_far" in books else ()):
        renewal, returned = float(books["renewal_so_far"][number]), int(books["returned"][number])
        overlap, facet = float(books["overlap"][number]), float(points.facet[points.contact == number].min())
        if overlap > TOUCHING * facet:
            yield (
                f"an overlap of contact '{name}' at the start, {overlap:.3g} deep, presses the bodies apart: what it "
                "brings is contact work, which no bound of the energy knows"
            )
        if returned:
            yield (
                f"points of contact '{name}' came back {returned} times to a surface that they had left, and lay "
                "inside it: each keeps that overlap as an offset, which falls as the point comes out"
            )
        if renewal > TOLD_RENEWAL * largest_energy:
            point = order[int(books["point"][number])] - int(np.argmax(points.contact == number))
            share, time = percent(renewal / largest_energy), float(books["time"][number])
            yield (
                f"as the rows of contact '{name}' change they may bring {share} of the largest energy: most at point "
                f"{point} at time {time:.6g}. Finer facets bring less"
            )
        share_of_step = share_of_limit(model, float(books["stiffness"][number]))
        if share_of_step is not None and share_of_step > 1.0:
            yield (
                f"the step is not shown to be stable at time {float(books['stiffest'][number]):.6g}, where the points "
                f"of contact '{name}' crowd on the fewest nodes: its bound is {share_of_step:.3g} of what it may be"
            )


def bodies_summary(march: March, outcome: Outcome) -> dict[str, BodySummary]:
    """Return velocity of the centre of mass and spin of each body, first and last.

    The spin is the angular momentum about the centre of mass over the moments of inertia, with the places at the start,
    as small strains count it; of other bodies with the places of the time.
    """
    model, dim = march.model, march.dim
    states = ("_first", outcome.starting_velocity, None), ("", outcome.final_velocity, outcome.final_displacement)
    found: dict[str, Any] = {}
    for name, body in model.bodies.items():
        numbers = found[name] = {}
        for when, velocities, moved in states:
            part = slice(body.start, body.stop)
            velocity, places = velocities.reshape(-1, dim)[part], model.bodies.nodes[part]
            if moved is not None and not body.of_small_strains:
                places = places + moved.reshape(-1, dim)[part]
            mean, middle = body.mass @ velocity / body.mass.sum(), body.mass @ places / body.mass.sum()
            numbers |= {f"velocity_{axis}{when}": float(value) for axis, value in zip("xyz", mean, strict=False)}
            if body.is_bar or body.spec.plane == "axisymmetric":
                continue
            spin = turn_of(body.mass, places - middle, velocity - mean)
            if dim == 2:
                numbers[f"spin{when}"] = float(spin[2])
            else:
                numbers |= {f"spin_{axis}{when}": float(value) for axis, value in zip("xyz", spin, strict=True)}
    return found


def growth_summary(march: March, outcome: Outcome, certificate: Certificate, scale: float) -> GrowthSummary:
    """Return the energy growth of a run and whether it is within the guarantee of its pair of methods.

    Parameters
    ----------
    march, outcome
        The run and its outcome.
    certificate
        Certificate of the run.
    scale
        Largest energy or work of the run.
    """
    total = outcome.totals
    rise, drift = (float(value) / scale if scale > 0 else 0.0 for value in (total.rise, total.largest_drift))
    measured = {NEVER_GROWS: rise, BETWEEN: drift}.get(certificate["energy"])
    if certificate["energy"] == BOUNDED and "excess" in outcome.histories:
        measured = float(outcome.histories["excess"].max()) / scale if scale > 0 else 0.0
    allowed = _allowed(outcome, ALLOWED_GROWTH, scale)
    if not math.isfinite(allowed):  # a motion that is no longer finite has no round-off
        measured = None
    step = int(total.rise_step) if total.rise > 0 else None
    linear, by_laws = not march.model.sums_internal_work, march.arrays.variables.stored_by_laws.size > 0
    return {
        "guarantee": certificate["energy"],
        "quantity": "contact work"
        if march.model.multistage
        else quantity(outcome.law, outcome.row, linear=linear, by_laws=by_laws),
        "largest": rise,
        "step": step,
        "time": (step + march.stepper.energy_at) * march.model.dt if step is not None else None,
        "between_switchings": drift,
        "allowed": allowed if measured is not None else None,
        "kept": bool(measured <= allowed) if measured is not None else None,
    }


def quantity(points: Any, rows: Any, *, linear: bool = True, by_laws: bool = False) -> str:
    """Return in words the energy that is measured for contact points of these `LAW` and `ROW` records.

    For linear bodies contact work equals kinetic plus elastic energy less external work, and is named by these.
    """
    parts = ["kinetic + elastic" if linear else "contact work"]
    if ((points.stores == BY_END) & (rows.kappa > 0)).any():
        parts.append("kappa/4 (<-g_n+1>^2 + <-g_n>^2)")
    if (points.stores == BY_CURRENT).any():
        parts.append("(eps_s g_n g_n+1 + eps_m r_n+1/2^2)/2 while closed")
    if by_laws:
        parts.append(STORED_BY_LAWS)
    return " + ".join(parts) + (" - work" if linear else "")


def growth_notes(march: March, outcome: Outcome, growth: GrowthSummary) -> list[str]:
    """Return a note on energy growth beyond the guarantee, or an empty list if there is none."""
    if growth["kept"] is not False:
        return []
    laws = " and ".join(dict.fromkeys(law.name for law in march.model.contact_points.laws))
    pair = f"{march.model.case.method.integrator.name} with {laws}"
    if growth["guarantee"] == BOUNDED:
        return [f"the contacts added more energy than the renewal of rows explains, which {pair} does not allow"]
    if growth["guarantee"] == NEVER_GROWS:
        return [
            f"energy grew by {percent(growth['largest'])} of the largest energy at step {growth['step']}, time "
            f"{growth['time']:.6g}, beyond what {pair} allows ({NEVER_GROWS})"
        ]
    step = int(outcome.totals.drift_step)
    return [
        f"energy changed by {percent(growth['between_switchings'])} of the largest energy up to step {step}, time "
        f"{(step + 0.5) * march.model.dt:.6g}, in steps in which no contact opened or closed, beyond what {pair} "
        f"allows ({BETWEEN})"
    ]
