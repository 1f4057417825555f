"""The conformance kit: whether a method does what the contract demands of it.

One line runs all of it, with pytest or without::

    test_conformance = conformance_test(MyLaw)
    print(conformance(MyLaw))

`StrictSystem` is a minimal host in plain NumPy that gives a method what the contract promises, and nothing else.
"""

from __future__ import annotations

from percuss.testing.kit import Outcome, Report, checks_of, conformance, conformance_test
from percuss.testing.strict import StrictSystem
from percuss.testing.subject import Check, CheckFailed, NotApplicable, Subject

__all__ = [
    "Check",
    "CheckFailed",
    "NotApplicable",
    "Outcome",
    "Report",
    "StrictSystem",
    "Subject",
    "checks_of",
    "conformance",
    "conformance_test",
]
