"""Questions that a run does not ask: whether a method answers alike twice, and its kernels in trial states.

A method that reads the clock, draws random numbers or keeps state gives two answers to the same question. Kernels are
called in plain Python, with read-only arrays and with results that start as nan: compiled code can write to arrays that
are meant to be read only, and can leave entries unset, and its numbers look like any others.
"""

from __future__ import annotations

import functools
import inspect
import types
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any
from unittest import mock

import numpy as np

from percuss.contact.law_trials import describe_state, multipliers_of, plain_kernel, trial_of, trial_states
from percuss.jit import Binder
from percuss.march.model import Model
from percuss.mesh.cells import cells_of, is_solid
from percuss.mesh.material_points import plain_slots, points_at_rest
from percuss.methods import slots
from percuss.methods.blame import breach, plain_function
from percuss.methods.interfaces import FAMILIES, CellElement, Component
from percuss.methods.plugin_calls import as_numbers, checked, kernel_faults, mapped, read_only, same
from percuss.step.integrator_check import constant_accelerations, no_internal_forces, plain_step, step_error

if TYPE_CHECKING:
    from collections.abc import Callable

    from percuss.case.case import Case
    from percuss.contact.bound_law import BoundLaw
    from percuss.mesh.materials import MaterialPoints
    from percuss.methods.interfaces import BodyMesh, Element, Floats, Integrator, Material, Mesh, Stages

REPEATED_CALLS = 3  # calls of a method that are repeated: the first may ask where every answer is zero
LOWEST_INDEX = -2  # A lower index of a bound array counts as a mistake; -1 and -2 are used on purpose.
ROUND_OFF_TOLERANCE = 1e-9
MOTIONS = ((0.0, 0.0, 0.0), (1e-3, 1e-6, -1e-3), (1.0, -1e-3, 1e-1))  # time, displacement and velocity of an end
FORCE, CELL_FORCE = "internal_force", "force"
DIFFERENT = (
    "gives another answer when it is asked the same again: it keeps state between calls, draws random numbers or reads "
    "the clock; its answer must follow only from its options and its arguments"
)

# Component, name of its kernel, and the kernel as a function of displacement and velocity.
Trial = tuple[Component, str, "Callable[[Floats, Floats], Any]"]


@contextmanager
def asked_twice(component: type[Component], asked: Counter[str]) -> Iterator[None]:
    """Ask the methods of a class everything twice inside this context, and check what they answer.

    Parameters
    ----------
    component
        The class.
    asked
        How often each method of each instance has been asked twice; it is counted on.
    """
    contract = FAMILIES[component.family]
    with ExitStack() as stack:
        for name in vars(contract):
            own = inspect.getattr_static(component, name)
            if name[0] != "_" and inspect.isfunction(own) and own is not vars(contract)[name]:
                stack.enter_context(mock.patch.object(component, name, _twice(own, asked)))
        yield


def _twice(method: Callable[..., Any], asked: Counter[str]) -> Callable[..., Any]:
    """Return a method that asks a method twice, unless it has been asked often enough."""

    @functools.wraps(method)
    def ask(component: Component, *arguments: Any, **named: Any) -> Any:
        call = functools.partial(method, component, **named)
        own_state, question = _own_state(component), f"{method.__name__} {component!r}"
        value = checked(component, method.__name__, call, *arguments)
        if asked[question] < REPEATED_CALLS:
            if not same(value, call(*map(read_only, arguments))):
                raise breach(component, method.__name__, f"{method.__name__} {DIFFERENT}")
            asked[question] += 1
        if _own_state(component) != own_state:
            message = f"{method.__name__} changes the component itself, which keeps nothing between calls"
            raise breach(component, method.__name__, message)
        return value

    return ask


def _own_state(component: Component) -> str:
    """Return the text of what a component holds, without what its cached properties have computed from it."""
    attributes = {name: inspect.getattr_static(type(component), name, None) for name in vars(component)}
    cached = {name for name, value in attributes.items() if isinstance(value, functools.cached_property)}
    return repr([(name, value) for name, value in vars(component).items() if name not in cached])


