"""The stop of a run before its end: step, node and reason."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from percuss.contact.model import Model

NOT_STARTED = "the certificate says unstable, so the run was not started"
UNSOLVED = "one of these contacts joins masses too unlike: drop one of them, or refine the heavier side"


Kind = Literal["contact work", "energy", "inverted", "not solved", "unstable step", "kernel", "not started"]


@dataclass(frozen=True)
class Stop:
    """The reason for a stop of a run before its end, with the step and the node.

    Attributes
    ----------
    step
        The step after which the run was stopped.
    node
        The node at which the reason shows most.
    kind
        ``"contact work"`` or ``"energy"`` of the bodies where that grew beyond all energy put in, ``"not solved"`` for
        the contact equation, ``"inverted"`` for a cell that is inside out, ``"unstable step"`` for one that needs a
        shorter step, ``"kernel"`` for a fault of a plug-in, or ``"not started"``.
    what
        The observation, in words.
    cause
        The cause, if the time loop itself knows it; if empty, it is sought in the certificate.
    """

    step: int
    node: int
    kind: Kind
    what: str
    cause: str = ""


def not_started(model: Model, worst: Collection[str], cause: str) -> Stop:
    """Return the stop of a run that its certificate forbids, placed at a node that limits the step.

    Parameters
    ----------
    model
        The model of the run.
    worst
        Names of the contacts that limit the step; without any, the fastest element does.
    cause
        Why the step is unstable, and the cure.
    """
    points = model.contact_points
    nodes = [points.nodes_of(p)[0] for p, name in enumerate(points.names) if name in worst]
    body = max(model.bodies.values(), key=lambda body: float(body.frequency.max()))
    node = nodes[0] if nodes else int(body.element_nodes(np.argmax(body.frequency, keepdims=True))[0, 0])
    return Stop(0, node, "not started", NOT_STARTED, cause)


def likely_cause(stop: Stop, stable: str, why: str) -> str:
    """Return the likely cause of a stop, in words.

    Parameters
    ----------
    stop
        Record of where and why the run stopped.
    stable, why
        What the certificate says of the step, and the reason for that; with the cure of an unstable step.
    """
    if stop.cause:
        return stop.cause
    if stop.kind == "not solved":
        return UNSOLVED
    if stable == "no":
        return why
    if stop.kind == "contact work":
        return "contact adds energy each time it closes or opens; this pair of methods gives no bound on it"
    if stable == "marginal":
        return "at the critical step the highest frequency of a bar with free ends grows with time: lower it"
    return f"unknown: {why}"
