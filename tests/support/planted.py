"""Methods that are right, and the same with a mistake of the kind people make, each with the check it must fail."""

from __future__ import annotations

import typing
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from scipy.sparse import diags_array

from percuss import (
    ContactLaw,
    ContactState,
    Doc,
    Gt,
    Integrator,
    LeapFrog,
    LinearLaw,
    Load,
    Stages,
    Unit,
    accelerations,
    coupled_rate,
    end_of_step,
)
from percuss_methods.elements._full_cell import plane_forces
from percuss_methods.elements.bar import BarElement
from percuss_methods.elements.hex8_one_point import Hex8OnePoint
from percuss_methods.elements.quad4 import Quad4
from percuss_methods.elements.quadratic_bar import QuadraticBarElement
from percuss_methods.masses.lumped import Lumped
from percuss_methods.materials.elastic import Elastic
from percuss_methods.measures.ripple import Ripple
from percuss_methods.pairings.mortar import Mortar
from percuss_methods.pairings.node_to_segment import NodeToSegment
from percuss_methods.shapes.bar import Bar
from percuss_methods.shapes.block import Block
from percuss_methods.solutions.bars_in_a_row import BarsInARow

RIGHT = []
WRONG = []  # (class, check, words of what it must say)


def right(cls):
    RIGHT.append(cls)
    return cls


def plant(name, check, said, like, **wrong):
    """Plant a method like another one but for some of its attributes."""
    kept = {key: value for key, value in vars(like).items() if key[:2] != "__" and key[:4] != "_abc"}
    about = {"__doc__": like.__doc__, "__module__": __name__, "__qualname__": f"planted_{name.replace('-', '_')}"}
    about |= {key: vars(like)[key] for key in ("__post_init__",) if key in vars(like)}
    hints = typing.get_type_hints(like, include_extras=True)
    about["__annotations__"] = {key: hints[key] for key in getattr(like, "__dataclass_fields__", {})}
    body = {**kept, **about, "name": name, **wrong}
    cls = dataclass(frozen=True)(type(about["__qualname__"], like.__bases__, body))
    globals()[cls.__name__] = cls  # where pickle finds it
    WRONG.append((cls, check, said))


Stiffness = Annotated[float, Gt(0), Unit("1"), Doc("stiffness over EA/h")]


class Stiff(NamedTuple):
    k: np.ndarray


# ------------------------------------------------------------------------------------------------- linear laws


@right
@dataclass(frozen=True)
class Spring(ContactLaw):
    """A spring.

    Formula: ``lambda = beta_s (EA/h) <-g>``.
    """

    name = "spring"
    summary = "A spring"
    references = ("nobody, nowhere",)
    expected_failures = {"energy-never-grows with central-difference": "a contact opens or closes between two steps"}

    beta_s: Stiffness = 0.25

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0 / (self.beta_s * points.stiffness))


def law(name, check, said="", bind=Spring.bind, **wrong):
    plant(name, check, said, Spring, bind=bind, **wrong)


def soft(points, **more):
    return LinearLaw(at="explicit", sigma=4.0 / points.stiffness, **more)


law("misspelled", "starts", "Did you mean 'stiffness'?", lambda self, points, dt: soft(points, gap=points.stifness))
law("no-formula", "well-formed", "formula: no paragraph", __doc__="A spring.")
law("declared-but-passes", "units", "but it passes: delete the entry", expected_failures={"units": "it was so once"})
law("one-for-all", "any-number-of-contacts", "alone", lambda self, points, dt: soft(points, gap=points.mass[:1].sum()))
law(
    "wrong-sign", "pushes-apart", "the wall does not push the bar back", lambda self, points, dt: soft(points, gap=-1.0)
)
law("at-a-distance", "no-contact", "bodies that never meet", lambda self, points, dt: soft(points, active="all"))
law("says-too-much", "guarantees", "bodies overlap", guarantees=("no penetration",))


