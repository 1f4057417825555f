"""Strips of four-node squares with contact rows over several nodes, marched by the loop of percuss itself.

Everything here is handed to the loop as data: a cell element of its own, blocks, masses, and rows of N that a test
makes. No body of it is a line.
"""

import itertools
from typing import NamedTuple

import numpy as np

from percuss import CellElement, Mesh, stress
from percuss.compiler.record_arrays import empty_records, record_array
from percuss.contact.bound_law import bind_law
from percuss.contact.contact_rows import Side, delassus_rows, law_records, point_records
from percuss.contact.points import NOTHING
from percuss.mesh.block import Block
from percuss.mesh.cells import cell_arrays, element_slots
from percuss.mesh.materials import material_slots
from percuss.methods.interfaces import BodyMesh, ContactPoints
from percuss.methods.registry import Registry
from percuss.step import bulk, loop, stages
from percuss.step.actions import BULK, INTERNAL_FORCES, KINETIC_ENERGY, STRAIN_ENERGY, Action
from percuss.step.build import Scheme, kernels
from percuss.step.integrator_check import ends_of, kernel_of, table_of_stage, unchecked_scheme
from percuss.step.record import ENERGIES, Record
from percuss.step.records import BOUNDARY_DOF, CONSTRAINT, NODAL_FORCE, NOW, SHARE, TOTAL, Loads, Step

REGISTRY = Registry.load()
GAUSS = 1.0 / np.sqrt(3.0)
DIM = 2


class Rule(NamedTuple):
    xi: np.ndarray  # (points, 2)
    corners: np.ndarray  # (4, 2)


class Square(CellElement):
    """A bilinear quadrilateral without lateral contraction: each strain has a stress of its own.

    A quadrature point asks the material three times: for both direct strains, and for the shear, whose stress is half
    of the modulus times the shear strain.
    """

    name = "square"
    summary = "Bilinear quadrilateral without lateral contraction"
    examples = ({},)
    linear = True
    cell = "quad"

    def rule(self):
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return Rule(GAUSS * corners, corners)

    def mass_shares(self, body):
        return np.full(4, 0.25)

    def volumes(self, body):
        corners = body.mesh.nodes[body.mesh.cells["quad"]]
        across, up = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
        area = across[:, 0] * up[:, 1] - across[:, 1] * up[:, 0]
        return body.section * area[:, None] / 4 * np.tile([1.0, 1.0, 0.5], 4)

    def highest_frequency(self, body, wave_speed):
        raise NotImplementedError

    @staticmethod
    def force(rule, material, first, section, coordinates, displacement, force):
        for a in range(4):
            force[a, 0] = 0.0
            force[a, 1] = 0.0
        for q in range(4):
            xx = xy = yx = yy = 0.0
            for a in range(4):
                by_xi = 0.25 * rule.corners[a, 0] * (1.0 + rule.xi[q, 1] * rule.corners[a, 1])
                by_eta = 0.25 * rule.corners[a, 1] * (1.0 + rule.xi[q, 0] * rule.corners[a, 0])
                xx += by_xi * coordinates[a, 0]
                xy += by_xi * coordinates[a, 1]
                yx += by_eta * coordinates[a, 0]
                yy += by_eta * coordinates[a, 1]
            determinant = xx * yy - xy * yx
            direct_x = direct_y = shear = 0.0
            for a in range(4):
                by_xi = 0.25 * rule.corners[a, 0] * (1.0 + rule.xi[q, 1] * rule.corners[a, 1])
                by_eta = 0.25 * rule.corners[a, 1] * (1.0 + rule.xi[q, 0] * rule.corners[a, 0])
                by_x = (yy * by_xi - xy * by_eta) / determinant
                by_y = (xx * by_eta - yx * by_xi) / determinant
                direct_x += by_x * displacement[a, 0]
                direct_y += by_y * displacement[a, 1]
                shear += by_y * displacement[a, 0] + by_x * displacement[a, 1]
            stress_x = stress(material, first + 3 * q, direct_x)
            stress_y = stress(material, first + 3 * q + 1, direct_y)
            stress_xy = 0.5 * stress(material, first + 3 * q + 2, shear)
            for a in range(4):
                by_xi = 0.25 * rule.corners[a, 0] * (1.0 + rule.xi[q, 1] * rule.corners[a, 1])
                by_eta = 0.25 * rule.corners[a, 1] * (1.0 + rule.xi[q, 0] * rule.corners[a, 0])
                by_x = (yy * by_xi - xy * by_eta) / determinant
                by_y = (xx * by_eta - yx * by_xi) / determinant
                force[a, 0] -= section * determinant * (by_x * stress_x + by_y * stress_xy)
                force[a, 1] -= section * determinant * (by_y * stress_y + by_x * stress_xy)


