"""The families of components: what a method must say, with shapes and units.

A component is a frozen dataclass. Its fields are its options, filled from YAML; ``Annotated`` bounds and units on
them are what validation, schema and help read. Its class facts (`name`, `summary`, `references`, ...) stand beside
them as plain class attributes. What depends on a model or on the time step appears in `bind`, never in the options.

A kernel is a static method that the time loop calls. Where it can be compiled it is; it may read its arguments and
module-level constants and call plain helper functions, and it keeps nothing between calls.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

__all__ = [
    "AllowInf",
    "BodyMesh",
    "Component",
    "ContactLaw",
    "ContactPoints",
    "DataFile",
    "Doc",
    "Element",
    "Exact",
    "ExactContact",
    "Floats",
    "Ge",
    "Gt",
    "Integers",
    "Integrator",
    "Judged",
    "Le",
    "LeapFrog",
    "Load",
    "Lt",
    "Mass",
    "Material",
    "Measure",
    "Mesh",
    "Region",
    "Rows",
    "Shape",
    "Solution",
    "Stages",
    "Trial",
    "Unit",
]

NAME_PATTERN = re.compile(r"[A-Za-z][\w-]*")


@dataclass(frozen=True)
class Unit:
    """Physical dimension of an option, in words: ``Unit("force/length")``; ``Unit("1")`` is a pure number."""

    unit: str

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> dict[str, Any]:
        schema: dict[str, Any] = handler(core_schema)
        schema["x-unit"] = self.unit
        return schema


@dataclass(frozen=True)
class AllowInf:
    """Marks a number that may be infinite; every other one is finite. ``nan`` is never a value."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> dict[str, Any]:
        schema: dict[str, Any] = handler(source)
        schema["allow_inf_nan"] = True
        return schema


@dataclass(frozen=True)
class Doc:
    """One line that says what an option is; shown in the schema and by ``percuss plugins NAME``."""

    text: str

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> dict[str, Any]:
        schema: dict[str, Any] = handler(core_schema)
        schema["description"] = self.text
        return schema


@dataclass(frozen=True, eq=False)
class DataFile:
    """A CSV file of numbers named in a case, relative to it; read once, when the case is checked.

    Two data files are equal where path and numbers are.

    Attributes
    ----------
    path
        As written in the case.
    table : (columns, rows) array
        Its numbers; a first line of which no field begins as a number does is skipped.
    """

    path: str
    table: Floats

    def __eq__(self, other: object) -> bool:
        # an array has no truth value, so that the comparison that a dataclass writes for itself would fail
        if not isinstance(other, DataFile):
            return NotImplemented
        return self.path == other.path and np.array_equal(self.table, other.table, equal_nan=True)

    def __hash__(self) -> int:
        return hash((self.path, self.table.shape))

    def columns(self, count: int) -> Floats:
        """Return the (count, rows) numbers.

        Raises
        ------
        ValueError
            If the file does not have `count` columns.
        """
        if self.table.shape[0] != count:
            raise ValueError(f"{self.path} has {self.table.shape[0]} columns, expected {count}")
        return self.table


