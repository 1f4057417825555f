"""The methods that come with percuss, registered in the same way as those of any plug-in, with one line each."""

from percuss import hookimpl
from percuss_methods.contacts.bipenalty import Bipenalty
from percuss_methods.contacts.cohesive import Cohesive
from percuss_methods.contacts.damped_penalty import DampedPenalty
from percuss_methods.contacts.energy_conserving_penalty import EnergyConservingPenalty
from percuss_methods.contacts.hunt_crossley import HuntCrossley
from percuss_methods.contacts.lagrange import Lagrange
from percuss_methods.contacts.moreau_jean import MoreauJean
from percuss_methods.contacts.nitsche import Nitsche
from percuss_methods.contacts.paoli_schatzman import PaoliSchatzman
from percuss_methods.contacts.penalty import Penalty
from percuss_methods.contacts.regularised_lagrange import RegularisedLagrange
from percuss_methods.contacts.softened_penalty import SoftenedPenalty
from percuss_methods.contacts.tied import Tied
from percuss_methods.contacts.uzawa import Uzawa
from percuss_methods.contacts.walton_braun import WaltonBraun
from percuss_methods.elements.bar import BarElement
from percuss_methods.elements.green_bar import GreenBarElement
from percuss_methods.elements.hex8 import Hex8
from percuss_methods.elements.hex8_one_point import Hex8OnePoint
from percuss_methods.elements.quad4 import Quad4
from percuss_methods.elements.quad4_axisymmetric import Quad4Axisymmetric
from percuss_methods.elements.quad4_one_point import Quad4OnePoint
from percuss_methods.elements.quadratic_bar import QuadraticBarElement
from percuss_methods.elements.spectral_bar import SpectralBarElement
from percuss_methods.elements.tet4 import Tet4
from percuss_methods.elements.tri3 import Tri3
from percuss_methods.elements.tri3_axisymmetric import Tri3Axisymmetric
from percuss_methods.integrators.asynchronous import Asynchronous
from percuss_methods.integrators.central_difference import CentralDifference
from percuss_methods.integrators.chung_lee import ChungLee
from percuss_methods.integrators.explicit_hht import ExplicitHHT
from percuss_methods.integrators.explicit_newmark import ExplicitNewmark
from percuss_methods.integrators.hulbert_chung import HulbertChung
from percuss_methods.integrators.noh_bathe import NohBathe
from percuss_methods.integrators.tchamwa_wielgosz import TchamwaWielgosz
from percuss_methods.integrators.velocity_verlet import VelocityVerlet
from percuss_methods.integrators.viscous_central_difference import ViscousCentralDifference
from percuss_methods.integrators.wu_predictor_corrector import WuPredictorCorrector
from percuss_methods.loads.absorbing import Absorbing
from percuss_methods.loads.base_excitation import BaseExcitation
from percuss_methods.loads.constant import Constant
from percuss_methods.loads.gravity import Gravity
from percuss_methods.loads.half_sine import HalfSine
from percuss_methods.loads.harmonic import Harmonic
from percuss_methods.loads.prescribed_velocity import PrescribedVelocity
from percuss_methods.loads.ramp import Ramp
from percuss_methods.loads.spring_dashpot import SpringDashpot
from percuss_methods.loads.table import Table
from percuss_methods.masses.lumped import Lumped
from percuss_methods.masses.reciprocal import Reciprocal
from percuss_methods.masses.redistributed import Redistributed
from percuss_methods.masses.scaled import Scaled
from percuss_methods.materials.bilinear_plastic import BilinearPlastic
from percuss_methods.materials.elastic import Elastic
from percuss_methods.materials.ramberg_osgood import RambergOsgood
from percuss_methods.measures.ripple import Ripple
from percuss_methods.pairings.gauss_points import GaussPoints
from percuss_methods.pairings.mortar import Mortar
from percuss_methods.pairings.node_to_segment import NodeToSegment
from percuss_methods.shapes.ball import Ball
from percuss_methods.shapes.bar import Bar
from percuss_methods.shapes.block import Block
from percuss_methods.shapes.disk import Disk
from percuss_methods.shapes.half_disk import HalfDisk
from percuss_methods.shapes.mesh import MeshFromFile
from percuss_methods.shapes.ring import Ring
from percuss_methods.solutions.bars_in_a_row import BarsInARow


@hookimpl
def percuss_integrators() -> list[type]:
    """Return the built-in time integrators."""
    return [
        Asynchronous,
        CentralDifference,
        ChungLee,
        ExplicitHHT,
        ExplicitNewmark,
        HulbertChung,
        NohBathe,
        TchamwaWielgosz,
        VelocityVerlet,
        ViscousCentralDifference,
        WuPredictorCorrector,
    ]


@hookimpl
def percuss_contacts() -> list[type]:
    """Return the built-in contact laws."""
    return [
        Penalty,
        DampedPenalty,
        SoftenedPenalty,
        EnergyConservingPenalty,
        Bipenalty,
        Nitsche,
        Lagrange,
        RegularisedLagrange,
        Uzawa,
        PaoliSchatzman,
        MoreauJean,
        HuntCrossley,
        WaltonBraun,
        Tied,
        Cohesive,
    ]


@hookimpl
def percuss_pairings() -> list[type]:
    """Return the built-in pairings."""
    return [GaussPoints, Mortar, NodeToSegment]


@hookimpl
def percuss_loads() -> list[type]:
    """Return the built-in loads."""
    return [
        Constant,
        Ramp,
        Table,
        HalfSine,
        Harmonic,
        Gravity,
        PrescribedVelocity,
        BaseExcitation,
        Absorbing,
        SpringDashpot,
    ]


@hookimpl
def percuss_shapes() -> list[type]:
    """Return the built-in shapes."""
    return [Ball, Bar, Block, Disk, HalfDisk, MeshFromFile, Ring]


@hookimpl
def percuss_elements() -> list[type]:
    """Return the built-in elements."""
    return [
        BarElement,
        GreenBarElement,
        QuadraticBarElement,
        SpectralBarElement,
        Hex8,
        Hex8OnePoint,
        Quad4,
        Quad4Axisymmetric,
        Quad4OnePoint,
        Tet4,
        Tri3,
        Tri3Axisymmetric,
    ]


@hookimpl
def percuss_materials() -> list[type]:
    """Return the built-in materials."""
    return [Elastic, BilinearPlastic, RambergOsgood]


@hookimpl
def percuss_masses() -> list[type]:
    """Return the built-in mass matrices."""
    return [Lumped, Redistributed, Reciprocal, Scaled]


@hookimpl
def percuss_solutions() -> list[type]:
    """Return the built-in exact solutions."""
    return [BarsInARow]


@hookimpl
def percuss_measures() -> list[type]:
    """Return the built-in measures of a study."""
    return [Ripple]
