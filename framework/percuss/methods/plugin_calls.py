"""Calls of the methods of components from Python, and checks of what those of third-party plug-ins answer.

Arrays are handed over read-only. An answer of the wrong shape, or one that is not finite, is refused with the place of
the method. All else is asked by the conformance kit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from percuss.errors import PercussError, PluginError
from percuss.methods.blame import breach, described, is_foreign, line_in_plugin
from percuss.methods.interfaces import BodyMesh, Component, Exact, Floats, Lumping, Mesh, PairedPoints, Surface


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
    try:
        if check := CHECKS.get((component.family, method)):
            check(Returned(component, method, value), *arguments)
    except (TypeError, ValueError):
        raise breach(component, method, f"{method} returned {_shown(value)}, expected numbers") from None
    return value


@contextmanager
def kernel_faults(component: Component, name: str) -> Iterator[None]:
    """Turn an error that the kernel of a name in plain Python raises inside this context into one with its line."""
    try:
        with np.errstate(all="ignore"):
            yield
    except PercussError:
        raise
    except Exception as error:
        text = f"{name}: {described(error)}"
        if isinstance(error, ValueError) and "read-only" in str(error):
            text = f"{name} changes what it was handed to read; it may write only its result"
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
    if isinstance(value, tuple):
        parts = [read_only(part) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    return value


# ---------------------------------------------------------------------------------------- checks of the answers


def as_numbers(value: object) -> Floats | None:
    """Return a value as an array of numbers, or None if it is not real numbers that double precision holds."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):  # rows of different lengths
        return None
    return array.astype(float) if np.can_cast(array.dtype, float) else None


def _shown(value: object) -> str:
    of = f" of {value.dtype}" if isinstance(value, np.ndarray) else ""
    return "nothing" if value is None else f"a {type(value).__name__}{of}"


class Returned(NamedTuple):
    """What a method of a component returned, or a part of it."""

    component: Component
    method: str
    value: Any
    part: str = ""  # what the value is of that which the method returned

    def expect(self, *shape: int) -> None:
        """Expect finite numbers of a shape; of an axis of -1 any number of them.

        Raises
        ------
        PluginError
            If the value is anything else.
        """
        array, words = as_numbers(self.value), str(shape).replace("-1", "n")
        if array is None:
            raise self.wrong(f"{_shown(self.value)}, expected numbers of shape {words}")
        if len(shape) != array.ndim or any(n not in {-1, size} for n, size in zip(shape, array.shape, strict=True)):
            raise self.wrong(f"numbers of shape {array.shape}, expected {words}")
        if not np.isfinite(array).all():
            array = np.atleast_1d(array)
            place = tuple(np.argwhere(~np.isfinite(array))[0])
            at = f" at index {', '.join(map(str, place))}" if shape else ""
            raise self.wrong(f"{array[place]}{at}")

    def expect_fields(self, shapes: Mapping[str, tuple[int, ...]]) -> None:
        """Expect finite numbers of these shapes in attributes."""
        for name, shape in shapes.items():
            self._replace(value=getattr(self.value, name), part=f" as `{name}`").expect(*shape)

    def expect_kind(self, kind: type, words: str) -> None:
        """Expect an object of a class."""
        if not isinstance(self.value, kind):
            raise self.wrong(f"{_shown(self.value)}, expected {words}")

    def expect_arrays(self) -> None:
        """Expect a NamedTuple of arrays of finite numbers."""
        fields = getattr(self.value, "_fields", None)
        if fields is None:
            raise self.wrong(f"{_shown(self.value)}, expected a NamedTuple of arrays")
        self.expect_fields({name: (-1,) * np.ndim(getattr(self.value, name)) for name in fields})

    def wrong(self, words: str) -> PluginError:
        """Return the error for a value that is something else than expected."""
        return breach(self.component, self.method, f"{self.method} returned{self.part} {words}")


def _amplitude(returned: Returned, time: Floats) -> None:
    array = as_numbers(returned.value)
    if array is not None and array.shape == np.shape(time) and not np.isfinite(array).all():
        first = np.isfinite(array).argmin()
        raise returned.wrong(f"{array.flat[first]} at the time {np.ravel(time)[first]:.6g}")
    returned.expect(*np.shape(time))


