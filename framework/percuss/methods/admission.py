"""Checks that a component registered by a plug-in keeps the contract."""

from __future__ import annotations

import functools
import inspect
import multiprocessing
import sys

from percuss import version
from percuss.errors import PluginError, suggestion
from percuss.methods.blame import plain_function
from percuss.methods.interfaces import FAMILIES, NAME_PATTERN, Component, ContactLaw, Friction, Material

PREFIX = "percuss_"
LAST_UNRELEASED = 5  # Contracts 2 to 5 were those of versions before the first release, which begins anew with 1.


def admitted(family: str, offer: object) -> type[Component]:
    """Return a registered object if it is a component class that keeps the contract of its family.

    Raises
    ------
    PluginError
        If it breaks a rule of the contract; the message names the rule.
    """
    if family not in FAMILIES:
        raise PluginError(f"there is no family '{family}'. {suggestion(family, FAMILIES, 'family')}")
    contract = FAMILIES[family]
    if not isinstance(offer, type):
        description = f"an object of class {type(offer).__name__}" if isinstance(offer, Component) else repr(offer)
        raise PluginError(f"{description} is not a class; return the class itself")
    name = offer.__name__
    if not issubclass(offer, contract):
        if family := getattr(offer, "family", "") if issubclass(offer, Component) else "":
            raise PluginError(f"{name} is one of {family}; return it from {PREFIX}{family}")
        raise PluginError(f"{name} is not a subclass of percuss.{contract.__name__}")
    if "name" not in vars(offer):
        raise PluginError(f"{name} is a contract, not a finished method; it has no `name`")
    _check_version(offer)  # A component for another contract may lack methods, so its version is checked first.
    if missing := sorted(getattr(offer, "__abstractmethods__", ())):
        raise PluginError(f"{name} is still abstract; it lacks {', '.join(f'`{method}`' for method in missing)}")
    # Only the value of the class itself counts: an inherited one does not cover the options of this class.
    parameters = vars(offer).get("__dataclass_params__")
    if parameters is None or not parameters.frozen:
        raise PluginError(f"{name} is not a frozen dataclass; put @dataclass(frozen=True) above it")
    if not NAME_PATTERN.fullmatch(offer.name):
        raise PluginError(f"{name} has the name {offer.name!r}; a letter, then letters, digits, _ and -")
    _check_signatures(contract, offer)
    if issubclass(offer, ContactLaw | Material):
        _check_state(offer)
    if issubclass(offer, Friction) and offer.state and not hasattr(offer, "renew"):
        raise PluginError(f"{name} has state variables; it lacks the static method `renew`, which writes them")
    return offer


# Static methods that a contract describes but does not define, with their arguments.
KERNELS: dict[str, dict[str, tuple[str, ...]]] = {
    "contacts": {"multipliers": ("bound", "trial", "multiplier")},
    "frictions": {"renew": ("data", "point", "force", "rate", "before", "after")},
    "integrators": {"step": ("numbers", "system", "u", "v", "kept", "dt")},
}


def _check_signatures(contract: type[Component], component: type[Component]) -> None:
    """Raise PluginError if a method cannot be called with the arguments that its contract gives it.

    Contracts are that of the family and those between it and the component, as `FollowingLoad` is.
    """
    expected: dict[str, tuple[str, ...]] = {**KERNELS.get(contract.family, {})}
    contracts = [base for base in reversed(component.__mro__[1:]) if issubclass(base, contract)]
    for name, value in (entry for base in contracts for entry in vars(base).items()):
        if name[0] != "_" and inspect.isfunction(function := plain_function(value)):
            expected[name] = tuple(inspect.signature(function).parameters)
    if issubclass(component, Material) and component.state:
        expected["stress"] = ("parameters", "strain", "before", "after")
    for name, arguments in expected.items():
        function = plain_function(inspect.getattr_static(component, name, None))
        if not inspect.isfunction(function):
            continue
        signature = inspect.signature(function)
        try:
            signature.bind(*arguments)
        except TypeError:
            shown = f"{component.__name__}.{name}{signature.replace(return_annotation=signature.empty)}"
            raise PluginError(f"{shown} is called as {name}({', '.join(arguments)})") from None


def _check_state(component: type[ContactLaw | Material]) -> None:
    """Raise PluginError if a contact law or a material does not declare its state variables soundly."""
    name, state = component.__name__, component.state
    if type(state) is not int or state < 0:
        raise PluginError(f"{name} has state = {state!r}; expected the number of its state variables")
    for fact in ("stored_in", "dissipated_in"):
        number = getattr(component, fact)
        if number is not None and not (type(number) is int and 0 <= number < state):
            raise PluginError(
                f"{name} has {fact} = {number!r}; expected the number of one of its {state} state variables, from 0, "
                "or None"
            )
    if not issubclass(component, Material):
        return
    if state > 0 and component.stored_in is None:
        raise PluginError(f"{name} has state variables; say with `stored_in` which of them is the energy it stores")
    if state > 0 and component.linear:
        raise PluginError(f"{name} has state variables, and declares `linear = True`; its stress depends on the past")
    if state == 0 and component.stress is not None and component.energy_density is Material.energy_density:
        raise PluginError(f"{name} is still abstract; it lacks `energy_density`")
    if component.stress is None:
        _check_solid(component)


def _check_solid(material: type[Material]) -> None:
    """Raise PluginError unless a material without a stress of bars has kernels for two or three dimensions."""
    kernels = {which: getattr(material, f"stress_{which}", None) for which in ("2d", "3d")}
    if not any(kernels.values()):
        raise PluginError(f"{material.__name__} is still abstract; it lacks `stress_2d`, `stress_3d` or `stress`")
    for which, kernel in kernels.items():
        silent = not (material.linear or material.state) and getattr(material, f"stored_{which}", None) is None
        if kernel is not None and silent:
            raise PluginError(f"{material.__name__} is not linear; say with `stored_{which}` what energy it stores")


def contract_of(component: type[Component]) -> int | None:
    """Return the contract for which a component is written, None if it does not say so."""
    stated = component.contract_version
    return 1 if stated is not None and version.CONTRACT < stated <= LAST_UNRELEASED else stated


def _check_version(component: type[Component]) -> None:
    """Raise PluginError if a component states a contract that is newer than this percuss, or none at all."""
    stated, current = component.contract_version, version.CONTRACT
    if stated is None:
        return
    if type(stated) is not int or stated < 1:
        raise PluginError(
            f"{component.__name__} has the contract_version {stated!r}; expected a whole number from 1, now {current}"
        )
    if contract_of(component) != stated:
        _note_on_unreleased_contracts()
    elif stated > current:
        written = f"{component.__name__} is written for contract {stated}, this percuss has contract {current}"
        raise PluginError(f"{written}: upgrade percuss")


@functools.cache
def _note_on_unreleased_contracts() -> None:
    """Say once, and not in each worker process of a study, what is made of a contract before the first release."""
    if multiprocessing.parent_process() is None:
        words = f"contracts 2 to {LAST_UNRELEASED} are those before the first release, and are taken as contract 1"
        print(f"note: {words}: write `contract_version = 1`", file=sys.stderr)