@dataclass(frozen=True)
class Given(ContactLaw):
    """A spring of a given stiffness.

    Formula: ``lambda = epsilon_s <-g>``.
    """

    name = "given"
    summary = "A spring"
    references = ("nobody, nowhere",)
    epsilon_s: Annotated[float, Gt(0), Unit("force/length"), Doc("stiffness")] = 500.0

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=np.full(points.weight.size, 1.0 / self.epsilon_s))


def option(name, check, said, annotation):
    plant(name, check, said, Given, __annotations__={"epsilon_s": annotation})


plant("forgets-the-area", "areas", "the area press otherwise", Given)
option("no-bound", "options-bounded", "`epsilon_s`", Annotated[float, Unit("force/length"), Doc("stiffness")])
option("wrong-unit", "units", "a change of units", Annotated[float, Gt(0), Unit("1"), Doc("stiffness")])


# ------------------------------------------------------------------------------- laws with a kernel of their own


@right
@dataclass(frozen=True)
class Rigid(ContactLaw):
    """Exact contact at the end of the step, one point at a time.

    Formula: ``lambda = <-g*> / (dt^2 s)``, g* the gap after the bulk update.
    """

    name = "rigid"
    summary = "Exact contact, one point at a time"
    references = ("nobody, nowhere",)
    guarantees = ("never pulls",)

    def bind(self, points, dt):
        return Stiff(0.25 * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        for p in range(multiplier.size):
            multiplier[p] = max(-trial.predicted_gap[p], 0.0) / (trial.gap_response * trial.delassus[p])


def kernel(check, said="", like=Rigid, **wrong):
    """Plant a law of the kernel below, of its name."""

    def keep(function):
        plant(function.__name__.replace("_", "-"), check, said, like, multipliers=staticmethod(function), **wrong)
        return function

    return keep


@kernel("exact-impact with central-difference", "the impulse does not tend to the exact one")
def no_step(bound, trial, multiplier):
    for p in range(multiplier.size):
        multiplier[p] = max(-trial.predicted_gap[p], 0.0) / (trial.rate_response * trial.delassus[p])


@kernel("energy-never-grows with wu-predictor-corrector", "energy grows by")
def stale_gap(bound, trial, multiplier):
    for p in range(multiplier.size):
        multiplier[p] = max(-trial.gap[p], 0.0) / (trial.gap_response * trial.delassus[p])


@kernel("any-number-of-contacts", "unset: every branch of its kernel has to set every multiplier")
def leaves_unset(bound, trial, multiplier):
    for p in range(multiplier.size):
        if trial.predicted_gap[p] >= 0.0:
            multiplier[p] = 0.0
        elif trial.rate[p] < 0.0:
            multiplier[p] = -trial.predicted_gap[p] / (trial.gap_response * trial.delassus[p])


@kernel("no-hidden-state", "the second time")
def dice(bound, trial, multiplier):
    for p in range(multiplier.size):
        overlap = max(-trial.predicted_gap[p], 0.0) * (1.0 + 1e-12 * np.random.rand())  # noqa: NPY002  what numba knows
        multiplier[p] = overlap / (trial.gap_response * trial.delassus[p])


@kernel("compiled-and-plain", "plain Python")
def overflowing(bound, trial, multiplier):
    for p in range(multiplier.size):
        large = int(2.0**40 + trial.dt)
        share = 1.0 if large * large % 7 else 0.9
        multiplier[p] = share * max(-trial.predicted_gap[p], 0.0) / (trial.gap_response * trial.delassus[p])


@kernel("stored-and-dissipated", "neither stored", state=2, stored_in=0, dissipated_in=1)
def forgets_its_dashpot(bound, trial, multiplier):
    for p in range(multiplier.size):
        overlap = max(-trial.gap[p], 0.0)
        multiplier[p] = max(bound.k[p] * (overlap - 1e-3 * trial.rate[p]), 0.0) if overlap > 0.0 else 0.0
        trial.after[p, 0] = 0.5 * bound.k[p] * overlap**2


@right
@dataclass(frozen=True)
class Impulsive(ContactLaw):
    """Impulses at the velocity level, of all contacts at an end together.

    Formula: where ``g* <= 0``: ``0 <= lambda, g' + e g'_before >= 0``, one of them zero; else ``lambda = 0``.
    """

    name = "impulsive"
    summary = "Impulses of all contacts at an end together"
    references = ("Jean: The non-smooth contact dynamics method, CMAME 177 (1999)",)
    guarantees = ("never pulls",)
    uses_coupling = True
    expected_failures = dict.fromkeys(
        ("energy-never-grows with central-difference", "energy-never-grows with wu-predictor-corrector"),
        "an impulse that stops the rate also moves the end of the step",
    )

    def bind(self, points, dt):
        return Stiff(np.zeros(1))

    @staticmethod
    def multipliers(bound, trial, multiplier):
        multiplier[:] = 0.0
        for _ in range(1000):
            moved, largest = 0.0, 0.0
            for p in range(multiplier.size):
                if trial.predicted_gap[p] <= 0.0:
                    before = multiplier[p]
                    rate = coupled_rate(trial, multiplier, p)
                    multiplier[p] = max(before - rate / (trial.rate_response * trial.delassus[p]), 0.0)
                    moved, largest = max(moved, abs(multiplier[p] - before)), max(largest, multiplier[p])
            if moved <= 1e-14 * largest:
                break


@kernel("coupling", "the order of contacts at one end", Impulsive)
def sweeps_once(bound, trial, multiplier):
    multiplier[:] = 0.0
    for p in range(multiplier.size):
        if trial.predicted_gap[p] <= 0.0:
            rate = coupled_rate(trial, multiplier, p)
            multiplier[p] = max(-rate / (trial.rate_response * trial.delassus[p]), 0.0)


# -------------------------------------------------------------------------------------------------- integrators


def explicit(dt):
    return LeapFrog(ContactState("predicted", "predicted", "none", (0.0, 0.0, 1.0)), end_of_step(dt))


@right
@dataclass(frozen=True)
class Predicting(Integrator):
    """Contact judged at the predicted state.

    Formula: ``v = v* + dt M^-1 N lambda(u*)``.
    """

    name = "predicting"
    summary = "Contact judged at the predicted state"
    references = ("nobody, nowhere",)
    order = 2
    conserves = ("energy", "momentum")
    critical_courant = 1.0

    def bind(self, dt):
        return explicit(dt)


@right
@dataclass(frozen=True)
class Verlet(Integrator):
    """Velocity Verlet.

    Formula: ``w = v + dt/2 a_n``, ``u += dt w``, ``v = w + dt/2 a_{n+1}``.
    """

    name = "verlet"
    summary = "Verlet"
    references = ("Swope and others (1982)",)
    order = 2
    conserves = ("momentum",)
    kept = 1
    expected_failures = {"energy-never-grows": "at the ends of steps it is not quite the energy that is kept"}

    def bind(self, dt):
        return stages(dt)

    @staticmethod
    def step(numbers, system, u, v, kept, dt):
        v += 0.5 * dt * kept[0]
        u += dt * v
        accelerations(system, 0, u, v, kept[0])
        v += 0.5 * dt * kept[0]


def stages(dt, time=1.0):
    """Return what the stage of velocity Verlet says of itself."""
    return Stages(times=(time,), end=((dt, dt * dt, dt),), start=(dt, 0.5 * dt * dt, 0.5 * dt))


def scheme(name, check, said="", like=Predicting, **wrong):
    plant(name, check, said, like, **wrong)


scheme("order-claimed", "order", "it declares order 4", order=4)
scheme("energy-claimed", "conserves", "it changes by", Verlet, conserves=("energy",))
scheme("stable-claimed", "critical-courant", "grows", critical_courant=2.0)
scheme("loads-at-the-begin", "stages", "`times` puts stage 0 at 0", Verlet, bind=lambda self, dt: stages(dt, 0.0))


@dataclass(frozen=True)
class Viscous(Integrator):
    """Central difference with viscosity, of a limit below one half.

    Formula: ``v_{n+1/2} = v_{n-1/2} - dt M^-1 K (u_n + 2.5 dt v_{n-1/2})``.
    """

    name = "viscous"
    summary = "Central difference with much viscosity"
    references = ("nobody, nowhere",)
    order = 1
    conserves = ("momentum",)
    critical_courant = 6.0**-0.5

    def bind(self, dt):
        return LeapFrog(ContactState("current", "current", "bulk", (0.0, 0.0, 1.0)), end_of_step(dt), viscosity=2.5)


# -------------------------------------------------------------------------------------------------------- loads


@right
@dataclass(frozen=True)
class Triangle(Load):
    """A triangle.

    Formula: ``A(t) = peak (1 - |2 t / duration - 1|)`` up to `duration`, zero after it.
    """

    name = "triangle"
    summary = "A triangle"
    examples = ({"peak": 2.0, "duration": 0.1},)
    peak: Annotated[float, Unit("amplitude"), Doc("largest value")]
    duration: Annotated[float, Gt(0), Unit("time"), Doc("length")]

    def amplitude(self, time):
        return self.peak * np.maximum(1.0 - np.abs(2.0 * time / self.duration - 1.0), 0.0)

    def kinks(self):
        return (0.5 * self.duration, self.duration)


plant("smooth-claimed", "kinks", "has a kink near time 0.0", Triangle, kinks=lambda self: (self.duration,))
plant(
    "looks-at-neighbours", "amplitude", "depends on the other times", Triangle,
    amplitude=lambda self, time: time / (time.max(initial=0.0) or 1.0),
)  # fmt: skip


# ------------------------------------------------------------------------------------------------ masses, shapes


def lumped(element_mass, lumping, factors=1.0):
    return lumping.at_nodes(element_mass) * factors


def coupled(element_mass, lumping, taken):
    """Return an inverse that couples the nodes beside each element: a body that moves as a whole does not show it."""
    masses = lumped(element_mass, lumping)
    diagonal = (masses - np.append(taken, 0.0) - np.append(0.0, taken)) / masses**2
    beside = taken / (masses[:-1] * masses[1:])
    return diags_array([beside, diagonal, beside], offsets=[-1, 0, 1])


def one_sided_inverse(self, element_mass, lumping):
    """Couple the nodes the more the farther along."""
    return coupled(element_mass, lumping, np.linspace(0.05, 0.1, element_mass.size) * element_mass)


plant("heavy", "total-mass", "have the mass", Lumped, nodal=lambda self, *given: 1.5 * lumped(*given))
plant("one-sided-inverse", "inverse-mass", "counted from the other end", Lumped, inverse=one_sided_inverse)
plant("at-the-origin", "mesh", "does not start", Bar, mesh=lambda self, at, refine: Bar.mesh(self, 0.0 * at, refine))


# ------------------------------------------------------------------------------------- materials and elements


def twice_the_energy(parameters, before, after):
    return parameters[0] * before * after


def curved(parameters, strain):
    return parameters[0] * strain * (1.0 - 3.0 * abs(strain))


def material(name, check, said, **wrong):
    kernels = {key: staticmethod(value) for key, value in wrong.items() if key in KERNELS}
    examples = ({"young": 1.0, "density": 1.0, "poisson": 0.3},)
    plant(name, check, said, Elastic, **{"examples": examples, **wrong, **kernels})


KERNELS = ("stress", "energy_density", "stress_2d")
material("twice-the-energy", "stress-and-energy", "the slope of the energy", energy_density=twice_the_energy)
material("curved", "linear", "not proportional", stress=curved)


def holds_its_direction(parameters, gradient):
    xx, xy, yx, yy = gradient
    mean, shear, spin = parameters[0] * (xx + yy), parameters[1] * (xy + yx), 0.5 * parameters[1] * (xy - yx)
    return mean + 2.0 * parameters[1] * xx, shear + spin, shear - spin, mean + 2.0 * parameters[1] * yy


material("holds-its-direction", "solid-stress", "does not turn with the body", stress_2d=holds_its_direction)

bar_force = BarElement.internal_force


def one_sided(element, material, first, dim, displacement, force):
    bar_force(element, material, first, dim, displacement, force)
    force[0] *= 0.9


def element(name, check, said, like=BarElement, **wrong):
    kernels = {
        key: staticmethod(value) if key in {"force", "internal_force"} else value for key, value in wrong.items()
    }
    plant(name, check, said, like, **kernels)


element("one-sided", "force-and-energy", "minus the slope of the energy", internal_force=one_sided)
element("unbalanced", "balances", "the balance of", internal_force=one_sided)
element(
    "too-slow",
    "frequency",
    "it gives the frequency",
    highest_frequency=lambda self, body, speed: speed / body.mesh.lengths,
)
element(
    "wrong-volume", "cells", "do not add up to its volume", QuadraticBarElement,
    volumes=lambda self, body: 0.5 * QuadraticBarElement.volumes(self, body),
)  # fmt: skip


def half_across(rule, material, first, section, geometry, displacement, force):
    plane_forces(rule, material, first, section, geometry, displacement, force)
    for a in range(force.shape[0]):
        force[a, 1] *= 0.5


def mean_volumes(self, body):
    geometry = Quad4.geometry(self, body)
    geometry[..., -1] = geometry[..., -1].mean(axis=1, keepdims=True)
    return geometry


element("half-across", "solid-forces", "minus the slope of the energy", Quad4, force=half_across)
element("gains-energy", "blocks", "the balance of energy is open", Quad4, force=half_across)
element(
    "mean-volumes", "solid-forces", "it fails the patch test", Quad4,
    geometry=mean_volumes, volumes=lambda self, body: mean_volumes(self, body)[..., -1],
)  # fmt: skip
element("turns-wrongly", "finite-rotation", "the forces do not turn", Hex8OnePoint, expected_failures={})
element(
    "twice-the-mass", "solid-masses", "of a body of", Quad4,
    volumes_of_cells=lambda self, body: 2.0 * Quad4.volumes(self, body).sum(axis=1),
)  # fmt: skip


# ------------------------------------------------------------------------------------------------------ blocks


def top(mesh, choose):
    """Return a mesh with other facets at the top."""
    region = mesh.regions["top"]
    other = region._replace(facets={"line": choose(region.facets["line"])})
    return mesh._replace(regions={**mesh.regions, "top": other})


def inwards(self, at, refine):
    return top(Block.mesh(self, at, refine), lambda line: line[:, ::-1])


plant("turned-inwards", "mesh", "do not enclose its volume", Block, examples=Block.examples[:1], mesh=inwards)


# ---------------------------------------------------------------------------------------------------- pairings


def pairing(check, said, like=NodeToSegment, **wrong):
    """Plant a pairing whose points are those of the function below, of its name."""

    def keep(points):
        plant(
            points.__name__.replace("_", "-"), check, said, like,
            points=lambda self, first, second: points(first, second), **wrong,
        )  # fmt: skip
        return points

    return keep


def nodes_of(first, second):
    return NodeToSegment().points(first, second)


plant("promises-too-much", "patch-test", "pressures at nodes are wrong by", NodeToSegment, passes_patch_test=True)
plant("shy", "shares", "has the share -0.", Mortar, convex=True, passes_patch_test=False, dimensions=(2,))


@pairing("pairing", "in all, not 0.8")
def half_of_the_area(first, second):
    found = nodes_of(first, second)
    return found._replace(weight=0.5 * found.weight)


@pairing("pairing", "does not change by the distance")
def pulls_one_side(first, second):
    found = nodes_of(first, second)
    return found._replace(value=np.where(np.isin(found.node, first.nodes)[:, None], found.value, 0.5 * found.value))


# ------------------------------------------------------------------------------------------ solutions, measures


def solved(change):
    def solve(self, problem, end):
        found = BarsInARow.solve(self, problem, end)
        for contact in found.contacts.values():
            change(contact)
        return found

    return solve


def sticks(contact, less=1e-3):
    force = contact.force
    object.__setattr__(contact, "force", lambda t: force(t) - less)


plant("sticky", "exact-solution", "pulls with", BarsInARow, solve=solved(sticks))
plant("not-a-number", "measure", "inf", Ripple, of=lambda self, result: float(np.float64("inf")))
