"""Likely cause of a blow-up according to the certificate, and the stop of a run that its certificate forbids."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.march.stop import NOT_STARTED, Stop

if TYPE_CHECKING:
    from percuss.certificate.verdict import Certificate
    from percuss.march.model import Model

UNSOLVED = "one of these contacts joins masses too unlike: drop one of them, or refine the heavier side"


def not_started(model: Model, certificate: Certificate) -> Stop:
    """Return the stop of a run that its certificate forbids, placed at the node that limits the step."""
    nodes = [
        contact_point.nodes[0] for contact_point in model.contact_points if contact_point.name in certificate["worst"]
    ]
    body = max(model.bodies.values(), key=lambda body: float(body.frequency.max()))
    node = nodes[0] if nodes else int(body.element_nodes(np.argmax(body.frequency, keepdims=True))[0, 0])
    return Stop(0, node, "not started", NOT_STARTED, f"{certificate['why']}: {certificate['cure']}")


def likely_cause(stop: Stop, certificate: Certificate) -> str:
    """Return the likely cause of a stop, in words.

    Parameters
    ----------
    stop
        Record of where and why the run stopped.
    certificate
        The certificate of the run.
    """
    if stop.cause:
        return stop.cause
    if stop.kind == "not solved":
        return UNSOLVED
    if certificate["stable"] == "no":
        return f"{certificate['why']}: {certificate['cure']}"
    if stop.kind == "contact work":
        return "contact adds energy each time it closes or opens; this pair of methods gives no bound on it"
    if certificate["stable"] == "marginal":
        return "at the critical step the highest frequency of a bar with free ends grows with time: lower it"
    return f"unknown: {certificate['why']}"
