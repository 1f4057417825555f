"""Result of ``--exact-only``: the exact solution of a case, sampled, with its summary; it has no step and no method."""

from __future__ import annotations

from percuss.results.case_result import CaseResult
from percuss.results.datasets import Source


class ExactSolutionResult(CaseResult):
    """Exact solution of a case, sampled at times of its own.

    Its histories are on the axis ``time``. Its summary has the status, contacts, energies, momentum, the solution and
    the time that it reached.
    """

    @property
    def end(self) -> float:
        """Time up to which the solution holds."""
        return float(self.summary["end"])

    @property
    def solution_name(self) -> str:
        """Name of the exact solution."""
        return str((self.summary["exact"] or self.summary["exact_covered"])["solution"])

    def _source(self) -> Source:
        return "exact"
