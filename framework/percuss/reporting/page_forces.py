"""The contact forces of the runs of a study that its page carries."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from percuss.jsonable import Entries
from percuss.reporting.figures import thinned
from percuss.reporting.study_data import numbers

if TYPE_CHECKING:
    import pandas as pd

    from percuss.studies.study_table import Study

MOST_HISTORIES = 120
MOST_CONTACTS = 4
POINTS = 200  # A history is thinned to this many points, which include its extremes.


def kept_histories(study: Study, table: pd.DataFrame, ranked: Sequence[str]) -> dict[int, Entries]:
    """Return thinned histories by row number, for as many of the rows as a page can carry.

    The rows are taken from each pair of methods in each case in turn, those with the least of the first `ranked`
    measure first: what a page leaves out are the worst runs of each pair. A history maps each contact to the times and
    forces of the run, and to those of the exact solution where it is known.
    """
    kept = table["key"].isin(list(study.with_histories)).to_numpy()
    errors = numbers(table[ranked[0]].where(table["status"] == "done")) if ranked else np.zeros(len(table))
    own = [rows[kept[rows]] for rows in table.groupby(["case", "integrator", "contact"]).indices.values()]
    queues = [rows[np.argsort(errors[rows], kind="stable")].tolist() for rows in own]
    out: dict[int, Entries] = {}
    for row in (row for turn in itertools.zip_longest(*queues) for row in turn if row is not None):
        history = study.histories(table["key"].iloc[row])
        if history is None:
            continue
        out[row] = _lines(history, table["case"].iloc[row])
        if len(out) == MOST_HISTORIES:
            break
    return out


def _lines(history: Entries, case: str) -> dict[str, list[list[list[float]]]]:
    """Return for each contact the computed and the exact line, thinned to times and forces of five digits."""
    time = np.asarray(history["time"], dtype=float)
    names = list(history.get("contact", []))
    out: dict[str, list[list[list[float]]]] = {}
    for values in (history.get("contact_force"), history.get("contact_force_exact")):
        for k, curve in enumerate(
            np.asarray(values, dtype=float).reshape(time.size, -1).T if values is not None else ()
        ):
            if k < MOST_CONTACTS:
                contact = f"{case}: {names[k] if k < len(names) else f'contact {k + 1}'}"
                line = [[float(f"{v:.5g}") for v in part] for part in thinned(time, curve, POINTS)]
                out.setdefault(contact, []).append(line)
    return out
