"""Bind the parts of a run into the loop: compiled as one, or in Python around what cannot be compiled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.methods import slots
from percuss.solver import integrator_check
from percuss.solver.compiled import bulk, custom_laws, leapfrog_loop, multistage_loop
from percuss.solver.compiler.fingerprint import layout
from percuss.solver.compiler.specialise import Specialiser, compile_error, jit_disabled

if TYPE_CHECKING:
    from percuss.methods.interfaces import Integrator
    from percuss.solver.multistage import Staged

Parts = Sequence[tuple[Any, Any]]  # element and material class of each group of bodies
Laws = list[dict[str, Any]]  # bound laws that are not rows


class Kernels(NamedTuple):
    """The bound loop, and why it is not compiled if it is not."""

    advance: Callable[..., int]
    elastic: Callable[..., float]
    compiled: bool
    reasons: tuple[str, ...]
    begin: Callable[..., None] | None = None  # of schemes that are no leap-frog


def bind(
    parts: Parts,
    groups: Sequence[Any],
    laws: Laws,
    stepper: Integrator | None,
    *,
    compiled: bool = True,
    counting: bool = False,
) -> Kernels:
    """Return the loop over `parts`, of which `groups` are the arrays, and `laws`.

    It is that of stages where there is a `stepper`, an integrator with a kernel.

    It is compiled if asked for and possible at all, and with `counting` in such a way that kernels may allocate.
    """
    reason = ""
    if not compiled:
        reason = "compilation was switched off for this run"
    elif jit_disabled():
        reason = "compilation is switched off by NUMBA_DISABLE_JIT"
    maker = Specialiser(jit=not reason, counting=counting, about=_layouts(groups, laws, stepper))
    made = _loop(maker, parts, laws, stepper, frozenset())
    return made._replace(compiled=not reason, reasons=(reason,) if reason else ())


def bind_around(
    error: Exception,
    parts: Parts,
    groups: Sequence[Any],
    laws: Laws,
    trial: tuple[Any, ...],
    staged: Staged | None = None,
) -> Kernels:
    """Return the loop in Python around those parts that cannot be compiled; the others stay compiled.

    Parameters
    ----------
    error
        What compiling the whole loop failed with; raised again if every part compiles by itself.
    parts, groups, laws
        As in `bind`, and the arrays of each group.
    trial
        Nodal arrays, displacement, velocity, dimension and step to try a group with; written over.
    staged
        What the march carries for a scheme that is no leap-frog.
    """
    nodal, u, v, dim, dt = trial
    momentum = np.zeros((1 + max(int(group.body.max()) for group in groups)) * dim)
    reasons: dict[str, Exception] = {}
    for part, group in zip(parts, groups, strict=True):
        maker = Specialiser(_slots(*part), counting=True, about=layout(group))
        try:
            if staged is None:
                maker.bind(bulk.bulk_group)(group, nodal, u, v, np.zeros(momentum.size), momentum, False, dim, dt)
            else:
                maker.bind(multistage_loop.force_group)(group, u, np.zeros(u.size), dim)
            maker.bind(bulk.elastic_group)(group, u, v, dim, dt)
        except compile_error() as why:
            reasons[_name(*part)] = why
    for entry in laws:
        why_not = custom_laws.why_not(entry)
        if why_not is not None:
            reasons[f"contact law {entry['law'].name}"] = why_not
    stepper = None if staged is None else staged.model.case.method.integrator
    if stepper is not None:
        unfit = _unfit(stepper, staged)
        if unfit is not None:
            reasons[f"integrator {stepper.name}"] = unfit
    if not reasons:
        raise error
    maker = Specialiser(counting=True, about=_layouts(groups, laws, stepper))
    made = _loop(maker, parts, laws, stepper, frozenset(reasons))
    said = tuple(f"{part} cannot be compiled: {_short(why)}" for part, why in reasons.items())
    return made._replace(compiled=False, reasons=said)


def _unfit(stepper: Integrator, staged: Any) -> Exception | None:
    """Return why the kernel of an integrator cannot be compiled, or None."""
    filled = {slots.accelerations: integrator_check.known}
    u, v, kept = (array.copy() for array in staged.state)
    try:
        step = Specialiser(filled, counting=True).bind(integrator_check.kernel_of(stepper))
        step(staged.said.numbers, (np.zeros(u.size),), u, v, kept, staged.model.dt)
    except compile_error() as error:
        return error
    return None


def _loop(maker: Specialiser, parts: Parts, laws: Laws, stepper: Integrator | None, plain: frozenset[str]) -> Kernels:
    """Return the loop and the strain-energy kernel; parts named in `plain` and what calls them stay Python."""
    whole = not plain
    update: tuple[Any, ...] = bulk.bulk_group, bulk.bulk_head, bulk.bulk_tail, bulk.bulk_chain
    if stepper is not None:
        loop = multistage_loop
        update = loop.force_group, loop.force_head, loop.force_tail, loop.force_chain
    energies = bulk.elastic_group, bulk.elastic_head, bulk.elastic_tail, bulk.elastic_chain
    forces = _chained(maker, parts, update, plain)
    elastic = _chained(maker, parts, energies, plain)
    own = custom_laws.bind(maker, laws, plain)
    top = maker.with_slots(
        {
            leapfrog_loop.bulk: forces,
            multistage_loop.forces: forces,
            leapfrog_loop.elastic: elastic,
            leapfrog_loop.own_laws: own,
        }
    )
    energy = top.bind(leapfrog_loop.strain_energy, cache=True, plain=not whole)
    if stepper is None:
        return Kernels(top.bind(leapfrog_loop.advance, cache=True, plain=not whole), energy, compiled=whole, reasons=())
    # called, not copied into every stage: that takes the compiler long, and brings little
    filled: dict[Any, Any] = {slots.accelerations: top.bind(multistage_loop.accelerate, cache=True)}
    part = top.with_slots(filled)
    part.jit = maker.jit and f"integrator {stepper.name}" not in plain
    part.counting = True  # nearly every such kernel allocates
    part.checked = True
    filled[multistage_loop.take_step] = part.bind(integrator_check.kernel_of(stepper), cache=True)
    top = top.with_slots(filled)
    advance = top.bind(multistage_loop.advance, cache=True, plain=not whole)
    return Kernels(advance, energy, whole, (), top.bind(multistage_loop.begin, cache=True, plain=not whole))


def _chained(maker: Specialiser, parts: Parts, templates: tuple[Any, ...], plain: frozenset[str]) -> Any:
    """Return what `templates` (of one group, the slots of first and others, of a pair) make of all parts."""
    group, first, others, chain = templates
    made: Any = None
    for element, material in reversed(parts):
        part = maker.with_slots(_slots(element, material))
        part.jit = maker.jit and _name(element, material) not in plain
        head = part.bind(group, cache=bool(plain))
        made = head if made is None else maker.with_slots({first: head, others: made}).bind(chain, plain=bool(plain))
    return made


def _slots(element: Any, material: Any) -> dict[Any, Any]:
    """Return the slots of the bulk update that an element and a material class fill."""
    return {
        slots.stress: material.stress,
        slots.energy_density: material.energy_density,
        slots.internal_force: element.internal_force,
        slots.energy: element.energy,
    }


def _layouts(groups: Sequence[Any], laws: Laws, stepper: Integrator | None) -> str:
    """Return how the tuples are laid out that elements, laws and integrator handed over."""
    numbers = () if stepper is None else stepper.bind(1.0)
    return layout((tuple(group.element for group in groups), tuple(entry["bound"] for entry in laws), numbers))


def _name(element: Any, material: Any) -> str:
    """Return what a pair of element and material is called in messages."""
    return f"element {element.name} with material {material.name}"


def _short(error: Exception) -> str:
    """Return the telling line of a compiler's message."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(("Failed in", "During", "File", "<source", "- Resol"))]
    return (telling or lines or ["no reason given"])[0]
