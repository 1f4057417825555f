"""Interface of a time integrator: a table for a leap-frog scheme, a kernel for a multi-stage scheme."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Literal, NamedTuple

from percuss.methods.interfaces.base import Component


class ContactState(NamedTuple):
    """The state at which a contact law is evaluated, and its response to a multiplier.

    Attributes
    ----------
    gap, rate
        ``"current"``: g(u_n) and the gap rate at n - 1/2; ``"predicted"``: both after the bulk update of the step.
    acceleration
        ``"bulk"``: the bulk acceleration of the gap; ``"none"``: the law receives zero. A linear law with a weight on
        the acceleration is then refused, unless it declares that it needs only the response to its multiplier
        (`ContactLaw.needs_only_response_of`).
    response
        Changes of (gap, rate, acceleration) by a unit multiplier, in units of the Delassus operator S.
    """

    gap: Literal["current", "predicted"]
    rate: Literal["current", "predicted"]
    acceleration: Literal["bulk", "none"]
    response: tuple[float, float, float]


class LeapFrog(NamedTuple):
    """The contact states of a leap-frog scheme (displacement at n, velocity at n - 1/2), its complete description.

    Attributes
    ----------
    explicit
        State for laws evaluated before the step is corrected.
    end
        State for laws evaluated at the end of the step.
    viscosity
        Stiffness-proportional viscosity of linear bodies: the time of the viscosity over the step. Internal forces are
        then ``K (u_n + viscosity dt v_{n-1/2})``, with the velocity of half a step before. At least 0, and the same at
        every step: the critical step is that of the bodies over ``sqrt(1 + 2 viscosity)``.
    own_steps
        Whether each body has a time step of its own. The time step of a case is then that of the body with the highest
        frequency omega; in a body whose highest frequency is omega_b internal forces act in every m-th step alone, from
        the first step on, m times as strong, with m the largest whole number up to ``omega / omega_b``: the body is at
        the Courant number of the case or below. Accelerations of whole bodies act with their internal forces; contacts,
        supports, drives and loads on ends act in every step. Not together with `viscosity`.
    """

    explicit: ContactState
    end: ContactState
    viscosity: float = 0.0
    own_steps: bool = False


class Stages(NamedTuple):
    """A multi-stage scheme: displacement and velocity at t_n, accelerations computed in stages of the step.

    Attributes
    ----------
    times
        Fraction of the step at which each stage computes its accelerations: 0 at t_n, 1 at t_{n+1}. Loads are taken at
        that time.
    numbers
        Coefficients for the kernel `step`: a NamedTuple or tuple of floats.
    end
        Coefficients ``(r_v, r_a, s_a)`` of each stage, all greater than 0. In this stage, laws evaluated at the end of
        the step are evaluated at the displacement ``u + r_v v + r_a a`` and the velocity ``v + s_a a``, where u and v
        are the arguments of `percuss.accelerations` and a is its result. If the coming displacement depends on anything
        else, such as an acceleration kept from an earlier stage, include it in the argument v, which only contact uses.
        Choose the displacement that the scheme reaches at the next stage, and the mean velocity until then:
        ``s_a = r_a / r_v``. If empty, laws evaluated at the end of the step are refused.
    velocity
        Coefficient c of each stage, at least 0: loads that follow the motion of an end act at the velocity ``v + c a``,
        where v is the argument of `percuss.accelerations` and a is its result without contact, which their own force
        changes. Choose the velocity at the time of the stage, ``c = dt / 2`` for velocity Verlet: with a velocity of an
        earlier time such loads make a scheme first order. If empty, they act at v.
    start
        Coefficients ``(r_v, r_a, s_a)`` of the acceleration at t = 0 that a scheme finds in `kept` before its first
        step, with v the initial velocity: as in `end`, for the displacement of its first stage. If empty, those of the
        last stage, which are others where the acceleration of that stage enters the velocity before the next one: then
        bodies that touch and approach at t = 0 overlap in the first step.
    """

    times: tuple[float, ...]
    numbers: tuple[float, ...] = ()
    end: tuple[tuple[float, float, float], ...] = ()
    velocity: tuple[float, ...] = ()
    start: tuple[float, ...] = ()

    @property
    def in_words(self) -> tuple[str, ...]:
        """What is special about such a scheme, in sentences for a reader of a case."""
        times = ", ".join(f"{time:.6g}" for time in self.times)
        end = "is evaluated there too, ahead to the next stage" if self.end else "has no place in it, and is refused"
        return (
            f"no leap-frog scheme: accelerations, contact included, at {times} of each step; a law evaluated at "
            f"the end of the step {end}",
            "forces and impulses are those of whole steps; energies stand at the end of each, and their closure counts "
            "what the scheme itself gains or loses",
        )


class Integrator(Component, contract="integrators"):
    """A time integrator: a leap-frog scheme, defined by `bind` alone, or a multi-stage scheme with a kernel.

    A scheme whose `bind` returns `LeapFrog` is complete; the framework makes the step. A multi-stage scheme returns
    `Stages` and has a static method ``step(numbers, system, u, v, kept, dt)``, a kernel that advances displacement u
    and velocity v, flat arrays, from t_n to t_{n+1}, *in place*. In it, ``percuss.accelerations(system, stage, u, v,
    a)``, imported by name, sets the array `a`, of the size of u, to ``M^-1 (f_ext - f_int(u) + N lambda)`` at the time
    of that stage; only contact uses v. The arrays passed to it are contiguous, as u, v and all that NumPy computes from
    them are, and `system` is only passed on. Values that the scheme keeps from step to step are rows of `kept`, (kept,
    size of u)::

        @staticmethod
        def step(numbers, system, u, v, kept, dt):  # velocity Verlet; kept = 1, Stages(times=(1.0,))
            v += 0.5 * dt * kept[0]
            u += dt * v
            accelerations(system, 0, u, v, kept[0])
            v += 0.5 * dt * kept[0]

    ``percuss.internal(system, stage, u, f)``, imported by name too, sets the array `f`, another one than u, to the
    internal forces over the masses, ``M^-1 f_int(u)``, for schemes that need them alone, such as those that use the
    gradient of the force. u may be any array of that size: of linear bodies ``internal(system, 0, a, f)`` is
    ``M^-1 K a``. Loads and contacts take no part, and supports and drives hold their ends at no acceleration, so that f
    is minus what `percuss.accelerations` would set without loads and contacts, reactions included: in sums of both,
    reactions, impulses and the balance of momentum remain right. State variables of materials are those at the begin
    of the step, and what `percuss.accelerations` has made of them remains. No stage has another internal force.

    A kernel may allocate arrays. It must treat all entries of u, v and kept alike: behind the degrees of freedom of the
    nodes lie entries whose accelerations are the multipliers, the reactions and the amplitudes of the loads. From the
    changes of these entries the framework computes impulses and work of a step for any weights of the stages. Before
    the first step it checks that a constant acceleration a changes v by dt a, and that v alone changes u by dt v.

    In a stage, laws evaluated explicitly receive ``g(u)``, ``N^T v`` and the bulk acceleration of the gap; a multiplier
    changes only the acceleration. In the direction of a support or drive, the acceleration is the change of the
    prescribed velocity over the step, divided by dt.

    Attributes
    ----------
    order
        Order of convergence of the displacement for smooth motion without contact.
    conserves
        Quantities conserved to round-off without contact: ``"energy"``, ``"momentum"``.
    critical_courant
        Courant number up to which a uniform bar without contact is stable with the first of `examples`; None if it is
        not known.
    kept
        Number of rows of the array `kept` of a multi-stage scheme; each row starts as the acceleration at t = 0, with
        contact evaluated as in the last stage.
    """

    order: ClassVar[int]
    conserves: ClassVar[tuple[str, ...]] = ()
    critical_courant: ClassVar[float | None] = None
    kept: ClassVar[int] = 0

    @abstractmethod
    def bind(self, dt: float) -> LeapFrog | Stages:
        """Return the description of a step of length `dt`.

        Parameters
        ----------
        dt
            Time step.

        Returns
        -------
        LeapFrog
            A leap-frog scheme: the framework does the bulk update and solves the contact equation.
        Stages
            A multi-stage scheme: the framework computes accelerations that include contact, and the class has a kernel
            `step`.
        """

    def refuses(self, law: object) -> str | None:  # noqa: ARG002
        """Return the reason why `law` makes no sense with this integrator, or None."""
        return None


def end_of_step(dt: float) -> ContactState:
    """Return the contact state at the end of a leap-frog step, which is the same for all leap-frog schemes."""
    return ContactState("predicted", "predicted", "bulk", (dt * dt, dt, 1.0))
