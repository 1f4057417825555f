"""Interface of a contact law: a linear law in multiplier, gap, gap rate and gap acceleration, or a kernel."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from percuss.jsonable import Data
from percuss.methods.interfaces.base import Component, Floats, Integers
from percuss.methods.interfaces.integrator import Integrator


@dataclass(frozen=True)
class ContactPoints:
    """The data of its contact points that a contact law can use; arrays are read-only, with one value per point.

    EA/h, 2c/h and rho A h / 2 are those of a two-node bar. Of an element of more nodes rho A h / 2 stands for its mass
    m at the end node, 2c/h for its highest frequency omega, and EA/h for ``m omega^2 / 2``. A side that is held or
    driven along the normal throughout the run is rigid: the numbers are those of the other side, as at a wall.

    Attributes
    ----------
    names : tuple of str
        Name of the contact of each point in the case.
    stiffness : (P,) array
        EA/h of the softer of the two sides [force/length].
    frequency : (P,) array
        Smaller 2c/h of the two sides [1/time].
    mass : (P,) array
        Half the mass of the end element, rho A h / 2, of the softer side [mass].
    equal_sides : (P,) bool array
        Whether both sides have the same EA/h and 2c/h; true at a rigid wall.
    delassus : (P,) array
        s, the diagonal entry of S = N^T M^-1 N for the point [1/mass]; its largest value in the run if a support or a
        drive holds an end for a part of the run. A multiplier changes the gap at the end of a leap-frog step by
        ``dt^2 s``. Of a side without mass it is the end element that yields: s is then the sum of ``1 / (k dt^2)`` over
        such sides, k the stiffness of the end element.
    coupling : (P,) array
        Sum of the absolute values in the point's row of S, divided by s [1]; 1 for a point that shares no end with
        another point.
    weight : (P,) array
        Share of the contact surface that belongs to the point; 1 for the end of a bar.
    limits
        Function that computes `stiffness_limit`, so that only laws that use it pay for it.
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
        """Largest contact stiffness with which central difference is stable with closed contacts, (P,) [force/length].

        It holds for any set of closed contacts, as long as no contact is stiffer than its own limit, and for the time
        step for which the points were made. If that step exceeds 0.99 of the Courant limit of a body, the limit is
        computed for 0.99. It is infinite if all sides that move have no mass: their end elements are softer.
        """
        return self.limits()


class LinearLaw(NamedTuple):
    """A contact law that is a linear relation of the multiplier lambda, the gap, its rate and its acceleration.

    The framework solves ``(diag(sigma) + diag(w) S) lambda = gamma`` for all active points of a step. Here w is the
    product of the weights (gap, rate, acceleration) with the response of the integrator, and gamma is minus their
    product with the gap, gap rate and gap acceleration at which the law is evaluated (see `ContactState`).

    Attributes
    ----------
    at
        Time of evaluation: ``"explicit"``, before the step is corrected, or ``"end"`` of the step.
    sigma : float or (P,) array
        Compliance [length/force]: 1/stiffness for a penalty, 0 for an exact constraint.
    gap, rate, acceleration : float or (P,) array
        Weights of gap, gap rate and gap acceleration [1, time, time^2].
    active
        Active set: points with ``"gap < 0"``, or ``"all"``.
    sign
        Sign of the multiplier: ``"free"`` for an equation; ``">= 0"`` for a complementarity condition, in which the
        contact never pulls.
    during : (K, 2) array or None
        Time intervals (start, stop) in which the law acts: it acts in each step whose middle lies in one of them. None
        means always.
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
    """The state that the kernel of a contact law receives, for all its points in one step; (P,) arrays, read-only.

    Only `after` is for the kernel to write.

    The state is the same for all leap-frog integrators; they differ only in the state that linear laws receive. `gap`
    belongs to the displacement at which the forces of the step are evaluated (u_{n+1} in papers that update it before
    the balance is solved), `predicted_gap` to the bodies one step later without contact. Gaps of touching bodies are
    zero up to round-off: the result of ``gap <= 0`` depends on that round-off, that of ``gap < 0`` less so.

    With an integrator that returns `Stages` the kernel is called in every stage. It then receives g(u) and N^T v, and
    as predicted values those defined by `Stages.end`; if that is empty, ``g + dt g' + dt^2 g''`` and ``g' + dt g''``
    with the bulk acceleration g''.

    Attributes
    ----------
    gap, predicted_gap
        Gap g(u_n), and the gap after the bulk update [length].
    rate, predicted_rate
        Gap rate at n - 1/2, and after the bulk update at n + 1/2 [length/time].
    delassus
        s of each point [1/mass].
    dt, time
        Time step, and t_n or the time of the stage.
    gap_response, rate_response
        Change of the predicted gap and of the predicted rate by a multiplier of 1/s: dt^2 and dt in a leap-frog step.
    first_neighbour, neighbour, coupling
        The off-diagonal entries of S between points of this law that share an end. Those of point p are ``coupling[k]``
        [1/mass] with the point ``neighbour[k]``, for k from ``first_neighbour[p]`` up to, but not including,
        ``first_neighbour[p + 1]``. The arrays are (P + 1,) integers, (K,) integers and (K,) floats. They are empty
        (K = 0) for a law that does not declare `ContactLaw.uses_coupling`.
    before, after
        State variables of each point, (P, k) for a law with ``state = k``: `before` as the last step has left them,
        zeros in the first step, and `after` for the kernel to write, which begins as a copy of `before`.
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
    before: Floats
    after: Floats


