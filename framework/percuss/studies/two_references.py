"""The two finer runs that judge runs of several laws or pairings: one alone would favour its own law and pairing."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

from percuss.case.case import Case
from percuss.case.defaults import OF_REFERENCE
from percuss.errors import PercussError
from percuss.jsonable import Data, Entries
from percuss.march.model_of_case import model_of
from percuss.studies.tasks import method_name, method_of_point


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
