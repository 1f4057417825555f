"""The accounts of a run: energy, work and momentum, and how well they close.

Energies are staggered, at t_{n+1/2}: kinetic ``v M v / 2``, elastic ``u_n K u_{n+1} / 2``. For every leap-frog method
on linear bodies the change of their sum over a step is ``lambda (g_{n+1} - g_{n-1}) / 2`` of the contacts plus
``(f_ext + reactions) (u_{n+1} - u_{n-1}) / 2``, to round-off; both works are summed in every step.

Of schemes in stages (`percuss.solver.compiled.multistage_loop`) energies are those of the state at t_{n+1}, and the
work of a force is its impulse in the step times ``(v_n + v_{n+1}) / 2``, which is what the kinetic energy takes up,
to round-off. What is left of the closure is what the scheme makes of the strain energy: it does not vanish.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.solver.compiled.contact_equation import ROUNDING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.methods.interfaces import Floats
    from percuss.solver.march import March, Outcome

# Of the largest energy, or of the momentum: what the accounts of a run may be off by. The identities above hold to
# round-off for linear bodies. The momentum of any body changes by the forces from outside alone.
CLOSED, CLOSED_NOT_LINEAR, BALANCED = 1e-9, 0.05, 1e-9
ROUND_OFF_UNITS = 4.0  # errors of a step, as in `percuss.results.energy_growth`


def energies(outcome: Outcome) -> dict[str, Floats]:
    """Return kinetic, elastic, external and contact energy at each record, how far they are from closing, and growth.

    Returns
    -------
    dict
        ``kinetic_energy``, ``elastic_energy``, ``external_work``, ``contact_work``, ``contact_energy`` (what closed
        contacts store) [energy]; and over the largest energy so far ``energy_error``, the closure, and
        ``energy_growth``, by what contact work and contact energy together have grown since the first step;
        (records,) each, at t_{n+1/2}.
    """
    kinetic, elastic, external, contact, stored = outcome.record.energy[: outcome.records].T
    total = kinetic + elastic
    closure = total - outcome.energy_before - external - contact
    sizes = np.max(np.abs([kinetic, elastic, external, contact]), axis=0, initial=abs(outcome.energy_before))
    # where all forces are in balance nothing moves, and the energies are round-off of what each would bring by itself
    step_energy = float(outcome.totals.step_energy[0])
    largest = np.maximum(np.maximum.accumulate(sizes), step_energy) if sizes.size else sizes
    grown = contact + stored - (contact + stored)[:1]
    return {
        "kinetic_energy": kinetic,
        "elastic_energy": elastic,
        "external_work": external,
        "contact_work": contact,
        "contact_energy": stored,
        "energy_error": np.divide(closure, largest, out=np.zeros_like(closure), where=largest > 0),
        "energy_growth": np.divide(grown, largest, out=np.zeros_like(grown), where=largest > 0),
    }


def largest(outcome: Outcome) -> float:
    """Return the largest energy or work of a run, as far as it was recorded."""
    total = outcome.totals[0]
    told = np.abs(outcome.record.energy[: outcome.records, :4])
    seen = float(np.max(told, initial=0.0, where=np.isfinite(told)))
    return max(seen, outcome.energy_before, float(total.largest_work), float(total.step_energy))


def energy_summary(march: March, outcome: Outcome) -> dict[str, Any]:
    """Return initial, final and largest energy, the works, and the largest closure error.

    ``ledger_allowed`` is how large that may be, and ``ledger_closed`` whether it is no larger; both are None of a run
    that was stopped, and of a scheme in stages, where the closure is what the scheme itself does to the energy.
    """
    parts = energies(outcome)
    total = parts["kinetic_energy"] + parts["elastic_energy"]
    initial = march.initial_energy()
    last = {name: float(values[-1]) if values.size else 0.0 for name, values in parts.items()}
    error = float(np.max(np.abs(parts["energy_error"]), initial=0.0))
    allowed = None if march.model.multistage or outcome.status == "unstable" else _allowed(march, outcome)
    return {
        "initial": initial,
        "final": float(total[-1]) if total.size else initial,
        "max": float(np.max(total, initial=initial)),
        "external_work": last["external_work"],
        "contact_work": last["contact_work"],
        "external_work_max": float(np.max(parts["external_work"], initial=0.0)),
        "contact_work_max": float(np.max(parts["contact_work"], initial=0.0)),
        "ledger_error": error,
        "ledger_allowed": allowed,
        "ledger_closed": None if allowed is None else bool(error <= allowed),
    }


def _allowed(march: March, outcome: Outcome) -> float:
    """Return by how much of the largest energy the ledger of a run may be open."""
    if march.model.why_not_linear:
        return CLOSED_NOT_LINEAR
    size = largest(outcome)
    # the round-off of the steps adds up in long runs
    round_off = ROUND_OFF_UNITS * ROUNDING * float(outcome.totals[0].round_off)
    return CLOSED + (round_off / size if size > 0 else 0.0)


def momentum_summary(march: March, outcome: Outcome) -> dict[str, Any]:
    """Return linear momentum before the first and after the last step, the impulses between, and their closure.

    The momenta are those at -dt/2 and t_N - dt/2, of a scheme in stages at 0 and t_N, between which N steps bring
    exactly the impulses given; the error is their difference over the largest impulse or momentum involved.
    ``balanced`` is whether that is round-off, None of a run that was stopped.
    """
    model, dim = march.model, march.dim
    mass = model.mass[:, None]
    before = (mass * outcome.starting_velocity.reshape(-1, dim)).sum(axis=0)
    after = (mass * outcome.final_velocity.reshape(-1, dim)).sum(axis=0)
    supports = np.zeros(dim)
    for hold, reaction in zip(model.constraints, outcome.reactions, strict=True):
        supports += model.dt * reaction * hold.direction
    walls = np.zeros(dim)
    for point, impulse in zip(march.order, outcome.points.impulse, strict=True):
        contact_pair = model.contact_pairs[point]
        if len(contact_pair.nodes) == 1:
            walls -= impulse * contact_pair.normal
    closure = after - before - outcome.load_impulse - supports - walls
    moving = float((model.mass * np.linalg.norm(outcome.final_velocity.reshape(-1, dim), axis=1)).sum())
    started = float((model.mass * np.linalg.norm(outcome.starting_velocity.reshape(-1, dim), axis=1)).sum())
    contacts = float(np.abs(outcome.points.impulse).sum())
    # each by itself: the reactions at the two ends of a stretched bar are large, and cancel
    held = model.dt * float(np.abs(outcome.reactions).sum())
    scale = max(
        moving,
        started,
        contacts,
        held,
        float(np.abs(outcome.load_impulse).max(initial=0.0)),
    )
    # forces in balance bring no momentum, and their round-off is one of the momentum that their energy could bring
    driven = float(np.sqrt(2.0 * float(model.mass.sum()) * largest(outcome)))
    off = float(np.abs(closure).max())
    return {
        "initial": before.tolist(),
        "final": after.tolist(),
        "impulse_of_loads": outcome.load_impulse.tolist(),
        "impulse_of_supports": supports.tolist(),
        "impulse_of_walls": walls.tolist(),
        "error": off / scale if scale > 0 else 0.0,
        "balanced": None if outcome.status == "unstable" else bool(off <= BALANCED * max(scale, driven)),
    }


def open_accounts(summary: Mapping[str, Any]) -> list[str]:
    """Return in words which accounts of a run do not close, energy or momentum; empty where they do.

    Parameters
    ----------
    summary
        Of a `percuss.Result`.
    """
    out = []
    energy, momentum = summary["energy"], summary["momentum"]
    if energy.get("ledger_closed") is False:
        out.append(
            f"the energy ledger does not close: {energy['ledger_error']:.2g} of the largest energy is not accounted "
            f"for, and {energy['ledger_allowed']:.2g} is allowed"
        )
    if momentum.get("balanced") is False:
        out.append(
            f"momentum does not balance: {momentum['error']:.2g} of it comes from no load, support or wall, so that "
            "the forces inside the bodies do not add up to zero"
        )
    return out


def ledger_words(energy: Mapping[str, Any], error: str, verb: str = "closes") -> str:
    """Return how well the energy ledger closes, in words; `error` is the closure as a reader wants to see it."""
    closed = energy.get("ledger_closed", True)
    if closed is False:
        return f"ledger does NOT close: {error} of the largest energy is not accounted for"
    state = "open by" if closed is None else f"{verb} to"
    return f"ledger {state} {error} of the largest energy"


def contact_summary(march: March, outcome: Outcome) -> dict[str, dict[str, Any]]:
    """Return, for each contact, impulse, peak force, times of closing and opening, and penetration."""
    model, dt = march.model, march.model.dt
    out: dict[str, dict[str, Any]] = {}
    for place, point in sorted(enumerate(march.order), key=lambda pair: pair[1]):
        p = outcome.points[place]
        met = p.first >= 0
        out[model.contact_pairs[point].name] = {
            "impulse": float(p.impulse),
            "peak_force": float(p.peak),
            "first_closed": float(p.first * dt) if met else None,
            "last_open": float((p.last + 1) * dt) if met else None,
            "closed_time": float(p.closed * dt),
            "penetration": {
                "largest": float(p.deepest),
                "time_mean": float(p.overlap / max(outcome.done, 1)),
                "energy": float(0.5 * p.end_stiffness * p.deepest**2) if np.isfinite(p.end_stiffness) else 0.0,
            },
        }
    return out
