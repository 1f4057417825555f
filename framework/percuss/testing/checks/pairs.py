"""Checks of integrators and contact laws in pairs: balances, exact impacts, energy, and what must not matter."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from percuss.errors import InputError, RefusedPair, RunError
from percuss.methods.interfaces import LeapFrog, LinearLaw
from percuss.testing import draws
from percuss.testing.draws import STEEL, for_all, must_agree, number, replaced, rows, with_examples
from percuss.testing.subject import CheckFailed, NotApplicable, Subject, check, forbidden

PAIRS = ("integrators", "contacts")
BALANCED = 1e-11
GROWS = 1e-10  # of the largest energy: less is round-off
NO_BETTER = 0.6  # by which the error of the impulse falls when the mesh is four times finer
CLOSE = 0.1
AS_GOOD_AS_EXACT = 2e-3
COURANTS = (0.25, 0.45, 0.65, 0.8, 0.86, 0.95)


def unlike(options: Mapping[str, Any], error: InputError) -> NotApplicable:
    """Return a refusal of options by a case as a reason why a check does not apply."""
    return NotApplicable(f"options {dict(options)} are refused: {error}")


@check(*PAIRS)
def check_balances(subject: Subject) -> None:
    """Momentum is accounted for to round-off in every run, and energy too where the scheme is a leap-frog.

    A force that is not applied to both sides alike, or one that is applied and not reported, breaks them.
    """

    def balanced(one: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        case, options, partner = one
        mine = subject.placed(case, options, partner)
        try:
            result = subject.run(mine)
        except InputError as error:
            raise unlike(options, error) from None
        except RunError as stopped:
            raise NotApplicable(str(stopped)) from None
        momentum, ledger = result.summary["momentum"]["error"], result.summary["energy"]["ledger_error"]
        if not momentum <= BALANCED:
            raise CheckFailed(f"momentum is off by {momentum:.2g} of the impulses")
        if is_leap_frog(subject, mine) and not ledger <= BALANCED:
            raise CheckFailed(f"the energy ledger is open by {ledger:.2g}")

    for_all(subject, with_examples(subject, rows(push=True)), balanced)


def is_leap_frog(subject: Subject, case: Mapping[str, Any]) -> bool:
    """Return whether the integrator of a case is a leap-frog scheme."""
    return isinstance(subject.load(case).method.integrator.bind(1.0), LeapFrog)


# ------------------------------------------------------------------------------------------- exact solutions


def impact(draw: tuple[float, float, float, int]) -> dict[str, Any]:
    """Return two unlike touching bars, one of which strikes the other, until they have parted."""
    length, young, area, refine = draw
    bodies = {
        "a": {"bar": {"length": 1.0, "elements": 10}, "material": STEEL, "area": 1.0, "at": 0.0, "velocity": 0.2},
        "b": {
            "bar": {"length": length, "elements": round(10 * length)},
            "material": {"young": young, "density": 0.01},
            "area": area,
            "at": 1.0,
            "velocity": -0.1,
        },
    }
    transit = 2.0 * max(1.0 / 100.0, length / (young / 0.01) ** 0.5)
    return {
        "percuss": 1,
        "bodies": bodies,
        "contacts": {"ab": {"between": ["a.right", "b.left"]}},
        "refine": refine,
        "time": {"end": 1.3 * transit, "courant": 0.5},
        "record": {"probes": []},
    }


@check(*PAIRS, in_pairs=True)
def check_exact_impact(subject: Subject, partner: str) -> None:
    """Two unlike bars that strike each other exchange the exact impulse as the mesh is refined, with default options.

    A wrong sign, a force applied twice, a step that is ignored or a gap from a step ago tends to another answer.
    """
    from hypothesis import strategies as st

    def converges(one: dict[str, float]) -> None:
        errors = []
        for refine in (2, 8):
            drawn_bars = one["length of b"], one["young of b"], one["area of b"], refine
            case = subject.placed(impact(drawn_bars), subject.examples[0], partner)
            try:
                result = subject.run(case)
            except RunError as stopped:
                raise CheckFailed(f"the run was stopped: {stopped}") from None
            if result.summary["exact"] is None:
                raise NotApplicable(f"no exact solution: {result.summary['exact_reason']}")
            errors.append(result.summary["exact"]["contacts"]["ab"]["impulse_error"])
        if not (errors[1] <= max(NO_BETTER * errors[0], AS_GOOD_AS_EXACT) and errors[1] <= CLOSE):
            told = f"{errors[0]:.3g} of it with 20 elements in the first bar, {errors[1]:.3g} with 80"
            raise CheckFailed(f"the impulse does not tend to the exact one: it is off by {told}")

    bars = {
        "length of b": st.sampled_from([0.7, 1.0, 1.5]),
        "young of b": number(30, 100),
        "area of b": number(0.5, 2),
    }
    for_all(subject, st.fixed_dictionaries(bars), converges, max(3, subject.draws // 3))


# --------------------------------------------------------------------------------------------------- energy


@check(*PAIRS, in_pairs=True)
def check_energy_never_grows(subject: Subject, partner: str) -> None:
    """Energy less the work of loads never grows, whatever opens and closes, while the closed step is stable.

    With it goes what the contacts store, where that is known; where it is not, energy is never above that of the
    start, and never rises from one state with all contacts open to the next.
    """
    from hypothesis import strategies as st

    theirs = [dict(one) for one in subject.registry.components[_other(subject), partner].examples]
    pairs = list(itertools.product(subject.examples, theirs))

    def never(case: Mapping[str, Any], options: Mapping[str, Any], others: Mapping[str, Any]) -> None:
        mine = subject.placed(case, options, {"name": partner, **others})
        try:
            result = subject.run(mine)
        except InputError:
            return
        except RunError as stopped:
            if stopped.result.summary["certificate"]["stable"] != "yes":
                return
            raise CheckFailed(f"with options {dict(options)} the run was {stopped}") from None
        known = result.summary["certificate"]
        if known["stable"] not in {"yes", "unknown"} or (known["theta"] is not None and known["theta"] >= 1.0):
            return
        grown = growth(subject, mine, result)
        if grown > GROWS:
            raise CheckFailed(f"energy grew by {grown:.3g} of the largest, with options {dict(options)}")

    for options, others in pairs:
        for case in battery():
            never(case, options, others)
    strategy = st.tuples(rows(moving=True), st.sampled_from(pairs))
    for_all(subject, strategy, lambda one: never(one[0], *one[1]))


def _other(subject: Subject) -> str:
    return "contacts" if subject.family == "integrators" else "integrators"


def growth(subject: Subject, case: Mapping[str, Any], result: Any) -> float:
    """Return by how much the energy of a run grew, over the largest."""
    from percuss.solver.model import Model

    model = Model(subject.load(case))
    bounds = [entry["bound"] for entry in model.laws]
    if any(
        isinstance(row, LinearLaw) and np.any(row.rate) and row.sign == "free" and row.active == "all" for row in bounds
    ):
        raise NotApplicable("a tie is no contact: it takes up the gap rate of its ends as it begins, and says so")
    rigid = all(isinstance(row, LinearLaw) and row.sign == ">= 0" and not np.any(row.sigma) for row in bounds)
    whole = rigid or result.summary["energy_growth"]["quantity"] != "kinetic + elastic - work"
    if model.stages is None and whole:
        return float(result.summary["energy_growth"]["largest"])
    arrays = result.arrays
    energy = arrays["kinetic_energy"] + arrays["elastic_energy"] - arrays["external_work"]
    apart_now = (arrays["contact_force"] == 0.0).all(axis=1) & (arrays["gap"] >= 0.0).all(axis=1)
    opened = energy[apart_now]
    scale = max(float(np.abs(arrays[k]).max()) for k in ("kinetic_energy", "elastic_energy", "external_work"))
    rises = [float(energy.max()) - result.summary["energy"]["initial"]]
    rises += [float((opened - np.minimum.accumulate(opened)).max())] if opened.size else []
    return max(rises) / scale if scale else 0.0


def battery() -> Iterator[dict[str, Any]]:
    """Yield unlike bars that strike each other and walls many times, at several lengths of the step."""
    for courant in COURANTS:
        time = {"steps": int(240 / courant), "courant": courant}
        one = {"bar": {"length": 1.0, "elements": 7}, "material": STEEL, "area": 1.0, "at": 0.0, "velocity": 0.4}
        walls = {"left": {"body": "a.left", "wall": -0.01}, "right": {"body": "a.right", "wall": 1.01}}
        case: dict[str, Any] = {"percuss": 1, "bodies": {"a": one}, "contacts": walls, "time": time}
        yield {**case, "record": {"probes": []}}
        other = {
            "bar": {"length": 1.5, "elements": 9},
            "material": {"young": 49.0, "density": 0.05},
            "area": 1.3,
            "at": 1.0,
            "velocity": -0.3,
        }
        meet = {"ab": {"between": ["a.right", "b.left"]}, "wall": {"body": "b.right", "wall": 2.51}}
        yield {**case, "bodies": {"a": one, "b": other}, "contacts": meet, "record": {"probes": []}}
        # one element between two longer bars, struck from both sides
        first = {"bar": {"length": 1.32, "elements": 5}, "material": {"young": 45.4, "density": 0.07}, "area": 1.49}
        short = {"bar": {"length": 1.72, "elements": 1}, "material": {"young": 200.0, "density": 0.04}, "area": 1.0}
        third = {"bar": {"length": 1.32, "elements": 8}, "material": {"young": 22.33, "density": 0.06}, "area": 1.68}
        row = {
            "a": {**first, "at": 0.0, "velocity": 0.79},
            "b": {**short, "at": 1.32, "velocity": -0.93},
            "c": {**third, "at": 3.11, "velocity": -0.52},
        }
        meet = {
            "ab": {"between": ["a.right", "b.left"]},
            "bc": {"between": ["b.right", "c.left"]},
            "wall": {"body": "c.right", "wall": 4.47},
        }
        yield {**case, "bodies": row, "contacts": meet, "record": {"probes": []}}


# ----------------------------------------------------------------------------------------------- invariances


def _invariant(subject: Subject, change: Any, what: str, **given: Any) -> None:
    def same(one: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        case, options, partner = one
        try:
            other = change(case)
            base, changed = (subject.placed(c, options, partner) for c in (case, other))
            must_agree(subject, base, changed, what)
        except InputError as error:
            raise unlike(options, error) from None
        except RunError as stopped:
            raise NotApplicable(str(stopped)) from None

    for_all(subject, with_examples(subject, rows(**given)), same, max(4, subject.draws // 2))


@check(*PAIRS)
def check_translation(subject: Subject) -> None:
    """Nothing changes if everything is moved along x: only gaps and rates count, not where a contact is."""
    _invariant(subject, lambda case: draws.shifted(case, 2.5), "moving everything")


@check(*PAIRS)
def check_dimensions(subject: Subject) -> None:
    """Turned in two and in three dimensions a case gives the same forces, gaps and motions along the bars."""
    for direction in ((-1.0,), (3.0, -4.0), (1.0, 2.0, -2.0)):
        _invariant(subject, lambda case, to=direction: draws.turned(case, to), f"turning everything to {direction}")


@check(*PAIRS)
def check_mirror(subject: Subject) -> None:
    """Nothing changes in a mirror: a law has no left and right."""
    _invariant(subject, draws.mirrored, "looking at it in a mirror")


@check(*PAIRS)
def check_naming(subject: Subject) -> None:
    """Nothing changes with the order in which bodies, and the sides of a contact, are named."""
    _invariant(subject, draws.turned_round, "naming bodies and sides the other way round")


@check(*PAIRS)
def check_units(subject: Subject) -> None:
    """Nothing changes with the units of length, mass and time; options are converted by the units they state.

    A constant with a unit inside a method, or a wrong unit of an option, gives another answer in other units.
    """
    force, length = draws.factor("force"), draws.factor("length")
    factors = {"contact_force": force, "gap": length, "displacement": length}

    def same(one: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        case, options, partner = one
        other = subject.placed(draws.converted(case), draws.converted_options(subject, options), partner)
        try:
            must_agree(subject, subject.placed(case, options, partner), other, "a change of units", factors)
        except InputError as error:
            raise unlike(options, error) from None
        except RunError as stopped:
            raise NotApplicable(str(stopped)) from None

    for_all(subject, with_examples(subject, rows(push=True)), same)


@check(*PAIRS)
def check_refusals(subject: Subject) -> None:
    """A refusal of a partner is a reason in words, the same one every time; and not every partner is refused.

    A refused pair stands in tables with its reason, never as a gap.
    """
    from percuss.testing.subject import PARTNERS

    others = PARTNERS[subject.family]
    refused = []
    for name in subject.registry.names(others):
        cls = subject.registry.components[others, name]
        partner: Any = Subject.of(cls, subject.registry).make(dict(cls.examples[0]))
        reasons = [subject.make(subject.examples[0]).refuses(partner) for _ in range(2)]
        if reasons[0] != reasons[1]:
            raise CheckFailed(f"it refuses {name} once with {reasons[0]!r} and once with {reasons[1]!r}")
        if reasons[0] is not None and not (isinstance(reasons[0], str) and reasons[0].strip()):
            raise CheckFailed(f"it refuses {name} with {reasons[0]!r}, expected a reason in words or None")
        refused.append(reasons[0] is not None)
    if refused and all(refused):
        raise CheckFailed("it refuses every partner there is")


@check(*PAIRS)
def check_no_contact(subject: Subject) -> None:
    """Without contacts, and with bodies that never meet, everything moves as if there were no contact law at all.

    A force at a distance, or a loop that needs a contact, is found here.
    """

    def alone(one: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        case, options, partner = one
        apart_case = replaced(case, contacts={}, loads={})
        far = replaced(case, loads={})
        for place, body in enumerate(far["bodies"].values()):
            body["at"] += 10.0 * place
            body["velocity"] = abs(body["velocity"]) * (place + 1)
            apart_case["bodies"][list(far["bodies"])[place]] |= {"at": body["at"], "velocity": body["velocity"]}
        for contact in far["contacts"].values():
            if "wall" in contact:
                contact["wall"] += 10.0 * len(far["bodies"]) + 100.0
        try:
            free = subject.run(subject.placed(apart_case, options, partner))
            other = subject.run(subject.placed(far, options, partner))
        except InputError as error:
            raise unlike(options, error) from None
        except RunError as stopped:
            if not forbidden(stopped):
                raise CheckFailed(f"bodies that never meet: the run was {stopped}") from None
            raise NotApplicable(str(stopped)) from None
        if other.arrays["contact_force"].any():
            raise CheckFailed("bodies that never meet feel a contact force")
        moved = float(np.abs(free.arrays["displacement"] - other.arrays["displacement"]).max())
        if moved > draws.FLOOR * float(np.abs(free.arrays["displacement"]).max()):
            raise CheckFailed(f"bodies that never meet move otherwise by {moved:.2g}")

    for_all(subject, with_examples(subject, rows()), alone, max(4, subject.draws // 2))


@check(*PAIRS)
def check_certificate(subject: Subject) -> None:
    """The critical step that follows from rows and table is the one at which the march itself begins to grow.

    A pair whose rows say one thing and whose run does another would be certified wrongly.
    """
    from percuss.certificate.closed_contacts import closed_contacts
    from percuss.certificate.criteria import BlackBoxCriterion, PencilCriterion
    from percuss.solver.model import Model

    def same(one: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        case, options, partner = one
        try:
            model = Model(subject.load(subject.placed(case, options, partner)))
        except (InputError, RefusedPair) as why:
            raise NotApplicable(str(why)) from None
        said = closed_contacts(model, model.dt)
        if said.unknown:
            raise NotApplicable(f"the rows of {', '.join(said.unknown)} say nothing; the step itself is the judge")
        rows_say, step_says = PencilCriterion(model).critical(), BlackBoxCriterion(model).critical()
        if not abs(rows_say - step_says) <= 1e-3 * rows_say:
            raise CheckFailed(f"by the rows the critical step is {rows_say:.6g}, by the step itself {step_says:.6g}")

    for_all(subject, with_examples(subject, rows(bars=2, walls=False)), same, max(3, subject.draws // 4))
