"""Result of ``--exact-only``: the exact solution of a case, sampled, with its summary; it has no step and no method."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from percuss.results.datasets import definition_attributes, fields_dataset, histories_dataset
from percuss.results.netcdf import FORMAT, write

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from percuss.methods.interfaces import Exact


@dataclass(frozen=True, eq=False, repr=False)
class ExactSolutionResult:
    """Exact solution of a case, sampled at times of its own.

    Attributes
    ----------
    arrays
        Histories as plain arrays by name, on the axis ``time``; `histories` is the same as an xarray Dataset.
    coordinates
        Names along the axes ``contact`` and ``probe``.
    field_arrays
        ``time``, ``body``, ``position`` and ``stress`` of the stress field over time; empty if the case records none.
    summary
        Plain dict: status, contacts, energies, momentum, the solution and the time it reached.
    provenance
        Versions, case, name of the solution, places of the bodies, machine.
    solution
        The solution itself, for any place and any time; None if this result was read from a file.
    """

    arrays: dict[str, Any]
    coordinates: dict[str, list[str]]
    field_arrays: dict[str, Any]
    summary: dict[str, Any]
    provenance: dict[str, Any]
    solution: Exact | None = None

    @property
    def status(self) -> str:
        """``done``, or ``interrupted`` if the solution ends before the case does."""
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
    def end(self) -> float:
        """Time up to which the solution holds."""
        return float(self.summary["end"])

    @property
    def solution_name(self) -> str:
        """Name of the exact solution."""
        return str((self.summary["exact"] or self.summary["exact_covered"])["solution"])

    @cached_property
    def histories(self) -> xr.Dataset:
        """Histories on the axis ``time``."""
        attributes = {
            "format": FORMAT,
            "title": self.title,
            "status": self.status,
            "summary": json.dumps(self.summary),
            "provenance": json.dumps(self.provenance),
        }
        return histories_dataset(self.arrays, self.coordinates, definition_attributes("exact", self.units), attributes)

    @cached_property
    def fields(self) -> xr.Dataset:
        """Stress along the bodies over time, (time, element); empty unless the case sets `record.fields`."""
        return fields_dataset(self.field_arrays, self.units)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the exact solution as NetCDF-4 to a temporary file beside `path`, then rename it.

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
        from percuss.reporting.report import exact_html

        return exact_html(self)

    def __repr__(self) -> str:
        contacts = ", ".join(f"{k}: impulse {v['impulse']:.6g}" for k, v in self.summary["contacts"].items())
        return f"<exact solution of {self.title!r}: {self.status}, {contacts or 'no contact'}>"
