"""Observed orders of convergence, from runs of one case on finer and finer meshes."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.studies.comparison import ERRORS, Row, metrics

REFINED = "refine"
ROUND_OFF = 1e-12  # errors below are not those of a mesh


def orders(rows: list[Row]) -> list[dict[str, Any]]:
    """Return the observed order of each error for each method, fitted over the values of ``refine``.

    Parameters
    ----------
    rows
        Of a comparison that varies ``refine``.

    Returns
    -------
    list of dict
        ``integrator``, ``contact``, the other varied values, and for each error its order (None where fewer than two
        meshes have an error above round-off) and the errors themselves; empty where no method ran on two meshes.
    """
    out = []
    runs = _series(rows)
    for key, series in runs.items() if any(len(series) > 1 for series in runs.values()) else ():
        fitted: dict[str, Any] = {"integrator": key[0], "contact": key[1], **dict(key[2])}
        fitted["refine"] = [row.varied[REFINED] for row in series]
        for name in ERRORS:
            errors = [metrics(row).get(name) for row in series]
            fitted[name] = errors
            fitted[f"{name}_order"] = _order(fitted["refine"], errors)
        out.append(fitted)
    return out


def _series(rows: list[Row]) -> dict[Any, list[Row]]:
    """Return the runs of each method that differ by mesh alone, coarse to fine."""
    series: dict[Any, list[Row]] = {}
    for row in rows:
        if REFINED in row.varied and row.status == "done":
            others = tuple((path, value) for path, value in row.varied.items() if path != REFINED)
            series.setdefault((row.integrator, row.contact, others), []).append(row)
    return {key: sorted(group, key=lambda row: row.varied[REFINED]) for key, group in series.items()}


def _order(refine: list[float], errors: list[Any]) -> float | None:
    known = [(r, e) for r, e in zip(refine, errors, strict=True) if e is not None and e > ROUND_OFF]
    if len({r for r, _ in known}) < 2:
        return None
    slope = np.polyfit(np.log([r for r, _ in known]), np.log([e for _, e in known]), 1)[0]
    return float(-slope)
