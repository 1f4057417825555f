"""Result of a case, of a run or of an exact solution: histories, fields, summary and provenance."""

from __future__ import annotations

import json
import os
from functools import cached_property
from typing import TYPE_CHECKING, Any

from percuss.results.datasets import Source, definition_attributes, fields_dataset, histories_dataset
from percuss.results.netcdf import FORMAT, write

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from percuss.methods.interfaces import Exact


class CaseResult:
    """Result of a case, saved to NetCDF-4 and drawn.

    Attributes
    ----------
    arrays
        Histories as plain arrays by name; `histories` is the same as an xarray Dataset.
    coordinates
        Names along the axes ``contact`` and ``probe``.
    field_arrays
        ``time``, ``body``, ``position`` and ``stress`` of the stress field over time; empty if the case records none.
    summary
        Plain dict of the entries by which results are compared.
    provenance
        All that the result can be made again with: the case with its data files, versions, settings, machine, digests
        of percuss and of each plug-in.
    solution
        The exact solution, for any place and any time; None if there is none, or if this result was read from a file.
    """

    def __init__(
        self,
        arrays: dict[str, Any],
        coordinates: dict[str, list[str]],
        field_arrays: dict[str, Any],
        summary: Any,
        provenance: dict[str, Any],
        solution: Exact | None = None,
    ) -> None:
        self.arrays = arrays
        self.coordinates = coordinates
        self.field_arrays = field_arrays
        self.summary = summary
        self.provenance = provenance
        self.solution = solution

    @property
    def status(self) -> str:
        """``done``, ``interrupted`` or ``unstable``; an exact solution that ends before its case is interrupted."""
        return str(self.summary["status"])

    @property
    def title(self) -> str:
        """Title of the case."""
        return str(self.provenance["case"].get("title", ""))

    @property
    def units(self) -> dict[str, str]:
        """Names of the units by kind, as ``{"length": "m"}``, that the case gives."""
        return dict(self.provenance["case"].get("units") or {})

    def _source(self) -> Source:
        """Return the kind of source of the histories, on which their definitions depend."""
        raise NotImplementedError

    @cached_property
    def histories(self) -> xr.Dataset:
        """Histories on the axis ``time``; energies of a run carry the coordinate ``time_half(time)``."""
        attributes = {
            "format": FORMAT,
            "title": self.title,
            "status": self.status,
            "summary": json.dumps(self.summary),
            "provenance": json.dumps(self.provenance),
        }
        definitions = definition_attributes(self._source(), self.units)
        return histories_dataset(self.arrays, self.coordinates, definitions, attributes)

    @cached_property
    def fields(self) -> xr.Dataset:
        """Stress along the bodies over time, (time, element); empty unless the case sets `record.fields`."""
        return fields_dataset(self.field_arrays, self.units)

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
        steps = f", {self.summary['steps']} steps" if self.summary.get("steps") is not None else ""
        return f"<percuss.{type(self).__name__} {self.title!r}: {self.status}{steps}, {contacts or 'no contact'}>"
