"""Force and stress of single elements, from plain Python calls of the kernels of a body.

The material kernel is replaced by one that records the stress it returns. The stress is therefore the one behind the
element's force, whatever strain the element measures and whatever the element does with the stress.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.compiler.specialise import Specialiser
from percuss.mesh.cells import cells_of, is_solid, volumes_of
from percuss.mesh.material_points import plain_slots, points_at_rest
from percuss.methods import slots
from percuss.methods.blame import definition_place, described, line_in_plugin, plain_function
from percuss.methods.interfaces import CellElement, SolidElement
from percuss.methods.plugin_calls import answer

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.mesh.materials import MaterialPoints
    from percuss.methods.interfaces import BodyMesh, Element, Floats, Material


class ElementProbe:
    """Force and stress of single elements of one body.

    Parameters
    ----------
    element, material
        The methods of the body.
    mesh
        The body as `Element.bind` receives it.
    """

    def __init__(self, element: Element, material: Material, mesh: BodyMesh) -> None:
        self.dim = mesh.mesh.nodes.shape[1]
        volumes = np.array(volumes_of(element, mesh))
        self.points_of_element = volumes.shape[1]
        volumes[:, self.points_of_element - getattr(element, "hourglass_points", 0) :] = 0.0
        self.nodes_of_element = cells_of(mesh.mesh).shape[1]
        self._points = points_at_rest(element, material, mesh)
        self._element, self._material = element, material
        self._stresses: list[tuple[Any, Any, float]] = []  # of each call: stress, strain, and volume of its point
        maker = Specialiser(plain_slots(element, material), jit=False)
        slot: Any = slots.stress
        if isinstance(element, SolidElement):
            slot = slots.stress_2d if element.dimension == 2 else slots.stress_3d
        self._slot = slot
        stress: Callable[..., Any] = maker.bind(maker.slots[slot])
        self._shown = _cauchy_stress(element, material, mesh) if is_solid(element) else lambda value, _: float(value)

        def recorded_stress(points: MaterialPoints, point: int, strain: Any) -> Any:
            value = stress(points, point, strain)
            self._stresses.append((value, strain, float(volumes.flat[point])))
            return value

        specialiser = Specialiser({slot: recorded_stress}, jit=False)
        if isinstance(element, CellElement):
            self._force = _force_of_cell(element, mesh, specialiser)
        else:
            arrays, force = answer(element, "bind", mesh), specialiser.bind(element.internal_force)
            self._force = lambda points, number, u, f: force(arrays, points, number, self.dim, u, f)

    def force(self, number: int, displacement: Floats, state: Floats | None = None) -> Floats:
        """Return the force of an element on its nodes, (nodes of an element * dim,).

        Parameters
        ----------
        number
            Number of the element in the body.
        displacement : (nodes of an element * dim,) array
            Displacement of its nodes.
        state : (points of an element, state variables) array
            State variables of its material before the step; zeros where it is None.
        """
        self._stresses.clear()
        force = np.zeros(self.nodes_of_element * self.dim)
        points = self._points
        if state is not None:
            before = np.zeros_like(points.after)
            first = number * self.points_of_element
            before[first : first + self.points_of_element] = state
            points = points._replace(before=before)
        self._force(points, number, displacement, force)
        return force

    def fault(self, number: int, displacement: Floats) -> tuple[str, str]:
        """Return what a kernel does wrong in an element at a displacement, and where that stands; empty if nothing.

        Parameters are those of `force`.
        """
        try:
            force = self.force(number, displacement)
        except Exception as error:  # noqa: BLE001  a kernel may raise anything
            return f"a kernel raises {described(error)}", line_in_plugin(error)
        for stress, strain, _ in self._stresses:
            if np.isfinite(strain).all() and not np.isfinite(stress).all():
                said = (
                    f"material {self._material.name}: the stress is {_listed(stress)} at the strain {_listed(strain)}"
                )
                return said, definition_place(getattr(self._material, self._slot.__name__))
        if np.isfinite(force).all():
            return "", ""
        kernel = "force" if isinstance(self._element, CellElement) else "internal_force"
        said = f"the forces are {_listed(force)} at the displacements {_listed(displacement)}"
        return f"element {self._element.name}: {said}", definition_place(getattr(self._element, kernel))

    def stress(self, number: int, displacement: Floats, state: Floats | None = None) -> Any:
        """Return the stress in an element, the mean over its volume; of a solid element Cauchy's as a (3, 3) array.

        It is nan if the element does not call the stress kernel of its material. Parameters are those of `force`.
        """
        self.force(number, displacement, state)
        if not self._stresses:
            return np.nan
        values = np.array([self._shown(stress, strain) for stress, strain, _ in self._stresses])
        if self.points_of_element == 1:
            return np.mean(values, axis=0)
        volumes = np.array([volume for _, _, volume in self._stresses])
        return np.tensordot(volumes, values, 1) / volumes.sum()


def _listed(numbers: Any) -> str:
    return ", ".join(f"{number:.6g}" for number in np.atleast_1d(numbers))


def _cauchy_stress(element: Any, material: Any, mesh: BodyMesh) -> Callable[[Any, Any], Floats]:
    """Return Cauchy's stress, (3, 3), as a function of what a solid material returns and of the displacement gradient.

    Under small strains, as of linear bodies, it is what the material returns. The stress across a body in plane strain
    is that of the material in three dimensions, nan where it has no `stress_3d`. In plane stress the body keeps its
    thickness.
    """
    dim, linear, across = element.dimension, element.linear and material.linear, mesh.plane == "strain"
    parameters = (
        np.array(answer(material, "solid_parameters", ""), dtype=float) if across and material.stress_3d else None
    )
    in_three = plain_function(material.stress_3d) if parameters is not None else None

    def cauchy(value: Any, gradient: Any) -> Floats:
        stress = np.zeros((3, 3))
        stress[:dim, :dim] = np.reshape(value, (dim, dim))
        if across:
            whole = (gradient[0], gradient[1], 0.0, gradient[2], gradient[3], 0.0, 0.0, 0.0, 0.0)
            stress[2, 2] = np.nan if in_three is None else in_three(parameters, whole)[8]
        if linear:
            return stress
        stretch = np.eye(3)
        stretch[:dim, :dim] += np.reshape(gradient, (dim, dim))
        deformed: Floats = stress @ stretch.T / np.linalg.det(stretch)
        return deformed

    return cauchy


def _force_of_cell(element: CellElement, mesh: BodyMesh, specialiser: Specialiser) -> Callable[..., None]:
    """Return the force of single cells as a function of their points, number, displacement and, to be set, force."""
    force, rule, cells = specialiser.bind(element.force), answer(element, "rule"), cells_of(mesh.mesh)
    points_of_cell, geometry = volumes_of(element, mesh).shape[1], answer(element, "geometry", mesh)

    def force_of_cell(points: Any, number: int, displacement: Floats, nodal: Floats) -> None:
        shape = cells.shape[1], mesh.mesh.nodes.shape[1]
        first = number * points_of_cell
        force(rule, points, first, mesh.section, geometry[number], displacement.reshape(shape), nodal.reshape(shape))

    return force_of_cell