class Strip(NamedTuple):
    """A rectangle of nx by ny cells, its nodes column by column."""

    nx: int
    ny: int
    length: float
    height: float
    at: float
    velocity: float

    @property
    def nodes(self):
        x = self.at + self.length * np.arange(self.nx + 1) / self.nx
        y = self.height * np.arange(self.ny + 1) / self.ny
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)

    @property
    def cells(self):
        corner = np.arange(self.nx)[:, None] * (self.ny + 1) + np.arange(self.ny)
        return np.stack([corner, corner + self.ny + 1, corner + self.ny + 2, corner + 1], axis=-1).reshape(-1, 4)

    @property
    def mass(self):
        quarter = 0.25 * self.length / self.nx * self.height / self.ny
        return np.bincount(self.cells.ravel(), minlength=len(self.nodes)) * quarter

    def end(self, *, right):
        """The nodes of the right or left end, from below."""
        first = self.nx * (self.ny + 1) if right else 0
        return first + np.arange(self.ny + 1)


class Row(NamedTuple):
    """A contact point: coefficients of N of nodes along x, its gap and its share of the surface."""

    normal: dict  # node: (2,)
    gap: float
    weight: float


class Marched(NamedTuple):
    """The state after all steps, and the histories."""

    u: np.ndarray  # (nodes, 2)
    v: np.ndarray  # (nodes, 2)
    record: Record
    totals: np.recarray
    mass: np.ndarray  # (nodes,)
    kinetic_before: float
    done: int

    def ledger(self):
        """The largest error of the energy balance over the energy put in."""
        energy = self.record.energy
        before = float(self.totals.energy_before[0])
        error = energy.kinetic_energy + energy.elastic_energy - energy.contact_work - before
        return float(np.abs(error).max() / max(before, np.abs(energy.contact_work).max()))


def hat(y, count, height):
    """The linear shape functions of an end of `count` cells at the height y, by number of node."""
    cell = min(int(y / height * count), count - 1)
    upper = y / height * count - cell
    return {cell: 1.0 - upper, cell + 1: upper}


def rows_between(left, right, places, gap=0.0):
    """Rows of the points at some heights, each with its weight, between the ends of two strips."""
    first, rows = len(left.nodes), []
    for y, weight in places:
        normal = {}
        for k, value in hat(y, left.ny, left.height).items():
            normal[int(left.end(right=True)[k])] = np.array([-value, 0.0])
        for k, value in hat(y, right.ny, right.height).items():
            normal[first + int(right.end(right=False)[k])] = np.array([value, 0.0])
        rows.append(Row({node: n for node, n in normal.items() if n.any()}, gap, weight))
    return rows


def at_nodes(strip):
    """Heights and weights of the nodes of an end."""
    h = strip.height / strip.ny
    return [(k * h, h * (0.5 if k in {0, strip.ny} else 1.0)) for k in range(strip.ny + 1)]


def at_gauss_points(edges):
    """Heights and weights of two Gauss points between each two of some heights."""
    places = []
    for low, high in itertools.pairwise(edges):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        places += [(middle - GAUSS * half, half), (middle + GAUSS * half, half)]
    return places


def cuts(left, right):
    """The heights of the nodes of both ends."""
    fine = {round(k / end.ny, 12) for end in (left, right) for k in range(end.ny + 1)}
    return [left.height * share for share in sorted(fine)]


def contact_points(rows, sides, element):
    """What a law is told of the points: EA/h, 2c/h and rho A h / 2 with the area of each point."""
    diagonal, others = delassus_rows(sides)
    weight = np.array([row.weight for row in rows])
    coupling = [1.0 + sum(map(abs, row.values())) / s for row, s in zip(others, diagonal, strict=True)]
    return ContactPoints(
        names=tuple(f"p{k}" for k in range(len(rows))), stiffness=weight / element,
        frequency=np.full(len(rows), 2.0 / element), mass=0.5 * element * weight,
        equal_sides=np.ones(len(rows), dtype=bool), delassus=diagonal, coupling=np.array(coupling), weight=weight,
        limits=lambda: np.full(len(rows), np.inf),
    )  # fmt: skip


