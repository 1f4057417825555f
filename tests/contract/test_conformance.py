"""Every method that is registered passes the kit that anybody's methods pass: same checks, no exception made."""

import functools

import pytest

from percuss.methods.registry import Registry
from percuss.testing.kit import checks_of, perform
from percuss.testing.subject import Subject, named

REGISTRY = Registry.load()
SUBJECTS = {f"{family}/{name}": Subject.of(cls, REGISTRY) for (family, name), cls in REGISTRY.components.items()}
# A check of a pair of law and integrator is the same from either side: it is made from that of the law.
EVERY = [
    (label, check, partner)
    for label, subject in SUBJECTS.items()
    for check, partner in checks_of(subject)
    if not (partner and label.startswith("integrators/"))
]


@functools.cache
def outcome(label, check, partner):
    return perform(check, SUBJECTS[label], partner)


# Of the plug-ins of large families these are checked in every run, the others in the whole check.
QUICK = (
    *("contacts/penalty", "integrators/wu-predictor-corrector"),
    *("elements/bar", "elements/quad4", "materials/elastic", "masses/lumped"),
    *("pairings/mortar", "pairings/node-to-segment"),
)
OF_MANY = ("contacts/", "integrators/", "elements/", "materials/", "masses/", "pairings/")
# These checks of a law or an integrator take long: they compile the loop anew, or march in plain Python.
LASTING = (
    *("no-hidden-state", "placement", "as-a-strict-host-has-it", "compiled-and-plain", "pushes-apart", "starts"),
    *("balances", "units"),
)


def is_deep(label, check, partner):
    """Return whether a check is left to the whole check."""
    return bool(partner) or (label.startswith(OF_MANY) and (label not in QUICK or check.name in LASTING))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("label", "check", "partner"),
    [
        pytest.param(
            label,
            check,
            partner,
            id=f"{label}-{named(check, partner)}",
            marks=pytest.mark.deep if is_deep(label, check, partner) else (),
        )
        for label, check, partner in EVERY
    ],
)
def test_conformance(label, check, partner):
    assert outcome(label, check, partner).good, str(outcome(label, check, partner))


def test_every_check_says_what_it_demands():
    demands = {check.name: check.demand for _, check, _ in EVERY}
    assert len(demands) >= 35
    assert all(len(text.split()) >= 8 and text.endswith(".") for text in demands.values())


@pytest.mark.deep
def test_every_check_applies_to_something():
    """A check that applies to nothing that is registered checks nothing."""
    applies = {}
    for label, check, partner in sorted(EVERY, key=lambda one: is_deep(*one)):  # what is made anyway comes first
        if not applies.get(check.name) and label.partition("/")[0] not in {"integrators", "contacts"}:
            applies[check.name] = outcome(label, check, partner).status != "not applicable"
    assert not [name for name, does in applies.items() if not does]


def test_every_pair_is_checked():
    """The integrators left out above as subjects stand among the partners of the laws."""
    pairs = {(label.partition("/")[2], partner) for label, _, partner in EVERY if partner}
    assert pairs == {(law, name) for law in REGISTRY.names("contacts") for name in REGISTRY.names("integrators")}
