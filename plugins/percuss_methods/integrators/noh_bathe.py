"""The explicit scheme of Noh and Bathe, with two sub-steps and damping of frequencies that the mesh cannot resolve."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from percuss import Doc, Gt, Integrator, Lt, Stages, Unit, accelerations

if TYPE_CHECKING:
    from percuss import Floats


class Weights(NamedTuple):
    """Share of the first sub-step, and weights of the accelerations in the velocity at the end of the second."""

    p: float
    q0: float
    q1: float
    q2: float


@dataclass(frozen=True)
class NohBathe(Integrator):
    """Explicit scheme of two sub-steps, p dt and (1 - p) dt.

    Formula: ``u_{n+p} = u_n + p dt v_n + (p dt)^2/2 a_n``, ``v_{n+p} = v_n + p dt/2 (a_n + a_{n+p})``; with
    r = 1 - p, ``u_{n+1} = u_{n+p} + r dt v_{n+p} + (r dt)^2/2 a_{n+p}``,
    ``v_{n+1} = v_{n+p} + r dt (q0 a_n + (1/2 + q1) a_{n+p} + q2 a_{n+1})``; q1 = (1 - 2p)/(2 p r), q2 = 1/2 - p q1,
    q0 = 1/2 - q1 - q2; ``a = M^-1 (f_ext - f_int(u) + N lambda)``.

    The accelerations are evaluated twice in each step. Stable without contact up to ``omega dt = 3.745`` for p = .54, a
    Courant number of 1.87. Damps the highest frequencies, those near the limit the most; p below 1/2 amplifies some
    frequencies. Laws evaluated at the current state see u_{n+p} and u_{n+1}, laws evaluated at the end of the step the
    displacement at the end of the sub-step that follows, from the acceleration at t = 0 on.
    """

    name = "noh-bathe"
    summary = "Noh-Bathe: two sub-steps, damps the highest frequencies"
    references = (
        "Noh, Bathe: An explicit time integration scheme for the analysis of wave propagations, Computers & "
        "Structures 129 (2013) 178-193, doi 10.1016/j.compstruc.2013.06.007",
    )
    examples = ({}, {"p": 0.6})
    order = 2
    conserves = ("momentum",)
    critical_courant = 1.8725
    kept = 1
    expected_failures = {
        "energy-never-grows": "the scheme damps another quantity than the energy of the state, which oscillates while "
        "waves run; and a contact that opens or closes between two stages adds or removes "
        "energy"
    }

    p: Annotated[float, Gt(0.0), Lt(1.0), Unit("1"), Doc("first sub-step over the step")] = 0.54

    def bind(self, dt: float) -> Stages:
        """Return the stages at t_{n+p} and t_{n+1}, each with the prediction of the displacement of the next stage."""
        p, r = self.p, 1.0 - self.p
        q1 = (1.0 - 2.0 * p) / (2.0 * p * r)
        q2 = 0.5 - p * q1
        weights = (r * dt, 0.5 * r * dt**2), (p * dt, (r * q2 + 0.5 * p) * p * dt**2)
        end = tuple((r_v, r_a, r_a / r_v) for r_v, r_a in weights)
        start = (p * dt, 0.5 * (p * dt) ** 2, 0.5 * p * dt)
        return Stages(times=(p, 1.0), numbers=Weights(p, 0.5 - q1 - q2, q1, q2), end=end, start=start)

    @staticmethod
    def step(numbers: Weights, system: Any, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
        """Advance u, v and kept by the two sub-steps in place."""
        a, first, second = kept[0], numbers.p * dt, (1.0 - numbers.p) * dt
        a_first = 0.0 * a
        u += first * v + 0.5 * first**2 * a
        v += 0.5 * first * a
        accelerations(system, 0, u, v, a_first)
        v += 0.5 * first * a_first
        u += second * v + 0.5 * second**2 * a_first
        v += second * (numbers.q0 * a + (0.5 + numbers.q1) * a_first)
        accelerations(system, 1, u, v, a)
        v += second * numbers.q2 * a
