"""A study before its first run: its runs, those that cannot be made and why, and roughly what the others cost."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from percuss.studies.perform import WAITING, foreseen, perform_timed
from percuss.studies.spec import read_study
from percuss.studies.study import planned

__all__ = ["Forecast", "forecast"]

MOST_EXAMINED = 500
MARCHES = 2  # that a study makes of a run at least, to time it


@dataclass(frozen=True)
class Forecast:
    """A study before its first run.

    Attributes
    ----------
    title
        Title of the study.
    runs
        Number of all runs.
    rows
        A mapping for each run that was examined, as of the table of the study, with ``node_steps``; ``status`` is
        ``waiting`` for a run that nothing speaks against, else ``refused``, ``unstable`` or ``failed``, with the
        reason. Of a large study runs at equal distances are examined.
    seconds
        Rough time of all runs on all cores of this machine, from the time of the cheapest run; None without such a run.
    """

    title: str
    runs: int
    rows: list[dict[str, Any]]
    seconds: float | None

    @property
    def counts(self) -> dict[str, int]:
        """Number of examined runs with each status."""
        return dict(Counter(row["status"] for row in self.rows))

    @property
    def node_steps(self) -> float:
        """Steps times nodes of all runs that can be made; of a large study an estimate."""
        return float(sum(row["node_steps"] for row in self.rows)) * self.runs / len(self.rows)


def forecast(
    path: str | Path | Mapping[str, Any],
    plugins: Sequence[str | Path] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Forecast:
    """Return what is known of a study before its first run; one run, the cheapest, is made to time it.

    Parameters
    ----------
    path
        Path of a study file, or its contents as a mapping.
    plugins
        Single-file plug-ins besides those that the cases name.
    progress
        Called with (runs examined, runs in all).

    Raises
    ------
    InputError
        If the study, a case or a varied path is wrong.
    """
    spec = read_study(path, [Path(plugin) for plugin in plugins])
    jobs = planned(spec)[0]
    tasks = [job.task for job in jobs[:: math.ceil(len(jobs) / MOST_EXAMINED)]]
    varied = dict.fromkeys(name for task in tasks for name in task.varied)
    rows: list[dict[str, Any]] = []
    for task in tasks:
        run, node_steps = foreseen(spec.cases[task.case], task)
        names = {"case": task.case, "integrator": task.integrator, "contact": task.contact}
        values = {name: task.varied.get(name) for name in varied}
        outcome = {"status": run.status, "reason": run.reason, "said_by": run.said_by, "fragile": None}
        rows.append({**names, **values, **outcome, "node_steps": node_steps})
        if progress is not None:
            progress(len(rows), len(tasks))
    work = {i: row["node_steps"] for i, row in enumerate(rows) if row["status"] == WAITING}
    seconds = None
    if work:
        cheapest = min(work, key=lambda i: work[i])
        sample = perform_timed(spec.cases[tasks[cheapest].case], tasks[cheapest], repeats=MARCHES).result
        if sample is not None:
            times = sample.summary["seconds"]
            marched = MARCHES * times["march"]
            besides = max(times["total"] - times["compile"] - marched, 0.0)
            each = (besides + marched * node_steps / work[cheapest] for node_steps in work.values())
            seconds = sum(each) * len(jobs) / len(tasks) / (os.cpu_count() or 1)
    return Forecast(str(spec.data.get("title", "")), len(jobs), rows, seconds)
