"""Three ways to judge whether a step is stable: the rows of the laws, the step itself, and closed forms.

`BlackBoxJudge` asks nothing of the laws and `ClosedForm` nothing of meshes, so that each checks `RowsJudge`; that one
asks the step itself only about bars of an element or two, above theta = 1.
"""

from __future__ import annotations

import dataclasses
import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.blackbox import DENSE, Motions, combinations, examine
from percuss.contact import broadcast, delassus_rows
from percuss.contracts import Rows
from percuss.pencil import EDGE, Pencil, critical_step, largest
from percuss.schemes import reach, scheme

if TYPE_CHECKING:
    from percuss.contracts import Floats, Judged
    from percuss.model import Model

NEVER_GROWS, BETWEEN = "never grows", "conserved between switchings"
NOT_GUARANTEED, UNKNOWN = "not guaranteed", "unknown"
WEAKEST_LAST = (NEVER_GROWS, BETWEEN, NOT_GUARANTEED, UNKNOWN)
BY_END = "the force follows from the gap at the end of the step: energy and what contacts store never exceed the work"
NO_CONTACT = "without contact the step conserves energy"
JUMPS = "the force follows from the gap at the current state: energy jumps as a contact closes or opens, either way"
PULLS = "with its mass the contact pulls before it opens, and each opening or closing may gain energy"
OTHER = "{} is no leap-frog scheme: what it does to energy as contacts open and close is not known"
SHARED = "contacts share an end: one may open or close another against what was predicted"
SHORT = 3  # elements
LOOSE = 1e-6  # of the critical step: what a search by the step itself settles for


class NoClosedFormError(Exception):
    """A case for which no closed form is known; the message says why."""


@dataclass(frozen=True)
class Closed:
    """What the laws of a model say of its points at one step; (P,) each, in the order of the case.

    Attributes
    ----------
    stiffness, inertia
        eps_s and eps_m; zero where a law is judged at the end of the step.
    predicted
        Whether the law is judged at the predicted gap.
    unknown
        Names of laws of which the rows say nothing: a kernel of their own, or a weight on the gap rate; in a scheme of
        stages all that are judged at the end of the step, too.
    energy, why
        What the pair guarantees of the energy, the weakest of all contacts, and the reason in words.
    """

    stiffness: Floats
    inertia: Floats
    predicted: Any
    unknown: tuple[str, ...]
    energy: str
    why: str


@dataclass(frozen=True)
class Finding:
    """What a judge finds of one step.

    Attributes
    ----------
    stable
        Whether nothing grows in the worst combination.
    worst
        The contacts closed in it.
    theta
        Of Wu's predictor-corrector, in that combination or the largest known.
    doubt
        Why that is less than certain, or why nothing can be said; empty where it is certain.
    known
        Whether anything can be said.
    """

    stable: bool
    worst: list[int] = field(default_factory=list)
    theta: float | None = None
    doubt: str = ""
    known: bool = True


def closed(model: Model, dt: float) -> Closed:
    """Return what the laws of a model say of its closed points for a step `dt`."""
    count = len(model.meetings)
    stiffness, inertia = np.zeros(count), np.zeros(count)
    predicted = np.zeros(count, dtype=bool)
    unknown: list[str] = []
    energy = [(NEVER_GROWS, BY_END) if count else (BETWEEN, NO_CONTACT)]
    stages, (*_, table) = scheme(model.case.method.integrator, dt)
    if stages is not None:
        energy.append((UNKNOWN, OTHER.format(model.case.method.integrator.name)))
    for entry in model.laws:
        law, where = entry["law"], entry["where"]
        bound = law.bind(entry["points"], dt)
        if not isinstance(bound, Rows):
            unknown.append(law.name)
            continue
        rows = broadcast(bound, entry["points"], law.name)
        if rows["at"] == "end":
            held = stages is None and rows["active"] == "all" and rows["sign"] == ">= 0" and not rows["rate"].any()
            if not held:
                unknown.append(law.name)
            continue
        if rows["rate"].any() or (rows["sigma"] <= 0).any():
            unknown.append(law.name)
            continue
        if not _readable(table.explicit, rows):
            unknown.append(f"{law.name} with {model.case.method.integrator.name}")
            continue
        stiffness[where] = rows["gap"] / rows["sigma"]
        predicted[where] = table.explicit.gap == "predicted"
        by_gap, _, by_acceleration = table.explicit.answer
        inertia[where] = (rows["gap"] * by_gap + rows["acceleration"] * by_acceleration) / rows["sigma"]
        if table.explicit.gap == "current":
            energy.append((NOT_GUARANTEED, PULLS) if inertia[where].any() else (BETWEEN, JUMPS))
        elif _share_an_end(model, where):
            energy.append((NOT_GUARANTEED, SHARED))
    if unknown and stages is None:
        energy.append((UNKNOWN, f"nothing is known of {', '.join(unknown)}, which is no line in gap and acceleration"))
    weakest, why = max(energy, key=lambda one: WEAKEST_LAST.index(one[0]))
    return Closed(stiffness, inertia, predicted, tuple(unknown), weakest, why)


