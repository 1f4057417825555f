"""Result of a case: histories, fields, summary and provenance, saved as a NetCDF-4 file and opened again."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from percuss.errors import PercussError
from percuss.jsonable import Entries
from percuss.methods.interfaces import Exact, Floats
from percuss.results import netcdf
from percuss.results.summary import Summary

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


@dataclass(repr=False, eq=False)
class Result:
    """Result of a case, saved to NetCDF-4 and drawn: of a run, or of its exact solution alone, for which none marched.

    The exact solution alone has forces, gaps, motion and stresses, and the entries of the summary about them.

    Attributes
    ----------
    arrays
        Histories as plain arrays by name; `histories` is the same as an xarray Dataset.
    coordinates
        Names along the axes ``contact`` and ``probe``, and ``support`` where there are any; of surfaces whose laws have
        state variables the contact of each ``point`` too, as the state belongs to the points.
    field_arrays
        Fields over time; empty if the case records none. Of bars ``time``, and ``body``, ``position`` and ``stress`` of
        elements. Of other bodies ``stress`` has the components xx, yy and xy, and there are ``von_mises``,
        ``cell_nodes`` and, of bodies of finite strain, ``volume_ratio`` and ``plastic_strain`` of elements,
        ``node_body``, ``node_position``, ``displacement`` and ``velocity`` of nodes, and ``point_contact``,
        ``point_area``, ``point_normal``, ``point_position`` and ``contact_pressure`` of contact points.
    summary
        Plain dict of the entries by which results are compared.
    provenance
        All that the result can be made again with: the case with its data files, versions, settings, machine, digests
        of percuss and of each plug-in.
    solution
        The exact solution, for any place and any time; None if there is none, or if this result was read from a file.
    """

    arrays: dict[str, Floats]
    coordinates: dict[str, list[str]]
    field_arrays: Entries
    summary: Summary
    provenance: Entries
    solution: Exact | None = None

    def __getstate__(self) -> Entries:
        """Return what is copied or sent to another process: all but the exact solution, which may be of a plug-in.

        As for a result read from a file, `exact` is computed again.
        """
        return {**vars(self), "solution": None}

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

    @property
    def marched(self) -> bool:
        """Whether it is the result of a run, not of the exact solution alone, which makes no steps."""
        return self.summary.get("steps") is not None

    @property
    def end(self) -> float:
        """Time at which the run ended or stopped, or up to which the exact solution holds."""
        return float(self.summary["end"])

    @property
    def solution_name(self) -> str:
        """Name of the exact solution; empty if there is none."""
        errors = self.summary["exact"] or self.summary["exact_covered"]
        return errors["solution"] if errors else ""

    @property
    def exact(self) -> Exact | None:
        """The exact solution of the case, for any position and any time up to its `reached`; None if there is none.

        For a result read from a file it is computed again from the case in the provenance.
        """
        errors, partial_errors = self.summary["exact"], self.summary.get("exact_covered")
        until = errors["reached"] if errors else partial_errors["until"] if partial_errors else None
        if self.solution is None and until is not None:
            from percuss.march.model_of_case import model_of
            from percuss.results.exact import exact_solution
            from percuss.results.provenance import case_inside

            self.solution = exact_solution(model_of(case_inside(self.provenance)), until)[0]
        return self.solution

    @property
    def exact_histories(self) -> dict[str, tuple[Floats, Floats]] | None:
        """Times and exact forces of each contact, as figures plot them over those of the run, or None."""
        return self._histories_of("contact_force_exact")

    @property
    def finer_histories(self) -> dict[str, tuple[Floats, Floats]] | None:
        """Times and forces of each contact in the finer run by which the errors are estimated, or None."""
        return self._histories_of("contact_force_finer")

    def _histories_of(self, quantity: str) -> dict[str, tuple[Floats, Floats]] | None:
        if quantity not in self.arrays:
            return None
        forces = self.arrays[quantity]
        return {name: (self.arrays["time"], forces[:, k]) for k, name in enumerate(self.coordinates["contact"])}

    def _source(self) -> netcdf.Source:
        """Return the kind of source of the histories, on which their definitions depend.

        That of a run shows in the time of its energies: t_{n+1/2} or t_{n+1}.
        """
        if not self.marched:
            return "exact"
        if not self.arrays["time_half"].size:
            return "leap-frog"
        after = float(self.arrays["time_half"][0] - self.arrays["time"][0]) / self.summary["dt"]
        return "multistage" if after > 0.75 else "leap-frog"

    @cached_property
    def histories(self) -> xr.Dataset:
        """Histories on the axis ``time``; energies of a run carry the coordinate ``time_half(time)``."""
        return self._labelled_histories().dataset()

    def _labelled_histories(self) -> netcdf.Labelled:
        attributes = {
            "format": netcdf.FORMAT,
            "title": self.title,
            "status": self.status,
            "summary": json.dumps(self.summary),
            "provenance": json.dumps(self.provenance),
        }
        return netcdf.labelled_histories(self.arrays, self.coordinates, self._source(), self.units, attributes)

    @cached_property
    def fields(self) -> xr.Dataset:
        """Fields over time, as `field_arrays` has them; empty unless the case sets `record.fields`."""
        return netcdf.labelled_fields(self.field_arrays, self._source(), self.units).dataset()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the result as NetCDF-4, or its fields as VTKHDF, to a temporary file beside `path`, then rename it.

        Parameters
        ----------
        path
            Path of the file; one that ends in ``.vtkhdf`` gets the fields of bodies in two or three dimensions alone.

        Raises
        ------
        InputError
            If the folder does not exist or cannot be written, or there are no fields for a VTKHDF file.
        """
        if Path(path).suffix.lower() == netcdf.VTKHDF:
            netcdf.write_vtkhdf(path, self.field_arrays)
            return
        fields = netcdf.labelled_fields(self.field_arrays, self._source(), self.units) if self.field_arrays else None
        netcdf.write(path, self._labelled_histories(), fields)

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
        from percuss.reporting.run_figure import plotted

        return plotted(self, path)

    def _repr_png_(self) -> bytes | None:
        """Return the figure for a notebook, or None if matplotlib is not installed."""
        try:
            return self.plot()._repr_png_()  # type: ignore[attr-defined, no-any-return]
        except PercussError:
            return None

    def __repr__(self) -> str:
        contacts = ", ".join(f"{k}: impulse {v['impulse']:.6g}" for k, v in self.summary["contacts"].items())
        steps = f"{self.summary['steps']} steps" if self.marched else "exact solution"
        return f"<percuss.Result {self.title!r}: {self.status}, {steps}, {contacts or 'no contact'}>"


def open_result(path: str | os.PathLike[str]) -> Result:
    """Return a result that its method `save` wrote.

    Raises
    ------
    InputError
        If there is no such file, it is not a percuss result, or a checksum of its numbers does not fit.
    """
    return Result(*netcdf.read(path))
