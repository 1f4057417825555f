"""Roles of the columns of a study's table: varied values, measures with their labels, costs, true errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.quantities import QUANTITIES, of_column
from percuss.reporting.study_data.values import methods, numbers, texts
from percuss.studies.tasks import TIED

if TYPE_CHECKING:
    import pandas as pd

    from percuss.studies.study_table import Study

# Labels of the measures, in their order on the page: the comparisons with the exact solution come first.
MEASURES = {
    **{name: quantity.label for name, quantity in QUANTITIES.items() if quantity.against_exact},
    **{name: quantity.label for name, quantity in QUANTITIES.items() if quantity.path or quantity.metric},
    **dict.fromkeys(("seconds.march", "seconds"), "seconds of the march alone"),
}

# Measures of the cost of a run; the first does not depend on the machine.
COSTS = ("node_steps", "seconds", "seconds.march", "steps")

ABOUT = ("case", "integrator", "contact", "status", "reason", "said_by", "fragile", "key")


@dataclass(frozen=True)
class ColumnRoles:
    """The roles of the columns of a study's table.

    Attributes
    ----------
    varied
        Paths of the varied values.
    measures
        Names of the measured columns with their labels; columns without any number are left out.
    costs
        Names of the measures that are costs of a run.
    """

    varied: tuple[str, ...]
    measures: dict[str, str]
    costs: tuple[str, ...]


def columns(study: Study) -> ColumnRoles:
    """Return the roles of the columns of a study's table: varied values, measures and costs."""
    others = [str(name) for name in study.table.columns if name not in ABOUT]
    varied = [name for name in others if name not in study.columns]
    named = dict.fromkeys([*(name for name in MEASURES if name in study.columns), *study.columns])
    values = {name: numbers(study.table[name]) for name in named if name in others}
    measured = [name for name, column in values.items() if column is not None and np.isfinite(column).any()]
    labels = {
        name: (MEASURES.get(name) or of_column(name).label.replace("_", " ")) + " [%]" * is_share(name)
        for name in measured
    }
    if {"seconds", "seconds.march"} <= set(labels):
        labels["seconds"] += ", the least of its repeats"
    return ColumnRoles(tuple(varied), labels, tuple(name for name in COSTS if name in labels))


def is_share(name: str) -> bool:
    """Return whether a measure is a share: a fraction in the table of a study, per cent wherever it is shown."""
    return of_column(name).is_fraction


def in_per_cent(table: pd.DataFrame, roles: ColumnRoles) -> Any:
    """Return a table with its shares in per cent, as reports show them."""
    return table.assign(**{name: 100.0 * numbers(table[name]) for name in roles.measures if is_share(name)})


def references(table: pd.DataFrame) -> list[str]:
    """Return the pairs of methods with mesh tying instead of a contact law.

    They need the exact solution, so they are references and do not compete with the methods.
    """
    pairs = zip(methods(table), texts(table["contact"]), strict=True)
    return list(dict.fromkeys(method for method, contact in pairs if contact == TIED))
