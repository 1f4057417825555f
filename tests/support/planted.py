"""Methods that are right, and the same with a mistake of the kind people make, each with the check it must fail."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np
from scipy.sparse import diags_array

from percuss import (
    BodyMesh,
    CellElement,
    ContactLaw,
    ContactState,
    Doc,
    Element,
    Ge,
    Gt,
    Integrator,
    LeapFrog,
    LinearLaw,
    Load,
    Mass,
    Material,
    Measure,
    Mesh,
    Pairing,
    Region,
    Shape,
    SolidElement,
    SolidMaterial,
    Stages,
    Surface,
    Unit,
    Wall,
    accelerations,
    coupled_rate,
    end_of_step,
    energy_density,
    stress,
    stress_2d,
)
from percuss_methods.elements.quad4 import Quad4
from percuss_methods.pairings._covered import covered
from percuss_methods.pairings.gauss_points import GaussPoints
from percuss_methods.pairings.mortar import Mortar
from percuss_methods.pairings.node_to_segment import NodeToSegment
from percuss_methods.solutions.bars_in_a_row import BarsInARow

SWITCHING = {"energy-never-grows with central-difference": "a contact that opens or closes between two steps"}
RIGHT = []
WRONG = []  # (class, check, words of what it must say)


def right(cls):
    RIGHT.append(cls)
    return cls


def caught_by(check, said=""):
    def keep(cls):
        WRONG.append((cls, check, said))
        return cls

    return keep


class law:
    """What contact laws of this file have in common."""

    summary = "a contact law"
    references = ("nobody, nowhere",)


Stiffness = Annotated[float, Gt(0), Unit("1"), Doc("stiffness over EA/h")]

# ------------------------------------------------------------------------------------------- laws that are rows


@right
@dataclass(frozen=True)
class Spring(ContactLaw):
    """A spring.

    Formula: ``lambda = beta_s (EA/h) <-g>``.
    """

    name = "spring"
    summary = "A spring"
    references = ("nobody, nowhere",)
    expected_failures = SWITCHING

    beta_s: Stiffness = 0.25

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0 / (self.beta_s * points.stiffness))


@caught_by("starts")
@dataclass(frozen=True)
class Misspelled(ContactLaw):
    """Asks the contact points for an attribute that they do not have."""

    name = "misspelled"
    summary = law.summary
    beta_s: Stiffness = 0.25

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0 / (self.beta_s * points.stifness))


@caught_by("starts")
@dataclass(frozen=True)
class InPlainPythonAlone(ContactLaw):
    """Has a kernel that numba cannot compile."""

    name = "in-plain-python-alone"
    summary = law.summary
    beta_s: Stiffness = 0.25

    def bind(self, points, dt):
        return Stiff(self.beta_s * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        table = {"k": bound.stiffness, "what": "text"}
        for p in range(multiplier.size):
            multiplier[p] = table["k"][p] * max(-trial.gap[p], 0.0)


@caught_by("pushes-apart")
@dataclass(frozen=True)
class WrongSign(ContactLaw):
    """Pulls where it should push."""

    name = "wrong-sign"
    summary = law.summary
    beta_s: Stiffness = 0.25

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0 / (self.beta_s * points.stiffness), gap=-1.0)


@caught_by("pushes-apart", "a dashpot of this sign adds energy")
@dataclass(frozen=True)
class DrivingDashpot(ContactLaw):
    """A spring whose dashpot has the wrong sign."""

    name = "driving-dashpot"
    summary = law.summary
    beta_s: Stiffness = 0.25

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0 / (self.beta_s * points.stiffness), rate=-1e-4)


@caught_by("pushes-apart", "a dashpot of this sign adds energy")
@dataclass(frozen=True)
class DrivingKernel(ContactLaw):
    """The same in a kernel."""

    name = "driving-kernel"
    summary = law.summary
    beta_s: Stiffness = 0.25

    def bind(self, points, dt):
        return Stiff(self.beta_s * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            overlap = max(-trial.gap[p], 0.0)
            multiplier[p] = bound.k[p] * overlap * max(1.0 + 0.1 * trial.rate[p], 0.0)


@caught_by("areas", "a surface twice as fine presses otherwise")
@dataclass(frozen=True)
class ForgetsTheArea(ContactLaw):
    """Has the same stiffness at each point, however many share a surface."""

    name = "forgets-the-area"
    summary = law.summary
    epsilon_s: Annotated[float, Gt(0), Unit("force/length"), Doc("stiffness")] = 500.0

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=np.full(points.weight.size, 1.0 / self.epsilon_s))


@caught_by("options-bounded")
@dataclass(frozen=True)
class NoBound(ContactLaw):
    """A stiffness that may be negative, or zero."""

    name = "no-bound"
    summary = law.summary
    beta_s: Annotated[float, Unit("1"), Doc("stiffness")] = 0.25

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0 / (self.beta_s * points.stiffness))


@caught_by("units")
@dataclass(frozen=True)
class WrongUnit(ContactLaw):
    """A stiffness with a unit, which says that it has none."""

    name = "wrong-unit"
    summary = law.summary
    epsilon: Annotated[float, Gt(0), Unit("1"), Doc("stiffness")] = 30.0

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0 / self.epsilon)


@caught_by("units")
@dataclass(frozen=True)
class StepIgnored(ContactLaw):
    """A compliance made from a step of a millisecond, whatever the step is."""

    name = "step-ignored"
    summary = law.summary

    def bind(self, points, dt):
        return LinearLaw(at="end", sigma=1e-3**2 * points.delassus, active="all", sign=">= 0")


CACHE = {}


@caught_by("no-hidden-state")
@dataclass(frozen=True)
class Remembers(ContactLaw):
    """Keeps the stiffness of the first run for all that follow."""

    name = "remembers"
    summary = law.summary

    def bind(self, points, dt):
        stiffness = CACHE.setdefault(len(points.names), points.stiffness)
        return LinearLaw(at="explicit", sigma=4.0 / stiffness)


@caught_by("any-number-of-contacts")
@dataclass(frozen=True)
class OneForAll(ContactLaw):
    """Takes the stiffness of the first contact for every one."""

    name = "one-for-all"
    summary = law.summary

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness[:1].sum())


@caught_by("inputs-untouched")
@dataclass(frozen=True)
class ChangesPoints(ContactLaw):
    """Doubles the stiffness in place."""

    name = "changes-points"
    summary = law.summary

    def bind(self, points, dt):
        points.stiffness[:] *= 2.0
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)


@caught_by("no-contact")
@dataclass(frozen=True)
class AtADistance(ContactLaw):
    """Pushes at any gap."""

    name = "at-a-distance"
    summary = law.summary

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness, active="all")


@caught_by("guarantees")
@dataclass(frozen=True)
class SaysTooMuch(ContactLaw):
    """A spring that says that nothing overlaps."""

    name = "says-too-much"
    summary = law.summary
    guarantees = ("no penetration",)

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)


@caught_by("guarantees")
@dataclass(frozen=True)
class LumpedInertia(ContactLaw):
    """Bipenalty whose mass is taken off the diagonal of the wrong matrix: it no longer keeps the free step."""

    name = "lumped-inertia"
    summary = law.summary
    guarantees = ("keeps the free step",)

    def bind(self, points, dt):
        eps_s = 4.0 * points.stiffness
        return LinearLaw(at="explicit", sigma=1.0 / eps_s + 0.25 * dt**2 * points.delassus, acceleration=0.0)


@caught_by("guarantees")
@dataclass(frozen=True)
class UnknownGuarantee(ContactLaw):
    """Guarantees something nobody knows."""

    name = "unknown-guarantee"
    summary = law.summary
    guarantees = ("never pull",)

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)


@caught_by("refusals")
@dataclass(frozen=True)
class RefusesWithoutAWord(ContactLaw):
    """Refuses an integrator, and does not say why."""

    name = "refuses-without-a-word"
    summary = law.summary

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)

    def refuses(self, integrator):
        return "" if integrator.name == "central-difference" else None


@caught_by("refusals")
@dataclass(frozen=True)
class RefusesAll(ContactLaw):
    """Is for nobody."""

    name = "refuses-all"
    summary = law.summary

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)

    def refuses(self, integrator):
        return "out of principle"


@caught_by("references")
@dataclass(frozen=True)
class NoSource(ContactLaw):
    """From nowhere."""

    name = "no-source"
    summary = law.summary

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)


@caught_by("facts")
@dataclass(frozen=True)
class Misspelt(ContactLaw):
    """Declares to fail a check that there is not."""

    name = "misspelt"
    summary = law.summary
    expected_failures = {"energy-newer-grows": "of a typing error"}

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)


@caught_by("units")
@dataclass(frozen=True)
class DeclaredButPasses(ContactLaw):
    """Declares to fail a check that it passes."""

    name = "declared-but-passes"
    summary = law.summary
    expected_failures = {"units": "it was so once"}

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)


@caught_by("options-documented")
@dataclass(frozen=True)
class Silent(ContactLaw):
    """Does not say what its option is."""

    name = "silent"
    summary = law.summary
    beta_s: Annotated[float, Gt(0)] = 0.25

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0 / (self.beta_s * points.stiffness))


@caught_by("examples")
@dataclass(frozen=True)
class BadExample(ContactLaw):
    """Has an example that no case could have."""

    name = "bad-example"
    summary = law.summary
    examples = ({"beta_s": -1.0},)
    beta_s: Stiffness = 0.25

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0 / (self.beta_s * points.stiffness))


@caught_by("resolved")
@dataclass(frozen=True)
class ResolvesNothing(ContactLaw):
    """Says of its parameters that they are not numbers."""

    name = "resolves-nothing"
    summary = law.summary

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=4.0 / points.stiffness)

    def resolved(self, points, dt):
        return {"epsilon_s": 0.0 * points.stiffness / 0.0 if not len(points.names) else np.full(3, 1.0)}


# ------------------------------------------------------------------------------- laws with a kernel of their own


class Nothing(NamedTuple):
    none: np.ndarray


NOTHING = Nothing(np.zeros(1))


@right
@dataclass(frozen=True)
class Rigid(ContactLaw):
    """Exact contact at the end of the step, one point at a time.

    Formula: ``lambda = <-g*> / (dt^2 s)``, g* the gap after the bulk update.
    """

    name = "rigid"
    summary = law.summary
    references = law.references
    guarantees = ("never pulls",)

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = max(-trial.predicted_gap[p], 0.0) / (trial.gap_response * trial.delassus[p])


@caught_by("exact-impact with central-difference")
@dataclass(frozen=True)
class Twice(ContactLaw):
    """The force, and the force again."""

    name = "twice"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        multiplier[:] = 0.0
        for _ in range(2):
            for p in range(multiplier.size):
                multiplier[p] += max(-trial.predicted_gap[p], 0.0) / (trial.gap_response * trial.delassus[p])


@caught_by("energy-never-grows with wu-predictor-corrector")
@dataclass(frozen=True)
class StaleGap(ContactLaw):
    """Looks at the gap before the step, and takes it for that at its end."""

    name = "stale-gap"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = max(-trial.gap[p], 0.0) / (trial.gap_response * trial.delassus[p])


@caught_by("exact-impact with central-difference")
@dataclass(frozen=True)
class NoStep(ContactLaw):
    """Divides by the step once too seldom."""

    name = "no-step"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = max(-trial.predicted_gap[p], 0.0) / (trial.rate_response * trial.delassus[p])


@caught_by("any-number-of-contacts")
@dataclass(frozen=True)
class FirstOnly(ContactLaw):
    """Handles the first contact."""

    name = "first-only"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        multiplier[0] = max(-trial.predicted_gap[0], 0.0) / (trial.gap_response * trial.delassus[0])


@caught_by("inputs-untouched")
@dataclass(frozen=True)
class ChangesTrial(ContactLaw):
    """Clips the gaps it is shown in place."""

    name = "changes-trial"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            trial.predicted_gap[p] = min(trial.predicted_gap[p], 0.0)
            multiplier[p] = -trial.predicted_gap[p] / (trial.gap_response * trial.delassus[p])


@caught_by("stored-and-dissipated")
@dataclass(frozen=True)
class ForgetsItsDashpot(ContactLaw):
    """Counts the work of its spring alone, though a dashpot takes energy beside it."""

    name = "forgets-its-dashpot"
    summary = law.summary
    state = 2
    stored_in, dissipated_in = 0, 1

    def bind(self, points, dt):
        return Stiff(0.25 * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            overlap = max(-trial.gap[p], 0.0)
            multiplier[p] = max(bound.k[p] * (overlap - 1e-3 * trial.rate[p]), 0.0) if overlap > 0.0 else 0.0
            trial.after[p, 0] = 0.5 * bound.k[p] * overlap**2


class Stiff(NamedTuple):
    k: np.ndarray


@caught_by("no-hidden-state")
@dataclass(frozen=True)
class KeepsInBound(ContactLaw):
    """Counts its steps in an array that all runs share."""

    name = "keeps-in-bound"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING_KEPT

    @staticmethod
    def multipliers(bound, trial, multiplier):
        bound.none[0] += 1.0
        for p in range(multiplier.size):
            soft = 1.0 / (1.0 + 1e-3 * bound.none[0])
            multiplier[p] = soft * max(-trial.predicted_gap[p], 0.0) / (trial.gap_response * trial.delassus[p])


NOTHING_KEPT = Nothing(np.zeros(1))


@right
@dataclass(frozen=True)
class Impulsive(ContactLaw):
    """Impulses at the velocity level, of all contacts at an end together.

    Formula: where ``g* <= 0``: ``0 <= lambda, g' + e g'_before >= 0``, one of them zero; else ``lambda = 0``.
    """

    name = "impulsive"
    summary = law.summary
    references = ("Jean: The non-smooth contact dynamics method, CMAME 177 (1999)",)
    guarantees = ("never pulls",)
    uses_coupling = True
    expected_failures = dict.fromkeys(
        ("energy-never-grows with central-difference", "energy-never-grows with wu-predictor-corrector"),
        "an impulse that stops the rate also moves the end of the step",
    )

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        multiplier[:] = 0.0
        for _ in range(1000):
            moved, largest = 0.0, 0.0
            for p in range(multiplier.size):
                if trial.predicted_gap[p] <= 0.0:
                    before = multiplier[p]
                    rate = coupled_rate(trial, multiplier, p)
                    multiplier[p] = max(before - rate / (trial.rate_response * trial.delassus[p]), 0.0)
                    moved, largest = max(moved, abs(multiplier[p] - before)), max(largest, multiplier[p])
            if moved <= 1e-14 * largest:
                break


@caught_by("contacts-at-one-end")
@dataclass(frozen=True)
class SweepsOnce(ContactLaw):
    """Sweeps over its contacts a single time, so that the first of those at one end feels nothing of the others.

    Formula: where ``g* <= 0``: ``0 <= lambda, g' >= 0``, one of them zero; else ``lambda = 0``.
    """

    name = "sweeps-once"
    summary = law.summary
    references = Impulsive.references
    guarantees = ("never pulls",)
    uses_coupling = True
    expected_failures = Impulsive.expected_failures

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        multiplier[:] = 0.0
        for p in range(multiplier.size):
            if trial.predicted_gap[p] <= 0.0:
                rate = coupled_rate(trial, multiplier, p)
                multiplier[p] = max(-rate / (trial.rate_response * trial.delassus[p]), 0.0)


@caught_by("coupling")
@dataclass(frozen=True)
class CouplingClaimed(ContactLaw):
    """Says that it takes account of other contacts at the same end, and looks at none of them."""

    name = "coupling-claimed"
    summary = law.summary
    uses_coupling = True

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = max(-trial.predicted_gap[p], 0.0) / (trial.gap_response * trial.delassus[p])


@caught_by("any-number-of-contacts")
@dataclass(frozen=True)
class LeavesUnset(ContactLaw):
    """Forgets the branch of a closed contact whose bodies part."""

    name = "leaves-unset"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            if trial.predicted_gap[p] >= 0.0:
                multiplier[p] = 0.0
            elif trial.rate[p] < 0.0:
                multiplier[p] = -trial.predicted_gap[p] / (trial.gap_response * trial.delassus[p])


class Deepest:
    """What a class attribute remembers."""

    overlap = 0.0


@caught_by("no-hidden-state")
@dataclass(frozen=True)
class KeepsInClass(ContactLaw):
    """Remembers the deepest overlap of all runs in a class attribute."""

    name = "keeps-in-class"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            Deepest.overlap = max(Deepest.overlap, -trial.predicted_gap[p])
            overlap = max(-trial.predicted_gap[p], 0.0) - 1e-3 * Deepest.overlap
            multiplier[p] = max(overlap, 0.0) / (trial.gap_response * trial.delassus[p])


@caught_by("no-hidden-state")
@dataclass(frozen=True)
class Dice(ContactLaw):
    """Draws a hair of its force at random."""

    name = "dice"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            overlap = max(-trial.predicted_gap[p], 0.0) * (1.0 + 1e-12 * np.random.rand())  # noqa: NPY002  what numba knows
            multiplier[p] = overlap / (trial.gap_response * trial.delassus[p])


@caught_by("units")
@dataclass(frozen=True)
class Tolerant(ContactLaw):
    """Calls a gap of a tenth of a millimetre closed, in whatever unit it is."""

    name = "tolerant"
    summary = law.summary

    def bind(self, points, dt):
        return NOTHING

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            overlap = max(1e-4 - trial.predicted_gap[p], 0.0)
            multiplier[p] = overlap / (trial.gap_response * trial.delassus[p])


# -------------------------------------------------------------------------------------------------- integrators


@right
@dataclass(frozen=True)
class Predicting(Integrator):
    """Contact judged at the predicted state.

    Formula: ``v = v* + dt M^-1 N lambda(u*)``.
    """

    name = "predicting"
    summary = "Contact judged at the predicted state"
    references = ("nobody, nowhere",)
    order = 2
    conserves = ("energy", "momentum")
    critical_courant = 1.0

    def bind(self, dt):
        return LeapFrog(ContactState("predicted", "predicted", "none", (0.0, 0.0, 1.0)), end_of_step(dt))


@dataclass(frozen=True)
class Viscous(Integrator):
    """Central difference with viscosity, of a limit below one half.

    Formula: ``v_{n+1/2} = v_{n-1/2} - dt M^-1 K (u_n + 2.5 dt v_{n-1/2})``.
    """

    name = "viscous"
    summary = "Central difference with much viscosity"
    references = ("nobody, nowhere",)
    order = 1
    conserves = ("momentum",)
    critical_courant = 6.0**-0.5

    def bind(self, dt):
        return LeapFrog(ContactState("current", "current", "bulk", (0.0, 0.0, 1.0)), end_of_step(dt), viscosity=2.5)


@dataclass(frozen=True)
class Stiffer(ContactLaw):
    """A spring that needs a small step.

    Formula: ``lambda = 20 (EA/h) <-g>``.
    """

    name = "stiffer"
    summary = "A stiff spring"

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=0.05 / points.stiffness)


def explicit(dt):
    return LeapFrog(ContactState("predicted", "predicted", "none", (0.0, 0.0, 1.0)), end_of_step(dt))


@caught_by("order")
@dataclass(frozen=True)
class OrderClaimed(Integrator):
    """Says that it is of order four."""

    name = "order-claimed"
    summary = "a scheme"
    order = 4

    def bind(self, dt):
        return explicit(dt)


@caught_by("critical-courant")
@dataclass(frozen=True)
class StableClaimed(Integrator):
    """Says that it may take twice the step."""

    name = "stable-claimed"
    summary = "a scheme"
    order = 2
    critical_courant = 2.0

    def bind(self, dt):
        return explicit(dt)


@caught_by("critical-courant")
@dataclass(frozen=True)
class TooModest(Integrator):
    """Says that it may take half the step only."""

    name = "too-modest"
    summary = "a scheme"
    order = 2
    critical_courant = 0.5

    def bind(self, dt):
        return explicit(dt)


@caught_by("conserves")
@dataclass(frozen=True)
class ConservesWhat(Integrator):
    """Conserves something nobody knows."""

    name = "conserves-what"
    summary = "a scheme"
    order = 2
    conserves = ("enegry",)

    def bind(self, dt):
        return explicit(dt)


@caught_by("energy-never-grows with bipenalty")
@dataclass(frozen=True)
class ShowsTooMuch(Integrator):
    """Shows the bulk acceleration beside the predicted state, which has it already."""

    name = "shows-too-much"
    summary = "a scheme"
    order = 2

    def bind(self, dt):
        return LeapFrog(ContactState("predicted", "predicted", "bulk", (0.0, 0.0, 1.0)), end_of_step(dt))


@caught_by("exact-impact with lagrange")
@dataclass(frozen=True)
class WrongAnswer(Integrator):
    """Says of the end of the step that a multiplier moves it half as far as it does."""

    name = "wrong-answer"
    summary = "a scheme"
    order = 2

    def bind(self, dt):
        return explicit(dt)._replace(end=ContactState("predicted", "predicted", "bulk", (0.1 * dt * dt, dt, 1.0)))


def at_the_top(cls):
    """Let pickle find a class that a function made."""
    cls.__qualname__ = cls.__name__ = cls.name.replace("-", "_")
    globals()[cls.__name__] = cls
    return cls


def staged(name, check=None, *, gamma=0.5, order=2, conserves=("momentum",), scale=1.0):
    """Explicit Newmark with a weight of the new acceleration: velocity Verlet at a half, of first order else."""

    @dataclass(frozen=True)
    class Newmark(Integrator):
        """Explicit Newmark.

        Formula: ``u += dt v + dt^2/2 a``, ``v += dt ((1 - gamma) a_n + gamma a_{n+1})``.
        """

        summary = "Newmark"
        references = ("Newmark (1959)",)
        kept = 1
        expected_failures = {"energy-never-grows": "at the ends of steps it is not quite the energy that is kept"}

        def bind(self, dt):
            return Stages(times=(1.0,), numbers=(gamma, scale))

        @staticmethod
        def step(numbers, system, u, v, kept, dt):
            before = kept[0].copy()
            u += dt * v + 0.5 * numbers[1] * dt**2 * before
            v += dt * (1.0 - numbers[0]) * before
            accelerations(system, 0, u, v, kept[0])
            v += dt * numbers[0] * kept[0]

        vars()["name"], vars()["order"], vars()["conserves"] = name, order, conserves

    return (caught_by(check) if check else right)(at_the_top(Newmark))


staged("newmark")
staged("order-two-claimed", "order", gamma=0.6)
staged("energy-claimed", "conserves", conserves=("energy",))
staged("half-the-acceleration", "order", scale=0.5)


@caught_by("order", "of the velocity")
@dataclass(frozen=True)
class HalfAStepBehind(Integrator):
    """Semi-implicit Euler, said to be of second order: so are its displacements, if they start from zero."""

    name = "half-a-step-behind"
    summary = "a scheme"
    order = 2

    def bind(self, dt):
        return Stages(times=(0.0,))

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        a = np.empty_like(u)
        accelerations(system, 0, u, v, a)
        v += dt * a
        u += dt * v


def verlet(name, check=None, *, time=1.0, end=(1.0, 1.0, 1.0), start=(1.0, 0.5, 0.5)):
    """Velocity Verlet, whose stage says of itself what is given: time, `end` and `start` in units of the step."""

    @dataclass(frozen=True)
    class Verlet(Integrator):
        """Velocity Verlet.

        Formula: ``w = v + dt/2 a_n``, ``u += dt w``, ``v = w + dt/2 a_{n+1}``.
        """

        summary = "Verlet"
        references = ("Swope and others (1982)",)
        order = 2
        conserves = ("momentum",)
        kept = 1
        expected_failures = {"energy-never-grows": "at the ends of steps it is not quite the energy that is kept"}

        def bind(self, dt):
            scale = np.array([dt, dt * dt, dt])
            return Stages(times=(time,), end=(tuple(end * scale),), start=tuple(start * scale[: len(start)]))

        @staticmethod
        def step(numbers, system, u, v, kept, dt):
            v += 0.5 * dt * kept[0]
            u += dt * v
            accelerations(system, 0, u, v, kept[0])
            v += 0.5 * dt * kept[0]

        vars()["name"] = name

    return (caught_by(check) if check else right)(at_the_top(Verlet))


verlet("loads-at-the-begin", "stages", time=0.0)
verlet("loads-in-the-middle", "stages", time=0.5)
verlet("end-five-times", "stages", end=(1.0, 5.0, 5.0))
verlet("end-too-soon", "stages", end=(0.5, 0.5, 1.0))
verlet("end-of-another-velocity", "stages", end=(1.0, 1.0, 0.5))
verlet("start-as-any-stage", "stages", start=())


# -------------------------------------------------------------------------------------------------------- loads


@right
@dataclass(frozen=True)
class Triangle(Load):
    """A triangle.

    Formula: ``A(t) = peak (1 - |2 t / duration - 1|)`` up to `duration`, zero after it.
    """

    name = "triangle"
    summary = "A triangle"
    examples = ({"peak": 2.0, "duration": 0.1},)
    peak: Annotated[float, Unit("amplitude"), Doc("largest value")]
    duration: Annotated[float, Gt(0), Unit("time"), Doc("length")]

    def amplitude(self, time):
        return self.peak * np.maximum(1.0 - np.abs(2.0 * time / self.duration - 1.0), 0.0)

    def kinks(self):
        return (0.5 * self.duration, self.duration)


class pulse:
    examples = ({"peak": 2.0, "duration": 0.1},)


@caught_by("kinks")
@dataclass(frozen=True)
class SmoothClaimed(Load):
    """A triangle that says it is smooth up to its end."""

    name = "smooth-claimed"
    summary = "a load"
    examples = pulse.examples
    peak: Annotated[float, Unit("amplitude"), Doc("largest value")]
    duration: Annotated[float, Gt(0), Unit("time"), Doc("length")]

    def amplitude(self, time):
        return self.peak * np.maximum(1.0 - np.abs(2.0 * time / self.duration - 1.0), 0.0)

    def kinks(self):
        return (self.duration,)


@caught_by("amplitude")
@dataclass(frozen=True)
class LooksAtNeighbours(Load):
    """Scales with the largest time it is asked for."""

    name = "looks-at-neighbours"
    summary = "a load"

    def amplitude(self, time):
        return time / (time.max(initial=0.0) or 1.0)


@caught_by("amplitude")
@dataclass(frozen=True)
class NumberOnly(Load):
    """Gives one number for all times."""

    name = "number-only"
    summary = "a load"

    def amplitude(self, time):
        return 1.0


@caught_by("amplitude")
@dataclass(frozen=True)
class ChangesTimes(Load):
    """Shifts the times it was handed."""

    name = "changes-times"
    summary = "a load"

    def amplitude(self, time):
        time += 1.0
        return np.sin(time)


# --------------------------------------------------------------------------------------------- bulk of the bodies


@caught_by("total-mass")
@dataclass(frozen=True)
class LumpedPenalty(Mass):
    """Lumps a penalty mass on the two ends, so that contact may be stiffer."""

    name = "lumped-penalty"
    summary = "a mass"

    def nodal(self, element_mass, lumping):
        nodal = lumping.at_nodes(element_mass)
        nodal[[0, -1]] *= 1.5
        return nodal


@caught_by("masses-in-contact")
@dataclass(frozen=True)
class Dropped(Mass):
    """Drops the mass of ends in contact, which nobody gets."""

    name = "dropped"
    summary = "a mass"

    def nodal(self, element_mass, lumping):
        return lumping.at_nodes(element_mass)

    def nodal_in_contact(self, element_mass, lumping, in_contact):
        nodal = lumping.at_nodes(element_mass)
        return nodal * ~in_contact


@caught_by("units-of-mass")
@dataclass(frozen=True)
class HalfOrNothing(Mass):
    """Moves the mass of an end in contact if that is a share of the whole that some bars meet exactly."""

    name = "half-or-nothing"
    summary = "a mass"

    def nodal(self, element_mass, lumping):
        return lumping.at_nodes(element_mass)

    def nodal_in_contact(self, element_mass, lumping, in_contact):
        nodal = lumping.at_nodes(element_mass)
        for end, beside, acts in ((0, 1, in_contact[0]), (-1, -2, in_contact[-1])):
            if acts and element_mass.size > 2 and nodal[end] / element_mass.sum() >= 0.05:  # ten equal elements
                nodal[[end, beside]] = 0.0, nodal[end] + nodal[beside]
        return nodal


@caught_by("inverse-mass")
@dataclass(frozen=True)
class OneSided(Mass):
    """Couples the nodes of the first elements alone: a body that moves as a whole does not show it."""

    name = "one-sided"
    summary = "a mass"

    def nodal(self, element_mass, lumping):
        return lumping.at_nodes(element_mass)

    def inverse(self, element_mass, lumping):
        lumped = lumping.at_nodes(element_mass)
        taken = 0.1 * element_mass * (np.arange(element_mass.size) < element_mass.size // 2)
        diagonal = (lumped - np.append(taken, 0.0) - np.append(0.0, taken)) / lumped**2
        beside = taken / (lumped[:-1] * lumped[1:])
        return diags_array([beside, diagonal, beside], offsets=[-1, 0, 1])


@caught_by("total-mass")
@dataclass(frozen=True)
class Leaning(Mass):
    """Gives each node the mass of the element behind it, and the last one a bit."""

    name = "leaning"
    summary = "a mass"

    def nodal(self, element_mass, lumping):
        nodal = np.append(element_mass, 0.1 * element_mass[-1])
        return nodal * element_mass.sum() / nodal.sum()


@right
@dataclass(frozen=True)
class Hooke(Material):
    """Hooke's law.

    Formula: ``stress = young strain``.
    """

    name = "hooke"
    summary = "Linear"
    linear = True
    examples = ({"young": 100.0, "density": 0.01},)
    young: Annotated[float, Gt(0), Unit("stress"), Doc("Young's modulus")]
    density: Annotated[float, Gt(0), Unit("density"), Doc("density")]

    @property
    def rho(self):
        return self.density

    @property
    def modulus(self):
        return self.young

    def parameters(self):
        return (self.young,)

    @staticmethod
    def stress(parameters, strain):
        return parameters[0] * strain

    @staticmethod
    def energy_density(parameters, before, after):
        return 0.5 * parameters[0] * before * after


def material(name, check, *, linear=True, modulus=1.0, curve=0.0, energy=0.5, sign=1.0, slack=0.0):
    @dataclass(frozen=True)
    class Wrong(Material):
        """Hooke's law, wrongly."""

        summary = "a material"
        examples = ({"young": 100.0, "density": 0.01},)
        young: Annotated[float, Gt(0), Unit("stress"), Doc("Young's modulus")]
        density: Annotated[float, Gt(0), Unit("density"), Doc("density")]

        @property
        def rho(self):
            return self.density

        @property
        def modulus(self):
            return modulus * self.young

        def parameters(self):
            return (sign * self.young, curve, energy)

        @staticmethod
        def stress(parameters, strain):
            if abs(strain) < slack:
                return -parameters[0] * strain
            return parameters[0] * strain * (1.0 - parameters[1] * abs(strain))

        @staticmethod
        def energy_density(parameters, before, after):
            return parameters[2] * parameters[0] * before * after

        vars()["name"] = name
        vars()["linear"] = linear

    return caught_by(check)(at_the_top(Wrong))