def _readable(judged: Judged, rows: dict[str, Any]) -> bool:
    """Return whether stiffness and inertia of a closed contact follow from a law's rows with this table."""
    if judged.gap == "current":
        return judged.answer[0] == 0.0 and judged.acceleration == "bulk" and judged.answer[2] == 1.0
    return judged.acceleration == "none" or not rows["acceleration"].any()


def _share_an_end(model: Model, where: list[int]) -> bool:
    """Return whether a contact of `where` shares a node with any other: one then opens or closes what another saw."""
    nodes = [node for meeting in model.meetings for node in meeting.nodes]
    return any(nodes.count(node) > 1 for p in where for node in model.meetings[p].nodes)


class RowsJudge:
    """Judges steps by the rows of the laws: exact for any mesh and any combination of contacts.

    Central difference by the inertia of the closed pencil, Wu's predictor-corrector by theta in operator form. In
    stages, laws judged at the current state make every mode of the closed pencil an oscillator, so that its inertia
    tells there too, at the step that brings central difference to its limit where it brings the scheme to its own.

    Parameters
    ----------
    model
        The case as arrays.
    """

    by = "pencil"

    def __init__(self, model: Model) -> None:
        self.model = model
        self.pencil = Pencil(model)
        self.reach = reach(model.case.method.integrator, model.stages, model.dt)
        diagonal, others = delassus_rows(model.sides(0.5 * model.dt))
        self.delassus = np.diag(diagonal)
        for p, row in enumerate(others):
            for q, value in row.items():
                self.delassus[p, q] = value

    def theta(self, dt: float, said: Closed) -> tuple[float | None, list[int]]:
        """Return ``dt^2 lambda_max((I + S D_m)^-1 S D_s)`` of the contacts judged at the predicted gap, or None.

        And the contacts it comes from: those that share ends; any other that is closed damps what they excite.
        """
        from scipy.sparse.csgraph import connected_components

        which = np.flatnonzero(said.predicted & (said.stiffness > 0))
        most, worst = None, np.zeros(0, dtype=np.int64)
        alone = which.size < 2
        groups = 0 * which if alone else connected_components(self.delassus[np.ix_(which, which)] != 0)[1]
        for group in range(int(groups.max(initial=-1)) + 1):
            mine = which[groups == group]
            s = self.delassus[np.ix_(mine, mine)]
            left = np.eye(mine.size) + s * said.inertia[mine]
            values = np.linalg.eigvals(np.linalg.solve(left, s * said.stiffness[mine]))
            theta = float(dt**2 * np.max(values.real))
            if most is None or theta > most:
                most, worst = theta, mine
        return most, [int(p) for p in worst]

    def judge(self, dt: float) -> Finding:
        """Return what is to be said of a step."""
        said = closed(self.model, dt)
        current = ~said.predicted
        if self.reach == 0.0:
            return Finding(False)
        definite, worst = self.pencil.definite(
            dt / self.reach, np.where(current, said.stiffness, 0.0), np.where(current, said.inertia, 0.0)
        )
        theta, group = self.theta(dt, said)
        if theta is None or theta <= 1.0:
            return Finding(definite, worst, theta)
        if self._coarse is not None:
            return dataclasses.replace(self._coarse.judge(dt), theta=theta)
        return Finding(False, group, theta)

    @cached_property
    def _coarse(self) -> BlackBoxJudge | None:
        """The judge of steps above theta = 1, where a bar so short that contact damps all of it may stay stable."""
        short = any(body.stiffness.size < SHORT for body in self.model.bodies.values())
        return BlackBoxJudge(self.model) if short and 2 * self.model.mass.size <= DENSE else None

    @cached_property
    def free(self) -> float:
        """The largest step that is stable without contact."""
        return free_step(self.pencil) * self.reach

    def critical(self) -> float:
        """Return the largest stable step, laws bound anew for each step tried."""
        if self.free in {0.0, np.inf}:  # no step, or any: all nodes are held
            return self.free
        return critical_step(lambda dt: self.judge(dt).stable, self.free)


