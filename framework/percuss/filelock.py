"""Locks between processes: on the file of a study, and on the compilation of a function.

The operating system keeps a lock, so that it is released when the process that holds it ends, even by a crash. The
lock file beside a study's file describes that process.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from percuss.errors import InputError, Problem, wrong_input
from percuss.jsonable import Data

WAIT_SECONDS = 0.02  # between two attempts to get a lock


class BusyError(InputError):
    """Refusal to write to a file because another process is writing to it.

    Attributes
    ----------
    holder
        Description of that process, from the lock file; empty if it cannot be read.
    """

    def __init__(self, path: Path, holder: Data) -> None:
        self.holder = dict(holder)
        writer = f"process {holder.get('process', 'unknown')} on {holder.get('machine', 'an unknown machine')}"
        since = f", since {holder['since']}" if "since" in holder else ""
        message = f"is being written by {writer}{since}"
        super().__init__([Problem(str(path), "", message, "Wait until it has ended, or name another file with -o.")])


class NotWritableError(InputError):
    """Refusal to write to a file in a folder that cannot be written to.

    Attributes
    ----------
    path
        The file.
    """

    def __init__(self, path: Path, reason: str | None) -> None:
        self.path = path
        super().__init__([Problem(str(path), "", f"cannot write here: {reason}", "Name another file with -o.")])


@contextmanager
def locked(path: Path, about: Data) -> Iterator[None]:
    """Hold the lock on a file.

    Parameters
    ----------
    path
        The file; it need not exist.
    about
        Description of this process for others that find the file locked.

    Raises
    ------
    BusyError
        If another process, or another thread of this one, holds the lock.
    NotWritableError
        If the lock file cannot be opened for writing.
    """
    lock_file = path.with_name(f"{path.name}.lock")
    file = _acquired(path, lock_file)
    try:
        since = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
        holder = {**about, "process": os.getpid(), "machine": socket.gethostname(), "since": since}
        try:
            file.seek(0)
            file.truncate()
            file.write(json.dumps(holder))
            file.flush()
        except OSError as error:
            message = f"cannot write here: {error.strerror}"
            raise wrong_input(str(path), message, "Make room, or name another file with -o.") from error
        yield
    finally:
        with contextlib.suppress(OSError):
            lock_file.unlink()
        with contextlib.suppress(OSError):  # the disk is full
            file.close()


@contextmanager
def in_turn(lock_file: Path, longest_wait: float) -> Iterator[None]:
    """Wait until no other process is in this context, then enter it; enter anyway after `longest_wait` seconds.

    The lock file stays where it is. Where it cannot be written or locked nobody waits for anybody.
    """
    try:
        lock_file.parent.mkdir(parents=True, exist_ok=True)
        file = lock_file.open("a+", encoding="utf-8")
    except OSError:
        yield
        return
    with file:
        until = time.monotonic() + longest_wait
        held = False
        with contextlib.suppress(OSError):  # the file system has no locks
            while not (held := _try_lock(file)) and time.monotonic() < until:
                time.sleep(WAIT_SECONDS)
        try:
            yield
        finally:
            if held:
                _unlock(file)


def _acquired(path: Path, lock_file: Path) -> IO[str]:
    """Return the lock file of `path`, open and locked."""
    while True:
        try:
            # `locked` closes the file at its end, which releases the lock.
            file = lock_file.open("a+", encoding="utf-8")
        except OSError as error:
            raise NotWritableError(path, error.strerror) from error
        try:
            free = _try_lock(file)
        except OSError as error:
            file.close()
            message = f"cannot lock this file: {error.strerror}"
            raise wrong_input(str(path), message, "Name a file on another file system with -o.") from error
        if not free:
            file.seek(0)
            try:
                holder = json.loads(file.read())
            except ValueError:  # The holder has not written its description yet.
                holder = {}
            file.close()
            raise BusyError(path, holder if isinstance(holder, dict) else {})
        # The previous holder may have deleted the lock file after it was opened above. Others would then lock a new
        # file, so the lock only counts if the opened file is still the one on disk.
        with contextlib.suppress(OSError):
            if lock_file.stat().st_ino == os.fstat(file.fileno()).st_ino:
                return file
        file.close()


def _try_lock(file: IO[str]) -> bool:
    """Lock an open file and return True, or return False if another process or thread holds the lock.

    Raises
    ------
    OSError
        If the file system has no locks.
    """
    try:
        import fcntl
    except ImportError:  # Windows has no fcntl.
        return _try_lock_on_windows(file)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _unlock(file: IO[str]) -> None:
    """Release the lock on a file, also for processes that were forked while it was held."""
    with contextlib.suppress(ImportError):  # on Windows closing the file releases the lock
        import fcntl

        fcntl.flock(file, fcntl.LOCK_UN)


def _try_lock_on_windows(file: IO[str]) -> bool:
    """Lock an open file on Windows and return True, or return False if it is locked already."""
    import importlib

    msvcrt: Any = importlib.import_module("msvcrt")
    offset = 1 << 30  # Windows forbids reading locked bytes, so the lock lies far behind the text.
    file.seek(offset)
    try:
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
    except OSError:
        return False
    return True
