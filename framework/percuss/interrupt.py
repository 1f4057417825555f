"""Ctrl-C as an event that a time march or a study checks between chunks of work."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def interruptible() -> Iterator[threading.Event]:
    """Turn the first Ctrl-C into an event for the caller to check between chunks; a second one interrupts as usual.

    In any thread but the main one Ctrl-C is left as it is, and the event is never set.
    """
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    previous_handler = signal.getsignal(signal.SIGINT)

    def set_event(number: int, frame: Any) -> None:  # noqa: ARG001
        event.set()
        signal.signal(signal.SIGINT, previous_handler)

    signal.signal(signal.SIGINT, set_event)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, previous_handler)
