"""Bind the kernels of a run into the time loop, either compiled as a whole or entirely as plain Python."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.compiler.fingerprint import layout
from percuss.compiler.machine_code import CannotLink, jit_disabled
from percuss.compiler.readings import Readings
from percuss.compiler.specialise import Kernel, Specialiser, compile_error
from percuss.compiling import LOCK
from percuss.mesh import cell_kernels as cells
from percuss.mesh.cells import element_slots, energy_slots, has_cells
from percuss.mesh.materials import material_slots
from percuss.methods import slots
from percuss.methods.interfaces import Stages
from percuss.step import bulk, integrator_check, linked
from percuss.step import law_kernels as custom_laws
from percuss.step import loop as leapfrog_loop
from percuss.step import stages as multistage_loop
from percuss.step.linking import Entrances, LinkedLoop, LinkedStages
from percuss.step.parts import followers as following_loads

if TYPE_CHECKING:
    from percuss.contact.bound_law import BoundLaw
    from percuss.mesh.loads import Follower
    from percuss.methods.interfaces import Floats, Integrator

SWITCHED_OFF = "compilation was switched off for this run"
DISABLED = "compilation is switched off by NUMBA_DISABLE_JIT"
KEPT_LOOPS = 64  # number of bound loops that a process keeps


@dataclass(frozen=True)
class LoopParts:
    """The kernels and arrays of a model that the time loop is bound to.

    Attributes
    ----------
    kinds
        Element and material class of each group of bodies.
    groups
        The arrays of each group.
    laws
        Bound contact laws with a kernel.
    followers
        The loads that follow the motion of an end.
    integrator
        The integrator of a multi-stage scheme, None for a leap-frog scheme.
    dim
        Dimension of the model.
    """

    kinds: Sequence[tuple[Any, Any]]
    groups: Sequence[Any]
    laws: Sequence[BoundLaw]
    followers: Sequence[Follower]
    integrator: Integrator | None
    dim: int


class _Recipe(NamedTuple):
    """What a loop is bound from: the parts of a model without its arrays, which a loop that is kept must not keep."""

    bodies: tuple[tuple[Any, Any, Any], ...]  # element and material class, and what tells of the arrays of a group
    laws: tuple[tuple[Any, Any], ...]  # kernel of a contact law, and what tells of the arrays that it reads
    loads: tuple[tuple[Any, Any], ...]  # the same for loads that follow the motion
    scheme: tuple[Any, Any] | None  # the same for a multi-stage scheme
    dim: int


def _recipe(parts: LoopParts, told: Callable[[Any], Any]) -> _Recipe:
    """Return what a loop is bound from, with `told` of the arrays that a kernel reads in their place."""
    integrator = parts.integrator
    return _Recipe(
        tuple((*kinds, told(group)) for kinds, group in zip(parts.kinds, parts.groups, strict=True)),
        tuple((bound_law.kernel, told(bound_law.kernel_data)) for bound_law in parts.laws),
        tuple((follower.kernel, told(follower.numbers)) for follower in parts.followers),
        None if integrator is None else (integrator_check.kernel_of(integrator), told(integrator.bind(1.0))),
        parts.dim,
    )


class PlainLoop(NamedTuple):
    """The time loop in plain Python."""

    advance: Callable[..., int]
    begin: Callable[..., None] | None = None  # first accelerations of a multi-stage scheme

    def for_another_model(self) -> PlainLoop:
        """Return the loop itself, as it holds no arrays of a model."""
        return self


class Kernels(NamedTuple):
    """The bound time loop, the reasons if it is not compiled, and what its binding has read."""

    loop: Any  # `PlainLoop`, or `LinkedLoop` or `LinkedStages` of `percuss.step.linking`
    compiled: bool
    readings: Readings
    reasons: tuple[str, ...] = ()


# Bound loops of this process by what they are made of, the one that was used last at the end.
_BOUND: OrderedDict[Any, Kernels] = OrderedDict()


def bind(parts: LoopParts, *, compiled: bool = True, counting: bool = False) -> Kernels:
    """Return the bound time loop of a model.

    A loop that this process has bound before is not bound again, unless something that its kernels read has changed.

    Parameters
    ----------
    parts
        The kernels and arrays of the model.
    compiled
        Whether to compile the loop, unless compilation is switched off altogether.
    counting
        Whether kernels of plug-ins may allocate arrays, which needs reference counts.
    """
    reasons = () if compiled else (SWITCHED_OFF,)
    if compiled and jit_disabled():
        reasons = (DISABLED,)
    jit = not reasons
    key = None if counting else _key(parts, jit=jit)
    kernels = _BOUND.get(key)
    if kernels is None or not kernels.readings.unchanged(jit=jit):
        recipe = _recipe(parts, layout)
        kernels = _linked_loop(recipe, counting=counting) if jit else _plain_loop(recipe)
    if key is not None:
        _remember(key, kernels)
    kernels = kernels._replace(loop=kernels.loop.for_another_model())
    return kernels if jit else kernels._replace(reasons=reasons)


def keep(parts: LoopParts, kernels: Kernels) -> None:
    """Let `bind` return these kernels in the place of those that could not be compiled for such a model.

    A loop that turned out to need reference counts, or plain Python, is kept so: a compilation that has failed is not
    tried again.
    """
    _remember(_key(parts, jit=True), kernels._replace(loop=kernels.loop.for_another_model()))


def _remember(key: Any, kernels: Kernels) -> None:
    """Keep a bound loop as the one that was used last; the loops used least recently are dropped."""
    with LOCK:
        _BOUND[key] = kernels
        _BOUND.move_to_end(key)
        while len(_BOUND) > KEPT_LOOPS:
            _BOUND.popitem(last=False)


def _key(parts: LoopParts, *, jit: bool) -> Any:
    """Return what a bound loop depends on beside what its kernels read: the kernels and the types of their arrays."""
    return jit, _recipe(parts, _types), tuple(tuple(_slots(*kinds).values()) for kinds in parts.kinds)


def _types(value: object) -> Any:
    """Return the types of nested tuples of arrays and numbers."""
    if isinstance(value, tuple):
        return (type(value), *map(_types, value))
    if isinstance(value, np.ndarray):
        return type(value), value.dtype, value.ndim, value.flags.c_contiguous, value.flags.writeable
    return type(value)


def bind_plain(error: Exception, parts: LoopParts, u: Floats, v: Floats, dt: float) -> Kernels:
    """Return the loop as plain Python, with the name of each kernel that cannot be compiled and the reason.

    Parameters
    ----------
    error
        The error from compiling the whole loop; raised again if every kernel can be compiled by itself.
    parts
        The kernels and arrays of the model.
    u, v : (nodes * dim,)
        Displacement and velocity for the trial calls of the kernels; overwritten.
    dt
        Time step.
    """
    reasons: dict[str, Exception] = {}

    @contextmanager
    def trial_of(part: str) -> Iterator[None]:
        try:
            yield
        except compile_error() as failure:
            reasons[part] = failure

    for (element, material), group in zip(parts.kinds, parts.groups, strict=True):
        empty = Specialiser(counting=True)
        with trial_of(f"element {element.name} with material {material.name}"):
            maker, template = _of_group(empty, multistage_loop.force_group, element, material, layout(group))
            maker.bind(template, entry=True)(group, u, np.zeros(u.size), parts.dim)
            maker, template = _of_group(empty, bulk.elastic_group, element, material, layout(group))
            maker.bind(template, entry=True)(group, u, v, parts.dim, 1.0)
    for bound_law in parts.laws:
        with trial_of(f"contact law {bound_law.law.name}"):
            custom_laws.compile_alone(bound_law)
    for follower in parts.followers:
        with trial_of(f"load {follower.load.load.name}"):
            following_loads.compile_alone(follower)
    if parts.integrator is not None:
        with trial_of(f"integrator {parts.integrator.name}"):
            _compile_alone(parts.integrator, u, v, dt)
    if not reasons:
        if isinstance(error, CannotLink):
            return bind(parts, compiled=False)._replace(reasons=(str(error),))
        if parts.integrator is None:
            raise error
        # Every kernel can be compiled by itself: what the step passes to `accelerations` cannot.
        reasons[f"integrator {parts.integrator.name}"] = error
    sentences = tuple(f"{part} cannot be compiled: {_telling_line(failure)}" for part, failure in reasons.items())
    return bind(parts, compiled=False)._replace(reasons=sentences)


def _compile_alone(integrator: Integrator, u: Floats, v: Floats, dt: float) -> None:
    """Compile the kernel of an integrator by itself; raise the compiler's error if it cannot be compiled."""
    filled: dict[Any, Any] = {
        slots.accelerations: integrator_check.constant_accelerations,
        slots.internal: integrator_check.no_internal_forces,
    }
    step = Specialiser(filled, counting=True).bind(integrator_check.kernel_of(integrator), entry=True)
    stages = integrator.bind(dt)
    numbers = stages.numbers if isinstance(stages, Stages) else ()
    step(numbers, (np.zeros(u.size),), u, v, np.zeros((integrator.kept, u.size)), dt)


