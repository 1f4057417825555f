"""Result of a run: histories, fields, summary and provenance, saved to and opened from NetCDF-4."""

from __future__ import annotations

import json
import os
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from percuss.results.datasets import definition_attributes, fields_dataset, histories_dataset, plain_arrays
from percuss.results.exact_result import ExactSolutionResult
from percuss.results.netcdf import FORMAT, read, write

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from percuss.methods.interfaces import Exact
    from percuss.results.summary import Summary


class Result:
    """Result of a run.

    Attributes
    ----------
    arrays
        Histories as plain arrays by name; `histories` is the same as an xarray Dataset.
    field_arrays
        ``time``, ``body``, ``position`` and ``stress`` of the stress field over time; empty if the case records none.
    summary
        Plain dict of the entries by which runs are compared.
    provenance
        All that the run can be made again with: the case with its data files, versions, settings, machine, digests of
        percuss and of each plug-in; besides, the resolved parameters.
    coordinates
        Names along the axes ``contact`` and ``probe``.
    """

    def __init__(
        self,
        arrays: dict[str, Any],
        coordinates: dict[str, list[str]],
        field_arrays: dict[str, Any],
        summary: Summary,
        provenance: dict[str, Any],
    ) -> None:
        self.arrays = arrays
        self.coordinates = coordinates
        self.field_arrays = field_arrays
        self.summary = summary
        self.provenance = provenance
        self.solution: Exact | None = None

    @property
    def status(self) -> str:
        """``done``, ``interrupted`` or ``unstable``."""
        return str(self.summary["status"])

    @property
    def title(self) -> str:
        """Title of the case."""
        return str(self.provenance["case"].get("title", ""))

    @property
    def units(self) -> dict[str, str]:
        """Names of the units by kind, as ``{"length": "m"}``, that the case gives."""
        return dict(self.provenance["case"].get("units") or {})

    @property
    def exact(self) -> Exact | None:
        """The exact solution of the case, for any position and any time up to its `reached`; None if there is none.

        For a result read from a file it is computed again from the case in the provenance.
        """
        errors, partial_errors = self.summary["exact"], self.summary.get("exact_covered")
        until = errors["reached"] if errors else partial_errors["until"] if partial_errors else None
        if self.solution is None and until is not None:
            from percuss.results.case_inside import case_inside
            from percuss.results.exact import exact_solution
            from percuss.solver.model import Model

            self.solution = exact_solution(Model(case_inside(self.provenance)), until)[0]
        return self.solution

    @property
    def exact_histories(self) -> dict[str, tuple[Any, Any]] | None:
        """Times and exact forces of each contact, as figures plot them over those of the run, or None."""
        if "contact_force_exact" not in self.arrays:
            return None
        forces = self.arrays["contact_force_exact"]
        return {name: (self.arrays["time"], forces[:, k]) for k, name in enumerate(self.coordinates["contact"])}

    def _scheme(self) -> Literal["leap-frog", "multistage", "implicit"]:
        """Return the kind of scheme, which shows in the time of its energies: t_{n+1/2}, t_{n+1} or t_n."""
        if not self.arrays["time_half"].size:
            return "leap-frog"
        after = float(self.arrays["time_half"][0] - self.arrays["time"][0]) / self.summary["dt"]
        return "multistage" if after > 0.75 else "leap-frog" if after > 0.25 else "implicit"

    @cached_property
    def histories(self) -> xr.Dataset:
        """Histories on the axis ``time``; energies carry the coordinate ``time_half(time)``."""
        # Other schemes have their energies, or the force of a step, at other times than a leap-frog scheme.
        attributes = definition_attributes(self._scheme(), self.units)
        return histories_dataset(self.arrays, self.coordinates, attributes, self._attributes())

    @cached_property
    def fields(self) -> xr.Dataset:
        """Stress along the bodies over time, (time, element); empty unless the case sets `record.fields`."""
        return fields_dataset(self.field_arrays, self.units)

    def _attributes(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "title": self.title,
            "status": self.status,
            "summary": json.dumps(self.summary),
            "provenance": json.dumps(self.provenance),
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the result as NetCDF-4 to a temporary file beside `path`, then rename it.

        Raises
        ------
        InputError
            If the folder does not exist or cannot be written.
        """
        write(path, self.histories, self.fields if self.field_arrays else None)

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Return the figure of ``percuss run --plot``: contact forces, energies, and stress where the case records it.

        Parameters
        ----------
        path
            File ending in .png, .svg or .pdf to which the figure is written; by default none is.

        Raises
        ------
        PercussError
            If matplotlib is not installed.
        """
        from percuss.reporting.report import plotted

        return plotted(self, path)

    def _repr_html_(self) -> str:
        """Return a small table and the force figure as HTML for a notebook."""
        from percuss.reporting.report import notebook_html

        return notebook_html(self)

    def __repr__(self) -> str:
        contacts = ", ".join(f"{k}: impulse {v['impulse']:.6g}" for k, v in self.summary["contacts"].items())
        steps = self.summary["steps"]
        return f"<percuss.Result {self.title!r}: {self.status}, {steps} steps, {contacts or 'no contact'}>"


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
