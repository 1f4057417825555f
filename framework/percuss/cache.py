"""The user's cache folder: what need not be computed again, and is never believed where it is damaged.

What is loaded from it is executed. It is therefore private to its user, and it is not used where anybody else could
write to it. A file begins with a digest of its name and content, which is checked before anything reads the content:
neither a damaged file nor a whole one instead of another is taken for what was stored.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import stat
import sys
import time
from pathlib import Path

from percuss.errors import InputError, UnwrittenError
from percuss.files import replacing

DIGEST_SIZE = 32  # bytes
TEMPORARY = ".part"
ABANDONED_AFTER = 3600.0  # seconds after which no process is writing a temporary file any more


def kept(name: str) -> bytes | None:
    """Return what is stored under a name; None where there is nothing, or a damaged file, which is removed."""
    folder = cache_folder()
    if folder is None:
        return None
    try:
        stored = (folder / name).read_bytes()
    except OSError:
        return None
    content = stored[DIGEST_SIZE:]
    if stored[:DIGEST_SIZE] == _digest(name, content):
        return content
    with contextlib.suppress(OSError):
        (folder / name).unlink()
    return None


def keep(name: str, content: bytes) -> None:
    """Store `content` under a name; where there is no folder that can be written to, nothing is stored."""
    folder = cache_folder()
    if folder is not None:
        _tidy(folder)
        with contextlib.suppress(OSError, InputError, UnwrittenError), replacing(folder / name, TEMPORARY) as temporary:
            temporary.write_bytes(_digest(name, content) + content)


def cache_folder() -> Path | None:
    """Return the folder, inside NUMBA_CACHE_DIR of the environment if that is set; None where there is none to be used.

    Numba's settings file in the current folder, which may be anybody's, does not name it.
    """
    if configured := os.environ.get("NUMBA_CACHE_DIR"):
        return _made(Path(configured, "percuss"))
    import platformdirs

    return _made(Path(platformdirs.user_cache_dir("percuss", appauthor=False)))


@functools.cache
def _made(path: Path) -> Path | None:
    """Return the folder at a path, made if need be; None, after a note, where others can change what is in it."""
    folder = Path(os.path.realpath(path))  # so that no link on the way can lead elsewhere later
    owners = {os.getuid(), 0} if hasattr(os, "getuid") else None
    try:
        for each in reversed((folder, *folder.parents)):
            each.mkdir(mode=stat.S_IRWXU, exist_ok=True)
            state = each.stat()
            # In a parent with the sticky bit others can make files, but cannot replace those of the user.
            private = not state.st_mode & 0o022 or (each != folder and state.st_mode & stat.S_ISVTX)
            if owners is not None and not (private and state.st_uid in owners):
                _tell_refused(folder, each)
                return None
    except OSError:
        return None
    with contextlib.suppress(OSError):  # it belongs to root, or lies on a disk that cannot be written to
        folder.chmod(state.st_mode & stat.S_IRWXU)
    return folder


def _tell_refused(folder: Path, place: Path) -> None:
    """Say on standard error why the folder is not used; the first process of a command says it for all of them."""
    from multiprocessing import parent_process

    if parent_process() is None:
        print(
            f"note: the cache folder {folder} is not used, because what it holds is executed, and another user owns"
            f" {place} or can write to it. Everything is compiled for this command alone. Remove the cache folder and"
            f" take the right from others (chmod go-w), or name another folder in NUMBA_CACHE_DIR.",
            file=sys.stderr,
        )


@functools.cache
def _tidy(folder: Path) -> None:
    """Remove what processes have left behind that were killed while they were writing."""
    for file in folder.glob(f".*{TEMPORARY}"):
        with contextlib.suppress(OSError):
            if file.stat().st_mtime < time.time() - ABANDONED_AFTER:
                file.unlink()


def _digest(name: str, content: bytes) -> bytes:
    return hashlib.sha256(name.encode() + b"\0" + content).digest()
