"""percuss: a bench on which explicit contact-impact methods are compared.

The public door. ``load`` a case, ``run`` it, look at the `Result`; subclass a component family to bring a method.
Everything is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "Case": "case",
    "ContactLaw": "contracts",
    "Element": "contracts",
    "InputError": "errors",
    "Integrator": "contracts",
    "Load": "contracts",
    "Mass": "contracts",
    "Material": "contracts",
    "Measure": "contracts",
    "PercussError": "errors",
    "PluginError": "errors",
    "RefusedPair": "errors",
    "Result": "result",
    "RunError": "errors",
    "Shape": "contracts",
    "Solution": "contracts",
    "Study": "studies",
    "compare": "comparison",
    "hookimpl": "hookspecs",
    "load": "case",
    "open_result": "result",
    "open_study": "studies",
    "run": "runner",
    "stability": "maps",
    "study": "studies",
}

__all__ = [
    "Case",
    "ContactLaw",
    "Element",
    "InputError",
    "Integrator",
    "Load",
    "Mass",
    "Material",
    "Measure",
    "PercussError",
    "PluginError",
    "RefusedPair",
    "Result",
    "RunError",
    "Shape",
    "Solution",
    "Study",
    "compare",
    "hookimpl",
    "load",
    "open_result",
    "open_study",
    "run",
    "stability",
    "study",
]

if TYPE_CHECKING:
    from percuss.case import Case, load
    from percuss.comparison import compare
    from percuss.contracts import ContactLaw, Element, Integrator, Load, Mass, Material, Measure, Shape, Solution
    from percuss.errors import InputError, PercussError, PluginError, RefusedPair, RunError
    from percuss.hookspecs import hookimpl
    from percuss.maps import stability
    from percuss.result import Result, open_result
    from percuss.runner import run
    from percuss.studies import Study, open_study, study


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module 'percuss' has no attribute {name!r}")
    return getattr(import_module(f"percuss.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