def _bound(maker: Specialiser, recipe: _Recipe) -> tuple[Kernel, Kernel, Kernel, Kernel]:
    """Return bulk update or internal forces, strain energy, contact laws and following loads of a model, bound."""
    forces: Kernel = bulk.advance_bodies if recipe.scheme is None else multistage_loop.force_group
    update = _over_groups(maker, recipe, forces, bulk.each_group)
    energy = _over_groups(maker, recipe, bulk.elastic_group, bulk.sum_over_groups)
    loads = following_loads.bind(maker, recipe.loads)
    return update, energy, custom_laws.bind(maker, recipe.laws), loads


def _plain_loop(recipe: _Recipe) -> Kernels:
    """Return the loop as plain Python, with the kernels in the place of its slots."""
    maker = Specialiser(jit=False)
    update, energy, laws, loads = _bound(maker, recipe)
    filled: dict[Any, Any] = {
        leapfrog_loop.elastic: energy,
        leapfrog_loop.kernel_laws: laws,
        leapfrog_loop.following_forces: loads,
    }
    if recipe.scheme is None:
        filled[leapfrog_loop.bulk] = update
        return Kernels(PlainLoop(maker.with_slots(filled).bind(leapfrog_loop.advance)), False, maker.readings)
    filled[multistage_loop.forces] = update
    filled[slots.accelerations] = maker.with_slots(filled).bind(multistage_loop.accelerate)
    filled[slots.internal] = maker.with_slots(filled).bind(multistage_loop.internal_accelerations)
    filled[multistage_loop.take_step] = maker.with_slots(filled).bind(recipe.scheme[0])
    maker = maker.with_slots(filled)
    loop = PlainLoop(maker.bind(multistage_loop.advance), maker.bind(multistage_loop.begin))
    return Kernels(loop, False, maker.readings)


