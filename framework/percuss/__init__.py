"""Public interface of percuss, a test bench that compares explicit contact-impact methods.

Read a case with ``load``, compute it with ``run`` and inspect the `Result`; to add a method, subclass one of the
component families. A plug-in may import only the names in ``__all__`` of this module and of `percuss.testing`. These
names are stable: `CONTRACT` is their version number, which increases when plug-ins have to change; see
`percuss.methods.interfaces` for the details. Every name is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from percuss.version import CONTRACT
from percuss.version import __version__ as __version__

_MODULES = {
    "case.case": "Case load",
    "studies.comparison": "compare",
    "methods.interfaces": (
        "AllowInf BodyEnd BodyMesh CellElement ContactLaw ContactPoints ContactProblem ContactState DataFile Doc "
        "Element Exact ExactContact Floats FollowingLoad Ge Gt Implicit Integers Integrator Le LeapFrog LinearLaw Load "
        "LoadedEnd Lt Lumping Mass Material Measure Mesh OptionError "
        "ProblemBody ProblemContact ProblemLoad Region Shape Solution Stages Trial Unit end_of_step"
    ),
    "heartbeat": "progress",
    "errors": "InputError PercussError PluginError RefusedPair RunError",
    "methods.hookspecs": "hookimpl",
    "methods.slots": "accelerations coupled_gap coupled_rate energy_density internal stress",
    "certificate.maps": "stability",
    "results.result": "Result open_result",
    "results.runner": "run",
    "solver.compiler.specialise": "compiled_function",
    "studies.recommendation": "recommend",
    "studies.study": "study",
    "studies.study_table": "Study open_study",
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "CONTRACT",
    "AllowInf",
    "BodyEnd",
    "BodyMesh",
    "Case",
    "CellElement",
    "ContactLaw",
    "ContactPoints",
    "ContactProblem",
    "ContactState",
    "DataFile",
    "Doc",
    "Element",
    "Exact",
    "ExactContact",
    "Floats",
    "FollowingLoad",
    "Ge",
    "Gt",
    "Implicit",
    "InputError",
    "Integers",
    "Integrator",
    "Le",
    "LeapFrog",
    "LinearLaw",
    "Load",
    "LoadedEnd",
    "Lt",
    "Lumping",
    "Mass",
    "Material",
    "Measure",
    "Mesh",
    "OptionError",
    "PercussError",
    "PluginError",
    "ProblemBody",
    "ProblemContact",
    "ProblemLoad",
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
    "compiled_function",
    "coupled_gap",
    "coupled_rate",
    "end_of_step",
    "energy_density",
    "hookimpl",
    "internal",
    "load",
    "open_result",
    "open_study",
    "progress",
    "recommend",
    "run",
    "stability",
    "stress",
    "study",
]

if TYPE_CHECKING:
    from percuss.case.case import Case, load
    from percuss.certificate.maps import stability
    from percuss.errors import InputError, PercussError, PluginError, RefusedPair, RunError
    from percuss.heartbeat import progress
    from percuss.methods.hookspecs import hookimpl
    from percuss.methods.interfaces import (
        AllowInf,
        BodyEnd,
        BodyMesh,
        CellElement,
        ContactLaw,
        ContactPoints,
        ContactProblem,
        ContactState,
        DataFile,
        Doc,
        Element,
        Exact,
        ExactContact,
        Floats,
        FollowingLoad,
        Ge,
        Gt,
        Implicit,
        Integers,
        Integrator,
        Le,
        LeapFrog,
        LinearLaw,
        Load,
        LoadedEnd,
        Lt,
        Lumping,
        Mass,
        Material,
        Measure,
        Mesh,
        OptionError,
        ProblemBody,
        ProblemContact,
        ProblemLoad,
        Region,
        Shape,
        Solution,
        Stages,
        Trial,
        Unit,
        end_of_step,
    )
    from percuss.methods.slots import accelerations, coupled_gap, coupled_rate, energy_density, internal, stress
    from percuss.results.result import Result, open_result
    from percuss.results.runner import run
    from percuss.solver.compiler.specialise import compiled_function
    from percuss.studies.comparison import compare
    from percuss.studies.recommendation import recommend
    from percuss.studies.study import study
    from percuss.studies.study_table import Study, open_study


def __getattr__(name: str) -> Any:
    """Return a public name, imported from its module when it is first used."""
    from importlib import import_module

    if name not in _MODULE_OF:
        raise AttributeError(f"module 'percuss' (contract {CONTRACT}) has no attribute {name!r}{_did_you_mean(name)}")
    return getattr(import_module(f"percuss.{_MODULE_OF[name]}"), name)


def _did_you_mean(name: str) -> str:
    """Return a sentence that suggests the public name nearest to `name`; empty if none is similar."""
    from percuss.errors import nearest

    near = None if name.startswith("_") else nearest(name, __all__)
    return f". Did you mean '{near}'?" if near else ""


def __dir__() -> list[str]:
    """Return the names of the module, including those that are not imported yet."""
    return sorted([*globals(), *_MODULE_OF])
