"""Public interface of percuss, a test bench that compares explicit contact-impact methods.

Read a case with ``load``, compute it with ``run`` and inspect the `Result`; to add a method, subclass one of the
component families. A plug-in may import only the names in ``__all__`` of this module and of `percuss.testing`. These
names are stable: `CONTRACT` is their version number, which increases when plug-ins have to change; see
`percuss.methods.interfaces` for the details. Every name is imported when it is first used.
"""

# This module imports nothing, not even from the standard library, until a name is used: the command has to put the path
# in order first. Type checkers take this variable for that of `typing`, and read each name where it is defined.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from percuss.case.case import Case as Case
    from percuss.case.case import load as load
    from percuss.certificate.maps import stability as stability
    from percuss.errors import InputError as InputError
    from percuss.errors import PercussError as PercussError
    from percuss.errors import PluginError as PluginError
    from percuss.errors import RefusedPair as RefusedPair
    from percuss.errors import RunError as RunError
    from percuss.heartbeat import progress as progress
    from percuss.methods.hookspecs import hookimpl as hookimpl
    from percuss.methods.interfaces import AllowInf as AllowInf
    from percuss.methods.interfaces import BodyEnd as BodyEnd
    from percuss.methods.interfaces import BodyMesh as BodyMesh
    from percuss.methods.interfaces import CellElement as CellElement
    from percuss.methods.interfaces import ContactLaw as ContactLaw
    from percuss.methods.interfaces import ContactPoints as ContactPoints
    from percuss.methods.interfaces import ContactProblem as ContactProblem
    from percuss.methods.interfaces import ContactState as ContactState
    from percuss.methods.interfaces import DataFile as DataFile
    from percuss.methods.interfaces import Doc as Doc
    from percuss.methods.interfaces import Element as Element
    from percuss.methods.interfaces import Exact as Exact
    from percuss.methods.interfaces import ExactContact as ExactContact
    from percuss.methods.interfaces import Floats as Floats
    from percuss.methods.interfaces import FollowingLoad as FollowingLoad
    from percuss.methods.interfaces import Ge as Ge
    from percuss.methods.interfaces import Gt as Gt
    from percuss.methods.interfaces import Implicit as Implicit
    from percuss.methods.interfaces import Integers as Integers
    from percuss.methods.interfaces import Integrator as Integrator
    from percuss.methods.interfaces import Le as Le
    from percuss.methods.interfaces import LeapFrog as LeapFrog
    from percuss.methods.interfaces import LinearLaw as LinearLaw
    from percuss.methods.interfaces import Load as Load
    from percuss.methods.interfaces import LoadedEnd as LoadedEnd
    from percuss.methods.interfaces import Lt as Lt
    from percuss.methods.interfaces import Lumping as Lumping
    from percuss.methods.interfaces import Mass as Mass
    from percuss.methods.interfaces import Material as Material
    from percuss.methods.interfaces import Measure as Measure
    from percuss.methods.interfaces import Mesh as Mesh
    from percuss.methods.interfaces import OptionError as OptionError
    from percuss.methods.interfaces import ProblemBody as ProblemBody
    from percuss.methods.interfaces import ProblemContact as ProblemContact
    from percuss.methods.interfaces import ProblemLoad as ProblemLoad
    from percuss.methods.interfaces import Region as Region
    from percuss.methods.interfaces import Shape as Shape
    from percuss.methods.interfaces import Solution as Solution
    from percuss.methods.interfaces import Stages as Stages
    from percuss.methods.interfaces import Trial as Trial
    from percuss.methods.interfaces import Unit as Unit
    from percuss.methods.interfaces import end_of_step as end_of_step
    from percuss.methods.slots import accelerations as accelerations
    from percuss.methods.slots import coupled_gap as coupled_gap
    from percuss.methods.slots import coupled_rate as coupled_rate
    from percuss.methods.slots import energy_density as energy_density
    from percuss.methods.slots import internal as internal
    from percuss.methods.slots import stress as stress
    from percuss.results.result import Result as Result
    from percuss.results.result import open_result as open_result
    from percuss.results.runner import run as run
    from percuss.solver.compiler.specialise import compiled_function as compiled_function
    from percuss.studies.comparison import compare as compare
    from percuss.studies.recommendation import recommend as recommend
    from percuss.studies.study import study as study
    from percuss.studies.study_table import Study as Study
    from percuss.studies.study_table import open_study as open_study
    from percuss.version import CONTRACT as CONTRACT
    from percuss.version import __version__ as __version__
else:
    _MODULES = {
        "case.case": "Case load",
        "studies.comparison": "compare",
        "methods.interfaces": (
            "AllowInf BodyEnd BodyMesh CellElement ContactLaw ContactPoints ContactProblem ContactState DataFile Doc "
            "Element Exact ExactContact Floats FollowingLoad Ge Gt Implicit Integers Integrator Le LeapFrog "
            "LinearLaw Load LoadedEnd Lt Lumping Mass Material Measure Mesh OptionError ProblemBody ProblemContact "
            "ProblemLoad Region Shape Solution Stages Trial Unit end_of_step"
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
        "version": "CONTRACT __version__",
    }
    _MODULE_OF = {name: module for module, names in _MODULES.items() for name in names.split()}

    __all__ = [name for name in _MODULE_OF if name != "__version__"]

    def __getattr__(name):
        """Return a public name, imported from its module when it is first used."""
        from importlib import import_module

        if name in _MODULE_OF:
            return getattr(import_module(f"percuss.{_MODULE_OF[name]}"), name)
        from percuss.version import CONTRACT

        raise AttributeError(f"module 'percuss' (contract {CONTRACT}) has no attribute {name!r}{_did_you_mean(name)}")

    def _did_you_mean(name):
        """Return a sentence that suggests the public name nearest to `name`; empty if none is similar."""
        from percuss.errors import nearest

        near = None if name.startswith("_") else nearest(name, __all__)
        return f". Did you mean '{near}'?" if near else ""

    def __dir__():
        """Return the names of the module, including those that are not imported yet."""
        return sorted([*globals(), *_MODULE_OF])
