"""Checks of loads: amplitudes over time, and when they are not smooth."""

from __future__ import annotations

import numpy as np

from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check

TIMES = np.linspace(0.0, 1.0, 41)
TOLERANCE = 1e-12


@check("loads")
def check_amplitude(subject: Subject) -> None:
    """An amplitude is a finite number for each time of an array, whatever its length and the other times in it.

    Amplitudes are asked for in chunks of steps: one that looks at its neighbours depends on where chunks end.
    """
    for options in subject.examples:
        load = subject.make(options)
        for time in (TIMES, TIMES[:1], TIMES[:0], TIMES[::-1].copy(), TIMES * 1e3):
            kept = time.copy()
            locked = time.copy()
            locked.flags.writeable = False
            try:
                found = np.asarray(load.amplitude(locked), dtype=float)
            except ValueError as error:
                raise CheckFailed(f"`amplitude` of {time.size} times: {error}") from error
            if found.shape != time.shape or not np.isfinite(found).all():
                raise CheckFailed(f"`amplitude` of {time.size} times has shape {found.shape}, or is not finite")
            if not np.array_equal(locked, kept):
                raise CheckFailed("`amplitude` changes the times it was handed")
            alone = [float(np.asarray(load.amplitude(time[k : k + 1]))[0]) for k in range(time.size)]
            size = float(np.abs(found).max(initial=1.0))
            if not np.allclose(found, alone, rtol=0.0, atol=TOLERANCE * size):
                raise CheckFailed("the amplitude at a time depends on the other times it is asked for")


@check("loads")
def check_kinks(subject: Subject) -> None:
    """Between the times that `kinks` names the amplitude is smooth: an exact solution is built on that.

    Held against the parabola through three of four near points, of which the fourth must be one.
    """
    told = False
    for options in subject.examples:
        load = subject.make(options)
        kinks = load.kinks()
        if kinks is None:
            continue
        told = True
        times = np.linspace(1e-4, 1.2, 3001)
        near = np.abs(times[:, None] - np.array([*kinks, -1.0])).min(axis=1) < 5 * (times[1] - times[0])
        values = np.asarray(load.amplitude(times), dtype=float)
        bends = np.abs(np.diff(values, 3))
        clear = ~(near[:-3] | near[1:-2] | near[2:-1] | near[3:])
        typical = np.median(bends[clear]) if clear.any() else 0.0
        size = float(np.abs(values).max(initial=1e-300))
        rough = np.flatnonzero(clear & (bends > 1e3 * typical + 1e-4 * size))
        if rough.size:
            raise CheckFailed(f"the amplitude has a kink near time {times[rough[0]]:.4g}, which `kinks` does not name")
    if not told:
        raise NotApplicable("it does not say when it is smooth")


@check("loads")
def check_facts_of_loads(subject: Subject) -> None:
    """`acts_as` is force, acceleration or velocity, and `vector` a direction of one to three numbers or nothing."""
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
    """In a case the load does the impulse that its amplitude has, and momentum and energy are accounted for.

    A bar in flight, pushed at its end, or driven where the load is a velocity.
    """
    for options in subject.examples:
        load = subject.make(options)
        vector = load.vector()
        dim = len(vector) if vector is not None else 1
        acts = subject.component.acts_as  # type: ignore[attr-defined]
        where = {} if subject.component.everywhere else {"on": "a.left"}  # type: ignore[attr-defined]
        case = {
            "percuss": 1,
            "bodies": {
                "a": {
                    "bar": {"length": 1.0, "elements": 5}
                    | ({"direction": [1.0, *[0.0] * (dim - 1)]} if dim > 1 else {}),
                    "material": {"young": 100.0, "density": 0.01},
                    "area": 1.0,
                }
            },
            "loads": {"push": {subject.name: dict(options), **where}},
            "time": {"steps": 400, "courant": 0.5},
        }
        result = subject.run(case)
        momentum, dt = result.summary["momentum"], result.summary["dt"]
        if momentum["error"] > 1e-11 or result.summary["energy"]["ledger_error"] > 1e-11:
            raise CheckFailed("momentum or energy is not accounted for")
        if acts == "velocity":
            continue
        steps = np.arange(result.summary["steps"]) * dt
        wanted = dt * float(np.sum(load.amplitude(steps))) * (0.01 if acts == "acceleration" else 1.0)
        along = np.asarray(vector if vector is not None else [1.0])
        found = float(np.dot(momentum["impulse_of_loads"], along / np.linalg.norm(along)))
        # the share of the first and the last step in which it acts is the framework's
        if abs(found - wanted) > 2.0 * dt * float(np.abs(load.amplitude(steps)).max()) + 1e-12:
            raise CheckFailed(f"its impulse is {found:.6g}, and that of its amplitude {wanted:.6g}")
