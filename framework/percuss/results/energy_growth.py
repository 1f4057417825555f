"""Energy growth of a run caused by its contacts, compared with the guarantee of its pair of methods.

By the energy identity (see `percuss.results.ledger`) kinetic plus elastic energy less external work changes by the
contact work alone. The loop adds the energy stored in closed contacts (see
`percuss.step.account.stored_energy`) and follows the sum over every step. For a contact point whose
force follows from the gap at the end of the step, ``lambda = kappa <-g_{n+1}>``, the sum changes in a step by
``-kappa/4 (<-g_{n+1}> - <-g_{n-1}>)^2`` if the gap was closed before, and by less if it was open: it never grows. Where
lambda follows from the current gap, the sum is constant while the contact stays closed.
"""

from __future__ import annotations

from typing import Any

from percuss.case.quantities import percent
from percuss.certificate.closed_contacts import BETWEEN, NEVER_GROWS
from percuss.certificate.verdict import Certificate
from percuss.contact.points import BY_CURRENT, BY_END, BY_PART
from percuss.march.march import March, Outcome
from percuss.results.summary import GrowthSummary
from percuss.step.account import ROUNDING

ALLOWED = 1e-12  # allowed growth over the largest energy or work, beside round-off
# Error of a step in rounding units. A gap is the sum of two displacements and a distance, each rounded to half a unit,
# and work takes the difference of two gaps: up to three units, and one more from the sums over the steps. The bound
# assumes that all these errors have the same sign.
ROUND_OFF_UNITS = 4.0
# Half a step before the other energies: the sum grows and falls with the force even where nothing is gained.
STORED_BY_LAWS = "what laws say they store at t_n"


def growth_summary(march: March, outcome: Outcome, certificate: Certificate, scale: float) -> GrowthSummary:
    """Return the energy growth of a run and whether it is within the guarantee of its pair of methods.

    Parameters
    ----------
    march, outcome
        The run and its outcome.
    certificate
        Certificate of the run.
    scale
        Largest energy or work of the run.
    """
    total = outcome.totals
    guarantee = certificate["energy"]

    def share(value: float) -> float:
        return float(value) / scale if scale > 0 else 0.0

    rise, drift = share(total.rise), share(total.largest_drift)
    measured = {NEVER_GROWS: rise, BETWEEN: drift}.get(guarantee)
    # The round-off of the steps adds up in long runs.
    allowed = ALLOWED + ROUND_OFF_UNITS * ROUNDING * share(total.round_off)
    step = int(total.rise_step) if total.rise > 0 else None
    return {
        "guarantee": guarantee,
        "quantity": "contact work"
        if march.model.multistage
        else quantity(
            outcome.law,
            linear=not march.model.sums_internal_work,
            by_laws=march.arrays.variables.stored_by_laws.size > 0,
        ),
        "largest": rise,
        "step": step,
        "time": (step + march.stepper.energy_at) * march.model.dt if step is not None else None,
        "between_switchings": drift,
        "allowed": allowed if measured is not None else None,
        "kept": bool(measured <= allowed) if measured is not None else None,
    }


def quantity(points: Any, *, linear: bool = True, by_laws: bool = False) -> str:
    """Return in words the energy that is measured for the given contact points.

    For linear bodies contact work equals kinetic plus elastic energy less external work, and is named by these.
    """
    parts = ["kinetic + elastic" if linear else "contact work"]
    if ((points.stores == BY_END) & (points.kappa > 0)).any():
        parts.append("kappa/4 (<-g_n+1>^2 + <-g_n>^2)")
    if (points.stores == BY_CURRENT).any():
        parts.append("(eps_s g_n g_n+1 + eps_m r_n+1/2^2)/2 while closed")
    if (points.stores == BY_PART).any():
        parts.append("what contacts store of the gap that they see - softens F_n F_n+1 / 2")
    if by_laws:
        parts.append(STORED_BY_LAWS)
    return " + ".join(parts) + (" - work" if linear else "")


def growth_notes(march: March, outcome: Outcome, growth: GrowthSummary) -> list[str]:
    """Return a note on energy growth beyond the guarantee, or an empty list if there is none."""
    if growth["kept"] is not False:
        return []
    laws = " and ".join(dict.fromkeys(contact_pair.law.name for contact_pair in march.model.contact_pairs))
    pair = f"{march.model.case.method.integrator.name} with {laws}"
    if growth["guarantee"] == NEVER_GROWS:
        return [
            f"energy grew by {percent(growth['largest'])} of the largest energy at step {growth['step']}, time "
            f"{growth['time']:.6g}, beyond what {pair} allows ({NEVER_GROWS})"
        ]
    step = int(outcome.totals.drift_step)
    return [
        f"energy changed by {percent(growth['between_switchings'])} of the largest energy up to step {step}, time "
        f"{(step + 0.5) * march.model.dt:.6g}, in steps in which no contact opened or closed, beyond what {pair} "
        f"allows ({BETWEEN})"
    ]
