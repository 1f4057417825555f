"""Bind the parts of a run into the loop: compiled as one, or in Python around what cannot be compiled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from percuss import escape, kernels, loop
from percuss.specialise import Specialiser, compile_error, jit_disabled

Parts = Sequence[tuple[Any, Any]]  # element and material class of each group of bodies
Laws = list[dict[str, Any]]  # bound laws that are not rows


class Kernels(NamedTuple):
    """The bound loop, and why it is not compiled if it is not."""

    advance: Callable[..., int]
    elastic: Callable[..., float]
    compiled: bool
    reasons: tuple[str, ...]


def bind(parts: Parts, laws: Laws, *, compiled: bool, counting: bool = False) -> Kernels:
    """Return the loop over `parts` and `laws`.

    It is compiled if asked for and possible at all, and with `counting` in such a way that kernels may allocate.
    """
    reason = ""
    if not compiled:
        reason = "compilation was switched off for this run"
    elif jit_disabled():
        reason = "compilation is switched off by NUMBA_DISABLE_JIT"
    maker = Specialiser(jit=not reason, counting=counting)
    advance, elastic = _loop(maker, parts, laws, frozenset())
    return Kernels(advance, elastic, compiled=not reason, reasons=(reason,) if reason else ())


def bind_around(error: Exception, parts: Parts, groups: Sequence[Any], laws: Laws, trial: tuple[Any, ...]) -> Kernels:
    """Return the loop in Python around those parts that cannot be compiled; the others stay compiled.

    Parameters
    ----------
    error
        What compiling the whole loop failed with; raised again if every part compiles by itself.
    parts, groups, laws
        As in `bind`, and the arrays of each group.
    trial
        Nodal arrays, displacement, velocity, dimension and step to try a group with; written over.
    """
    bulk, u, v, dim, dt = trial
    momentum = np.zeros((1 + max(int(group.body.max()) for group in groups)) * dim)
    reasons: dict[str, Exception] = {}
    for part, group in zip(parts, groups, strict=True):
        maker = Specialiser(_slots(*part), counting=True)
        try:
            maker.bind(kernels.bulk_group)(group, bulk, u, v, np.zeros(momentum.size), momentum, False, dim, dt)
            maker.bind(kernels.elastic_group)(group, u, v, dim, dt)
        except compile_error() as why:
            reasons[_name(*part)] = why
    for entry in laws:
        why_not = escape.why_not(entry)
        if why_not is not None:
            reasons[f"contact law {entry['law'].name}"] = why_not
    if not reasons:
        raise error
    maker = Specialiser(counting=True)
    advance, elastic = _loop(maker, parts, laws, frozenset(reasons))
    said = tuple(f"{part} cannot be compiled: {_short(why)}" for part, why in reasons.items())
    return Kernels(advance, elastic, compiled=False, reasons=said)


def _loop(
    maker: Specialiser, parts: Parts, laws: Laws, plain: frozenset[str]
) -> tuple[Callable[..., int], Callable[..., float]]:
    """Return the loop and the strain-energy kernel; parts named in `plain` and what calls them stay Python."""
    bulk: Any = None
    elastic: Any = None
    whole = not plain
    for element, material in reversed(parts):
        part = maker.with_slots(_slots(element, material))
        part.jit = maker.jit and _name(element, material) not in plain
        head = part.bind(kernels.bulk_group, cache=not whole)
        head_energy = part.bind(kernels.elastic_group, cache=not whole)
        if bulk is None:
            bulk, elastic = head, head_energy
            continue
        slots: dict[Any, Any] = {kernels.bulk_head: head, kernels.bulk_tail: bulk}
        bulk = maker.with_slots(slots).bind(kernels.bulk_chain, plain=not whole)
        slots = {kernels.elastic_head: head_energy, kernels.elastic_tail: elastic}
        elastic = maker.with_slots(slots).bind(kernels.elastic_chain, plain=not whole)
    slots = {loop.bulk: bulk, loop.elastic: elastic, loop.own_laws: escape.bind(maker, laws, plain)}
    top = maker.with_slots(slots)
    advance = top.bind(loop.advance, cache=True, plain=not whole)
    return advance, top.bind(loop.strain_energy, cache=True, plain=not whole)


def _slots(element: Any, material: Any) -> dict[Any, Any]:
    """Return the slots of the bulk update that an element and a material class fill."""
    return {
        kernels.stress: material.stress,
        kernels.energy_density: material.energy_density,
        kernels.internal_force: element.internal_force,
        kernels.energy: element.energy,
    }


def _name(element: Any, material: Any) -> str:
    """Return what a pair of element and material is called in messages."""
    return f"element {element.name} with material {material.name}"


def _short(error: Exception) -> str:
    """Return the telling line of a compiler's message."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(("Failed in", "During", "File", "<source", "- Resol"))]
    return (telling or lines or ["no reason given"])[0]
