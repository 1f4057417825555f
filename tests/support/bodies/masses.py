"""Mass matrices that leave nodes without mass."""

from dataclasses import dataclass
from typing import Annotated

from percuss import Doc, Mass, Unit


@dataclass(frozen=True)
class Moved(Mass):
    """Row-sum lumping whose ends give a share of their mass to their neighbours.

    Formula: ``M_0 = (1 - share) m_0 / 2``, and so at the other end.
    """

    name = "moved"
    summary = "Mass of the ends moved to their neighbours"
    references = ("Khenous, Laborde, Renard: Mass redistribution method, Eur. J. Mech. A 27 (2008)",)

    share: Annotated[float, Unit("1"), Doc("of the end mass that is moved")] = 1.0

    def nodal(self, element_mass, lumping):
        mass = lumping.at_nodes(element_mass)
        for end, inner in ((0, 1), (-1, -2)):
            moved = self.share * mass[end]
            mass[inner] += moved
            mass[end] -= moved
        return mass
