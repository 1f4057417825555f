"""What the contacts of a run did to its energy, held against what its pair of methods guarantees.

By the energy identity (see `percuss.results.ledger`) kinetic plus elastic energy less external work changes by the
contact work alone. The loop adds to it what closed contacts store (see
`percuss.solver.compiled.contact_equation.stored`) and follows the sum over every step. Per point, where the force
follows from the gap at the end of the step as ``lambda = kappa <-g_{n+1}>``, the sum changes in a step by ``-kappa/4
(<-g_{n+1}> - <-g_{n-1}>)^2`` where the gap was closed before, and by less where it was open: it never grows. Where
lambda follows from the current gap it is constant while the contact stays closed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from percuss.certificate.closed_contacts import BETWEEN, NEVER_GROWS
from percuss.solver.compiled.contact_equation import BY_CURRENT, BY_END, ROUNDING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.solver.march import March, Outcome

ALLOWED = 1e-12  # of the largest energy or work
# A gap is the sum of two displacements and a distance, each kept to half a rounding unit, and work takes the difference
# of two gaps: errors of up to three units a step, and one of the sums. They are taken as if all were of one sign.
UNITS = 4.0


def growth_summary(march: March, outcome: Outcome, certificate: Mapping[str, Any], scale: float) -> dict[str, Any]:
    """Return by how much the energy of a run grew, and whether that is within what its pair guarantees.

    Parameters
    ----------
    march, outcome
        The run, and what it left behind.
    certificate
        Its certificate.
    scale
        Largest energy or work of the run.

    Returns
    -------
    dict
        ``guarantee`` (of the certificate), ``quantity`` (what is measured), ``largest`` (rise above the smallest value
        so far, over `scale`), ``step`` and ``time`` of it, ``between_switchings`` (largest sum of changes in steps in
        which no contact judged at its current gap opens or closes, over `scale`), ``allowed`` and ``kept``, both None
        where nothing is guaranteed.
    """
    total = outcome.totals[0]
    guarantee = certificate["energy"]

    def share(value: float) -> float:
        return float(value) / scale if scale > 0 else 0.0

    rise, drift = share(total.rise), share(total.largest_drift)
    judged = {NEVER_GROWS: rise, BETWEEN: drift}.get(guarantee)
    # in long runs the round-off of the steps adds up
    allowed = ALLOWED + UNITS * ROUNDING * share(total.round_off)
    step = int(total.rise_step) if total.rise > 0 else None
    return {
        "guarantee": guarantee,
        "quantity": "contact work"
        if march.model.multistage
        else quantity(outcome.points, linear=not march.model.why_not_linear),
        "largest": rise,
        "step": step,
        "time": (step + march.stepper.energy_at) * march.model.dt if step is not None else None,
        "between_switchings": drift,
        "allowed": allowed if judged is not None else None,
        "kept": bool(judged <= allowed) if judged is not None else None,
    }


def quantity(points: Any, *, linear: bool = True) -> str:
    """Return in words what is measured at these points; of linear bodies contact work is energy less other work."""
    parts = ["kinetic + elastic" if linear else "contact work"]
    if ((points.stores == BY_END) & (points.kappa > 0)).any():
        parts.append("kappa/4 (<-g_n+1>^2 + <-g_n>^2)")
    if (points.stores == BY_CURRENT).any():
        parts.append("(eps_s g_n g_n+1 + eps_m r_n+1/2^2)/2 while closed")
    return " + ".join(parts) + (" - work" if linear else "")


def growth_notes(march: March, outcome: Outcome, found: Mapping[str, Any]) -> list[str]:
    """Return the note that names a growth beyond what is guaranteed."""
    if found["kept"] is not False:
        return []
    laws = " and ".join(dict.fromkeys(contact_pair.law.name for contact_pair in march.model.contact_pairs))
    pair = f"{march.model.case.method.integrator.name} with {laws}"
    if found["guarantee"] == NEVER_GROWS:
        return [
            f"energy grew by {found['largest']:.3g} of the largest energy at step {found['step']}, time "
            f"{found['time']:.6g}, beyond what {pair} allows ({NEVER_GROWS})"
        ]
    step = int(outcome.totals[0].drift_step)
    return [
        f"energy changed by {found['between_switchings']:.3g} of the largest energy up to step {step}, time "
        f"{(step + 0.5) * march.model.dt:.6g}, in steps in which no contact opened or closed, beyond what {pair} "
        f"allows ({BETWEEN})"
    ]
