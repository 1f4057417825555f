"""Signs of life of the work of this process, and a watch that notices when there are none."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

__all__ = ["Watch", "beat"]

_BEATS = [0]


def beat() -> None:
    """Give a sign of life: some steps are made, a function is compiled, a part of the work is done."""
    _BEATS[0] += 1


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

    def __exit__(self, *_: Any) -> None:
        self._ended.set()

    def _keep_watch(self) -> None:
        tick = min(1.0, self._seconds / 4)
        latest, silent = _BEATS[0], 0.0
        while not self._ended.wait(tick):
            silent = silent + tick if _BEATS[0] == latest else 0.0
            latest = _BEATS[0]
            if silent >= self._seconds > silent - tick:
                self._stalled()
