"""Location of an error in a plug-in by file and line, and the text of the error for the plug-in's author."""

from __future__ import annotations

import inspect
import re
import sys
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from percuss import version
from percuss.errors import PercussError, PluginError, RefusedPair, nearest

if TYPE_CHECKING:
    from percuss.methods.interfaces import Component

OWN_PACKAGES = {"percuss", "percuss_methods"}
PLUGIN_MODULES: set[str] = set()  # top-level modules of all plug-ins, from their import on; the registry adds to it

SINGULAR = {
    "integrators": "integrator",
    "contacts": "contact law",
    "frictions": "friction",
    "loads": "load",
    "shapes": "shape",
    "elements": "element",
    "materials": "material",
    "masses": "mass",
    "pairings": "pairing",
    "measures": "measure",
    "solutions": "exact solution",
}

# Errors of Python where a number is none, or has another shape than its reader expects.
OF_AN_ANSWER = (TypeError, ValueError, LookupError, AttributeError, ArithmeticError)
_NAME_MISSING = re.compile(r"cannot import name '(\w+)' from '(percuss(?:\.\w+)*)'")


@contextmanager
def plugin_faults() -> Iterator[None]:
    """Turn an error that a third-party plug-in raises inside this context into a PluginError with file and line.

    An answer of a plug-in that percuss cannot use may raise an error in percuss itself: then the files of the plug-ins
    are named. A refused pair, and the errors that percuss raises on purpose, stay as they are.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        where = line_in_plugin(error)
        unforeseen = isinstance(error, OF_AN_ANSWER) and not isinstance(error, PercussError)
        if not where and unforeseen and (files := third_party_files()):
            advice = "`percuss verify --plugin FILE` asks each answer of a plug-in."
            message = f"{described(error)}, where percuss used an answer of a plug-in. {advice}"
            raise PluginError(message, ", ".join(files)) from error
        (*_, (frame, _)) = traceback.walk_tb(error.__traceback__)
        of_percuss = isinstance(error, PercussError) and not is_third_party(frame.f_globals.get("__name__", ""))
        if not where or of_percuss or isinstance(error, RefusedPair):
            raise
        raise PluginError(described(error), where) from error


def third_party_files() -> list[str]:
    """Return the files of the modules of third-party plug-ins that are loaded."""
    modules = (module for name, module in list(sys.modules.items()) if is_third_party(name))
    return [file for module in modules if (file := getattr(module, "__file__", None))]


def described(error: BaseException) -> str:
    """Return the class and the text of an error."""
    text = str(error.msg if isinstance(error, SyntaxError) else error).strip()
    return ": ".join(filter(None, (type(error).__name__, text)))


def line_in_plugin(error: BaseException | None) -> str:
    """Return ``file:line`` of the innermost call of an error that lies in a third-party plug-in, or an empty text.

    Of an error without such a call the cause is asked: Python ends a generator that a StopIteration leaves with an
    error of its own.
    """
    if error is None:
        return ""
    return _innermost(reversed(list(traceback.walk_tb(error.__traceback__)))) or line_in_plugin(error.__cause__)


def said_by(error: ValueError) -> str:
    """Return the text of an error about options, with file and line of the third-party plug-in that raises it."""
    text = str(error).strip() or type(error).__name__
    where = line_in_plugin(error)
    # A method that percuss itself defines may be called from generated code, as that of a dataclass, which has no file.
    return text if not where or where.startswith("<") else f"{text} (raised in the plug-in {where})"


def _innermost(calls: Iterable[tuple[FrameType, int]]) -> str:
    """Return ``file:line`` of the first call that lies in a third-party plug-in, or an empty text."""
    for frame, line in calls:
        if is_third_party(frame.f_globals.get("__name__", "")):
            return f"{frame.f_code.co_filename}:{line}"
    return ""


def is_third_party(module: str) -> bool:
    """Return whether a module belongs to a plug-in that does not come with percuss."""
    return module.startswith("percuss_file_") or module.partition(".")[0] in PLUGIN_MODULES - OWN_PACKAGES


def is_foreign(component: Component) -> bool:
    """Return whether a method does not come with percuss."""
    return type(component).__module__.partition(".")[0] not in OWN_PACKAGES


def breach(component: Component, method: str, message: str, place: str = "") -> PluginError:
    """Return the error for a method of a component that does what its contract forbids.

    Parameters
    ----------
    component
        The component, with its family and its name.
    method
        Name of the method or kernel; its first line is the place of the error.
    message
        What it does, what is expected, and what to do.
    place
        Place of the error; by default the first line of the method.
    """
    place = place or definition_place(inspect.getattr_static(type(component), method, type(component)))
    return PluginError(f"{SINGULAR[component.family]} {component.name}: {message}", place)


def place_of(error: BaseException) -> str:
    """Return ``file:line`` of an error inside a plug-in that was being loaded, or an empty text."""
    if isinstance(error, PluginError) and error.place:
        return error.place
    if isinstance(error, SyntaxError) and error.filename and Path(error.filename).is_file():
        return f"{error.filename}:{error.lineno}"
    return line_in_plugin(error)


def definition_place(definition: Any) -> str:
    """Return ``file:line`` where a class or function is defined, or an empty text."""
    definition = plain_function(definition)
    try:
        return f"{inspect.getsourcefile(definition)}:{inspect.getsourcelines(definition)[1]}"
    except (OSError, TypeError, SyntaxError):
        return ""


def plain_function(attribute: Any) -> Any:
    """Return the function behind a static method or a compiled function; anything else as it is."""
    attribute = getattr(attribute, "__func__", attribute)
    return getattr(attribute, "py_func", attribute)


def error_text(error: BaseException) -> str:
    """Return the text of a plug-in's error; for a name that percuss does not have, suggest the nearest one."""
    if isinstance(error, PluginError):
        return str(error).removeprefix(f"{error.place}: ")
    text = str(error)
    present = f"percuss {version.__version__} (contract {version.CONTRACT})"
    if isinstance(error, ModuleNotFoundError) and (error.name or "").startswith("percuss."):
        text = f"{present} has no module '{error.name}'; a plug-in imports only from percuss and percuss.testing"
        return f"ModuleNotFoundError: {text}"
    if isinstance(error, ImportError) and (missing := _NAME_MISSING.match(text)):
        name, module = missing.groups()
        near = nearest(name, getattr(sys.modules.get(module), "__all__", ()))
        advice = f"did you mean '{near}'?" if near else "was it written for another percuss?"
        advice = "it stands in percuss itself" if name in sys.modules["percuss"].__all__ else advice
        return f"ImportError: {present} has no '{name}' in {module}; {advice}"
    return " ".join(described(error).split())
