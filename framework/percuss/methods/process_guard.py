"""Guards around a process that runs plug-ins: what they print, change, close and end, and errors nobody catches."""

from __future__ import annotations

import contextlib
import functools
import gc
import inspect
import itertools
import locale
import operator
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any, TextIO

from percuss.errors import PluginError
from percuss.files import PACKAGE
from percuss.heartbeat import beat
from percuss.methods.blame import (
    assignment_place,
    definition_place,
    described,
    is_third_party,
    line_in_plugin,
    running_line,
)

MOST_FILES = 256  # numbers of open files that are looked at
MISSING = object()  # instead of a name that has been removed
Owner = ModuleType | type  # of names that others use
STREAMS = ("stdin", "stdout", "stderr")
STANDSTILL = 10.0  # seconds without a completed step after which the line of the plug-in is named

# Nothing in this folder prints: text that appears to come from here comes from a compiled kernel.
KERNELS_RUN_IN = str(PACKAGE / "step")
COMPILED = "a compiled kernel (NUMBA_DISABLE_JIT=1 shows its line)"


class _Output:
    """Standard output from which the text of plug-ins is passed on to standard error.

    Parameters
    ----------
    real
        The standard output.
    shown
        Whether the text of plug-ins is passed on; otherwise it is left out.
    """

    def __init__(self, real: TextIO, *, shown: bool) -> None:
        self._real, self._shown = real, shown
        self.places: dict[str, None] = {}

    def write(self, text: str) -> int:
        """Write a text to standard output, or to standard error if a plug-in wrote it."""
        place = _place_of(sys._getframe(1))
        if not place:
            return self._real.write(text)
        if place not in self.places:
            self.places[place] = None
            fate = "it is shown here" if self._shown else "its text is left out"
            print(f"note: {place} prints to standard output, which is for results; {fate}", file=sys.stderr)
        return sys.stderr.write(text) if self._shown else len(text)

    def close(self) -> None:
        """Leave the standard output open: what follows is printed there."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)


@contextmanager
def guarded_output(*, shown: bool = True) -> Iterator[None]:
    """Keep what plug-ins print inside this context from standard output; name each line of code that prints once.

    Parameters
    ----------
    shown
        Whether their text goes to standard error; otherwise it is left out.
    """
    guarded = isinstance(sys.stdout, _Output)
    with contextlib.nullcontext() if guarded else contextlib.redirect_stdout(_Output(sys.stdout, shown=shown)):
        yield


@contextmanager
def plug_ins_cannot_end_the_process() -> Iterator[None]:
    """Raise an error where a plug-in ends this process inside this context, or closes a file that was open before it.

    Without its files a process stands still, or can neither print nor say why it fails.
    """
    ours = dict(filter(None, map(_open_file, range(MOST_FILES))))
    real = {name: getattr(os, name) for name in ("_exit", "abort", "close", "closerange", "dup2")}

    def guarded(name: str, *arguments: Any, **options: Any) -> Any:
        where = running_line(sys._getframe(1))
        if where and name in {"_exit", "abort"}:
            raise SystemExit(*arguments)
        if where:
            first, *rest = (*arguments, *options.values())
            closed = range(first, *rest) if name == "closerange" else rest[:1] if name == "dup2" else [first]
            for number, file in ours.items():
                if number in closed and _open_file(number) == (number, file):
                    message = f"os.{name} closes file {number}, which percuss needs: close only what you open"
                    raise PluginError(message, where)
        return real[name](*arguments, **options)

    for name in real:
        setattr(os, name, functools.partial(guarded, name))
    try:
        yield
    finally:
        for name, function in real.items():
            setattr(os, name, function)


def _open_file(number: int) -> tuple[int, tuple[int, int]] | None:
    """Return the number of an open file and what identifies the file, or None if there is no open file."""
    try:
        status = os.fstat(number)
    except OSError:
        return None
    return number, (status.st_dev, status.st_ino)


def _folder() -> str:
    """Return the current folder, or an empty text if it has been removed."""
    try:
        return os.getcwd()  # noqa: PTH109
    except OSError:
        return ""


def _numpy_errors() -> dict[str, str]:
    """Return what numpy does about overflow and the like; nothing before a plug-in or percuss has imported it."""
    numpy = sys.modules.get("numpy")
    return dict(numpy.geterr()) if numpy is not None else {}


def _put_handler(handler: Any) -> None:
    """Put back the handler of Ctrl-C where a plug-in has replaced it; percuss itself does so once Ctrl-C has come."""
    now = signal.getsignal(signal.SIGINT)
    of_plugin = isinstance(now, signal.Handlers) or is_third_party(str(getattr(now, "__module__", "")))
    if of_plugin and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, handler)


# What a plug-in may change for all others: how it is read, and how it is put back.
STATES: tuple[tuple[Callable[[], Any], Callable[[Any], Any]], ...] = (
    (sys.getrecursionlimit, sys.setrecursionlimit),
    (sys.getswitchinterval, sys.setswitchinterval),
    (lambda: [(name, getattr(sys, name)) for name in STREAMS], lambda streams: vars(sys).update(streams)),
    (_numpy_errors, lambda errors: sys.modules["numpy"].seterr(**errors) if errors else None),
    (lambda: warnings.filters[:], lambda filters: vars(warnings).update(filters=filters)),
    (gc.isenabled, lambda enabled: gc.enable() if enabled else gc.disable()),
    (lambda: locale.setlocale(locale.LC_ALL), lambda name: locale.setlocale(locale.LC_ALL, name)),
    (lambda: signal.getsignal(signal.SIGINT), _put_handler),
    (_folder, lambda folder: os.chdir(folder) if folder else None),
)


@contextmanager
def process_as_before(*modules: str) -> Iterator[None]:
    """Put back what a plug-in inside this context changes in this process, and refuse one that overwrites a name.

    Names are those of Python, numpy and percuss that other methods use.

    Parameters
    ----------
    modules
        Modules, or their packages, whose code may run; if all come with percuss, nothing is looked at.

    Raises
    ------
    PluginError
        If a plug-in overwrites a name.
    """
    if not any(map(is_third_party, modules)):
        yield
        return
    beat()  # so that a silence from here on is one of the plug-in
    states = [(put, get()) for get, put in STATES]
    _NAMES.begin()
    try:
        yield
    finally:
        changed = _NAMES.put_back()
        for put, before in states:
            put(before)
        for owner, name, now in changed:
            if place := _culprit(name, now):  # and the cause of any error that has been raised
                message = f"overwrites {owner.__name__}.{name}, which others use too: take a name of your own"
                raise PluginError(message, place)
            setattr(owner, name, now) if now is not MISSING else delattr(owner, name)


class _Names:
    """The names that no plug-in may overwrite, as they were when the outermost context of `process_as_before` began.

    To copy nine thousand names for each run would take as long as many a run: they are copied where they have changed.
    """

    def __init__(self) -> None:
        self._open = 0  # contexts
        self._held: list[tuple[Owner, dict[str, object]]] = []  # by module or class
        self._views: list[Iterable[object]] = []  # of the objects of each as they are now
        self._values: list[object] = []  # of all objects then
        self._modules: list[str] = []  # that were loaded then

    def begin(self) -> None:
        """Hold the names as they are now, in the outermost context."""
        self._open += 1
        if self._open > 1:
            return
        if self._modules != list(sys.modules):
            self._modules = list(sys.modules)
            self._held = [(owner, dict(vars(owner))) for owner in _owners()]
        elif self._unchanged():
            return
        else:
            self._held = [(owner, dict(vars(owner)) if _differ(owner, held) else held) for owner, held in self._held]
        self._views = [vars(owner).values() for owner, _ in self._held]
        self._values = self._present()

    def _present(self) -> list[object]:
        """Return the objects under all names as they are now."""
        return list(itertools.chain.from_iterable(map(list, self._views)))

    def _unchanged(self) -> bool:
        """Return whether no name has come, gone or got another object: that is seen sooner than which one has."""
        present = self._present()
        return len(present) == len(self._values) and all(map(operator.is_, present, self._values))

    def put_back(self) -> list[tuple[Owner, str, object]]:
        """End a context; after the outermost, put back all names, and return those that were other objects."""
        self._open -= 1
        if self._open:
            return []
        changed = []
        for owner, held in () if self._unchanged() else self._held:
            for name, value in held.items() if _differ(owner, held) else ():
                if (now := vars(owner).get(name, MISSING)) is not value:
                    changed.append((owner, name, now))
                    setattr(owner, name, value)
        return changed


_NAMES = _Names()


def _differ(owner: Owner, values: Mapping[str, object]) -> bool:
    """Return whether a module or a class has another object under one of the names than it had."""
    return not all(map(operator.is_, map(vars(owner).get, values), values.values()))


def _owners() -> Iterator[Owner]:
    """Yield the modules and the classes whose names no plug-in may overwrite."""
    for key, module in list(sys.modules.items()):
        top = key.partition(".")[0]
        if top in {"builtins", "math", "numpy", "os", "percuss"} and "._" not in key and module is not None:
            yield module
            if top == "percuss":
                yield from (item for item in vars(module).values() if inspect.isclass(item) and item.__module__ == key)


def _culprit(name: str, value: object) -> str:
    """Return the place at which a plug-in overwrites a name, or an empty text if no plug-in does."""
    in_plugin = is_third_party(str(getattr(value, "__module__", "")))
    return assignment_place(name) or (definition_place(value) if in_plugin else "")


def tell_uncaught() -> None:
    """Tell an error of a plug-in that nothing can catch, as in a thread of its own or at the end, in one line."""
    told = set()

    def tell(usual: Callable[[Any], Any], arguments: Any) -> None:
        error = arguments.exc_value
        if error is None or not (where := line_in_plugin(error)):
            usual(arguments)
        elif where not in told:
            told.add(where)
            print(f"note: {where}: {described(error)}; nothing catches it here", file=sys.stderr, flush=True)

    threading.excepthook = functools.partial(tell, threading.excepthook)
    sys.unraisablehook = functools.partial(tell, sys.unraisablehook)


def _place_of(frame: FrameType) -> str:
    """Return the line of a plug-in that a call runs, or a text for compiled kernels, else an empty text."""
    in_step = Path(frame.f_code.co_filename).is_relative_to(KERNELS_RUN_IN)
    return running_line(frame) or (COMPILED if in_step else "")


def where_work_is() -> str:
    """Return the line of a plug-in at which the main thread is, or a text for compiled kernels, else an empty text."""
    frame = sys._current_frames().get(threading.main_thread().ident or 0)
    return _place_of(frame) if frame is not None else ""


def tell_standstill() -> None:
    """Say on standard error in which line of a plug-in the work of the main thread stands still, if it is in one."""
    if place := where_work_is():
        message = f"note: no step has been completed for {STANDSTILL:g} s; the work is in {place}; Ctrl-C ends it"
        print(message, file=sys.stderr, flush=True)
