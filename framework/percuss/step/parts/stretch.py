"""The watch on the step of cells of finite strain, whose highest frequencies change as they deform.

The squared frequency of a cell is in proportion to the largest eigenvalue of ``A = sum of b b^T / m`` over its nodes, b
the gradient of the shape function of a node and m its mass in the cell. In the deformed cell b is ``F^-T b``. So the
frequency of a cell is its stretch r times that at the start, r^2 the largest ratio over its points of the eigenvalues
of ``F^-T A F^-1`` and A. The stiffness of the material is taken as that at rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from percuss.mesh.cell_kernels import Cells, cell_strain, gather, room
from percuss.mesh.cells import element_masses, element_slots, is_solid, lumping_of
from percuss.mesh.element_probe import ElementProbe
from percuss.record_arrays import Records, empty_records
from percuss.step.actions import AFTER_STEP, Action
from percuss.step.part import Part, Setting

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from percuss.contact.model import Model
    from percuss.mesh.body import Body
    from percuss.methods.interfaces import Floats, Integers

EVERY = 20  # steps from one look to the next
SHARE_OF_NEXT = 0.9  # of the Courant number that the stretch allows, with which a run should begin again
# The cell whose frequency came nearest to what the step allows.
WATCH = np.dtype(
    [
        ("courant", "f8"),  # its Courant number at the start times its stretch
        ("at_start", "f8"),  # its Courant number at the start
        ("stretch", "f8"),
        ("body", "i8"),  # its number in the block
        ("cell", "i8"),  # its number in the block
        ("time", "f8"),
        ("over", "i8"),  # 1 where the step is too long for it
    ]
)


class Watched(NamedTuple):
    """The cells of a block of bodies of finite strain."""

    cells: Cells
    start: Integers  # (bodies,) first node
    stop: Integers
    kind: Integers  # (cells,) row of `inertia`
    inertia: Floats  # (kinds, points, d, d) A of each point
    largest: Floats  # (kinds, points) its largest eigenvalue
    courant: Floats  # (cells,) Courant number at the start
    limit: float  # largest Courant number with which the run goes on
    inverse: Floats  # (d, d) work space
    product: Floats  # (d, d)
    now: Records  # percuss.step.records.NOW
    watch: Records  # (1,) WATCH


class Stretch(Part[Any]):
    """The part of a step that watches the frequencies of cells of finite strain.

    Parameters
    ----------
    data
        The blocks of such bodies, each with its element class and its bodies.
    """

    def __init__(self, data: Sequence[tuple[Watched, type, list[Body]]]) -> None:
        super().__init__(data)

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where no body is of finite strain."""
        model, now = setting.model, setting.step.now
        if before is not None:
            return cls([(one._replace(now=now), *rest) for one, *rest in before.data])
        found = []
        for block, element, _ in setting.blocks:
            bodies = [list(model.bodies.values())[k] for k in block.body.tolist()]
            if not model.multistage and is_solid(element) and not any(body.of_small_strains for body in bodies):
                found.append((_watched(model, block, bodies, now), type(element), bodies))
        return cls(found) if found else None

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        for watched, element, _ in self.data:
            yield Action(AFTER_STEP, find_stretch, watched, element_slots(element), order=1)

    def changing_arrays(self) -> list[Any]:
        """Return the watches."""
        return [watched.watch for watched, *_ in self.data]

    def stop(self, model: Model) -> tuple[int, str, str] | None:
        """Return node, observation and cause where the step is too long for a cell."""
        for watched, _, bodies in self.data:
            watch, limit = watched.watch[0], watched.limit
            if watch.over == 1:
                body, cell = bodies[watch.body], int(watch.cell - watched.cells.edges[watch.body])
                what = (
                    f"the step is too long for cell {cell} of body '{body.name}', whose highest frequency is "
                    f"{watch.stretch:.3g} times that at the start: its Courant number is {watch.courant:.3g}, and may "
                    f"be {limit:.3g}"
                )
                courant = SHARE_OF_NEXT * model.courant / watch.courant
                cause = f"start with a shorter step, `--set time.courant={courant:.2g}` or below"
                return int(body.element_nodes(np.array([cell]))[0, 0]), what, cause
        return None

    def sums(self) -> Mapping[str, Any]:
        """Return the cell whose frequency came nearest to what the step allows, as the summary has it."""
        watched, _, bodies = max(self.data, key=lambda one: float(one[0].watch[0].courant))
        watch = watched.watch[0]
        names = np.array([bodies[watch.body].name])
        cell = watch.cell - watched.cells.edges[watch.body]
        numbers = [watch.stretch, cell, watch.time, watch.at_start, watch.courant]
        return {"stretch": np.array(numbers, dtype=float), "stretched_body": names}


