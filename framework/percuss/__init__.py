"""percuss: a bench on which explicit contact-impact methods are compared.

The public door. ``load`` a case, ``run`` it, look at the `Result`; subclass a component family to bring a method.
What stands in ``__all__``, here and in `percuss.testing`, is all that a plug-in may import, and stable: `CONTRACT`
is its version, which grows when a plug-in has to change; `percuss.methods.interfaces` has the details. Everything is
imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"
CONTRACT = 2

_MODULES = {
    "case.case": "Case load",
    "studies.comparison": "compare",
    "methods.interfaces": (
        "AllowInf BodyMesh ContactLaw ContactPoints ContactState DataFile Doc Element Exact ExactContact Floats Ge Gt "
        "Integers Integrator Le LeapFrog LinearLaw Load Lt Mass Material Measure Mesh Region Shape Solution Stages "
        "Trial Unit end_of_step"
    ),
    "errors": "InputError PercussError PluginError RefusedPair RunError",
    "methods.hookspecs": "hookimpl",
    "methods.slots": "accelerations coupled_gap coupled_rate energy_density stress",
    "certificate.maps": "stability",
    "results.result": "Result open_result",
    "results.runner": "run",
    "studies.study": "Study open_study study",
}
_HOME = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "CONTRACT",
    "AllowInf",
    "BodyMesh",
    "Case",
    "ContactLaw",
    "ContactPoints",
    "ContactState",
    "DataFile",
    "Doc",
    "Element",
    "Exact",
    "ExactContact",
    "Floats",
    "Ge",
    "Gt",
    "InputError",
    "Integers",
    "Integrator",
    "Le",
    "LeapFrog",
    "LinearLaw",
    "Load",
    "Lt",
    "Mass",
    "Material",
    "Measure",
    "Mesh",
    "PercussError",
    "PluginError",
    "RefusedPair",
    "Region",
    "Result",
    "RunError",
    "Shape",
    "Solution",
    "Stages",
    "Study",
    "Trial",
    "Unit",
    "accelerations",
    "compare",
    "coupled_gap",
    "coupled_rate",
    "end_of_step",
    "energy_density",
    "hookimpl",
    "load",
    "open_result",
    "open_study",
    "run",
    "stability",
    "stress",
    "study",
]

if TYPE_CHECKING:
    from percuss.case.case import Case, load
    from percuss.certificate.maps import stability
    from percuss.errors import InputError, PercussError, PluginError, RefusedPair, RunError
    from percuss.methods.hookspecs import hookimpl
    from percuss.methods.interfaces import (
        AllowInf,
        BodyMesh,
        ContactLaw,
        ContactPoints,
        ContactState,
        DataFile,
        Doc,
        Element,
        Exact,
        ExactContact,
        Floats,
        Ge,
        Gt,
        Integers,
        Integrator,
        Le,
        LeapFrog,
        LinearLaw,
        Load,
        Lt,
        Mass,
        Material,
        Measure,
        Mesh,
        Region,
        Shape,
        Solution,
        Stages,
        Trial,
        Unit,
        end_of_step,
    )
    from percuss.methods.slots import accelerations, coupled_gap, coupled_rate, energy_density, stress
    from percuss.results.result import Result, open_result
    from percuss.results.runner import run
    from percuss.studies.comparison import compare
    from percuss.studies.study import Study, open_study, study


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module 'percuss' (contract {CONTRACT}) has no attribute {name!r}{_near(name)}")
    return getattr(import_module(f"percuss.{_HOME[name]}"), name)


def _near(name: str) -> str:
    from percuss.errors import nearest

    near = None if name.startswith("_") else nearest(name, __all__)
    return f". Did you mean '{near}'?" if near else ""


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
