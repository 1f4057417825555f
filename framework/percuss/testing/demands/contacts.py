"""Demands on contact laws and integrators, alone and in pairs: order, conservation, stability, declared stages."""

from __future__ import annotations

import contextlib
import copy
import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple, cast

import numpy as np
from hypothesis import strategies as st

from percuss.case.quantities import COMPARED_BY_KIT, QUANTITIES
from percuss.certificate import verdict
from percuss.contact.bound_law import COEFFICIENTS, bind_law
from percuss.contact.law_trials import COUPLED, multipliers_of, plain_kernel, trial_of, trial_states
from percuss.errors import InputError, RunError, suggestion
from percuss.jsonable import Data, Entries
from percuss.march.model_of_case import model_of
from percuss.march.stop import NOT_STARTED
from percuss.methods.interfaces import ContactPoints, Floats, Integrator, LeapFrog, LinearLaw, Stages
from percuss.results.ledger import STORED_BY_LAWS
from percuss.results.result import Result
from percuss.step.integrator_check import plain_step
from percuss.testing import draws
from percuss.testing.draws import at_courant, bar, bar_chains, chain, for_all, number, on_chains, per_cent
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, demand, must, sample_points

COUNTS = (0, 1, 2, 5)  # numbers of contact points
# Two bars that strike each other, and a wall that one of them reaches with the same end.
STRUCK_TWICE = {
    **draws.TWO_BARS,
    "contacts": {**draws.TWO_BARS["contacts"], "wall": {"body": "a.right", "wall": 1.0002}},
    "time": {**draws.TWO_BARS["time"], "on_unstable": "warn"},
}
ALIKE = 1e-6  # largest difference of two forces, relative to their peak
WIDE = 4.0
NEARLY_EQUAL = 1e-6  # largest change of a short run by the order of its contacts, relative to its peaks
REDUCTION = 0.6  # largest allowed ratio of the errors on a finer mesh, or with a shorter step, and on the coarsest
NOT_BACK = "the wall does not push the bar back (a multiplier is positive in compression)"
STEP = 1e-3
SHORT_STEP = 1e-9  # a dashpot weaker than it is taken for a law of another time within the step
APPROACHES = (1.0, 0.1, -0.1, -1.0)  # gap rates, from a fast opening to a fast closing
ADDS_ENERGY = "a dashpot of this sign adds energy"
PAIRS = ("integrators", "contacts")
GROWTH_TOLERANCE = 1e-10  # relative to the largest energy; less growth is round-off
MESHES = (2, 8, 32)  # refinements; the third is for methods whose error on the first is small by chance
SMALLEST_COURANT = 0.02  # Courant number below which no run is tried: it would take too long
CLOSE = 0.1  # largest allowed relative error of the impulse on a finer mesh
AS_GOOD_AS_EXACT = 2e-3  # relative error of the impulse below which no further convergence is demanded
COURANT = 0.5  # of an exact impact, where that is stable
COURANTS = (0.25, 0.45, 0.65, 0.8, 0.86, 0.95)
GUARANTEES = ("never pulls", "no penetration", "keeps the free step")


class Bound(NamedTuple):
    """A contact law bound at contact points for a time step: a linear law, or the data of its kernel."""

    law: Any
    points: ContactPoints
    dt: float
    linear: LinearLaw | None
    data: Any

    def answer(self, state: list[Floats], before: Floats | None = None, strength: float = 0.0) -> tuple[Floats, Floats]:
        """Return the multipliers of its kernel in a state, with points coupled so strongly, and the state variables."""
        trial = trial_of(self.points, self.dt, state, self.law, before, strength=strength)
        return multipliers_of(self.law, plain_kernel(self.law), self.data, trial), trial.after


def _bound(subject: Subject, options: Data, points: ContactPoints, dt: float = STEP) -> Bound:
    law = subject.make(options)
    found = bind_law(law, tuple(range(len(points.names))), points, dt)
    return Bound(law, points, dt, found.linear, found.kernel_data)


