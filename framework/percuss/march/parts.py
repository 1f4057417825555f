"""The optional features of a model: the one table of the parts of a step, and of what else says facts."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from percuss.contact import frictions, moving_rows
from percuss.step.integrator_check import laws_refused
from percuss.step.part import Part
from percuss.step.parts import (
    coupled_masses,
    damping,
    ends_without_mass,
    followers,
    following_pressure,
    friction,
    own_steps,
    viscosity,
)
from percuss.step.parts import sliding as slides
from percuss.step.parts.internal_work import InternalWork
from percuss.step.parts.moments import MomentsSummed
from percuss.step.parts.of_surfaces import SurfacesRecorded
from percuss.step.parts.state_variables import StateVariablesKept
from percuss.step.parts.stretch import Stretch
from percuss.step.parts.supports import SupportsRecorded

if TYPE_CHECKING:
    from percuss.contact.features import Feature
    from percuss.contact.model import Model

# The optional parts of a step, in the order in which they act at one place.
PARTS: tuple[type[Part[Any]], ...] = (
    coupled_masses.CoupledMasses,
    followers.Followers,
    following_pressure.FollowingPressure,
    ends_without_mass.EndsWithoutMass,
    InternalWork,
    viscosity.Viscosity,
    damping.Damping,
    own_steps.OwnSteps,
    slides.Sliding,
    friction.Frictions,
    MomentsSummed,
    StateVariablesKept,
    Stretch,
    SurfacesRecorded,
    SupportsRecorded,
)
# What says the facts about each feature, None of a model without it; of several facts that exclude each other the first
# one counts.
FEATURES: tuple[Callable[[Model], Feature | None], ...] = (
    viscosity.feature,
    damping.feature,
    own_steps.feature,
    coupled_masses.feature,
    ends_without_mass.feature,
    followers.feature,
    friction.feature,
    slides.feature,
)
# What the features refuse, before and after the laws are bound; of a pair of methods the first reason is told.
BEFORE_LAWS = (coupled_masses.refusals, viscosity.refusals, damping.refusals, following_pressure.refusals)
WITH_LAWS = (ends_without_mass.refusals, laws_refused, moving_rows.refusals, frictions.refusals)


def features_of(model: Model) -> tuple[Feature, ...]:
    """Return the facts about the optional features that a model has."""
    return tuple(filter(None, (feature(model) for feature in FEATURES)))
