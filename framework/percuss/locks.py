"""The lock on the file of a study, to which one process writes at a time.

The operating system keeps a lock, so that it is released when the process that holds it ends, even by a crash.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from percuss.errors import wrong_input


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock on a file, which need not exist.

    Raises
    ------
    InputError
        If another process, or another thread of this one, holds the lock, or the lock file cannot be made.
    """
    import filelock

    lock = filelock.FileLock(path.with_name(f"{path.name}.lock"), timeout=0)
    try:
        lock.acquire()
    except filelock.Timeout:
        advice = "Wait until it has ended, or name another file with -o."
        raise wrong_input(str(path), "is being written by another process", advice) from None
    except OSError as error:
        raise wrong_input(str(path), f"cannot write here: {error.strerror}", "Name another file with -o.") from error
    try:
        yield
    finally:
        # It is removed while it is still locked: who has opened it meanwhile sees that it is gone, and makes another.
        Path(lock.lock_file).unlink(missing_ok=True)
        lock.release()
