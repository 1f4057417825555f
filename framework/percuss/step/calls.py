"""Calls of compiled kernels by their addresses, as numba compiles them.

This module imports numba. `percuss.step.linking` does without it, so that a run whose machine code is stored
does not import the compiler. What numba hands to an `intrinsic`, the context and its convention for calls, belongs to
its low-level extension API; the types of its layouts are those of `llvmlite.ir`.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from typing import Any

import numba
from llvmlite import ir
from numba import TypingError, types
from numba.extending import intrinsic

from percuss.compiler import machine_code
from percuss.compiler.machine_code import CannotLink
from percuss.compiling import Kernel, numba_inside
from percuss.step.linked import EXAMPLES

_FORMATS = {
    ("double", 8): "d",
    ("float", 4): "f",
    ("i8", 1): "b",
    ("i16", 2): "h",
    ("i32", 4): "i",
    ("i64", 8): "q",
}


@functools.cache
def signatures() -> Mapping[str, tuple[Any, Any]]:
    """Return the type of the result and that of the tuple of arguments, for each kind of kernel."""
    return {
        kind: (types.none if result is None else numba.typeof(result), numba.typeof(arguments))
        for kind, (result, arguments) in EXAMPLES.items()
    }


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
    if not isinstance(kind, types.Literal):
        return None  # numba asks again without the constant after an error, and reports the first one
    result, expected = signatures()[kind.literal_value]
    found = types.Tuple([types.unliteral(argument) for argument in arguments])
    # A call with other arguments than the kernel was compiled for would read them from the wrong places.
    if (kernel, data, found) != (types.int64, types.int64, expected):
        raise TypingError(f"{kind.literal_value}: the arguments are {found}, expected {expected}")
    passed = types.voidptr, expected

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        convention = context.call_conv
        function = builder.inttoptr(values[1], ir.PointerType(convention.get_function_type(result, passed)))
        place = builder.inttoptr(values[2], context.get_value_type(types.voidptr))
        status, returned = convention.call_function(builder, function, result, passed, [place, values[3]])
        with builder.if_then(status.is_error, likely=False):
            convention.return_status_propagate(builder, status)
        return returned

    return result(kind, kernel, data, expected), generate


@intrinsic  # type: ignore[untyped-decorator]
def at(_typing: Any, data: Any) -> Any:
    """Return the value at the address `data`, in compiled code."""

    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return context.unpack_value(builder, data.dtype, values[0])

    return data.dtype(data), generate


@intrinsic  # type: ignore[untyped-decorator]
def room(_typing: Any, rows: Any, columns: Any) -> Any:
    """Return an array for a number for each pair of an entry of two tuples, in compiled code.

    It lies on the stack of the calling function. The compiler knows its size and that no other array overlaps it, so
    that loops over it are unrolled and its numbers kept in registers.
    """
    kind, shape = types.Array(types.float64, 2, "C"), (rows.count, columns.count)

    def generate(context: Any, builder: Any, _signature: Any, _values: Any) -> Any:
        number = context.get_value_type(types.float64)
        with builder.goto_entry_block():
            place = builder.alloca(ir.ArrayType(number, shape[0] * shape[1]))

        def sizes(*values: int) -> Any:
            whole = [context.get_constant(types.intp, value) for value in values]
            return context.make_tuple(builder, types.UniTuple(types.intp, len(whole)), whole) if whole[1:] else whole[0]

        array = context.make_array(kind)(context, builder)
        array.data = builder.bitcast(place, ir.PointerType(number))
        array.shape, array.strides = sizes(*shape), sizes(8 * shape[1], 8)
        array.itemsize, array.nitems = sizes(8), sizes(shape[0] * shape[1])
        array.meminfo = context.get_constant_null(types.MemInfoPointer(types.float64))
        array.parent = context.get_constant_null(types.pyobject)
        return array._getvalue()

    return kind(rows, columns), generate


def compiled(kernel: Kernel, kind: str, key: str, data: Any, of: str) -> tuple[str, int]:
    """Return the form of a block of data, and the address of a compiled function that reads it; store its code.

    Parameters
    ----------
    kernel
        The entrance of the function.
    kind
        Its kind, a key of `signatures`.
    key
        The key under which its machine code is stored, empty where it is not.
    data
        The value that a block will hold.
    of
        What the data belong to, for the text of an error.
    """
    try:
        data_type = numba.typeof(data)
    except ValueError as error:  # as for an array of objects
        raise CannotLink(f"{of} cannot be compiled: {error}") from None
    dispatcher: Any = kernel
    form = form_of(data_type, dispatcher.targetctx)
    result, arguments = signatures()[kind]
    passed = types.CPointer(data_type), arguments
    if passed not in dispatcher.overloads:
        dispatcher.compile(result(*passed))
    made = dispatcher.overloads[passed]
    if made.signature.return_type != result:
        raise TypingError(f"{kind}: the kernel returns {made.signature.return_type}, expected {result}")
    symbol = made.fndesc.llvm_func_name
    address = int(made.library.get_pointer_to_function(symbol))
    if address == 0:  # the loop would take it for a kernel that is not there
        raise CannotLink(f"{of} cannot be compiled: its machine code has no address")
    inside = numba_inside()
    if key and inside is not None:
        object_code, outside = inside.object_code(made.library)
        if object_code and machine_code.refers_to_c_alone(outside):
            machine_code.store(key, machine_code.MachineCode(symbol, form, object_code))
    return form, address


@functools.cache
def form_of(kind: Any, context: Any) -> str:
    """Return the places of the numbers of a type in compiled code of a context, as a format of the module `struct`."""
    form, end = "=", 0
    for offset, layout in _places(context.get_data_type(kind), 0, context.target_data):
        size = layout.get_abi_size(context.target_data)
        form += "x" * (offset - end) + _FORMATS[str(layout), size]
        end = offset + size
    return form


def _places(layout: Any, offset: int, target_data: Any) -> Iterator[tuple[int, Any]]:
    """Return the offset and the type of every number in a layout of compiled code; an address is an integer."""
    if isinstance(layout, ir.ArrayType):
        step = layout.element.get_abi_size(target_data)
        for index in range(layout.count):
            yield from _places(layout.element, offset + index * step, target_data)
    elif isinstance(layout, ir.BaseStructType):
        for index, element in enumerate(layout.elements):
            yield from _places(element, offset + layout.get_element_offset(target_data, index), target_data)
    else:
        yield offset, ir.IntType(64) if layout.is_pointer else layout
