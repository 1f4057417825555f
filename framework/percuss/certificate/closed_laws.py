"""Stiffness and inertia of closed contacts from their linear laws, and the energy guarantee of a pair of methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from percuss.certificate.assessment import quoted
from percuss.contact.laws import laws_at
from percuss.step.integrator_check import kernel_of, scheme, uses_internal

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.model import Model
    from percuss.methods.interfaces import ContactState, Floats, LinearLaw


NEVER_GROWS, BETWEEN = "never grows", "conserved between switchings"
BOUNDED = "bounded by the renewal of rows"
NOT_GUARANTEED, UNKNOWN = "not guaranteed", "unknown"
WEAKEST_LAST = (NEVER_GROWS, BETWEEN, NOT_GUARANTEED, UNKNOWN)
BY_END = "the force follows from the gap at the end of the step: energy and what contacts store never exceed the work"
RENEWED = "rows that move bring energy: no more than a number R that the run computes, step by step"
MOVED = "rows that move bring energy, and under this law no bound of it is known"
NO_CONTACT = "without contact the step conserves energy"
JUMPS = "the force follows from the gap at the current state: energy jumps as a contact closes or opens, either way"
PULLS = "with its mass the contact pulls before it opens, and each opening or closing may gain energy"
OTHER = "{} is no leap-frog scheme: what it does to energy as contacts open and close is not known"
SHARED = "contacts share an end: one may open or close another against what was predicted"
TIES = "a tie takes up the gap rate of its ends when it begins: energy jumps there, either way"
BALANCED = "an end without mass is in balance with its gap at the current state: energy jumps as it closes or opens"
BILATERAL = "the law pulls as it pushes from its first step on: a gap that is there then brings energy"
INTERVALS = "the law acts in intervals of time: what its contacts store jumps as one of them begins"
ALONE = "asks for the internal forces without those of contact, so that a closed contact does not act as a stiffness"
OF_LINEAR_BODIES = "the energy of a step is balanced by the work of contacts and loads for linear bodies only"
UNALIKE = (
    "contacts {} share an end and differ in eps_m / eps_s: they do not act on one another as equals, and such a step "
    "can grow at any theta"
)
# Difference of two eps_m / eps_s, relative to their scale and dt^2, below which it is round-off.
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class ClosedLaws:
    """Closed contacts of a model at one step, as their linear laws describe them; (P,) arrays in the order of the case.

    Attributes
    ----------
    stiffness, inertia
        eps_s and eps_m; zero where a law is evaluated at the end of the step, or does not act. Of a contact with an end
        without mass, the stiffness of its law in series with the end elements, and zero.
    predicted
        Whether the law is evaluated at the predicted gap.
    surplus
        Excess of ``eps_m / eps_s`` over its value for a gap at the end of the step (dt^2 in a leap-frog scheme), for
        laws evaluated at the predicted gap; 0 for laws evaluated at the end of the step, nan elsewhere [time^2].
    compliance
        sigma over the weight of the gap; 0 for mesh tying and for unknown laws; that of the end elements is added where
        an end has no mass [length/force].
    doubts
        Reasons in words, each once, why neither stiffness and inertia nor a constraint follow from some of the laws,
        such as laws with a kernel of their own or a weight on the gap rate; with a multi-stage scheme also laws
        evaluated at the end of the step. Empty where they follow from all laws.
    energy, why
        Energy guarantee of the pair of methods, the weakest of all contacts, and the reason for it in words.
    """

    stiffness: Floats
    inertia: Floats
    predicted: Any
    surplus: Floats
    compliance: Floats
    doubts: tuple[str, ...]
    energy: str
    why: str

    @property
    def pressing(self) -> Any:
        """Which contacts have a `surplus` and can press, (P,): the predicted ones need stiffness for it."""
        return np.where(self.predicted, self.stiffness > 0.0, ~np.isnan(self.surplus))

    def at_current_state(self) -> tuple[Floats, Floats]:
        """Return eps_s and eps_m of the contacts evaluated at the current state, 0 for the others, (P,) each."""
        return np.where(self.predicted, 0.0, self.stiffness), np.where(self.predicted, 0.0, self.inertia)

    def unlike(self, delassus: Any, dt: float) -> list[int]:
        """Return the contacts that differ in eps_m / eps_s from one with which they share an end.

        Parameters
        ----------
        delassus : (P, P) sparse array
            The Delassus operator S.
        dt
            Time step.
        """
        if delassus.nnz == delassus.shape[0]:  # none share an end
            return []
        pairs, pressing = delassus.tocoo(), self.pressing
        one, other = self.surplus[pairs.row], self.surplus[pairs.col]
        differ = np.abs(one - other) > ROUND_OFF * (np.maximum(np.abs(one), np.abs(other)) + dt * dt)
        found: list[int] = np.unique(pairs.row[differ & pressing[pairs.row] & pressing[pairs.col]]).tolist()
        return found


def why_unlike(model: Model, laws: ClosedLaws | None = None) -> str:
    """Return which contacts that share an end differ in eps_m / eps_s; empty if none do.

    The closed contacts of its step, `laws`, are found unless they are given.
    """
    unlike = (laws or closed_laws(model, model.dt)).unlike(model.delassus, model.dt)
    return UNALIKE.format(quoted(model.contact_points.names, unlike)) if unlike else ""


# Those of the step of each model, which several criteria ask for.
_AT_OWN_STEP: WeakKeyDictionary[Model, ClosedLaws] = WeakKeyDictionary()


def closed_laws(model: Model, dt: float) -> ClosedLaws:
    """Return the closed contacts of a model, as its linear laws describe them for a step `dt`."""
    if dt != model.dt:
        return _closed_laws(model, dt)
    if model not in _AT_OWN_STEP:
        _AT_OWN_STEP[model] = _closed_laws(model, dt)
    return _AT_OWN_STEP[model]


def _closed_laws(model: Model, dt: float) -> ClosedLaws:
    count = len(model.contact_points)
    stiffness, inertia, compliance = np.zeros((3, count))
    predicted, surplus = np.zeros(count, dtype=bool), np.full(count, np.nan)
    doubts: list[str] = []
    integrator = model.case.method.integrator
    _, (*_, table) = scheme(integrator, dt)
    guarantees = _guarantees_without_laws(model)
    alone = model.multistage and uses_internal(kernel_of(integrator))
    by_scheme = model.why("springs") or (f"{integrator.name} {ALONE}" if alone else "")
    for bound_law in laws_at(model, dt):
        linear: Any = bound_law.linear
        indices = list(bound_law.where)
        if reason := _reason_unknown(model, bound_law, table.explicit, by_scheme):
            doubts.append(reason)
            if not model.facts.of_all_laws:
                guarantees.append((UNKNOWN, reason))
            continue
        if linear.at == "explicit":
            stiffness[indices] = linear.gap / linear.sigma
            by_gap, _, by_acceleration = table.explicit.response
            inertia[indices] = (linear.gap * by_gap + linear.acceleration * by_acceleration) / linear.sigma
            predicted[indices] = table.explicit.gap == "predicted"
            if table.explicit.gap == "predicted":
                surplus[indices] = inertia[indices] / stiffness[indices] - table.end.response[0]
        else:
            surplus[indices] = 0.0
        if not bound_law.ties:
            compliance[indices] = linear.sigma / linear.gap
        guarantees.append(_energy_guarantee(model, indices, linear, inert=bool(inertia[indices].any())))
    inactive = list(model.inactive_points(0.5 * model.dt))
    stiffness[inactive], inertia[inactive], surplus[inactive] = 0.0, 0.0, np.nan
    if (balanced := model.balanced).any():
        # A closed contact of an end without mass is a spring between nodes with mass, which is the law in series with
        # the end elements and follows from the current state.
        compliance[balanced] += model.rows_at(0.5 * model.dt).delassus[balanced] * model.dt**2
        stiffness[balanced], inertia[balanced], surplus[balanced], predicted[balanced] = 0.0, 0.0, np.nan, False
        acting = [int(p) for p in np.flatnonzero(balanced) if p not in inactive]
        stiffness[acting] = 1.0 / compliance[acting]
        guarantees.append((BETWEEN, BALANCED))
    weakest, why = max(guarantees, key=lambda guarantee: WEAKEST_LAST.index(guarantee[0]))
    if weakest == UNKNOWN and not model.multistage:
        why = f"nothing is known: {'; '.join(dict.fromkeys(why for energy, why in guarantees if energy == UNKNOWN))}"
    reasons = tuple(filter(None, (*dict.fromkeys(doubts), model.why("linear laws"))))
    return ClosedLaws(stiffness, inertia, predicted, surplus, compliance, reasons, weakest, why)


def _guarantees_without_laws(model: Model) -> list[tuple[str, str]]:
    """Return the energy guarantees that bodies and scheme give and limit, each with the reason for it in words."""
    guarantees = [(NEVER_GROWS, BY_END) if model.contact_points else (BETWEEN, NO_CONTACT)]
    if model.bodies.why_not_linear:
        guarantees.append((NOT_GUARANTEED, f"{model.bodies.why_not_linear}, and {OF_LINEAR_BODIES}"))
    if model.why("energy"):
        guarantees.append((NOT_GUARANTEED, model.why("energy")))
    if model.multistage:
        guarantees.append((UNKNOWN, OTHER.format(model.case.method.integrator.name)))
    return guarantees


def _reason_unknown(model: Model, bound_law: BoundLaw, state: ContactState, by_scheme: str) -> str:
    """Return why neither stiffness and inertia nor a constraint follow from a law; empty if either does.

    Parameters
    ----------
    model
        The case as arrays.
    bound_law
        The law at its points.
    state
        What laws evaluated at the current or predicted gap are shown.
    by_scheme
        Why this is so of any law in this model; empty if it is not.
    """
    linear, law = bound_law.linear, bound_law.law.name
    if linear is None:
        return f"{law} has a kernel of its own and is not linear in gap and acceleration"
    end = linear.at == "end"
    sigma, gap, rate = np.asarray(linear.sigma), np.asarray(linear.gap), np.asarray(linear.rate)
    weighs_rate = bool(rate.any())
    tie = end and weighs_rate and bool(rate.all()) and not gap.any() and not sigma.any()
    reasons = {
        f"{law} is evaluated at the end of a step of stages": end and model.multistage,
        f"{law} weighs the gap rate, which damps or drives": weighs_rate and not tie,
        f"{law} ties the gap rate of its contacts, but not always or not both ways": (
            tie and (linear.active != "all" or linear.sign != "free")
        ),
        f"{law} does not weigh the gap": not tie and not gap.all(),
        f"{law} weighs the gap acceleration at the end of the step": end and np.any(linear.acceleration),
        f"{law} is evaluated at the current or predicted gap without a compliance (sigma = 0)": (
            not end and (sigma <= 0).any()
        ),
        by_scheme: bool(by_scheme),
        f"{model.case.method.integrator.name} shows {law} its gap and acceleration of different times": (
            not end and not _determined(state, linear)
        ),
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


def _energy_guarantee(model: Model, indices: list[int], linear: LinearLaw, *, inert: bool) -> tuple[str, str]:
    """Return the energy guarantee of one linear law at its points, and the reason for it in words.

    Parameters
    ----------
    model
        The case as arrays.
    indices
        Numbers of the contacts under the law.
    linear
        The linear law.
    inert
        Whether a closed contact of the law has inertia.
    """
    table = model.tables[-1]
    if linear.during is not None:
        return NOT_GUARANTEED, INTERVALS
    if linear.at == "end":
        if np.any(linear.rate):
            return NOT_GUARANTEED, TIES
        if linear.active == "gap < 0" and _share_an_end(model, indices):
            return NOT_GUARANTEED, SHARED
        bilateral = linear.active == "all" and linear.sign == "free"
        return (NOT_GUARANTEED, BILATERAL) if bilateral else (NEVER_GROWS, BY_END)
    if table.explicit.gap == "current":
        return (NOT_GUARANTEED, PULLS) if inert else (BETWEEN, JUMPS)
    return (NOT_GUARANTEED, SHARED) if _share_an_end(model, indices) else (NEVER_GROWS, BY_END)


def _determined(state: ContactState, linear: LinearLaw) -> bool:
    """Return whether stiffness and inertia of a closed contact follow from a linear law evaluated at this state."""
    if state.gap == "current":
        return state.response[0] == 0.0 and state.acceleration == "bulk" and state.response[2] == 1.0
    return state.acceleration == "none" or not np.any(linear.acceleration)


def _share_an_end(model: Model, indices: list[int]) -> bool:
    """Return whether a contact of `indices` shares a node with another contact, whose force then changes its gap."""
    points = model.contact_points
    shared = np.bincount(points.node)[points.node] > 1
    return bool(np.isin(points.point[shared], indices).any())
