"""Run of a case: model, time loop, accounts and result."""

from __future__ import annotations

import threading
from functools import partial

import numpy as np

from percuss.blas import one_blas_thread
from percuss.case.case import Case, expect_case
from percuss.certificate import verdict
from percuss.errors import RunError
from percuss.interrupt import heard_by, interruptible
from percuss.jit import Stopwatch
from percuss.jsonable import Data, Entries
from percuss.march.march import March, Outcome, Progress
from percuss.march.recording import recordable
from percuss.march.stop import NOT_STARTED, not_started
from percuss.methods.interfaces import Floats
from percuss.results.assemble import result_of
from percuss.results.result import Result
from percuss.results.saved_state import SavedState
from percuss.results.summary import StopSummary
from percuss.threads import number_of_threads

REPEATS, REPEAT_SECONDS = 3, 0.3  # marches of a timed run, and seconds after which no other begins
NUDGE_OF_AREA = 1e-12  # relative, of the nudged twin
FRAGILE_DIFFERENCE = 1e-4  # relative, in L2


def run(
    case: Case,
    overrides: Data | None = None,
    *,
    compiled: bool = True,
    nudge: bool = False,
    progress: Progress | None = None,
    resume: bool = False,
    threads: int | None = None,
) -> Result:
    """Run a case and return its result.

    A run that lasts saves its state, so that another call can go on from it.

    Parameters
    ----------
    case
        A case from `percuss.load`.
    overrides
        Dotted path to value; the same paths and checks as ``--set``.
    compiled
        Whether to compile the time loop; otherwise the same loop runs as plain Python.
    nudge
        Whether to run a twin whose first body is slightly thicker, to see if the result depends on round-off
        (``summary["fragile"]``).
    progress
        Called at intervals with (steps done, steps in all).
    resume
        Whether the run goes on from the state that an earlier run of the case saved before it was killed or
        interrupted. The result has the bits of a run that nothing has stopped.
    threads
        How many threads share out the steps of large solids; None: as many as there are cores, or as NUMBA_NUM_THREADS
        of the environment says. The bits do not depend on it.

    Returns
    -------
    Result
        Its `status` is ``interrupted`` where Ctrl-C ended the run early.

    Raises
    ------
    InputError
        If the case or an override is wrong, there are not so many threads, or no state from which the run can go on.
    RefusedPair
        If the integrator and a contact law make no sense together.
    RunError
        If the certificate forbids the run, or it went unstable or non-finite; its `result` holds what was computed.
    """
    watch = Stopwatch()
    expect_case("percuss.run", case, overrides=overrides)
    case = case.with_overrides(overrides) if overrides else case
    threads, keeper = number_of_threads(threads), SavedState(case, compiled=compiled, resume=resume)
    asked = any(one.quantity in verdict.OF_CRITICAL_STEP for one in case.expect)
    certify = verdict.certificate if asked else verdict.verdict_alone
    options: Entries = {"compiled": compiled, "nudge": nudge, "threads": threads}
    return _run(case, watch, **options, progress=progress, certify=certify, keeper=keeper)


def timed_run(case: Case, *, nudge: bool = False, repeats: int | None = None, critical_step: bool = False) -> Result:
    """Run a case for a study: its march is repeated, and the smallest of the times counts.

    Parameters
    ----------
    case
        The case.
    nudge
        As in `run`.
    repeats
        Number of marches; None: `REPEATS`, of which none begins after `REPEAT_SECONDS`.
    critical_step
        Whether to search the critical step of a stable run.
    """
    certify = verdict.certificate if critical_step else verdict.verdict_alone
    return _run(case, Stopwatch(), nudge=nudge, repeats=repeats, certify=certify)


def examined_run(case: Case, *, compiled: bool = True, certify: verdict.Certify = verdict.verdict_alone) -> Result:
    """Run a case for a check of the conformance kit, some of which need another certificate than other runs.

    The function `certify` returns the certificate, as `percuss.certificate.verdict.certificate` does.
    """
    return _run(case, Stopwatch(), compiled=compiled, certify=certify)


