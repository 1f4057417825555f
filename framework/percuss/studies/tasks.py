"""Tasks of a study: each case, pair of methods and point is a task, and each task becomes a run."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from percuss.case.case import Case
from percuss.case.defaults import OF_REFERENCE
from percuss.case.options import options_of
from percuss.errors import PercussError
from percuss.jsonable import Data, Entries
from percuss.march.model_of_case import model_of

NAMES = ("case", "integrator", "contact")  # columns of every row, besides the varied paths
TIED = "tied"  # name of a tied twin in place of that of a contact law
FAMILIES = {"integrator": "integrators", "contact": "contacts"}


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
    key
        Key of all inputs of the run; empty before it is known.
    """

    case: str
    integrator: str
    contact: str
    varied: Data
    changes: Data
    tied: bool = False
    key: str = ""

    def changed(self, case: Case) -> Case:
        """Return the case of the task with its changes.

        Raises
        ------
        InputError
            If these cannot be made.
        """
        return case.with_overrides(self.changes) if self.changes else case


def tasks(
    cases: Mapping[str, Case], integrators: Data, contacts: Data, points: Sequence[Data], *, tied: bool = False
) -> Iterator[Task]:
    """Yield the tasks of each case: every pair with every point, then the tied twin of every integrator and point.

    An option that a pair lacks changes nothing in its runs: points that differ only in such options are one task of the
    pair, without them. An option that no pair of any case has is kept, so that the runs say it.

    Parameters
    ----------
    cases
        The cases by label; the integrator or law of a case is used where none is listed.
    integrators, contacts
        A name, or a mapping with a name and options, by label. A name alone keeps the options of the case.
    points
        Values of dotted paths.
    tied
        Whether to add tied twins.
    """
    known: set[str] = set()
    pairs = []
    for label, case in cases.items():
        of_integrator = list(integrators.items()) or [(case.method.integrator.name, None)]
        of_law = list(contacts.items()) or [(case.method.contact.name, None)]
        for integrator, law in itertools.product(of_integrator, of_law):
            pairs.append((label, case, integrator, law, False))
            methods = integrator[1], law[1]
            known |= {path for point in points for path in point if not _lacks(case, *methods, point, path)}
        pairs += [(label, case, integrator, (TIED, None), True) for integrator in of_integrator if tied]
    for label, case, (integrator_label, integrator), (law_label, law), is_tied in pairs:
        changes = {**_method_change("method.integrator", integrator), **_method_change("method.contact", law)}
        seen = set()
        for point in points:
            fitting = {
                path: value
                for path, value in point.items()
                if not (is_tied and path.split(".")[:2] == ["method", "contact"])
                and (path not in known or not _lacks(case, integrator, law, point, path))
            }
            identity = repr(sorted(fitting.items(), key=repr)) if len(fitting) < len(point) else ""
            if identity not in seen:
                names = (
                    method_of_point(fitting, "method.integrator") or integrator_label,
                    method_of_point(fitting, "method.contact") or law_label,
                )
                yield Task(label, *names, fitting, {**changes, **fitting}, is_tied)
            seen |= {identity} if identity else set()


def _lacks(case: Case, integrator: object, law: object, point: Data, path: str) -> bool:
    """Return whether a path is one of an option that the integrator or the law of a run does not have."""
    section, kind, option, *_ = (*path.split("."), "", "", "")
    if section != "method" or kind not in FAMILIES or option in {"", "name"}:
        return False
    listed, default = (integrator, case.method.integrator) if kind == "integrator" else (law, case.method.contact)
    name = method_of_point(point, f"method.{kind}") or method_name(listed) or default.name
    method = case.registry.components.get((FAMILIES[kind], name))
    return method is not None and option not in options_of(method)


def method_name(value: object) -> str:
    """Return the name of a method, given alone or with options; empty if there is none."""
    name = value.get("name") if isinstance(value, Mapping) else value
    return name if isinstance(name, str) else ""


def _method_change(path: str, value: object) -> Entries:
    if value is None:
        return {}
    return {f"{path}.name": value} if isinstance(value, str) else {path: value}


def method_of_point(point: Data, path: str) -> str:
    """Return the name of the method that a point sets because methods are varied by their path, or an empty text."""
    return method_name(point.get(path, point.get(f"{path}.name")))


# ----------------------------------------------------------------------------------------- which runs judge them


def two_references(case: Case, contacts: Data, points: Iterable[Data]) -> Case:
    """Return a case that is judged by two finer runs if its runs differ in law or pairing.

    Parameters
    ----------
    case
        The case; without a finer run, or with two of its own, it stays as it is.
    contacts
        The contact laws of the runs, by label: names, or mappings with a name.
    points
        Values of dotted paths in which the runs differ.
    """
    points = list(points)
    laws = [method_name(law) for law in contacts.values()]
    laws += [method_of_point(point, "method.contact") for point in points]
    laws = [law for law in laws if law and not _is_bond(case, law)]  # finer runs of bonds and ties keep these
    paths = ["method.pairing", *(f"contacts.{name}.pairing" for name in case.contacts)]
    pairings = [method_of_point(point, path) for point in points for path in paths]
    changes = second_reference(case, laws, pairings)
    return case.with_overrides(changes) if changes else case


def _is_bond(case: Case, law: str) -> bool:
    return law in case.registry.names("contacts") and bool(getattr(case.registry.get("contacts", law), "bond", False))


def second_reference(case: Case, laws: Sequence[str], pairings: Sequence[str]) -> Entries:
    """Return the values, by path, that judge a case by two finer runs, of two of the laws and of the pairings.

    The first has the law and the pairing that a single one would have, where runs have them too or the case names
    them. Nothing changes where all runs have one law and one pairing, and where no other finer run can be made.
    """
    chosen: Any = case.reference
    if chosen is None or chosen.second is not None:
        return {}
    first: Entries = {}
    others: dict[str, list[str]] = {}
    for kind, names in (("contact", laws), ("pairing", pairings)):
        varied = list(dict.fromkeys(filter(None, names)))
        named = getattr(chosen, kind)
        usual = named.name if named is not None else OF_REFERENCE[f"{kind}s"]
        if len(varied) > 1:
            first[kind] = usual if named is not None or usual in varied else varied[0]
            others[kind] = [name for name in varied if name != first[kind]]
        elif case.method.pairing is not None or kind == "contact":
            # A law may refuse the other pairings: the law of the case stands in for it then.
            others[kind] = [usual, case.method.contact.name] if kind == "contact" else [usual]
    for values in itertools.product(*others.values()) if first else ():
        second = dict(zip(others, values, strict=True))
        changes = {f"method.{kind}": name for kind, name in second.items()}
        given = case.data.get("contacts", {})
        own = {f"contacts.{name}.pairing": None for name, contact in given.items() if "pairing" in contact}
        try:
            made = case.with_overrides(changes | own)  # contacts have no pairing of their own, as in a finer run
            model_of(made)
        except PercussError:
            continue
        try:
            case.with_overrides({"reference.second": second})
        except PercussError:  # a law that needs options has those of the case
            second["contact"] = made.data["method"]["contact"]
        kept = {f"reference.{kind}": name for kind, name in first.items() if getattr(chosen, kind) is None}
        return kept | {"reference.second": second}
    return {}
