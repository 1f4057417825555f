"""Ctrl-C as an event that a time march or a study checks between chunks of work, and the progress of a plug-in."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import Any

_WAITING: list[threading.Event] = []  # events of the contexts that this process is in


@contextmanager
def interruptible() -> Iterator[threading.Event]:
    """Turn the first Ctrl-C into an event for the caller to check between chunks; a second one interrupts as usual.

    Inside another such context the events of both are set, as the inner work may be at its end when Ctrl-C comes. In
    any thread but the main one Ctrl-C is left as it is, and the event is never set.
    """
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    usual: Any = signal.getsignal(signal.SIGINT)
    if not _WAITING:
        signal.signal(signal.SIGINT, partial(_set_events, usual))
    _WAITING.append(event)
    try:
        yield event
    finally:
        _WAITING.pop()
        if not _WAITING:
            signal.signal(signal.SIGINT, usual)


def _set_events(usual: Callable[..., Any] | int | None, number: int, frame: object) -> None:  # noqa: ARG001
    """Set the events of all contexts, and put back the usual handler of Ctrl-C."""
    signal.signal(signal.SIGINT, usual)
    for event in _WAITING:
        event.set()


@contextmanager
def interrupted_afterwards() -> Iterator[None]:
    """Let Ctrl-C interrupt at the end of this context, for code that calls Python back in a way that loses errors.

    Where somebody around it checks an event of Ctrl-C, that one alone is set.
    """
    checked = bool(_WAITING)
    with interruptible() as pressed:
        try:
            yield
        finally:
            if pressed.is_set() and not checked:
                raise KeyboardInterrupt


# Who hears of the progress of a long computation of a plug-in.
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
