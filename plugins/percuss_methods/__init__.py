"""The methods that come with percuss, registered in the same way as those of any plug-in, with one line each."""

from percuss import hookimpl
from percuss_methods.contacts.bipenalty import Bipenalty
from percuss_methods.contacts.lagrange import Lagrange
from percuss_methods.contacts.penalty import Penalty
from percuss_methods.contacts.tied import Tied
from percuss_methods.elements.bar import BarElement
from percuss_methods.integrators.central_difference import CentralDifference
from percuss_methods.integrators.noh_bathe import NohBathe
from percuss_methods.integrators.wu_predictor_corrector import WuPredictorCorrector
from percuss_methods.loads.constant import Constant
from percuss_methods.loads.gravity import Gravity
from percuss_methods.loads.half_sine import HalfSine
from percuss_methods.loads.harmonic import Harmonic
from percuss_methods.loads.prescribed_velocity import PrescribedVelocity
from percuss_methods.loads.ramp import Ramp
from percuss_methods.loads.table import Table
from percuss_methods.masses.lumped import Lumped
from percuss_methods.materials.elastic import Elastic
from percuss_methods.measures.ripple import Ripple
from percuss_methods.shapes.bar import Bar
from percuss_methods.solutions.bars_in_a_row import BarsInARow


@hookimpl
def percuss_integrators() -> list[type]:
    """Return the built-in time integrators."""
    return [CentralDifference, NohBathe, WuPredictorCorrector]


@hookimpl
def percuss_contacts() -> list[type]:
    """Return the built-in contact laws."""
    return [Penalty, Bipenalty, Lagrange, Tied]


@hookimpl
def percuss_loads() -> list[type]:
    """Return the built-in load amplitudes."""
    return [Constant, Ramp, Table, HalfSine, Harmonic, Gravity, PrescribedVelocity]


@hookimpl
def percuss_shapes() -> list[type]:
    """Return the built-in shapes."""
    return [Bar]


@hookimpl
def percuss_elements() -> list[type]:
    """Return the built-in elements."""
    return [BarElement]


@hookimpl
def percuss_materials() -> list[type]:
    """Return the built-in materials."""
    return [Elastic]


@hookimpl
def percuss_masses() -> list[type]:
    """Return the built-in mass matrices."""
    return [Lumped]


@hookimpl
def percuss_solutions() -> list[type]:
    """Return the built-in exact solutions."""
    return [BarsInARow]


@hookimpl
def percuss_measures() -> list[type]:
    """Return the built-in measures of a study."""
    return [Ripple]
