"""A linear bar whose force on its last node is too small: it takes momentum from nowhere."""

from dataclasses import dataclass

from percuss import Element
from percuss_methods.elements.bar import BarElement

bar_force = BarElement.internal_force


@dataclass(frozen=True)
class Leaking(Element):
    """A two-node bar but for its last node.

    Formula: ``force = A stress(strain) e``.
    """

    name = "leaking"
    summary = "Two-node bar"
    linear = True
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 1",)

    bind = BarElement.bind
    axial_stiffness = BarElement.axial_stiffness
    highest_frequency = BarElement.highest_frequency
    energy = staticmethod(BarElement.energy)

    @staticmethod
    def internal_force(element, material, first, dim, displacement, force):
        """Set `force` to the axial forces on the nodes, on the last one a hundredth too small."""
        bar_force(element, material, first, dim, displacement, force)
        force[-1] *= 0.99
