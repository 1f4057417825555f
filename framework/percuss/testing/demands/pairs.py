"""Demands on integrators and contact laws in pairs: balances, exact impacts, energy growth, units, free flight."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterator
from typing import cast

import numpy as np
from hypothesis import strategies as st

from percuss.case.quantities import COMPARED_BY_KIT, QUANTITIES
from percuss.certificate import verdict
from percuss.errors import InputError, RunError
from percuss.jsonable import Data, Entries
from percuss.march.model_of_case import model_of
from percuss.methods.interfaces import LeapFrog
from percuss.results.ledger import STORED_BY_LAWS
from percuss.results.result import Result
from percuss.testing import draws
from percuss.testing.draws import bar, bar_chains, chain, for_all, must_agree, must_balance, number, on_chains, per_cent
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, as_of, demand, was_not_started

PAIRS = ("integrators", "contacts")
GROWTH_TOLERANCE = 1e-10  # relative to the largest energy; less growth is round-off
REDUCTION = 0.6  # largest allowed ratio of the impulse errors of a finer mesh and of the coarsest
MESHES = (2, 8, 32)  # refinements; the third is for methods whose error on the first is small by chance
SAFE = 0.9  # Courant number relative to the limit of an integrator
SMALLEST_COURANT = 0.02  # Courant number below which no run is tried: it would take too long
CLOSE = 0.1  # largest allowed relative error of the impulse on a finer mesh
AS_GOOD_AS_EXACT = 2e-3  # relative error of the impulse below which no further convergence is demanded
COURANT = 0.5  # of an exact impact, where that is stable
COURANTS = (0.25, 0.45, 0.65, 0.8, 0.86, 0.95)


@demand(*PAIRS, "elements", "materials", "masses", "shapes")
@on_chains(push=True)
def check_balances(subject: Subject, case: Entries) -> None:
    """Momentum and energy are balanced.

    The momentum balance of every run closes to round-off, and so does the energy ledger of a leap-frog scheme. A force
    that acts on one side only, or that is not reported, violates them.
    """
    if subject.family == "shapes":  # one body, because a shape names its ends itself
        name, body = next(iter(case["bodies"].items()))
        case = {**case, "bodies": {name: body}, "contacts": {}, "loads": {}, "record": {"probes": []}}
    case = subject.placed(case)
    must_balance(subject.run(case), ledger=isinstance(subject.scheme_of(case), LeapFrog))


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
        errors: list[float] = []
        certify, courant = verdict.verdict_alone, COURANT
        for refine in MESHES:
            case = at_courant(subject.placed(impact((*drawn, refine)), subject.examples[0], partner), courant)
            try:
                result = _run_at_stable_step(subject, case, certify)
            except RunError as stopped:
                raise CheckFailed(f"the run was {stopped}") from None
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
        except RunError:
            courant *= 0.5
            if courant < SMALLEST_COURANT:
                raise


def at_courant(case: Data, courant: float) -> Entries:
    """Return a case with another Courant number."""
    return {**case, "time": {**case["time"], "courant": courant}}


def below_limit(subject: Subject, case: Data, courant: float) -> float:
    """Return a Courant number, lowered where it is near or above the limit of an integrator without contact.

    The limit is the declared one; of an integrator that declares none, it is that of its certificate.
    """
    if subject.family != "integrators":
        return courant
    limit = subject.component.critical_courant  # type: ignore[attr-defined]
    if limit is None:
        free = {**case, "contacts": {}, "method": {"integrator": case["method"]["integrator"]}}
        limit = verdict.certificate(model_of(subject.load(free)))["courant_critical"]
    return courant if limit is None else min(courant, SAFE * limit)


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
        full_case = subject.placed(case, options, {"name": partner, **partner_options})
        if getattr(subject.scheme_of(full_case), "own_steps", False):
            raise NotApplicable("its internal forces do not act in every step, so contact is not balanced in each")
        try:
            if energy_growth(subject, full_case, subject.run(full_case, certify=verdict.unasked)) <= GROWTH_TOLERANCE:
                return
        except InputError:
            return
        except RunError:  # the certificate tells whether the step is to blame
            pass
        try:
            result = subject.run(full_case)
        except RunError as stopped:
            if stopped.result.summary["certificate"]["stable"] != "yes":
                return
            raise CheckFailed(f"the run was {stopped}") from None
        certificate = result.summary["certificate"]
        if certificate["stable"] not in {"yes", "unknown"} or (
            certificate["theta"] is not None and certificate["theta"] >= 1.0
        ):
            return
        relative_growth = energy_growth(subject, full_case, result)
        if relative_growth > GROWTH_TOLERANCE:
            raise CheckFailed(f"energy grows by {per_cent(relative_growth)} of its largest value")

    for options, partner_options in pairs:
        for case in repeated_impacts():
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
    rises = [float(energy.max()) - result.summary["energy"]["initial"]]
    rises += [float((open_energy - np.minimum.accumulate(open_energy)).max())] if open_energy.size else []
    return max(rises) / scale if scale else 0.0


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
        arrays = subject.run(other, certify=as_of(base)).arrays
        return {name: arrays[name] / draws.unit_factor(QUANTITIES[name].unit) for name in COMPARED_BY_KIT}

    must_agree(subject, subject.placed(case), "a change of units", converted_back)


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
        if was_not_started(stopped):
            raise
        raise CheckFailed(f"bodies that never meet: the run was {stopped}") from None
    if apart.arrays["contact_force"].any():
        raise CheckFailed("bodies that never meet have a contact force")
