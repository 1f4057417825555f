"""Calls of the methods of components from Python, and checks of what those of third-party plug-ins answer.

Arrays are handed over read-only. An answer of the wrong shape, or one that is not finite, is refused with the place of
the method. Before the first run of a changed source each method is called twice (`percuss.methods.first_run`): an
answer that depends on earlier calls, on chance or on the clock differs, unless it does so too seldom to be seen in so
few calls. Kernels are tried elsewhere (`percuss.methods.kernel_trial`, `percuss.mesh.kernel_trial`).
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from percuss.compiling import Kernel
from percuss.errors import PercussError
from percuss.methods.blame import breach, described, line_in_plugin
from percuss.methods.first_run import first_asked, is_watched
from percuss.methods.interfaces import BodyMesh, Component, Exact, Floats, LeapFrog, Lumping, Mesh

REPEATED_CALLS = 3  # calls of a method that are repeated: the first may ask where every answer is zero
DEEPEST = 6  # levels of attributes up to which two answers are compared


def answer(component: Component, method: str, *arguments: object) -> Any:
    """Return the answer of a method of a component to arguments whose arrays it cannot change.

    Raises
    ------
    PluginError
        If the method of a third-party plug-in changes its arguments or answers with the wrong shape or with a value
        that is not finite; before the first run of its source also if it answers differently when it is asked the same
        again, or changes the component.
    """
    call = getattr(component, method)
    if not is_watched(component):
        return call(*arguments)
    arguments = tuple(read_only(argument) for argument in arguments)
    try:
        with first_asked(f"{method} {component!r}", component, times=REPEATED_CALLS) as due:
            own_state = _own_state(component) if due else ""
            value = call(*arguments)
            check = CHECKS.get((component.family, method))
            if check is not None and (fault := _fault_of(check, value, *arguments)):
                raise breach(component, method, f"{method} {fault}")
            if due and not same(value, call(*arguments)):
                raise breach(component, method, f"{method} {DIFFERENT}")
            if due and _own_state(component) != own_state:
                message = f"{method} changes the component itself, which keeps nothing between calls"
                raise breach(component, method, message)
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        message = f"{method} changes an array that it was handed: copy it first"
        raise breach(component, method, message, line_in_plugin(error)) from error
    return value


def _own_state(component: Component) -> str:
    """Return the text of what a component holds, without what its cached properties have computed from it."""
    attributes = {name: inspect.getattr_static(type(component), name, None) for name in vars(component)}
    cached = {name for name, value in attributes.items() if isinstance(value, functools.cached_property)}
    return repr([(name, value) for name, value in vars(component).items() if name not in cached])


DIFFERENT = (
    "gives another answer when it is asked the same again: it keeps state between calls, draws random numbers or reads "
    "the clock; its answer follows from its options and its arguments alone"
)


@contextmanager
def kernel_faults(component: Component, name: str, advice: str = "") -> Iterator[None]:
    """Turn an error that a kernel in plain Python raises inside this context into one with its line.

    Parameters
    ----------
    component, name
        The method and the name of its kernel.
    advice
        What to do about an index that is out of bounds.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except PercussError:
        raise
    except Exception as error:
        text = f"{name}: {described(error)}"
        if isinstance(error, ValueError) and "read-only" in str(error):
            text = f"{name} changes what it was handed to read; it writes its result alone"
        if isinstance(error, IndexError):
            text += advice
        raise breach(component, name, text, line_in_plugin(error)) from error


def called_twice(component: Component, name: str, call: Kernel, states: Sequence[tuple[object, ...]]) -> list[Any]:
    """Return what a kernel gives in some states; call it in all of them a second time.

    Raises
    ------
    PluginError
        If the kernel raises an error, changes what it was handed, or gives another result the second time.
    """
    with kernel_faults(component, name):
        first, second = ([call(*state) for state in states] for _ in range(2))
    if not same(first, second):
        raise breach(component, name, f"{name} {DIFFERENT}")
    return first


