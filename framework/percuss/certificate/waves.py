"""Waves at an interface: what a closed contact lets through and throws back, measured from the step itself.

Two endless uniform bars meet in the contact. Harmonics in them are known, of the leap-frog step as of the bar:
``(2/C) sin(omega dt/2) = Omega = 2 sin(k h/2)``. What the step makes of the ends in contact is read from the
amplification matrix; two equations at the two ends then give reflection and transmission at any frequency.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.certificate.black_box import ClosedStep, Motions
from percuss.certificate.closed_contacts import closed_contacts
from percuss.errors import InputError, PercussError, Problem, suggestion

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats
    from percuss.solver.model import Model


@dataclass(frozen=True)
class Waves:
    """Reflection and transmission of one contact; (F,) arrays.

    Attributes
    ----------
    contact
        Its name.
    frequency
        Omega = omega h / c of the first side's end element, as the bar sees it; from 0 to 2 [1].
    reflected, transmitted
        Complex amplitudes of displacement over that of the arriving wave; nothing is transmitted into a wall.
    kept
        Share of the arriving energy that leaves again; 1 where the interface keeps energy.
    formula
        Transmission by formula (identical bars, laws that are rows), or None.
    reason
        Why there is no formula.
    """

    contact: str
    frequency: Floats
    reflected: Any
    transmitted: Any
    kept: Floats
    formula: Any
    reason: str

    def rows(self) -> list[dict[str, Any]]:
        """Return one dict a frequency, moduli and phases."""
        return [
            {
                "contact": self.contact,
                "frequency": float(self.frequency[k]),
                "reflection": float(abs(self.reflected[k])),
                "transmission": float(abs(self.transmitted[k])),
                "transmission_phase": float(np.angle(self.transmitted[k])),
                "formula": None if self.formula is None else float(abs(self.formula[k])),
                "energy_kept": float(self.kept[k]),
            }
            for k in range(self.frequency.size)
        ]


def waves(model: Model, contact: str = "", count: int = 200) -> Waves:
    """Return what a contact held closed does to waves.

    Parameters
    ----------
    model
        The case as arrays; its integrator, law, step and end elements are those measured.
    contact
        Name of the contact; by default the first.
    count
        Number of frequencies.

    Raises
    ------
    InputError
        If there is no such contact.
    PercussError
        If a body is not linear, the integrator is no leap-frog scheme, the contact is not linear when closed, or an end
        in it is held or in a second contact.
    """
    if model.why_not_linear:
        raise PercussError(f"{model.why_not_linear}: its waves are no harmonics, and change with the strain")
    if model.stages is not None:
        name = model.case.method.integrator.name
        raise PercussError(
            f"{name} is no leap-frog scheme: harmonics at an interface are known of a leap-frog step only"
        )
    names = [contact_pair.name for contact_pair in model.contact_pairs]
    if not names or (contact and contact not in names):
        advice = suggestion(contact, names, "contact") if names else "Add a contact."
        raise InputError([Problem("--contact", "", f"expected the name of a contact, found '{contact}'", advice)])
    p = names.index(contact) if contact else 0
    contact_pair = model.contact_pairs[p]
    ends = _Ends(model, p)
    courant = [0.5 * model.dt * frequency for _, frequency in ends.sides]
    # up to where the first side or the leap-frog step itself ends
    frequency = np.linspace(0.0, 2.0 * min(1.0, 1.0 / courant[0]), count + 2)[1:-1]
    turn = 2.0 * np.arcsin(0.5 * courant[0] * frequency)  # omega dt
    z = np.exp(1j * turn)
    phase = [_phase(2.0 / c * np.sin(0.5 * turn)) for c in courant]
    reflected, transmitted = np.zeros((2, count), dtype=complex)
    for k in range(count):
        # displacement along the normal of each end and the node behind it, for R = T = 0, then by R and by T
        known = np.zeros(2 * len(ends.sides), dtype=complex)
        known[:2] = 1.0, np.exp(1j * phase[0][k])
        unknown = np.zeros((2 * len(ends.sides), len(ends.sides)), dtype=complex)
        for side in range(len(ends.sides)):
            unknown[2 * side : 2 * side + 2, side] = 1.0, np.exp(-1j * phase[side][k])
        rule = ends.place + (1.0 - 1.0 / z[k]) * ends.speed
        rule[:, ::2] -= (z[k] - 1.0) * np.eye(len(ends.sides))
        found = np.linalg.solve(rule @ unknown, -rule @ known)
        reflected[k], transmitted[k] = found[0], found[1] if found.size > 1 else 0.0
    flux = [stiffness * np.sin(angle).real for (stiffness, _), angle in zip(ends.sides, phase, strict=True)]
    onward = np.abs(transmitted) ** 2 * flux[1] / flux[0] if len(flux) > 1 else 0.0
    formula, reason = _formula(model, p, frequency, turn)
    return Waves(contact_pair.name, frequency, reflected, transmitted, np.abs(reflected) ** 2 + onward, formula, reason)


class _Ends:
    """What the step makes of the ends of a contact: ``dt v`` after it, by place and speed of ends and nodes behind."""

    def __init__(self, model: Model, p: int) -> None:
        contact_pair = model.contact_pairs[p]
        motions = Motions(model)
        step = ClosedStep(motions, model.dt, [p])
        if not step.linear():
            raise PercussError(f"contact '{contact_pair.name}': the step is not linear while it is closed")
        held = {hold.node for hold in motions.pencil.constraints}
        bodies = [model.body_of(node) for node in contact_pair.nodes]
        others = [
            m.name for m in model.contact_pairs if m is not contact_pair and set(m.nodes) & set(contact_pair.nodes)
        ]
        if held & set(contact_pair.nodes) or others or any(body.stiffness.size < 2 for body in bodies):
            raise PercussError(
                f"contact '{contact_pair.name}': waves need ends that move freely, in one contact, with two elements "
                "behind"
            )
        self.sides = [
            (float(b.stiffness[b.end_element(n)]), float(b.frequency[b.end_element(n)]))
            for b, n in zip(bodies, contact_pair.nodes, strict=True)
        ]
        behind = [n + 1 if n == b.start else n - 1 for b, n in zip(bodies, contact_pair.nodes, strict=True)]
        nodes = [node for pair in zip(contact_pair.nodes, behind, strict=True) for node in pair]
        place = np.stack([self._unit(motions, model, node, contact_pair.normal) for node in nodes], axis=1)
        rest = np.zeros_like(place)
        read = place[:, ::2] / np.sum(place[:, ::2] ** 2, axis=0)
        self.place = read.T @ step(np.concatenate([place, rest]))[step.size :]
        self.speed = read.T @ step(np.concatenate([rest, place]))[step.size :]

    @staticmethod
    def _unit(motions: Motions, model: Model, node: int, normal: Floats) -> Floats:
        full = np.zeros((model.n_nodes, model.dim))
        full[node] = normal
        return np.asarray(motions.read @ (full.ravel() * motions.root))


def _phase(frequency: Floats) -> Any:
    """Return k h of a bar at Omega, decaying into the bar where Omega is above 2."""
    return np.conj(2.0 * np.arcsin(0.5 * frequency.astype(complex)))


def _formula(model: Model, p: int, frequency: Floats, turn: Floats) -> tuple[Any, str]:
    """Return the transmission of identical bars by formula, or why there is none."""
    contact_pair = model.contact_pairs[p]
    if len(contact_pair.nodes) < 2 or not contact_pair.equal_sides:
        return None, "a formula is known for identical bars only"
    said = closed_contacts(model, model.dt)
    if contact_pair.law.name in said.unknown or said.stiffness[p] == 0:
        return None, f"no formula for {contact_pair.law.name}"
    side = frequency * np.sqrt(1.0 - 0.25 * frequency**2)
    stiffness, inertia = said.stiffness[p] / contact_pair.stiffness, said.inertia[p] / contact_pair.mass
    if not said.predicted[p]:
        # eps_s - eps_m omega^2, over EA/h; with rho A h / 2 = 2 (EA/h) / (2c/h)^2
        return 1.0 / (1.0 + 1j * side / (2.0 * (stiffness - 0.5 * inertia * frequency**2))), ""
    # 1/kappa over h/EA, s = 2/m of two equal masses; 0 at theta = 1, where contact takes back all of the overlap
    soft = (1.0 + (said.inertia[p] - model.dt**2 * said.stiffness[p]) * 2.0 / contact_pair.mass) / stiffness
    return 1.0 / (1.0 + 0.5j * side * np.exp(-1j * turn) * soft), ""
