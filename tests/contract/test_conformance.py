"""Every method that is registered passes the kit that anybody's methods pass: same checks, no exception made."""

import functools

import pytest

from percuss.methods.registry import Registry
from percuss.testing import checks
from percuss.testing.kit import demands, outcome_of

REGISTRY = Registry.load()
BY_METHOD = {
    (family, name): list(checks(cls, registry=REGISTRY)) for (family, name), cls in sorted(REGISTRY.components.items())
}
EVERY = {}
for (family, name), found in BY_METHOD.items():
    for what, check in found:
        # a check of a pair of law and integrator is the same from either side
        pair = tuple(sorted((name, check.partner))) if check.partner else (family, name)
        EVERY.setdefault((check.demand.name, *pair), (f"{family}/{name}-{what}", check))
EVERY = dict(EVERY.values())


@functools.cache
def outcome(label):
    return outcome_of(EVERY[label])


# Of the plug-ins of large families these are checked in every run, the others in the whole check.
QUICK = ("contacts/penalty", "elements/bar", "materials/elastic", "masses/lumped", "loads/gravity", "frictions/coulomb")
OF_MANY = ("contacts/", "integrators/", "elements/", "materials/", "masses/", "pairings/", "loads/", "frictions/")
# These checks take long: they compile the loop anew, or march in plain Python.
LASTING = ("no-hidden-state", "compiled-and-plain", "pushes-apart", "starts", "balances", "units", "options-bounded")
LASTING += ("runs-in-a-case", "blocks", "slides")


def is_deep(label):
    """Return whether a check is left to the whole check."""
    check = EVERY[label]
    subject = f"{check.subject.family}/{check.subject.name}"
    return bool(check.partner) or (
        subject.startswith(OF_MANY) and (subject not in QUICK or check.demand.name in LASTING)
    )


def marks_of(label):
    """Return when a check is made: schemes with other laws each night; tests/truth/test_energy has them by day."""
    check = EVERY[label]
    if check.subject.family == "integrators" and check.partner not in {"", "penalty", "bipenalty", "lagrange"}:
        return pytest.mark.nightly
    return pytest.mark.deep if is_deep(label) else ()


@pytest.mark.slow
@pytest.mark.parametrize("label", [pytest.param(one, marks=marks_of(one)) for one in EVERY])
def test_conformance(label):
    assert outcome(label).status != "failed", str(outcome(label))


def test_every_check_says_what_it_demands():
    assert 40 <= len(demands()) <= 50
    assert all(len(one.text.split()) >= 8 and one.text.endswith(".") for one in demands())


@pytest.mark.deep
def test_every_check_applies_to_something():
    """A check that applies to nothing that is registered checks nothing."""
    applies = {}
    for label in sorted(EVERY, key=is_deep):  # what is made anyway comes first
        name = EVERY[label].demand.name
        if not applies.get(name) and not label.startswith(("integrators/", "contacts/")):
            applies[name] = outcome(label).status != "skipped"
    assert not [name for name, does in applies.items() if not does]


def test_a_law_is_judged_with_each_state_that_it_may_see_and_an_integrator_with_each_kind_of_law():
    """Two states of leap-frog schemes and one of stages; laws that are linear, coupled, with state."""
    partners = {key: {check.partner for _, check in found if check.partner} for key, found in BY_METHOD.items()}
    of_law = partners["contacts", "penalty"]
    assert {"central-difference", "wu-predictor-corrector"} <= of_law
    assert len(of_law) == 3
    assert {"penalty", "bipenalty", "lagrange"} <= partners["integrators", "velocity-verlet"]
    judged = {pair for (family, name), others in partners.items() for pair in ((name, other) for other in others)}
    assert set(REGISTRY.names("contacts")) <= {one for one, _ in judged}
    assert set(REGISTRY.names("integrators")) <= {one for one, _ in judged}
