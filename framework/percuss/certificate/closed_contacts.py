"""Closed contacts as the laws describe them: stiffness, inertia, and the guarantee that a pair of methods gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.methods.interfaces import LinearLaw
from percuss.solver.contact_rows import broadcast
from percuss.solver.integrator_check import scheme

if TYPE_CHECKING:
    from percuss.methods.interfaces import ContactState, Floats
    from percuss.solver.model import Model


NEVER_GROWS, BETWEEN = "never grows", "conserved between switchings"
NOT_GUARANTEED, UNKNOWN = "not guaranteed", "unknown"
WEAKEST_LAST = (NEVER_GROWS, BETWEEN, NOT_GUARANTEED, UNKNOWN)
BY_END = "the force follows from the gap at the end of the step: energy and what contacts store never exceed the work"
NO_CONTACT = "without contact the step conserves energy"
JUMPS = "the force follows from the gap at the current state: energy jumps as a contact closes or opens, either way"
PULLS = "with its mass the contact pulls before it opens, and each opening or closing may gain energy"
OTHER = "{} is no leap-frog scheme: what it does to energy as contacts open and close is not known"
SHARED = "contacts share an end: one may open or close another against what was predicted"
TIES = "a tie takes up the gap rate of its ends when it begins: energy jumps there, either way"
BILATERAL = "the law pulls as it pushes from its first step on: a gap that is there then brings energy"
INTERVALS = "the law acts in intervals of time: what its contacts store jumps as one of them begins"
OF_LINEAR_BODIES = "the energy of a step is balanced by the work of contacts and loads for linear bodies only"


@dataclass(frozen=True)
class ClosedContacts:
    """What the laws of a model say of its points at one step; (P,) each, in the order of the case.

    Attributes
    ----------
    stiffness, inertia
        eps_s and eps_m; zero where a law is judged at the end of the step, or does not act.
    predicted
        Whether the law is judged at the predicted gap.
    surplus
        Of laws judged at the predicted gap or at the end of the step: by what ``eps_m / eps_s`` exceeds that of a
        gap judged at the end of the step, dt^2 of a leap-frog scheme; 0 of the latter, nan elsewhere [time^2].
    compliance
        sigma of the laws that have a `surplus`, over the weight of the gap; 0 of a tie [length/force].
    tied
        Points whose gap never changes while the law acts, and it acts whatever the gap.
    unknown
        Names of laws of which the rows say nothing: a kernel of their own, or a weight on the gap rate; in a scheme of
        stages all that are judged at the end of the step, too.
    doubts
        Of each of these, in words why.
    energy, why
        What the pair guarantees of the energy, the weakest of all contacts, and the reason in words.
    """

    stiffness: Floats
    inertia: Floats
    predicted: Any
    surplus: Floats
    compliance: Floats
    tied: tuple[int, ...]
    unknown: tuple[str, ...]
    doubts: tuple[str, ...]
    energy: str
    why: str


def closed_contacts(model: Model, dt: float) -> ClosedContacts:
    """Return what the laws of a model say of its closed points for a step `dt`."""
    count = len(model.contact_pairs)
    stiffness, inertia, compliance = np.zeros(count), np.zeros(count), np.zeros(count)
    predicted, surplus = np.zeros(count, dtype=bool), np.full(count, np.nan)
    unknown: list[str] = []
    tied: list[int] = []
    doubts: list[str] = []

    def doubt(name: str, why: str) -> None:
        unknown.append(name)
        doubts.append(why)

    energy = [(NEVER_GROWS, BY_END) if count else (BETWEEN, NO_CONTACT)]
    stages, (*_, table) = scheme(model.case.method.integrator, dt)
    if model.why_not_linear:
        energy.append((NOT_GUARANTEED, f"{model.why_not_linear}, and {OF_LINEAR_BODIES}"))
    if stages is not None:
        energy.append((UNKNOWN, OTHER.format(model.case.method.integrator.name)))
    for entry in model.laws:
        law, where = entry["law"], entry["where"]
        points = model.points(where, dt)
        bound = law.bind(points, dt)
        if not isinstance(bound, LinearLaw):
            doubt(law.name, f"{law.name} has a kernel of its own, and is no line in gap and acceleration")
            continue
        rows = broadcast(bound, points, law.name)
        if why := _not_followed(rows, law.name, multistage=stages is not None):
            doubt(law.name, why)
            continue
        if rows["at"] == "explicit" and not _readable(table.explicit, rows):
            name = model.case.method.integrator.name
            doubt(f"{law.name} with {name}", f"{name} shows {law.name} its gap and acceleration of different times")
            continue
        if rows["at"] == "explicit":
            stiffness[where] = rows["gap"] / rows["sigma"]
            by_gap, _, by_acceleration = table.explicit.response
            inertia[where] = (rows["gap"] * by_gap + rows["acceleration"] * by_acceleration) / rows["sigma"]
            predicted[where] = table.explicit.gap == "predicted"
            if table.explicit.gap == "predicted":
                surplus[where] = inertia[where] / stiffness[where] - table.end.response[0]
        else:
            surplus[where] = 0.0
        if rows["rate"].any():
            tied += where
        else:
            compliance[where] = rows["sigma"] / rows["gap"]
        energy.append(_energy_of(model, where, rows, inert=bool(inertia[where].any())))
    if unknown and stages is None:
        energy.append((UNKNOWN, f"nothing is known: {'; '.join(dict.fromkeys(doubts))}"))
    resting = list(model.resting(0.5 * model.dt))
    stiffness[resting], inertia[resting], surplus[resting] = 0.0, 0.0, np.nan
    ties = tuple(p for p in tied if p not in resting)
    weakest, why = max(energy, key=lambda known: WEAKEST_LAST.index(known[0]))
    return ClosedContacts(
        stiffness,
        inertia,
        predicted,
        surplus,
        compliance,
        ties,
        tuple(unknown),
        tuple(dict.fromkeys(doubts)),
        weakest,
        why,
    )


def _not_followed(rows: dict[str, Any], law: str, *, multistage: bool) -> str:
    """Return why neither stiffness and inertia nor a constraint follows from a law's row; empty if one does.

    Parameters
    ----------
    rows
        The row with one value a point.
    law
        Name of the law.
    multistage
        Whether the integrator is a multi-stage scheme.
    """
    end = rows["at"] == "end"
    tie = end and bool(rows["rate"].all()) and not rows["gap"].any() and not rows["sigma"].any()
    reasons = {
        f"{law} is judged at the end of a step of stages, and no closed form of that is known": end and multistage,
        f"{law} weighs the gap rate, which damps or drives": rows["rate"].any() and not tie,
        f"{law} ties the gap rate of its contacts, but not always or not both ways": (
            tie and (rows["active"] != "all" or rows["sign"] != "free")
        ),
        f"{law} does not weigh the gap": not rows["gap"].all() and not tie,
        f"{law} weighs the gap acceleration at the end of the step": end and rows["acceleration"].any(),
        f"{law} is judged at the current or predicted gap without a compliance (sigma = 0)": (
            not end and (rows["sigma"] <= 0).any()
        ),
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


def _energy_of(model: Model, where: list[int], rows: dict[str, Any], *, inert: bool) -> tuple[str, str]:
    """Return what one law of readable rows guarantees of the energy at its points, and why."""
    table = model.tables[-1]
    if rows["during"] is not None:
        return NOT_GUARANTEED, INTERVALS
    if rows["at"] == "end":
        if rows["rate"].any():
            return NOT_GUARANTEED, TIES
        if rows["active"] == "gap < 0" and _share_an_end(model, where):
            return NOT_GUARANTEED, SHARED
        bilateral = rows["active"] == "all" and rows["sign"] == "free"
        return (NOT_GUARANTEED, BILATERAL) if bilateral else (NEVER_GROWS, BY_END)
    if table.explicit.gap == "current":
        return (NOT_GUARANTEED, PULLS) if inert else (BETWEEN, JUMPS)
    return (NOT_GUARANTEED, SHARED) if _share_an_end(model, where) else (NEVER_GROWS, BY_END)


def _readable(judged: ContactState, rows: dict[str, Any]) -> bool:
    """Return whether stiffness and inertia of a closed contact follow from a law's rows with this table."""
    if judged.gap == "current":
        return judged.response[0] == 0.0 and judged.acceleration == "bulk" and judged.response[2] == 1.0
    return judged.acceleration == "none" or not rows["acceleration"].any()


def _share_an_end(model: Model, where: list[int]) -> bool:
    """Return whether a contact of `where` shares a node with any other: one then opens or closes what another saw."""
    nodes = [node for contact_pair in model.contact_pairs for node in contact_pair.nodes]
    return any(nodes.count(node) > 1 for p in where for node in model.contact_pairs[p].nodes)
