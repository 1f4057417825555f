"""Routines of LAPACK, from the module in which SciPy compiles them."""

from __future__ import annotations

import functools
import importlib.util
import sys
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

MODULE = "_flapack"  # of the package scipy.linalg, whose module `lapack` passes its routines on
ROUTINES = ("dpttrf", "dpttrs", "dstebz", "dpbtrf", "dpbtrs")


@functools.cache
def lapack() -> Any:
    """Return the module of the routines, as `scipy.linalg.lapack` has them.

    Importing scipy.linalg takes longer than many a run, nearly all of it for other things. Its compiled module is
    therefore loaded alone; where a version of SciPy is built otherwise, scipy.linalg is imported.
    """
    alone = None if "scipy.linalg" in sys.modules else _loaded_alone()
    if alone is not None and all(hasattr(alone, name) for name in ROUTINES):
        return alone
    from scipy.linalg import lapack

    return lapack


def _loaded_alone() -> Any:
    """Return the compiled module, None if it is not found or cannot be loaded."""
    package = importlib.util.find_spec("scipy")
    folders = (package and package.submodule_search_locations) or ()
    spec = PathFinder.find_spec(MODULE, [str(Path(folder) / "linalg") for folder in folders])
    if spec is None or spec.loader is None:
        return None
    try:
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except ImportError:
        return None
    return module
