"""The conformance kit, which checks that a method meets the demands of its contract.

With pytest each check is a test::

    @parametrize(MyLaw)
    def test_conformance(check):
        check()

Without it, `percuss verify` makes the checks of a file, and `checks` gives them to a program.
"""

from __future__ import annotations

from percuss.testing.kit import Check, checks, parametrize
from percuss.testing.subject import CheckFailed, DeclaredFailure, Demand, NotApplicable, Subject

__all__ = ["Check", "CheckFailed", "DeclaredFailure", "Demand", "NotApplicable", "Subject", "checks", "parametrize"]
