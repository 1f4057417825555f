"""Calls of compiled kernels by their addresses, and blocks of memory with the data that only one kernel reads.

A time loop with the code of its kernels inside has to be compiled again for every method, although nearly all of it is
the same. The loop is therefore compiled once for all methods and calls each kernel by its address. The arrays and
numbers that only one kernel reads have types of their own, and a loop that received them would be a function of these
types. They are written to a block of memory, in the form that compiled code reads, and the loop receives the address of
the block. The loop itself is called in the same way: a block holds all that it reads.

Nothing here imports numba: what earlier processes have stored runs without it (`percuss.compiler.machine_code`).
What is not stored yet is compiled by `percuss.step.calls`.
"""

from __future__ import annotations

import copy
import ctypes
import itertools
import pickle
import struct
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple, Self

import numpy as np

from percuss.compiler import machine_code
from percuss.compiler.fingerprint import layout
from percuss.compiler.machine_code import CannotLink
from percuss.compiling import compiler
from percuss.step.linked import LinkedBodies, LinkedKernel, LinkedLaws, LinkedSystem

Kernel = Callable[..., Any]
# The values that data may contain, in tuples; a subclass may mean more than its numbers, as a masked array does.
ARRAYS = frozenset({np.ndarray, np.recarray, np.memmap})
NUMBERS = (bool, int, float, complex, np.bool, np.integer, np.float32, np.float64, np.complex64, np.complex128)


# -------------------------------------------------------------------------------------------------- blocks of memory


