"""Checks of loads: amplitude over time, declared kinks and class facts, and impulse in a run."""

from __future__ import annotations

import numpy as np

from percuss.methods.interfaces import FollowingLoad
from percuss.methods.plugin_calls import answer
from percuss.testing.draws import bar, chain, must_balance
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check

TIMES = np.linspace(0.0, 1.0, 41)
TOLERANCE = 1e-12


@check("loads")
def check_amplitude(subject: Subject) -> None:
    """Each time has one finite amplitude.

    An amplitude is a finite number for each time of an array, whatever the length of the array and its other times.
    Amplitudes are computed in chunks of steps: one that uses neighbouring times depends on where chunks end.
    """
    if issubclass(subject.component, FollowingLoad):
        raise NotApplicable("it follows the motion of an end; it is no function of time")
    for _, load in subject.made():
        for time in (TIMES, TIMES[:1], TIMES[:0], TIMES[::-1].copy(), TIMES * 1e3):
            amplitude = np.asarray(answer(load, "amplitude", time), dtype=float)
            alone = [float(np.asarray(load.amplitude(time[k : k + 1]))[0]) for k in range(time.size)]
            size = float(np.abs(amplitude).max(initial=1.0))
            if not np.allclose(amplitude, alone, rtol=0.0, atol=TOLERANCE * size):
                raise CheckFailed("the amplitude at a time depends on the other times of the array")


@check("loads")
def check_kinks(subject: Subject) -> None:
    """`kinks` names every kink.

    The amplitude is smooth between the times that `kinks` returns, because an exact solution relies on it. Of any
    four neighbouring points, the fourth lies near the parabola through the other three.
    """
    declares_kinks = False
    for _, load in subject.made():
        kinks = load.kinks()
        if kinks is None:
            continue
        declares_kinks = True
        times = np.linspace(1e-4, 1.2, 3001)
        near_kink = np.abs(times[:, None] - np.array([*kinks, -1.0])).min(axis=1) < 5 * (times[1] - times[0])
        values = np.asarray(load.amplitude(times), dtype=float)
        bends = np.abs(np.diff(values, 3))
        clear = ~(near_kink[:-3] | near_kink[1:-2] | near_kink[2:-1] | near_kink[3:])
        typical = np.median(bends[clear]) if clear.any() else 0.0
        size = float(np.abs(values).max(initial=1e-300))
        rough = np.flatnonzero(clear & (bends > 1e3 * typical + 1e-4 * size))
        if rough.size:
            raise CheckFailed(f"the amplitude has a kink near time {times[rough[0]]:.4g}, and `kinks` does not name it")
    if not declares_kinks:
        raise NotApplicable("`kinks` returns None")


@check("loads")
def check_facts_of_loads(subject: Subject) -> None:
    """Its class facts have the right values.

    `acts_as` is force, acceleration or velocity, `everywhere` is a bool, and `vector` returns a direction or None.
    A direction has one to three finite components, which are not all zero.
    """
    cls = subject.component
    if cls.acts_as not in {"force", "acceleration", "velocity"}:  # type: ignore[attr-defined]
        raise CheckFailed(f"`acts_as` is {cls.acts_as!r}, expected force, acceleration or velocity")  # type: ignore[attr-defined]
    if not isinstance(cls.everywhere, bool):  # type: ignore[attr-defined]
        raise CheckFailed(f"`everywhere` is {cls.everywhere!r}, expected True or False")  # type: ignore[attr-defined]
    for options in subject.examples:
        vector = subject.make(options).vector()
        if vector is not None and not (1 <= len(vector) <= 3 and np.isfinite(vector).all() and np.any(vector)):
            raise CheckFailed(f"`vector` is {vector!r}, expected a direction of one to three numbers")


@check("loads")
def check_runs_in_a_case(subject: Subject) -> None:
    """Its impulse is that of its amplitude.

    In a run the impulse of a load is that of its amplitude, and momentum and energy are balanced to round-off. The
    load acts on a free bar: at its end or everywhere, or as the velocity of the driven end. A load that follows the
    motion of an end has no impulse of its own; only the balances are checked.
    """
    follows = issubclass(subject.component, FollowingLoad)
    for options, load in subject.made():
        vector = load.vector()
        dim = len(vector) if vector is not None else 1
        quantity = subject.component.acts_as  # type: ignore[attr-defined]
        where = {} if subject.component.everywhere else {"on": "a.left"}  # type: ignore[attr-defined]
        start = np.eye(dim)[0].tolist()
        body = bar(5, velocity=start if follows else 0.0, at=[0.0] * dim)
        if dim > 1:
            body["bar"]["direction"] = start
        push = {subject.name: dict(options), **where}
        case = chain({"a": body}, loads={"push": push}, time={"steps": 400, "courant": 0.5})
        result = subject.run(case)
        must_balance(result)
        momentum, dt = result.summary["momentum"], result.summary["dt"]
        if quantity == "velocity" or follows:
            continue
        steps = np.arange(result.summary["steps"]) * dt
        expected = dt * float(np.sum(load.amplitude(steps))) * (0.01 if quantity == "acceleration" else 1.0)
        along = np.asarray(vector if vector is not None else [1.0])
        impulse = float(np.dot(momentum["impulse_of_loads"], along / np.linalg.norm(along)))
        # the framework decides on the weights of the first and of the last step in which the load acts
        if abs(impulse - expected) > 2.0 * dt * float(np.abs(load.amplitude(steps)).max()) + 1e-12:
            raise CheckFailed(f"its impulse is {impulse:.6g}, that of its amplitude is {expected:.6g}")
