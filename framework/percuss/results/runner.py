"""Run a case: model, march, accounts, result."""

from __future__ import annotations

import threading
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.case import expect_case
from percuss.certificate import cause, verdict
from percuss.compiling import Stopwatch
from percuss.errors import RunError
from percuss.results import true_error
from percuss.results.assemble import result_of
from percuss.results.result import Result
from percuss.solver.march import March, Outcome, Progress
from percuss.solver.recording import recordable
from percuss.solver.stop import NOT_STARTED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.case.case import Case


REPEATS, REPEATING = 5, 0.3  # how often a march is made of which the time is asked, within so many seconds
MARCHING = threading.Lock()  # of a process: one march is timed at a time


def run(
    case: Case,
    overrides: Mapping[str, Any] | None = None,
    *,
    compiled: bool = True,
    nudge: bool = False,
    progress: Progress | None = None,
) -> Result:
    """Run a case and return its result.

    Parameters
    ----------
    case
        A case from `percuss.load`.
    overrides
        Dotted path to value; the same paths and checks as ``--set``.
    compiled
        Whether to compile the time loop; without, the same loop runs as plain Python.
    nudge
        Whether to run a twin whose first body is a hair thicker, to see if the answer hangs on round-off
        (``summary["exact"]["fragile"]``).
    progress
        Called with (steps done, steps in all) now and then.

    Returns
    -------
    Result
        Its `status` is ``interrupted`` where Ctrl-C ended the run early.

    Raises
    ------
    InputError
        If the case or an override is wrong.
    RefusedPair
        If the integrator and a contact law make no sense together.
    RunError
        If the certificate forbids the run, or it went unstable or non-finite; its `result` holds what was computed.
    """
    watch = Stopwatch()
    expect_case("percuss.run", case, overrides=overrides)
    case = case.with_overrides(overrides) if overrides else case
    return _run(case, watch, compiled=compiled, nudge=nudge, progress=progress)


def timed_run(case: Case, *, nudge: bool = False, repeats: int | None = None) -> Result:
    """Run a case as a row of a study: its march is repeated, and the least of the times counts.

    No other thread of this process marches meanwhile: one that did would lengthen the time.

    Parameters
    ----------
    case
        The case.
    nudge
        As of `run`.
    repeats
        How often to march; None: until `REPEATS` marches are made or `REPEATING` seconds have passed.
    """
    return _run(case, Stopwatch(), nudge=nudge, repeats=repeats, timed=True)


def _run(
    case: Case,
    watch: Stopwatch,
    *,
    compiled: bool = True,
    nudge: bool = False,
    progress: Progress | None = None,
    repeats: int | None = 1,
    timed: bool = False,
) -> Result:
    march = March(recordable(verdict.settled(case)), compiled=compiled)
    seconds = march.seconds
    seconds["build"] = watch.lap()
    known = verdict.certificate(march.model)
    seconds["certificate"] = watch.lap()
    if known["stable"] == "no" and case.time.on_unstable == "stop":
        outcome = march.refuse(cause.not_started(march.model, known))
    else:
        marginal = known["stable"] == "marginal"
        march.compile()  # compiles before the march of this process begins, for which other threads wait
        with MARCHING if timed else nullcontext():
            outcome = march.run(progress, marginal=marginal)
            if timed and outcome.status == "done":
                _repeat(march, outcome, repeats, marginal=marginal)
    watch.lap()
    with np.errstate(all="ignore") if outcome.status == "unstable" else nullcontext():  # the stop tells what overflowed
        result = result_of(march, outcome, known)
    if nudge and result.summary["exact"] is not None and outcome.status != "unstable":
        try:
            with MARCHING if timed else nullcontext():  # it is not timed, and must not disturb one that is
                twin = run(true_error.nudged(case, march.model.courant), compiled=compiled)
        except RunError as error:  # a hair's breadth decides whether it blows up
            twin = error.result
        result.summary["exact"]["fragile"] = true_error.is_fragile(
            *(made.arrays["contact_force"] for made in (result, twin))
        )
    result.summary["seconds"] |= {"compile": watch.compiled(), "total": watch.total()}
    if outcome.status == "unstable":
        raise RunError(stop_message(result.summary["stop"]), result)
    return result


def _repeat(march: March, outcome: Outcome, repeats: int | None, *, marginal: bool) -> None:
    """March again from the beginning, and keep the least time; Ctrl-C meanwhile is told as if it were of the run."""
    most = REPEATS if repeats is None else repeats
    spent = outcome.seconds["march"]
    for _ in range(most - 1):
        if repeats is None and spent > REPEATING:
            return
        again = March(march.model, kernels=march.kernels).run(marginal=marginal)
        if again.status == "interrupted":
            outcome.status = "interrupted"
            return
        spent += again.seconds["march"]
        outcome.seconds["march"] = min(outcome.seconds["march"], again.seconds["march"])


def stop_message(stop: Mapping[str, Any]) -> str:
    """Return the words for a run that was stopped: what, step, time, node and likely cause."""
    when = f"stopped at step {stop['step']}, time {stop['time']:.9g}"
    return (
        f"{'not started' if stop['what'] == NOT_STARTED else when}, node {stop['node']} "
        f"(node {stop['node_in_body']} of body '{stop['body']}'): {stop['what']}\n"
        f"  likely cause: {stop['cause']}"
    )
