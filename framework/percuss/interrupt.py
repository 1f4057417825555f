"""Ctrl-C as an event that a time march or a study checks between chunks of work."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any


@contextmanager
def interruptible(*, at_once: bool = False) -> Iterator[threading.Event]:
    """Turn the first Ctrl-C into an event for the caller to check between chunks; a second one interrupts as usual.

    Inside another such context the events of both are set, as the inner work may be at its end when Ctrl-C comes. In
    any thread but the main one Ctrl-C is left as it is, and the event is never set.

    Parameters
    ----------
    at_once
        Whether the first Ctrl-C also raises KeyboardInterrupt.
    """
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    previous_handler = signal.getsignal(signal.SIGINT)

    signal.signal(signal.SIGINT, _SetEvents(event, previous_handler, at_once))
    try:
        yield event
    finally:
        # The handler that was there before, unless Ctrl-C has put the usual one back for all contexts.
        interrupted = isinstance(previous_handler, _SetEvents) and previous_handler.event.is_set()
        if not interrupted:
            signal.signal(signal.SIGINT, previous_handler)


@dataclass(frozen=True)
class _SetEvents:
    """A handler of Ctrl-C that sets its event and those of the handlers it replaced, and puts back the usual one."""

    event: threading.Event
    previous: Any
    at_once: bool

    def __call__(self, number: int, frame: object) -> None:  # noqa: ARG002
        handler: Any = self
        while isinstance(handler, _SetEvents):
            handler.event.set()
            handler = handler.previous
        signal.signal(signal.SIGINT, handler)
        if self.at_once:
            raise KeyboardInterrupt


@contextmanager
def interrupted_afterwards() -> Iterator[threading.Event]:
    """Let Ctrl-C set an event inside this context, and interrupt at its end; the caller may do so before.

    It is for code that calls Python back in a way that loses errors. Where somebody around it checks an event of
    Ctrl-C, that one alone is set.
    """
    handler = signal.getsignal(signal.SIGINT)
    if isinstance(handler, _SetEvents) and not handler.at_once:
        yield threading.Event()
        return
    with interruptible() as pressed:
        try:
            yield pressed
        finally:
            if pressed.is_set():
                raise KeyboardInterrupt
