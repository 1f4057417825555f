"""Waves at an interface: reflection and transmission of a closed contact, measured by the black box.

Two infinitely long uniform bars meet in the contact. Harmonics of the leap-frog step in such a bar are known:
``(2/C) sin(omega dt/2) = Omega = 2 sin(k h/2)``. The motion of the ends in contact over a step is read from the
amplification matrix; two equations at the two ends then give reflection and transmission at any frequency.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.blas import one_blas_thread
from percuss.certificate.closed_laws import closed_laws
from percuss.certificate.closed_step import ClosedStep, Motions
from percuss.errors import InputError, PercussError, Problem, suggestion
from percuss.jsonable import Entries

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats


@dataclass(frozen=True)
class Waves:
    """Reflection and transmission of one closed contact; (F,) arrays.

    Attributes
    ----------
    contact
        Name of the contact.
    frequency
        Omega = 2 sin(k h / 2) of the end element of the first side, which is omega h / c of the bar without time
        steps; from 0 to 2 [1].
    reflected, transmitted
        Complex amplitudes of displacement over that of the incident wave; nothing is transmitted into a wall.
    kept
        Share of the incident energy that leaves the interface again; 1 where the interface conserves energy.
    formula
        Transmission by formula, for identical bars and a linear law; else None.
    reason
        Reason why there is no formula; empty where there is one.
    """

    contact: str
    frequency: Floats
    reflected: Any
    transmitted: Any
    kept: Floats
    formula: Any
    reason: str

    def rows(self) -> list[Entries]:
        """Return one dictionary for each frequency, with moduli and the phase of the transmission."""
        columns = {
            "frequency": self.frequency,
            "reflection": abs(self.reflected),
            "transmission": abs(self.transmitted),
            "transmission_phase": np.angle(self.transmitted),
            "formula": np.full(self.frequency.size, None) if self.formula is None else abs(self.formula),
            "energy_kept": self.kept,
        }
        values = zip(*(column.tolist() for column in columns.values()), strict=True)
        return [{"contact": self.contact, **dict(zip(columns, row, strict=True))} for row in values]


@one_blas_thread()
@np.errstate(all="ignore")  # equations that overflow have no solution
def waves(model: Model, contact: str = "", count: int = 200) -> Waves:
    """Return reflection and transmission of waves at a contact that is held closed.

    Parameters
    ----------
    model
        The case as arrays; integrator, contact law, step and end elements are measured as they are in it.
    contact
        Name of the contact; by default the first.
    count
        Number of frequencies.

    Raises
    ------
    InputError
        If there is no such contact.
    PercussError
        If a body is not linear or has elements of more than two nodes, the integrator is a multi-stage scheme or
        viscous, the step is not linear with the contact closed, or an end in contact is held, in a second contact, or
        of a body with fewer than two elements.
    """
    if why := _unlike_plain_bars(model):
        known = "harmonics at an interface are known of linear bars of two-node elements and a leap-frog step only"
        raise PercussError(f"{why}: {known}")
    names = model.contact_points.names
    if not names or (contact and contact not in names):
        advice = suggestion(contact, names, "contact") if names else "Add a contact."
        raise InputError([Problem("--contact", "", f"expected the name of a contact, found '{contact}'", advice)])
    p = names.index(contact) if contact else 0
    sides, from_place, from_speed = _ends(model, p)
    courant = [0.5 * model.dt * frequency for _, frequency in sides]
    # The first bar carries no wave above Omega = 2, and the leap-frog step none above Omega = 2/C.
    frequency = np.linspace(0.0, 2.0 * min(1.0, 1.0 / courant[0]), count + 2)[1:-1]
    step_phase = 2.0 * np.arcsin(0.5 * courant[0] * frequency)  # omega dt
    z = np.exp(1j * step_phase)
    phase = [_element_phase(2.0 / c * np.sin(0.5 * step_phase)) for c in courant]
    # Displacements along the normal of each end and of the node behind it: of the incident wave, and of the waves that
    # leave with unit amplitude, the reflected one and, into a second bar, the transmitted one.
    incident = np.zeros((count, 2 * len(courant), 1), dtype=complex)
    outgoing = np.zeros((count, 2 * len(courant), len(courant)), dtype=complex)
    incident[:, 0, 0], incident[:, 1, 0] = 1.0, np.exp(1j * phase[0])
    for side, of_side in enumerate(phase):
        outgoing[:, 2 * side, side], outgoing[:, 2 * side + 1, side] = 1.0, np.exp(-1j * of_side)
    equations = from_place + (1.0 - 1.0 / z)[:, None, None] * from_speed
    equations[:, :, ::2] -= (z - 1.0)[:, None, None] * np.eye(len(courant))
    try:
        amplitudes = np.linalg.solve(equations @ outgoing, -equations @ incident)[:, :, 0].T
    except np.linalg.LinAlgError:
        singular = np.abs(np.linalg.det(equations @ outgoing)).argmin()
        where = f"contact '{names[p]}': at the frequency {frequency[singular]:.6g}"
        raise PercussError(f"{where} the equations of its waves have no solution in numbers of 64 bits") from None
    reflected, transmitted = amplitudes if len(courant) > 1 else (*amplitudes, np.zeros(count, dtype=complex))
    flux = [stiffness * np.sin(angle).real for (stiffness, _), angle in zip(sides, phase, strict=True)]
    passed = np.abs(transmitted) ** 2 * flux[1] / flux[0] if len(flux) > 1 else 0.0
    formula, reason = _formula(model, p, frequency, step_phase)
    return Waves(names[p], frequency, reflected, transmitted, np.abs(reflected) ** 2 + passed, formula, reason)


def _unlike_plain_bars(model: Model) -> str:
    """Return what sets a model apart from linear bars of two-node elements under a leap-frog scheme, or nothing."""
    scheme = f"{model.case.method.integrator.name} is no leap-frog scheme" if model.multistage else ""
    cells = (
        f"the cells of body '{body.name}' are of the kind {kind}"
        for body in model.bodies.values()
        for kind in (body.mesh.cells if body.of_cells else ())
    )
    return model.bodies.why_not_linear or scheme or model.why("plain bars") or next(cells, "")


def _ends(model: Model, p: int) -> tuple[list[tuple[float, float]], Floats, Floats]:
    """Return the response of the ends of a closed contact, measured from the time step.

    Returns
    -------
    sides
        EA/h and 2c/h of the end element of each side.
    from_place, from_speed : (sides, 2 sides) arrays
        ``dt v`` of each end along the normal, after a step from a unit displacement and from a unit ``dt v`` of each
        end and of the node behind it.
    """
    points = model.contact_points
    contact, ends = f"contact '{points.names[p]}'", points.nodes_of(p)
    if why := model.why("waves"):
        raise PercussError(f"{contact}: {why}")
    motions = Motions(model)
    step = ClosedStep(motions, model.dt, [p])
    if not step.linear():
        raise PercussError(f"{contact}: the step is not linear while it is closed")
    bodies = [model.bodies.at(node) for node in ends]
    taken = {constraint.node for constraint in motions.constraints}.union(points.node[points.point != p].tolist())
    if taken.intersection(ends) or any(body.count < 2 for body in bodies):
        needed = "ends that move freely, in one contact, with two elements behind"
        raise PercussError(f"{contact}: waves need {needed}")
    behind = [end + 1 if end == body.start else end - 1 for end, body in zip(ends, bodies, strict=True)]
    nodes = [node for pair in zip(ends, behind, strict=True) for node in pair]
    units = np.zeros((len(nodes), model.bodies.n_nodes, model.dim))
    units[np.arange(len(nodes)), nodes] = points.normal[p]
    place = motions.projection @ (units.reshape(len(units), -1) * motions.root).T
    rest = np.zeros_like(place)
    readout = place[:, ::2] / np.sum(place[:, ::2] ** 2, axis=0)
    after = [step(np.concatenate(state))[step.size :] for state in ((place, rest), (rest, place))]
    elements = [(body, body.end_element(node)) for body, node in zip(bodies, ends, strict=True)]
    sides = [(float(body.stiffness[i]), float(body.frequency[i])) for body, i in elements]
    return sides, readout.T @ after[0], readout.T @ after[1]


def _element_phase(frequency: Floats) -> Any:
    """Return k h of a bar at the frequencies Omega, complex above Omega = 2, where the wave decays into the bar."""
    return np.conj(2.0 * np.arcsin(0.5 * frequency.astype(complex)))


def _formula(model: Model, p: int, frequency: Floats, step_phase: Floats) -> tuple[Any, str]:
    """Return the transmission between identical bars by formula, or None and the reason why there is no formula."""
    points = model.contact_points
    if points.at_wall[p] or not points.equal_sides[p]:
        return None, "a formula is known for identical bars only"
    laws = closed_laws(model, model.dt)
    if laws.stiffness[p] == 0:
        return None, f"no formula for {points.laws[p].name}"
    side = frequency * np.sqrt(1.0 - 0.25 * frequency**2)
    stiffness, inertia = laws.stiffness[p] / points.stiffness[p], laws.inertia[p] / points.mass[p]
    if not laws.predicted[p]:
        # The contact has the dynamic stiffness eps_s - eps_m omega^2, here over EA/h, as rho A h / 2 is
        # 2 (EA/h) / (2c/h)^2.
        return 1.0 / (1.0 + 1j * side / (2.0 * (stiffness - 0.5 * inertia * frequency**2))), ""
    # This is 1/kappa over h/EA, with s = 2/m of two equal masses. It is 0 at theta = 1, where contact takes back all of
    # the overlap.
    compliance = (1.0 + (laws.inertia[p] - model.dt**2 * laws.stiffness[p]) * 2.0 / points.mass[p]) / stiffness
    return 1.0 / (1.0 + 0.5j * side * np.exp(-1j * step_phase) * compliance), ""