@demand("contacts")
def check_any_number_of_contacts(subject: Subject) -> None:
    """Many points are treated as each alone.

    A law binds at any number of contact points, also at none, and treats each point as it would treat it alone. Its
    kernel sets every multiplier in every kind of state, open, closed and touching, in approach and parting, and writes
    to nothing else.
    """
    for options, count in itertools.product(subject.examples, COUNTS):
        together = _bound(subject, options, sample_points(count))
        alone = [_bound(subject, options, sample_points(count, slice(p, p + 1))) for p in range(count)]
        if together.linear is not None:
            for name in COEFFICIENTS:
                _compare(name, getattr(together.linear, name), [getattr(one.linear, name) for one in alone])
            continue
        before = np.zeros((count, together.law.state))
        for state in trial_states(count, STEP):
            multiplier, after = together.answer(state, before)
            of_points = [([values[p : p + 1] for values in state], before[p : p + 1]) for p in range(count)]
            _compare("multiplier", multiplier, [one.answer(*own)[0] for one, own in zip(alone, of_points, strict=True)])
            before = after


def _compare(name: str, together: Any, alone: list[Any]) -> None:
    """Raise `CheckFailed` unless the values of a law at some points are those at each point alone."""
    single = np.array([values[0] for values in alone], dtype=float)
    same = np.allclose(together, single, rtol=1e-13, atol=0.0, equal_nan=True)
    must(same, f"{name} of each point is {together} at {len(alone)} points, and {single} alone")


@demand("contacts")
def check_coupling(subject: Subject) -> None:
    """The order of contacts at one end does not matter.

    A kernel that declares `uses_coupling` solves the contacts at one end together: with too few sweeps the result
    depends on their order.
    """
    if not subject.component.uses_coupling:  # type: ignore[attr-defined]
        raise NotApplicable("it does not declare `uses_coupling`")
    for options in subject.examples:
        for partner in subject.partners:
            case = subject.placed(STRUCK_TWICE, options, partner)
            swapped = {**case, "contacts": dict(reversed(case["contacts"].items()))}
            with contextlib.suppress(InputError, RunError, NotApplicable):
                arrays, other = (subject.run(each).arrays for each in (case, swapped))
                mirrored = {name: other[name][:, ::-1] for name in ("contact_force", "gap")}
                difference = draws.largest_difference(arrays, {**mirrored, "displacement": other["displacement"]})
                words = f"with {partner} the order of contacts at one end changes the result by {per_cent(difference)}"
                must(difference <= NEARLY_EQUAL, f"{words} of its peak: sweep over the contacts until nothing changes")


@demand("contacts")
def check_stored_and_dissipated(subject: Subject) -> None:
    """Stored and dissipated energy add up.

    The energies that a law says its contact stores and has dissipated add up to the work that the contact takes
    from the bodies. The difference vanishes with the time step, and the dissipated energy never decreases.
    """
    law: Any = subject.component
    if law.stored_in is None or law.dissipated_in is None:
        raise NotApplicable("it does not declare both `stored_in` and `dissipated_in`")
    for options in subject.examples:
        errors = []
        for courant in (0.4, 0.1):
            case = {**draws.STRUCK_WALL, "time": {"end": 0.04, "courant": courant}}
            try:
                result = subject.run(subject.placed(case, options))
            except InputError as refusal:
                raise NotApplicable(str(refusal)) from None
            arrays, largest = result.arrays, result.summary["energy"]["max"]
            dissipated = arrays["contact_dissipation"]
            falls = np.diff(dissipated).min(initial=0.0)
            must(falls >= -1e-12 * largest, "the energy that it has dissipated decreases")
            missing = arrays["contact_work"] + arrays["contact_energy"] + dissipated
            errors.append(float(np.abs(missing[-1])) / largest)
        must(
            errors[1] <= max(REDUCTION * errors[0], 1e-4),
            f"{per_cent(errors[0])} of the largest energy is missing at a Courant number of 0.4, and "
            f"{per_cent(errors[1])} at 0.1: neither stored, dissipated nor given back",
        )


@demand("contacts")
def check_pushes_apart(subject: Subject) -> None:
    """A wall pushes a bar back.

    A bar that strikes a wall is pushed back: the contact impulse is positive.
    Multipliers are positive in compression, so a law of the opposite sign pulls the bodies into each other. No force
    in closed contact falls with the speed of approach: a dashpot of the opposite sign adds energy.
    """
    case = {**draws.STRUCK_WALL, "time": {"end": 0.009, "courant": 0.5}}
    for options in subject.examples:
        _check_sign_of_rate(subject, options)
    for options, partner in itertools.product(subject.examples, subject.partners):
        try:
            result = subject.run(subject.placed(case, options, partner))
        except (InputError, NotApplicable):
            continue
        except RunError as stopped:
            must(was_not_started(stopped), f"{NOT_BACK}: the run was {stopped}")
            continue
        impulse = result.summary["contacts"]["wall"]["impulse"]
        must(impulse > 0.0, f"{NOT_BACK}: its impulse is {impulse:.3g}")


