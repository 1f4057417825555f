"""The lock on the file of a study: one process at a time writes to it.

The lock is one of the operating system, so that it ends with the process that holds it, however that ends. What stands
in the file beside says who holds it.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import json
import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from percuss.errors import InputError, Problem

__all__ = ["BusyError", "locked"]


class BusyError(InputError):
    """Another process writes to the file.

    Attributes
    ----------
    holder
        What that process says of itself; empty where it cannot be read.
    """

    def __init__(self, path: Path, holder: Mapping[str, Any]) -> None:
        self.holder = dict(holder)
        who = f"process {holder.get('process', 'unknown')} on {holder.get('machine', 'an unknown machine')}"
        since = f", since {holder['since']}" if "since" in holder else ""
        message = f"is being written by {who}{since}"
        super().__init__([Problem(str(path), "", message, "Wait until it has ended, or name another file with -o.")])


@contextmanager
def locked(path: Path, about: Mapping[str, Any]) -> Iterator[None]:
    """Hold the lock on a file.

    Parameters
    ----------
    path
        The file; it need not be there.
    about
        What another process is to know of what holds it.

    Raises
    ------
    BusyError
        If another process, or another thread of this one, holds it.
    InputError
        If nothing can be written there.
    """
    beside = path.with_name(f"{path.name}.lock")
    file = _acquired(path, beside)
    try:
        since = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
        holder = {**about, "process": os.getpid(), "machine": socket.gethostname(), "since": since}
        file.seek(0)
        file.truncate()
        file.write(json.dumps(holder))
        file.flush()
        yield
    finally:
        with contextlib.suppress(OSError):
            beside.unlink()
        file.close()


def _acquired(path: Path, beside: Path) -> IO[str]:
    """Return the open file beside, locked."""
    while True:
        try:
            # closed by whoever holds the lock: it ends with that
            file = beside.open("a+", encoding="utf-8")
        except OSError as error:
            message = f"cannot write here: {error.strerror}"
            raise InputError([Problem(str(path), "", message, "Name another file with -o.")]) from error
        if not _try_lock(file):
            file.seek(0)
            try:
                holder = json.loads(file.read())
            except ValueError:  # it has just been taken
                holder = {}
            file.close()
            raise BusyError(path, holder if isinstance(holder, dict) else {})
        # whoever held it before may have removed it since it was opened: then others would lock a new one
        with contextlib.suppress(OSError):
            if beside.stat().st_ino == os.fstat(file.fileno()).st_ino:
                return file
        file.close()


def _try_lock(file: IO[str]) -> bool:
    """Lock an open file; return whether nobody else holds it."""
    try:
        import fcntl
    except ImportError:  # Windows
        return _try_lock_on_windows(file)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _try_lock_on_windows(file: IO[str]) -> bool:
    import importlib

    msvcrt: Any = importlib.import_module("msvcrt")
    place = 1 << 30  # behind what is written, so that others may read that
    file.seek(place)
    try:
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    except OSError:
        return False
    return True
