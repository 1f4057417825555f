"""Roles of the columns of a study's table: varied values, measures with their labels, costs, true errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from percuss.case.quantities import QUANTITIES, of_column
from percuss.jsonable import Entries
from percuss.reporting.study_data.values import methods, numbers, texts
from percuss.studies.tasks import TIED

if TYPE_CHECKING:
    import pandas as pd

# Labels of the measures, in their order on the page: the comparisons with the exact solution come first.
MEASURES = {
    **{name: quantity.label for name, quantity in QUANTITIES.items() if quantity.against_exact},
    **{name: quantity.label for name, quantity in QUANTITIES.items() if quantity.path or quantity.metric},
    "seconds.march": "seconds of the march alone",
    "seconds": "seconds of the whole row, with loading, compiling, certificate and exact solution",
}

# Measures of the cost of a run; the first does not depend on the machine. `seconds` is one of them only where the study
# describes it, because it then is the time of the march alone.
COSTS = ("node_steps", "seconds", "seconds.march", "steps")
SECONDS_OF_MARCH = "seconds of the march alone"

ABOUT = ("case", "integrator", "contact", "status", "reason", "said_by", "fragile", "key")


class StudyLike(Protocol):
    """The part of a study's interface that a report uses."""

    @property
    def title(self) -> str:
        """Title of the study in one line."""

    @property
    def spec(self) -> Entries:
        """The study file as plain data."""

    @property
    def provenance(self) -> Entries:
        """Versions, machine, plug-ins and the command that made the study."""

    @property
    def table(self) -> Any:
        """The runs as a pandas DataFrame, one row per run."""

    @property
    def with_histories(self) -> set[str]:
        """Keys of the runs whose histories are kept."""

    def histories(self, key: Any) -> Entries | None:
        """Return the histories of a run, or None if they were not kept.

        The keys are ``time``, ``contact_force``, ``contact_force_exact`` and ``contact`` (names).
        """


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


def columns(study: StudyLike) -> ColumnRoles:
    """Return the roles of the columns of a study's table: varied values, measures and costs."""
    others = [str(name) for name in study.table.columns if name not in ABOUT]
    descriptions = words(study)
    if descriptions:
        varied = [name for name in others if name not in descriptions and name != "seconds"]
    else:
        named = {path for part in ("vary", "sample", "paired") for path in _paths_named(study.spec.get(part))}
        varied = [
            name for name in others if name in named or (name not in MEASURES and ("." in name or name == "refine"))
        ]
    standard = [name for name in MEASURES if name in others and name not in varied]
    further = [name for name in others if name not in varied and name not in MEASURES]
    values = {name: numbers(study.table[name]) for name in (*standard, *further)}
    measured = [name for name, column in values.items() if column is not None and np.isfinite(column).any()]
    labels = {
        name: (MEASURES.get(name) or of_column(name).label.replace("_", " ")) + " [%]" * is_share(name)
        for name in measured
    }
    costs = [name for name in COSTS if name in labels and (name != "seconds" or "seconds" in descriptions)]
    if "seconds" in costs:
        labels["seconds"] = SECONDS_OF_MARCH + (", the least of its repeats" if "seconds.march" in labels else "")
    return ColumnRoles(tuple(varied), labels, tuple(costs))


def is_share(name: str) -> bool:
    """Return whether a measure is a share: a fraction in the table of a study, per cent wherever it is shown."""
    return of_column(name).is_fraction


def in_per_cent(table: pd.DataFrame, roles: ColumnRoles) -> Any:
    """Return a table with its shares in per cent, as reports show them."""
    return table.assign(**{name: 100.0 * numbers(table[name]) for name in roles.measures if is_share(name)})


def words(study: StudyLike) -> dict[str, str]:
    """Return the study's own description of each measured column; empty for a study without descriptions."""
    return dict(getattr(study, "columns", None) or {})


def _paths_named(part: Any) -> list[str]:
    """Return the paths named by one part of a study file: a mapping, a list of mappings, or a sample with its `of`."""
    if isinstance(part, dict):
        return [str(path) for path in part.get("of", part)]
    return [path for item in part for path in _paths_named(item)] if isinstance(part, list) else []


def references(table: pd.DataFrame) -> list[str]:
    """Return the pairs of methods with mesh tying instead of a contact law.

    They need the exact solution, so they are references and do not compete with the methods.
    """
    pairs = zip(methods(table), texts(table["contact"]), strict=True)
    return list(dict.fromkeys(method for method, contact in pairs if contact == TIED))
