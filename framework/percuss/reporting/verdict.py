"""The verdict at the end of a command: what came out, how far it can be trusted, and what to do next, in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from percuss.case.quantities import percent
from percuss.certificate.cures import capitalised
from percuss.results.ledger import open_accounts
from percuss.results.true_error import largest_error
from percuss.studies.columns import metric

if TYPE_CHECKING:
    from percuss.results.result import Result
    from percuss.studies.alternatives import Alternatives

CLEARLY_BETTER = 0.9  # ratio of two errors
MOST_REASONS = 12


def run_verdict(result: Result, others: Alternatives | None, next_command: str) -> Iterator[str]:
    """Yield the verdict on a run, one sentence or two a line.

    Parameters
    ----------
    result
        The run.
    others
        Other runs of its case, if any were made.
    next_command
        The command that searches better methods for the case.
    """
    summary = result.summary
    stop, certificate = summary["stop"], summary["certificate"]
    cure = f" To be stable, {certificate['cure']}." if certificate["cure"] else ""
    if stop is not None:
        happened = f"The run stopped at t = {stop['time']:.4g}" if stop["step"] else "percuss refused to run it"
        why = "the certificate says unstable" if certificate["stable"] == "no" else stop["what"]
        yield f"{happened}: {why}.{cure}"
        return
    if certificate["stable"] == "no":
        yield f"The step is unstable, so do not trust this run.{cure}"
    if result.status == "interrupted":
        yield f"The run was interrupted: all numbers hold up to t = {summary['end']:.4g}."
    if open_accounts(summary):
        yield "This is not a valid result: energy or momentum does not balance. See the notes."
    yield from _error_lines(result, others, next_command)
    kept = metric(result, "energy_kept")
    if kept is not None:
        change = f"{'lost' if kept < 1.0 else 'added'} {percent(abs(kept - 1.0), 2)} of the energy put in"
        yield f"Contacts, scheme and materials {change}."
    if summary["fragile"] is not None:
        what = "contact force" if summary["contacts"] else "motion"
        sensitivity = "depends on round-off: a change of 1e-10 % in one area changes it"
        yield f"The {what} {sensitivity if summary['fragile'] else 'is insensitive to round-off'}."


def error_words(result: Result) -> str:
    """Return the true error of a run in a few words, or that it is unknown."""
    summary = result.summary
    error, covered = largest_error(summary), summary["exact_covered"]
    errors = summary["exact"] or covered
    if error is None or errors is None:
        return "the true error is unknown"
    of_force = any(contact["force_error_l1"] is not None for contact in errors["contacts"].values())
    until = f" up to t = {covered['until']:.4g}, where the exact solution ends" if covered else ""
    return f"the {'contact force' if of_force else 'displacement at the end'} is off by {percent(error, 2)}{until}"


def _error_lines(result: Result, others: Alternatives | None, next_command: str) -> Iterator[str]:
    """Yield how large the true error of a run is, and how it can be made smaller."""
    summary = result.summary
    error, words = largest_error(summary), capitalised(error_words(result))
    if error is None and summary["exact"] is None and summary["exact_covered"] is None:
        yield f"No exact solution is known, so percuss cannot compute the true error ({summary['exact_reason']})."
        yield f"To judge the run, compare it with a finer mesh (`--set refine=2`), or try `{next_command}`."
        return
    if others is None or error is None:
        yield f"{words} (exact solution known)."
        return
    law = min(others.laws, key=others.laws.__getitem__, default="")
    advice = []
    if others.finer is not None and others.finer < CLEARLY_BETTER * error:
        advice.append(f"refine the mesh (twice as fine: {percent(others.finer, 2)})")
    if law and others.laws[law] < CLEARLY_BETTER * error:
        advice.append(f"try {law} ({percent(others.laws[law], 2)})")
    yield f"{words} (exact solution known): {', or '.join(advice) or f'try `{next_command}`'}."
    tried = [*(["a mesh twice as fine"] if others.finer is not None else [])]
    tried += [f"{len(others.laws)} other contact law{'s' if len(others.laws) > 1 else ''}"] if others.laws else []
    if tried:
        helps = "" if advice else ", and none has a clearly smaller error"
        late = f"; there was no time for {', '.join(others.untried)}" if others.untried else ""
        yield f"percuss tried {' and '.join(tried)}{helps}{late}. `{next_command}` searches more."