def was_not_started(stopped: RunError) -> bool:
    """Return whether a run was refused before its first step because of its certificate, not stopped during it."""
    return bool(stopped.result.summary["stop"]["what"] == NOT_STARTED)


def _check_sign_of_rate(subject: Subject, options: Data) -> None:
    """Raise `CheckFailed` if a force in closed contact is the lower the faster its sides approach each other."""
    dt, deep = SHORT_STEP, np.full(2, -1e-3)
    bound = _bound(subject, options, sample_points(2), dt)
    if (linear := bound.linear) is not None:
        # The gap at the end of a step has the rate in it.
        weight = float(np.min(linear.rate + dt * np.asarray(linear.gap) * (linear.at == "end")))
        must(weight >= 0.0, f"the weight of the gap rate is {weight:.3g}: {ADDS_ENERGY}")
        return
    rates = np.repeat(APPROACHES, 2).reshape(-1, 2)
    found = [bound.answer([deep, deep + dt * rate, rate, rate], strength=COUPLED)[0][0] for rate in rates]
    rises = (np.diff(found) >= -ALIKE * np.abs(found).max()).all()
    must(rises, f"of one gap at the rates {APPROACHES} the multipliers are {np.array(found)}: {ADDS_ENERGY}")


@demand("contacts")
def check_areas(subject: Subject) -> None:
    """Points press by their areas.

    The forces of points are in proportion to `weight`, the area of a point, as `stiffness` and `mass` are. On bars the
    area is 1, so that a law that forgets it is right there, and on surfaces of more points too stiff.
    """
    for options in subject.examples:
        small, large = (_bound(subject, options, sample_points(3, area=area)) for area in (1.0, WIDE))
        if small.linear is not None and large.linear is not None:
            pairs = [(small.linear.sigma, WIDE * np.asarray(large.linear.sigma))]
        else:
            states = trial_states(3, STEP)
            pairs = [(small.answer(state)[0], large.answer(state)[0] / WIDE) for state in states]
        for one, other in pairs:
            alike = np.abs(one - other).max() <= ALIKE * np.abs(one).max()
            must(alike, f"points of {WIDE:g} times the area press otherwise: `weight` of a point is its area")


@demand("contacts")
@on_chains()
def check_guarantees(subject: Subject, case: Entries) -> None:
    """Its guarantees are kept in every run.

    The declared `guarantees` of a law hold in every drawn run, with every partner and option set. The possible
    guarantees are "never pulls", "no penetration" (at the end of each step, and at each of its stages) and "keeps
    the free step", the latter under schemes with one step for all bodies.
    """
    declared = subject.component.guarantees  # type: ignore[attr-defined]
    for fact in declared:
        must(fact in GUARANTEES, f"'{fact}' is no known guarantee. {suggestion(fact, GUARANTEES, 'guarantee')}")
    if not declared:
        raise NotApplicable("it declares no guarantee")
    full_case, keeps = subject.placed(case), "keeps the free step" in declared
    try:
        result = subject.run(full_case, certify=verdict.certificate if keeps else verdict.verdict_alone)
    except RunError as refusal:
        must(not keeps, f"it declares 'keeps the free step', but the run was {refusal}")
        raise
    force, gap = result.arrays["contact_force"], result.arrays["gap"]
    travel = float(np.abs(result.arrays["displacement"]).max()) + float(np.abs(gap).max(initial=0.0))
    least = force.min(initial=0.0)
    must("never pulls" not in declared or least >= 0.0, f"it declares 'never pulls', but a force is {least:.3g}")
    deepest = max(contact["penetration"]["largest"] for contact in result.summary["contacts"].values())
    deepest = max(deepest, -float(gap.min(initial=0.0)))
    apart = "no penetration" not in declared or deepest <= 1e-11 * travel
    must(apart, f"it declares 'no penetration', but bodies overlap by {deepest:.3g}")
    certificate = result.summary["certificate"]
    critical, free = certificate["dt_critical"], certificate["dt_critical_free"]
    lowered = critical is not None and free is not None and critical < free * (1.0 - 1e-5)
    must(not (keeps and lowered), f"it declares 'keeps the free step', but {certificate['why']}")


