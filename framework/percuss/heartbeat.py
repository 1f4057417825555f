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


class Watch:
    """A thread that calls a function after some seconds without a sign of life, once for each such silence.

    The seconds are counted while this process runs: a computer that slept does not make its work late.

    Parameters
    ----------
    seconds
        Length of the silence.
    stalled
        Called in the thread of the watch.
    """

    def __init__(self, seconds: float, stalled: Callable[[], None]) -> None:
        self._seconds, self._stalled = seconds, stalled
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._keep_watch, name="percuss-watch", daemon=True)

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()

    def _keep_watch(self) -> None:
        tick = min(1.0, self._seconds / 4)
        latest, silent = _BEATS[0], 0.0
        while not self._ended.wait(tick):
            silent = silent + tick if _BEATS[0] == latest else 0.0
            latest = _BEATS[0]
            if silent >= self._seconds > silent - tick:
                self._stalled()
