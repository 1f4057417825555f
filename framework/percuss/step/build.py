"""Bind the kernels of a run: compiled and called by their addresses, or as plain Python."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from percuss.jit import (
    LOCK,
    Binder,
    Bound,
    Compiled,
    Filled,
    Kernel,
    compile_error,
    compiler,
    each,
    entry,
    jit_disabled,
    plain,
    structure_of,
    type_of,
)
from percuss.mesh import cell_kernels
from percuss.methods import slots
from percuss.step import actions as plain_actions
from percuss.step import stages
from percuss.step.actions import PLACES, Action

SWITCHED_OFF = "compilation was switched off for this run"
DISABLED = "compilation is switched off by NUMBA_DISABLE_JIT"
KEPT_KERNELS = 256  # number of bound kernels that a process keeps
Slots = tuple[tuple[Kernel, Any], ...]


class Entrance:
    """A compiled kernel, called by its address; it is compiled once for each type of its data.

    Parameters
    ----------
    kernel, filled
        The kernel, and what fills its slots.
    template
        Name of its entrance in `percuss.step.linked`.
    allocates, checked
        As of `percuss.jit.Binder`.

    Attributes
    ----------
    failure
        Why it cannot be compiled; empty if it can.
    """

    def __init__(self, kernel: Kernel, filled: Slots, template: str, *, allocates: bool, checked: bool) -> None:
        from percuss.step import linked

        with compiler():
            bound = _binder(filled, allocates=allocates, checked=checked).callee(kernel)
            self._bound = Binder({linked.kernel: bound}, allocates=allocates).bind(getattr(linked, template))
        self._compiled: dict[Any, Any] = {}
        self.failure = ""

    def address(self, data: Any) -> int:
        """Return the address of the machine code that reads `data`.

        Raises
        ------
        CannotLink
            If compiled code cannot read the data.
        """
        import numba

        from percuss.step.linked import SIGNATURE, CannotLink

        try:
            structure = structure_of(data)
            kind = None if structure in self._compiled else type_of(data)
        except ValueError as error:  # as for an array of objects
            raise CannotLink(str(error)) from None
        with LOCK:
            if structure not in self._compiled:
                signature = numba.types.int32(numba.types.CPointer(kind), *SIGNATURE)
                self._compiled[structure] = entry(self._bound, numba.cfunc, signature)
        return int(self._compiled[structure].address)


def _binder(filled: Slots, *, allocates: bool = False, checked: bool = False) -> Binder:
    import numba

    from percuss.step import linked

    instructions: dict[Kernel, Any] = {
        plain_actions.perform: linked.perform,
        stages.take_step: linked.take_step,
        slots.accelerations: linked.accelerations,
        slots.internal: linked.internal,
        cell_kernels.room: linked.room,
        each: Bound(numba.prange, "prange"),
    }
    return Binder({**instructions, **dict(filled)}, allocates=allocates, checked=checked)


@lru_cache(maxsize=KEPT_KERNELS)
def _entrance(kernel: Kernel, filled: Slots, template: str, *, allocates: bool, checked: bool) -> Entrance:
    return Entrance(kernel, filled, template, allocates=allocates, checked=checked)


@lru_cache(maxsize=KEPT_KERNELS)
def _plain(kernel: Kernel, filled: Slots) -> Kernel:
    return plain(kernel, dict(filled))


@lru_cache(maxsize=16)
def _loop(function: Kernel) -> Compiled:
    return Compiled(_binder(()).bind(function))


class _Loop:
    """A compiled loop over the steps of a stretch of a run, whose arguments always have the same types."""

    def __init__(self, compiled: Compiled) -> None:
        self._compiled = compiled
        self._function: Callable[..., int] | None = None

    def __call__(self, *arguments: object) -> int:
        if self._function is None:
            self._function = self._compiled.of(arguments)
        return self._function(*arguments)


_ALLOCATING: set[tuple[Kernel, Slots]] = set()  # kernels that allocate arrays and do not say so


def _of_action(action: Action, *, allocates: bool | None = None) -> Entrance:
    filled = tuple(action.slots.items())
    if allocates is None:
        allocates = action.allocates or (action.kernel, filled) in _ALLOCATING
    return _entrance(action.kernel, filled, "entrance", allocates=allocates, checked=action.of_plugin)


@dataclass(frozen=True)
class Scheme:
    """The kernel of a multi-stage scheme.

    Attributes
    ----------
    kernel
        Its step.
    numbers
        The numbers that it reads.
    uses_internal
        Whether it asks for internal forces.
    name
        Of the integrator, for the text of an error.
    """

    kernel: Kernel
    numbers: Any
    uses_internal: bool
    name: str


@dataclass(frozen=True)
class Kernels:
    """How the kernels of a run are called.

    Attributes
    ----------
    compiled
        Whether they are compiled.
    reasons
        Why they are not.
    """

    compiled: bool
    reasons: tuple[str, ...] = ()
    _kept: list[Any] = field(default_factory=list)  # what has the memory that compiled code reads

    def linked(self, actions: Sequence[Action]) -> Any:
        """Return the actions of a step as `percuss.step.records.Step` has them."""
        ordered = sorted(actions, key=lambda action: (action.place, action.order))
        if not self.compiled:
            places: list[list[object]] = [[] for _ in PLACES]
            for action in ordered:
                places[action.place].append((_plain(action.kernel, tuple(action.slots.items())), action.data))
            return places
        from percuss.step.linked import LinkedActions

        rows = np.zeros((len(ordered), 2), dtype=np.int64)
        for row, action in zip(rows, ordered, strict=True):
            row[:] = _of_action(action).address(action.data), action.block.address
        edges = np.searchsorted([action.place for action in ordered], np.arange(len(PLACES) + 1)).astype(np.int64)
        self._kept.append(ordered)
        return LinkedActions(rows, edges)

    def loop(self, function: Kernel, scheme: Scheme | None = None) -> Callable[..., int]:
        """Return a loop over steps, or over the steps of a multi-stage scheme, called as the function itself is."""
        if self.compiled:
            return _Loop(_loop(function))
        stage = ((slots.accelerations, stages.accelerate), (slots.internal, stages.internal_accelerations))
        filled = (*stage, (stages.take_step, Filled(scheme.kernel, stage))) if scheme else ()
        return _plain(function, filled)

    def scheme(self, scheme: Scheme, system: object) -> tuple[object, object]:
        """Return what the loop of a multi-stage scheme takes for the numbers of the scheme and for its system."""
        if not self.compiled:
            return scheme.numbers, system
        from percuss.step.linked import Block, LinkedKernel, LinkedSystem

        def address(kernel: Kernel, template: str, data: object, *, of_plugin: bool = False) -> int:
            return _entrance(kernel, (), template, allocates=of_plugin, checked=of_plugin).address(data)

        block, internal = Block(system), 0
        accelerate = address(stages.accelerate, "entrance", system)
        if scheme.uses_internal:
            internal = address(stages.internal_accelerations, "entrance_of_forces", system)
        read = scheme.numbers, LinkedSystem(block.address, accelerate, internal)
        own = Block(read)
        self._kept.extend((block, own))
        step = address(scheme.kernel, "entrance_of_scheme", read, of_plugin=True)
        return LinkedKernel(own.address, step), read[1]


def kernels(*, compiled: bool = True) -> Kernels:
    """Return how the kernels of a run are called: compiled, unless that is not wanted or switched off."""
    if not compiled:
        return Kernels(False, (SWITCHED_OFF,))
    return Kernels(False, (DISABLED,)) if jit_disabled() else Kernels(True)


def compile_actions(actions: Sequence[Action], refuse: Callable[[Exception], None]) -> tuple[str, ...]:
    """Compile the kernels of actions; return a sentence for each that cannot be compiled.

    Parameters
    ----------
    actions
        The actions of a step.
    refuse
        Called with an error of the compiler; raises an error where plain Python would not help.
    """
    failures = [_failure(action, refuse) for action in actions]
    return tuple(dict.fromkeys(filter(None, failures)))


def _failure(action: Action, refuse: Callable[[Exception], None]) -> str:
    """Compile the kernel of an action; return why that is not possible, or "".

    A kernel that allocates arrays needs reference counts; one that does not say so is compiled twice.
    """
    from percuss.step.linked import CannotLink

    for allocates in (None, True):
        entrance = _of_action(action, allocates=allocates)
        if entrance.failure:
            return entrance.failure
        try:
            _ = action.block  # its data may be such that compiled code cannot read them
            entrance.address(action.data)
        except compile_error() as error:
            refuse(error)
            if allocates or action.allocates or isinstance(error, CannotLink):
                entrance.failure = why_not_compiled(action.name, error)
                return entrance.failure
            _ALLOCATING.add((action.kernel, tuple(action.slots.items())))
        else:
            return ""
    raise AssertionError


def why_not_compiled(name: str, error: Exception) -> str:
    """Return in a sentence why a kernel of `name` cannot be compiled, from the error of the compiler."""
    from percuss.step.linked import PASSES_ON, CannotLink

    if isinstance(error, CannotLink):
        return f"{name} cannot be compiled: {error}"
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    own = [line.removeprefix("TypingError: ") for line in lines if PASSES_ON in line]
    telling = [line for line in lines if not line.startswith(("Failed in", "During", "File", "<source", "- Resol"))]
    return f"{name} cannot be compiled: {(own or telling or lines or ['no reason given'])[0]}"
