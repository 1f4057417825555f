"""The actions of a step as compiled code performs them: by the addresses of their kernels and of their data.

Each kernel is compiled behind an *entrance*, a function of C with one signature, which finds its data at their address.
So the loop is compiled once, whatever kernels its steps perform. The arrays and numbers that only one kernel reads lie
in a block of memory, in the form that compiled code reads. This module imports numba; `build` imports it when something
is compiled.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import TypingError, types
from numba.extending import intrinsic

from percuss.methods.slots import unbound
from percuss.record_arrays import Records

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Integers


class LinkedActions(NamedTuple):
    """The actions of all places of a step."""

    addresses: Integers  # (actions, 2) of the kernel of each, and of its data
    edges: Integers  # (places + 1,) index of the first action of each place, and the number of all actions


class LinkedKernel(NamedTuple):
    """A single kernel: addresses of its data and of its code."""

    data: int
    apply: int


class LinkedSystem(NamedTuple):
    """The system of a multi-stage scheme, and the functions for the accelerations and internal forces in a stage."""

    data: int
    accelerate: int
    internal: int  # 0 if the scheme does not ask for them


# -------------------------------------------------------------------------------------------------- blocks of memory

# The values that data may contain, in tuples; a subclass may mean more than its numbers, as a masked array does.
ARRAYS = frozenset({np.ndarray, np.recarray, np.memmap, Records})
NUMBERS = (bool, int, float, complex, np.bool, np.number)
FORMATS = {"b1": "?", "f4": "f", "f8": "d", "c8": "ff", "c16": "dd"} | {
    f"{sign}{size}": letter if sign == "i" else letter.upper()
    for sign in "iu"
    for size, letter in ((1, "b"), (2, "h"), (4, "i"), (8, "q"))
}


class CannotLink(NotImplementedError):
    """Error: a kernel cannot be called by its address, as its data contain something else than numbers and arrays."""


class Block:
    """A block of memory with a number, an array, or a tuple of such values; it keeps its arrays alive.

    Attributes
    ----------
    address
        Its address.

    Raises
    ------
    CannotLink
        If the value contains anything else.
    """

    def __init__(self, value: object) -> None:
        self._value = value
        form, numbers = _words(value)
        self._memory = np.zeros(struct.calcsize(form) // 8 + 1, dtype=np.int64)
        struct.pack_into(form, self._memory.data, 0, *numbers)
        self.address = int(self._memory.ctypes.data)


def _words(value: Any) -> tuple[str, list[Any]]:
    """Return the format, for the module `struct`, and the numbers that make up a value in compiled code."""
    if isinstance(value, tuple):
        parts = [_words(part) for part in value]
        form = "".join(form for form, _ in parts)
        widest = max([letter for letter in form if letter != "0"], key=struct.calcsize, default="b")
        # It begins and ends where its widest number may lie.
        return f"0{widest}{form}0{widest}", [number for _, numbers in parts for number in numbers]
    if type(value) in ARRAYS:
        # Neither reference count nor owner, as the block keeps the array alive.
        numbers = [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]
        return "q" * len(numbers), numbers
    form = FORMATS.get(np.dtype(type(value)).str[1:], "") if isinstance(value, NUMBERS) else ""
    if not form or (isinstance(value, int) and not -(2**63) <= value < 2**63):
        raise CannotLink(f"compiled kernels read numbers and arrays, not a {type(value).__name__}")
    return form, [value.real, value.imag] if len(form) == 2 else [value]


# ------------------------------------------------------------------------------------------------------ instructions

# What every entrance is called with beside its data: number of the step or stage, time step, three arrays of as many
# entries (the third one in rows), that number, and the number of rows. It returns 0, or 1 after an error.
PASSES_ON = "a kernel passes on"
_LINE = types.CPointer(types.float64)
SIGNATURE = (types.int64, types.float64, _LINE, _LINE, _LINE, types.int64, types.int64)
_ADDRESSES = (types.int64, types.float64, types.uintp, types.uintp, types.uintp, types.int64, types.int64)


@intrinsic  # type: ignore[untyped-decorator]
def at(_typing: Any, data: Any) -> Any:
    """Return the value at the address `data`."""

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return context.unpack_value(builder, data.dtype, values[0])

    return data.dtype(data), generate


@intrinsic  # type: ignore[untyped-decorator]
def address(_typing: Any, array: Any) -> Any:
    """Return the address of the numbers of an array, which an entrance reads one after the other."""
    if not isinstance(array, types.Array) or (array.dtype, array.layout) != (types.float64, "C"):
        raise TypingError(f"{PASSES_ON} {array}, expected an array of float64 without gaps")

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        place = context.make_array(array)(context, builder, values[0]).data
        return builder.ptrtoint(place, context.get_value_type(types.uintp))

    return types.uintp(array), generate


@intrinsic  # type: ignore[untyped-decorator]
def call_address(
    _typing: Any, kernel: Any, data: Any, n: Any, dt: Any, u: Any, v: Any, a: Any, size: Any, rows: Any
) -> Any:
    """Call an entrance by its address; all addresses are integers."""

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [value.type for value in values[1:]])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), values[1:])

    return types.int32(types.int64, types.int64, *_ADDRESSES), generate


def _array(context: Any, builder: Any, place: Any, *shape: Any) -> Any:
    """Return the array of numbers at a place, with no owner: `numba.carray` would count references to it."""
    number, width = context.get_value_type(types.float64), context.get_constant(types.intp, 8)

    def sizes(*values: Any) -> Any:
        return context.make_tuple(builder, types.UniTuple(types.intp, len(values)), values)

    array = context.make_array(types.Array(types.float64, len(shape), "C"))(context, builder)
    array.data = builder.bitcast(place, ir.PointerType(number))
    array.shape = sizes(*shape)
    array.strides = sizes(*([builder.mul(width, shape[1])] if shape[1:] else []), width)
    array.itemsize, array.nitems = width, builder.mul(shape[0], shape[1]) if shape[1:] else shape[0]
    array.meminfo = context.get_constant_null(types.MemInfoPointer(types.float64))
    array.parent = context.get_constant_null(types.pyobject)
    return array._getvalue()


@intrinsic  # type: ignore[untyped-decorator]
def line(_typing: Any, place: Any, size: Any) -> Any:
    """Return the array of `size` numbers at a place."""

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return _array(context, builder, *values)

    return types.Array(types.float64, 1, "C")(place, types.intp), generate


@intrinsic  # type: ignore[untyped-decorator]
def table(_typing: Any, place: Any, rows: Any, size: Any) -> Any:
    """Return the array of rows of `size` numbers at a place."""

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return _array(context, builder, *values)

    return types.Array(types.float64, 2, "C")(place, types.intp, types.intp), generate


@intrinsic  # type: ignore[untyped-decorator]
def room(_typing: Any, rows: Any, columns: Any) -> Any:
    """Return an array for a number for each pair of an entry of two tuples.

    It lies on the stack of the calling function. The compiler knows its size and that no other array overlaps it, so
    that loops over it are unrolled and its numbers kept in registers.
    """

    def generate(context: Any, builder: Any, _signature: Any, _values: Any) -> Any:
        with builder.goto_entry_block():
            place = builder.alloca(ir.ArrayType(context.get_value_type(types.float64), rows.count * columns.count))
        return _array(
            context, builder, place, *(context.get_constant(types.intp, one.count) for one in (rows, columns))
        )

    return types.Array(types.float64, 2, "C")(rows, columns), generate


# --------------------------------------------------------------------------------------------------------- entrances


def kernel(data: Any, *arguments: Any) -> Any:
    """Compute what the kernel does (slot)."""
    unbound()


def entrance(data: Any, n: int, dt: float, u: Any, v: Any, a: Any, size: int, rows: int) -> int:
    """Call the kernel of an action, or the accelerations in a stage."""
    try:
        kernel(at(data), n, line(u, size), line(v, size), line(a, size))
    except Exception:  # noqa: BLE001  a kernel may raise anything
        return 1
    return 0


def entrance_of_forces(data: Any, n: int, dt: float, u: Any, v: Any, a: Any, size: int, rows: int) -> int:
    """Call the internal forces in a stage."""
    try:
        kernel(at(data), n, line(u, size), line(a, size))
    except Exception:  # noqa: BLE001
        return 1
    return 0


def entrance_of_scheme(data: Any, n: int, dt: float, u: Any, v: Any, a: Any, size: int, rows: int) -> int:
    """Call the kernel of a multi-stage scheme with its numbers and the system."""
    numbers, system = at(data)
    try:
        kernel(numbers, system, line(u, size), line(v, size), table(a, rows, size), dt)
    except Exception:  # noqa: BLE001
        return 1
    return 0


# ------------------------------------------------------------------------------------------------- what fills the loop


def call(kernel: int, data: int, n: int, dt: float, u: Floats, v: Floats, a: Any) -> None:
    """Call an entrance with arrays of as many entries; the third one may have rows of them."""
    rows = a.size // max(u.size, 1)
    if call_address(kernel, data, n, dt, address(u), address(v), address(a), u.size, rows) != 0:
        raise RuntimeError("an exception was raised in a compiled kernel")


def perform(actions: LinkedActions, place: int, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Perform the actions of one place of a step."""
    for k in range(actions.edges[place], actions.edges[place + 1]):
        call(actions.addresses[k, 0], actions.addresses[k, 1], n, 0.0, u, v, a)


def accelerations(system: LinkedSystem, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to the accelerations in a stage."""
    call(system.accelerate, system.data, stage, 0.0, u, v, a)


def internal(system: LinkedSystem, stage: int, u: Floats, f: Floats) -> None:
    """Set `f` to the internal forces in a stage, over the masses."""
    call(system.internal, system.data, stage, 0.0, u, u, f)


def take_step(numbers: LinkedKernel, system: object, u: Floats, v: Floats, kept: Floats, dt: float) -> None:
    """Make one step of the integrator."""
    call(numbers.apply, numbers.data, 0, dt, u, v, kept)
