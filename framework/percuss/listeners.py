"""The progress of a long computation of a plug-in, and who hears of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_LISTENERS: ContextVar[tuple[Callable[[float], object], ...]] = ContextVar("_LISTENERS", default=())


def progress(share: float) -> None:
    """Tell which share of a long computation of a plug-in is done, between two parts of it.

    Call it about every tenth of a second: it shows the progress to whoever watches, and Ctrl-C ends the computation
    here, by a KeyboardInterrupt that the plug-in lets pass.

    Parameters
    ----------
    share
        Share of the computation that is done, from 0 to 1.
    """
    for listener in _LISTENERS.get():
        listener(share)


@contextmanager
def heard_by(listener: Callable[[float], object]) -> Iterator[None]:
    """Call a function at each `progress` inside this context, in this thread."""
    token = _LISTENERS.set((*_LISTENERS.get(), listener))
    try:
        yield
    finally:
        _LISTENERS.reset(token)