def try_kernels(case: Case, component: type[Component], asked: Counter[str]) -> None:
    """Call the kernels of a class in plain Python as a case uses them, once for each set of options.

    Raises
    ------
    PluginError
        If a kernel fails, changes what it was handed, leaves its result unset, or gives another one the second time.
    """
    laws = [contact.law for contact in case.contacts.values()]
    methods = (case.method.integrator, *laws, *(load.load for load in case.loads.values()))
    parts = [(body.element, body.material, body.shape.dimension()) for body in case.bodies.values()]
    of_class = [each for each in (*methods, *parts) if component in map(type, each if type(each) is tuple else [each])]
    question = f"kernels {len(case.contacts)} {of_class!r}"
    if not of_class or asked[question]:
        return
    asked[question] += 1
    model = Model(case)
    if isinstance(integrator := case.method.integrator, component) and model.stages is not None:
        _check_one_step(integrator, model.stages, model.dt)
        _check_repeated_steps(integrator, model.stages, model.dt)
    for bound_law in model.laws:
        if isinstance(bound_law.law, component) and bound_law.linear is None:
            _try_law(bound_law, model.dt)
    for follower in model.loads.followers:
        if isinstance(follower.load.load, component):
            follow = functools.partial(plain_function(follower.kernel), follower.numbers)
            _called_twice(follower.load.load, "follow", follow, MOTIONS)
    for body in model.bodies.values():
        if {type(body.spec.element), type(body.spec.material)} & {component}:
            _try_kernels_of_body(body.spec.element, body.spec.material, body.view, component)


def _called_twice(component: Component, name: str, call: Callable[..., Any], states: Sequence[Any]) -> list[Any]:
    """Return what a kernel gives in some states; call it in all of them a second time.

    Raises
    ------
    PluginError
        If the kernel raises an error, changes what it was handed, or gives another result the second time.
    """
    with kernel_faults(component, name):
        first, second = ([call(*state) for state in states] for _ in range(2))
    if not same(first, second):
        raise breach(component, name, f"{name} {DIFFERENT}")
    return first


# ------------------------------------------------------------------------------------------------- contact laws


def _try_law(bound_law: BoundLaw, dt: float) -> None:
    """Call the kernel of a contact law in many states, and a second time in each of them.

    Raises
    ------
    PluginError
        If the kernel fails, leaves a multiplier unset, changes a global variable, reads a bound array at an index below
        `LOWEST_INDEX`, or gives other multipliers the second time.
    """
    law, points = bound_law.law, bound_law.points
    kernel = plain_kernel(law)
    globals_before = _mutable_globals(kernel)
    low_indices: list[int] = []
    bound = _with_watched_arrays(bound_law.kernel_data, low_indices)

    def call_in_all_states() -> list[tuple[Floats, ...]]:
        results: list[tuple[Floats, ...]] = []
        for state in trial_states(len(points.names), dt):
            # The state variables that the kernel leaves are those that it finds in the next state.
            trial = trial_of(points, dt, state, law, results[-1][1] if results else None)
            results.append((multipliers_of(law, kernel, bound, trial), trial.after))
            if low_indices:
                raise breach(
                    law,
                    "multipliers",
                    f"multipliers reads a bound array at index {low_indices[0]}, which counts from its end, in the "
                    f"state with {describe_state(trial, 0)}: check the index, or write `array.size - n` where the end "
                    "is meant",
                )
        return results

    _called_twice(law, "multipliers", call_in_all_states, [()])
    for name, value in _mutable_globals(kernel).items():
        if value != globals_before[name]:
            raise breach(
                law,
                "multipliers",
                f"multipliers changes `{name}`: a kernel keeps nothing between calls; what it needs is in what `bind` "
                "returns and in the trial, and what it remembers in `trial.before` and `trial.after`",
            )


class _WatchedArray(np.ndarray):
    """An array that records the indices below `LOWEST_INDEX` at which it is read.

    Plain Python and compiled code both take index -5 for the fifth entry from the end, so that such a mistake raises no
    error.
    """

    low_indices: list[int]

    def __array_finalize__(self, other: object) -> None:
        self.low_indices = getattr(other, "low_indices", [])

    def __getitem__(self, index: Any) -> Any:
        indices = index if isinstance(index, tuple) else (index,)
        self.low_indices += [int(i) for i in indices if isinstance(i, int | np.integer) and i < LOWEST_INDEX]
        return super().__getitem__(index)


def _with_watched_arrays(value: object, low_indices: list[int]) -> Any:
    """Return a bound value whose arrays record in `low_indices` the indices below `LOWEST_INDEX` that are read."""
    if isinstance(value, np.ndarray):
        view = value.view(_WatchedArray)
        view.low_indices = low_indices
        return view
    return mapped(lambda item: _with_watched_arrays(item, low_indices), value) if isinstance(value, tuple) else value


def _mutable_globals(kernel: types.FunctionType) -> dict[str, str]:
    """Return the text form of each mutable global variable that a kernel names, attributes of classes included."""
    kinds = (list, dict, set, bytearray, np.ndarray)
    names = kernel.__globals__
    globals_used = {name: names[name] for name in kernel.__code__.co_names if name in names}
    class_attributes = {
        f"{name}.{part}": value
        for name, owner in globals_used.items()
        if isinstance(owner, type)
        for part, value in vars(owner).items()
    }
    return {
        name: repr(value) for name, value in {**globals_used, **class_attributes}.items() if isinstance(value, kinds)
    }


