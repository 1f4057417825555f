"""The user's cache folder: what need not be computed again. It may be removed at any time."""

from __future__ import annotations

import os
from pathlib import Path


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