class Component(ABC):
    r"""Root of every contract. A class is either a contract or a finished method, never both.

    Attributes
    ----------
    name
        As written in a case; matches ``[A-Za-z][\w-]*``.
    summary
        One line for tables and help.
    references
        Sources, with DOI where there is one.
    examples
        Option sets that make sense; the conformance kit runs them.
    shorthand
        Name of the option meant where a case gives a bare value in place of a mapping; empty if none.
    expected_failures
        Checks that the method is known not to pass, to the reason: ``"energy-never-grows"``, or with one partner only
        ``"energy-never-grows with penalty"``. A declared failure that does not occur is an error.
    contract_version
        The `percuss.CONTRACT` that it was written for; may be left out. A percuss that no longer keeps that contract
        refuses the component and says what changed, an older percuss asks to be upgraded.
    """

    family: ClassVar[str]
    name: ClassVar[str]
    summary: ClassVar[str]
    references: ClassVar[tuple[str, ...]] = ()
    examples: ClassVar[tuple[Mapping[str, Any], ...]] = ({},)
    shorthand: ClassVar[str] = ""
    expected_failures: ClassVar[Mapping[str, str]] = {}
    contract_version: ClassVar[int | None] = None

    def __init_subclass__(cls, *, contract: str = "", **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if contract:
            cls.family = contract
            return
        finished = [base.__name__ for base in cls.__mro__[1:] if "name" in vars(base) and issubclass(base, Component)]
        if finished:
            msg = f"{cls.__name__} subclasses the finished method {finished[0]}: subclass its contract instead"
            raise TypeError(msg)
        for fact in ("name", "summary"):
            if not isinstance(vars(cls).get(fact), str):
                raise TypeError(f'{cls.__name__} does not say its `{fact}`: add `{fact} = "..."` to the class')
        known = {fact for base in cls.__mro__[1:] for fact in (*vars(base), *vars(base).get("__annotations__", {}))}
        for option, value in vars(cls).items():
            plain = isinstance(value, int | float | str | None) and option.islower() and not option.startswith("_")
            if plain and option not in known and option not in vars(cls).get("__annotations__", {}):
                raise TypeError(
                    f"{cls.__name__}.{option} has no annotation, so that no case can set it: write "
                    f"`{option}: {type(value).__name__} = {value!r}`, or {option.upper()} for a constant"
                )
        if not NAME_PATTERN.fullmatch(cls.name):
            raise TypeError(
                f"{cls.__name__} has the name {cls.name!r}: start with a letter, then letters, digits, _, -"
            )
        if not (vars(cls).get("__doc__") or "").strip():
            raise TypeError(f"{cls.__name__} has no docstring: give formula, source and stability limit")


# ---------------------------------------------------------------------------------------------- integrators


class Judged(NamedTuple):
    """At which state a contact law is judged, and how that state answers a multiplier.

    Attributes
    ----------
    gap, rate
        ``"current"``: g(u_n) and the rate at n - 1/2; ``"predicted"``: the same after the bulk update of the step.
    acceleration
        ``"bulk"``: the gap's bulk acceleration; ``"none"``: zero is shown to the law. A law whose row has a weight on
        the acceleration is then refused, unless it says that it needs the response to its multiplier alone
        (`ContactLaw.needs_only_response_of`).
    answer
        What a unit multiplier adds to (gap, rate, acceleration), in units of the Delassus operator S.
    """

    gap: Literal["current", "predicted"]
    rate: Literal["current", "predicted"]
    acceleration: Literal["bulk", "none"]
    answer: tuple[float, float, float]


class LeapFrog(NamedTuple):
    """A leap-frog scheme (displacement at n, velocity at n - 1/2) as its contact sees it: all such a scheme must say.

    Attributes
    ----------
    explicit
        For laws judged before the step is corrected.
    end
        For laws judged at the end of the step.
    """

    explicit: Judged
    end: Judged


class Stages(NamedTuple):
    """A scheme that is no leap-frog: displacement and velocity at t_n, accelerations asked for in stages of the step.

    Attributes
    ----------
    times
        Of each stage, the fraction of the step at which its accelerations are taken: 0 at t_n, 1 at t_{n+1}. Loads are
        those of that time.
    numbers
        Coefficients that `step` is handed: a NamedTuple or tuple of floats.
    end
        Of each stage, ``(r_v, r_a, s_a)``, all greater than 0: laws judged at the end of the step are judged in this
        stage at the displacement ``u + r_v v + r_a a`` and the velocity ``v + s_a a``; u and v as `step` hands them to
        `percuss.accelerations` there, a what it gets back. What else the displacement to come depends on, such as an
        acceleration that is kept, goes into the v that is handed: contact alone looks at it. Take the displacement
        that the scheme reaches by the next stage, and the mean velocity until then: ``s_a = r_a / r_v``. Empty: such
        laws are refused.
    """

    times: tuple[float, ...]
    numbers: tuple[float, ...] = ()
    end: tuple[tuple[float, float, float], ...] = ()


class Integrator(Component, contract="integrators"):
    """A time integrator: a leap-frog scheme, complete with its `bind`, or any other explicit one, with a kernel.

    A scheme whose `bind` returns `LeapFrog` says no more; the framework makes the step. Any other one returns `Stages`
    and has a static method ``step(numbers, system, u, v, kept, dt)``, a kernel that takes displacement u and velocity
    v, flat arrays, from t_n to t_{n+1}, *in place*. In it ``percuss.accelerations(system, stage, u, v, a)``, imported
    by name, sets the array `a`, as long as u, to ``M^-1 (f_ext - f_int(u) + N lambda)`` at the time of that stage; v is
    seen by contact alone. What the scheme remembers from step to step is in the rows of `kept`, (kept, size of u)::

        @staticmethod
        def step(numbers, system, u, v, kept, dt):  # velocity Verlet; kept = 1, Stages(times=(1.0,))
            v += 0.5 * dt * kept[0]
            u += dt * v
            accelerations(system, 0, u, v, kept[0])
            v += 0.5 * dt * kept[0]

    A kernel may allocate arrays. Every entry of u, v and kept must be treated alike: behind the degrees of freedom of
    the nodes stand entries whose accelerations are the multipliers, the reactions and the amplitudes of the loads, and
    from what becomes of them follow the impulses and works of a step, whatever its weights. Before the first step the
    framework checks that a constant acceleration a changes v by dt a, and v alone u by dt v.

    In a stage, laws judged explicitly see ``g(u)``, ``N^T v`` and the bulk acceleration of the gap, of which a
    multiplier changes the last alone. Along a support or drive the acceleration is that of the prescribed velocity,
    over the step.

    Attributes
    ----------
    order
        Order of convergence of the displacement on smooth contact-free motion.
    conserves
        What holds to round-off without contact: ``"energy"``, ``"momentum"``.
    critical_courant
        Courant number up to which a uniform bar without contact is stable, with the first of `examples`; None where
        it is not known.
    kept
        How many rows a scheme with a kernel `step` keeps; each begins as the acceleration at t = 0, with contact
        judged as in the last stage.
    """

    order: ClassVar[int]
    conserves: ClassVar[tuple[str, ...]] = ()
    critical_courant: ClassVar[float | None] = None
    kept: ClassVar[int] = 0

    @abstractmethod
    def bind(self, dt: float) -> LeapFrog | Stages:
        """Return how contact is judged in a step of length `dt`.

        Parameters
        ----------
        dt
            Time step.

        Returns
        -------
        LeapFrog
            The framework does the bulk update and solves the contact equation.
        Stages
            The framework gives accelerations with contact in them, and the class has a kernel `step`.
        """

    def refuses(self, law: ContactLaw) -> str | None:  # noqa: ARG002
        """Return why `law` makes no sense with this integrator, or None."""
        return None


def end_of_step(dt: float) -> Judged:
    """Return how the end of a leap-frog step answers a multiplier; the same for every leap-frog scheme."""
    return Judged("predicted", "predicted", "bulk", (dt * dt, dt, 1.0))


# ------------------------------------------------------------------------------------------------- contacts


@dataclass(frozen=True)
class ContactPoints:
    """What a contact law may know of its points; every array is read-only with one value a point.

    Attributes
    ----------
    names : tuple of str
        The contact of each point, as the case names it.
    stiffness : (P,) array
        EA/h of the softer of the two sides [force/length].
    frequency : (P,) array
        Smaller 2c/h of the two sides [1/time].
    mass : (P,) array
        Half the mass of the end element, rho A h / 2, of the softer side [mass].
    equal_sides : (P,) bool array
        Whether both sides have the same EA/h and 2c/h; true at a rigid wall.
    delassus : (P,) array
        s, the point's own entry of S = N^T M^-1 N [1/mass]: the largest of the run, where a support or a drive holds
        an end for a part of it.
    coupling : (P,) array
        Sum of the absolute entries of the point's row of S over s: 1 for a point that shares no end with another [1].
    weight : (P,) array
        Share of the contact surface that belongs to the point; 1 for a bar's end.
    limits
        Function that computes `stiffness_limit`, which few laws ask for.
    """

    names: tuple[str, ...]
    stiffness: Floats
    frequency: Floats
    mass: Floats
    equal_sides: NDArray[np.bool_]
    delassus: Floats
    coupling: Floats
    weight: Floats
    limits: Callable[[], Floats] = field(repr=False, compare=False)

    @cached_property
    def stiffness_limit(self) -> Floats:
        """Contact stiffness up to which the closed step of central difference is stable, (P,) [force/length].

        It is so whichever contacts are closed, as long as none is stiffer than its own limit, and for the step that the
        points were made for; above 0.99 of the Courant limit of a body for that of 0.99.
        """
        return self.limits()


class Rows(NamedTuple):
    """A contact law as a line in (multiplier, gap, rate, acceleration), one a point.

    The framework solves ``(diag(sigma) + diag(w) S) lambda = gamma`` over all active points of a step, where w is
    (gap, rate, acceleration) times the integrator's answer, and gamma minus (gap, rate, acceleration) times the
    judged state.

    Attributes
    ----------
    at
        ``"explicit"`` or ``"end"`` of the step.
    sigma : float or (P,) array
        Compliance [length/force]: 1/stiffness for a penalty, 0 for an exact constraint.
    gap, rate, acceleration : float or (P,) array
        Weights [1, time, time^2].
    active
        ``"gap < 0"`` or ``"all"``.
    sign
        ``"free"``: an equation; ``">= 0"``: complementarity, the contact never pulls.
    during : (K, 2) array or None
        Intervals of time (start, stop) in which the law acts: it does so in each step whose middle lies in one of
        them. None: always.
    """

    at: Literal["explicit", "end"]
    sigma: Floats | float
    gap: Floats | float = 1.0
    rate: Floats | float = 0.0
    acceleration: Floats | float = 0.0
    active: Literal["gap < 0", "all"] = "gap < 0"
    sign: Literal["free", ">= 0"] = "free"
    during: Floats | None = None


class Trial(NamedTuple):
    """What the kernel of a law that is not rows sees of its points in one step; (P,) arrays, read-only.

    It is the same with every leap-frog integrator: two of them differ in what they show to rows alone. `gap` is that
    of the displacement the forces of the step are evaluated at (u_{n+1} of papers that update it before the balance is
    solved), `predicted_gap` where the bodies would be a step later without contact. Gaps of bodies that touch are
    round-off about zero: ``gap <= 0`` hangs on it, ``gap < 0`` less so.

    With an integrator of `Stages` it is called in every stage, and sees there g(u) and N^T v, and predicted the state
    that the integrator's `end` says; where that is empty, ``g + dt g' + dt^2 g''`` and ``g' + dt g''`` with the bulk
    acceleration g''.

    Attributes
    ----------
    gap, predicted_gap
        g(u_n), and the gap after the bulk update.
    rate, predicted_rate
        Gap rate at n - 1/2, and after the bulk update at n + 1/2.
    delassus
        s of each point [1/mass].
    dt, time
        Step, and t_n or the time of the stage.
    gap_answer, rate_answer
        What a multiplier of 1/s adds to the predicted gap and to the predicted rate: dt^2 and dt of a leap-frog step.
    first_neighbour, neighbour, coupling
        The entries of S off its diagonal, between points of this law that share an end: those of point p are
        ``coupling[k]`` [1/mass] with the point ``neighbour[k]``, for k from ``first_neighbour[p]`` up to, not
        including, ``first_neighbour[p + 1]``; integer arrays (P + 1,) and (K,), and (K,) floats. There are none for a
        law that does not declare `ContactLaw.uses_coupling`.
    pushed_by_others
        The gap acceleration that the contacts of other laws at the same ends bring in this step, as far as their
        forces are found: the kernel is called again until all of them fit together. Zero for a law that does not
        declare `ContactLaw.uses_coupling`.
    """

    gap: Floats
    predicted_gap: Floats
    rate: Floats
    predicted_rate: Floats
    delassus: Floats
    dt: float
    time: float
    gap_answer: float
    rate_answer: float
    first_neighbour: Integers
    neighbour: Integers
    coupling: Floats
    pushed_by_others: Floats


class ContactLaw(Component, contract="contacts"):
    """A way to enforce contact: rows wherever it can be written so, else a kernel `multipliers`.

    A law whose `bind` returns `Rows` is complete. Any other law returns a NamedTuple of arrays of its own and
    has a static method ``multipliers(bound, trial, multiplier)`` that fills the (P,) array `multiplier`,
    compression positive, from the `Trial`; there is no closed-form stability certificate for it. Before each call
    every multiplier is nan: one that the kernel leaves unset ends the run, with the contact named. What the kernel is
    handed to read cannot be written, and nothing may be kept from one call to the next.

    Where contacts share an end, the force of one changes the motion that the other is judged by. Rows are solved
    together. A kernel sees each point by itself, as if no other force acted in the step, unless it declares
    `uses_coupling`; then `percuss.coupled_gap` and `percuss.coupled_rate` are the predicted gap and rate with what all
    contacts at that end press, and a few sweeps over the points solve them together::

        @staticmethod
        def multipliers(bound, trial, multiplier):  # no overlap at the end of the step
            multiplier[:] = 0.0
            for _ in range(1000):
                moved = 0.0
                for p in range(multiplier.size):
                    before = multiplier[p]
                    gap = coupled_gap(trial, multiplier, p)
                    multiplier[p] = max(before - gap / (trial.gap_answer * trial.delassus[p]), 0.0)
                    moved = max(moved, abs(multiplier[p] - before))
                if moved <= 1e-14 * multiplier.max():
                    break

    Attributes
    ----------
    uses_coupling
        Whether the kernel takes account of other contacts at the same end. Where it does not and contacts share an
        end, `percuss check` and the notes of the run say so.
    measured
        Name of an integrator -> in words what was measured with it where nothing guarantees the energy.
    guarantees
        What holds whatever the options and the integrator: ``"never pulls"``, ``"no penetration"`` (at the end of
        each step), ``"keeps the free step"``; the conformance kit holds it against drawn runs.
    needs_only_response_of
        Quantities of the row (so far ``"acceleration"`` alone can be missing) -> why the law is still itself with an
        integrator that does not show their bulk value (`Judged.acceleration` is ``"none"``), so that the weight acts on
        what the multiplier itself adds to them and on nothing else. A penalty mass is such a weight: Wu's
        predictor-corrector lets it resist the corrector's acceleration alone. A law that reads the bulk acceleration,
        as Nitsche's method reads the normal stress of the bodies from it, is not, and would silently become another
        method. A pair whose row has a weight that is neither shown nor named here is refused.
    """

    uses_coupling: ClassVar[bool] = False
    measured: ClassVar[Mapping[str, str]] = {}
    guarantees: ClassVar[tuple[str, ...]] = ()
    needs_only_response_of: ClassVar[Mapping[str, str]] = {}

    @abstractmethod
    def bind(self, points: ContactPoints, dt: float) -> Rows | Any:
        """Return the law's `Rows` at `points` for the step `dt`, or the bound arrays of its `multipliers`."""

    def resolved(self, points: ContactPoints, dt: float) -> Mapping[str, Any]:  # noqa: ARG002
        """Return the parameters as they came out at `points` for the step `dt`; they go into the provenance."""
        return {}

    def chosen(self, points: ContactPoints, dt: float) -> Mapping[str, str]:  # noqa: ARG002
        """Return, for each option the law sets by itself at `points` for the step `dt`, what it came to and why."""
        return {}

    def refuses(self, integrator: Integrator) -> str | None:  # noqa: ARG002
        """Return why `integrator` makes no sense with this law, or None."""
        return None


# ---------------------------------------------------------------------------------------------------- loads


class Load(Component, contract="loads"):
    """An amplitude over time. Where it acts, when, along what and as what quantity, the case says.

    Attributes
    ----------
    acts_as
        What the amplitude is unless the case says otherwise (`as`).
    everywhere
        Whether it acts on all bodies unless the case says where (`on`).
    """

    acts_as: ClassVar[Literal["force", "acceleration", "velocity"]] = "force"
    everywhere: ClassVar[bool] = False

    @abstractmethod
    def amplitude(self, time: Floats) -> Floats:
        """Return the amplitude at each `time`, which counts from the moment the load is switched on.

        Parameters
        ----------
        time : (T,) array
            Times since the load's `from`, not negative.

        Returns
        -------
        (T,) array
            Amplitude [force, acceleration or velocity, as the case says].
        """

    def kinks(self) -> tuple[float, ...] | None:
        """Return the times, from its start, at which the amplitude is not smooth; None where that is not known.

        A load that says so can be part of an exact solution.
        """
        return None

    def vector(self) -> tuple[float, ...] | None:
        """Return the direction the load itself gives, or None where the case or the body gives it."""
        return None


# ----------------------------------------------------------------------------------- shapes and bulk methods


class Region(NamedTuple):
    """A named part of a body's boundary: its nodes, and the unit vector that points out of the body there."""

    nodes: tuple[int, ...]
    outward: Floats


class Mesh(NamedTuple):
    """A body's line mesh: element i joins nodes i and i + 1.

    Attributes
    ----------
    nodes : (n + 1, dim) array
        Positions [length].
    lengths : (n,) array
        Element lengths [length].
    direction : (dim,) array
        Unit vector along the line.
    regions
        Named ends; ``BODY.REGION`` is the only address there is.
    """

    nodes: Floats
    lengths: Floats
    direction: Floats
    regions: Mapping[str, Region]


class Shape(Component, contract="shapes"):
    """The geometry of a body; its name is the key in the body's mapping."""

    regions: ClassVar[tuple[str, ...]]

    @abstractmethod
    def dimension(self) -> int | None:
        """Return the number of dimensions the options imply, or None where any will do."""

    @abstractmethod
    def mesh(self, at: Floats, refine: int) -> Mesh:
        """Return the mesh of the body whose start is `at`, with `refine` times the elements asked for.

        Parameters
        ----------
        at : (dim,) array
            Start of the body [length].
        refine
            Factor on the number of elements.
        """


class Material(Component, contract="materials"):
    """A one-dimensional material: stress from strain.

    The kernel ``stress(parameters, strain)`` gets the (k,) array that `parameters` returned and a float, and
    returns a float. ``energy_density(parameters, before, after)`` is the staggered strain energy per volume of the
    strains at t_n and t_n+1; for a linear material half the product of the one's stress and the other's strain.

    Attributes
    ----------
    linear
        Whether the stress is `modulus` times the strain, whatever the strain. A body is linear if its element and its
        material both say so. Exact solutions, certificates, the guarantees of energy and the energy identity to
        round-off are for linear bodies; of any other body percuss says that it does not know. The conformance kit
        holds the declaration against the kernels.
    """

    linear: ClassVar[bool] = False

    @property
    @abstractmethod
    def rho(self) -> float:
        """Density [mass/length^3]."""

    @property
    @abstractmethod
    def modulus(self) -> float:
        """Largest tangent modulus, from which wave speed, step and penalty scales follow [force/length^2]."""

    @abstractmethod
    def parameters(self) -> tuple[float, ...]:
        """Return what the kernels need, as plain numbers."""

    @staticmethod
    @abstractmethod
    def stress(parameters: Floats, strain: float) -> float:
        """Return the stress at `strain` [force/length^2]; a kernel."""

    @staticmethod
    @abstractmethod
    def energy_density(parameters: Floats, before: float, after: float) -> float:
        """Return the staggered strain-energy density of two consecutive strains [energy/length^3]; a kernel."""


@dataclass(frozen=True)
class BodyMesh:
    """What an element may know of the body it fills.

    Attributes
    ----------
    mesh : Mesh
        Nodes, element lengths and direction.
    area : float
        Cross-section [length^2].
    """

    mesh: Mesh
    area: float


class Element(Component, contract="elements"):
    """A two-node line element.

    Both kernels work on a run of consecutive elements, of which `first` is the number of the first in the bound
    arrays; displacement, velocity and force are flat, node by node, `dim` components each.

    ``internal_force(element, parameters, first, dim, displacement, force)`` *sets* `force` to what the stretched
    elements do to their nodes. ``energy(element, parameters, first, dim, displacement, velocity, dt)`` returns their
    staggered strain energy, where `displacement` is at n + 1 and ``displacement - dt * velocity`` at n. They call the
    material by the slots `percuss.stress` and `percuss.energy_density`, with the strain of the element's own measure.

    The stress that a result shows of an element is what `stress` returned when `internal_force` was asked for the force
    of that element alone, the mean over its calls: whatever the strain measure, it is that of the force.

    Attributes
    ----------
    linear
        Whether the strain that is handed to the material, and the direction of the force, are linear in the
        displacement: the force is then proportional to the displacement wherever the material is linear too. A body is
        linear if its element and its material both say so (see `Material`). The conformance kit holds the declaration
        against the kernels.
    """

    linear: ClassVar[bool] = False

    @abstractmethod
    def bind(self, body: BodyMesh) -> Any:
        """Return a NamedTuple of (elements, ...) float arrays for one body."""

    @abstractmethod
    def axial_stiffness(self, body: BodyMesh, modulus: float) -> Floats:
        """Return the stiffness of each element along the line, (elements,) [force/length]."""

    @abstractmethod
    def highest_frequency(self, body: BodyMesh, wave_speed: float) -> Floats:
        """Return an upper bound of each element's own angular frequency with lumped mass, (elements,) [1/time]."""

    @staticmethod
    @abstractmethod
    def internal_force(
        element: Any, parameters: Floats, first: int, dim: int, displacement: Floats, force: Floats
    ) -> None:
        """Set `force` to the internal force of the elements on their nodes; a kernel."""

    @staticmethod
    @abstractmethod
    def energy(
        element: Any,
        parameters: Floats,
        first: int,
        dim: int,
        displacement: Floats,
        velocity: Floats,
        dt: float,
    ) -> float:
        """Return the staggered strain energy of the elements; a kernel."""


class Mass(Component, contract="masses"):
    """How element masses become nodal masses; always diagonal."""

    @abstractmethod
    def nodal(self, element_mass: Floats) -> Floats:
        """Return the (n + 1,) nodal masses of a line of (n,) element masses [mass]."""


# ------------------------------------------------------------------------------------------ exact solutions


class ExactContact(ABC):
    """The exact history of one contact; times are (T,) arrays or numbers."""

    @abstractmethod
    def force(self, time: Floats) -> Floats:
        """Return the contact force, compression positive [force]."""

    @abstractmethod
    def impulse(self, time: Floats) -> Floats:
        """Return the impulse of the contact force from 0 to `time`; 0 before [force time]."""

    @abstractmethod
    def gap(self, time: Floats) -> Floats:
        """Return the gap, open positive [length]."""

    @property
    @abstractmethod
    def closed(self) -> tuple[tuple[float, float], ...]:
        """Intervals (start, stop) in which the contact presses."""

    @abstractmethod
    def largest_force(self, start: float, stop: float) -> float:
        """Return the least upper bound of the force between two times: no sample may exceed it [force]."""

    def mean_force(self, start: Floats, stop: Floats) -> Floats:
        """Return the force averaged from `start` to `stop` [force]; zero force before t = 0."""
        return (self.impulse(stop) - self.impulse(start)) / (np.asarray(stop) - np.asarray(start))


class Exact(ABC):
    """The exact solution of a case, evaluated at any time up to `reached`.

    Attributes
    ----------
    reached
        Time up to which it holds.
    fronts
        How many fronts it took.
    contacts
        `ExactContact` of each contact by name.
    stopped
        Why it holds no farther than `reached`, in words; empty where that is the end asked for.
    """

    reached: float
    fronts: int
    stopped: str = ""
    contacts: Mapping[str, ExactContact]

    @abstractmethod
    def displacement(self, body: str, x: Floats, time: Floats) -> Floats:
        """Return the displacement along the body at distance `x` from its start [length]."""

    @abstractmethod
    def velocity(self, body: str, x: Floats, time: Floats) -> Floats:
        """Return the velocity along the body [length/time]."""

    @abstractmethod
    def stress(self, body: str, x: Floats, time: Floats) -> Floats:
        """Return the stress, tension positive [force/length^2]."""

    @abstractmethod
    def energy(self, time: float) -> tuple[float, float]:
        """Return kinetic and elastic energy."""

    @abstractmethod
    def largest_energy(self) -> float:
        """Return the least upper bound of kinetic and elastic energy together from 0 to `reached` [energy]."""

    @abstractmethod
    def work(self, time: float) -> float:
        """Return the work of loads, supports and drives from 0 to `time` [energy]."""

    @abstractmethod
    def momentum(self, time: float) -> float:
        """Return the momentum along the direction of the first body [mass length/time]."""

    @abstractmethod
    def impulse(self, time: float) -> float:
        """Return the impulse of loads, supports, drives and walls along the same direction [force time]."""


class Solution(Component, contract="solutions"):
    """An exact solution of a class of cases.

    It is handed a `percuss.model.Model`, of which it must not use the mesh beyond the ends of its bodies.

    Attributes
    ----------
    linear_bodies_only
        Whether it holds for linear bodies alone (`Material.linear`, `Element.linear`). It is then not asked about any
        other case: no run with a body that is not linear is held against it.
    """

    linear_bodies_only: ClassVar[bool] = True

    @abstractmethod
    def covers(self, model: Any) -> str | None:
        """Return why the case is not covered, or None where it is."""

    @abstractmethod
    def solve(self, model: Any, end: float) -> Exact:
        """Return the exact solution up to `end`, or up to an earlier time and then why, in `Exact.stopped`."""


class Measure(Component, contract="measures"):
    """A number that a study takes of every run that is done, beside those of its summary and histories.

    Attributes
    ----------
    what
        In words: quantity, norm, averaging; stands beside the column.
    """

    what: ClassVar[str]

    @abstractmethod
    def of(self, result: Any) -> float | None:
        """Return the number of a `percuss.Result`, None where it has none."""


FAMILIES: dict[str, type[Component]] = {
    contract.family: contract
    for contract in (Integrator, ContactLaw, Load, Shape, Element, Material, Mass, Solution, Measure)
}
