"""Runs whose steps are shared out among threads, in a process of their own: ``shared_out.py NAMES THREADS``.

The runs of each case, with as many threads as each digit of THREADS says, are told as JSON: the threads that there
were, a digest of all that the result holds but for times, and the notes.
"""

import hashlib
import json
import multiprocessing
import sys
import threading

import numba
import numpy as np

import percuss
from percuss.march import arrays
from percuss.reporting.terminal import result_lines
from percuss.results.rerun import rerun


def blocks(size, cells, **more):
    """Return the case of two blocks, of which the lower one is thrown against the upper one."""
    dim, plane, fixed = len(size), more.pop("plane", None), more.pop("fixed", [])
    body = {
        "block": {"size": size, "elements": [4] * dim, "cells": cells},
        "material": {"young": 1.0, "density": 1.0, "poisson": 0.2},
        "fixed": fixed,
        **({"plane": plane} if plane else {}),
    }
    lower = {**body, "at": [0.0] * dim, "velocity": [0.0] * (dim - 1) + [0.1]}
    upper = {**body, "at": [0.0] * (dim - 1) + size[-1:]}
    return {
        "percuss": 1,
        "bodies": {"lower": lower, "upper": upper},
        "contacts": {"seam": {"between": ["lower.top", "upper.bottom"]}},
        "time": {"steps": 60, "courant": 0.4},
        "record": {"fields": 3},
        **more,
    }


NOH_BATHE = {"integrator": "noh-bathe", "contact": "penalty"}
CASES = {
    "tet4": blocks([1.0, 1.0, 1.0], "tet4"),
    "weight": blocks([1.0, 1.0], "quad4", loads={"weight": {"gravity": [0.0, -1.0]}}),
    "viscous": blocks([1.0, 1.0], "tri3", method={"integrator": "viscous-central-difference"}),
    "stages of rings": blocks(
        [1.0, 1.0], "quad4", method=NOH_BATHE, plane="axisymmetric", fixed=[{"on": "left", "along": "x"}]
    ),
}


def run(name, threads=None):
    """Return the result of a case."""
    return percuss.run(percuss.load(CASES[name]), threads=threads)


def told(result):
    """Return the threads of a run, a digest of all that it holds but for times, and its notes."""
    summary = {key: value for key, value in result.summary.items() if key not in {"seconds", "threads", "notes"}}
    digest = hashlib.sha256(json.dumps(summary, sort_keys=True, default=str).encode())
    for name, values in [*sorted(result.arrays.items()), *sorted(result.field_arrays.items())]:
        digest.update(name.encode() + np.asarray(values).tobytes())
    return result.summary["threads"], digest.hexdigest(), result.summary["notes"]


def at_once(names):
    """Return what is told of the runs of some cases in as many threads of Python, at the same time."""
    start, ends = threading.Barrier(len(names)), [None] * len(names)

    def work(k):
        start.wait()
        ends[k] = told(run(names[k]))

    threads = [threading.Thread(target=work, args=(k,)) for k in range(len(names))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return ends


def in_child(name):
    """Return what is told of a run in a forked process."""
    fork = multiprocessing.get_context("fork")
    receiver, sender = fork.Pipe(duplex=False)
    child = fork.Process(target=lambda: sender.send(told(run(name))))
    child.start()
    sender.close()
    return receiver.recv()


def same_again(name, file):
    """Return whether the saved result of one thread is found again to the last bit by others, and what is printed."""
    run(name, 1).save(file)
    return rerun(file).passed, str(next(filter(lambda line: isinstance(line, str), result_lines(run(name)))))


def launched():
    """Return whether this process has launched threads."""
    try:
        return bool(numba.threading_layer())
    except ValueError:
        return False


if __name__ == "__main__":
    names, counts = sys.argv[1].split(","), list(map(int, sys.argv[2]))
    ends = {"small": (run(names[0], counts[0]).summary["threads"], launched())}
    arrays.FEW_NUMBERS = 0
    ends["runs"] = {name: [told(run(name, threads)) for threads in counts] for name in names}
    if sys.argv[3:]:
        ends |= {"at once": at_once([names[0]] * 2), "child": in_child(names[0])}
        ends["again"] = same_again(names[0], sys.argv[3])
    print(json.dumps(ends))