def _watched(model: Model, block: Any, bodies: list[Body], now: Records) -> Watched:
    """Return the cells of a block, at rest."""
    kinds: list[Integers] = []
    inertia: list[Floats] = []
    for body in bodies:
        numbers, kind = body.view.kinds
        probe = ElementProbe(body.spec.element, body.spec.material, body.view)
        slopes = probe.slopes(numbers, 1e-6 * body.shortest)
        masses = element_masses(body.spec.element, body.view, body.spec.material.rho)[:, None]
        mass = (lumping_of(body.spec.element, body.view).shares * masses)[numbers]
        kinds.append(kind + sum(map(len, inertia)))
        inertia.append(np.einsum("kqai,kqaj,ka->kqij", slopes, slopes, 1.0 / mass))
    whole = np.concatenate(inertia)
    courant = np.concatenate([0.5 * model.dt * body.frequency for body in bodies])
    limit = max(1.0, model.courant) if model.case.time.on_unstable == "stop" else np.inf
    return Watched(
        cells=block.element, start=block.start, stop=block.stop, kind=np.concatenate(kinds), inertia=whole,
        largest=np.array(np.linalg.eigvalsh(whole)[..., -1]), courant=courant, limit=limit,
        inverse=np.zeros(whole.shape[2:]), product=np.zeros(whole.shape[2:]), now=now,
        watch=empty_records(1, WATCH),
    )  # fmt: skip


# ------------------------------------------------------------------------------------------------------------- kernels


def find_stretch(data: Watched, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Find the cell whose frequency is nearest to what the step allows, every some steps."""
    if n % EVERY != 0:
        return
    cells, watch, dim = data.cells, data.watch[0], len(data.cells.axes)
    points = cells.volumes.shape[1] - cells.hourglass_points
    of_cell, unused = room(cells.corners, cells.axes), room(cells.corners, cells.axes)
    for b in range(data.start.size):
        lo, hi = data.start[b] * dim, data.stop[b] * dim
        for e in range(cells.edges[b], cells.edges[b + 1]):
            gather(cells, e, u[lo:hi], v[lo:hi], 0.0, of_cell)
            cell_strain(cells.rule, cells.strains[0], 0, cells.section[e], cells.geometry[e], of_cell, unused)
            square, k = 0.0, data.kind[e]
            for q in range(points):
                invert(cells.strains[0, q], data.inverse)
                turned(data.inertia[k, q], data.inverse, data.product)
                square = max(square, largest_eigenvalue(data.product) / data.largest[k, q])
            stretch = math.sqrt(square)
            courant = stretch * data.courant[e]
            if courant > watch.courant:
                watch.courant, watch.at_start, watch.stretch = courant, data.courant[e], stretch
                watch.body, watch.cell, watch.time = b, e, data.now[0].time
    if watch.courant > data.limit:
        watch.over = 1
        data.now[0].solved = 0


def invert(gradient: Floats, inverse: Floats) -> None:
    """Set the inverse of the deformation gradient I + H, row by row."""
    if inverse.shape[0] == 2:
        xx, xy, yx, yy = 1.0 + gradient[0], gradient[1], gradient[2], 1.0 + gradient[3]
        volume = xx * yy - xy * yx
        inverse[0, 0], inverse[0, 1], inverse[1, 0], inverse[1, 1] = (
            yy / volume,
            -xy / volume,
            -yx / volume,
            xx / volume,
        )
        return
    for i in range(3):
        for j in range(3):
            p, q, r, s = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            one, two = stretched(gradient, p, r) * stretched(gradient, q, s), stretched(gradient, p, s)
            inverse[i, j] = one - two * stretched(gradient, q, r)
    volume = 0.0
    for k in range(3):
        volume += stretched(gradient, 0, k) * inverse[k, 0]
    for i in range(3):
        for j in range(3):
            inverse[i, j] /= volume


def stretched(gradient: Floats, i: int, j: int) -> float:
    """Return an entry of the deformation gradient in three dimensions."""
    return gradient[3 * i + j] + (1.0 if i == j else 0.0)  # type: ignore[no-any-return]


def turned(inertia: Floats, inverse: Floats, product: Floats) -> None:
    """Set the product F^-T A F^-1."""
    dim = inverse.shape[0]
    for i in range(dim):
        for j in range(dim):
            product[i, j] = 0.0
            for k in range(dim):
                for m in range(dim):
                    product[i, j] += inverse[k, i] * inertia[k, m] * inverse[m, j]


def largest_eigenvalue(matrix: Floats) -> float:
    """Return the largest eigenvalue of a symmetric matrix of two or three rows."""
    if matrix.shape[0] == 2:
        mean, half = 0.5 * (matrix[0, 0] + matrix[1, 1]), 0.5 * (matrix[0, 0] - matrix[1, 1])
        return mean + math.sqrt(half * half + matrix[0, 1] * matrix[0, 1])  # type: ignore[no-any-return]
    mean = (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) / 3.0
    xx, yy, zz = matrix[0, 0] - mean, matrix[1, 1] - mean, matrix[2, 2] - mean
    xy, xz, yz = matrix[0, 1], matrix[0, 2], matrix[1, 2]
    size = math.sqrt((xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    if size == 0.0:
        return mean  # type: ignore[no-any-return]
    det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    angle = math.acos(min(1.0, max(-1.0, 0.5 * det / size**3))) / 3.0
    return mean + 2.0 * size * math.cos(angle)  # type: ignore[no-any-return]
