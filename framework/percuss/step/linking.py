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

import ctypes
import itertools
import pickle
import struct
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from percuss.compiler import machine_code
from percuss.compiler.fingerprint import layout
from percuss.compiler.machine_code import CannotLink
from percuss.compiling import Kernel, compiler

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

    def __init__(self, value: object, form: str, numbers: Iterable[Any] | None = None) -> None:
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


def _numbers(value: object) -> list[Any]:
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


# --------------------------------------------------------------------------------------------------------- entrances


class Entrance:
    """The compiled code of one kernel, by its address.

    Parameters
    ----------
    kind
        Kind of the kernel, a key of `percuss.step.linked.EXAMPLES`.
    tag
        Digest of all the code that is reached from it; empty where it cannot be stored.
    bind
        Returns it bound for the compiler. It is called when its machine code is not stored.
    """

    def __init__(self, kind: str, tag: str, bind: Callable[[], Kernel]) -> None:
        self.kind, self.tag, self._bind = kind, tag, bind
        self._bound: Kernel | None = None
        self._known: dict[object, tuple[str, int]] = {}  # form of the block and address, by structure of the data

    def address(self, data: Any, of: str) -> tuple[str, int]:
        """Return the form of a block of `data`, and the address of the machine code that reads it.

        Raises
        ------
        CannotLink
            If compiled code cannot read the data, which belong to what `of` names.
        """
        try:
            key = structure(data)
        except CannotLink as error:
            raise CannotLink(f"{of} cannot be compiled: compiled kernels read numbers and arrays, {error}") from None
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = self._compiled(data, f"{key!r};{layout(data)}", of)
        return known

    def _compiled(self, data: object, about: str, of: str) -> tuple[str, int]:
        stored_as = machine_code.key_of(self.tag, self.kind, about) if self.tag else ""
        with compiler():
            stored = machine_code.address_of_stored(stored_as) if stored_as else None
            if stored is not None:
                address, form = stored
                return form, address
            from percuss.step import calls

            self._bound = self._bound or self._bind()
            return calls.compiled(self._bound, self.kind, stored_as, data, of)


class _Call(NamedTuple):
    """The last call of a loop: its arguments with the numbers of each, their block with its form, and the address."""

    arguments: tuple[Any, ...]
    numbers: list[list[Any]]
    form: str
    address: int
    block: Block

    def fits(self, arguments: tuple[object, ...]) -> bool:
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
    """A compiled loop, called from Python.

    Parameters
    ----------
    entrance
        The entrance of the loop.
    """

    def __init__(self, entrance: Entrance) -> None:
        self._entrance = entrance
        self._last: _Call | None = None  # another thread may replace it: a caller holds it until the call has returned

    def __call__(self, *arguments: object) -> int:
        """Call the loop; numbers and arrays of its arguments are written to a block, unless they are those before."""
        last = self._last
        if last is None or not last.fits(arguments):
            form, address = self._entrance.address(arguments, "the loop")
            numbers = [_numbers(argument) for argument in arguments]
            last = _Call(arguments, numbers, form, address, Block(arguments, form, itertools.chain(*numbers)))
        elif not all(new is old for new, old in zip(arguments, last.arguments, strict=True)):
            given = zip(arguments, last.arguments, last.numbers, strict=True)
            numbers = [numbers if new is old else _numbers(new) for new, old, numbers in given]
            block = Block(arguments, last.form, itertools.chain(*numbers))
            last = last._replace(arguments=arguments, numbers=numbers, block=block)
        self._last = last
        return call_at(last.address, last.block)
