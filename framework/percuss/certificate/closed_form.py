"""Critical steps of uniform bars in closed form: no mesh, no matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from percuss.certificate.closed_contacts import closed_contacts
from percuss.certificate.pencil import Pencil, critical_step

if TYPE_CHECKING:
    from percuss.solver.model import Model


class NoClosedFormError(Exception):
    """A case for which no closed form is known; the message says why."""


class ClosedFormCriterion:
    """Critical steps of uniform bars taken as endless: no mesh, no matrix.

    A harmonic that decays into an endless bar of elements h holds its end with the stiffness
    ``(EA/h)(2/C) sqrt(1/C^2 - 1)`` at the step dt = C h/c; central difference is stable while both ends in series are
    stiffer than ``eps_s - 4 eps_m / dt^2`` is soft. On a rigid wall ``C = sqrt(2 / (1 + sqrt(1 + beta_s^2)))`` for the
    penalty method. Wu's predictor-corrector is stable for ``theta <= 1``.

    Parameters
    ----------
    model
        The case as arrays.

    Raises
    ------
    NoClosedFormError
        If a bar is not uniform, or ends share contacts.
    """

    by = "closed-form"

    def __init__(self, model: Model) -> None:
        self.model = model
        if model.why_not_linear:
            raise NoClosedFormError(f"{model.why_not_linear}")
        if model.stages is not None:
            raise NoClosedFormError(f"{model.case.method.integrator.name} is no leap-frog scheme")
        self.sides: list[list[tuple[float, float]]] = []  # EA/h and 2c/h
        for body in model.bodies.values():
            if np.ptp(body.mesh.lengths) > 1e-9 * body.mesh.lengths.mean():
                raise NoClosedFormError(f"the elements of body '{body.name}' are unequal")
        nodes = [node for contact_pair in model.contact_pairs for node in contact_pair.nodes]
        if len(set(nodes)) < len(nodes):
            raise NoClosedFormError("an end is in several contacts")
        if {hold.node for hold in Pencil(model).constraints} & set(nodes):
            raise NoClosedFormError("an end in contact is fixed or driven")
        for contact_pair in model.contact_pairs:
            ends = [(model.body_of(node), model.body_of(node).end_element(node)) for node in contact_pair.nodes]
            self.sides.append([(float(b.stiffness[e]), float(b.frequency[e])) for b, e in ends])
        self.free = 2.0 / model.omega

    def _stable(self, dt: float) -> bool:
        said = closed_contacts(self.model, dt)
        if said.unknown:
            raise NoClosedFormError("; ".join(said.doubts))
        if dt > self.free:
            return False
        for p, sides in enumerate(self.sides):
            if said.predicted[p]:
                # s = 1/m of each side, m = 2 (EA/h) / omega^2
                s = sum(frequency**2 / (2.0 * stiffness) for stiffness, frequency in sides)
                if dt**2 * said.stiffness[p] * s > 1.0 + said.inertia[p] * s:
                    return False
                continue
            excess = said.stiffness[p] - 4.0 * said.inertia[p] / dt**2
            courant = [0.5 * dt * frequency for _, frequency in sides]
            holds = [
                stiffness * 2.0 / c * np.sqrt(max(1.0 / c**2 - 1.0, 0.0))
                for (stiffness, _), c in zip(sides, courant, strict=True)
            ]
            if excess > 0 and sum(excess / h if h > 0 else np.inf for h in holds) > 1.0:
                return False
        return True

    def critical(self) -> float:
        """Return the critical step."""
        return critical_step(self._stable, self.free)