def _linked_loop(recipe: _Recipe, *, counting: bool) -> Kernels:
    """Return the compiled loop, the same for all methods, which calls the kernels by their addresses.

    The kernels are bound and digested first; they are bound for the compiler when machine code is not stored yet.
    """
    maker = Specialiser(counting=counting, digested_alone=True)
    tags = {kind: maker.tag_of(kernel) for kind, kernel in _entrances(maker, recipe).items()}

    def bind_for_the_compiler() -> dict[str, Kernel]:
        from percuss.step.calls import at, call

        return _entrances(Specialiser(counting=counting), recipe, {linked.at: at, linked.call: call})

    loop = LinkedLoop if recipe.scheme is None else LinkedStages
    return Kernels(loop(Entrances(tags, bind_for_the_compiler)), True, maker.readings)


def _entrances(maker: Specialiser, recipe: _Recipe, instructions: Mapping[Any, Any] | None = None) -> dict[str, Kernel]:
    """Return the entrances of the kernels and of the loop of a model.

    Parameters
    ----------
    maker
        What binds them.
    recipe
        The kernels of the model.
    instructions
        What replaces the slots of `linked` that stand for instructions of the compiler.
    """
    instructions = dict(instructions or {})
    update, energy, laws, loads = _bound(maker, recipe)
    filled: dict[Any, Any] = instructions | {
        leapfrog_loop.bulk: linked.bulk,
        leapfrog_loop.elastic: linked.elastic,
        leapfrog_loop.kernel_laws: linked.kernel_laws,
        leapfrog_loop.following_forces: linked.following_forces,
        multistage_loop.forces: linked.forces,
        multistage_loop.take_step: linked.take_step,
        slots.accelerations: linked.accelerations,
        slots.internal: linked.internal,
    }
    own = maker.with_slots(filled)

    def entrance(maker: Specialiser, kernel: Kernel, template: Kernel = linked.entrance) -> Kernel:
        return maker.with_slots({linked.kernel: kernel, **instructions}).bind(template, linked=True)

    def entrance_of_loop(template: Kernel) -> Kernel:
        return entrance(own, template, linked.entrance_of_loop)

    entrances = {"strain energy": entrance(maker, energy)}
    if recipe.laws:
        entrances["contact laws"] = entrance(maker, laws)
    if recipe.loads:
        entrances["following loads"] = entrance(maker, loads)
    if recipe.scheme is None:
        entrances["bulk update"] = entrance(maker, update)
        entrances["leap-frog loop"] = entrance_of_loop(leapfrog_loop.advance)
        return entrances
    entrances["internal forces"] = entrance(maker, update)
    entrances["accelerations of a stage"] = entrance(own, multistage_loop.accelerate)
    step, about = recipe.scheme
    if integrator_check.uses_internal(step):
        entrances["internal forces of a stage"] = entrance(own, multistage_loop.internal_accelerations)
    scheme = maker.with_slots(filled, about)
    scheme.counting = True  # nearly every kernel of a multi-stage scheme allocates
    scheme.checked = True
    entrances["step of a scheme"] = entrance(scheme, step, linked.entrance_of_step)
    entrances["multi-stage loop"] = entrance_of_loop(multistage_loop.advance)
    entrances["first accelerations"] = entrance_of_loop(multistage_loop.begin)
    return entrances


