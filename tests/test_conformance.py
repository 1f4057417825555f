"""Every method that is registered passes the kit that anybody's methods pass: same checks, no exception made."""

import pytest

from percuss.methods.registry import Registry
from percuss.testing.kit import checks_of, perform
from percuss.testing.subject import Subject, named

REGISTRY = Registry.load()
SUBJECTS = {f"{family}/{name}": Subject.of(cls, REGISTRY) for (family, name), cls in REGISTRY.components.items()}
EVERY = [(label, one, partner) for label, subject in SUBJECTS.items() for one, partner in checks_of(subject)]


@pytest.mark.parametrize(("label", "one", "partner"), EVERY, ids=[f"{label}-{named(*rest)}" for label, *rest in EVERY])
def test_conformance(label, one, partner):
    outcome = perform(one, SUBJECTS[label], partner)
    assert outcome.good, str(outcome)


def test_every_check_says_what_it_demands():
    demands = {one.name: one.demand for _, one, _ in EVERY}
    assert len(demands) >= 35
    assert all(len(text.split()) >= 8 and text.endswith(".") for text in demands.values())


def test_every_check_applies_to_something():
    """A check that applies to nothing that is registered checks nothing."""
    seen = {}
    for label, one, partner in EVERY:
        if seen.get(one.name) != "applies" and label.partition("/")[0] not in {"integrators", "contacts"}:
            status = perform(one, SUBJECTS[label], partner).status
            seen[one.name] = "applies" if status != "not applicable" else status
    assert not [name for name, status in seen.items() if status == "not applicable"]
