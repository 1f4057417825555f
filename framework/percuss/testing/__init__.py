"""The conformance kit, which checks that a method meets the demands of its contract.

One line runs all checks, with pytest or without it::

    test_conformance = conformance_test(MyLaw)
    print(conformance(MyLaw))

`StrictSystem` is a minimal reference implementation in plain NumPy that gives a method the quantities promised by the
contract and nothing else.
"""

from __future__ import annotations

from percuss.testing.kit import checks_of, conformance, conformance_test
from percuss.testing.report import Outcome, Report
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
