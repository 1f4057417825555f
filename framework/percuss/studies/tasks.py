"""Tasks of a study: each case, pair of methods and point is a task, and each task becomes a run."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from percuss.case.case import Case
from percuss.case.options import options_of
from percuss.jsonable import Data, Entries

TIED = "tied"  # name of a tied twin in place of that of a contact law


@dataclass(frozen=True)
class Task:
    """A run to be made.

    Attributes
    ----------
    case, integrator, contact
        Names of the case and the methods in the row.
    varied
        Value of each varied path.
    changes
        All values replaced in the case, those of `varied` among them.
    tied
        Whether the interfaces are tied while the exact contact is closed.
    """

    case: str
    integrator: str
    contact: str
    varied: Data
    changes: Data
    tied: bool = False


def tasks(
    label: str,
    case: Case,
    integrators: Data,
    contacts: Data,
    points: Sequence[Data],
    *,
    tied: bool = False,
    strict: bool = False,
) -> Iterator[Task]:
    """Yield the tasks of one case: every pair with every point, then the tied twin of every integrator and point.

    Points that differ only in options which a pair lacks are one task of the pair, without these options.

    Parameters
    ----------
    label
        Label of the case.
    case
        The case; its own integrator or law is used where none is listed.
    integrators, contacts
        A name, or a mapping with a name and options, by label. A name alone keeps the options of the case.
    points
        Values of dotted paths.
    tied
        Whether to add tied twins.
    strict
        Whether every pair gets all values of a point, even those for which it has no option.
    """
    listed_integrators = list(integrators.items()) or [(case.method.integrator.name, None)]
    listed_laws = list(contacts.items()) or [(case.method.contact.name, None)]
    pairs = [(*pair, points, False) for pair in itertools.product(listed_integrators, listed_laws)]
    if tied:
        tied_points = _without_law(points)
        pairs += [(integrator, (TIED, None), tied_points, True) for integrator in listed_integrators]
    for (integrator_label, integrator), (law_label, law), points_of_pair, is_tied in pairs:
        changes = {**_method_change("method.integrator", integrator), **_method_change("method.contact", law)}
        for point in points_of_pair if strict else _applicable(case, points_of_pair, integrator, law):
            shown_integrator = method_of_point(point, "method.integrator") or integrator_label
            shown_law = method_of_point(point, "method.contact") or law_label
            yield Task(label, shown_integrator, shown_law, point, {**changes, **point}, is_tied)


def _applicable(case: Case, points: Sequence[Data], integrator: object, law: object) -> Iterator[Data]:
    """Yield the points without options that the integrator or the law lacks; points that become equal are yielded once.

    The value of a missing option changes nothing: all its values share a single run, whose row shows none of them.
    """
    seen = set()
    for point in points:
        options_by_method = {
            path: set(options_of(case.registry.get(family, name)))
            for path, family, listed, default in (
                ("method.integrator", "integrators", integrator, case.method.integrator.name),
                ("method.contact", "contacts", law, case.method.contact.name),
            )
            if (name := method_of_point(point, path) or method_name(listed) or default) in case.registry.names(family)
        }
        lacking = {
            path
            for path in point
            for method, options in options_by_method.items()
            if path.startswith(f"{method}.") and path.split(".")[2] not in {"name", *options}
        }
        fitting = {path: value for path, value in point.items() if path not in lacking}
        identity = repr(sorted(fitting.items(), key=repr)) if lacking else ""
        if identity not in seen:
            yield fitting
        seen |= {identity} if lacking else set()


def method_name(value: object) -> str:
    """Return the name of a method, given alone or with options; empty if there is none."""
    name = value.get("name") if isinstance(value, Mapping) else value
    return name if isinstance(name, str) else ""


def _without_law(points: Sequence[Data]) -> list[Data]:
    """Return the points without the contact law and its options, which a tied twin lacks; equal points once."""
    remaining = [
        {path: value for path, value in point.items() if path.split(".")[:2] != ["method", "contact"]}
        for point in points
    ]
    return list({repr(sorted(point.items())): point for point in remaining}.values())


def _method_change(path: str, value: object) -> Entries:
    if value is None:
        return {}
    return {f"{path}.name": value} if isinstance(value, str) else {path: value}


def method_of_point(point: Data, path: str) -> str:
    """Return the name of the method that a point sets because methods are varied by their path, or an empty text."""
    return method_name(point.get(path, point.get(f"{path}.name")))
