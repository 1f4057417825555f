"""The arrays that describe a checked case: nodes, masses, elements, contact points, supports, loads, time step."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.contact.bound_law import BoundLaw
from percuss.contact.contact_problem import contact_problem
from percuss.contact.laws import bind_laws
from percuss.contact.model_arrays import ModelArrays
from percuss.contact.pairs import points_of
from percuss.contact.points import LAW, NOTHING
from percuss.contact.rows import law_records
from percuss.errors import Problem, refuse_if_any
from percuss.march.features import features_of
from percuss.march.number_of_steps import check_step, step_count
from percuss.march.refusals import BEFORE_LAWS, WITH_LAWS, refuse
from percuss.mesh import spots
from percuss.mesh.bodies import bodies_of
from percuss.mesh.loads import Constraint, Held, acts_at, supports_and_loads
from percuss.methods.interfaces import ContactLaw, Floats, LeapFrog
from percuss.step.integrator_check import scheme

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.contact.features import Feature
    from percuss.methods.interfaces import ContactProblem


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


@dataclass(frozen=True, init=False, eq=False, repr=False)
class Model(ModelArrays):
    """The arrays of a case; a model never changes, and models derived from it share its arrays.

    Parameters
    ----------
    case
        A checked case.

    Raises
    ------
    InputError
        If the geometry, the contacts or the loads do not fit together.
    RefusedPair
        If the integrator and a contact law do not work together.
    """

    _never_active: tuple[int, ...]  # contact points whose law is not active at any time
    _whole: Model | None  # the model of the whole run, in the model of a stretch

    @np.errstate(all="ignore")  # numbers that are not finite are refused with their place
    def __init__(self, case: Case) -> None:
        bodies = bodies_of(case)
        self._set(case=case, bodies=bodies, _never_active=(), _whole=None)
        courant = 1.0 if case.time.courant is None or case.time.courant == "auto" else case.time.courant
        self._set_step(case.time.step if case.time.step is not None else courant * 2.0 / bodies.omega)
        problems: list[Problem] = []
        of_loads: list[Problem] = []
        loads = supports_and_loads(case, bodies, of_loads)
        points = points_of(case, bodies, Held(loads.constraints), problems)
        problems += [*of_loads, *spots.outside(case, bodies)]
        refuse_if_any(problems)
        self._set(contact_points=points, loads=loads)
        self._bind()

    # -- construction and derived models -----------------------------------------------------------------

    def _set(self, **values: Any) -> None:
        """Set attributes of a model that is still under construction."""
        vars(self).update(values)

    def _derived(self, **changes: Any) -> Model:
        """Return a copy with some attributes replaced; nothing that was computed from them is carried over."""
        model = object.__new__(Model)
        model._set(**{field.name: getattr(self, field.name) for field in dataclasses.fields(self)} | changes)
        return model

    def _set_step(self, dt: float) -> None:
        check_step(self.case, dt)
        steps = self.case.time.steps
        self._set(dt=dt, steps=steps if steps is not None else step_count(self.case, dt))

    def _bind(self) -> None:
        """Bind the integrator and the laws for the step, and refuse methods that do not work together."""
        stages, tables = scheme(self.case.method.integrator, self.dt)
        self._set(stages=stages, tables=tables)
        refuse(self, BEFORE_LAWS)
        self._set(laws=bind_laws(self, self.dt))
        refuse(self, WITH_LAWS)

    def with_step(self, dt: float) -> Model:
        """Return the model of the whole run with another time step."""
        model = self._derived()
        model._set_step(dt)
        model._bind()
        return model

    def with_laws(self, replaced: Mapping[ContactLaw, ContactLaw]) -> Model:
        """Return the model of the whole run with other contact laws.

        Parameters
        ----------
        replaced
            The new law for each law that is replaced.
        """
        laws = tuple(replaced.get(law, law) for law in self.contact_points.laws)
        model = self._derived(contact_points=dataclasses.replace(self.contact_points, laws=laws))
        model._bind()
        return model

    def without_loads(self, dt: float, constraints: Sequence[Constraint], inactive: Sequence[int] = ()) -> Model:
        """Return the model of one stretch, with laws bound again for the time step `dt`.

        It has no loads but those that follow the motion of an end, and `constraints` as given.

        Parameters
        ----------
        dt
            Time step.
        constraints
            The supports and drives of the stretch.
        inactive
            Contact points whose law is never active; all other laws are always active.
        """
        stages, tables = scheme(self.case.method.integrator, dt)
        return self._derived(
            dt=dt,
            steps=1,
            loads=self.loads._replace(constraints=tuple(constraints), nodal_forces=(), body_forces=()),
            stages=stages,
            tables=tables,
            laws=tuple(dataclasses.replace(bound_law, during=None) for bound_law in self.laws_at(dt)),
            _never_active=tuple(inactive),
            _whole=self.whole,
        )

    def stretches(self) -> list[Stretch]:
        """Return the stretches of the run that differ in their active supports and drives, or in their active laws.

        A stretch with the same constraints and laws as an earlier one is not listed again.
        """
        listed: dict[Any, Stretch] = {}
        for first, last in self.segments():
            midpoint = (first + 0.5) * self.dt
            constraints = tuple(
                index for index, constraint in enumerate(self.loads.constraints) if constraint.active(midpoint)
            )
            inactive = self.inactive_points(midpoint)
            if (constraints, inactive) not in listed:
                acting = (self.loads.constraints[index] for index in constraints)
                at_rest = [dataclasses.replace(constraint, load=None, column=0) for constraint in acting]
                model = self.without_loads(self.dt, at_rest, inactive)
                start, stop = first * self.dt, min(last, self.steps) * self.dt
                listed[constraints, inactive] = Stretch(start, max(stop, start), constraints, inactive, model)
        return list(listed.values())

    @cached_property
    def problem(self) -> ContactProblem | str:
        """The mechanical problem that the case states, as exact solutions receive it; or why it is none of bars."""
        return contact_problem(self)

    @cached_property
    def features(self) -> tuple[Feature, ...]:
        """The facts about the optional features that the model has."""
        return features_of(self)

    # -- bodies and time ---------------------------------------------------------------------------------

    @property
    def whole(self) -> Model:
        """The model of the whole run, also for the model of a stretch."""
        return self._whole or self

    @property
    def courant(self) -> float:
        """Courant number of the element with the highest frequency omega, ``omega dt / 2``: c dt/h of a bar."""
        return 0.5 * self.dt * self.bodies.omega

    def inactive_points(self, midpoint: float) -> tuple[int, ...]:
        """Return the contact points whose law is not active in the step around `midpoint`."""
        inactive = set(self._never_active)
        for bound_law in self.laws:
            during = bound_law.during
            if during is not None and not acts_at(midpoint, during[:, 0], during[:, 1]).any():
                inactive.update(bound_law.where)
        return tuple(sorted(inactive))

    # -- contacts ----------------------------------------------------------------------------------------

    @cached_property
    def tied_points(self) -> tuple[int, ...]:
        """The contact points of masses that are tied in every step of the run or stretch, in ascending order."""
        tied = {p for bound_law in self.laws if bound_law.ties and bound_law.during is None for p in bound_law.where}
        return tuple(sorted(p for p in tied.difference(self._never_active) if not self.balanced[p]))

    def laws_at(self, dt: float) -> tuple[BoundLaw, ...]:
        """Return the laws bound for a time step `dt`, in the order of `laws`."""
        return self.whole.laws if dt == self.whole.dt else bind_laws(self.whole, dt)

    def law_records(self, table: LeapFrog | None = None) -> tuple[list[int], Any]:
        """Return the order of the contact points in the loop, and their law records in that order, (P,) `LAW`."""
        table, delassus = table or self.tables[-1], self.rows_at(0.5 * self.dt).delassus
        order = [point for bound_law in self.laws for point in bound_law.where]
        parts = [self.records_of(bound_law, table, delassus[list(bound_law.where)]) for bound_law in self.laws]
        records = np.concatenate(parts) if parts else np.zeros(0, dtype=LAW)
        if self.stages is not None:
            records["stores"] = NOTHING
        return order, records

    def records_of(self, bound_law: BoundLaw, table: LeapFrog, delassus: Floats) -> Any:
        """Return the records of a law at its points, where S has the diagonal `delassus`, (P,) `LAW`."""
        records = law_records(bound_law, table, delassus)
        return self.facts.records(bound_law, records, delassus) if self.facts.records else records
