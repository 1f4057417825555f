"""Observed orders of convergence, from runs of one case on successively finer meshes."""

from __future__ import annotations

from typing import Any

import numpy as np

from percuss.case.quantities import TRUE_ERRORS
from percuss.studies.comparison import metrics
from percuss.studies.perform import Run

REFINED = "refine"
ROUND_OFF = 1e-12  # smaller errors are not discretisation errors


def orders(runs: list[Run]) -> list[dict[str, Any]]:
    """Return the observed order of each error for each method, fitted over the values of ``refine``.

    Parameters
    ----------
    runs
        Runs of a comparison that varies ``refine``.

    Returns
    -------
    list of dict
        ``integrator``, ``contact``, the other varied values, and for each error its order (None where fewer than two
        meshes have an error above round-off) and the errors themselves; empty if no method ran on two meshes.
    """
    orders_by_method = []
    runs_by_method = _runs_by_method(runs)
    for key, series in runs_by_method.items() if any(len(series) > 1 for series in runs_by_method.values()) else ():
        fitted: dict[str, Any] = {"integrator": key[0], "contact": key[1], **dict(key[2])}
        fitted["refine"] = [run.varied[REFINED] for run in series]
        for name in TRUE_ERRORS:
            errors = [metrics(run).get(name) for run in series]
            fitted[name] = errors
            fitted[f"{name}_order"] = _order(fitted["refine"], errors)
        orders_by_method.append(fitted)
    return orders_by_method


def _runs_by_method(runs: list[Run]) -> dict[Any, list[Run]]:
    """Return the runs of each method that differ by mesh alone, from coarse to fine."""
    series: dict[Any, list[Run]] = {}
    for run in runs:
        if REFINED in run.varied and run.status == "done":
            others = tuple((path, value) for path, value in run.varied.items() if path != REFINED)
            series.setdefault((run.integrator, run.contact, others), []).append(run)
    return {key: sorted(group, key=lambda run: run.varied[REFINED]) for key, group in series.items()}


def _order(refine: list[float], errors: list[Any]) -> float | None:
    points = [
        (factor, error) for factor, error in zip(refine, errors, strict=True) if error is not None and error > ROUND_OFF
    ]
    if len({factor for factor, _ in points}) < 2:
        return None
    slope = np.polyfit(np.log([factor for factor, _ in points]), np.log([error for _, error in points]), 1)[0]
    return float(-slope)