# The templates for a group of two-node elements, and those for a group of elements with cells of any kind.
_WITH_CELLS: dict[Kernel, Kernel] = {
    bulk.advance_bodies: bulk.advance_cells,
    bulk.elastic_group: cells.elastic_cells,
    multistage_loop.force_group: cells.force_cells,
}


def _of_group(maker: Specialiser, template: Kernel, element: Any, material: Any, about: str) -> tuple[Specialiser, Any]:
    """Return the specialiser and the template for a group of bodies, given the template for two-node elements."""
    filled = _slots(element, material)
    if has_cells(element):
        template = _WITH_CELLS[template]
    if template is cells.elastic_cells:
        filled |= energy_slots(maker, element)
    return maker.with_slots(filled, about=about), template


def _over_groups(maker: Specialiser, recipe: _Recipe, template: Kernel, pair: Kernel) -> Any:
    """Return one function for all groups of bodies: `template` treats one, `pair` one and the groups behind it."""
    joined: Any = None
    for element, material, about in reversed(recipe.bodies):
        specialiser, of_group = _of_group(maker, template, element, material, about)
        head = specialiser.bind(of_group)
        if joined is None:
            joined = head
        else:
            joined = maker.with_slots({bulk.first_group: head, bulk.other_groups: joined}).bind(pair)
    return joined


def _slots(element: Any, material: Any) -> dict[Any, Any]:
    """Return the slots of the bulk update and the kernels of an element and a material class that replace them."""
    return {**material_slots(material), **element_slots(element)}


def _telling_line(error: Exception) -> str:
    """Return the line of a compiler's message that states the reason."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    linking = [line.removeprefix("TypingError: ") for line in lines if ": the arguments are " in line]
    if linking:
        return linking[0]
    telling = [line for line in lines if not line.startswith(("Failed in", "During", "File", "<source", "- Resol"))]
    return (telling or lines or ["no reason given"])[0]
