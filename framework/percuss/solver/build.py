"""Bind the parts of a run into the loop: compiled as one, or all of it as plain Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.methods import slots
from percuss.methods.interfaces import Stages
from percuss.solver import integrator_check
from percuss.solver.compiled import bulk, custom_laws, leapfrog_loop, multistage_loop
from percuss.solver.compiler.fingerprint import layout
from percuss.solver.compiler.specialise import Specialiser, compile_error, jit_disabled

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integrator

SWITCHED_OFF = "compilation was switched off for this run"
DISABLED = "compilation is switched off by NUMBA_DISABLE_JIT"


@dataclass(frozen=True)
class LoopParts:
    """What a model puts into the slots of the loop.

    Attributes
    ----------
    kinds
        Element and material class of each group of bodies.
    groups
        The arrays of each group.
    laws
        Bound contact laws with a kernel of their own.
    integrator
        The integrator of a multi-stage scheme, None for a leap-frog.
    dim
        Dimension of the model.
    constrained
        Whether the model has supports or drives.
    loaded
        Whether the model has forces on nodes or bodies.
    """

    kinds: Sequence[tuple[Any, Any]]
    groups: Sequence[Any]
    laws: list[dict[str, Any]]
    integrator: Integrator | None
    dim: int
    constrained: bool
    loaded: bool


class Kernels(NamedTuple):
    """The bound loop, and why it is not compiled if it is not."""

    advance: Callable[..., int]
    compiled: bool
    reasons: tuple[str, ...] = ()
    begin: Callable[..., None] | None = None  # of multi-stage schemes


def bind(parts: LoopParts, *, compiled: bool = True, counting: bool = False) -> Kernels:
    """Return the loop of a model.

    Parameters
    ----------
    parts
        What fills the slots of the loop.
    compiled
        Whether to compile it, unless that is switched off altogether.
    counting
        Whether kernels of plug-ins may allocate arrays.
    """
    reasons = () if compiled else (SWITCHED_OFF,)
    if compiled and jit_disabled():
        reasons = (DISABLED,)
    maker = Specialiser(jit=not reasons, counting=counting)
    return _loop(maker, parts)._replace(compiled=not reasons, reasons=reasons)


def bind_plain(error: Exception, parts: LoopParts, u: Floats, v: Floats, dt: float) -> Kernels:
    """Return the loop as plain Python, with the names of the kernels that cannot be compiled and the reason of each.

    Parameters
    ----------
    error
        What compiling the whole loop failed with; raised again if every kernel compiles by itself.
    parts
        What fills the slots of the loop.
    u, v : (nodes * dim,)
        Displacement and velocity to try the kernels with; written over.
    dt
        Time step.
    """
    reasons: dict[str, Exception] = {}
    for (element, material), group in zip(parts.kinds, parts.groups, strict=True):
        maker = Specialiser(_slots(element, material), counting=True, about=layout(group))
        try:
            maker.bind(multistage_loop.force_group, entry=True)(group, u, np.zeros(u.size), parts.dim)
            maker.bind(bulk.elastic_group, entry=True)(group, u, v, parts.dim, 1.0)
        except compile_error() as why:
            reasons[f"element {element.name} with material {material.name}"] = why
    for entry in parts.laws:
        why_not = custom_laws.why_not(entry)
        if why_not is not None:
            reasons[f"contact law {entry['law'].name}"] = why_not
    if parts.integrator is not None:
        unfit = _unfit(parts.integrator, u, v, dt)
        if unfit is not None:
            reasons[f"integrator {parts.integrator.name}"] = unfit
    if not reasons:
        raise error
    said = tuple(f"{part} cannot be compiled: {_short(why)}" for part, why in reasons.items())
    return bind(parts, compiled=False)._replace(reasons=said)


def _unfit(integrator: Integrator, u: Floats, v: Floats, dt: float) -> Exception | None:
    """Return why the kernel of an integrator cannot be compiled, or None."""
    filled = {slots.accelerations: integrator_check.known}
    try:
        step = Specialiser(filled, counting=True).bind(integrator_check.kernel_of(integrator), entry=True)
        stages = integrator.bind(dt)
        numbers = stages.numbers if isinstance(stages, Stages) else ()
        step(numbers, (np.zeros(u.size),), u, v, np.zeros((integrator.kept, u.size)), dt)
    except compile_error() as error:
        return error
    return None


def _loop(maker: Specialiser, parts: LoopParts) -> Kernels:
    """Return the loop over steps, and what begins it in a multi-stage scheme."""
    update = bulk.advance_bars if parts.dim == 1 else bulk.advance_bodies
    forces: tuple[Any, ...] = update, bulk.bulk_head, bulk.bulk_tail, bulk.bulk_chain
    if parts.integrator is not None:
        loop = multistage_loop
        forces = loop.force_group, loop.force_head, loop.force_tail, loop.force_chain
    energies = bulk.elastic_group, bulk.elastic_head, bulk.elastic_tail, bulk.elastic_chain
    filled: dict[Any, Any] = {
        leapfrog_loop.elastic: _chained(maker, parts, energies),
        leapfrog_loop.own_laws: custom_laws.bind(maker, parts.laws),
    }
    if not parts.constrained:
        idle = leapfrog_loop.impose_velocity, leapfrog_loop.add_contact_reactions
        filled |= dict.fromkeys(idle, leapfrog_loop.no_loads)
    if not parts.loaded:
        idle = leapfrog_loop.apply_nodal_forces, leapfrog_loop.work_of_loads
        filled |= dict.fromkeys(idle, leapfrog_loop.no_loads)
    filled[leapfrog_loop.bulk if parts.integrator is None else multistage_loop.forces] = _chained(maker, parts, forces)
    top = maker.with_slots(filled)
    if parts.integrator is None:
        return Kernels(top.bind(leapfrog_loop.advance, entry=True), maker.jit)
    # called, not copied into every stage: that takes the compiler long, and brings little
    filled[slots.accelerations] = top.bind(multistage_loop.accelerate, entry=True)
    step = top.with_slots(filled, about=layout(parts.integrator.bind(1.0)))
    step.counting = True  # nearly every such kernel allocates
    step.checked = True
    filled[multistage_loop.take_step] = step.bind(integrator_check.kernel_of(parts.integrator), entry=True)
    top = top.with_slots(filled)
    advance = top.bind(multistage_loop.advance, entry=True)
    return Kernels(advance, maker.jit, begin=top.bind(multistage_loop.begin, entry=True))


def _chained(maker: Specialiser, parts: LoopParts, templates: tuple[Any, ...]) -> Any:
    """Return what `templates` (of one group, the slots of first and others, of a pair) make of all groups."""
    group, first, others, chain = templates
    made: Any = None
    for (element, material), arrays in zip(reversed(parts.kinds), reversed(parts.groups), strict=True):
        head = maker.with_slots(_slots(element, material), about=layout(arrays)).bind(group)
        made = head if made is None else maker.with_slots({first: head, others: made}).bind(chain)
    return made


def _slots(element: Any, material: Any) -> dict[Any, Any]:
    """Return the slots of the bulk update that an element and a material class fill."""
    return {
        slots.stress: material.stress,
        slots.energy_density: material.energy_density,
        slots.internal_force: element.internal_force,
        slots.energy: element.energy,
    }


def _short(error: Exception) -> str:
    """Return the telling line of a compiler's message."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(("Failed in", "During", "File", "<source", "- Resol"))]
    return (telling or lines or ["no reason given"])[0]
