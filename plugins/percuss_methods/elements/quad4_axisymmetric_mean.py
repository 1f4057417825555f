"""The four-node quadrilateral of a body of revolution, whose volume strain is a mean."""

from __future__ import annotations

from dataclasses import dataclass

from percuss_methods.elements._full_cell import RingCell
from percuss_methods.elements._mean_dilatation import ring_forces
from percuss_methods.elements.quad4 import Quad4


@dataclass(frozen=True)
class Quad4AxisymmetricMean(RingCell):
    """Bilinear quadrilateral about the axis x = 0, as `quad4-axisymmetric`, with a mean volume strain.

    Formula: the material sees ``F' = (Jm / J)^(1/3) F``, ``Jm = sum V J / sum V`` over the points of the cell, and the
    forces are the slopes of ``sum V Psi(F')``.

    It does not lock where a material flows or is almost incompressible. Strains may be of any size.
    """

    name = "quad4-axisymmetric-mean"
    summary = "Four-node quadrilateral of a body of revolution, mean dilatation"
    cell = "quad"
    dimension = 3
    isochoric = True
    references = (
        "Nagtegaal, Parks, Rice: On numerically accurate finite element solutions in the fully plastic range, Comput. "
        "Methods Appl. Mech. Engrg. 4 (1974), doi 10.1016/0045-7825(74)90032-2",
        "Simo, Taylor, Pister: Variational and projection methods for the volume constraint in finite deformation "
        "elasto-plasticity, Comput. Methods Appl. Mech. Engrg. 51 (1985), doi 10.1016/0045-7825(85)90033-7",
    )
    shapes, slopes, weights = Quad4.shapes, Quad4.slopes, Quad4.weights
    force = staticmethod(ring_forces)
