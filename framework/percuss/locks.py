"""The lock on the file of a study, to which one process writes at a time.

The operating system keeps a lock, so that it is released when the process that holds it ends, even by a crash.
"""

from __future__ import annotations

import contextlib
import datetime as dt
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from percuss.errors import wrong_input


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock on a file, which need not exist: a lock file beside it says which process writes.

    Raises
    ------
    InputError
        If another process, or another thread of this one, holds the lock, or the lock file cannot be made.
    """
    import filelock

    lock_file = path.with_name(f"{path.name}.lock")
    lock = filelock.FileLock(lock_file, timeout=0)
    try:
        lock.acquire()
    except filelock.Timeout:
        writer = ""
        with contextlib.suppress(OSError):  # it has just been removed
            writer = lock_file.read_text(encoding="utf-8")
        message = f"is being written by {writer or 'another process'}"
        raise wrong_input(str(path), message, "Wait until it has ended, or name another file with -o.") from None
    except OSError as error:
        raise wrong_input(str(path), f"cannot write here: {error.strerror}", "Name another file with -o.") from error
    try:
        since = dt.datetime.now(dt.UTC).isoformat(timespec="seconds")
        with contextlib.suppress(OSError):  # the disk is full, or the lock forbids it, as on Windows
            lock_file.write_text(f"process {os.getpid()} on {socket.gethostname()}, since {since}", encoding="utf-8")
        yield
    finally:
        # It is removed while it is still locked: who has opened it meanwhile sees that it is gone, and makes another.
        with contextlib.suppress(OSError):
            lock_file.unlink()
        lock.release()
