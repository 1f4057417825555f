"""Demands on integrators: declared order, conservation and stability, and the declared stages."""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np

from percuss.certificate import verdict
from percuss.errors import RunError, suggestion
from percuss.jsonable import Data, Entries
from percuss.march.model_of_case import model_of
from percuss.methods.interfaces import Floats, Integrator, Stages
from percuss.step.integrator_check import plain_step
from percuss.testing.draws import at_courant, bar, chain, per_cent
from percuss.testing.subject import NotApplicable, Subject, demand, must

CONSERVED = {"energy": ["left"], "momentum": []}  # what a scheme may conserve, with the fixed ends of its bar
COURANTS = (0.4, 0.2, 0.1, 0.05, 0.025, 0.0125)  # Courant numbers at which the order is measured
ORDER_TOLERANCE = 0.15  # largest deviation of the measured from the declared order
PULL = 1.0  # a force that displaces the end by as much as its velocity does
LOWEST = 1e-11  # relative to the amplitude; smaller errors are round-off
CONSERVATION_TOLERANCE = 1e-11  # largest relative change of a conserved quantity
GROWN = 1e3  # ratio of energies that tells that they grow
SAFE = 0.9  # Courant number relative to the limit of an integrator
MARGIN = 0.01  # distance from the critical Courant number at which stability is tried, relative to it


def moving_bar(elements: int, courant: float, steps: int, *fixed: str) -> Entries:
    """Return a case of a moving bar without contact, with fixed ends from t = 0 on."""
    case = chain({"a": bar(elements, velocity=1.0, fixed=list(fixed))}, time={"steps": steps, "courant": courant})
    return {**case, "record": {"probes": ["a.right"]}}


def below_limit(subject: Subject, case: Data, courant: float) -> float:
    """Return a Courant number, lowered where it is near or above the limit of the scheme in a case without contact."""
    limit = verdict.certificate(model_of(subject.load(case)))["courant_critical"]
    return courant if limit is None else min(courant, SAFE * limit)


def exact_end(elements: int, pull: float, time: Floats) -> dict[str, Floats]:
    """Return the exact motion of the free end of a `moving_bar` fixed at its left end and pulled at this one.

    It swings about the place where it would rest: its modes start with a displacement and a velocity.
    """
    young, density = bar(1)["material"].values()
    angles = (np.arange(elements) + 0.5) * np.pi / elements  # between neighbouring nodes of each mode
    omega = 2.0 * elements * np.sqrt(young / density) * np.sin(0.5 * angles)
    at = np.arange(1, elements + 1)
    modes, mass = np.sin(np.outer(at, angles)), np.append(np.ones(elements - 1), 0.5)
    rest = pull / young * at / elements
    displaced, moving = ((mass * start) @ modes / (mass @ modes**2) * modes[-1] for start in (-rest, np.ones(elements)))
    cosine, sine = (function(omega[:, None] * time) for function in (np.cos, np.sin))
    return {
        "displacement": rest[-1] + displaced @ cosine + (moving / omega) @ sine,
        "velocity": moving @ cosine - (displaced * omega) @ sine,
    }


@demand("integrators")
def check_order(subject: Subject) -> None:
    """The declared order is the measured one.

    Without contact, halving the step divides the error of the motion by two to the power of the declared `order`.
    The order is the lower one of displacement and velocity. It is measured on a bar of four elements that moves and is
    pulled at its end, against its exact modes, from errors above round-off and at steps below the limit of the scheme.
    It may deviate by 0.15.
    """
    declared: Any = getattr(subject.component, "order", None)
    whole = isinstance(declared, int) and declared >= 1
    must(whole, f"`order` is {declared!r}, expected a whole number of at least 1")
    for options in subject.examples:
        largest = below_limit(subject, subject.placed(moving_bar(4, COURANTS[0], 1, "left"), options), COURANTS[0])
        courants = [courant * largest / COURANTS[0] for courant in COURANTS]
        errors: dict[str, list[float]] = {"displacement": [], "velocity": []}
        for courant in courants:
            case = moving_bar(4, courant, round(2.0 / courant), "left")
            case["loads"] = {"pull": {"constant": PULL, "on": "a.right"}}
            arrays = subject.run(subject.placed(case, options)).arrays
            for name, exact in exact_end(4, PULL, arrays["time"]).items():
                errors[name].append(float(np.abs(arrays[name][:, 0, 0] - exact).max() / np.abs(exact).max()))
        slopes = {}
        for name, found in errors.items():
            used = [k for k, error in enumerate(found) if error > LOWEST][-2:]
            if len(used) == 2:
                slopes[name] = np.log(found[used[0]] / found[used[1]]) / np.log(COURANTS[used[0]] / COURANTS[used[1]])
        lowest = min(slopes, key=slopes.__getitem__, default="")
        if lowest:
            points = zip(courants, errors[lowest], strict=True)
            measured = ", ".join(f"{per_cent(error)} at C = {courant:g}" for courant, error in points)
            words = f"it declares order {declared}, measured is {slopes[lowest]:.2f} of the {lowest}: {measured}"
            must(abs(slopes[lowest] - declared) <= ORDER_TOLERANCE, words)