# ------------------------------------------------------------------------------------- laws and integrators in pairs


@demand(*PAIRS, "elements", "materials", "masses")
@on_chains(push=True)
def check_balances(subject: Subject, case: Entries) -> None:
    """Momentum and energy are balanced.

    The momentum balance of every run closes to round-off, and so does the energy ledger of a leap-frog scheme. A force
    that acts on one side only, or that is not reported, violates them.
    """
    case = subject.placed(case)
    draws.must_balance(subject.run(case), ledger=isinstance(subject.scheme_of(case), LeapFrog))


# ------------------------------------------------------------------------------------------- exact solutions


def impact(parameters: tuple[float, float, float, int]) -> Entries:
    """Return a case of two unlike bars that touch and move towards each other, run until they have separated.

    Parameters
    ----------
    parameters
        Length, Young's modulus and area of bar b, and the refinement of the mesh.
    """
    length, young, area, refine = parameters
    second = bar(round(10 * length), length, young=young, area=area, at=1.0, velocity=-0.1)
    transit = 2.0 * max(1.0 / 100.0, length / (young / 0.01) ** 0.5)
    time = {"end": 1.3 * transit, "courant": COURANT}
    return chain({"a": bar(10, velocity=0.2), "b": second}, refine=refine, time=time)


@demand(*PAIRS, in_pairs=True)
def check_exact_impact(subject: Subject, partner: str) -> None:
    """The impulse tends to the exact one.

    The impulse of two unlike colliding bars tends to the exact one as the mesh is refined, with default options. The
    Courant number is 0.5, or the largest half, quarter and so on of it at which the coarsest mesh runs. With a wrong
    sign, a force applied twice, an ignored time step or the gap of an earlier step the impulse has another limit.
    """

    def check_convergence(drawn: tuple[float, float, float]) -> None:
        """Fail if the impulse of an impact, by its drawn numbers, does not tend to the exact one."""
        errors: list[float] = []
        certify, courant = verdict.verdict_alone, COURANT
        for refine in MESHES:
            case = at_courant(subject.placed(impact((*drawn, refine)), subject.examples[0], partner), courant)
            result = _run_at_stable_step(subject, case, certify)
            if result.summary["exact"] is None:
                raise NotApplicable(f"no exact solution: {result.summary['exact_reason']}")
            certify, courant = verdict.unasked, result.summary["courant"]
            errors.append(cast("float", result.summary["exact"]["contacts"]["ab"]["impulse_error"]))
            if errors[-1] <= min(max(REDUCTION * errors[0], AS_GOOD_AS_EXACT), CLOSE) and len(errors) > 1:
                return
        off = ", ".join(f"{per_cent(error)} with {10 * refine}" for error, refine in zip(errors, MESHES, strict=True))
        raise CheckFailed(f"the impulse does not tend to the exact one: its error is {off} elements in the first bar")

    parameters = st.tuples(st.sampled_from([0.7, 1.0, 1.5]), number(30, 100), number(0.5, 2))
    for_all(subject, parameters, check_convergence, max(3, subject.draws // 3))


def _run_at_stable_step(subject: Subject, case: Entries, certify: verdict.Certify) -> Result:
    """Return the result of a run, with the step of the case or the largest half, quarter and so on at which it runs."""
    courant = case["time"]["courant"]
    while True:
        try:
            return subject.run(at_courant(case, courant), certify=certify)
        except RunError as stopped:
            courant *= 0.5
            must(courant >= SMALLEST_COURANT, f"the run was {stopped}")


# --------------------------------------------------------------------------------------------------- energy


@demand(*PAIRS, in_pairs=True)
def check_energy_never_grows(subject: Subject, partner: str) -> None:
    """Energy never grows at a stable step.

    Energy minus the work of loads never grows if the step with closed contacts is stable. Contacts may open and
    close. The energy includes the energy stored in the contacts if it follows from the law and does not rest on the
    law's own word. Otherwise the energy never exceeds its initial value and never rises from one state with all
    contacts open to the next. A scheme that gives bodies steps of their own is exempt, whatever the contact law.
    """
    pairs = list(itertools.product(subject.examples, subject.partner_class(partner).examples))

    def check_growth(case: Data, options: Data, partner_options: Data) -> None:
        """Fail if the energy of a case grows with the options of the method and of its partner."""
        full_case = subject.placed(case, options, {"name": partner, **partner_options})
        if getattr(subject.scheme_of(full_case), "own_steps", False):
            raise NotApplicable("its internal forces do not act in every step, so contact is not balanced in each")
        growth = np.inf
        with contextlib.suppress(RunError):  # the certificate tells whether the step is to blame
            growth = energy_growth(subject, full_case, subject.run(full_case, certify=verdict.unasked))
        if growth <= GROWTH_TOLERANCE:
            return
        try:
            certificate = subject.run(full_case).summary["certificate"]
        except RunError as stopped:
            must(stopped.result.summary["certificate"]["stable"] != "yes", f"the run was {stopped}")
            return
        above_limit = certificate["theta"] is not None and certificate["theta"] >= 1.0
        allowed = certificate["stable"] not in {"yes", "unknown"} or above_limit
        must(allowed, f"energy grows by {per_cent(growth)} of its largest value")

    for (options, partner_options), case in itertools.product(pairs, repeated_impacts()):
        with contextlib.suppress(InputError):
            check_growth(case, options, partner_options)
    strategy = st.tuples(bar_chains(), st.sampled_from(pairs))
    for_all(subject, strategy, lambda drawn: check_growth(drawn[0], *drawn[1]))


def energy_growth(subject: Subject, case: Data, result: Result) -> float:
    """Return the energy growth of a run, relative to its largest energy.

    Raises
    ------
    NotApplicable
        If a law ties meshes.
    """
    model = model_of(subject.load(case))
    laws = [bound_law.linear for bound_law in model.laws]
    if any(law is not None and np.any(law.rate) and law.sign == "free" and law.active == "all" for law in laws):
        raise NotApplicable("it is a tie, which takes the gap rate from its ends as it begins")
    rigid = all(law is not None and law.sign == ">= 0" and not np.any(law.sigma) for law in laws)
    measured = result.summary["energy_growth"]["quantity"]
    # Without a stored energy in its name, the quantity is the work of contacts alone, which springs take and give back.
    without_stored = {"kinetic + elastic - work", "contact work"}
    contact_energy_known = rigid or (measured not in without_stored and STORED_BY_LAWS not in measured)
    if model.stages is None and contact_energy_known:
        return float(result.summary["energy_growth"]["largest"])
    arrays = result.arrays
    kinetic, elastic, work = arrays["kinetic_energy"], arrays["elastic_energy"], arrays["external_work"]
    energy = kinetic + elastic - work
    if model.facts.dissipates:  # what a lagging viscosity takes swings; contacts are held to what they add
        energy = energy + arrays["dissipated_energy"]
    all_open = (arrays["contact_force"] == 0.0).all(axis=1) & (arrays["gap"] >= 0.0).all(axis=1)
    open_energy = energy[all_open]
    scale = max(float(np.abs(part).max()) for part in (kinetic, elastic, work))
    rise = float(energy.max()) - result.summary["energy"]["initial"]
    between_open = float((open_energy - np.minimum.accumulate(open_energy)).max(initial=0.0))
    return max(rise, between_open) / scale if scale else 0.0


def repeated_impacts() -> Iterator[Entries]:
    """Yield cases of unlike bars that strike each other and walls many times, at several Courant numbers."""
    for courant in COURANTS:
        time = {"steps": int(240 / courant), "courant": courant}
        first = bar(7, velocity=0.4)
        walls = {"left": {"body": "a.left", "wall": -0.01}, "right": {"body": "a.right", "wall": 1.01}}
        yield {**chain({"a": first}, time=time), "contacts": walls}
        second = bar(9, 1.5, young=49.0, density=0.05, area=1.3, at=1.0, velocity=-0.3)
        yield chain({"a": first, "b": second}, wall=2.51, time=time)
        # a bar of one element between two bars of several elements is struck from both sides
        left = bar(5, 1.32, young=45.4, density=0.07, area=1.49, velocity=0.79)
        middle = bar(1, 1.72, young=200.0, density=0.04, at=1.32, velocity=-0.93)
        right = bar(8, 1.32, young=22.33, density=0.06, area=1.68, at=3.11, velocity=-0.52)
        yield chain({"a": left, "b": middle, "c": right}, wall=4.47, time=time)


# ------------------------------------------------------------------------------------------ units, free flight


@demand(*PAIRS)
@on_chains(push=True)
def check_units(subject: Subject, case: Entries) -> None:
    """A change of units changes nothing.

    Results do not depend on the units of length, mass and time. Options are converted by their stated units. A
    method with a dimensional constant inside it, or an option with a wrong unit, gives another result in other
    units.
    """
    other = subject.placed(draws.converted(case), draws.converted_options(subject))

    def converted_back(base: Result) -> draws.Arrays:
        arrays = subject.run(other, like=base).arrays
        return {name: arrays[name] / draws.unit_factor(QUANTITIES[name].unit) for name in COMPARED_BY_KIT}

    draws.must_agree(subject, subject.placed(case), "a change of units", converted_back)


@demand(*PAIRS)
@on_chains(share=2)
def check_no_contact(subject: Subject, case: Entries) -> None:
    """Bodies that never meet move freely.

    Bodies whose contacts never close have no contact force: a law does not act at a distance.
    """
    open_case = copy.deepcopy({**case, "loads": {}})
    for index, body in enumerate(open_case["bodies"].values()):
        body["at"] += 10.0 * index
        body["velocity"] = abs(body["velocity"]) * (index + 1)
    for contact in open_case["contacts"].values():
        if "wall" in contact:
            contact["wall"] += 10.0 * len(open_case["bodies"]) + 100.0
    try:
        apart = subject.run(subject.placed(open_case))
    except RunError as stopped:
        must(was_not_started(stopped), f"bodies that never meet: the run was {stopped}")
        raise
    must(not apart.arrays["contact_force"].any(), "bodies that never meet have a contact force")


# --------------------------------------------------------------------------------------- integrators by themselves

CONSERVED = {"energy": ["left"], "momentum": []}  # what a scheme may conserve, with the fixed ends of its bar
LARGEST, HALVINGS = 0.4, 5  # Courant numbers at which the order is measured
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
        largest = below_limit(subject, subject.placed(moving_bar(4, LARGEST, 1, "left"), options), LARGEST)
        courants = [largest * 0.5**k for k in range(HALVINGS + 1)]
        errors: dict[str, list[float]] = {"displacement": [], "velocity": []}
        for courant in courants:
            case = moving_bar(4, courant, round(2.0 / courant), "left")
            case["loads"] = {"pull": {"constant": PULL, "on": "a.right"}}
            arrays = subject.run(subject.placed(case, options)).arrays
            for name, exact in exact_end(4, PULL, arrays["time"]).items():
                errors[name].append(float(np.abs(arrays[name][:, 0, 0] - exact).max() / np.abs(exact).max()))
        slopes = {}
        for name, found in errors.items():
            used = [error for error in found if error > LOWEST][-2:]
            if len(used) == 2:
                slopes[name] = float(np.log2(used[0] / used[1]))
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
        stages = integrator.bind(STAGED_STEP)
        if not isinstance(stages, Stages):
            raise NotApplicable("it is no multi-stage scheme")
        (_, *calls), u, v = _steps(integrator, stages, 1)
        by_v, by_a = float(u[1] / STAGED_STEP), float(v[ACCELERATIONS].sum() / STAGED_STEP)
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


STAGED_STEP = 0.37
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
        step(stages.numbers, None, u, v, kept, STAGED_STEP)
    return calls, u, v


def _check_stage(stages: Stages, call: Call) -> None:
    """Raise `CheckFailed` unless displacement and velocity of a stage of the first step fit what it says of itself."""
    stage, declared = call.stage, stages.times[call.stage]
    time = float(call.u[1] / STAGED_STEP)
    must(
        abs(time - declared) <= STAGED_TOLERANCE,
        f"`times` puts stage {stage} at {declared:.9g} of the step, but in free flight its displacement is that at "
        f"{time:.9g}",
    )
    if stages.velocity:
        reached = float(call.v[ACCELERATIONS].sum() + stages.velocity[stage]) / STAGED_STEP
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
            f"nearest to u + {fit[0]:.9g} v + {fit[1]:.9g} a (the step is {STAGED_STEP:g})",
        )
        mean = r_a / r_v
        words = f"{said} gives s_a = {s_a:.9g}; the mean velocity to the next stage needs r_a / r_v = {mean:.9g}"
        must(abs(s_a - mean) <= STAGED_TOLERANCE * abs(s_a), words)