class Block:
    """A block of memory with a value in the form that compiled code reads.

    Parameters
    ----------
    value
        A number, an array, or a tuple of such values, nested as it may be. The block keeps its arrays alive.
    form
        The places of its numbers, as `percuss.step.calls.form_of` returns them for its type.
    numbers
        Its numbers, where they are known.

    Attributes
    ----------
    address
        Address of the block.
    """

    def __init__(self, value: Any, form: str, numbers: Iterable[Any] | None = None) -> None:
        self._value = value
        self._memory = np.zeros(struct.calcsize(form) // 8 + 1, dtype=np.int64)
        struct.pack_into(form, self._memory.data, 0, *(_numbers(value) if numbers is None else numbers))
        self.address = int(self._memory.ctypes.data)


def structure(value: Any) -> Any:
    """Return classes and dtypes in a value, on which its type in compiled code depends; numba finds that type slowly.

    Raises
    ------
    CannotLink
        If the value contains anything else than numbers, arrays, and tuples of them.
    """
    if isinstance(value, tuple):
        return (type(value), *map(structure, value))
    if type(value) in ARRAYS:
        dtype, flags = value.dtype, value.flags
        order = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"  # of one row they are all the same
        return dtype, dtype.isalignedstruct, value.ndim, order, flags.writeable, flags.aligned
    if not isinstance(value, NUMBERS):
        raise CannotLink(f"not a {type(value).__name__}")
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise CannotLink("not an integer of more than 64 bits")
    return type(value)


def _numbers(value: Any) -> list[Any]:
    """Return the numbers that make up a value in compiled code."""
    if isinstance(value, tuple):
        return [number for part in value for number in _numbers(part)]
    if isinstance(value, np.ndarray):
        # Neither reference count nor owner, as the block keeps the array alive.
        return [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]
    if isinstance(value, (complex, np.complexfloating)):
        return [value.real, value.imag]
    if isinstance(value, np.unsignedinteger):
        return [int(value.view(f"i{value.itemsize}"))]  # the same bits
    return [int(value) if isinstance(value, np.bool) else value]


# ------------------------------------------------------------------------------------------------------------- calls


class _Exception(ctypes.Structure):
    """What compiled code leaves of an exception: the pickled class, arguments and place, if they were constants."""

    _fields_ = (
        ("pickled", ctypes.c_void_p),
        ("size", ctypes.c_int32),
        ("digest", ctypes.c_void_p),
        ("unwrap", ctypes.c_void_p),
        ("variable", ctypes.c_int32),
    )


class CompiledError(RuntimeError):
    """Error of a compiled kernel whose own class and arguments are not known."""


# The result is a status. The returned number is written to the first place.
_CALL = ctypes.CFUNCTYPE(
    ctypes.c_int32, ctypes.POINTER(ctypes.c_int64), ctypes.POINTER(ctypes.POINTER(_Exception)), ctypes.c_void_p
)


NO_ERROR = (0, -2)  # statuses of a function that has returned a number, or None


def call_at(address: int, block: Block) -> int:
    """Call a compiled function of a block of data, without other threads having to wait; return its integer result."""
    result, exception = ctypes.c_int64(), ctypes.POINTER(_Exception)()
    if _CALL(address)(ctypes.byref(result), ctypes.byref(exception), block.address) not in NO_ERROR:
        raise _raised(exception)
    return result.value


def _raised(exception: Any) -> BaseException:
    if exception and not exception.contents.variable:
        # The pickle is a constant of the compiled code.
        text = ctypes.string_at(exception.contents.pickled, exception.contents.size)
        raised, arguments, *_ = pickle.loads(text)  # noqa: S301
        if isinstance(raised, type) and issubclass(raised, Exception):
            return raised(*(arguments or ()))
    return CompiledError("an exception was raised in compiled code")


# --------------------------------------------------------------------------------------------------------- the loop


class Entrances:
    """The entrances of the kernels and loops of one kind of model.

    Parameters
    ----------
    tags
        Digest of all the code that is reached from the entrance of each kind; empty where it cannot be stored.
    bind
        Returns the entrances, bound for the compiler. It is called when the machine code of one is not stored.
    """

    def __init__(self, tags: Mapping[str, str], bind: Callable[[], Mapping[str, Kernel]]) -> None:
        self.tags, self._bind = tags, bind
        self._bound: Mapping[str, Kernel] = {}

    def addresses(self, kinds: tuple[str, ...], data: Any, of: str) -> tuple[str, list[int]]:
        """Return the form of a block of `data`, and the addresses of the machine code of several kinds that read it."""
        about = f"{structure(data)!r};{layout(data)}"
        keys = [machine_code.key_of(self.tags[kind], kind, about) if self.tags[kind] else "" for kind in kinds]
        with compiler():
            stored = [machine_code.address_of_stored(key) if key else None for key in keys]
            found = [each for each in stored if each is not None]
            if len(found) == len(keys):
                return found[0][1], [address for address, _ in found]
            from percuss.step import calls

            self._bound = self._bound or self._bind()
            entrances = [(self._bound[kind], kind, key) for kind, key in zip(kinds, keys, strict=True)]
            return calls.compiled(entrances, data, of)


class _Links:
    """What the loop receives in the place of a value, and everything that has to stay in memory meanwhile."""

    def __init__(self, value: Any, links: Any, *kept: object) -> None:
        self.value, self.links, self._kept = value, links, kept


class _Call(NamedTuple):
    """The last call of a loop: its arguments with the numbers of each, their block with its form, and the address."""

    arguments: tuple[Any, ...]
    numbers: list[list[Any]]
    form: str
    address: int
    block: Block

    def fits(self, arguments: tuple[Any, ...]) -> bool:
        """Return whether these arguments have the same structure as those of the last call."""
        try:
            return len(arguments) == len(self.arguments) and all(
                structure(new) == structure(old)
                for new, old in zip(arguments, self.arguments, strict=True)
                if new is not old
            )
        except CannotLink:  # which is told when they are linked
            return False


class LinkedLoop:
    """The compiled loop of leap-frog schemes, linked to the kernels and arrays of one model.

    Parameters
    ----------
    entrances
        Entrances of the kernels and of the loop.
    """

    update = "bulk update"  # kind of the kernel that treats all bodies

    def __init__(self, entrances: Entrances) -> None:
        self.entrances = entrances
        # Form of the block, and addresses of the kernels, of each structure of data that was met.
        self._known: dict[Any, tuple[str, list[int]]] = {}
        # The links to the values that came last. Another thread may replace them at any time: a caller of compiled code
        # has to hold the links until the call has returned.
        self._last: dict[str, _Links] = {}
        self._calls: dict[str, _Call] = {}

    def for_another_model(self) -> Self:
        """Return the same loop, without links to the arrays of this model."""
        loop = copy.copy(self)
        loop._last, loop._calls = {}, {}
        return loop

    def advance(self, loop: Any, *others: Any) -> int:
        """Make steps; arguments and result are those of `percuss.step.loop.advance`."""
        return self._call("leap-frog loop", (self._once("loop", loop, self._loop).links, *others))

    def _loop(self, loop: Any) -> _Links:
        link_bodies = self._uniform_bodies if loop.uniform.size > 0 else self._bodies
        bodies, laws = self._once("bodies", loop.groups, link_bodies), self._once("laws", loop.laws, self._laws)
        loads = self._once("loads", loop.loads, self._loads)
        linked = loop._replace(groups=bodies.links, laws=laws.links, loads=loads.links)
        return _Links(loop, linked, bodies, laws, loads)

    def _call(self, kind: str, arguments: tuple[Any, ...]) -> int:
        last = self._calls.get(kind)
        if last is None or not last.fits(arguments):
            form, (address,) = self._known_link(arguments, "the loop", kind)
            numbers = [_numbers(argument) for argument in arguments]
            last = _Call(arguments, numbers, form, address, Block(arguments, form, itertools.chain(*numbers)))
        elif not all(new is old for new, old in zip(arguments, last.arguments, strict=True)):
            given = zip(arguments, last.arguments, last.numbers, strict=True)
            numbers = [numbers if new is old else _numbers(new) for new, old, numbers in given]
            block = Block(arguments, last.form, itertools.chain(*numbers))
            last = last._replace(arguments=arguments, numbers=numbers, block=block)
        self._calls[kind] = last
        return call_at(last.address, last.block)

    def _once(self, name: str, value: Any, link: Callable[[Any], _Links]) -> _Links:
        links = self._last.get(name)
        if links is None or links.value is not value:
            links = self._last[name] = link(value)
        return links

    def _bodies(self, groups: Any) -> _Links:
        block, addresses = self._link(groups, "the bodies", self.update, "strain energy")
        return _Links(groups, LinkedBodies(block.address, *addresses), block)

    def _uniform_bodies(self, groups: Any) -> _Links:
        """Return the links of uniform bars, which the loop advances itself, without the kernel of their update."""
        block, (energy,) = self._link(groups, "the bodies", "strain energy")
        return _Links(groups, LinkedBodies(block.address, 0, energy), block)

    def _laws(self, laws: Any) -> _Links:
        if "contact laws" not in self.entrances.tags:
            return _Links(laws, LinkedLaws(0, 0, 0))
        block, addresses = self._link(laws, "the contact laws", "contact laws")
        return _Links(laws, LinkedLaws(laws[0], block.address, *addresses), block)

    def _loads(self, loads: Any) -> _Links:
        if "following loads" not in self.entrances.tags:
            return _Links(loads, LinkedKernel(0, 0))
        block, addresses = self._link(loads, "the loads", "following loads")
        return _Links(loads, LinkedKernel(block.address, *addresses), block)

    def _link(self, data: Any, of: str, *kinds: str) -> tuple[Block, list[int]]:
        """Return a block with the data of one or more kernels, and the addresses of these kernels."""
        form, addresses = self._known_link(data, of, *kinds)
        return Block(data, form), addresses

    def _known_link(self, data: Any, of: str, *kinds: str) -> tuple[str, list[int]]:
        """Return the form of a block with such data, and the addresses of the kernels that read it."""
        try:
            key = kinds, structure(data)
        except CannotLink as error:
            raise CannotLink(f"{of} cannot be compiled: compiled kernels read numbers and arrays, {error}") from None
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = self.entrances.addresses(kinds, data, of)
        return known


class LinkedStages(LinkedLoop):
    """The compiled loop of multi-stage schemes, linked to the kernels and arrays of one model."""

    update = "internal forces"

    def advance(self, system: Any, numbers: Any, *others: Any) -> int:
        """Make steps; arguments and result are those of `percuss.step.stages.advance`."""
        linked = self._once("system", system, self._system)
        step = self._last.get("step")
        if step is None or step.value[0] is not linked or step.value[1] is not numbers:
            step = self._last["step"] = self._step(linked, numbers)
        return self._call("multi-stage loop", (linked.links[0], step.links, *others))

    def begin(self, system: Any, *others: Any) -> None:
        """Set the first accelerations; arguments are those of `percuss.step.stages.begin`."""
        linked = self._once("system", system, self._system)
        self._call("first accelerations", (linked.links[1], *others))

    def _system(self, system: Any) -> _Links:
        bodies, laws = self._once("bodies", system.groups, self._bodies), self._once("laws", system.laws, self._laws)
        loads = self._once("loads", system.loads, self._loads)
        aside = self._once("bodies aside", system.groups_aside, self._bodies)
        linked = system._replace(groups=bodies.links, groups_aside=aside.links, laws=laws.links, loads=loads.links)
        kinds = ("accelerations of a stage", "internal forces of a stage")
        block, addresses = self._link(linked, "the system", *(kind for kind in kinds if kind in self.entrances.tags))
        own = LinkedSystem(block.address, addresses[0], addresses[1] if len(addresses) == len(kinds) else 0)
        return _Links(system, (linked, own), bodies, aside, laws, loads, block)

    def _step(self, system: _Links, numbers: Any) -> _Links:
        block, addresses = self._link((numbers, system.links[1]), "the step", "step of a scheme")
        return _Links((system, numbers), LinkedKernel(block.address, *addresses), block)
