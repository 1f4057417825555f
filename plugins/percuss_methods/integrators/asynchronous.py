"""Asynchronous variational integrator: a central difference in which each body has a step of its own."""

from __future__ import annotations

from dataclasses import dataclass

from percuss import ContactState, Integrator, LeapFrog, end_of_step


@dataclass(frozen=True)
class Asynchronous(Integrator):
    """Asynchronous variational integrator of Lew, Marsden, Ortiz and West, with the bodies as its subsystems.

    Formula: ``v_{n+1/2} = v_{n-1/2} + dt M^-1 (m_b f_b(u_n) + f_c)``, ``u_{n+1} = u_n + dt v_{n+1/2}``: internal forces
    and accelerations f_b of body b act in every m_b-th step, and contacts, supports and loads on ends, f_c, in each.

    Nodes drift at a constant velocity, and each part of the potential energy kicks them at times of its own, with the
    impulse of its own step. The step dt is that of the body with the highest frequency omega; m_b is the largest whole
    number up to ``omega / omega_b``, so that no body exceeds the Courant number of the case. Between two kicks a body
    costs nothing. Where all m_b are 1 it is `central-difference`, to the last bit.

    Without contact each body is a leap-frog scheme of the step ``m_b dt``, stable for ``m_b dt <= 2 / omega_b``, which
    conserves the energy ``v M v / 2 + u_j K u_{j+1} / 2`` between its kicks j and j + 1. With closed contacts steps of
    different lengths resonate, small ones too: nothing is guaranteed, and the black box examines the step over the
    period of all kicks. Velocities are recorded as the mean of those before and after t_n, elastic energy as that
    between the two kicks of a body around t_{n+1/2}, along its present velocities. The force of a contact balances
    kicks of a coarse body in the step of the kick alone: compare its impulses, or its mean over m_b steps.
    """

    name = "asynchronous"
    summary = "Asynchronous variational integrator: central difference with a step of its own for each body"
    references = (
        "Lew, Marsden, Ortiz, West: Asynchronous variational integrators, Arch. Rational Mech. Anal. 167 (2003) "
        "85-146, doi 10.1007/s00205-002-0212-y",
        "Lew, Marsden, Ortiz, West: Variational time integrators, IJNME 60 (2004) 153-212, doi 10.1002/nme.958",
        "Fong, Darve, Lew: Stability of asynchronous variational integrators, J. Comput. Phys. 227 (2008) 8367-8394, "
        "doi 10.1016/j.jcp.2008.05.017",
        "Wolff, Bucher: Asynchronous collision integrators, IJNME 95 (2013) 562-586, doi 10.1002/nme.4516",
    )
    order = 2
    conserves = ("energy", "momentum")
    critical_courant = 1.0

    def bind(self, dt: float) -> LeapFrog:
        """Return the table of central difference, with steps of their own for the bodies."""
        explicit = ContactState("current", "current", "bulk", (0.0, 0.0, 1.0))
        return LeapFrog(explicit, end_of_step(dt), own_steps=True)
