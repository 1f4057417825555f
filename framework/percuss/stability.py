"""What can be said of stability: the free critical step, theta of a closed contact, the cause of a run that blew up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact import SWEEPS

if TYPE_CHECKING:
    from percuss.march import March
    from percuss.model import Model

UNSOLVED = "one of these contacts joins masses too unlike: drop one of them, or refine the heavier side"


def free_step(model: Model) -> float:
    """Return a step that is stable without contact: 2 over the highest element frequency, which bounds the mesh's."""
    return 2.0 / model.omega


def closed_contact_step(model: Model, order: list[int], points: Any, i: int) -> float:
    """Return an upper bound of the critical step while point `i` is closed; infinite where none is known.

    A contact judged at the current state adds stiffness and inertia to the mesh; the Rayleigh quotient of the motion
    M^-1 N bounds the highest frequency from below. One judged at the predicted state is unstable beyond
    ``theta = dt^2 eps_s s / (1 + eps_m s) = 1``.
    """
    p = points[i]
    if not np.isfinite(p.end_stiffness):
        return np.inf
    stiffness = float(p.end_stiffness * p.weight_gap)
    s = float(p.delassus)
    if p.sees_predicted_gap:
        return float(np.sqrt((1.0 + p.end_stiffness * p.answer * s) / (stiffness * s)))
    inertia = float(p.end_stiffness * p.weight_acceleration * p.sees_acceleration)
    bulk = 0.0
    for node in model.meetings[order[i]].nodes:
        body = model.body_of(node)
        bulk += float(body.stiffness[body.end_element(node)]) / float(model.mass[node]) ** 2
    return float(2.0 / np.sqrt((bulk + stiffness * s**2) / (s + inertia * s**2)))


def theta(model: Model, order: list[int], points: Any) -> float | None:
    """Return the largest theta of single closed points judged at the predicted state, or None where there is none."""
    values = [
        (model.dt / closed_contact_step(model, order, points, p)) ** 2
        for p in range(points.size)
        if points[p].sees_predicted_gap and np.isfinite(points[p].end_stiffness)
    ]
    return max(values) if values else None


def certificate(model: Model, order: list[int], points: Any) -> dict[str, Any]:
    """Return what is known before the run; `stable` and `energy` are ``unknown`` with the reason."""
    return {
        "stable": "unknown",
        "energy": "unknown",
        "dt_critical": free_step(model),
        "theta": theta(model, order, points),
        "why": "dt_critical is that of the bodies without contact; a verdict on closed contacts is not derived yet",
    }


def likely_cause(march: March, step: int, *, by_contact: bool, unsolved: bool = False) -> dict[str, Any]:
    """Return step, time, node and likely cause of a run that was stopped.

    Parameters
    ----------
    march
        The run, as it stands after the step.
    step
        The step after which it was stopped.
    by_contact
        Whether the work of the contacts ran away, rather than the bodies' own energy.
    unsolved
        Whether the sweeps over contacts that share an end did not converge.
    """
    model = march.model
    finite = np.isfinite(march.u) & np.isfinite(march.v)
    points = march.few.points
    closed = [p for p in range(points.size) if points[p].multiplier != 0.0]
    node = _worst_node(march, finite, closed if by_contact or unsolved else [])
    body = model.body_of(node)
    energy = "the work of the contacts" if by_contact else "the kinetic energy"
    what = f"{energy} exceeds all energy put in many times"
    if not finite.all():
        what = "a value is no longer finite"
    elif unsolved:
        what = f"the equation of contacts that share an end was not solved in {SWEEPS} sweeps"
    return {
        "step": step,
        "time": step * model.dt,
        "node": node,
        "body": body.name,
        "node_in_body": node - body.start,
        "position": [float(x) for x in model.nodes[node]],
        "what": what,
        "cause": UNSOLVED if unsolved else _cause(march, closed if by_contact else list(range(points.size))),
    }


def _worst_node(march: March, finite: Any, closed: list[int]) -> int:
    if not finite.all():
        return int(np.argmin(finite)) // march.dim
    if closed:
        few = march.few
        worst = max(closed, key=lambda p: abs(few.points[p].multiplier))
        return int(few.special[few.entries[few.points[worst].start].place].dof) // march.dim
    return int(np.argmax(np.abs(march.v))) // march.dim


def _cause(march: March, suspects: list[int]) -> str:
    model, points = march.model, march.few.points
    if model.courant > 1.0 + 1e-12:
        return (
            f"the step {model.dt:.6g} is above {free_step(model):.6g}, the critical step of the bodies without contact "
            f"(Courant number {model.courant:.6g}): lower it below 1"
        )
    parameters = model.parameters()
    for p in suspects:
        bound = closed_contact_step(model, march.order, points, p)
        if model.dt > bound * (1.0 + 1e-9):
            name = model.meetings[march.order[p]].name
            said = ", ".join(f"{k} = {v:.6g}" for k, v in parameters[name].items() if k in {"beta_s", "ratio"})
            return (
                f"the step {model.dt:.6g} is above {bound:.6g}, which the closed contact '{name}' allows at most "
                f"({parameters[name]['law']}{': ' + said if said else ''}): lower the step or the penalty stiffness"
            )
    if model.courant > 1.0 - 1e-9:
        return "at a Courant number of 1 the highest frequency of a bar with free ends grows with time: lower it"
    if suspects:
        return "contact adds energy each time it closes or opens; this pair of methods gives no bound on it"
    return "unknown: the step is below the critical step of the bodies"