# --------------------------------------------------------------------------------------- elements and materials


def _try_kernels_of_body(element: Element, material: Material, mesh: BodyMesh, component: type[Component]) -> None:
    """Call the kernels of an element and a material in plain Python, and a second time in each state.

    The first element of the body is at rest, stretched, compressed and displaced as a whole. What the kernels are
    handed to read is read-only. Only the kernels of one class are called.

    Raises
    ------
    PluginError
        If a kernel raises an error, changes what it was handed, gives a value that is not finite, or another one the
        second time.
    """
    points = points_at_rest(element, material, mesh)
    states = [
        read_only((displacement.ravel(), velocity.ravel()))
        for displacement in _motions(mesh.mesh)
        for velocity in list(_motions(mesh.mesh))[:2]
    ]
    maker = Binder(plain_slots(element, material), jit=False)
    kernels = (
        _solid_kernels(element, material, points, mesh)
        if is_solid(element)
        else _material_kernels(maker, material, points)
    )
    if isinstance(element, CellElement):
        kernels.append((element, CELL_FORCE, _force_of_first_cell(maker, element, points, mesh)))
    else:
        kernels += _line_kernels(maker, element, points, mesh)
    for owner, name, call in kernels:
        if isinstance(owner, component):
            _try_kernel(owner, name, call, states)


def _material_kernels(maker: Binder, material: Material, points: MaterialPoints) -> list[Trial]:
    """Return the kernels of a material as functions of displacement and velocity, whose ends make the strain."""
    stress, energy_density = (maker.bind(maker.slots[slot]).value for slot in (slots.stress, slots.energy_density))

    def stress_of(u: Floats, _: Floats) -> Any:
        return stress(points, 0, float(u[-1] - u[0]))

    def density_of(u: Floats, v: Floats) -> Any:
        return energy_density(points, 0, float(u[-1] - u[0]), float(v[-1] - v[0]))

    return [(material, "stress", stress_of), (material, "energy_density", density_of)]


def _solid_kernels(element: Any, material: Any, points: MaterialPoints, mesh: BodyMesh) -> list[Trial]:
    """Return the kernels of a solid material as functions of the displacement of a cell, which makes its gradient."""
    corners, size = mesh.mesh.nodes[cells_of(mesh.mesh)[0]], element.dimension

    def gradient(u: Floats) -> Floats:
        about = np.column_stack([np.ones(len(corners)), corners])
        slopes = np.linalg.lstsq(about, u.reshape(corners.shape), rcond=None)[0][1:].T
        found = np.zeros((size, size))
        found[: len(slopes), : len(slopes)] = slopes
        return found.ravel()

    stress, stored = (getattr(material, f"{kernel}_{size}d") for kernel in ("stress", "stored"))
    kernels: list[Trial] = [
        (
            material,
            f"stress_{size}d",
            lambda u, _: plain_function(stress)(points.parameters, tuple(gradient(u).tolist())),
        )
    ]
    if not material.linear:
        energy = plain_function(stored)
        kernels.append((material, f"stored_{size}d", lambda u, _: energy(points.parameters, read_only(gradient(u)))))
    return kernels


def _motions(mesh: Mesh) -> Iterator[Floats]:
    """Yield displacements of the first element: of both its ends, or of all nodes of a cell that is along no line."""
    corners = mesh.nodes[cells_of(mesh)[0]]
    if mesh.line is not None:
        corners = np.stack([0.0 * mesh.direction, float(mesh.lengths[0]) * mesh.direction])
    stretches, size = corners - corners[0], 1e-6 * float(np.ptp(corners, axis=0).max())
    rest, moved = 0.0 * stretches, 0.0 * stretches + size
    yield from (rest, 1e-6 * stretches, -1e-6 * stretches, moved, 1e-3 * stretches)
    if mesh.line is None:
        yield 1e-6 * stretches[:, ::-1]


def _line_kernels(maker: Binder, element: Element, points: MaterialPoints, mesh: BodyMesh) -> list[Trial]:
    """Return the kernels of a two-node element as functions of displacement and velocity of its first element."""
    arrays, dim = read_only(element.bind(mesh)), mesh.mesh.nodes.shape[1]
    force, energy = maker.bind(element.internal_force).value, maker.bind(element.energy).value

    def force_of(u: Floats, _: Floats) -> Floats:
        result = np.full(u.size, np.nan)
        force(arrays, points, 0, dim, u, result)
        return result

    def energy_of(u: Floats, v: Floats) -> Any:
        return energy(arrays, points, 0, dim, u, v, 1e-3)

    return [(element, FORCE, force_of), (element, "energy", energy_of)]


