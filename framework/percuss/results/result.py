"""Result of a run, and the opening of results in NetCDF-4 files."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

from percuss.results.case_result import CaseResult
from percuss.results.datasets import Source, plain_arrays
from percuss.results.exact_result import ExactSolutionResult
from percuss.results.netcdf import read

if TYPE_CHECKING:
    from percuss.methods.interfaces import Exact
    from percuss.results.summary import Summary


class Result(CaseResult):
    """Result of a run."""

    summary: Summary

    @property
    def exact(self) -> Exact | None:
        """The exact solution of the case, for any position and any time up to its `reached`; None if there is none.

        For a result read from a file it is computed again from the case in the provenance.
        """
        errors, partial_errors = self.summary["exact"], self.summary.get("exact_covered")
        until = errors["reached"] if errors else partial_errors["until"] if partial_errors else None
        if self.solution is None and until is not None:
            from percuss.march.model import Model
            from percuss.results.case_inside import case_inside
            from percuss.results.exact import exact_solution

            self.solution = exact_solution(Model(case_inside(self.provenance)), until)[0]
        return self.solution

    @property
    def exact_histories(self) -> dict[str, tuple[Any, Any]] | None:
        """Times and exact forces of each contact, as figures plot them over those of the run, or None."""
        if "contact_force_exact" not in self.arrays:
            return None
        forces = self.arrays["contact_force_exact"]
        return {name: (self.arrays["time"], forces[:, k]) for k, name in enumerate(self.coordinates["contact"])}

    def _source(self) -> Source:
        """Return the kind of scheme, which shows in the time of its energies: t_{n+1/2}, t_{n+1} or t_n."""
        if not self.arrays["time_half"].size:
            return "leap-frog"
        after = float(self.arrays["time_half"][0] - self.arrays["time"][0]) / self.summary["dt"]
        return "multistage" if after > 0.75 else "leap-frog" if after > 0.25 else "implicit"


def open_result(path: str | os.PathLike[str]) -> Result | ExactSolutionResult:
    """Return a result that its method `save` wrote: that of a run, or of ``percuss run --exact-only``.

    Raises
    ------
    InputError
        If there is no such file, it is not a percuss result, or it is damaged: a checksum covers every byte.
    """
    histories, fields = read(path)
    summary, provenance = (json.loads(histories.attrs[name]) for name in ("summary", "provenance"))
    kind = Result if summary.get("steps") is not None else ExactSolutionResult  # an exact solution makes no steps
    return kind(*plain_arrays(histories, fields), summary, provenance)
