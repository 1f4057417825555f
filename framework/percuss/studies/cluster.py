"""Runs of a study on the workers of a Dask scheduler.

Everything that a worker needs, some kilobytes, travels with each batch: so a worker may join or leave at any moment.
"""

from __future__ import annotations

import functools
import logging
import pickle
import threading
import time
from concurrent.futures import CancelledError
from typing import Any

from percuss.errors import RunError, wrong_input
from percuss.jit import LOCK
from percuss.studies.job_package import Bench, Job, Record
from percuss.studies.perform import LOST
from percuss.studies.store import WORKER
from percuss.studies.workers import Batches, Made
from percuss.version import __version__

CONNECT_SECONDS = 5.0  # until a scheduler counts as absent
FIRST_WORD, LATER_WORDS = 5.0, 60.0  # seconds without workers until it is said, and until it is said again
LOG = logging.getLogger("percuss")  # without other settings Python prints its warnings on standard error


def made_on_cluster(bench: Bench, address: str, batches: Batches, stop: threading.Event) -> Made:
    """Make the runs on the workers of the scheduler at `address` and yield each finished batch with its records.

    Parameters
    ----------
    bench
        Everything the workers need: cases, plug-ins and tables as text. Packages of methods must be installed there.
    address
        Address of the scheduler, as ``tcp://10.0.0.1:8786``.
    batches
        Runs to make.
    stop
        Event that ends the work when it is set.

    Raises
    ------
    InputError
        If distributed is not installed, or no scheduler answers at `address`.
    RunError
        If the scheduler goes away meanwhile, or a worker has no percuss or another version of it.
    """
    client = _client(address)
    try:
        with client.as_current():
            yield from _made(client, pickle.dumps(bench), batches, stop)
    except (CancelledError, OSError) as error:
        message = "the scheduler is gone; the rows made so far are kept, and the same command continues"
        raise RunError(f"{address}: {message} ({type(error).__name__})") from error
    except ImportError as error:  # raised on a worker and passed on by the scheduler
        raise RunError(f"{address}: a worker lacks a package: {error}; install percuss there too") from error
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


def _made(client: Any, bench: bytes, batches: Batches, stop: threading.Event) -> Made:
    from distributed import KilledWorker

    batches.workers = max(1, sum(client.nthreads().values()))
    in_flight: dict[Any, list[Job]] = {}
    # Addresses of workers that cannot make runs of this study: they would use up all runs at once by failing them.
    unfit: set[str] = set()
    waiting = _WaitForWorkers(client)
    while (batches.waiting or in_flight) and not stop.is_set():
        while batches.waiting and len(in_flight) < 2 * batches.workers:
            batch = batches.take()
            fit_workers = [address for address in client.nthreads() if address not in unfit] if unfit else []
            placement = {"workers": fit_workers} if fit_workers else {}
            in_flight[client.submit(_work, bench, __version__, batch, pure=False, **placement)] = batch
        waiting.tell()
        for future in _finished(list(in_flight)):
            batch = in_flight.pop(future)
            try:
                records, address = future.result()
            except KilledWorker:  # the scheduler raises it for a batch that killed several workers
                killer, address = batches.culprit(batch), ""
                reason = "its worker process died several times; the same command tries the run again"
                records = [Record(killer.key, LOST, reason, WORKER)] if killer is not None else []
            if any(record.misfit for record in records):
                unfit.add(address)
                if set(client.nthreads()) - unfit:  # other workers may be able to make the runs
                    records = [record for record in records if not record.misfit]
            yield batch, records
    client.cancel(list(in_flight))


class _WaitForWorkers:
    """Messages to the log while a scheduler has no workers, which may still come."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self.since: float | None = None
        self.told = 0

    def tell(self) -> None:
        """Say, after some seconds and then once a minute, that there are no workers; and that they have come."""
        address = self.client.scheduler.address
        if self.client.nthreads():
            if self.told:
                LOG.warning("%s: workers have come", address)
            self.since, self.told = None, 0
            return
        now = time.monotonic()
        self.since = now if self.since is None else self.since
        if now - self.since >= FIRST_WORD + self.told * LATER_WORDS:
            self.told += 1
            LOG.warning(
                "%s: the scheduler has no workers, for %.0f s now: start some with `dask worker %s`; Ctrl-C ends the "
                "wait and keeps the rows made so far",
                address,
                now - self.since,
                address,
            )


def _finished(futures: list[Any]) -> list[Any]:
    """Return the finished futures, or an empty list if none finishes within half a second."""
    from distributed import TimeoutError as Late
    from distributed import wait

    try:
        return list(wait(futures, timeout=0.5, return_when="FIRST_COMPLETED").done)
    except Late:
        return []


@functools.lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> Bench:
    return pickle.loads(packed)  # type: ignore[no-any-return]  # noqa: S301 - from the scheduler that is trusted with code


def _bench(packed: bytes) -> Bench:
    """Return the bench of a study, which all threads of a worker share."""
    with LOCK:
        return _unpacked(packed)


def _work(packed: bytes, version: str, batch: list[Job]) -> tuple[list[Record], str]:
    """Return the records of a batch and the address of this worker."""
    from distributed import get_worker

    if version != __version__:
        raise RunError(f"a worker has percuss {__version__}, and this is {version}: install the same version there")
    return _bench(packed).records(batch), get_worker().address
