"""The making of a model from a checked case, and of models with another step, other laws or without loads."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.contact.laws import bind_laws, laws_at
from percuss.contact.model import Model, rows_over_the_run
from percuss.contact.pairs import points_of
from percuss.errors import Problem, refuse_if_any
from percuss.march.number_of_steps import steps_of
from percuss.march.parts import features_of
from percuss.march.refusals import BEFORE_LAWS, WITH_LAWS, refuse
from percuss.mesh import spots
from percuss.mesh.bodies import bodies_of
from percuss.mesh.loads import Constraint, Held, supports_and_loads
from percuss.methods.interfaces import ContactLaw
from percuss.step.integrator_check import scheme

if TYPE_CHECKING:
    from percuss.case.case import Case


class Stretch(NamedTuple):
    """A part of a run during which the set of active supports and drives and the set of active laws do not change.

    Attributes
    ----------
    start, stop
        Times between which it lasts.
    constraints
        Numbers of the active supports and drives.
    inactive
        Numbers of the contact points whose law is not active.
    model
        The same model without loads, its supports and drives at rest.
    """

    start: float
    stop: float
    constraints: tuple[int, ...]
    inactive: tuple[int, ...]
    model: Model


@np.errstate(all="ignore")  # numbers that are not finite are refused with their place
def model_of(case: Case) -> Model:
    """Return the model of a checked case.

    Raises
    ------
    InputError
        If the geometry, the contacts or the loads do not fit together.
    RefusedPair
        If the integrator and a contact law do not work together.
    """
    bodies = bodies_of(case)
    courant = 1.0 if case.time.courant is None or case.time.courant == "auto" else case.time.courant
    dt = case.time.step if case.time.step is not None else courant * 2.0 / bodies.omega
    steps = steps_of(case, dt)
    problems: list[Problem] = []
    of_loads: list[Problem] = []
    loads = supports_and_loads(case, bodies, of_loads)
    points = points_of(case, bodies, Held(loads.constraints), problems)
    problems += [*of_loads, *spots.outside(case, bodies)]
    refuse_if_any(problems)
    return _bound(Model(case, bodies, points, loads, dt, steps, *scheme(case.method.integrator, dt)))


def _bound(model: Model) -> Model:
    """Return a model with its rows, facts and laws, or refuse methods that do not work together."""
    model = dataclasses.replace(model, rows=rows_over_the_run(model), features=features_of(model))
    refuse(model, BEFORE_LAWS)
    model = dataclasses.replace(model, laws=bind_laws(model, model.dt))
    refuse(model, WITH_LAWS)
    return model


def with_step(model: Model, dt: float) -> Model:
    """Return the model of a whole run with another time step."""
    stages, tables = scheme(model.case.method.integrator, dt)
    steps = steps_of(model.case, dt)
    return _bound(dataclasses.replace(model, dt=dt, steps=steps, stages=stages, tables=tables))


def with_laws(model: Model, replaced: Mapping[ContactLaw, ContactLaw]) -> Model:
    """Return the model of a whole run with other contact laws.

    Parameters
    ----------
    model
        The model.
    replaced
        The new law for each law that is replaced.
    """
    laws = tuple(replaced.get(law, law) for law in model.contact_points.laws)
    points = dataclasses.replace(model.contact_points, laws=laws)
    return _bound(dataclasses.replace(model, contact_points=points))


def without_loads(model: Model, dt: float, constraints: Sequence[Constraint], inactive: Sequence[int] = ()) -> Model:
    """Return the model of one stretch of a run, with laws bound again for the time step `dt`.

    It has no loads but those that follow the motion of an end, and `constraints` as given.

    Parameters
    ----------
    model
        The model of the run, or of a stretch of it.
    dt
        Time step.
    constraints
        The supports and drives of the stretch.
    inactive
        Contact points whose law is never active; all other laws are always active.
    """
    stages, tables = scheme(model.case.method.integrator, dt)
    stretch = dataclasses.replace(
        model,
        loads=model.loads._replace(constraints=tuple(constraints), nodal_forces=(), body_forces=()),
        dt=dt,
        steps=1,
        stages=stages,
        tables=tables,
        laws=tuple(dataclasses.replace(bound_law, during=None) for bound_law in laws_at(model, dt)),
        never_active=tuple(inactive),
        run=model.whole,
    )
    return dataclasses.replace(stretch, rows=rows_over_the_run(stretch), features=features_of(stretch))


def stretches(model: Model) -> list[Stretch]:
    """Return the stretches of the run that differ in their active supports and drives, or in their active laws.

    A stretch with the same constraints and laws as an earlier one is not listed again.
    """
    listed: dict[Any, Stretch] = {}
    if _is_one_stretch(model):
        whole = tuple(range(len(model.loads.constraints)))
        return [Stretch(0.0, model.steps * model.dt, whole, (), model)]
    for first, last in model.segments():
        midpoint = (first + 0.5) * model.dt
        constraints, inactive = model.active_constraints(midpoint), model.inactive_points(midpoint)
        if (constraints, inactive) not in listed:
            acting = (model.loads.constraints[index] for index in constraints)
            at_rest = [dataclasses.replace(constraint, load=None, column=0) for constraint in acting]
            start, stop = first * model.dt, min(last, model.steps) * model.dt
            alone = without_loads(model, model.dt, at_rest, inactive)
            listed[constraints, inactive] = Stretch(start, max(stop, start), constraints, inactive, alone)
    return list(listed.values())


def _is_one_stretch(model: Model) -> bool:
    """Return whether a model is that of its only stretch: it has supports at rest and laws that always act alone."""
    acts = bool(model.loads.on_nodes or model.loads.body_forces or model.never_active)
    always = all(one.load is None for one in model.loads.constraints)
    return always and not acts and all(bound_law.during is None for bound_law in model.laws)
