"""Interfaces of the component families: the attributes and functions of each method, with shapes and units.

A component is a frozen dataclass. Its fields are its options, filled from YAML; validation, schema and help read the
bounds and units in their ``Annotated`` types. Facts about the class (`name`, `summary`, `references`, ...) are plain
class attributes. Values that depend on a model or on the time step belong in `bind`, never in the options.

A kernel is a static method that the time loop calls. It is compiled if possible. It may read its arguments and
module-level constants and call plain helper functions, and it keeps nothing between calls.
"""

from annotated_types import Ge, Gt, Le, Lt

from percuss.methods.interfaces.base import (
    NAME_PATTERN,
    AllowInf,
    Array,
    Component,
    DataFile,
    Doc,
    Floats,
    Integers,
    MeshFile,
    OptionError,
    Unit,
)
from percuss.methods.interfaces.body import (
    BodyMesh,
    CellElement,
    Element,
    Line,
    Lumping,
    Mass,
    Material,
    Mesh,
    Region,
    Shape,
    SolidElement,
    SolidMaterial,
)
from percuss.methods.interfaces.cells import REFERENCE_CELLS, ReferenceCell
from percuss.methods.interfaces.contact import ContactLaw, ContactPoints, LinearLaw, Trial
from percuss.methods.interfaces.friction import Friction, FrictionPoints, Stiffness
from percuss.methods.interfaces.integrator import ContactState, Integrator, LeapFrog, Stages, end_of_step
from percuss.methods.interfaces.load import FollowingLoad, Load, LoadedEnd
from percuss.methods.interfaces.measure import Measure
from percuss.methods.interfaces.pairing import (
    FacingSurfaces,
    PairedPoints,
    Pairing,
    Places,
    RenewedPoints,
    Surface,
    Wall,
)
from percuss.methods.interfaces.problem import BodyEnd, ContactProblem, ProblemBody, ProblemContact, ProblemLoad
from percuss.methods.interfaces.solution import Exact, ExactContact, Solution

FAMILIES: dict[str, type[Component]] = {
    contract.family: contract
    for contract in (Integrator, ContactLaw, Friction, Pairing, Load, Shape, Element, Material, Mass, Solution, Measure)
}
