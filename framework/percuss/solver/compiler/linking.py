"""Calls of compiled kernels by their addresses, and blocks of memory with the data that only one kernel reads.

A time loop with the code of its kernels inside has to be compiled again for every method, although nearly all of it is
the same. The loop is therefore compiled once for all methods and calls each kernel by its address. The arrays and
numbers that only one kernel reads have types of their own, and a loop that received them would be a function of these
types. They are written to a block of memory, in the form that compiled code reads, and the loop receives the address of
the block.
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.registry import cpu_target
from numba.extending import intrinsic

from percuss.solver.compiled.linked import EXAMPLES, LinkedBodies, LinkedLaws, LinkedStep, LinkedSystem

Kernel = Callable[..., Any]
_FORMATS = {
    ("double", 8): "d",
    ("float", 4): "f",
    ("i8", 1): "b",
    ("i16", 2): "h",
    ("i32", 4): "i",
    ("i64", 8): "q",
}


class CannotLink(NotImplementedError):
    """Error: the data of a kernel contain something else than numbers and arrays."""


@functools.cache
def signatures() -> Mapping[str, tuple[Any, Any]]:
    """Return the type of the result and that of the tuple of arguments, for each kind of kernel."""
    return {
        kind: (types.none if result is None else numba.typeof(result), numba.typeof(arguments))
        for kind, (result, arguments) in EXAMPLES.items()
    }


# ------------------------------------------------------------------------------------- instructions for the compiler


@intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
def call(_typing: Any, kind: Any, kernel: Any, data: Any, arguments: Any) -> Any:
    """Call a kernel, in compiled code.

    Parameters
    ----------
    kind
        Kind of the kernel, a constant text: a key of `signatures`.
    kernel
        Its address.
    data
        Address of its data.
    arguments
        The tuple of its arguments.
    """
    if not isinstance(kind, types.misc.Literal):
        return None  # numba asks again without the constant after an error, and reports the first one
    result, expected = signatures()[kind.literal_value]
    found = types.containers.Tuple([types.misc.unliteral(argument) for argument in arguments])
    # A call with other arguments than the kernel was compiled for would read them from the wrong places.
    if (kernel, data, found) != (types.int64, types.int64, expected):
        raise TypingError(f"{kind.literal_value}: the arguments are {found}, expected {expected}")
    passed = types.voidptr, expected

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        convention = context.call_conv
        function = builder.inttoptr(values[1], ir.PointerType(convention.get_function_type(result, passed)))
        place = builder.inttoptr(values[2], context.get_value_type(types.voidptr))
        status, returned = convention.call_function(builder, function, result, passed, [place, values[3]])
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return returned

    return result(kind, kernel, data, expected), generate


@intrinsic  # type: ignore[untyped-decorator]
def at(_typing: Any, data: Any) -> Any:
    """Return the value at the address `data`, in compiled code."""

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return context.unpack_value(builder, data.dtype, values[0])

    return data.dtype(data), generate


def address_of(kernel: Kernel, kind: str, data: Any) -> int:
    """Return the address of the machine code of a kernel for data of the same types as `data`.

    Parameters
    ----------
    kernel
        A compiled function of the data and the tuple of its arguments.
    kind
        Key of `signatures`.
    data
        The data.
    """
    result, arguments = signatures()[kind]
    passed = types.misc.CPointer(numba.typeof(data)), arguments
    dispatcher: Any = kernel
    if passed not in dispatcher.overloads:
        dispatcher.compile(result(*passed))
    compiled = dispatcher.overloads[passed]
    if compiled.signature.return_type != result:
        raise TypingError(f"{kind}: the kernel returns {compiled.signature.return_type}, expected {result}")
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


# -------------------------------------------------------------------------------------------------- blocks of memory


class Block:
    """A block of memory with a value in the form that compiled code reads.

    Parameters
    ----------
    value
        A number, an array, or a tuple of such values, nested as it may be. The block keeps its arrays alive.
    of
        What the value belongs to, for the message of an error.

    Attributes
    ----------
    address
        Address of the block.

    Raises
    ------
    CannotLink
        If the value contains anything else.
    """

    def __init__(self, value: Any, of: str) -> None:
        self._value = value
        try:
            numbers = list(_numbers(value))
        except TypeError as error:
            raise CannotLink(f"{of} cannot be compiled: compiled kernels read numbers and arrays, {error}") from None
        form = _form(numba.typeof(value))
        self._memory = np.zeros(struct.calcsize(form) // 8 + 1, dtype=np.int64)
        struct.pack_into(form, self._memory.data, 0, *numbers)
        self.address = int(self._memory.ctypes.data)


def _numbers(value: Any) -> Iterator[Any]:
    """Return the numbers that make up a value in compiled code."""
    if isinstance(value, tuple):
        for part in value:
            yield from _numbers(part)
    elif isinstance(value, np.ndarray):
        # Neither reference count nor owner, as the block keeps the array alive.
        yield from (0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)
    elif isinstance(value, (complex, np.complexfloating)):
        yield from (value.real, value.imag)
    elif isinstance(value, (bool, int, float, np.bool, np.integer, np.floating)):
        yield value
    else:
        raise TypeError(f"not a {type(value).__name__}")


@functools.cache
def _form(kind: Any) -> str:
    """Return the places of the numbers of a type in compiled code, as a format of the module `struct`."""
    form, end = "=", 0
    for offset, layout in _places(cpu_target.target_context.get_data_type(kind), 0):
        size = layout.get_abi_size(cpu_target.target_context.target_data)
        form += "x" * (offset - end) + _FORMATS[str(layout), size]
        end = offset + size
    return form


def _places(layout: Any, offset: int) -> Iterator[tuple[int, Any]]:
    """Return the offset and the type of every number in a layout of compiled code; an address is an integer."""
    target_data = cpu_target.target_context.target_data
    if isinstance(layout, ir.ArrayType):
        step = layout.element.get_abi_size(target_data)
        for index in range(layout.count):
            yield from _places(layout.element, offset + index * step)
    elif isinstance(layout, ir.BaseStructType):
        for index, element in enumerate(layout.elements):
            yield from _places(element, offset + layout.get_element_offset(target_data, index))
    else:
        yield offset, ir.IntType(64) if layout.is_pointer else layout


# --------------------------------------------------------------------------------------------------------- the loop


class _Links:
    """What the loop receives in the place of a value, and everything that has to stay in memory meanwhile."""

    def __init__(self, value: Any, links: Any, *kept: object) -> None:
        self.value, self.links, self._kept = value, links, kept


class LinkedLoop:
    """The compiled loop of leap-frog schemes, linked to the kernels and arrays of one model.

    Parameters
    ----------
    compiled_advance
        The compiled `percuss.solver.compiled.leapfrog_loop.advance`.
    entrances
        Entrance of the kernel of each kind.
    """

    update = "bulk update"  # kind of the kernel that treats all bodies

    def __init__(self, compiled_advance: Kernel, entrances: Mapping[str, Kernel]) -> None:
        self.compiled_advance, self.entrances = compiled_advance, entrances
        # The links to the values that came last. Another thread may replace them at any time: a caller of compiled code
        # has to hold the links until the call has returned.
        self._last: dict[str, _Links] = {}

    def for_another_model(self) -> LinkedLoop:
        """Return the same loop, without links to the arrays of this model."""
        return type(self)(self.compiled_advance, self.entrances)

    def advance(self, groups: Any, masses: Any, boundary: Any, laws: Any, *others: Any) -> Any:
        """Make steps; arguments and result are those of the function that was compiled."""
        bodies, contacts = self._once("bodies", groups, self._bodies), self._once("laws", laws, self._laws)
        return self.compiled_advance(bodies.links, masses, boundary, contacts.links, *others)

    def _once(self, kind: str, value: Any, link: Callable[[Any], _Links]) -> _Links:
        links = self._last.get(kind)
        if links is None or links.value is not value:
            links = self._last[kind] = link(value)
        return links

    def _bodies(self, groups: Any) -> _Links:
        block = Block(groups, "the bodies")
        update, energy = self._address(self.update, groups), self._address("strain energy", groups)
        return _Links(groups, LinkedBodies(block.address, update, energy), block)

    def _laws(self, laws: Any) -> _Links:
        if "contact laws" not in self.entrances:
            return _Links(laws, LinkedLaws(0, 0, 0))
        block = Block(laws, "the contact laws")
        return _Links(laws, LinkedLaws(laws[0], block.address, self._address("contact laws", laws)), block)

    def _address(self, kind: str, data: Any) -> int:
        return address_of(self.entrances[kind], kind, data)


class LinkedStages(LinkedLoop):
    """The compiled loop of multi-stage schemes, linked to the kernels and arrays of one model.

    Parameters
    ----------
    compiled_advance, compiled_begin
        The compiled functions `advance` and `begin` of `percuss.solver.compiled.multistage_loop`.
    entrances
        Entrance of the kernel of each kind.
    """

    update = "internal forces"

    def __init__(self, compiled_advance: Kernel, compiled_begin: Kernel, entrances: Mapping[str, Kernel]) -> None:
        super().__init__(compiled_advance, entrances)
        self.compiled_begin = compiled_begin

    def for_another_model(self) -> LinkedStages:
        """Return the same loop, without links to the arrays of this model."""
        return type(self)(self.compiled_advance, self.compiled_begin, self.entrances)

    def advance(self, system: Any, numbers: Any, *others: Any) -> Any:
        """Make steps; arguments and result are those of the function that was compiled."""
        linked = self._once("system", system, self._system)
        step = self._once("step", system, lambda _: self._step(linked, numbers))
        return self.compiled_advance(linked.links[0], step.links, *others)

    def begin(self, system: Any, *others: Any) -> None:
        """Set the first accelerations; arguments are those of the function that was compiled."""
        linked = self._once("system", system, self._system)
        self.compiled_begin(linked.links[1], *others)

    def _system(self, system: Any) -> _Links:
        bodies, laws = self._once("bodies", system.groups, self._bodies), self._once("laws", system.laws, self._laws)
        linked = system._replace(groups=bodies.links, laws=laws.links)
        block = Block(linked, "the system")
        accelerate = self._address("accelerations of a stage", linked)
        return _Links(system, (linked, LinkedSystem(block.address, accelerate)), bodies, laws, block)

    def _step(self, system: _Links, numbers: Any) -> _Links:
        data = numbers, system.links[1]
        block = Block(data, "the step")
        return _Links(system.value, LinkedStep(block.address, self._address("step of a scheme", data)), block, system)