def _mesh(returned: Returned, at: Floats, _refine: float) -> None:
    returned.expect_kind(Mesh, "a Mesh")
    mesh, dim = returned.value, np.size(at)
    count = len(next(iter(mesh.cells.values()), ()))
    if mesh.line is None:
        returned.expect_fields({"nodes": (-1, dim)})
    else:
        returned.expect_fields({"lengths": (count,), "nodes": (count + 1, dim), "direction": (dim,)})


def _paired_points(returned: Returned, first: Surface, _second: object) -> None:
    returned.expect_kind(PairedPoints, "percuss.PairedPoints")
    count, dim = np.size(returned.value.gap), first.positions.shape[1]
    returned.expect_fields(
        {"gap": (count,), "weight": (count,), "normal": (count, dim), "facets": (count, 2), "start": (count + 1,)}
    )
    entries = int(np.max(returned.value.start, initial=0))
    returned.expect_fields({"node": (entries,), "value": (entries, dim)})


def _inverse(returned: Returned, _element_mass: Floats, lumping: Lumping) -> None:
    if (matrix := returned.value) is None:
        return
    if not hasattr(matrix, "tocoo"):
        raise returned.wrong(f"{_shown(matrix)}, expected a sparse array of SciPy")
    if matrix.shape != (shape := (lumping.nodes, lumping.nodes)):
        raise returned.wrong(f"a sparse array of shape {matrix.shape}, expected {shape}")
    returned._replace(value=matrix.tocoo().data).expect(-1)


def _solution(returned: Returned, _problem: object, _end: float) -> None:
    if not isinstance(returned.value, str):
        returned.expect_kind(Exact, "an Exact or why there is none")
        returned.expect_fields({"reached": ()})


def _measure(returned: Returned, _result: object) -> None:
    if returned.value is not None and not isinstance(returned.value, str | bool | int | np.integer | np.bool_):
        returned.expect()


def _of_elements(returned: Returned, body: BodyMesh, *_: object) -> None:
    """Expect a number for each element of a body; in an array of more axes, as many as its method may return."""
    axes = {"volumes": 2, "geometry": np.ndim(returned.value)}.get(returned.method, 1)
    returned.expect(len(next(iter(body.mesh.cells.values()))), *[-1] * (axes - 1))


def _mass_shares(returned: Returned, body: BodyMesh) -> None:
    shape = np.shape(next(iter(body.mesh.cells.values())))
    returned.expect(*(shape if np.ndim(returned.value) == 2 else shape[1:]))


def _of_nodes(returned: Returned, _element_mass: Floats, lumping: Lumping, *_: object) -> None:
    returned.expect(lumping.nodes)


# Each check receives what a method returned and the arguments of the method.
CHECKS: dict[tuple[str, str], Callable[..., None]] = {
    ("loads", "amplitude"): _amplitude,
    ("loads", "numbers"): lambda returned, _end: returned.expect(-1),
    ("loads", "follow"): lambda returned, *_: returned.expect(),
    ("shapes", "mesh"): _mesh,
    ("masses", "nodal"): _of_nodes,
    ("masses", "nodal_in_contact"): _of_nodes,
    ("masses", "inverse"): _inverse,
    ("elements", "bind"): lambda returned, _body: returned.expect_arrays(),
    ("elements", "rule"): lambda returned: returned.expect_arrays(),
    ("elements", "reference_nodes"): lambda returned: returned.expect(-1),
    ("elements", "mass_shares"): _mass_shares,
    ("elements", "volumes"): _of_elements,
    ("elements", "geometry"): _of_elements,
    ("elements", "volumes_of_cells"): _of_elements,
    ("elements", "axial_stiffness"): _of_elements,
    ("elements", "highest_frequency"): _of_elements,
    ("materials", "parameters"): lambda returned: returned.expect(-1),
    ("pairings", "points"): _paired_points,
    ("solutions", "solve"): _solution,
    ("measures", "of"): _measure,
}
