"""Python's search for garbage in cycles, paused while many objects are made that all stay.

The search begins after a number of new objects and looks at all that live. Of a row of many bars hundreds of thousands
are made, none of them garbage: the searches then take as long as the work itself, and grow faster than the row.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collection_paused() -> Iterator[None]:
    """Search for no garbage inside this context; also a decorator. What no cycle holds is freed as ever."""
    searched = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if searched:
            gc.enable()
