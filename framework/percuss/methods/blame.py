"""Whose fault an error is: the file and line in a plug-in that it came from, and its text for the author."""

from __future__ import annotations

import importlib
import importlib.metadata
import inspect
import os
import re
import sys
import traceback
from pathlib import Path
from typing import Any

import pluggy

import percuss
from percuss.errors import PluginError, nearest
from percuss.files import PACKAGE

OWN = {"percuss", "percuss_methods"}
RENAMED = {"Rows": "LinearLaw", "Judged": "ContactState"}  # since contract 2
PLUGIN_MODULES: set[str] = set()  # top modules of all plug-ins that were loaded; the registry adds to it

_NAME_MISSING = re.compile(r"cannot import name '(\w+)' from '(percuss(?:\.\w+)*)'")


def line_in_plugin(error: BaseException) -> str:
    """Return ``file:line`` of the innermost call of an error that is in a plug-in of somebody else's, else nothing."""
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        module = frame.f_globals.get("__name__", "")
        if module.startswith("percuss_file_") or module.partition(".")[0] in PLUGIN_MODULES - OWN:
            return f"{frame.f_code.co_filename}:{line}"
    return ""


def place_of(error: BaseException, plugin: str) -> str:
    """Return ``file:line`` of the innermost call of an error inside a plug-in that was being loaded, else nothing.

    Parameters
    ----------
    error
        The error that the plug-in raised.
    plugin
        The file of the plug-in; empty where it is not known.
    """
    if isinstance(error, SyntaxError) and error.filename and Path(error.filename).is_file():
        return f"{error.filename}:{error.lineno}"
    packages: Any = (importlib, pluggy, sys.modules.get("importlib_metadata", pluggy))  # it takes over once imported
    own = str(PACKAGE) + os.sep
    machinery = ("<frozen", own, *(str(Path(one.__file__).parent) for one in packages))
    trace = ((step.filename, step.lineno) for step in traceback.extract_tb(error.__traceback__))
    steps = [step for step in trace if not step[0].startswith(machinery)]
    home = Path(plugin or (steps[0][0] if steps else ""))
    if not plugin and (home.parent / "__init__.py").exists():
        home = home.parent  # an installed package is all its files
    return next((f"{file}:{line}" for file, line in reversed(steps) if file.startswith(str(home))), "")


def begin_of(thing: Any) -> str:
    """Return ``file:line`` where a class or function begins, else nothing."""
    try:
        return f"{inspect.getsourcefile(thing)}:{inspect.getsourcelines(thing)[1]}"
    except (OSError, TypeError, SyntaxError):
        return ""


def described(error: BaseException) -> str:
    """Return the text of an error of a plug-in; a name that percuss does not have is answered with the nearest one."""
    text = error.msg if isinstance(error, SyntaxError) else str(error).strip()
    version = f"percuss {percuss.__version__} (contract {percuss.CONTRACT})"
    if isinstance(error, ModuleNotFoundError) and (error.name or "").startswith("percuss."):
        text = f"{version} has no module '{error.name}'; a plug-in imports from percuss and percuss.testing alone"
    elif isinstance(error, ImportError) and (missing := _NAME_MISSING.match(text)):
        name, module = missing.groups()
        near = nearest(name, getattr(sys.modules.get(module), "__all__", ()))
        advice = f"did you mean '{near}'?" if near else "was it written for another percuss?"
        advice = "it stands in percuss itself" if name in percuss.__all__ else advice
        advice = f"it is called `{RENAMED[name]}` since contract 2" if name in RENAMED else advice
        text = f"{version} has no '{name}' in {module}; {advice}"
    return text if isinstance(error, PluginError) else ": ".join(filter(None, (type(error).__name__, text)))