@demand("integrators")
def check_conserves(subject: Subject) -> None:
    """It conserves what it declares.

    Without contact an integrator conserves the quantities in `conserves` to round-off. Energy is measured over a
    thousand steps of a vibrating bar, momentum on a bar in free flight. The Courant numbers are 0.3 and 0.9, or 0.9
    of the limit of the scheme if that is less.
    """
    declared = subject.component.conserves  # type: ignore[attr-defined]
    for fact in declared:
        advice = suggestion(fact, CONSERVED, "quantity")
        must(fact in CONSERVED, f"'{fact}' cannot be declared in `conserves`. {advice}")
    for options, wanted, fact in itertools.product(subject.examples, (0.3, 0.9), declared):
        case = subject.placed(moving_bar(7, wanted, 1000, *CONSERVED[fact]), options)
        result = subject.run(at_courant(case, below_limit(subject, case, wanted)))
        momentum = result.summary["momentum"]
        values = {
            "energy": result.arrays["kinetic_energy"] + result.arrays["elastic_energy"],
            "momentum": np.array([momentum["initial"][0], momentum["final"][0]]),
        }[fact]
        changed, at = float(np.abs(values / values[0] - 1.0).max()), f"C = {result.summary['courant']:g}"
        words = f"it declares to conserve {fact}, but it changes by {per_cent(changed)} at {at}"
        must(changed <= CONSERVATION_TOLERANCE, words)


@demand("integrators")
def check_critical_courant(subject: Subject) -> None:
    """It is stable up to `critical_courant`.

    Without contact the scheme is stable exactly up to the Courant number declared as `critical_courant`. The energy
    of uniform bars, in free flight and fixed at one end, stays bounded one per cent below that number and grows
    without bound one per cent above it.
    """
    declared = subject.component.critical_courant  # type: ignore[attr-defined]
    if declared is None:
        raise NotApplicable("it declares no critical Courant number")
    for above, courant in ((False, (1.0 - MARGIN) * declared), (True, (1.0 + MARGIN) * declared)):
        case = moving_bar(20, courant, 3000)
        case["bodies"]["b"] = {**case["bodies"]["a"], "at": 1.0, "fixed": ["left"]}  # it vibrates
        case["time"]["on_unstable"] = "warn"
        try:
            arrays = subject.run(subject.placed(case, subject.examples[0])).arrays
            energy = np.abs(arrays["kinetic_energy"] + arrays["elastic_energy"])
        except RunError:
            energy = np.array([1.0, np.inf])
        growth = float(energy.max() / energy[0])  # nan of a run that overflows
        found = "is bounded" if above else f"grows {growth:.2g}-fold"
        must((growth <= GROWN) != above, f"it declares {declared:g}, but energy {found} at C = {courant:.5g}")


@demand("integrators")
def check_stages(subject: Subject) -> None:
    """`times` and `end` describe the stages.

    In a multi-stage scheme `times` gives the time of each stage, and `end` the displacement of the next stage. A step
    changes v by dt a and u by dt v, in place; otherwise impulse and work are lost. In free flight at velocity v, a
    stage at time c asks for accelerations at the displacement u + c dt v; with another c the loads would act at another
    time. If `end` is (r_v, r_a, s_a), the next stage asks for accelerations at u + r_v v + r_a a, for any u, v and a of
    this stage, and s_a = r_a / r_v; otherwise a law of the end of the step is evaluated at another state. The first
    stage is compared with `start` in the same way if it lies after t = 0, where v is the velocity there and a the
    acceleration that is kept. Without `start` it is compared with the end of the last stage, unless laws without
    penetration are refused. If `velocity` is c, a stage at time t asks under a constant acceleration a for
    accelerations at a velocity v with v + c a = v_n + t dt a.
    """
    for options, integrator in subject.made():
        stages = integrator.bind(STEP)
        if not isinstance(stages, Stages):
            raise NotApplicable("it is no multi-stage scheme")
        (_, *calls), u, v = _steps(integrator, stages, 1)
        by_v, by_a = float(u[1] / STEP), float(v[ACCELERATIONS].sum() / STEP)
        must(
            np.abs([by_v - 1.0, v[1] - 1.0, by_a - 1.0]).max() <= STAGED_TOLERANCE,
            "step must change u and v in place (u += ..., or u[:] = ...), v by dt times a constant acceleration and u "
            f"by dt times a constant velocity; found a change of v by {by_a:.9g} dt a, and of u by {by_v:.9g} dt v",
        )
        for call in calls:
            _check_stage(stages, call)
        if stages.end:
            start = bool(type(integrator).kept and (stages.start or not _refuses_exact_laws(subject, options)))
            _check_stage_end(integrator, stages, start=start)


