"""Location of an error in a plug-in by file and line, and the text of the error for the plug-in's author."""

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

from percuss import version
from percuss.errors import PluginError, nearest
from percuss.files import PACKAGE

OWN_PACKAGES = {"percuss", "percuss_methods"}
RENAMED = {"Rows": "LinearLaw", "Judged": "ContactState"}  # names that contract 2 changed
PLUGIN_MODULES: set[str] = set()  # top-level modules of all loaded plug-ins; the registry adds to it

_NAME_MISSING = re.compile(r"cannot import name '(\w+)' from '(percuss(?:\.\w+)*)'")


def line_in_plugin(error: BaseException) -> str:
    """Return ``file:line`` of the innermost call of an error that lies in a third-party plug-in, or an empty text."""
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        module = frame.f_globals.get("__name__", "")
        if module.startswith("percuss_file_") or module.partition(".")[0] in PLUGIN_MODULES - OWN_PACKAGES:
            return f"{frame.f_code.co_filename}:{line}"
    return ""


def place_of(error: BaseException, plugin: str) -> str:
    """Return ``file:line`` of the innermost call of an error inside a plug-in that was being loaded, or an empty text.

    Parameters
    ----------
    error
        The error that the plug-in raised.
    plugin
        The file of the plug-in; empty if it is not known.
    """
    if isinstance(error, SyntaxError) and error.filename and Path(error.filename).is_file():
        return f"{error.filename}:{error.lineno}"
    # importlib_metadata, once imported, takes over the finding of distributions.
    packages: Any = (importlib, pluggy, sys.modules.get("importlib_metadata", pluggy))
    percuss_folder = str(PACKAGE) + os.sep
    machinery = ("<frozen", percuss_folder, *(str(Path(package.__file__).parent) for package in packages))
    trace = ((frame.filename, frame.lineno) for frame in traceback.extract_tb(error.__traceback__))
    calls = [call for call in trace if not call[0].startswith(machinery)]
    home = Path(plugin or (calls[0][0] if calls else ""))
    if not plugin and (home.parent / "__init__.py").exists():
        home = home.parent  # An installed plug-in may be a package of several files.
    return next((f"{file}:{line}" for file, line in reversed(calls) if file.startswith(str(home))), "")


def definition_place(definition: Any) -> str:
    """Return ``file:line`` where a class or function is defined, or an empty text."""
    try:
        return f"{inspect.getsourcefile(definition)}:{inspect.getsourcelines(definition)[1]}"
    except (OSError, TypeError, SyntaxError):
        return ""


def error_text(error: BaseException) -> str:
    """Return the text of a plug-in's error; for a name that percuss does not have, suggest the nearest one."""
    text = error.msg if isinstance(error, SyntaxError) else str(error).strip()
    present = f"percuss {version.__version__} (contract {version.CONTRACT})"
    if isinstance(error, ModuleNotFoundError) and (error.name or "").startswith("percuss."):
        text = f"{present} has no module '{error.name}'; a plug-in imports from percuss and percuss.testing alone"
    elif isinstance(error, ImportError) and (missing := _NAME_MISSING.match(text)):
        name, module = missing.groups()
        near = nearest(name, getattr(sys.modules.get(module), "__all__", ()))
        advice = f"did you mean '{near}'?" if near else "was it written for another percuss?"
        advice = "it stands in percuss itself" if name in sys.modules["percuss"].__all__ else advice
        advice = f"it is called `{RENAMED[name]}` since contract 2" if name in RENAMED else advice
        text = f"{present} has no '{name}' in {module}; {advice}"
    return text if isinstance(error, PluginError) else ": ".join(filter(None, (type(error).__name__, text)))
