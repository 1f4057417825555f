"""The arrays of a run: those that no step changes, its histories, and what a step of each stretch works on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.contact.points import NEVER, carry_over, point_records
from percuss.contact.sliding import sliding, surfaces_of
from percuss.contact.state_variables import StateVariables
from percuss.contact.walls import round_or_moving
from percuss.march.parts import PARTS
from percuss.march.recording import empty_record, probe_nodes, recorded_elements
from percuss.mesh.cell_kernels import Block
from percuss.mesh.cells import cell_arrays, element_slots, has_cells, is_solid, parameters_of, slots_of_material
from percuss.mesh.stiffness_rows import StiffnessRows
from percuss.methods.plugin_calls import answer, read_only
from percuss.record_arrays import empty_records, record_array
from percuss.step import bulk, uniform_rows
from percuss.step.actions import (
    BULK,
    CONTACT_EQUATION,
    INTERNAL_FORCES,
    INTERNAL_FORCES_ASIDE,
    KINETIC_ENERGY,
    STRAIN_ENERGY,
    Action,
)
from percuss.step.equation import Equation, solve_equation
from percuss.step.law_kernels import kernel_laws
from percuss.step.part import Part, Setting
from percuss.step.records import BOUNDARY_DOF, CONSTRAINT, NODAL_FORCE, NOW, SHARE, TOTAL, Loads, Step
from percuss.threads import why_one

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.contact.model import Model
    from percuss.contact.points import Points, Rows
    from percuss.methods.interfaces import Array, BodyMesh, Floats


# Numbers in the rows of stiffness of a body, up to which it takes longer to wake threads than they win.
FEW_NUMBERS = 200_000


class Arrays:
    """The arrays of a run.

    Parameters
    ----------
    model
        The model of the run.
    threads
        How many threads may share out the loops over large bodies.

    Attributes
    ----------
    order
        Numbers of the contact points in the order of the loop.
    kernel_laws
        The laws with a kernel.
    place
        Map from each boundary node to the index of its first boundary degree of freedom.
    record, time
        The histories, and the time of each of their rows.
    blocks
        The bodies of one kind of element and material, with an element and a material of this kind.
    step
        What the present stretch works on; it has no actions.
    parts
        The optional parts of its step.
    actions
        What its step does.
    uniform
        Whether all bodies are advanced as bars of equal elements.
    threads
        How many threads share out the loops over large bodies; 1 where there are no such bodies.
    why_one
        Why it is one although there are such bodies and more threads were asked for; else empty.
    """

    step: Step
    parts: Sequence[Part[Any]]
    actions: Sequence[Action]
    uniform: bool

    def __init__(self, model: Model, threads: int = 1) -> None:
        self.model = model
        self.order, self.law_records = model.law_records()
        self.kernel_laws: Sequence[BoundLaw] = [bound_law for bound_law in model.laws if bound_law.linear is None]
        self.variables = StateVariables.of(model, self.kernel_laws)
        self.columns = len(model.case.loads) + 1
        self.place = _places(model)
        self.recorded = recorded_elements(model)
        self.record, self.time = empty_record(model, self.place)
        self.blocks = list(_blocks(model, self.variables))
        # A process in which threads have been launched may not fork: small runs launch none.
        shared = threads > 1 and any(_is_large(block) for block, _, _ in self.blocks)
        self.why_one = why_one() if shared else ""
        self.threads = threads if shared and not self.why_one else 1

    def begin(self, momenta: Floats) -> None:
        """Make what the first stretch works on, with the momenta of the bodies half a step before t = 0."""
        for array in (self.variables.before, self.variables.after):
            array[:] = 0.0
        model, dim = self.model, self.model.dim
        dofs: list[tuple[Any, ...]] = []
        for node in self.place:
            body, mass = model.bodies.at(node).number, model.bodies.mass[node]
            dofs += [(node * dim + axis, mass, body * dim + axis, *([0.0] * 6)) for axis in range(dim)]
        # A wall that is round or moves has a place as a node has, behind those of the nodes.
        walls = range(len(round_or_moving(model.case)) * dim)
        dofs += [(model.bodies.n_nodes * dim + k, 0.0, k % dim, *([0.0] * 6)) for k in walls]
        boundary, now = record_array(dofs, BOUNDARY_DOF), empty_records(1, NOW)
        now["dt"], now["span"], now["dim"] = model.dt, model.dt, dim
        now["gap_response"], now["rate_response"] = model.dt * model.dt, model.dt
        bodies = len(model.bodies) * dim
        leap_frog = not model.multistage
        amplitudes = np.zeros(2 * self.columns + bodies if leap_frog else self.columns)
        momentum = np.zeros(bodies if model.loads.body_forces and leap_frog else 0)
        nothing = record_array([], SHARE)
        loads = Loads(
            nothing, nothing, nothing, np.zeros(0), amplitudes, amplitudes[2 * self.columns :], momentum, momenta
        )
        rows, points = self._points(0.5 * model.dt)
        self.step = Step(boundary, points, loads, empty_records(1, TOTAL), now, None)
        self.parts = ()
        self._enter(rows, 0.5 * model.dt)

    def switch(self, midpoint: float) -> None:
        """Change to the supports, drives and laws that are active at a time, and continue all sums over the steps."""
        rows, points = self._points(midpoint)
        carry_over(self.step.points, points)
        self.step = self.step._replace(points=points)
        self._enter(rows, midpoint)

    def _enter(self, rows: Rows, midpoint: float) -> None:
        """Make supports, loads, parts and actions of the stretch around a time, whose points have these rows."""
        model = self.model
        constraints = [
            (index, constraint)
            for index, constraint in enumerate(model.loads.constraints)
            if model.multistage or constraint.active(midpoint)
        ]
        self.active_constraints = [index for index, _ in constraints]
        self.step = self.step._replace(loads=self._loads(constraints, rows, midpoint))
        known, made = {type(part): part for part in self.parts}, list[Part[Any]]()
        setting = Setting(
            model, self.place, self.order, rows, midpoint, self.step, self.record, self.variables, self.recorded,
            self.blocks, made,
        )  # fmt: skip
        for kind in PARTS:
            if (part := kind.of(setting, known.get(kind))) is not None:
                made.append(part)
        self.parts = made
        self.actions = list(self._actions())

    def _points(self, midpoint: float) -> tuple[Rows, Points]:
        """Return the rows and the records of the contact points in the order of the loop."""
        rows = self.model.rows_of_step(midpoint).permuted(self.order)
        laws = self.law_records
        if inactive := self.model.inactive_points(midpoint):
            laws = laws.copy()
            laws["always"][np.isin(self.order, inactive)] = NEVER
        return rows, point_records(laws, self.model.contact_points, self.order, rows, self.place)

    def _loads(self, constraints: Sequence[tuple[int, Any]], rows: Rows, midpoint: float) -> Loads:
        """Return supports and loads with the constraints of a stretch, whose reactions start at zero."""
        model, dim, slowing = self.model, self.model.dim, self.model.slowing
        first = 0 if model.multistage else self.columns  # column of the first prescribed velocity
        held = [
            (self.place[support.node], i * dim, model.bodies.mass_held(support.node), first + support.column, 0.0, 0.0)
            for i, (_, support) in enumerate(constraints)
        ]
        touched, point, stays = set(rows.node.tolist()), rows.point, ~model.contact_points.slides[self.order]
        shares = [
            (i, int(point[k]), float(constraint.direction @ rows.normal[k]))
            for i, (_, constraint) in enumerate(constraints)
            if constraint.node in touched and constraint.active(midpoint)
            for k in np.flatnonzero((rows.node == constraint.node) & stays[point])
        ]
        forces = [
            (self.place[force.node], i * dim, model.bodies.mobility(force.node) / slowing[force.node], force.column)
            for i, force in enumerate(model.loads.nodal_forces, start=len(constraints))
        ]
        axes = [
            *(constraint.direction for _, constraint in constraints),
            *(force.force for force in model.loads.on_nodes),
        ]
        return self.step.loads._replace(
            constraints=record_array(held, CONSTRAINT),
            shares=record_array(shares, SHARE),
            nodal_forces=record_array(forces, NODAL_FORCE),
            axes=np.array(axes, dtype=float).ravel(),
        )

    def _actions(self) -> Iterator[Action]:
        """Yield what a step of this stretch does."""
        equation = Action(CONTACT_EQUATION, solve_equation, Equation(self.step.points, self.step.now))
        for action in (*self._of_bodies(), equation):
            changed: Action | None = action
            for part in self.parts:
                changed = part.changed(changed) if changed is not None else None
            if changed is not None:
                yield changed
        yield from kernel_laws(self.kernel_laws, self.step.points, self.step.now, self.variables.of_laws())
        for part in self.parts:
            yield from part.actions()

    def _of_bodies(self) -> Iterator[Action]:
        """Yield the actions of the bodies: their update or their forces, and their energies."""
        model, step = self.model, self.step
        bars = uniform_rows.uniform_bars(model, list(self.place))
        self.uniform = bars.size > 0
        if self.uniform:
            rows = uniform_rows.UniformRows(bars, step.totals, model.dt)
            yield Action(BULK, uniform_rows.advance_whole, rows)
            yield Action(STRAIN_ENERGY, uniform_rows.add_energies, rows)
            return
        yield Action(KINETIC_ENERGY, bulk.add_kinetic_energy, bulk.Masses(model.bodies.mass_of_dofs, step.totals))
        for block, element, material in self.blocks:
            cells = has_cells(element)
            largest = int((block.stop - block.start).max()) if cells else bulk.PIECE + 2
            data = bulk.Bulk(
                block, model.bodies.mass_of_dofs, model.bodies.inverse_mass_of_dofs, np.zeros(largest * model.dim),
                step.loads.accelerations, np.zeros(model.dim), step.loads.momentum, step.totals, model.dim, model.dt,
                0.0 if model.multistage else model.dt, (),
            )  # fmt: skip
            allocates = element.allocates or material.allocates
            filled: Mapping[Callable[..., Any], Any] = {
                **slots_of_material(type(element), type(material)),
                **element_slots(type(element)),
                bulk.advance_body: bulk.advance_cells if cells else bulk.advance_row,
                bulk.energy_of_body: bulk.energy_of_cell_body if cells else bulk.energy_of_row,
            }
            if isinstance(block.element, StiffnessRows):
                shared = self.threads > 1 and _is_large(block)
                filled = {**filled, **bulk.of_linear_solids(model.dim, threads=shared)}
            if model.loads.body_forces and not model.multistage:
                filled = {**filled, **bulk.OF_LOADED_BODIES}
            name = f"element {element.name} with material {material.name}"
            if model.multistage:
                forces = bulk.set_forces_of_cells if cells else bulk.set_forces
                aside = data._replace(block=block._replace(after=np.zeros_like(block.after)))
                yield Action(INTERNAL_FORCES, forces, data, filled, allocates=allocates, name=name)
                yield Action(INTERNAL_FORCES_ASIDE, forces, aside, filled, allocates=allocates, name=name)
            else:
                yield Action(BULK, bulk.advance_block, data, filled, allocates=allocates, name=name)
            if material.state == 0 or not is_solid(element):
                yield Action(STRAIN_ENERGY, bulk.add_strain_energy, data, filled, allocates=allocates, name=name)
            elif not model.multistage:
                for kernel, number in (
                    (bulk.add_strain_energy, material.stored_in), (bulk.add_dissipated_energy, material.dissipated_in),
                ):  # fmt: skip
                    if number is not None:
                        rising = data._replace(block=_of_rise(block, number))
                        yield Action(STRAIN_ENERGY, kernel, rising, filled, allocates=allocates, name=name)
            if getattr(element, "hourglass_points", 0) > 0:
                held = data._replace(block=block._replace(element=cell_arrays(element, self._views(block))))
                yield Action(STRAIN_ENERGY, bulk.add_hourglass_energy, held, filled, allocates=allocates, name=name)

    def _views(self, block: Block) -> list[BodyMesh]:
        """Return the bodies of a block as their element receives them."""
        bodies = list(self.model.bodies.values())
        return [bodies[number].view for number in block.body]

    def changing_arrays(self) -> list[Array]:
        """Return the arrays that a step changes, always in the same order, without displacements and velocities."""
        step, loads = self.step, self.step.loads
        own = [
            step.points.state,
            step.points.sums,
            step.points.contacts,
            step.totals,
            loads.constraints,
            loads.momentum,
            loads.momentum_before,
        ]
        return own + [array for part in self.parts for array in part.changing_arrays()]

    def sums(self) -> dict[str, Floats]:
        """Return copies of what the parts have summed up over the steps so far, by name."""
        return {name: array.copy() for part in self.parts for name, array in part.sums().items()}

    def sums_of_records(self) -> dict[str, Floats]:
        """Return what the parts have summed up until the last record, by name."""
        return {name: array for part in self.parts for name, array in part.sums_of_records().items()}

    def histories(self) -> dict[str, Floats]:
        """Return the histories that the parts record, by name."""
        return {name: array for part in self.parts for name, array in part.results().items()}


def _places(model: Model) -> dict[int, int]:
    """Return the boundary nodes, each with the index of its first boundary degree of freedom."""
    contact_nodes = model.contact_points.node.tolist()
    acted_nodes = model.loads.acted_nodes
    beside = [
        node
        for end in (*contact_nodes, *acted_nodes)
        if model.bodies.mass[end] > 0.0
        for node in model.bodies.at(end).response(end)
    ]
    probed = [node for nodes in probe_nodes(model) for node, _ in nodes]
    slid = [surface.nodes for spec in sliding(model.case).values() for surface in surfaces_of(spec, model.bodies)]
    nodes = dict.fromkeys([*contact_nodes, *acted_nodes, *beside, *probed, *(n for one in slid for n in one.tolist())])
    return {node: k * model.dim for k, node in enumerate(nodes)}


def _is_large(block: Block) -> bool:
    return isinstance(block.element, StiffnessRows) and block.element.pairs.size > FEW_NUMBERS


def _of_rise(block: Block, number: int) -> Block:
    """Return a block for `percuss.mesh.materials.rise` of a state variable from the present step to the next one."""
    kept, room = block.after.view(), np.zeros((2, block.after.shape[1]))
    kept.flags.writeable, room[1, 0] = False, number
    return block._replace(before=kept, after=room)


def _blocks(model: Model, variables: StateVariables) -> Iterator[tuple[Block, Any, Any]]:
    """Yield the bodies of each kind of element and material, with an element and a material of this kind."""
    kinds: dict[tuple[type, type, Any, Any], list[Any]] = {}
    for body in model.bodies.values():
        element = body.spec.element
        options = element if has_cells(element) else None  # bodies of cells share what follows from the options
        alone = body.number if body.marches_by_rows else None
        kinds.setdefault((type(element), type(body.spec.material), options, alone), []).append(body)
    for bodies in kinds.values():
        element, meshes = bodies[0].spec.element, [body.view for body in bodies]
        if bodies[0].marches_by_rows:
            arrays: Any = read_only(bodies[0].stiffness_rows)
        elif has_cells(element):
            arrays = cell_arrays(element, meshes)
        else:
            bound = [answer(body.spec.element, "bind", mesh) for body, mesh in zip(bodies, meshes, strict=True)]
            arrays = type(bound[0])(
                *(read_only(np.ascontiguousarray(np.concatenate(columns))) for columns in zip(*bound, strict=True))
            )
        counts = [body.volumes.size for body in bodies]
        yield (
            Block(
                arrays,
                read_only(np.array([parameters_of(element, one.spec.material, one.view, model.dt) for one in bodies])),
                np.array([body.number for body in bodies], dtype=np.int64),
                np.array([body.start for body in bodies], dtype=np.int64),
                np.array([body.stop for body in bodies], dtype=np.int64),
                np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
                *variables.of_bodies(bodies),
            ),
            element,
            bodies[0].spec.material,
        )
