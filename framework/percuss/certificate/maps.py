"""Stability maps: critical Courant numbers over varied parameters, by one stability criterion or several."""

from __future__ import annotations

import csv
import itertools
import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.blas import one_blas_thread
from percuss.case.arguments import expect_names
from percuss.case.case import expect_case
from percuss.case.overrides import as_given_by
from percuss.certificate.black_box import BlackBox
from percuss.certificate.criteria import Criterion, RunCriterion
from percuss.certificate.flutter import flutter_of
from percuss.certificate.linear_laws import doubts_of, linear_laws
from percuss.certificate.verdict import settled
from percuss.contact.model import Model
from percuss.errors import InputError, PluginError, Problem, RefusedPair, refuse_if_any, suggestion
from percuss.files import replacing
from percuss.jsonable import Data, Entries

if TYPE_CHECKING:
    from percuss.case.case import Case

CRITERIA: dict[str, Callable[[Model], Criterion]] = {"linear-laws": linear_laws, "black-box": BlackBox}
MOST_COMBINATIONS = 1_000_000
STEP = ("time.courant", "time.step")


@one_blas_thread()
@np.errstate(all="ignore")  # numbers that are not finite are refused or make a step unstable
def stability(
    case: Case,
    vary: Mapping[str, Sequence[object]] | None = None,
    curves: Mapping[str, Sequence[object]] | None = None,
    by: Sequence[str] = (),
    *,
    before: Callable[[Model, int], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Entries]:
    """Return critical Courant numbers over every combination of varied values.

    Parameters
    ----------
    case
        A case from `percuss.load`.
    vary, curves
        Values for each dotted path; `curves` differ from `vary` in the figure only.
    by
        Criteria: ``linear-laws`` (from the coefficients of the laws) and ``black-box`` (from the measured amplification
        matrix). By default the linear laws where they cover all contacts, else the black box.
    before
        Function that is called with the first model and the number of combinations, before the first search.
    progress
        Function that is called with the number of combinations done and the number of all combinations.

    Returns
    -------
    list of dict
        For each combination and criterion the varied paths, ``courant_critical``, ``dt_critical``, ``by``, ``reason``
        where there is no number or a doubt about it, where the step is varied ``margin`` (step over the critical
        step) and ``theta``, and with friction ``flutter``, the growth rate while all points slide.

    Raises
    ------
    InputError
        If a path, a value or a criterion is wrong.
    """
    expect_case("percuss.stability", case, many=True, vary=vary, curves=curves)
    _check_arguments(by, curves or {}, vary or {})
    axes = {path: list(values) for path, values in {**(curves or {}), **(vary or {})}.items()}
    if (count := math.prod(map(len, axes.values()))) > MOST_COMBINATIONS:
        message = f"expected at most {MOST_COMBINATIONS} combinations of values, found {count}"
        raise InputError([Problem("--vary", "", message, "Take fewer values.")])
    ways = by or ("linear-laws",)
    rows: list[Entries] = []
    errors: list[InputError] = []
    for done, values in enumerate(itertools.product(*axes.values()), 1):
        varied = dict(zip(axes, values, strict=True))
        try:
            model = settled(case.with_overrides(varied) if varied else case).model
        except InputError as error:
            errors.append(error)
            rows += [_row(varied, way, None, str(error.problems[0].message)) for way in ways]
        except (PluginError, RefusedPair) as error:
            reason = error.sentence if isinstance(error, RefusedPair) else str(error)
            rows += [_row(varied, way, None, reason) for way in ways]
        else:
            if before is not None:
                before(model, count)
                before = None
            doubts = doubts_of(model)
            ways_here = by or ("black-box" if doubts else "linear-laws",)
            found = [_critical_row(model, varied, way, doubts) for way in ways_here]
            if (flutter := flutter_of(model)) is not None:
                unknown = flutter.told if flutter.rate is None else ""
                found = [row | {"flutter": flutter.rate, "reason": unknown or row["reason"]} for row in found]
            rows += found
        if progress is not None:
            progress(done, count)
    if len(errors) == count:
        options = (("--vary", vary or {}), ("--curves", curves or {}))
        raise as_given_by({path: f"{option} {path}=" for option, paths in options for path in paths}, errors[0])
    return rows


def _check_arguments(by: Sequence[str], curves: Data, vary: Data) -> None:
    expect_names("percuss.stability", "by", by)
    problems = [
        Problem(f"--by {way}", "", f"unknown way '{way}'", suggestion(way, CRITERIA))
        for way in by
        if way not in CRITERIA
    ]
    problems += [
        Problem(f"--curves {path}", "", "expected another path than those of --vary", "Give each path once.")
        for path in curves
        if path in vary
    ]
    refuse_if_any(problems)


def save(rows: list[Entries], path: str | os.PathLike[str]) -> None:
    """Write rows as a CSV file, through a temporary file that is renamed, so that no half-written file remains."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with replacing(Path(path), ".csv") as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)


def _critical_row(model: Model, varied: Data, way: str, doubts: Sequence[str]) -> Entries:
    """Return the row of one criterion; `doubts` are the reasons why the linear laws do not tell of some contacts."""
    if why := _why_unknown(model, way, doubts):
        return _row(varied, way, None, why)
    try:
        criterion = RunCriterion(model, CRITERIA[way])
        critical = criterion.critical_step
    except PluginError as error:
        return _row(varied, way, None, str(error))
    doubt = ""
    if way == "black-box":
        assessment = criterion.assess_step(critical if critical > 0 else model.dt)
        doubt = assessment.doubt
        if assessment.answer == "unknown" or np.isnan(critical):
            return _row(varied, way, None, doubt or "the closed step is not linear")
    row = _row(varied, way, critical, doubt if critical > 0 else "no step is stable", model)
    if set(STEP) & set(varied):
        row["margin"] = model.dt / critical if critical > 0 else np.inf
        row["theta"] = criterion.assess_step(model.dt).theta
    return row


def _why_unknown(model: Model, way: str, doubts: Sequence[str]) -> str:
    """Return why a criterion gives no number for a model, whatever its step; empty if it gives one."""
    if model.bodies.why_not_linear:
        return f"{model.bodies.why_not_linear}, and its critical step changes with the strain"
    if why := model.why("certificate"):
        return f"{why}, which changes the critical step"
    if model.why("critical step"):
        return model.why("critical step")
    if way == "linear-laws" and doubts:
        return f"the linear laws do not cover this: {'; '.join(doubts)}"
    why = model.why("black box")
    return "; ".join((why, *doubts)) if way == "black-box" and why else ""


def _row(varied: Data, way: str, critical: float | None, reason: str, model: Any = None) -> Entries:
    courant = 0.5 * critical * model.bodies.omega if critical is not None else None
    return {**varied, "courant_critical": courant, "dt_critical": critical, "by": way, "reason": reason}
