"""A study before its first run: its runs, those that cannot be made and why, and roughly what the others cost."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from percuss.jsonable import Data, Entries
from percuss.studies.perform import WAITING, foreseen, perform_timed
from percuss.studies.spec import read_study
from percuss.studies.study import planned

MOST_EXAMINED = 500
MARCHES = 2  # that a study makes of a run at least, to time it


def forecast(
    path: str | Path | Data,
    plugins: Sequence[str | Path] = (),
    progress: Callable[[int, int], None] | None = None,
    *,
    workers: int = 1,
    changes: Data | None = None,
) -> Entries:
    """Return what is known of a study before its first run; one run, the cheapest, is made to time it.

    Parameters
    ----------
    path
        Path of a study file, or its contents as a mapping.
    plugins
        Single-file plug-ins besides those that the cases name.
    progress
        Called with (runs examined, runs in all).
    workers
        Number of processes that share the runs.
    changes
        As of `percuss.study`.

    Returns
    -------
    dict
        ``title``, number of all ``runs`` and of those ``examined``; ``rows``, a mapping for each run that was examined,
        as of the table of the study, with ``node_steps`` and the ``status`` ``waiting`` for a run that nothing speaks
        against, else ``refused``, ``unstable`` or ``failed`` with the reason; the ``counts`` of each status among
        them; the ``node_steps`` of all runs that can be made, and their ``seconds`` with all workers, from the time of
        the cheapest run, None without such a run. Of a large study runs at equal distances are examined, and both are
        estimates.

    Raises
    ------
    InputError
        If the study, a case or a varied path is wrong.
    """
    spec = read_study(path, [Path(plugin) for plugin in plugins], changes)
    jobs = planned(spec)[0]
    tasks = [job.task for job in jobs[:: math.ceil(len(jobs) / MOST_EXAMINED)]]
    varied = dict.fromkeys(name for task in tasks for name in task.varied)
    rows: list[Entries] = []
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
            seconds = sum(each) * len(jobs) / len(tasks) / workers
    return {
        "title": str(spec.data.get("title", "")),
        "runs": len(jobs),
        "examined": len(rows),
        "rows": rows,
        "counts": dict(Counter(row["status"] for row in rows)),
        "node_steps": sum(work.values()) * len(jobs) / len(tasks),
        "seconds": seconds,
    }