@one_blas_thread()
@np.errstate(all="ignore")  # an overflow is reported by the stop of the run, or as a history without a number
def _run(
    case: Case,
    watch: Stopwatch,
    *,
    compiled: bool = True,
    nudge: bool = False,
    progress: Progress | None = None,
    repeats: int | None = 1,
    certify: verdict.Certify = verdict.verdict_alone,
    keeper: SavedState | None = None,
    threads: int = 1,
) -> Result:
    model, criterion = verdict.settled(case)
    march = March(recordable(model), compiled=compiled, threads=threads)
    seconds = march.seconds
    seconds["build"] = watch.lap()
    certificate = certify(model, criterion)
    seconds["certificate"] = watch.lap()
    if certificate["stable"] == "no" and case.time.on_unstable == "stop":
        cause = f"{certificate['why']}: {certificate['cure']}"
        outcome = march.refuse(not_started(march.model, certificate["worst"], cause))
    else:
        marginal = certificate["stable"] == "marginal"
        march.compile()
        if repeats != 1:
            march.keep_beginning()
        with interruptible() as interrupted:
            outcome = march.run(progress, marginal=marginal, interrupted=interrupted, keeper=keeper)
            if outcome.status == "done":
                _repeat(march, outcome, repeats, interrupted, marginal=marginal)
            if interrupted.is_set() and outcome.status == "done":  # in the last steps
                outcome.status = "interrupted"
    watch.lap()
    with interruptible() as interrupted, heard_by(partial(_end_if, interrupted)):
        result = result_of(march, outcome, certificate)
    if nudge and outcome.status == "done":
        try:
            twin = run(nudged(case, model.courant), compiled=compiled, threads=threads)
        except RunError as error:  # the twin is unstable although the run is not
            twin = error.result
        if twin.status == "interrupted":
            interrupted.set()
        else:
            compared = "contact_force" if result.arrays["contact_force"].size else "displacement"
            result.summary["fragile"] = differs(result.arrays[compared], twin.arrays[compared])
    if interrupted.is_set() and outcome.status == "done":
        outcome.status = result.summary["status"] = "interrupted"
    result.summary["seconds"] |= {"compile": watch.compiled(), "total": watch.total()}
    if keeper is not None and outcome.status != "interrupted":
        keeper.forget()
    stop = result.summary["stop"]
    if stop is not None:
        raise RunError(stop_message(stop), result)
    return result


def _end_if(interrupted: threading.Event, share: float) -> None:  # noqa: ARG001 - told to all who listen
    """End the search for the exact solution once Ctrl-C has come; the run keeps what the march has made."""
    if interrupted.is_set():
        raise KeyboardInterrupt


def _repeat(
    march: March, outcome: Outcome, repeats: int | None, interrupted: threading.Event, *, marginal: bool
) -> None:
    """Repeat the march from its beginning and keep the smallest time; Ctrl-C meanwhile interrupts the whole run."""
    times = [outcome.seconds["march"]]
    while len(times) < (repeats or REPEATS) and (repeats or sum(times) < REPEAT_SECONDS):
        repeated = march.again().run(marginal=marginal, interrupted=interrupted)
        if repeated.status == "interrupted":
            outcome.status = "interrupted"
            return
        times.append(repeated.seconds["march"])
    outcome.seconds["march"] = min(times)


def stop_message(stop: StopSummary) -> str:
    """Return the message for a stopped run: reason, step, time, node and likely cause."""
    where = f"node {stop['node_in_body']} of body '{stop['body']}'"
    if stop["what"] == NOT_STARTED:
        happened = f"not started: the certificate says unstable, {where} limits the step"
    else:
        happened = f"stopped at step {stop['step']}, time {stop['time']:.9g}, {where}: {stop['what']}"
    return f"{happened}\n  likely cause: {stop['cause']}"


def nudged(case: Case, courant: float) -> Case:
    """Return the case with a section of its first body larger by `NUDGE_OF_AREA`, at the same Courant number."""
    name, body = next(iter(case.bodies.items()))
    section = "area" if body.area is not None else "thickness"
    fixed_courant = {"time.courant": courant} if case.time.courant == "auto" else {}
    return case.with_overrides({f"bodies.{name}.{section}": body.section * (1.0 + NUDGE_OF_AREA), **fixed_courant})


def differs(values: Floats, twin_values: Floats) -> bool:
    """Return whether histories differ by more than `FRAGILE_DIFFERENCE` in L2."""
    size = float(np.linalg.norm(values))
    return bool(values.shape != twin_values.shape or np.linalg.norm(values - twin_values) > FRAGILE_DIFFERENCE * size)
