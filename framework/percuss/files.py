"""Folder of the percuss package, files that may be written, one written completely or not at all, and locks."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from percuss.errors import UnwrittenError, wrong_input

PACKAGE = Path(__file__).parent  # folder of percuss's own modules

# Errors of a disk that is full, broken or not to be written to.
_ERRORS = ("ENOSPC", "EDQUOT", "EFBIG", "EIO", "EROFS", "EACCES", "EPERM")
CANNOT_BE_WRITTEN = {getattr(errno, name) for name in _ERRORS if hasattr(errno, name)}  # Windows lacks one


def is_file(path: Path) -> bool:
    """Return whether a path is that of a file; False for a text that can be no path."""
    return os.path.isfile(path)  # noqa: PTH113 - that of pathlib raises for one too long, or with a null character


def is_folder(path: Path) -> bool:
    """Return whether a path is that of a folder; False for a text that can be no path."""
    return os.path.isdir(path)  # noqa: PTH112


def found_instead(path: Path) -> str:
    """Return in words what lies at a path in place of a file, or an empty text for a file, nothing, and no path."""
    if is_folder(path):
        return "a folder"
    return "" if is_file(path) or not os.path.exists(path) else "a pipe or a device"  # noqa: PTH110


def expect_no_input(path: str | os.PathLike[str], inputs: Iterable[tuple[str, Path]]) -> None:
    """Refuse an output at the place of a file that is read.

    Parameters
    ----------
    path
        Path of the output.
    inputs
        Role and path of each file that is read, as ``("case", case.yaml)``.

    Raises
    ------
    InputError
        If the output is one of them, also by way of a link.
    """
    for role, file in inputs:
        if _is_same(Path(path), file):
            message = f"expected a file to write, found the {role} {file}, which is read"
            raise wrong_input(str(path), message, "Name another file.")


def _is_same(first: Path, second: Path) -> bool:
    """Return whether two paths are of one file, which need not exist."""
    try:
        return first.samefile(second)
    except (OSError, ValueError):
        return first.absolute() == second.absolute()


def expect_writable(path: str | os.PathLike[str], inputs: Iterable[tuple[str, Path]] = ()) -> None:
    """Refuse an output that cannot be written, or that is one of the `inputs`, before anything is run.

    Raises
    ------
    InputError
        If there cannot be such a file, or it is read.
    """
    expect_no_input(path, inputs)
    _temporary_beside(Path(path), "").unlink()


def expect_place(path: Path) -> None:
    """Refuse a path whose folder is missing, or at which something else lies than a file.

    Raises
    ------
    InputError
        If there cannot be a file.
    """
    if not is_folder(path.parent):
        raise wrong_input(str(path), f"expected a folder {path.parent}, found none", "Make it first.")
    if other := found_instead(path):
        raise wrong_input(str(path), f"expected a file to write, found {other}", "Name another file.")


@contextmanager
def replacing(path: str | os.PathLike[str], suffix: str) -> Iterator[Path]:
    """Give a temporary path and, if no error occurs inside this context, rename that file to the target.

    Raises
    ------
    InputError
        On entry, if there cannot be such a file.
    UnwrittenError
        At the end, if the file could not be written to its end or renamed.
    """
    target = Path(path)
    temporary = _temporary_beside(target, suffix)
    try:
        yield temporary
        temporary.replace(target)
    except OSError as error:
        if error.errno not in CANNOT_BE_WRITTEN:
            raise
        raise unwritten(target, str(error.strerror)) from error
    finally:
        temporary.unlink(missing_ok=True)


def _temporary_beside(target: Path, suffix: str) -> Path:
    """Return an empty file beside the target, or refuse the target because there cannot be such a file."""
    expect_place(target)
    try:
        temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}{suffix}")
        temporary.touch(exist_ok=False)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise wrong_input(str(target), f"cannot write here: {reason}", "Name another file or folder.") from error
    return temporary


def unwritten(target: Path, reason: str) -> UnwrittenError:
    """Return the error for a target that could not be written."""
    before = "what was there is as it was" if target.exists() else "nothing is left behind"
    return UnwrittenError(f"{target}: cannot be written: {reason}; {before}. Make room, or name another place.")


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock on the file of a study, which need not exist, and to which one process writes at a time.

    The operating system keeps a lock, so that it is released when the process that holds it ends, even by a crash.

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
