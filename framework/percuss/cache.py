"""The user's cache folder: what need not be computed again. It may be removed at any time."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from percuss.errors import InputError, UnwrittenError
from percuss.files import replacing


def cache_folder() -> Path | None:
    """Return the folder, inside NUMBA_CACHE_DIR of the environment if that is set; None where it cannot be made.

    What is loaded from it may be executed: it is made for its user alone.
    """
    import platformdirs

    configured = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(configured, "percuss") if configured else platformdirs.user_cache_path("percuss", appauthor=False)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError:
        return None
    return folder


def kept(name: str) -> bytes | None:
    """Return what is stored under a name; None where there is nothing."""
    folder = cache_folder()
    try:
        return None if folder is None else (folder / name).read_bytes()
    except OSError:
        return None


def keep(name: str, content: bytes) -> None:
    """Store `content` under a name; where there is no folder that can be written to, nothing is stored."""
    folder = cache_folder()
    if folder is not None:
        with contextlib.suppress(OSError, InputError, UnwrittenError), replacing(folder / name, ".part") as temporary:
            temporary.write_bytes(content)