def _force_of_first_cell(
    maker: Binder, element: CellElement, points: MaterialPoints, mesh: BodyMesh
) -> Callable[[Any, Any], Any]:
    """Return the force of the first cell as a function of the displacement; along a line that of its ends."""
    along_line = mesh.mesh.line is not None
    places, rule = np.zeros(0), read_only(element.rule())
    if along_line:
        places = np.asarray(element.reference_nodes())
    geometry, force = read_only(element.geometry(mesh)[0]), maker.bind(element.force).value

    def force_of(u: Floats, _: Floats) -> Floats:
        displacement = u.reshape(-1, mesh.mesh.nodes.shape[1])
        if along_line:
            displacement = (1.0 - places[:, None]) * displacement[0] + places[:, None] * displacement[1]
        displacement = read_only(displacement)
        result = np.full(displacement.shape, np.nan)
        force(rule, points, 0, mesh.section, geometry, displacement, result)
        return result.ravel()

    return force_of


def _try_kernel(component: Any, name: str, call: Callable[[Any, Any], Any], states: list[Any]) -> None:
    """Call a kernel in all states, twice; raise PluginError if it fails or its results differ or are no numbers."""
    count = {"stress_2d": 4, "stress_3d": 9}.get(name)
    for value in _called_twice(component, name, call, states):
        # the nodal forces are the array that the kernel was handed; the other kernels return what they find
        numbers = as_numbers(value)
        right = name in (FORCE, CELL_FORCE) or (numbers is not None and numbers.shape == ((count,) if count else ()))
        if numbers is None or not right:
            raise breach(
                component, name, f"{name} returned {value}, expected {f'{count} numbers' if count else 'one number'}"
            )
        if not np.isfinite(numbers).all():
            shown = tuple(numbers.tolist()) if count else value
            raise breach(component, name, f"{name} gave {shown}, expected finite numbers")


# ------------------------------------------------------------------------------------------------- integrators


def _check_one_step(integrator: Integrator, stages: Stages, dt: float) -> None:
    """Check one step of two points in plain Python, one in free flight and one accelerated from rest.

    Raises
    ------
    PluginError
        If v does not change by dt a, or u by dt v: the kernel does not change u and v in place, or does not use all of
        the impulse, and the sums of work and momentum would be wrong.
    """
    stages_used = []

    def accelerations(system: object, stage: int, u: Floats, v: Floats, a: Floats) -> None:
        stages_used.append(stage)
        constant_accelerations(system, stage, u, v, a)

    def internal(system: object, stage: int, u: Floats, f: Floats) -> None:
        stages_used.append(stage)
        no_internal_forces(system, stage, u, f)

    step = plain_step(integrator, accelerations, internal)
    constant = np.array([0.0, 1.0])
    u, v, kept = np.zeros(2), np.array([1.0, 0.0]), np.tile(constant, (integrator.kept, 1))
    advice = "" if integrator.kept else " (`kept` is 0: say how many rows the scheme keeps)"
    with kernel_faults(integrator, "step", advice):
        step(stages.numbers, (constant,), u, v, kept, dt)
    if set(stages_used) - set(range(len(stages.times))):
        raise step_error(
            integrator, f"step asks for stage {max(stages_used)}, and Stages.times has {len(stages.times)}"
        )
    # a value that is not a number fails these comparisons
    if not (
        abs(u[0] - dt) <= ROUND_OFF_TOLERANCE * dt and np.abs(v - [1.0, dt]).max() <= ROUND_OFF_TOLERANCE * max(1.0, dt)
    ):
        raise step_error(
            integrator,
            "step must change u and v in place (u += ..., or u[:] = ...), v by dt times an acceleration that is "
            f"constant and u by dt times a velocity that is; found a change of v by {v[1] / dt:.9g} dt a, and of u by "
            f"{u[0] / dt:.9g} dt v",
        )


def _check_repeated_steps(integrator: Integrator, stages: Stages, dt: float) -> None:
    """Check that a second step from the same state gives the same result, for several states.

    Raises
    ------
    PluginError
        If the results differ.
    """
    step = plain_step(integrator, constant_accelerations, no_internal_forces)
    rows = np.cos(np.arange(1.0, 5.0 * (3 + integrator.kept) + 1.0)).reshape(3 + integrator.kept, 5)

    def state_after(size: float) -> list[Floats]:
        u, v, a, kept = size * rows[0], size * rows[1], size * rows[2], size * rows[3:]
        step(stages.numbers, (a,), u, v, kept, dt)
        return [u, v, *kept]

    _called_twice(integrator, "step", state_after, [(1e-3,), (1.0,), (1e3,)])