def read_only(value: Any) -> Any:
    """Return a value with its arrays, also those inside tuples, replaced by read-only views."""
    if isinstance(value, np.ndarray):
        view = value.view()
        view.flags.writeable = False
        return view
    if dataclasses.is_dataclass(value) and not isinstance(value, type | Component):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        arrays = {name: read_only(item) for name, item in fields.items() if isinstance(item, np.ndarray | tuple)}
        return dataclasses.replace(value, **arrays) if arrays else value
    return mapped(read_only, value) if isinstance(value, tuple) else value


def mapped(function: Kernel, *values: Any) -> Any:
    """Return nested tuples with the answer of `function` to the corresponding entries of `values` in their place.

    Raises
    ------
    ValueError
        If the tuples differ in length.
    """
    first = values[0]
    if not isinstance(first, tuple):
        return function(*values)
    parts = [mapped(function, *entries) for entries in zip(*values, strict=True)]
    return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)


def same(first: Any, second: Any, depth: int = 0) -> bool:
    """Return whether two answers are equal to the last bit, as far as they consist of numbers, text and containers.

    All other objects are compared attribute by attribute.
    """
    if first is second or depth > DEEPEST:
        return True
    if type(first) is not type(second):
        return False
    if isinstance(first, np.ndarray | np.generic | float | int):
        bits = [(array.dtype, array.shape, array.tobytes()) for array in map(np.asarray, (first, second))]
        return bits[0] == bits[1]
    if isinstance(first, str | bytes):
        return first == second  # type: ignore[no-any-return]
    if hasattr(first, "tocoo"):  # a sparse array keeps what was found out about it, too
        entries = first.tocoo(), second.tocoo()
        first, second = ((matrix.shape, matrix.row, matrix.col, matrix.data) for matrix in entries)
    if isinstance(first, Mapping):
        first, second = list(first.items()), list(second.items())
    if isinstance(first, list | tuple):
        return len(first) == len(second) and all(same(*pair, depth + 1) for pair in zip(first, second, strict=True))
    is_compared = hasattr(first, "__dict__") and not isinstance(first, Component) and not callable(first)
    return not is_compared or same(vars(first), vars(second), depth + 1)


# ---------------------------------------------------------------------------------------- checks of the answers


