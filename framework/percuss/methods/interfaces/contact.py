"""The interface of a contact law: a line in multiplier, gap, gap rate and gap acceleration, or a kernel of its own."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from percuss.methods.interfaces.base import Component, Floats, Integers
from percuss.methods.interfaces.integrator import Integrator


@dataclass(frozen=True)
class ContactPoints:
    """What a contact law may know of its points; every array is read-only with one value a point.

    Attributes
    ----------
    names : tuple of str
        The contact of each point, as the case names it.
    stiffness : (P,) array
        EA/h of the softer of the two sides [force/length].
    frequency : (P,) array
        Smaller 2c/h of the two sides [1/time].
    mass : (P,) array
        Half the mass of the end element, rho A h / 2, of the softer side [mass].
    equal_sides : (P,) bool array
        Whether both sides have the same EA/h and 2c/h; true at a rigid wall.
    delassus : (P,) array
        s, the point's own entry of S = N^T M^-1 N [1/mass]: the largest of the run, where a support or a drive holds
        an end for a part of it.
    coupling : (P,) array
        Sum of the absolute entries of the point's row of S over s: 1 for a point that shares no end with another [1].
    weight : (P,) array
        Share of the contact surface that belongs to the point; 1 for a bar's end.
    limits
        Function that computes `stiffness_limit`, which few laws ask for.
    """

    names: tuple[str, ...]
    stiffness: Floats
    frequency: Floats
    mass: Floats
    equal_sides: NDArray[np.bool_]
    delassus: Floats
    coupling: Floats
    weight: Floats
    limits: Callable[[], Floats] = field(repr=False, compare=False)

    @cached_property
    def stiffness_limit(self) -> Floats:
        """Contact stiffness up to which the closed step of central difference is stable, (P,) [force/length].

        It is so whichever contacts are closed, as long as none is stiffer than its own limit, and for the step that the
        points were made for; above 0.99 of the Courant limit of a body for that of 0.99.
        """
        return self.limits()


class LinearLaw(NamedTuple):
    """A contact law as a linear relation of the multiplier lambda, the gap, its rate and its acceleration at a point.

    The framework solves ``(diag(sigma) + diag(w) S) lambda = gamma`` over all active points of a step, where w is
    (gap, rate, acceleration) times the integrator's response, and gamma minus (gap, rate, acceleration) times the
    judged state.

    Attributes
    ----------
    at
        ``"explicit"`` or ``"end"`` of the step.
    sigma : float or (P,) array
        Compliance [length/force]: 1/stiffness for a penalty, 0 for an exact constraint.
    gap, rate, acceleration : float or (P,) array
        Weights [1, time, time^2].
    active
        ``"gap < 0"`` or ``"all"``.
    sign
        ``"free"``: an equation; ``">= 0"``: complementarity, the contact never pulls.
    during : (K, 2) array or None
        Intervals of time (start, stop) in which the law acts: it does so in each step whose middle lies in one of
        them. None: always.
    """

    at: Literal["explicit", "end"]
    sigma: Floats | float
    gap: Floats | float = 1.0
    rate: Floats | float = 0.0
    acceleration: Floats | float = 0.0
    active: Literal["gap < 0", "all"] = "gap < 0"
    sign: Literal["free", ">= 0"] = "free"
    during: Floats | None = None


class Trial(NamedTuple):
    """The state that the kernel of a law is handed, for all its points in one step; (P,) arrays, read-only.

    It is the same with every leap-frog integrator: two of them differ in what they show to linear laws alone. `gap` is
    that of the displacement the forces of the step are evaluated at (u_{n+1} of papers that update it before the
    balance is solved), `predicted_gap` where the bodies would be a step later without contact. Gaps of bodies that
    touch are round-off about zero: ``gap <= 0`` hangs on it, ``gap < 0`` less so.

    With an integrator of `Stages` it is called in every stage, and sees there g(u) and N^T v, and predicted the state
    that the integrator's `end` says; where that is empty, ``g + dt g' + dt^2 g''`` and ``g' + dt g''`` with the bulk
    acceleration g''.

    Attributes
    ----------
    gap, predicted_gap
        g(u_n), and the gap after the bulk update.
    rate, predicted_rate
        Gap rate at n - 1/2, and after the bulk update at n + 1/2.
    delassus
        s of each point [1/mass].
    dt, time
        Step, and t_n or the time of the stage.
    gap_response, rate_response
        What a multiplier of 1/s adds to the predicted gap and to the predicted rate: dt^2 and dt of a leap-frog step.
    first_neighbour, neighbour, coupling
        The entries of S off its diagonal, between points of this law that share an end: those of point p are
        ``coupling[k]`` [1/mass] with the point ``neighbour[k]``, for k from ``first_neighbour[p]`` up to, not
        including, ``first_neighbour[p + 1]``; integer arrays (P + 1,) and (K,), and (K,) floats. There are none for a
        law that does not declare `ContactLaw.uses_coupling`.
    pushed_by_others
        The gap acceleration that the contacts of other laws at the same ends bring in this step, as far as their
        forces are found: the kernel is called again until all of them fit together. Zero for a law that does not
        declare `ContactLaw.uses_coupling`.
    """

    gap: Floats
    predicted_gap: Floats
    rate: Floats
    predicted_rate: Floats
    delassus: Floats
    dt: float
    time: float
    gap_response: float
    rate_response: float
    first_neighbour: Integers
    neighbour: Integers
    coupling: Floats
    pushed_by_others: Floats


class ContactLaw(Component, contract="contacts"):
    """A way to enforce contact: a linear law wherever it can be written so, else a kernel `multipliers`.

    A law whose `bind` returns `LinearLaw` is complete. Any other law returns a NamedTuple of arrays of its own and
    has a static method ``multipliers(bound, trial, multiplier)`` that fills the (P,) array `multiplier`,
    compression positive, from the `Trial`; there is no closed-form stability certificate for it. Before each call
    every multiplier is nan: one that the kernel leaves unset ends the run, with the contact named. What the kernel is
    handed to read cannot be written, and nothing may be kept from one call to the next.

    Where contacts share an end, the force of one changes the motion that the other is judged by. Linear laws are solved
    together. A kernel sees each point by itself, as if no other force acted in the step, unless it declares
    `uses_coupling`; then `percuss.coupled_gap` and `percuss.coupled_rate` are the predicted gap and rate with what all
    contacts at that end press, and a few sweeps over the points solve them together::

        @staticmethod
        def multipliers(bound, trial, multiplier):  # no overlap at the end of the step
            multiplier[:] = 0.0
            for _ in range(1000):
                moved = 0.0
                for p in range(multiplier.size):
                    before = multiplier[p]
                    gap = coupled_gap(trial, multiplier, p)
                    multiplier[p] = max(before - gap / (trial.gap_response * trial.delassus[p]), 0.0)
                    moved = max(moved, abs(multiplier[p] - before))
                if moved <= 1e-14 * multiplier.max():
                    break

    Attributes
    ----------
    uses_coupling
        Whether the kernel takes account of other contacts at the same end. Where it does not and contacts share an
        end, `percuss check` and the notes of the run say so.
    measured
        Name of an integrator -> in words what was measured with it where nothing guarantees the energy.
    guarantees
        What holds whatever the options and the integrator: ``"never pulls"``, ``"no penetration"`` (at the end of
        each step), ``"keeps the free step"``; the conformance kit holds it against drawn runs.
    stiffening
        Options, numbers all of them, that make a closed contact stiffer as they grow. A certificate that says no names
        the largest value of each with which the step is stable.
    tied_during
        Option that takes intervals of time, of a law that ties its contacts in them; empty of any other law. The tied
        twin of a comparison is made with such a law.
    headline
        Resolved parameters that a table of results shows beside the name of the law.
    needs_only_response_of
        Quantities of the row (so far ``"acceleration"`` alone can be missing) -> why the law is still itself with an
        integrator that does not show their bulk value (`ContactState.acceleration` is ``"none"``), so that the weight
        acts on what the multiplier itself adds to them and on nothing else. A penalty mass is such a weight: Wu's
        predictor-corrector lets it resist the corrector's acceleration alone. A law that reads the bulk acceleration,
        as Nitsche's method reads the normal stress of the bodies from it, is not, and would silently become another
        method. A pair whose row has a weight that is neither shown nor named here is refused.
    """

    uses_coupling: ClassVar[bool] = False
    measured: ClassVar[Mapping[str, str]] = {}
    guarantees: ClassVar[tuple[str, ...]] = ()
    stiffening: ClassVar[tuple[str, ...]] = ()
    headline: ClassVar[tuple[str, ...]] = ()
    tied_during: ClassVar[str] = ""
    needs_only_response_of: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    def bind(self, points: ContactPoints, dt: float) -> LinearLaw | Any:
        """Return the law's `LinearLaw` at `points` for the step `dt`, or the bound arrays of its `multipliers`."""

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return the parameters as they came out at `points` for the step `dt`; they go into the provenance."""
        return {}

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:  # noqa: ARG002
        """Return, for each option the law sets by itself at `points` for the step `dt`, what it came to and why."""
        return {}

    def refuses(self, integrator: Integrator) -> str | None:  # noqa: ARG002
        """Return why `integrator` makes no sense with this law, or None."""
        return None
