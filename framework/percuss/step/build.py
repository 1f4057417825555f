"""Bind the kernels of a run: compiled and called by their addresses, or as plain Python."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from percuss.compiler.fingerprint import layout
from percuss.compiler.machine_code import CannotLink, jit_disabled
from percuss.compiler.readings import Readings
from percuss.compiler.specialise import Filled, Specialiser, compile_error
from percuss.compiling import LOCK, Kernel
from percuss.mesh import cell_kernels
from percuss.methods import slots
from percuss.step import actions as plain
from percuss.step import linked, stages
from percuss.step.actions import PLACES, Action
from percuss.step.linking import Block, Entrance, LinkedLoop

SWITCHED_OFF = "compilation was switched off for this run"
DISABLED = "compilation is switched off by NUMBA_DISABLE_JIT"
KEPT_KERNELS = 256  # number of bound kernels that a process keeps

TEMPLATES: Mapping[str, Kernel] = {linked.SCHEME: linked.entrance_of_scheme, linked.LOOP: linked.entrance_of_loop}
LINKED: Mapping[Kernel, Kernel] = {
    plain.perform: linked.perform,
    stages.take_step: linked.take_step,
    slots.accelerations: linked.accelerations,
    slots.internal: linked.internal,
}


class Source(NamedTuple):
    """What a kernel is bound from.

    Attributes
    ----------
    kernel
        The kernel, or a template with slots.
    slots
        The slots with what fills them, in pairs.
    kind
        Kind of the kernel, a key of `percuss.step.linked.EXAMPLES`.
    about
        The layout of the tuples that it reads.
    checked
        Whether array indices in kernels of plug-ins are checked.
    """

    kernel: Kernel
    slots: tuple[tuple[Kernel, Any], ...] = ()
    kind: str = linked.LOOP
    about: str = ""
    checked: bool = False

    @staticmethod
    def of(action: Action) -> Source:
        """Return what the kernel of an action is bound from."""
        about = layout(action.data)
        return Source(action.kernel, tuple(action.slots.items()), linked.ACTION, about, action.of_plugin)

    def bound(self, maker: Specialiser, filled: Mapping[Kernel, Kernel]) -> Kernel:
        """Return the kernel with its slots filled."""
        own = maker.with_slots({**filled, **dict(self.slots)}, self.about)
        own.checked = self.checked
        return own.bind(self.kernel)

    def entrance(self, maker: Specialiser, instructions: Mapping[Kernel, Kernel]) -> Kernel:
        """Return the kernel behind its entrance; `instructions` fill the slots that stand for those of the compiler."""
        bound = self.bound(maker, {**LINKED, **instructions})
        template = TEMPLATES.get(self.kind, linked.entrance)
        return maker.with_slots({linked.kernel: bound, **instructions}).bind(template, linked=True)


@dataclass
class _Bound:
    """A kernel as it was bound last: as plain Python or behind an entrance, and what binding it has read."""

    kernel: Any
    readings: Readings
    counting: bool
    failure: str = ""  # why it cannot be compiled


# Bound kernels of this process by what they are bound from, the one that was used last at the end.
_BOUND: OrderedDict[Any, _Bound] = OrderedDict()


def _bound(source: Source, *, jit: bool, counting: bool = False) -> _Bound:
    """Return a kernel bound from its source, unless this process has bound it before and nothing has changed since.

    Parameters
    ----------
    source
        What it is bound from.
    jit
        Whether it is compiled.
    counting
        Whether it may allocate arrays, which needs reference counts.
    """
    key = jit, source
    known = _BOUND.get(key)
    if known is None or known.counting < counting or not known.readings.unchanged(jit=jit):
        if jit:
            maker = Specialiser(counting=counting, digested_alone=True)
            tag = maker.tag_of(source.entrance(maker, {}))
            kernel: Any = Entrance(source.kind, tag, lambda: _for_the_compiler(source, counting=counting))
        else:
            maker = Specialiser(jit=False)
            kernel = source.bound(maker, {})
        known = _Bound(kernel, maker.readings, counting)
    with LOCK:
        _BOUND[key] = known
        _BOUND.move_to_end(key)
        while len(_BOUND) > KEPT_KERNELS:
            _BOUND.popitem(last=False)
    return known


def _for_the_compiler(source: Source, *, counting: bool) -> Kernel:
    from percuss.step.calls import at, call, room

    instructions: dict[Kernel, Kernel] = {linked.at: at, linked.call: call, cell_kernels.room: room}
    return source.entrance(Specialiser(counting=counting), instructions)


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

    @property
    def source(self) -> Source:
        """What the kernel is bound from; its array indices are checked."""
        return Source(self.kernel, (), linked.SCHEME, layout(self.numbers), checked=True)


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
    _kept: list[Any] = field(default_factory=list)  # blocks of memory that compiled code reads

    def linked(self, actions: Sequence[Action]) -> Any:
        """Return the actions of a step as `percuss.step.records.Step` has them."""
        ordered = sorted(actions, key=lambda action: (action.place, action.order))
        if not self.compiled:
            places: list[list[object]] = [[] for _ in PLACES]
            for action in ordered:
                places[action.place].append((_bound(Source.of(action), jit=False).kernel, action.data))
            return places
        rows = np.zeros((len(ordered), 2), dtype=np.int64)
        blocks: dict[int, Block] = {}
        for row, action in zip(rows, ordered, strict=True):
            form, row[0] = _bound(Source.of(action), jit=True).kernel.address(action.data, action.name)
            block = blocks.get(id(action.data)) or Block(action.data, form)
            blocks[id(action.data)] = block
            row[1] = block.address
        edges = np.searchsorted([action.place for action in ordered], np.arange(len(PLACES) + 1)).astype(np.int64)
        self._kept.append(blocks)
        return linked.LinkedActions(rows, edges)

    def loop(self, function: Kernel, scheme: Scheme | None = None) -> Callable[..., int]:
        """Return a loop over steps, or over the steps of a multi-stage scheme, called as the function itself is."""
        if self.compiled:
            return LinkedLoop(_bound(Source(function), jit=True).kernel)
        stage = ((slots.accelerations, stages.accelerate), (slots.internal, stages.internal_accelerations))
        filled = (*stage, (stages.take_step, Filled(scheme.kernel, stage))) if scheme else ()
        loop: Callable[..., int] = _bound(Source(function, filled), jit=False).kernel
        return loop

    def scheme(self, scheme: Scheme, system: object) -> tuple[object, object]:
        """Return what the loop of a multi-stage scheme takes for the numbers of the scheme and for its system."""
        if not self.compiled:
            return scheme.numbers, system
        accelerate = Source(stages.accelerate, (), linked.ACCELERATIONS)
        form, address = _bound(accelerate, jit=True).kernel.address(system, "the system")
        block, internal = Block(system, form), 0
        if scheme.uses_internal:
            forces = Source(stages.internal_accelerations, (), linked.INTERNAL)
            internal = _bound(forces, jit=True).kernel.address(system, "the system")[1]
        read = scheme.numbers, linked.LinkedSystem(block.address, address, internal)
        form, address = _bound(scheme.source, jit=True, counting=True).kernel.address(read, scheme.name)
        own = Block(read, form)
        self._kept.extend((block, own))
        return linked.LinkedKernel(own.address, address), read[1]


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
    failures = [_failure(Source.of(action), action.data, action.name, refuse) for action in actions]
    return tuple(dict.fromkeys(filter(None, failures)))


def _failure(source: Source, data: object, name: str, refuse: Callable[[Exception], None]) -> str:
    """Compile a kernel, without reference counts if it allocates nothing; return why that is not possible, or ""."""
    for counting in (False, True):
        bound = _bound(source, jit=True, counting=counting)
        if bound.failure:
            return bound.failure
        try:
            bound.kernel.address(data, name)
        except compile_error() as error:
            refuse(error)
            if counting or isinstance(error, CannotLink):
                bound.failure = why_not_compiled(name, error)
                return bound.failure
        else:
            return ""
    raise AssertionError


def why_not_compiled(name: str, error: Exception) -> str:
    """Return in a sentence why a kernel of `name` cannot be compiled, from the error of the compiler."""
    if isinstance(error, CannotLink):
        return str(error)
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    linking = [line.removeprefix("TypingError: ") for line in lines if ": the arguments are " in line]
    telling = [line for line in lines if not line.startswith(("Failed in", "During", "File", "<source", "- Resol"))]
    return f"{name} cannot be compiled: {(linking or telling or lines or ['no reason given'])[0]}"
