"""Calls of compiled kernels by their addresses, and blocks of memory with the data that only one kernel reads.

A time loop with the code of its kernels inside has to be compiled again for every method, although nearly all of it is
the same. The loop is therefore compiled once for all methods and calls each kernel by its address. The arrays and
numbers that only one kernel reads have types of their own, and a loop that received them would be a function of these
types. They are written to a block of memory, in the form that compiled code reads, and the loop receives the address of
the block.
"""

from __future__ import annotations

import copy
import functools
import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Self

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.registry import cpu_target
from numba.extending import intrinsic

from percuss.solver.compiled.linked import EXAMPLES, LinkedBodies, LinkedLaws, LinkedStep, LinkedSystem

Kernel = Callable[..., Any]
# The values that data may contain, in tuples; a subclass may mean more than its numbers, as a masked array does.
ARRAYS = frozenset({np.ndarray, np.recarray, np.memmap})
NUMBERS = (bool, int, float, complex, np.bool, np.integer, np.float32, np.float64, np.complex64, np.complex128)
_FORMATS = {
    ("double", 8): "d",
    ("float", 4): "f",
    ("i8", 1): "b",
    ("i16", 2): "h",
    ("i32", 4): "i",
    ("i64", 8): "q",
}


class CannotLink(NotImplementedError):
    """Error: a kernel cannot be called by its address, as its data contain something else than numbers and arrays."""


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


def address_of(kernel: Kernel, kind: str, data_type: Any) -> int:
    """Return the address of the machine code of a kernel.

    Parameters
    ----------
    kernel
        A compiled function of the data and the tuple of its arguments.
    kind
        Key of `signatures`.
    data_type
        Type of the data.
    """
    result, arguments = signatures()[kind]
    passed = types.misc.CPointer(data_type), arguments
    dispatcher: Any = kernel
    if passed not in dispatcher.overloads:
        dispatcher.compile(result(*passed))
    compiled = dispatcher.overloads[passed]
    if compiled.signature.return_type != result:
        raise TypingError(f"{kind}: the kernel returns {compiled.signature.return_type}, expected {result}")
    address = int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))
    if address == 0:  # the loop would take it for a kernel that is not there
        raise CannotLink(f"{kind} cannot be compiled: its machine code has no address")
    return address


# -------------------------------------------------------------------------------------------------- blocks of memory


class Block:
    """A block of memory with a value in the form that compiled code reads.

    Parameters
    ----------
    value
        A number, an array, or a tuple of such values, nested as it may be. The block keeps its arrays alive.
    form
        The places of its numbers, as `form_of` returns them for its type.

    Attributes
    ----------
    address
        Address of the block.
    """

    def __init__(self, value: Any, form: str) -> None:
        self._value = value
        self._memory = np.zeros(struct.calcsize(form) // 8 + 1, dtype=np.int64)
        struct.pack_into(form, self._memory.data, 0, *_numbers(value))
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
        arrangement = flags.c_contiguous, flags.f_contiguous, flags.writeable, flags.aligned
        return dtype, dtype.isalignedstruct, value.ndim, *arrangement
    if not isinstance(value, NUMBERS):
        raise CannotLink(f"not a {type(value).__name__}")
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise CannotLink("not an integer of more than 64 bits")
    return type(value)


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
    elif isinstance(value, np.unsignedinteger):
        yield int(value.view(f"i{value.itemsize}"))  # the same bits
    else:
        yield int(value) if isinstance(value, np.bool) else value


@functools.cache
def form_of(kind: Any) -> str:
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
        # Form of the block, and addresses of the kernels, of each structure of data that was met.
        self._known: dict[Any, tuple[str, list[int]]] = {}
        # The links to the values that came last. Another thread may replace them at any time: a caller of compiled code
        # has to hold the links until the call has returned.
        self._last: dict[str, _Links] = {}

    def for_another_model(self) -> Self:
        """Return the same loop, without links to the arrays of this model."""
        loop = copy.copy(self)
        loop._last = {}
        return loop

    def advance(self, groups: Any, masses: Any, boundary: Any, laws: Any, *others: Any) -> Any:
        """Make steps; arguments and result are those of the function that was compiled."""
        bodies, contacts = self._once("bodies", groups, self._bodies), self._once("laws", laws, self._laws)
        return self.compiled_advance(bodies.links, masses, boundary, contacts.links, *others)

    def _once(self, name: str, value: Any, link: Callable[[Any], _Links]) -> _Links:
        links = self._last.get(name)
        if links is None or links.value is not value:
            links = self._last[name] = link(value)
        return links

    def _bodies(self, groups: Any) -> _Links:
        block, addresses = self._link(groups, "the bodies", self.update, "strain energy")
        return _Links(groups, LinkedBodies(block.address, *addresses), block)

    def _laws(self, laws: Any) -> _Links:
        if "contact laws" not in self.entrances:
            return _Links(laws, LinkedLaws(0, 0, 0))
        block, addresses = self._link(laws, "the contact laws", "contact laws")
        return _Links(laws, LinkedLaws(laws[0], block.address, *addresses), block)

    def _link(self, data: Any, of: str, *kinds: str) -> tuple[Block, list[int]]:
        """Return a block with the data of one or more kernels, and the addresses of these kernels."""
        try:
            key = kinds, structure(data)
        except CannotLink as error:
            raise CannotLink(f"{of} cannot be compiled: compiled kernels read numbers and arrays, {error}") from None
        known = self._known.get(key)
        if known is None:
            try:
                data_type = numba.typeof(data)
            except ValueError as error:  # as for an array of objects
                raise CannotLink(f"{of} cannot be compiled: {error}") from None
            known = form_of(data_type), [address_of(self.entrances[kind], kind, data_type) for kind in kinds]
            self._known[key] = known
        form, addresses = known
        return Block(data, form), addresses


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

    def advance(self, system: Any, numbers: Any, *others: Any) -> Any:
        """Make steps; arguments and result are those of the function that was compiled."""
        linked = self._once("system", system, self._system)
        step = self._last.get("step")
        if step is None or step.value[0] is not linked or step.value[1] is not numbers:
            step = self._last["step"] = self._step(linked, numbers)
        return self.compiled_advance(linked.links[0], step.links, *others)

    def begin(self, system: Any, *others: Any) -> None:
        """Set the first accelerations; arguments are those of the function that was compiled."""
        linked = self._once("system", system, self._system)
        self.compiled_begin(linked.links[1], *others)

    def _system(self, system: Any) -> _Links:
        bodies, laws = self._once("bodies", system.groups, self._bodies), self._once("laws", system.laws, self._laws)
        linked = system._replace(groups=bodies.links, laws=laws.links)
        block, addresses = self._link(linked, "the system", "accelerations of a stage")
        return _Links(system, (linked, LinkedSystem(block.address, *addresses)), bodies, laws, block)

    def _step(self, system: _Links, numbers: Any) -> _Links:
        block, addresses = self._link((numbers, system.links[1]), "the step", "step of a scheme")
        return _Links((system, numbers), LinkedStep(block.address, *addresses), block)
