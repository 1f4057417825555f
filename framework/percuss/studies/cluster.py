"""Runs of a study on the workers of a Dask scheduler, where percuss and the plug-ins are installed too."""

from __future__ import annotations

import threading
from collections.abc import Generator, Sequence
from concurrent.futures import CancelledError
from typing import Any

from percuss.errors import RunError, wrong_input
from percuss.studies.bench import Bench, Job
from percuss.studies.perform import LOST, WORKER, Record

CONNECT_SECONDS = 5.0  # until a scheduler counts as absent


def made_on_cluster(address: str, bench: Bench, jobs: Sequence[Job], stop: threading.Event) -> Generator[list[Record]]:
    """Make runs on the workers of the scheduler at `address`, and yield the records of those that have ended.

    Parameters
    ----------
    address
        Address of the scheduler, as ``tcp://10.0.0.1:8786``.
    bench
        Everything the workers need.
    jobs
        The runs.
    stop
        Event that ends the work when it is set.

    Raises
    ------
    InputError
        If distributed is not installed, or no scheduler answers at `address`.
    RunError
        If the scheduler goes away meanwhile, or a worker has no percuss.
    """
    from distributed import KilledWorker, wait

    client = _client(address)
    try:
        with client.as_current():
            held = client.scatter(bench, broadcast=True, direct=False)
            waiting: dict[Any, Job] = {
                client.submit(Bench.record_elsewhere, held, job, pure=False): job for job in jobs
            }
            while waiting and not stop.is_set():
                try:
                    done = wait(list(waiting), timeout=0.5, return_when="FIRST_COMPLETED").done
                except TimeoutError:
                    continue
                records = []
                for future in done:
                    job = waiting.pop(future)
                    try:
                        records.append(future.result())
                    except KilledWorker as error:  # it killed several workers
                        records.append(Record(job.key, LOST, str(error), WORKER))
                yield records
            client.cancel(list(waiting))
    except (CancelledError, OSError, ImportError) as error:  # an ImportError is that of a worker
        message = "the scheduler is gone, or a worker lacks a package; the same command continues"
        raise RunError(f"{address}: {message} ({type(error).__name__}: {error})") from error
    finally:
        client.close()


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        advice = "Install percuss[study], or leave --scheduler out to use the cores of this machine."
        raise wrong_input("--scheduler", "needs distributed, which is not installed", advice) from None
    try:
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        advice = "Start one with `dask scheduler`, and workers with `dask worker ADDRESS`."
        raise wrong_input(f"--scheduler {address}", f"nobody answers: {error}", advice) from None