class BlackBoxJudge:
    """Judges steps by the amplification matrix of the march's own step; needs nothing from integrator and law.

    Parameters
    ----------
    model
        The case as arrays.
    """

    by = "black-box"

    def __init__(self, model: Model) -> None:
        self.model = model
        self.motions = Motions(model)
        self._limits: list[tuple[int, ...]] | None = None  # combinations unstable at the free step, once that is known

    @cached_property
    def free(self) -> float:
        """The largest step that is stable without contact."""
        model = self.model
        return free_step(self.motions.pencil) * reach(model.case.method.integrator, model.stages, model.dt)

    @cached_property
    def _tried(self) -> list[tuple[int, ...]]:
        """The combinations of closed contacts; of stages without the open one, which `free` is about."""
        every = combinations(len(self.model.meetings))
        return every if self.model.stages is None else every[1:]

    def judge(self, dt: float) -> Finding:
        """Return what is to be said of a step, over the combinations of closed contacts that are tried."""
        doubt, radius, theta = "", -1.0, None
        worst: list[int] = []
        tried = self._tried
        if self.model.stages is not None and dt > self.free * (1.0 + EDGE):
            return Finding(False)
        if 2 ** len(self.model.meetings) > len(combinations(len(self.model.meetings))):
            doubt = "tried were no contact, each one and all of them closed"
        for one in tried:
            found = examine(self.motions, dt, one, sure=dt < self.free and self._limits == [])
            if not found.linear:
                names = ", ".join(f"'{self.model.meetings[p].name}'" for p in one) or "none"
                doubt = f"the step is not linear with contacts {names} closed"
                if found.failure:
                    doubt = f"with contacts {names} held closed a kernel fails ({found.failure})"
                return Finding(False, list(one), doubt=doubt, known=False)
            if found.theta is not None and (theta is None or found.theta > theta):
                theta = found.theta
            if not found.stable:
                return Finding(False, list(one), found.theta)
            if not found.whole:
                doubt = "the model is large: growth was looked for by a Krylov iteration, and none found"
            if found.radius > radius * (1.0 + 1e-6):
                radius, worst = found.radius, list(one)
        return Finding(True, worst, theta, doubt)

    def critical(self) -> float:
        """Return the largest stable step, within `LOOSE`; a combination stable at the free step is so below it.

        nan where the step is not linear, of which nothing can be said.
        """
        if self.free in {0.0, np.inf}:
            return self.free
        tried = [(one, examine(self.motions, self.free * (1.0 - EDGE), one)) for one in self._tried]
        if not all(found.linear for _, found in tried):
            return np.nan
        limits = [one for one, found in tried if not found.stable]
        self._limits = limits
        if not limits:
            return self.free
        broken: list[float] = []  # steps that are not linear

        def holds(dt: float) -> bool:
            found = [examine(self.motions, dt, one) for one in limits]
            broken.extend(dt for one in found if not one.linear)
            return all(one.linear and one.stable for one in found)

        critical = largest(holds, self.free, LOOSE)
        return np.nan if broken else critical


class ClosedForm:
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
        if model.stages is not None:
            raise NoClosedFormError(f"{model.case.method.integrator.name} is no leap-frog scheme")
        self.sides: list[list[tuple[float, float]]] = []  # EA/h and 2c/h
        for body in model.bodies.values():
            if np.ptp(body.mesh.lengths) > 1e-9 * body.mesh.lengths.mean():
                raise NoClosedFormError(f"the elements of body '{body.name}' are unequal")
        nodes = [node for meeting in model.meetings for node in meeting.nodes]
        if len(set(nodes)) < len(nodes):
            raise NoClosedFormError("an end is in several contacts")
        if {hold.node for hold in Pencil(model).holds} & set(nodes):
            raise NoClosedFormError("an end in contact is fixed or driven")
        for meeting in model.meetings:
            ends = [(model.body_of(node), model.body_of(node).end_element(node)) for node in meeting.nodes]
            self.sides.append([(float(b.stiffness[e]), float(b.frequency[e])) for b, e in ends])
        self.free = 2.0 / model.omega

    def _stable(self, dt: float) -> bool:
        said = closed(self.model, dt)
        if said.unknown:
            raise NoClosedFormError(f"{', '.join(said.unknown)} is no line in gap and acceleration")
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


_FREE: dict[bytes, float] = {}


def free_step(pencil: Pencil) -> float:
    """Return the largest step that is stable without contact."""
    digest = hashlib.blake2b(np.float64(pencil.model.omega).tobytes())
    for _, *arrays in pencil.bodies:
        for array in arrays:
            digest.update(np.int64(array.size).tobytes() + array.tobytes())
    key = digest.digest()
    if key not in _FREE:  # many runs on the same bodies differ in their contacts alone
        if len(_FREE) >= 256:
            _FREE.clear()
        _FREE[key] = largest(lambda dt: pencil.factors(dt) is not None, 2.0 / pencil.model.omega)
    return _FREE[key]
