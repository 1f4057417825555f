"""Signs of life of the work of this process, and a watch that notices when there are none."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_BEATS = [0]
_LISTENERS: ContextVar[tuple[Callable[[float], object], ...]] = ContextVar("_LISTENERS", default=())


def beat() -> None:
    """Give a sign of life: some steps are made, a function is compiled, a part of the work is done."""
    _BEATS[0] += 1


def progress(share: float) -> None:
    """Tell which share of a long computation of a plug-in is done, between two parts of it.

    Call it about every tenth of a second: it is a sign of life, it shows the progress to whoever watches, and Ctrl-C
    ends the computation here, by a KeyboardInterrupt that the plug-in lets pass.

    Parameters
    ----------
    share
        Share of the computation that is done, from 0 to 1.
    """
    beat()
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


@contextmanager
def watched(seconds: float, stalled: Callable[[], None]) -> Iterator[None]:
    """Call a function after some seconds without a sign of life inside this context, once for each such silence.

    The seconds are counted while this process runs: a computer that slept does not make its work late.

    Parameters
    ----------
    seconds
        Length of the silence.
    stalled
        Called in a thread of its own.
    """
    ended = threading.Event()
    threading.Thread(target=_keep_watch, args=(seconds, stalled, ended), name="percuss-watch", daemon=True).start()
    try:
        yield
    finally:
        ended.set()


def _keep_watch(seconds: float, stalled: Callable[[], None], ended: threading.Event) -> None:
    tick = min(1.0, seconds / 4)
    latest, silent = _BEATS[0], 0.0
    while not ended.wait(tick):
        silent = silent + tick if _BEATS[0] == latest else 0.0
        latest = _BEATS[0]
        if silent >= seconds > silent - tick:
            stalled()