class ContactLaw(Component, contract="contacts"):
    """A method that enforces contact: a linear law if it can be written as such, otherwise a kernel `multipliers`.

    A law whose `bind` returns `LinearLaw` is complete. Any other law returns a NamedTuple of arrays and numbers and
    has a static method ``multipliers(bound, trial, multiplier)`` that fills the (P,) array `multiplier`, compression
    positive, from the `Trial`; the black box certifies it. Before each call all multipliers
    are nan; a multiplier that the kernel leaves unset ends the run with an error that names the contact. The other
    arguments of the kernel are read-only, and nothing may be kept from one call to the next.

    A law whose force depends on the past, as on the greatest overlap so far, declares ``state = k``: its kernel finds k
    state variables of each point in `Trial.before` and writes them to `Trial.after`. The framework owns them. They
    begin as zeros, are carried over once a step, whatever the number of calls of the kernel in it, and are recorded as
    ``contact_state``::

        state = 1

        @staticmethod
        def multipliers(bound, trial, multiplier):  # stiff while loading, stiffer while unloading
            for p in range(multiplier.size):
                overlap = max(-trial.gap[p], 0.0)
                greatest = max(trial.before[p, 0], overlap)
                trial.after[p, 0] = greatest
                force = bound.unloading[p] * overlap - (bound.unloading[p] - bound.loading[p]) * greatest
                multiplier[p] = max(force, 0.0)

    If contacts share an end, the force of one contact changes the motion of the other. Linear laws are solved together.
    A kernel receives the state of each point as if no other contact force acted in the step, unless it declares
    `uses_coupling`; then `percuss.coupled_gap` and `percuss.coupled_rate` give the predicted gap and rate including the
    forces of all contacts at the ends of the point, and a few sweeps over the points solve them together. All contacts
    at such an end have to have this law with the same options::

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
        Whether the kernel takes account of other contacts at the same end. If it does not and contacts share an end,
        `percuss check` and the notes of the run report it.
    measured
        Measured energy behaviour, in words, by name of the integrator, for combinations without an energy guarantee.
    state
        Number of state variables of each contact point.
    stored_in, dissipated_in
        Numbers, from 0, of the state variables that are the energy that the contact stores, and the energy that it has
        dissipated so far [energy]; None if there are none. They are recorded beside the contact work.
    guarantees
        Properties that hold for all options and integrators: ``"never pulls"``, ``"no penetration"`` (at the end of
        each step, and at each of its stages), ``"keeps the free step"`` (contact does not lower the critical time step,
        under schemes with one step for all bodies). The conformance kit checks them in randomly drawn runs.
    stiffening
        Numerical options that make a closed contact stiffer as they grow. The certificate of an unstable step names the
        largest stable value of each.
    bond
        Whether it holds bodies together that would part. It is a part of the problem then, and no method for contact:
        no exact solution of contact judges a run with it, unless it ties while the exact contact is closed.
    tied_during
        Option with the time intervals during which the law ties its contacts; empty for a law that does not tie. A
        comparison uses such a law for tied twins: runs with the contacts tied while the exact contact is closed.
    headline
        Resolved parameters that a table of results shows beside the name of the law.
    totals
        Resolved parameters that add up over the points of a contact, as an energy does. Of others the value of the
        first point stands for the contact.
    needs_only_response_of
        Reasons, by quantity of the linear law, why the law remains valid with an integrator that does not supply the
        bulk value of that quantity. So far only ``"acceleration"`` can be missing (`ContactState.acceleration` is
        ``"none"``). The weight then acts only on the change that the multiplier itself causes. A penalty mass has such
        a weight: Wu's predictor-corrector lets it resist the acceleration of the corrector alone. A law that uses the
        bulk acceleration, as Nitsche's method derives the normal stress of the bodies from it, has no such weight and
        would silently become another method. A law with a weight on a quantity that is neither supplied nor named here
        is refused.
    """

    uses_coupling: ClassVar[bool] = False
    state: ClassVar[int] = 0
    stored_in: ClassVar[int | None] = None
    dissipated_in: ClassVar[int | None] = None
    measured: ClassVar[Mapping[str, str]] = {}
    guarantees: ClassVar[tuple[str, ...]] = ()
    stiffening: ClassVar[tuple[str, ...]] = ()
    headline: ClassVar[tuple[str, ...]] = ()
    bond: ClassVar[bool] = False
    totals: ClassVar[tuple[str, ...]] = ()
    tied_during: ClassVar[str] = ""
    needs_only_response_of: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    def bind(self, points: ContactPoints, dt: float) -> LinearLaw | Any:
        """Return the `LinearLaw` at `points` for the time step `dt`, or the arrays for the kernel `multipliers`."""

    def resolved(self, points: ContactPoints, dt: float) -> Data:  # noqa: ARG002
        """Return the resolved parameters at `points` for the time step `dt`; they go into the provenance."""
        return {}

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:  # noqa: ARG002
        """Return value and reason, in words, of each option that the law itself sets at `points` for a step `dt`."""
        return {}

    def refuses(self, integrator: Integrator) -> str | None:  # noqa: ARG002
        """Return the reason why `integrator` makes no sense with this law, or None."""
        return None
