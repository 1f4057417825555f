"""Calls of the methods of components from Python, and checks of what those of third-party plug-ins answer.

Arrays are handed over read-only. An answer of the wrong shape, or one that is not finite, is refused with the place of
the method. All else is asked by the conformance kit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from percuss.compiling import Kernel
from percuss.errors import PercussError
from percuss.methods.blame import breach, described, is_foreign, line_in_plugin
from percuss.methods.interfaces import (
    BodyMesh,
    Component,
    Exact,
    Floats,
    LeapFrog,
    Lumping,
    Mesh,
    PairedPoints,
    Surface,
    Wall,
)

NODES_OF_CELLS = {"triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8}
DEEPEST = 6  # levels of attributes up to which two answers are compared


def answer(component: Component, method: str, *arguments: object) -> Any:
    """Return the answer of a method of a component; one that does not come with percuss is checked.

    Raises
    ------
    PluginError
        If the method changes its arguments or answers with the wrong shape or with a value that is not finite.
    """
    call = getattr(component, method)
    return checked(component, method, call, *arguments) if is_foreign(component) else call(*arguments)


def checked(component: Component, method: str, call: Callable[..., Any], *arguments: object) -> Any:
    """Return the answer of a method to arguments whose arrays it cannot change; raise PluginError as `answer` does."""
    arguments = tuple(read_only(argument) for argument in arguments)
    try:
        value = call(*arguments)
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        message = f"{method} changes an array that it was handed: copy it first"
        raise breach(component, method, message, line_in_plugin(error)) from error
    _check(component, method, value, *arguments)
    return value


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
            text = f"{name} changes what it was handed to read; it may write only its result"
        if isinstance(error, IndexError):
            text += advice
        raise breach(component, name, text, line_in_plugin(error)) from error


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


class _Wrong(Exception):
    """What is wrong with an answer, in words that follow the name of the method."""


def _check(component: Component, method: str, value: object, *arguments: object) -> None:
    """Raise PluginError if the answer of a method to some arguments breaks its contract."""
    try:
        if check := CHECKS.get((component.family, method)):
            check(value, *arguments)
    except _Wrong as fault:
        raise breach(component, method, f"{method} {fault}") from None
    except (TypeError, ValueError):
        raise breach(component, method, f"{method} returned {_shown(value)}, expected numbers") from None


def _at_index(place: Sequence[int]) -> str:
    return f" at index {', '.join(map(str, place))}"


def _numbers(
    value: object, shape: tuple[int, ...], words: str = "", more: str = "", at: Callable[..., str] = _at_index
) -> None:
    """Expect an array of finite numbers.

    Parameters
    ----------
    value, shape
        The array, and its shape.
    words, more
        What to say of the array, and after the fault.
    at
        Gives words for the place of a number that is not finite.
    """
    array = as_numbers(value)
    if array is None:
        raise _Wrong(f"returned{words} {_shown(value)}, expected numbers of shape {shape}{more}")
    if array.shape != shape:
        raise _Wrong(f"returned{words} numbers of shape {array.shape}, expected {shape}{more}")
    array = np.atleast_1d(array)
    for place in map(tuple, np.argwhere(~np.isfinite(array))):
        raise _Wrong(f"returned{words} {array[place]}{at(place)}{more}")


def _shown(value: object) -> str:
    of = f" of {value.dtype}" if isinstance(value, np.ndarray) else ""
    return "nothing" if value is None else f"a {type(value).__name__}{of}"


def _amplitude(value: Any, time: Floats) -> None:
    times = np.atleast_1d(time)
    _numbers(value, np.shape(time), at=lambda place: f" at the time {times[place]:.6g} since the load began")


def _arrays(value: object, shape: tuple[int, ...] = ()) -> None:
    """Expect a NamedTuple of arrays of finite numbers, whose shapes begin with `shape`."""
    if not (isinstance(value, tuple) and hasattr(value, "_fields")):
        raise _Wrong(f"returned {_shown(value)}, expected a NamedTuple of arrays")
    for name, array in zip(value._fields, value, strict=True):
        _numbers(array, (*shape, *np.shape(array)[len(shape) :]), f" as `{name}`")


def _follower_numbers(value: object, _end: object) -> None:
    if not isinstance(value, tuple):
        raise _Wrong(f"returned {_shown(value)}, expected a tuple of numbers")
    _numbers(value, (len(value),))


def _follow(value: object, _read: object, time: float, displacement: float, velocity: float) -> None:
    motion = f" at the time {time:g}, the displacement {displacement:g} and the velocity {velocity:g}"
    if value is None:
        raise _Wrong(f"returned nothing, expected a number{motion}")
    _numbers(value, (), more=motion, at=lambda _: "")


def _mesh(mesh: object, at: Floats, _refine: float) -> None:
    if not isinstance(mesh, Mesh):
        raise _Wrong(f"returned {_shown(mesh)}, expected a Mesh")
    count, dim = len(next(iter(mesh.cells.values()), ())), np.size(at)
    if mesh.line is None:
        _mesh_of_cells(mesh, dim)
        return
    if list(mesh.cells) != ["line"]:
        kinds = ", ".join(mesh.cells)
        raise _Wrong(f"returned cells of the kind {kinds}: along a line it makes a row, `Mesh.of_line`")
    shapes = {"lengths": (count,), "nodes": (count + 1, dim), "direction": (dim,)}
    for name, shape in shapes.items():
        _numbers(getattr(mesh, name), shape, f" as `{name}`")


def _mesh_of_cells(mesh: Mesh, dim: int) -> None:
    """Expect cells of one kind on all of the nodes, and regions of edges with the body on their left."""
    _numbers(mesh.nodes, (np.shape(mesh.nodes)[0], dim), " as `nodes`")
    kind = ", ".join(mesh.cells)
    if kind not in NODES_OF_CELLS:
        raise _Wrong(f"returned cells of the kind {kind or 'none'}, expected one of {', '.join(NODES_OF_CELLS)}")
    count, cells = len(mesh.nodes), np.asarray(mesh.cells[kind])
    _node_numbers(cells, NODES_OF_CELLS[kind], count, "`cells`")
    for node in np.setdiff1d(np.arange(count), cells):
        raise _Wrong(f"returned the node {node} at {np.asarray(mesh.nodes)[node].tolist()}, which belongs to no cell")
    if dim == 2:
        _anticlockwise(np.asarray(mesh.nodes)[cells])
        _edges(mesh, cells, count)
    for name, region in mesh.regions.items():
        for facets in map(np.asarray, region.facets.values()):
            once, times = np.unique(np.sort(facets), axis=0, return_counts=True)
            for facet in once[times > 1]:
                raise _Wrong(f"returned in the region '{name}' the facet of the nodes {facet.tolist()} twice")


def _edges(mesh: Mesh, cells: Any, count: int) -> None:
    """Expect as facets of regions edges of single cells, each with the body on its left."""
    of_cells = cells * count + np.roll(cells, -1, axis=1)
    for name, region in mesh.regions.items():
        if (kinds := ", ".join(region.facets) or "none") != "line":
            raise _Wrong(f"returned the region '{name}' with facets of the kind {kinds}, expected line")
        facets = np.asarray(region.facets["line"])
        _node_numbers(facets, 2, count, f"facets of the region '{name}'")
        left, right = (np.isin(facets[:, way] * count + facets[:, 1 - way], of_cells) for way in (0, 1))
        for facet in np.flatnonzero(~left | right):
            is_one = "of two cells" if left[facet] else "with the body on its right" if right[facet] else "of no cell"
            said = f"returned in the region '{name}' the facet {facets[facet].tolist()}, an edge {is_one}"
            raise _Wrong(f"{said}, expected edges of the boundary with the body on their left")


def _node_numbers(value: Any, width: int, count: int, words: str) -> None:
    if value.ndim != 2 or value.shape[1] != width or value.dtype.kind not in "iu":
        raise _Wrong(
            f"returned as {words} {value.dtype} of shape {value.shape}, expected integers of shape (n, {width})"
        )
    for node in value[(value < 0) | (value >= count)]:
        raise _Wrong(f"returned as {words} the node {node}, expected one from 0 to {count - 1}")


def _anticlockwise(corners: Floats) -> None:
    """Expect cells whose corners run anticlockwise, each with an area and no corner that points inward."""
    along = np.roll(corners, -1, axis=1) - corners
    before = np.roll(along, 1, axis=1)
    turns = before[..., 0] * along[..., 1] - before[..., 1] * along[..., 0]  # twice the area at each corner
    for cell in np.flatnonzero((turns.min(axis=1) < 0.0) | ~(turns.sum(axis=1) > 0.0)):
        shown = corners[cell].tolist()
        raise _Wrong(f"returned the cell {cell} of the corners {shown}, expected corners that run anticlockwise")


def _reference_nodes(value: Any) -> None:
    _numbers(value, (max(np.size(value), 2),))
    inner = np.asarray(value, dtype=float)[2:]
    if tuple(value[:2]) != (0.0, 1.0) or np.unique(inner).size < inner.size or not ((inner > 0) & (inner < 1)).all():
        shown = np.asarray(value).tolist()
        raise _Wrong(f"returned {shown}, expected 0, 1, and different positions between them")


def _count(body: BodyMesh) -> int:
    return len(next(iter(body.mesh.cells.values())))


def _shares(value: Any, body: BodyMesh) -> None:
    shape = (_count(body),) if np.ndim(value) == 2 else ()
    _numbers(value, (*shape, max(np.shape(value)[-1:], (2,))[0]))
    sums = np.atleast_1d(np.sum(value, axis=-1))
    worst = int(np.argmax(np.abs(sums - 1.0)))
    if abs(sums[worst] - 1.0) > 1e-12:
        raise _Wrong(f"returned shares whose sum is {sums[worst]:.17g}, expected 1")


def _nodal_in_contact(value: Any, _element_mass: Floats, lumping: Lumping, in_contact: Any) -> None:
    _numbers(value, (lumping.nodes,))
    for node in np.flatnonzero((np.asarray(value) == 0.0) & ~in_contact):
        raise _Wrong(f"returned no mass at node {node}, expected some at every node except an end in contact")
    if not np.any(value):
        raise _Wrong("returned no mass at all")


def _inverse(value: Any, _element_mass: Floats, lumping: Lumping) -> None:
    if value is None:
        return
    from scipy.sparse import issparse

    shape = lumping.nodes, lumping.nodes
    if not issparse(value):
        raise _Wrong(f"returned {_shown(value)}, expected a sparse array of SciPy")
    if value.shape != shape:
        raise _Wrong(f"returned a sparse array of shape {value.shape}, expected {shape}")
    _numbers(value.tocoo().data, (value.nnz,))
    matrix = value.tocsr()
    if abs(matrix - matrix.T).max() > 1e-12 * abs(matrix).max():
        raise _Wrong("returned a matrix that is not symmetric")


def _reason(value: object, *_arguments: object) -> None:
    if value is not None and not isinstance(value, str):
        raise _Wrong(f"returned {_shown(value)}, expected a text or None")


def _solution(value: object, _problem: object, _end: float) -> None:
    if isinstance(value, str) and value.strip():
        return
    if not isinstance(value, Exact):
        raise _Wrong(f"returned {_shown(value)}, expected an Exact or why there is none")
    if not np.isfinite(value.reached):
        raise _Wrong(f"returned a solution that reached the time {value.reached}")


def _measure(value: object, _result: object) -> None:
    if value is not None and not isinstance(value, str | bool | int | np.integer | np.bool_):
        _numbers(value, (), more="; None says that there is no number")


def _bound_law(value: object, _points: object, _dt: float) -> None:
    for name in getattr(value, "_fields", ()):
        array = getattr(value, name)
        if isinstance(array, np.ndarray) and array.dtype.kind != "V" and not np.can_cast(array.dtype, complex):
            raise _Wrong(f"returned as `{name}` {_shown(array)}, expected numbers")


def _bound_integrator(value: object, _dt: float) -> None:
    if isinstance(value, LeapFrog):  # the numbers of `Stages` are checked with the trial steps
        for name in ("explicit", "end"):
            _numbers(getattr(value, name).response, (3,), f" as the response of `{name}`")


# Each check receives what a method returned and the arguments of the method.
def _paired_points(value: Any, first: Surface, second: Surface | Wall) -> None:
    """Expect points whose arrays belong together, on nodes of the two surfaces, each with an area."""
    if not isinstance(value, PairedPoints):
        raise _Wrong(f"returned {_shown(value)}, expected percuss.PairedPoints")
    count, dim = np.size(value.gap), first.positions.shape[1]
    shapes: dict[str, tuple[int, ...]] = {
        "gap": (count,), "weight": (count,), "normal": (count, dim), "facets": (count, 2), "start": (count + 1,),
    }  # fmt: skip
    for name, shape in shapes.items():
        _numbers(getattr(value, name), shape, f" as `{name}`")
    entries = int(np.max(value.start, initial=0))
    _numbers(value.node, (entries,), " as `node`")
    _numbers(value.value, (entries, dim), " as `value`")
    known = first.nodes if isinstance(second, Wall) else np.concatenate([first.nodes, second.nodes])
    for node in np.setdiff1d(value.node, known):
        raise _Wrong(f"returned the node {node}, which is on neither surface")
    if count and not np.min(value.weight) > 0.0:
        raise _Wrong(f"returned an area of {np.min(value.weight)}, expected one greater than 0")


CHECKS: dict[tuple[str, str], Callable[..., None]] = {
    ("loads", "amplitude"): _amplitude,
    ("loads", "numbers"): _follower_numbers,
    ("loads", "follow"): _follow,
    ("shapes", "mesh"): _mesh,
    ("masses", "nodal"): lambda value, _mass, lumping: _numbers(value, (lumping.nodes,)),
    ("masses", "nodal_in_contact"): _nodal_in_contact,
    ("masses", "inverse"): _inverse,
    ("elements", "bind"): lambda value, body: _arrays(value, (_count(body),)),
    ("elements", "rule"): _arrays,
    ("elements", "reference_nodes"): _reference_nodes,
    ("elements", "mass_shares"): _shares,
    ("elements", "volumes"): lambda value, body: _numbers(value, (_count(body), *(np.shape(value)[1:2] or (1,)))),
    ("elements", "geometry"): lambda value, body: _numbers(value, (_count(body), *np.shape(value)[1:])),
    ("elements", "volumes_of_cells"): lambda value, body: _numbers(value, (_count(body),)),
    ("elements", "axial_stiffness"): lambda value, body, _modulus: _numbers(value, (_count(body),)),
    ("elements", "highest_frequency"): lambda value, body, _speed: _numbers(value, (_count(body),)),
    ("materials", "parameters"): lambda value: _numbers(value, np.shape(value)[:1] or (1,)),
    ("pairings", "points"): _paired_points,
    ("solutions", "covers"): _reason,
    ("solutions", "too_costly"): _reason,
    ("solutions", "solve"): _solution,
    ("measures", "of"): _measure,
    ("integrators", "bind"): _bound_integrator,
    ("contacts", "bind"): _bound_law,
}