def march(strips, rows, integrator, law, dt, steps, *, compiled=True, further=lambda step: ()):
    """March strips with contact rows; `further` returns more actions of a step."""
    starts = np.cumsum([0, *(len(strip.nodes) for strip in strips)])
    mass = np.concatenate([strip.mass for strip in strips])
    meshes = [Mesh(s.nodes, {"quad": s.cells}, {}) for s in strips]
    element, material = Square(), REGISTRY.get("materials", "elastic")(young=1.0, density=1.0)
    arrays = cell_arrays(element, [BodyMesh(mesh, 1.0) for mesh in meshes])
    nothing = np.zeros((arrays.volumes.size, 0))
    numbers = np.arange(len(strips))
    block = Block(arrays, np.ones((len(strips), 1)), numbers, starts[:-1], starts[1:], 0 * numbers, nothing, nothing)
    place = {node: DIM * k for k, node in enumerate(dict.fromkeys(node for row in rows for node in row.normal))}
    sides = [[Side(node, n, n / mass[node]) for node, n in row.normal.items()] for row in rows]
    made = REGISTRY.get("integrators", integrator)()
    definition, tables = unchecked_scheme(made, dt)
    points_of_law = contact_points(rows, sides, strips[0].length / strips[0].nx)
    bound = bind_law(law, tuple(range(len(rows))), points_of_law, dt)
    records = law_records(bound, tables[-1], points_of_law.delassus)
    if definition is not None:
        records["stores"] = NOTHING
    points = point_records(records, range(len(rows)), [row.gap for row in rows], sides, place)
    dofs = [(DIM * node + d, mass[node], 0, *([0.0] * 6)) for node in place for d in range(DIM)]
    boundary, totals, now = record_array(dofs, BOUNDARY_DOF), empty_records(1, TOTAL), empty_records(1, NOW)
    now["dt"], now["span"], now["dim"], now["gap_response"], now["rate_response"] = dt, dt, DIM, dt * dt, dt
    columns, bodies = 1, DIM * len(strips)
    amplitudes = np.zeros(2 * columns + bodies if definition is None else columns)
    loads = Loads(
        record_array([], CONSTRAINT), record_array([], SHARE), record_array([], NODAL_FORCE), np.zeros(0), amplitudes,
        np.zeros(bodies), np.zeros(0), np.zeros(0),
    )  # fmt: skip
    inverse, size = np.repeat(1.0 / mass, DIM), DIM * len(mass)
    data = bulk.Bulk(
        block, np.repeat(mass, DIM), inverse, np.zeros(size), loads.accelerations, np.zeros(DIM), loads.momentum,
        totals, DIM, dt, dt if definition is None else 0.0, (),
    )  # fmt: skip
    slots = {
        **material_slots(type(material)), **element_slots(Square), bulk.advance_body: bulk.advance_cells,
        bulk.energy_of_body: bulk.energy_of_cell_body,
    }  # fmt: skip
    step = Step(boundary, points, loads, totals, now, None)
    actions = [
        Action(KINETIC_ENERGY, bulk.add_kinetic_energy, bulk.Masses(data.mass, totals)),
        Action(STRAIN_ENERGY, bulk.add_strain_energy, data, slots),
        Action(BULK, bulk.advance_block, data, slots)
        if definition is None
        else Action(INTERNAL_FORCES, bulk.set_forces_of_cells, data, slots),
        *further(step),
    ]
    how = kernels(compiled=compiled)
    step = step._replace(actions=how.linked(actions))
    record = Record(
        1, steps, *(np.full((steps, len(rows)), np.nan) for _ in range(3)), np.zeros((steps, 0)), np.zeros((steps, 0)),
        np.zeros(0, dtype=np.int64), empty_records(steps, ENERGIES), 0, np.zeros((0, 0)), np.zeros(0, dtype=np.int64),
    )  # fmt: skip
    extra = 0 if definition is None else len(rows) + columns
    u, v = np.zeros(size + extra), np.zeros(size + extra)
    for strip, start, stop in zip(strips, starts, starts[1:], strict=False):
        v[DIM * start : DIM * stop : DIM] = strip.velocity
    kinetic = 0.5 * float(data.mass @ v[:size] ** 2)
    totals["energy_before"], totals["growth"], totals["floor"] = kinetic, 9.0, np.inf
    if definition is None:
        zeros = np.zeros((steps, amplitudes.size))
        done = how.loop(loop.advance)(step, record, zeros, u, v, 0, steps)
    else:
        done = _in_stages(how, made, definition, tables, step, data, bound, points_of_law, record, (u, v), steps)
    shape = (len(mass), DIM)
    return Marched(u[:size].reshape(shape), v[:size].reshape(shape), record, totals, mass, kinetic, done)


def _in_stages(how, integrator, definition, tables, step, data, bound, points, record, motion, steps):
    """March with a multi-stage scheme."""
    responses = np.array([law_records(bound, table, points.delassus)["response"] for table in tables])
    count = len(definition.times)
    system = stages.System(
        step, data.mass, data.inverse_mass, record_array([], stages.BODY_FORCE), np.zeros(0),
        np.zeros(0, dtype=np.int64), responses, ends_of(definition, data.dt), np.array(definition.times, dtype=float),
        np.zeros((count, 1)), np.zeros((2, 1)), np.zeros(1), np.zeros(1),
    )  # fmt: skip
    scheme = Scheme(kernel_of(integrator), definition.numbers, False, "integrator")
    numbers, inside = how.scheme(scheme, system)
    state = stages.State(*motion, np.zeros((integrator.kept, motion[0].size)))
    system.clock[0] = -system.times[-1] * data.dt
    last = system.ends[-1].copy(), responses[-1].copy()
    if definition.start:
        of_start = law_records(bound, table_of_stage(*definition.start), points.delassus)
        system.ends[-1], responses[-1] = definition.start, of_start["response"]
    how.loop(stages.begin, scheme)(inside, count - 1, *state)
    system.ends[-1], responses[-1] = last
    amplitudes = stages.StageAmplitudes(np.zeros((steps, count, 1)), np.zeros((steps, 2, 1)))
    return how.loop(stages.advance, scheme)(system, numbers, record, amplitudes, state, 0, steps)
