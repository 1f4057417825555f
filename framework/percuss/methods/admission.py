"""Whether what a plug-in registers keeps the contract, and for which version of the contract it was written."""

from __future__ import annotations

import inspect
import math

import percuss
from percuss.errors import PluginError, suggestion
from percuss.methods.interfaces import FAMILIES, NAME_PATTERN, Component

__all__ = ["CHANGES", "OLDEST", "PREFIX", "admitted"]

PREFIX = "percuss_"
# contract -> what a plug-in written for the one before has to change; never taken out, so that any can be brought up
CHANGES = {
    1: "the first",
    2: "`Rows` is `LinearLaw`, `Judged` is `ContactState` with `response` in place of `answer`, `Trial.gap_answer` and "
    "`Trial.rate_answer` are `gap_response` and `rate_response`, `DataFile.columns` is `as_columns`",
}
OLDEST = 2  # contract that is still kept: a method that states an older one is refused


def admitted(family: str, offer: object) -> type[Component]:
    """Return a registered object as the component it is.

    Raises
    ------
    PluginError
        With the rule that it breaks.
    """
    if family not in FAMILIES:
        raise PluginError(f"there is no family '{family}'. {suggestion(family, FAMILIES, 'family')}")
    contract = FAMILIES[family]
    if not isinstance(offer, type):
        what = f"an object of class {type(offer).__name__}" if isinstance(offer, Component) else repr(offer)
        raise PluginError(f"{what} is not a class; return the class itself")
    name = offer.__name__
    if not issubclass(offer, contract):
        if family := getattr(offer, "family", "") if issubclass(offer, Component) else "":
            raise PluginError(f"{name} is one of {family}; return it from {PREFIX}{family}")
        raise PluginError(f"{name} is not a subclass of percuss.{contract.__name__}")
    if "name" not in vars(offer):
        raise PluginError(f"{name} is a contract, not a finished method; it has no `name`")
    _check_version(offer)  # first: what another contract asks for may well be missing here
    if missing := sorted(getattr(offer, "__abstractmethods__", ())):
        raise PluginError(f"{name} is still abstract; it lacks {', '.join(f'`{one}`' for one in missing)}")
    parameters = vars(offer).get("__dataclass_params__")  # its own: those of a base do not see its options
    if parameters is None or not parameters.frozen:
        raise PluginError(f"{name} is not a frozen dataclass; put @dataclass(frozen=True) above it")
    _check_signatures(contract, offer)
    if not isinstance(offer.name, str) or not NAME_PATTERN.fullmatch(offer.name):
        raise PluginError(f"{name} has the name {offer.name!r}; a letter, then letters, digits, _ and -")
    return offer


KERNELS: dict[str, dict[str, tuple[str, ...]]] = {  # static methods that a contract names and does not have
    "contacts": {"multipliers": ("bound", "trial", "multiplier")},
    "integrators": {"step": ("numbers", "system", "u", "v", "kept", "dt")},
}


def _check_signatures(contract: type[Component], component: type[Component]) -> None:
    """Raise PluginError where a method takes other arguments than its contract says it is called with."""
    wanted: dict[str, tuple[str, ...]] = {**KERNELS.get(contract.family, {})}
    own = {name: value for name, value in vars(contract).items() if name[0] != "_"}
    for name, value in own.items():
        function = value.__func__ if isinstance(value, staticmethod) else value
        if inspect.isfunction(function):
            wanted[name] = tuple(inspect.signature(function).parameters)
    for name, arguments in wanted.items():
        given = inspect.getattr_static(component, name, None)
        function = given.__func__ if isinstance(given, staticmethod) else given
        function = getattr(function, "py_func", function)
        if not inspect.isfunction(function):
            continue
        parameters = inspect.signature(function).parameters.values()
        needed = [p for p in parameters if p.default is p.empty and p.kind not in {p.VAR_POSITIONAL, p.VAR_KEYWORD}]
        most = math.inf if any(p.kind is p.VAR_POSITIONAL for p in parameters) else len(parameters)
        if not len(needed) <= len(arguments) <= most:
            has = f"{name}({', '.join(map(str, parameters))})"
            raise PluginError(f"{component.__name__}.{has} is called as {name}({', '.join(arguments)})")


def _check_version(component: type[Component]) -> None:
    """Raise PluginError where a component states a contract that this percuss does not have, or has no more."""
    stated, here = component.contract_version, percuss.CONTRACT
    if stated is None:
        return
    if type(stated) is not int or stated < 1:
        raise PluginError(
            f"{component.__name__} has the contract_version {stated!r}; expected a whole number from 1, now {here}"
        )
    written = f"{component.__name__} is written for contract {stated}, this percuss has contract {here}"
    if stated > here:
        raise PluginError(f"{written}: upgrade percuss")
    if stated < OLDEST:
        since = "; ".join(f"contract {one}: {CHANGES[one]}" for one in range(stated + 1, here + 1))
        raise PluginError(
            f"{written} and keeps those from {OLDEST} on: change it ({since}), then state contract_version = {here}"
        )
