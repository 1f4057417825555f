"""Stability maps: critical Courant numbers over varied parameters, judged in one way or in several side by side."""

from __future__ import annotations

import csv
import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.arguments import expect_names
from percuss.case.case import expect_case
from percuss.certificate.closed_contacts import closed_contacts
from percuss.certificate.closed_form import ClosedFormCriterion, NoClosedFormError
from percuss.certificate.criteria import BlackBoxCriterion, PencilCriterion, RunCriterion
from percuss.certificate.verdict import settled
from percuss.errors import InputError, PluginError, Problem, RefusedPair, suggestion
from percuss.files import replacing
from percuss.solver.model import Model

if TYPE_CHECKING:
    from percuss.case.case import Case

WAYS = ("closed-form", "pencil", "black-box")
STEP = ("time.courant", "time.step")


def stability(
    case: Case,
    vary: Mapping[str, Sequence[Any]] | None = None,
    curves: Mapping[str, Sequence[Any]] | None = None,
    by: Sequence[str] = (),
    *,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Return critical Courant numbers over every combination of varied values.

    Parameters
    ----------
    case
        A case from `percuss.load`.
    vary, curves
        Values of dotted paths; `curves` differ from `vary` in the picture only.
    by
        Ways to judge: ``closed-form`` (uniform bars taken as endless), ``pencil`` (the rows of the laws), ``black-box``
        (the amplification matrix of the step itself). By default the pencil where the laws are rows, else the black
        box.
    progress
        Called with (combinations done, in all).

    Returns
    -------
    list of dict
        For each combination and way the varied paths, ``courant_critical``, ``dt_critical``, ``by``, ``reason`` where
        there is no number, and where the step itself is varied ``margin`` (step over the critical one) and ``theta``.

    Raises
    ------
    InputError
        If a path, a value or a way is wrong.
    """
    expect_case("percuss.stability", case, many=True, vary=vary, curves=curves)
    _check(by, curves or {}, vary or {})
    axes = {**(curves or {}), **(vary or {})}
    combinations = list(itertools.product(*axes.values()))
    unknown = by or ("pencil",)
    rows: list[dict[str, Any]] = []
    wrong: list[InputError] = []
    for done, values in enumerate(combinations):
        varied = dict(zip(axes, values, strict=True))
        try:
            model = settled(case.with_overrides(varied) if varied else case)
        except InputError as error:
            wrong.append(error)
            rows += [_row(varied, way, None, str(error.problems[0].message)) for way in unknown]
        except (PluginError, RefusedPair) as error:
            rows += [_row(varied, way, None, str(error)) for way in unknown]
        else:
            unsaid = closed_contacts(model, model.dt).doubts
            rows += [_judged(model, varied, way, unsaid) for way in by or ("black-box" if unsaid else "pencil",)]
        if progress is not None:
            progress(done + 1, len(combinations))
    if len(wrong) == len(combinations):
        raise wrong[0]
    return rows


def _check(by: Sequence[str], curves: Mapping[str, Any], vary: Mapping[str, Any]) -> None:
    expect_names("percuss.stability", "by", by)
    problems = [
        Problem(f"--by {one}", "", f"unknown way '{one}'", suggestion(one, WAYS)) for one in by if one not in WAYS
    ]
    problems += [
        Problem(f"--curves {path}", "", "expected another path than those of --vary", "Give each path once.")
        for path in curves
        if path in vary
    ]
    if problems:
        raise InputError(problems)


def as_json(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return rows in the terms of JSON, which has no infinite numbers: those become the text ``inf``."""
    return [{k: "inf" if v in {np.inf, "inf"} else v for k, v in row.items()} for row in rows]


def save(rows: list[dict[str, Any]], path: str | os.PathLike[str]) -> None:
    """Write rows as a csv file; written beside and then renamed."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    with replacing(Path(path), ".csv") as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        writer.writerows(rows)


def _judged(model: Model, varied: Mapping[str, Any], way: str, unsaid: Sequence[str]) -> dict[str, Any]:
    """Return the row of one way to judge; `unsaid` is why the rows of some laws say nothing."""
    if model.why_not_linear:
        return _row(varied, way, None, f"{model.why_not_linear}, and its critical step changes with the strain")
    if way == "pencil" and unsaid:
        return _row(varied, way, None, f"nothing follows from the rows: {'; '.join(unsaid)}")
    try:
        kinds: dict[str, type[PencilCriterion | BlackBoxCriterion]] = {
            "pencil": PencilCriterion,
            "black-box": BlackBoxCriterion,
        }
        judge: Any = RunCriterion(model, kinds[way]) if way in kinds else ClosedFormCriterion(model)
        critical = judge.critical()
    except (NoClosedFormError, PluginError) as error:
        return _row(varied, way, None, str(error))
    doubt = ""
    if way == "black-box":
        found = judge.judge(critical if critical > 0 else model.dt)
        doubt = found.doubt
        if not (found.known or found.stable) or np.isnan(critical):
            return _row(varied, way, None, doubt or "the closed step is not linear")
    row = _row(varied, way, critical, doubt if critical > 0 else "no step is stable", model)
    if set(STEP) & set(varied):
        row["margin"] = model.dt / critical if critical > 0 else np.inf
        row["theta"] = None if way == "closed-form" else judge.judge(model.dt).theta
    return row


def _row(varied: Mapping[str, Any], way: str, critical: float | None, reason: str, model: Any = None) -> dict[str, Any]:
    courant = 0.5 * critical * model.omega if critical is not None else None
    return {**varied, "courant_critical": courant, "dt_critical": critical, "by": way, "reason": reason}