def as_numbers(value: object) -> Floats | None:
    """Return a value as an array of numbers, or None if it is not real numbers that double precision holds."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # rows of different lengths
        return None
    return array.astype(float) if np.can_cast(array.dtype, float) else None


def _fault_of(check: Callable[..., str], value: object, *arguments: object) -> str:
    try:
        return check(value, *arguments)
    except (TypeError, ValueError):
        return f"returned {_shown(value)}, expected numbers"


def _numbers_fault(value: object, shape: tuple[int, ...]) -> str:
    """Return what is wrong with an array of finite numbers, in words, or an empty text."""
    array = as_numbers(value)
    if array is None:
        return f"returned {_shown(value)}, expected numbers of shape {shape}"
    if array.shape != shape:
        return f"returned numbers of shape {array.shape}, expected {shape}"
    if not np.isfinite(array).all():
        place = ", ".join(str(index[0]) for index in np.nonzero(~np.isfinite(np.atleast_1d(array))))
        return f"returned {np.atleast_1d(array)[~np.isfinite(np.atleast_1d(array))][0]} at index {place}"
    return ""


def _shown(value: object) -> str:
    of = f" of {value.dtype}" if isinstance(value, np.ndarray) else ""
    return "nothing" if value is None else f"a {type(value).__name__}{of}"


def _amplitude_fault(value: Any, time: Floats) -> str:
    fault = _numbers_fault(value, np.shape(time))
    if " at index " not in fault:
        return fault
    wrong = np.flatnonzero(~np.isfinite(np.ravel(value)))
    return f"returned {np.ravel(value)[wrong[0]]} at the time {np.ravel(time)[wrong[0]]:.6g} since the load began"


def _parts_fault(parts: Iterable[tuple[str, object, tuple[int, ...]]]) -> str:
    """Return what is wrong with the first part that is no array of finite numbers; a part has words and a shape."""
    for words, value, shape in parts:
        fault = _numbers_fault(value, shape)
        if fault:
            return fault.replace("returned", f"returned as {words}", 1)
    return ""


def _arrays_fault(value: object, shape: tuple[int, ...] = ()) -> str:
    """Return what is wrong with a NamedTuple of arrays, whose shapes begin with `shape`."""
    if not (isinstance(value, tuple) and hasattr(value, "_fields")):
        return f"returned {_shown(value)}, expected a NamedTuple of arrays"
    return _parts_fault(
        (f"`{name}`", array, (*shape, *np.shape(array)[len(shape) :]))
        for name, array in zip(value._fields, value, strict=True)
    )


def _follower_numbers_fault(value: object, _end: object) -> str:
    if not isinstance(value, tuple):
        return f"returned {_shown(value)}, expected a tuple of numbers"
    return _numbers_fault(value, (len(value),))


def _follow_fault(value: object, _numbers: object, time: float, displacement: float, velocity: float) -> str:
    fault = "returned nothing, expected a number" if value is None else _numbers_fault(value, ())
    motion = f"at the time {time:g}, the displacement {displacement:g} and the velocity {velocity:g}"
    return f"{fault.removesuffix(' at index 0')} {motion}" if fault else ""


def _mesh_fault(mesh: object, at: Floats, _refine: float) -> str:
    if not isinstance(mesh, Mesh):
        return f"returned {_shown(mesh)}, expected a Mesh"
    count, dim = len(next(iter(mesh.cells.values()), ())), np.size(at)
    if mesh.line is None:
        return _parts_fault([("`nodes`", mesh.nodes, (np.shape(mesh.nodes)[0], dim))])
    if list(mesh.cells) != ["line"]:
        return f"returned cells of the kind {', '.join(mesh.cells)}: along a line it makes a row, `Mesh.of_line`"
    shapes = {"lengths": (count,), "nodes": (count + 1, dim), "direction": (dim,)}
    return _parts_fault((f"`{name}`", getattr(mesh, name), shape) for name, shape in shapes.items())


def _reference_nodes_fault(value: Any) -> str:
    fault = _numbers_fault(value, (max(np.size(value), 2),))
    if fault:
        return fault
    inner = np.asarray(value, dtype=float)[2:]
    if tuple(value[:2]) != (0.0, 1.0) or np.unique(inner).size < inner.size or not ((inner > 0) & (inner < 1)).all():
        return f"returned {np.asarray(value).tolist()}, expected 0, 1, and different positions between them"
    return ""


def _count(body: BodyMesh) -> int:
    return len(next(iter(body.mesh.cells.values())))


def _shares_fault(value: Any, body: BodyMesh) -> str:
    shape = (_count(body),) if np.ndim(value) == 2 else ()
    fault = _numbers_fault(value, (*shape, max(np.shape(value)[-1:], (2,))[0]))
    if fault:
        return fault
    sums = np.atleast_1d(np.sum(value, axis=-1))
    worst = int(np.argmax(np.abs(sums - 1.0)))
    return f"returned shares whose sum is {sums[worst]:.17g}, expected 1" if abs(sums[worst] - 1.0) > 1e-12 else ""


def _nodal_in_contact_fault(value: Any, _element_mass: Floats, lumping: Lumping, in_contact: Any) -> str:
    fault = _numbers_fault(value, (lumping.nodes,))
    if fault:
        return fault
    without = [int(node) for node in np.flatnonzero((np.asarray(value) == 0.0) & ~in_contact)]
    if without:
        return f"returned no mass at node {without[0]}, expected some at every node except an end in contact"
    return "" if np.any(value) else "returned no mass at all"


def _inverse_fault(value: Any, _element_mass: Floats, lumping: Lumping) -> str:
    if value is None:
        return ""
    from scipy.sparse import issparse

    size = lumping.nodes
    if not issparse(value):
        return f"returned {_shown(value)}, expected a sparse array of SciPy"
    if value.shape != (size, size):
        return f"returned a sparse array of shape {value.shape}, expected {(size, size)}"
    if fault := _numbers_fault(value.tocoo().data, (value.nnz,)):
        return fault
    matrix = value.tocsr()
    return (
        "" if abs(matrix - matrix.T).max() <= 1e-12 * abs(matrix).max() else "returned a matrix that is not symmetric"
    )


def _reason_fault(value: object, *_arguments: object) -> str:
    return "" if value is None or isinstance(value, str) else f"returned {_shown(value)}, expected a text or None"


def _solve_fault(value: object, _problem: object, _end: float) -> str:
    if isinstance(value, str) and value.strip():
        return ""
    if not isinstance(value, Exact):
        return f"returned {_shown(value)}, expected an Exact or why there is none"
    return "" if np.isfinite(value.reached) else f"returned a solution that reached the time {value.reached}"


def _measure_fault(value: object, _result: object) -> str:
    if value is None or isinstance(value, str | bool | int | np.integer | np.bool_):
        return ""
    fault = _numbers_fault(value, ())
    return f"{fault}; None says that there is no number" if fault else ""


def _bound_law_fault(value: object, _points: object, _dt: float) -> str:
    for name in getattr(value, "_fields", ()):
        array = getattr(value, name)
        if isinstance(array, np.ndarray) and array.dtype.kind != "V" and not np.can_cast(array.dtype, complex):
            return f"returned as `{name}` {_shown(array)}, expected numbers"
    return ""


def _bound_integrator_fault(value: object, _dt: float) -> str:
    if not isinstance(value, LeapFrog):
        return ""  # the numbers of `Stages` are checked with the trial steps
    states = {"explicit": value.explicit, "end": value.end}
    return _parts_fault((f"the response of `{name}`", state.response, (3,)) for name, state in states.items())


# Each check receives what a method returned and the arguments of the method.
CHECKS: dict[tuple[str, str], Callable[..., str]] = {
    ("loads", "amplitude"): _amplitude_fault,
    ("loads", "numbers"): _follower_numbers_fault,
    ("loads", "follow"): _follow_fault,
    ("shapes", "mesh"): _mesh_fault,
    ("masses", "nodal"): lambda value, _mass, lumping: _numbers_fault(value, (lumping.nodes,)),
    ("masses", "nodal_in_contact"): _nodal_in_contact_fault,
    ("masses", "inverse"): _inverse_fault,
    ("elements", "bind"): lambda value, body: _arrays_fault(value, (_count(body),)),
    ("elements", "rule"): _arrays_fault,
    ("elements", "reference_nodes"): _reference_nodes_fault,
    ("elements", "mass_shares"): _shares_fault,
    ("elements", "volumes"): lambda value, body: _numbers_fault(value, (_count(body), *(np.shape(value)[1:2] or (1,)))),
    ("elements", "geometry"): lambda value, body: _numbers_fault(value, (_count(body), *np.shape(value)[1:])),
    ("elements", "volumes_of_cells"): lambda value, body: _numbers_fault(value, (_count(body),)),
    ("elements", "axial_stiffness"): lambda value, body, _modulus: _numbers_fault(value, (_count(body),)),
    ("elements", "highest_frequency"): lambda value, body, _speed: _numbers_fault(value, (_count(body),)),
    ("materials", "parameters"): lambda value: _numbers_fault(value, np.shape(value)[:1] or (1,)),
    ("solutions", "covers"): _reason_fault,
    ("solutions", "too_costly"): _reason_fault,
    ("solutions", "solve"): _solve_fault,
    ("measures", "of"): _measure_fault,
    ("integrators", "bind"): _bound_integrator_fault,
    ("contacts", "bind"): _bound_law_fault,
}