material("too-soft", "stress-and-energy", modulus=0.5)
material("curved", "stress-and-energy", curve=3.0)
material("curved-and-called-linear", "linear", curve=3.0)
material("twice-the-energy", "stress-and-energy", energy=1.0)
material("pulls-where-it-pushes", "stress-and-energy", linear=False, sign=-1.0)
material("wrong-sign-when-small", "stress-and-energy", linear=False, slack=1e-5)
material("modulus-too-large", "stress-and-energy", linear=False, modulus=4.0)


class Arrays(NamedTuple):
    inverse: np.ndarray
    area: np.ndarray
    direction: np.ndarray


def element(name, check=None, *, sets=True, factor=1.0, frequency=2.0, energy_factor=0.5, share=1.0, stiffness=1.0):
    @dataclass(frozen=True)
    class Plain(Element):
        """A bar of two nodes.

        Formula: ``force = A stress(strain) e``.
        """

        summary = "A bar"
        references = ("nobody, nowhere",)

        def bind(self, body: BodyMesh):
            count = body.mesh.lengths.size
            return Arrays(
                1.0 / body.mesh.lengths, np.full(count, body.section), np.tile(body.mesh.direction, (count, 1))
            )

        def axial_stiffness(self, body, modulus):
            return stiffness * modulus * body.section / body.mesh.lengths

        def highest_frequency(self, body, wave_speed):
            return frequency * wave_speed / body.mesh.lengths

        @staticmethod
        def internal_force(element, material, first, dim, displacement, force):
            for i in range(force.size):
                force[i] = 0.0 if sets else force[i]
            for i in range(displacement.size // dim - 1):
                stretch = 0.0
                for d in range(dim):
                    change = displacement[(i + 1) * dim + d] - displacement[i * dim + d]
                    stretch += element.direction[first + i, d] * change
                strain = share * stretch * element.inverse[first + i]
                axial = element.area[first + i] * stress(material, first + i, strain) / share
                for d in range(dim):
                    force[i * dim + d] += factor * axial * element.direction[first + i, d]
                    force[(i + 1) * dim + d] -= axial * element.direction[first + i, d]

        @staticmethod
        def energy(element, material, first, dim, displacement, velocity, dt):
            total = 0.0
            for i in range(displacement.size // dim - 1):
                after = 0.0
                rate = 0.0
                for d in range(dim):
                    j, k = (i + 1) * dim + d, i * dim + d
                    after += element.direction[first + i, d] * (displacement[j] - displacement[k])
                    rate += element.direction[first + i, d] * (velocity[j] - velocity[k])
                inverse = element.inverse[first + i]
                density = energy_density(material, first + i, (after - dt * rate) * inverse, after * inverse)
                total += 2.0 * energy_factor * element.area[first + i] / inverse * density
            return total

        vars()["name"] = name

    return (caught_by(check) if check else right)(at_the_top(Plain))


element("plain-bar")
element("adds-to-the-force", "force-and-energy", sets=False)
element("one-sided", "force-and-energy", factor=0.9)
element("energy-of-its-own", "force-and-energy", energy_factor=0.4)
element("stiffness-of-its-own", "force-and-energy", stiffness=2.0)
element("too-slow", "frequency", frequency=1.0)
element("too-fast", "frequency", frequency=5.0)
element("half-the-strain", "stress-in-the-element", share=0.5)


class CellRule(NamedTuple):
    slope: np.ndarray
    weight: np.ndarray


def cell(name, check=None, *, shares=(1.0, 1.0, 4.0), volume=1.0, frequency=24.0**0.5, sets=True, factor=1.0):
    @dataclass(frozen=True)
    class ThreeNodes(CellElement):
        """A bar of three nodes, integrated at them.

        Formula: ``force = A stress(strain) e``.
        """

        summary = "A bar"
        references = ("nobody, nowhere",)
        cell = "line3"
        linear = True

        def rule(self):
            slope = np.array([[-3.0, -1.0, 4.0], [1.0, 3.0, -4.0], [-1.0, 1.0, 0.0]])
            return CellRule(slope, np.array([1.0, 1.0, 4.0]) / 6)

        def reference_nodes(self):
            return np.array([0.0, 1.0, 0.5])

        def mass_shares(self, body):
            return np.array(shares) / 6

        def volumes(self, body):
            return volume * np.outer(body.section * body.mesh.lengths, [1.0, 1.0, 4.0]) / 6

        def axial_stiffness(self, body, modulus):
            return modulus * body.section / body.mesh.lengths

        def highest_frequency(self, body, wave_speed):
            return frequency * wave_speed / body.mesh.lengths

        @staticmethod
        def force(rule, material, first, section, coordinates, displacement, force):
            nodes, dim = force.shape
            squared = 0.0
            for d in range(dim):
                squared += (coordinates[1, d] - coordinates[0, d]) ** 2
                for a in range(nodes):
                    force[a, d] = 0.0 if sets else force[a, d]
            for q in range(nodes):
                strain = 0.0
                for a in range(nodes):
                    for d in range(dim):
                        along = coordinates[1, d] - coordinates[0, d]
                        strain += rule.slope[q, a] * displacement[a, d] * along / squared
                axial = section * rule.weight[q] * stress(material, first + q, strain) / np.sqrt(squared)
                for d in range(dim):
                    along = coordinates[1, d] - coordinates[0, d]
                    force[0, d] -= factor * axial * rule.slope[q, 0] * along
                    force[1, d] -= axial * rule.slope[q, 1] * along
                    force[2, d] -= axial * rule.slope[q, 2] * along

        vars()["name"] = name

    return (caught_by(check) if check else right)(at_the_top(ThreeNodes))


cell("three-nodes")
cell("adds-to-the-force-of-a-cell", "force-and-energy", sets=False)
cell("one-sided-cell", "force-and-energy", factor=0.9)
cell("lost-volume", "force-and-energy", volume=0.5)
cell("wrong-volume", "cells", volume=0.5)
cell("lopsided", "cells", shares=(2.0, 1.0, 3.0))
cell("too-slow-cell", "frequency", frequency=4.0)


@caught_by("mesh")
@dataclass(frozen=True)
class NeverFiner(Shape):
    """Has as many elements as it was born with."""

    name = "never-finer"
    summary = "a shape"
    regions = ("left", "right")
    examples = ({"length": 1.0},)
    length: Annotated[float, Gt(0), Unit("length"), Doc("length")]

    def dimension(self):
        return None

    def mesh(self, at, refine):
        direction = np.eye(at.size)[0]
        nodes = at + np.linspace(0.0, self.length, 5)[:, None] * direction
        ends = {"left": Region((0,), -direction), "right": Region((4,), direction)}
        return Mesh.of_line(nodes, np.full(4, self.length / 4), direction, ends)


def solid_material(name, check, said, *, linear=True, modulus=3.0, **wrong):
    @dataclass(frozen=True)
    class Wrong(SolidMaterial):
        """Hooke's law of small strains, rightly or wrongly.

        Formula: ``P = tr(strain) I + 2 strain``.
        """

        summary = "a material"
        rho = 1.0

        def wave_modulus(self, plane):
            return modulus

        def solid_parameters(self, plane):
            return tuple(wrong.get(key, usual) for key, usual in USUAL.items())

        @staticmethod
        def stress_2d(parameters, gradient):
            twice, spinning, rest, curve, sheared, sign = parameters
            xx, xy, yx, yy = sign * gradient[0], sign * gradient[1], sign * gradient[2], sign * gradient[3]
            shear, spin = sheared * (xy + yx), spinning * (xy - yx)
            mean = xx + yy + rest + curve * (xx + yy) ** 3
            return mean + 2.0 * xx, twice * shear + spin, shear - spin, mean + 2.0 * yy

        @staticmethod
        def stored_2d(parameters, gradient):
            xx, xy, yx, yy = gradient
            sum_of_both, of_spin = xx + yy, parameters[1] * (xy - yx) ** 2
            squares = xx**2 + yy**2 + 0.5 * (parameters[4] * (xy + yx) ** 2 + of_spin)
            return 0.5 * sum_of_both**2 + 0.25 * parameters[3] * sum_of_both**4 + squares

        if linear:
            stored_2d = None
        vars()["name"] = name
        vars()["linear"] = linear

    return (caught_by(check, said) if check else right)(at_the_top(Wrong))


USUAL = {"twice": 1.0, "spinning": 0.0, "rest": 0.0, "curve": 0.0, "sheared": 1.0, "sign": 1.0}
solid_material("hooke-in-two-dimensions", "", "")
solid_material("stiffens", "", "", linear=False, curve=5.0)
solid_material("twice-the-shear", "solid-stress", "the slope of the energy", twice=2.0)
solid_material("holds-its-direction", "solid-stress", "does not turn with the body", spinning=0.5)
solid_material("strained-at-rest", "solid-stress", "a body at rest has stress", rest=1e-3)
solid_material("waves-too-fast", "solid-stress", "`wave_modulus` is 2", modulus=2.0)
solid_material("waves-too-slow", "solid-stress", "`wave_modulus` is 4", modulus=4.0)
solid_material("negative-modulus", "solid-stress", "and `wave_modulus` is -3: none", modulus=-3.0)
solid_material("pushes-where-it-pulls", "solid-stress", "waves of the moduli -3 to -1", sign=-1.0)
solid_material("fast-across", "solid-stress", "`wave_modulus` is 3", sheared=3.0)
solid_material("curved-in-two-dimensions", "linear", "not proportional", curve=3.0)


def shearing(name, said):
    """Plant a material without lateral contraction whose kernel is a function."""

    def plant(kernel):
        @dataclass(frozen=True)
        class Wrong(SolidMaterial):
            """Hooke's law."""

            summary = "a material"
            linear = True
            rho = 1.0
            stress_2d = staticmethod(kernel)

            def wave_modulus(self, plane):
                return 2.0

            def solid_parameters(self, plane):
                return (2.0,)

            vars()["name"] = name

        caught_by("blocks", said)(at_the_top(Wrong))
        return kernel

    return plant


@shearing("for-python-alone", "cannot be compiled")
def for_python_alone(parameters, gradient):
    xx, xy, yx, yy = (parameters[0] * value for value in gradient)
    return xx, 0.5 * (xy + yx), 0.5 * (xy + yx), yy


@shearing("no-number-in-compression", "expected finite numbers")
def no_number_in_compression(parameters, gradient):
    xx, xy, yx, yy = gradient
    size = parameters[0] if xx > -1e-7 else np.nan
    return size * xx, 0.5 * size * (xy + yx), 0.5 * size * (xy + yx), size * yy


@shearing("overflows", "the run in plain Python differs by")
def overflows(parameters, gradient):
    xx, xy, yx, yy = gradient
    large = int(2.0**40 * parameters[0])
    size = parameters[0] if large * large % 7 else 0.9 * parameters[0]
    return size * xx, 0.5 * size * (xy + yx), 0.5 * size * (xy + yx), size * yy


def square(
    name,
    said="",
    *,
    way=1,
    shift=0.0,
    count=1,
    finer=True,
    follows=True,
    above=True,
    cells_run=1,
    grows=0.0,
    lonely=0,
    short=0,
):
    @dataclass(frozen=True)
    class Square(Shape):
        """A square of squares."""

        summary = "a shape"
        regions = ("skin", "top")
        cell = "quad"

        def dimension(self):
            return 2

        def element_count(self, refine):
            return count and count * (2 * self.refined(1, refine)) ** 2

        def mesh(self, at, refine):
            n = 2 * (refine if finer else 1)
            x, y = np.meshgrid(np.arange(n + 1) / n, np.arange(n + 1) / n, indexing="ij")
            x += shift * y * (1.0 - y) + grows * refine * x
            nodes = np.stack([x, y], axis=-1).reshape(-1, 2) + (at if follows else 0.0)
            nodes = np.append(nodes, nodes[:lonely] + 0.1, axis=0)
            number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
            cells = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
            run = np.concatenate([number[0, :0:-1], number[:-1, 0], number[-1]])
            skin, top = (np.stack([line[:-1], line[1:]], axis=1)[:, ::way] for line in (run, number[::-1, -1]))
            regions = {
                "skin": Region(tuple(run.tolist()), np.zeros(2), {"line": skin if above else np.vstack([skin, top])}),
                "top": Region((), np.array([0.0, 1.0]), {"line": top[short:] if above else top[:0]}),
            }
            return Mesh(nodes, {"quad": cells.reshape(-1, 4)[:, ::cells_run]}, regions)

        vars()["name"] = name

    return (caught_by("solid-mesh", said) if said else right)(at_the_top(Square))


square("square-of-squares")
square("turned-inwards", "an edge with the body on its right", way=-1)
square("a-node-too-many", "belongs to no cell", lonely=1)
square("ends-too-early", "do not enclose its volume", short=1)
square("slivers", "has an angle of", shift=40.0)
square("counts-twice", "`element_count` is 8", count=2)
square("never-finer-squares", "the largest cell is 0.5 long, and 0.5 with", count=None, finer=False)
square("clockwise", "expected corners that run anticlockwise", cells_run=-1)
square("wider-if-refined", "`refine` moves a region", grows=0.1)
square("stays-at-the-origin", "does not start where the case places it", follows=False)
square("nothing-on-top", "the region 'top' has no facets", above=False)


class Knobs(NamedTuple):
    numbers: np.ndarray


def solid(name, check="", said="", *, volume=1.0, mean=False, share=1.0, **wrong):
    @dataclass(frozen=True)
    class Plane(SolidElement):
        """A quadrilateral, whose gradients are right or not.

        Formula: ``f_a = -sum over points of V P grad N_a``.
        """

        summary = "an element"
        references = ("nobody, nowhere",)
        linear = True
        cell = "quad"
        dimension = 2

        def rule(self):
            return Knobs(np.array([wrong.get(key, usual) for key, usual in KNOBS.items()]))

        def geometry(self, body):
            geometry = Quad4.geometry(Quad4(), body)
            if mean:
                geometry[..., -1] = geometry[..., -1].mean(axis=1, keepdims=True)
            return geometry

        def volumes(self, body):
            return self.geometry(body)[..., -1]

        def volumes_of_cells(self, body):
            return volume * self.volumes(body).sum(axis=1)

        def mass_shares(self, body):
            return np.array([share, 2.0 - share, share, 2.0 - share]) / 4.0

        @staticmethod
        def force(rule, material, first, section, geometry, displacement, force):
            symmetric, across, lost, slack, averaged = rule.numbers
            force[:] = 0.0
            mean = volume = 0.0
            for q in range(4):
                volume += geometry[q, 8]
                for a in range(4):
                    along = displacement[a, 0] * geometry[q, 2 * a] + displacement[a, 1] * geometry[q, 2 * a + 1]
                    mean += geometry[q, 8] * along
            for q in range(4):
                xx = xy = yx = yy = 0.0
                for a in range(4):
                    by_x, by_y = geometry[q, 2 * a], geometry[q, 2 * a + 1]
                    xx += displacement[a, 0] * by_x
                    xy += displacement[a, 0] * by_y
                    yx += displacement[a, 1] * by_x
                    yy += displacement[a, 1] * by_y
                xy, yx = xy - symmetric * (xy - yx), yx + symmetric * (xy - yx)
                more = 0.5 * averaged * (mean / volume - xx - yy)
                stress = stress_2d(material, first + q, (xx + more, xy, (1.0 - lost) * yx, yy + more))
                if abs(xx) + abs(xy) + abs(yx) + abs(yy) < slack:
                    continue
                for a in range(4):
                    by_x, by_y = geometry[q, 2 * a] * geometry[q, 8], geometry[q, 2 * a + 1] * geometry[q, 8]
                    force[a, 0] -= stress[0] * by_x + stress[1] * by_y
                    force[a, 1] -= across * ((1.0 - lost) * stress[2] * by_x + stress[3] * by_y)

        vars()["name"] = name

    return (caught_by(check, said) if check else right)(at_the_top(Plane))


KNOBS = {"symmetric": 0.0, "across": 1.0, "lost": 0.0, "slack": 0.0, "averaged": 0.0}
solid("plain-quadrilateral")
solid("half-across", "solid-forces", "minus the slope of the energy", across=0.5)
# Forces that forget how the mean depends on the displacement are right as long as the material is isotropic and linear.
solid("forgotten-mean", "solid-forces", "minus the slope of the energy", averaged=1.0)
solid("gains-energy", "blocks", "the balance of energy is open", across=0.5)
solid("symmetric-gradient", "finite-rotation", "the forces do not turn with the body", symmetric=0.5)
solid("lost-slope", "solid-forces", "a rotation of the body gives a force", lost=0.2)
solid("mean-volumes", "solid-forces", "it fails the patch test", mean=True)
solid("twice-the-mass", "solid-masses", "of a body of", volume=2.0)
solid("nodes-of-no-mass", "solid-masses", "the nodes have the masses", share=0.0)
solid("dead-when-small", "solid-masses", "no cell at rest one above", slack=1e-5)


def pairing(name, check, said, **facts):
    """Plant a pairing whose points are those of a function, by default of `NodeToSegment`."""

    def plant(points):
        @dataclass(frozen=True)
        class Wrong(Pairing):
            """The nodes of a surface, wrongly."""

            summary = "a pairing"

            def points(self, first, second):
                return points(first, second)

            vars()["name"] = name
            vars().update(facts)

        caught_by(check, said)(at_the_top(Wrong))
        return points

    return plant


def nodes_of(first, second):
    return NodeToSegment().points(first, second)


CALLS = []


@pairing("counts-its-calls", "blocks", "gives another answer when it is asked the same again")
def counts_its_calls(first, second):
    CALLS.append(1)
    found = nodes_of(first, second)
    return found._replace(weight=found.weight * (1.0 + 1e-3 * len(CALLS)))


pairing("promises-too-much", "patch-test", "pressures at nodes are wrong by 4.8", passes_patch_test=True)(nodes_of)
pairing("negative-shares", "shares", "has the share -0.", dimensions=(2,))(lambda *surfaces: Mortar().points(*surfaces))


@pairing("turned-round", "shares", "the shares of a surface in a gap add up to -1, expected 1")
def turned_round(first, second):
    found = nodes_of(first, second)
    return found._replace(value=-found.value)


pairing("points-on-edges", "shares", "6 nodes have 10 points")(lambda *surfaces: GaussPoints(2).points(*surfaces))


@pairing("no-number-apart", "pairing", "points returned as `gap` nan")
def no_number_apart(first, second):
    found = nodes_of(first, second)
    return found._replace(gap=np.where(found.gap > 0.01, np.nan, found.gap))


@pairing("half-of-the-area", "pairing", "0.4 in all, not 0.8", more_points_than_nodes=True)
def half_of_the_area(first, second):
    found = GaussPoints(2).points(first, second)
    return found._replace(weight=0.5 * found.weight)


@pairing("pulls-one-side", "pairing", "does not change by the distance")
def pulls_one_side(first, second):
    found = nodes_of(first, second)
    return found._replace(value=np.where(np.isin(found.node, first.nodes)[:, None], found.value, 0.5 * found.value))


pairing("gains-momentum", "blocks", "the balance of momentum is open")(pulls_one_side)


@pairing("along-x", "pairing", "gaps are")
def along_x(first, second):
    found = nodes_of(first, second)
    return found._replace(gap=found.gap / np.abs(found.normal[:, 0]))


@pairing("shares-swapped", "pairing", "turn as one")
def shares_swapped(first, second):
    found = nodes_of(first, second)
    value = found.value.copy()
    for start, stop in pairwise(found.start):
        value[start + 1 : stop] = value[start + 1 : stop][::-1]
    return found._replace(value=value)


@pairing("beside-the-point", "pairing", "the slope of a gap")
def beside_the_point(first, second):
    """Give the force of the second node to its neighbours, as a lever would."""
    found = nodes_of(first, second)
    shares = np.eye(len(first.nodes))
    length = first.areas[:2]
    shares[1, :3] = [length[1] / length.sum(), 0.0, length[0] / length.sum()]
    start, node, value = [0], [], []
    for p, (begin, stop) in enumerate(pairwise(found.start)):
        of_first = np.flatnonzero(np.isin(found.node[begin:stop], first.nodes)) + begin
        others = np.setdiff1d(np.arange(begin, stop), of_first)
        own = shares[found.node[of_first[0]] - first.nodes[0]]
        node += [*first.nodes, *found.node[others]]
        value += [*(-own[:, None] * found.normal[p]), *found.value[others]]
        start.append(len(node))
    return found._replace(start=np.array(start), node=np.array(node), value=np.array(value))


@pairing("leans-to-one-side", "pairing", "seen in a mirror")
def leans_to_one_side(first, second):
    found = nodes_of(first, second)
    weight = np.zeros(len(first.nodes))
    np.add.at(weight, first.facets, first.areas[:, None] * [0.3, 0.7])
    covered = np.isin(first.nodes, found.node)
    return found._replace(weight=weight[covered] if covered.sum() == found.gap.size else found.weight)


@pairing("meets-from-afar", "pairing", "surfaces that do not face each other")
def meets_from_afar(first, second):
    found = nodes_of(first, second)
    return found if found.gap.size else nodes_of(first, Wall(second.positions[0], second.normals[0]))


@pairing("beyond-the-end", "pairing", "of a surface covered by 0.48")
def beyond_the_end(first, second):
    """Stretch the second surface far beyond its ends, if it is the narrower one."""
    if not isinstance(second, Surface) or second.areas.sum() > 0.9 * first.areas.sum():
        return nodes_of(first, second)
    positions = second.positions.copy()
    positions[[0, -1]] += 9.0 * (positions[[0, -1]] - positions.mean(axis=0))
    return nodes_of(first, second._replace(positions=positions))


@pairing("dual-on-whole-facets", "pairing", "turn as one", dimensions=(2,), convex=False)
def dual_on_whole_facets(first, second):
    """Take functions that are dual on whole facets, of which the second surface may cover a part."""
    if not isinstance(second, Surface):
        return nodes_of(first, second)
    at, exact = covered(first, second), Mortar().points(first, second)
    number = np.arange(exact.gap.size), np.searchsorted(first.nodes, exact.node[exact.start[:-1]])
    rows = np.zeros((len(first.nodes), len(first.nodes) + len(second.nodes)))
    dual = at.area[:, None] * (3.0 * at.share - 1.0)
    others = len(first.nodes) + second.facets[at.other]
    np.add.at(rows, (first.facets[at.facet][:, :, None], others[:, None]), dual[:, :, None] * at.other_share[:, None])
    rows = rows[number[1]] / exact.weight[:, None]
    rows[number] = -1.0
    nodes, positions = np.concatenate([first.nodes, second.nodes]), np.concatenate([first.positions, second.positions])
    value = rows[..., None] * exact.normal[:, None]
    start = np.arange(exact.gap.size + 1) * nodes.size
    gap = np.einsum("pnd,nd->p", value, positions)
    node = np.tile(nodes, exact.gap.size)
    return exact._replace(gap=gap, start=start, node=node, value=value.reshape(-1, 2))


@caught_by("mesh")
@dataclass(frozen=True)
class AtTheOrigin(Shape):
    """Begins at the origin, wherever it should."""

    name = "at-the-origin"
    summary = "a shape"
    regions = ("left", "right")
    examples = ({"length": 1.0},)
    length: Annotated[float, Gt(0), Unit("length"), Doc("length")]
    grading: Annotated[float, Ge(0), Unit("1"), Doc("not looked at")] = 1.0

    def dimension(self):
        return None

    def mesh(self, at, refine):
        direction, n = np.eye(at.size)[0], 4 * refine
        nodes = np.linspace(0.0, self.length, n + 1)[:, None] * direction
        ends = {"left": Region((0,), -direction), "right": Region((n,), direction)}
        return Mesh.of_line(nodes, np.full(n, self.length / n), direction, ends)


# ------------------------------------------------------------------------------------------ solutions, measures


@caught_by("signorini")
@dataclass(frozen=True)
class Sticky(BarsInARow.__mro__[1]):
    """The exact solution, with the force of a contact that sticks."""

    name = "sticky"
    summary = "a solution"

    def covers(self, problem):
        return BarsInARow().covers(problem)

    def solve(self, problem, end):
        solved = BarsInARow().solve(problem, end)
        for contact in solved.contacts.values():
            force = contact.force
            object.__setattr__(contact, "force", lambda t, f=force: f(t) - 1e-3)
        return solved


@caught_by("largest-values")
@dataclass(frozen=True)
class Understates(BarsInARow.__mro__[1]):
    """The exact solution, with half of the largest force."""

    name = "understates"
    summary = "a solution"

    def covers(self, problem):
        return BarsInARow().covers(problem)

    def solve(self, problem, end):
        solved = BarsInARow().solve(problem, end)
        for contact in solved.contacts.values():
            largest = contact.largest_force
            object.__setattr__(contact, "largest_force", lambda start, stop, f=largest: 0.5 * f(start, stop))
        return solved


@caught_by("measure")
@dataclass(frozen=True)
class Tidies(Measure):
    """Takes the absolute value of the forces, in place."""

    name = "tidies"
    summary = "a measure"
    what = "largest force"

    def of(self, result):
        force = result.arrays["contact_force"]
        force -= force.mean() + 1.0
        return float(force.max(initial=0.0))


@caught_by("measure")
@dataclass(frozen=True)
class NotANumber(Measure):
    """Divides by what may be nothing."""

    name = "not-a-number"
    summary = "a measure"
    what = "a quotient"

    def of(self, result):
        with np.errstate(all="ignore"):
            return float(np.float64(1.0) / np.float64(0.0))