STEP = 0.37
STAGED_TOLERANCE = 1e-9
# A step is linear. So u, v and each answer have a direction of their own in the steps of the check, and a state is the
# list of its shares in them: first those of u and v at the start, then in turn those of accelerations and of internal
# forces.
DIRECTIONS = np.eye(64)
ACCELERATIONS, INTERNAL_FORCES = slice(2, None, 2), slice(3, None, 2)


class Call(NamedTuple):
    """A call of `accelerations`: its stage, -1 of the state before the first step, the state, and its answer."""

    stage: int
    u: Floats
    v: Floats
    a: Floats


def _steps(integrator: Integrator, stages: Stages, count: int) -> tuple[list[Call], Floats, Floats]:
    """Return the calls of `accelerations` in some steps of a scheme, and the displacement and velocity after them."""
    u, v = DIRECTIONS[:2].copy()
    answers, forces = iter(DIRECTIONS[ACCELERATIONS]), iter(DIRECTIONS[INTERNAL_FORCES])
    calls = [Call(-1, u.copy(), v.copy(), next(answers))]
    kept = np.tile(calls[0].a, (type(integrator).kept, 1))  # all rows are set to the acceleration at t = 0

    def expect(stage: int) -> None:
        number = len(stages.times)
        must(stage < number, f"step asks for stage {stage}, and Stages.times has {number}")

    def accelerations(system: object, stage: int, u: Floats, v: Floats, a: Floats) -> None:  # noqa: ARG001  signature of the slot
        expect(stage)
        a[:] = next(answers)
        calls.append(Call(stage, u.copy(), v.copy(), a.copy()))

    def internal_forces(system: object, stage: int, u: Floats, f: Floats) -> None:  # noqa: ARG001  signature of the slot
        expect(stage)
        f[:] = next(forces)

    step = plain_step(integrator, accelerations, internal_forces)
    for _ in range(count):
        step(stages.numbers, None, u, v, kept, STEP)
    return calls, u, v


def _check_stage(stages: Stages, call: Call) -> None:
    """Raise `CheckFailed` unless displacement and velocity of a stage of the first step fit what it says of itself."""
    stage, declared = call.stage, stages.times[call.stage]
    time = float(call.u[1] / STEP)
    must(
        abs(time - declared) <= STAGED_TOLERANCE,
        f"`times` puts stage {stage} at {declared:.9g} of the step, but in free flight its displacement is that at "
        f"{time:.9g}",
    )
    if stages.velocity:
        reached = float(call.v[ACCELERATIONS].sum() + stages.velocity[stage]) / STEP
        must(
            np.abs([call.v[0], call.v[1] - 1.0, reached - declared]).max() <= STAGED_TOLERANCE,
            f"`velocity` of stage {stage} gives v + {stages.velocity[stage]:.9g} a as the velocity at {declared:.9g} "
            f"of the step; under a constant acceleration it is the velocity at {reached:.9g}",
        )


def _refuses_exact_laws(subject: Subject, options: Data) -> bool:
    """Return whether an integrator refuses all laws that guarantee "no penetration"."""
    laws = [cls for (family, _), cls in subject.registry.components.items() if family == "contacts"]
    exact: list[Any] = [cls for cls in laws if "no penetration" in cls.guarantees]  # type: ignore[attr-defined]
    return all(subject.make(options).refuses(cls(**cls.examples[0])) for cls in exact)


def _check_stage_end(integrator: Integrator, stages: Stages, *, start: bool) -> None:
    """Raise `CheckFailed` unless `end` predicts the displacement of the next stage and its mean velocity."""
    for (stage, u, v, a), (following, next_u, _, _) in itertools.pairwise(_steps(integrator, stages, 2)[0]):
        if stage < 0 and (not start or stages.times[following] == 0.0):
            continue  # A first stage at the start itself sees to what follows.
        said = f"`end` of stage {stage}" if stage >= 0 else "`start`, or else the `end` of the last stage,"
        r_v, r_a, s_a = stages.end[stage] if stage >= 0 else stages.start or stages.end[-1]
        fit = np.linalg.lstsq(np.stack([v, a], axis=1), next_u - u, rcond=None)[0]
        must(
            np.abs(u + r_v * v + r_a * a - next_u).max() <= STAGED_TOLERANCE,
            f"{said} gives u + {r_v:.9g} v + {r_a:.9g} a as the next displacement; the next stage has another one, "
            f"nearest to u + {fit[0]:.9g} v + {fit[1]:.9g} a (the step is {STEP:g})",
        )
        mean = r_a / r_v
        words = f"{said} gives s_a = {s_a:.9g}; the mean velocity to the next stage needs r_a / r_v = {mean:.9g}"
        must(abs(s_a - mean) <= STAGED_TOLERANCE * abs(s_a), words)
