"""The interface of a time integrator: a leap-frog scheme is a table, any other scheme a kernel of stages."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple

from percuss.methods.interfaces.base import Component


class ContactState(NamedTuple):
    """The state at which a contact law is judged, and how much a multiplier changes it.

    Attributes
    ----------
    gap, rate
        ``"current"``: g(u_n) and the rate at n - 1/2; ``"predicted"``: the same after the bulk update of the step.
    acceleration
        ``"bulk"``: the gap's bulk acceleration; ``"none"``: zero is shown to the law. A law whose row has a weight on
        the acceleration is then refused, unless it says that it needs the response to its multiplier alone
        (`ContactLaw.needs_only_response_of`).
    response
        What a unit multiplier adds to (gap, rate, acceleration), in units of the Delassus operator S.
    """

    gap: Literal["current", "predicted"]
    rate: Literal["current", "predicted"]
    acceleration: Literal["bulk", "none"]
    response: tuple[float, float, float]


class LeapFrog(NamedTuple):
    """A leap-frog scheme (displacement at n, velocity at n - 1/2) as its contact sees it: all such a scheme must say.

    Attributes
    ----------
    explicit
        For laws judged before the step is corrected.
    end
        For laws judged at the end of the step.
    """

    explicit: ContactState
    end: ContactState


class Stages(NamedTuple):
    """A scheme that is no leap-frog: displacement and velocity at t_n, accelerations asked for in stages of the step.

    Attributes
    ----------
    times
        Of each stage, the fraction of the step at which its accelerations are taken: 0 at t_n, 1 at t_{n+1}. Loads are
        those of that time.
    numbers
        Coefficients that `step` is handed: a NamedTuple or tuple of floats.
    end
        Of each stage, ``(r_v, r_a, s_a)``, all greater than 0: laws judged at the end of the step are judged in this
        stage at the displacement ``u + r_v v + r_a a`` and the velocity ``v + s_a a``; u and v as `step` hands them to
        `percuss.accelerations` there, a what it gets back. What else the displacement to come depends on, such as an
        acceleration that is kept, goes into the v that is handed: contact alone looks at it. Take the displacement
        that the scheme reaches by the next stage, and the mean velocity until then: ``s_a = r_a / r_v``. Empty: such
        laws are refused.
    """

    times: tuple[float, ...]
    numbers: tuple[float, ...] = ()
    end: tuple[tuple[float, float, float], ...] = ()


class Integrator(Component, contract="integrators"):
    """A time integrator: a leap-frog scheme, complete with its `bind`, or any other explicit one, with a kernel.

    A scheme whose `bind` returns `LeapFrog` says no more; the framework makes the step. Any other one returns `Stages`
    and has a static method ``step(numbers, system, u, v, kept, dt)``, a kernel that takes displacement u and velocity
    v, flat arrays, from t_n to t_{n+1}, *in place*. In it ``percuss.accelerations(system, stage, u, v, a)``, imported
    by name, sets the array `a`, as long as u, to ``M^-1 (f_ext - f_int(u) + N lambda)`` at the time of that stage; v is
    seen by contact alone. What the scheme remembers from step to step is in the rows of `kept`, (kept, size of u)::

        @staticmethod
        def step(numbers, system, u, v, kept, dt):  # velocity Verlet; kept = 1, Stages(times=(1.0,))
            v += 0.5 * dt * kept[0]
            u += dt * v
            accelerations(system, 0, u, v, kept[0])
            v += 0.5 * dt * kept[0]

    A kernel may allocate arrays. Every entry of u, v and kept must be treated alike: behind the degrees of freedom of
    the nodes stand entries whose accelerations are the multipliers, the reactions and the amplitudes of the loads, and
    from what becomes of them follow the impulses and works of a step, whatever its weights. Before the first step the
    framework checks that a constant acceleration a changes v by dt a, and v alone u by dt v.

    In a stage, laws judged explicitly see ``g(u)``, ``N^T v`` and the bulk acceleration of the gap, of which a
    multiplier changes the last alone. Along a support or drive the acceleration is that of the prescribed velocity,
    over the step.

    Attributes
    ----------
    order
        Order of convergence of the displacement on smooth contact-free motion.
    conserves
        What holds to round-off without contact: ``"energy"``, ``"momentum"``.
    critical_courant
        Courant number up to which a uniform bar without contact is stable, with the first of `examples`; None where
        it is not known.
    kept
        How many rows a scheme with a kernel `step` keeps; each begins as the acceleration at t = 0, with contact
        judged as in the last stage.
    """

    order: ClassVar[int]
    conserves: ClassVar[tuple[str, ...]] = ()
    critical_courant: ClassVar[float | None] = None
    kept: ClassVar[int] = 0

    @abstractmethod
    def bind(self, dt: float) -> LeapFrog | Stages:
        """Return how contact is judged in a step of length `dt`.

        Parameters
        ----------
        dt
            Time step.

        Returns
        -------
        LeapFrog
            The framework does the bulk update and solves the contact equation.
        Stages
            The framework gives accelerations with contact in them, and the class has a kernel `step`.
        """

    def refuses(self, law: Any) -> str | None:  # noqa: ARG002
        """Return why `law` makes no sense with this integrator, or None."""
        return None


def end_of_step(dt: float) -> ContactState:
    """Return the state at the end of a leap-frog step; the same for every leap-frog scheme."""
    return ContactState("predicted", "predicted", "bulk", (dt * dt, dt, 1.0))
