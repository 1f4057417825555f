"""Other runs of a case whose true error is large: on a finer mesh, and with other contact laws, in a limited time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from percuss.case.case import Case
from percuss.jit import NOTICES
from percuss.jsonable import Entries
from percuss.results.ledger import open_accounts
from percuss.results.result import Result
from percuss.results.true_error import largest_error
from percuss.studies.candidates import needed_quantities, required_options
from percuss.studies.columns import metric
from percuss.studies.perform import perform
from percuss.studies.tasks import Task

LARGE_ERROR = 0.05  # a run with a smaller true error needs no other run
# A law that takes or adds a larger share of the energy, and more than the run does, is no better law.
MOST_TAKEN, MOST_ADDED = 0.1, 0.01
LEAST_SECONDS = 2.0  # for all runs together, if the run itself took less
COMPILE_SECONDS = 4.0  # a law whose kernel must be compiled first is tried only if so much time is left


@dataclass(frozen=True)
class Alternatives:
    """Runs that were made beside a run.

    Attributes
    ----------
    finer
        Error on a mesh twice as fine with half the step; None if there was no such run, or it has no error.
    laws
        Error by contact law that keeps the energy as well as the run does, in the order in which they were tried:
        simple ones first.
    tried
        Number of contact laws that were tried.
    untried
        Contact laws for which the time was too short.
    interrupted
        Whether Ctrl-C ended them.
    """

    finer: float | None
    laws: dict[str, float]
    tried: int
    untried: list[str]
    interrupted: bool


def alternatives(case: Case, result: Result) -> Alternatives | None:
    """Return other runs of a case whose true error is large, or None where it is small or unknown, or no valid result.

    An estimate needs none: it favours the law of the finer run. All other runs together take about `LEAST_SECONDS`, or
    as long as the run itself. Ctrl-C ends them.

    Parameters
    ----------
    case
        The case.
    result
        Its run.
    """
    error = largest_error(result.summary)
    valid = result.status == "done" and result.summary["certificate"]["stable"] != "no"
    estimated = result.summary["estimated"] is not None
    if error is None or error <= LARGE_ERROR or estimated or not valid or open_accounts(result.summary):
        return None
    finer: dict[str, float] = {"refine": 2 * case.refine}
    finer |= {"time.step": 0.5 * case.time.step} if case.time.step is not None else {}
    finer |= {"time.steps": 2 * case.time.steps} if case.time.steps is not None else {}
    names = case.registry.names("contacts") if case.contacts else ()
    laws: Entries = {name: case.registry.get("contacts", name) for name in names}
    own = {contact.law.name for contact in case.contacts.values()}
    tried = {
        name: {f"method.contact.{key}": value for key, value in {"name": name, **required_options(law)}.items()}
        for name, law in sorted(laws.items(), key=_promise)
        if {name} != own and not law.tied_during and not needed_quantities(law)
    }
    found: dict[str, float] = {}
    count, untried, interrupted = 0, [], False
    own_change = _change_of_energy(result)
    seconds = result.summary["seconds"]
    deadline = time.monotonic() + max(LEAST_SECONDS, seconds["total"] - seconds["compile"])
    longest = 4.0 * seconds["march"]  # twice as many elements and steps
    one_law = case.with_one_law()
    with _compiling_until(deadline - COMPILE_SECONDS):
        for name, changes in {"": finer, **tried}.items():
            begun = time.monotonic()
            task = Task("", case.method.integrator.name, name, {}, changes)
            try:
                _expect_before(deadline - longest)
                run, _ = perform(one_law if name else case, task, progress=lambda *_: _expect_before(deadline))
            except _OutOfTime:
                untried.append(name)
                continue
            except KeyboardInterrupt:  # The run itself is done: Ctrl-C ends the others alone.
                interrupted = True
                break
            longest = max(longest, time.monotonic() - begun)
            if run.status == "interrupted":
                interrupted = True
                break
            if run.result is not None and run.status == "done":
                other = largest_error(run.result.summary)
                count += bool(name)
                change = _change_of_energy(run.result)
                allowed = max(MOST_ADDED if change > 0.0 else MOST_TAKEN, abs(own_change))
                if other is not None and abs(change) <= allowed:
                    found[name] = other
    return Alternatives(found.pop("", None), found, count, [name for name in untried if name], interrupted)


def _change_of_energy(result: Result) -> float:
    """Return the share of the energy put in that contacts, scheme and materials add, below 0 where they take some."""
    kept = metric(result, "energy_kept")
    return float(kept - 1.0) if kept is not None else 0.0


def _promise(law: tuple[str, Any]) -> tuple[bool, bool]:
    """Return the rank of a law by name: those without a kernel need no compilation, exact contact is often the best."""
    return hasattr(law[1], "multipliers"), "no penetration" not in law[1].guarantees


class _OutOfTime(BaseException):
    """Signal that ends a run for which the time is too short; no error, so that nothing takes it for one."""


def _expect_before(deadline: float) -> None:
    """Raise `_OutOfTime` if a time has passed."""
    if time.monotonic() > deadline:
        raise _OutOfTime


@contextmanager
def _compiling_until(deadline: float) -> Iterator[None]:
    """End a run inside this context that begins to compile after a time."""

    def notice(begun: bool) -> None:
        if begun:
            _expect_before(deadline)

    NOTICES.insert(0, notice)  # before those that show what is compiled
    try:
        yield
    finally:
        NOTICES.remove(notice)
