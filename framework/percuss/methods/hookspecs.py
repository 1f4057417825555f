"""Hooks that a plug-in may implement: one for each family; each takes no argument and returns component classes."""

from collections.abc import Iterable

import pluggy

hookspec = pluggy.HookspecMarker("percuss")
hookimpl = pluggy.HookimplMarker("percuss")


@hookspec
def percuss_integrators() -> Iterable[type]:
    """Return the time integrators: subclasses of `percuss.Integrator`."""


@hookspec
def percuss_contacts() -> Iterable[type]:
    """Return the contact laws: subclasses of `percuss.ContactLaw`."""


@hookspec
def percuss_loads() -> Iterable[type]:
    """Return the load amplitudes: subclasses of `percuss.Load`."""


@hookspec
def percuss_shapes() -> Iterable[type]:
    """Return the body shapes: subclasses of `percuss.Shape`."""


@hookspec
def percuss_elements() -> Iterable[type]:
    """Return the elements: subclasses of `percuss.Element`."""


@hookspec
def percuss_materials() -> Iterable[type]:
    """Return the materials: subclasses of `percuss.Material`."""


@hookspec
def percuss_masses() -> Iterable[type]:
    """Return the rules for nodal masses: subclasses of `percuss.Mass`."""


@hookspec
def percuss_solutions() -> Iterable[type]:
    """Return the exact solutions: subclasses of `percuss.Solution`."""


@hookspec
def percuss_measures() -> Iterable[type]:
    """Return the measures of results: subclasses of `percuss.Measure`."""
