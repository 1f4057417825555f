"""Registered methods with a mistake of the kind people make, each with the check it must fail."""

from __future__ import annotations

import typing
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from percuss import ContactLaw, Doc, Gt, LinearLaw, Places, Unit, coupled_rate, stress_2d, stress_3d
from percuss_methods.contacts.penalty import Penalty
from percuss_methods.contacts.uzawa import Uzawa
from percuss_methods.elements._full_cell import plane_forces, ring_forces
from percuss_methods.elements._one_point import plane_forces as one_point_forces
from percuss_methods.elements.bar import BarElement
from percuss_methods.elements.quad4 import Quad4
from percuss_methods.elements.quad4_axisymmetric import Quad4Axisymmetric
from percuss_methods.elements.quad4_mean import Quad4Mean
from percuss_methods.elements.quad4_one_point import Quad4OnePoint
from percuss_methods.elements.quadratic_bar import QuadraticBarElement
from percuss_methods.frictions.coulomb import Coulomb
from percuss_methods.integrators.velocity_verlet import VelocityVerlet
from percuss_methods.integrators.wu_predictor_corrector import WuPredictorCorrector
from percuss_methods.loads.ramp import Ramp
from percuss_methods.masses.lumped import Lumped
from percuss_methods.materials.elastic import Elastic
from percuss_methods.materials.j2_plastic import J2Plastic
from percuss_methods.materials.neo_hookean import NeoHookean
from percuss_methods.measures.ripple import Ripple
from percuss_methods.pairings._closest import paired
from percuss_methods.pairings.mortar import Mortar
from percuss_methods.pairings.node_to_segment import NodeToSegment
from percuss_methods.shapes.bar import Bar
from percuss_methods.shapes.block import Block
from percuss_methods.solutions.bars_in_a_row import BarsInARow

KERNELS = {"bound", "multipliers", "stress", "energy_density", "stress_2d", "stress_3d", "internal_force", "force"}
WRONG = []  # (class, check, words of what it must say)


def plant(name, check, said, like, **wrong):
    """Plant a method like another one but for some of its attributes."""
    kept = {key: value for key, value in vars(like).items() if key[:2] != "__" and key[:4] != "_abc"}
    about = {"__doc__": like.__doc__, "__module__": __name__, "__qualname__": f"planted_{name.replace('-', '_')}"}
    about |= {key: vars(like)[key] for key in ("__post_init__",) if key in vars(like)}
    hints = typing.get_type_hints(like, include_extras=True)
    about["__annotations__"] = {key: hints[key] for key in getattr(like, "__dataclass_fields__", {})}
    wrong = {key: staticmethod(value) if key in KERNELS else value for key, value in wrong.items()}
    body = {**kept, **about, "name": name, **wrong}
    cls = dataclass(frozen=True)(type(about["__qualname__"], like.__bases__, body))
    globals()[cls.__name__] = cls  # where pickle finds it
    WRONG.append((cls, check, said))


# ------------------------------------------------------------------------------------------------- linear laws


def law(name, check, said, bind=Penalty.bind, **wrong):
    """Plant a penalty with its default stiffness."""
    plant(name, check, said, Penalty, **{"bind": bind, "examples": ({},), **wrong})


def soft(points, **more):
    return LinearLaw(at="explicit", sigma=4.0 / points.stiffness, **more)


law("misspelled", "starts", "Did you mean 'stiffness'?", lambda self, points, dt: soft(points, gap=points.stifness))
law("no-formula", "well-formed", "formula: no paragraph", __doc__="A spring.")
law("declared-but-passes", "units", "but it passes: delete the entry", expected_failures={"units": "it was so once"})
law("one-for-all", "any-number-of-contacts", "alone", lambda self, points, dt: soft(points, gap=points.mass[:1].sum()))
law("wrong-sign", "pushes-apart", "the wall does not push", lambda self, points, dt: soft(points, gap=-1.0))
law("at-a-distance", "no-contact", "bodies that never meet", lambda self, points, dt: soft(points, active="all"))
law("says-too-much", "guarantees", "bodies overlap", guarantees=("no penetration",))


def same_for_all(self, points, dt):
    return LinearLaw(at="explicit", sigma=np.full(points.weight.size, 1.0 / self.epsilon_s))


def given(name, check, said, **wrong):
    """Plant a spring of a given stiffness."""
    plant(name, check, said, Penalty, examples=({"epsilon_s": 500.0},), bind=same_for_all, resolved=ContactLaw.resolved,
          chosen=ContactLaw.chosen, **wrong)  # fmt: skip


def option(*about):
    hints = typing.get_type_hints(Penalty, include_extras=True)
    return {**hints, "epsilon_s": Annotated[float, Doc("stiffness"), *about]}


given("forgets-the-area", "areas", "the area press otherwise")
given("no-bound", "options-bounded", "`epsilon_s`", __annotations__=option(Unit("force/length")))
given("wrong-unit", "units", "a change of units", __annotations__=option(Gt(0), Unit("1")))


# ------------------------------------------------------------------------------- laws with a kernel of their own


def kernel(check, said, **wrong):
    """Plant a law of the kernel below, of its name."""

    def keep(function):
        name, facts = function.__name__.replace("_", "-"), {"uses_coupling": False, **wrong}
        plant(name, check, said, Uzawa, multipliers=function, **facts)
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
        multiplier[p] = max(bound.stiffness[p] * (overlap - 1e-3 * trial.rate[p]), 0.0) if overlap > 0.0 else 0.0
        trial.after[p, 0] = 0.5 * bound.stiffness[p] * overlap**2


@kernel("coupling", "the order of contacts at one end", uses_coupling=True)
def sweeps_once(bound, trial, multiplier):
    multiplier[:] = 0.0
    for p in range(multiplier.size):
        if trial.predicted_gap[p] <= 0.0:
            rate = coupled_rate(trial, multiplier, p)
            multiplier[p] = max(-rate / (trial.rate_response * trial.delassus[p]), 0.0)


# -------------------------------------------------------------------------------------------------- integrators


def loads_at_the_begin(self, dt):
    return VelocityVerlet.bind(self, dt)._replace(times=(0.0,))


plant("order-claimed", "order", "it declares order 4", WuPredictorCorrector, order=4)
plant("energy-claimed", "conserves", "it changes by", VelocityVerlet, conserves=("energy",))
plant("stable-claimed", "critical-courant", "grows", WuPredictorCorrector, critical_courant=2.0)
plant("loads-at-the-begin", "stages", "`times` puts stage 0 at 0", VelocityVerlet, bind=loads_at_the_begin)


# -------------------------------------------------------------------------------------------------------- loads


plant("smooth-claimed", "kinks", "has a kink near time 0.0", Ramp, kinks=lambda self: ())
plant(
    "looks-at-neighbours", "amplitude", "depends on the other times", Ramp,
    amplitude=lambda self, time: time / (time.max(initial=0.0) or 1.0),
)  # fmt: skip


# ------------------------------------------------------------------------------------------------ masses, shapes


plant("heavy", "total-mass", "have the mass", Lumped, nodal=lambda self, *given: 1.5 * Lumped.nodal(self, *given))
plant("at-the-origin", "mesh", "does not start", Bar, mesh=lambda self, at, refine: Bar.mesh(self, 0.0 * at, refine))


# ------------------------------------------------------------------------------------- materials and elements


def material(name, check, said, **wrong):
    plant(name, check, said, Elastic, **{"examples": ({"young": 1.0, "density": 1.0, "poisson": 0.3},), **wrong})


def twice_the_energy(parameters, before, after):
    return parameters[0] * before * after


def curved(parameters, strain):
    return parameters[0] * strain * (1.0 - 3.0 * abs(strain))


def holds_its_direction(parameters, gradient):
    xx, xy, yx, yy = gradient
    mean, shear, spin = parameters[0] * (xx + yy), parameters[1] * (xy + yx), 0.5 * parameters[1] * (xy - yx)
    return mean + 2.0 * parameters[1] * xx, shear + spin, shear - spin, mean + 2.0 * parameters[1] * yy


def one_end(parameters, before, after):
    return 0.5 * parameters[0] * after * after


material("one-end", "balances", "the balance of energy is open by", energy_density=one_end)
material("twice-the-energy", "stress-and-energy", "the slope of the energy", energy_density=twice_the_energy)
material("curved", "linear", "not proportional", stress=curved)
material("holds-its-direction", "solid-stress", "does not turn with the body", stress_2d=holds_its_direction)


def kirchhoff(parameters, gradient, before=None, after=None):
    """The Kirchhoff stress, where P is asked."""
    found = (
        flows(parameters, gradient, before, after) if after is not None else NeoHookean.stress_3d(parameters, gradient)
    )
    return tuple((np.reshape(found, (3, 3)) @ (np.eye(3) + np.reshape(gradient, (3, 3))).T).ravel().tolist())


def hooke(parameters, strain):
    return (parameters[0] - 2.0 * parameters[1] / 3.0) * np.trace(strain) * np.eye(3) + 2.0 * parameters[1] * strain


def energy_of(parameters, stress):
    mean = np.trace(stress) / 3.0
    return 0.5 * mean**2 / parameters[0] + 0.25 * ((stress - mean * np.eye(3)) ** 2).sum() / parameters[1]


def rate_form(parameters, gradient, before, after):
    """A Kirchhoff stress by steps of strain, which does not turn with the body."""
    now, last = np.eye(3) + np.reshape(gradient, (3, 3)), np.eye(3) + np.reshape(before[:9], (3, 3))
    rate = (now - last) @ np.linalg.inv(0.5 * (now + last))
    stress = np.reshape(before[9:18], (3, 3)) + hooke(parameters, 0.5 * (rate + rate.T))
    after[:9], after[9:18], after[18] = (now - np.eye(3)).ravel(), stress.ravel(), energy_of(parameters, stress)
    return tuple((stress @ np.linalg.inv(now).T).ravel().tolist())


def rate_of_stretch(parameters, gradient, before, after):
    """A stress by steps of the stretch, in axes that turn with the body: it depends on the way of the strain."""
    now, last = np.eye(3) + np.reshape(gradient, (3, 3)), np.eye(3) + np.reshape(before[:9], (3, 3))
    squares, axes = np.linalg.eigh(now.T @ now)
    stretch = (axes * np.sqrt(squares)) @ axes.T
    rate = (stretch - last) @ np.linalg.inv(0.5 * (stretch + last))
    stress = np.reshape(before[9:18], (3, 3)) + hooke(parameters, 0.5 * (rate + rate.T))
    after[:9], after[9:18], after[18] = (stretch - np.eye(3)).ravel(), stress.ravel(), energy_of(parameters, stress)
    turn = now @ np.linalg.inv(stretch)
    return tuple((turn @ stress @ np.linalg.inv(stretch)).ravel().tolist())


def writes_before(parameters, gradient, before, after):
    """A return that writes the plastic strain to the state before the step."""
    stress = flows(parameters, gradient, before, after)
    before[6] = after[6]
    return stress


def keeps_trials(parameters, gradient, before, after):
    """A return that hardens by the largest stress of all calls."""
    stress = flows(parameters, gradient, before, after)
    Largest.stress = max(Largest.stress, abs(stress[0]))
    return tuple(one * (1.0 + 1e-6 * Largest.stress) for one in stress)


class Largest:
    stress = 0.0


def gains(parameters, gradient, before, after):
    """A return whose dissipated energy has the wrong sign."""
    stress = flows(parameters, gradient, before, after)
    after[8] = 2.0 * before[8] - after[8]
    return stress


def trial_energy(parameters, gradient, before, after):
    """A return that stores what the strain before the flow would store."""
    stress = flows(parameters, gradient, before, after)
    grown = after[6] - before[6]
    size = parameters[2] + parameters[3] * after[6] + 3.0 * parameters[1] * grown
    if grown > 0.0:
        after[7] += size * grown
    return stress


def creeps(parameters, gradient, before, after):
    """A return whose state fades a little in each step."""
    stress = flows(parameters, gradient, before, after)
    for k in range(6):
        after[k] *= 1.0 - 1e-9
    return stress


def soft_unloading(parameters, gradient, before, after):
    """A return that gives back less where it does not flow."""
    stress = flows(parameters, gradient, before, after)
    elastic = before[6] > 0.0 and after[6] == before[6]
    return tuple(0.98 * one for one in stress) if elastic else stress


def loses_in_unloading(parameters, gradient, before, after):
    """A return that counts a part of what it gives back as dissipated."""
    stress = flows(parameters, gradient, before, after)
    after[8] += 1e-3 * max(before[7] - after[7], 0.0)
    return stress


def strain_alone(parameters, gradient, before, after):
    """A return by the symmetric part of the gradient, as a rate form that turns the stress wrongly ends."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = gradient
    a, b, c = 0.5 * (xy + yx), 0.5 * (xz + zx), 0.5 * (yz + zy)
    return flows(parameters, (xx, a, b, a, yy, c, b, c, zz), before, after)


def forgets(parameters, gradient, before, after):
    """A return that writes no dissipated energy after a while."""
    stress = flows(parameters, gradient, before, after)
    if after[6] > 0.1:
        after[8] = 0.0
    return stress


def too_hard(parameters, gradient, before, after):
    """A stress whose work is more than the energies."""
    return tuple(1.1 * one for one in flows(parameters, gradient, before, after))


def plastic(name, said, kernel, **wrong):
    """Plant a metal."""
    plant(name, "solid-state", said, J2Plastic, stress_3d=kernel, **wrong)


flows = J2Plastic.stress_3d
TURNS, FALLS, WORK = "stress does not turn with the body", "the dissipated energy falls", "the work of the stress is"
BY_STEPS = {"state": 20, "stored_in": 18, "dissipated_in": 19, "plastic_in": None}  # nothing is dissipated
plastic("strain-alone", TURNS, strain_alone)
plastic("kirchhoff", TURNS, kirchhoff)
plastic("rate-form", TURNS, rate_form, **BY_STEPS)
plastic("rate-of-stretch", "elastic cycles change the stress by", rate_of_stretch, **BY_STEPS)
plastic("creeps", "elastic cycles change the stress by", creeps)
plastic("forgets", FALLS, forgets)
plastic("gains", FALLS, gains)
plastic("too-hard", WORK, too_hard)
plastic("trial-energy", WORK, trial_energy)
plastic("writes-before", "writes to the state before the step", writes_before)
plastic("keeps-trials", "another stress or state if it is asked again", keeps_trials)
plastic("soft-unloading", "of which", soft_unloading)
plastic("loses-in-unloading", "unloading by a strain of 0.0001 dissipates", loses_in_unloading)
plant("kirchhoff-of-rubber", "solid-stress", "the slope of the energy", NeoHookean, stress_2d=None, stress_3d=kirchhoff)

SLOPE = "minus the slope of the energy"
bar_force = BarElement.internal_force


def one_sided(element, material, first, dim, displacement, force):
    bar_force(element, material, first, dim, displacement, force)
    force[0] *= 0.9


def too_slow(self, body, speed):
    return speed / body.mesh.lengths


def half_of_the_volume(self, body):
    return 0.5 * QuadraticBarElement.volumes(self, body)


def held_along_x(rule, material, first, section, geometry, displacement, force):
    """A spring between two corners, which does not turn with them."""
    plane_forces(rule, material, first, section, geometry, displacement, force)
    pull = 0.01 * (displacement[1, 0] - displacement[0, 0])
    force[0, 0] += pull
    force[1, 0] -= pull


def half_across(rule, material, first, section, geometry, displacement, force):
    plane_forces(rule, material, first, section, geometry, displacement, force)
    for a in range(force.shape[0]):
        force[a, 1] *= 0.5


def one_corner_less(rule, material, first, section, geometry, displacement, force):
    plane_forces(rule, material, first, section, geometry, displacement, force)
    force[0, 0] *= 0.9


def mean_volumes(self, body):
    geometry = Quad4.geometry(self, body)
    geometry[..., -1] = geometry[..., -1].mean(axis=1, keepdims=True)
    return geometry


def volumes_of_these(self, body):
    return mean_volumes(self, body)[..., -1]


def twice_the_volume(self, body):
    return 2.0 * Quad4.volumes(self, body).sum(axis=1)


def gradients_of(geometry, displacement):
    """Return slopes, deformation gradients and volumes of the points of a quadrilateral."""
    slopes = geometry[:, :8].reshape(-1, 4, 2)
    return slopes, np.eye(2) + np.einsum("ai,qaj->qij", displacement, slopes), geometry[:, 8]


def mean_without_pressure(rule, material, first, section, geometry, displacement, force):
    """The mean of the volume strain in the stress alone; where J is negative its cubic root is too."""
    slopes, deformed, volume = gradients_of(geometry, displacement)
    ratio = np.linalg.det(deformed)
    scale = np.cbrt((volume @ ratio) / volume.sum() / ratio)
    force[:] = 0.0
    for q in range(4):
        whole = np.eye(3)
        whole[:2, :2] = deformed[q]
        stress = stress_3d(material, first + q, tuple((scale[q] * whole - np.eye(3)).ravel().tolist()))
        force -= volume[q] * scale[q] * slopes[q] @ np.reshape(stress, (3, 3))[:2, :2].T


def by_squares(rule, material, first, section, geometry, displacement, force):
    """The stress at the stretch, the root of F^T F, turned as the point is: the root knows no sign."""
    slopes, deformed, volume = gradients_of(geometry, displacement)
    force[:] = 0.0
    for q in range(4):
        squares, axes = np.linalg.eigh(deformed[q].T @ deformed[q])
        stretch = (axes * np.sqrt(squares)) @ axes.T
        stress = stress_2d(material, first + q, tuple((stretch - np.eye(2)).ravel().tolist()))
        force -= volume[q] * slopes[q] @ (deformed[q] @ np.linalg.inv(stretch) @ np.reshape(stress, (2, 2))).T


def without_hoop(rule, material, first, section, geometry, displacement, force):
    geometry = geometry.copy()
    geometry[:, 8:12] = 0.0
    ring_forces(rule, material, first, section, geometry, displacement, force)


def holds_at_rest(rule, material, first, section, geometry, displacement, force):
    """Hourglass control that fades as the cell is strained."""
    geometry = geometry.copy()
    geometry[9:12] *= max(1.0 - 4.0 * abs(geometry[:8:2] @ displacement[:, 0]), 0.0)
    one_point_forces(rule, material, first, section, geometry, displacement, force)


plant("mean-without-pressure", "solid-forces", SLOPE, Quad4Mean, force=mean_without_pressure)
plant("mean-of-negative", "inside-out", "a corner pushed through it has the force", Quad4Mean,
      force=mean_without_pressure)  # fmt: skip
plant("by-squares", "inside-out", "turned inside out has the force", Quad4, force=by_squares, linear=False)
plant("without-hoop", "solid-forces", "it fails the patch test", Quad4Axisymmetric, force=without_hoop)
plant("holds-at-rest", "hourglass", "a cell that is deformed has 2 motions", Quad4OnePoint, force=holds_at_rest)
plant("one-sided", "force-and-energy", SLOPE, BarElement, internal_force=one_sided)
plant("unbalanced", "balances", "the balance of", BarElement, internal_force=one_sided)
plant("too-slow", "frequency", "it gives the frequency", BarElement, highest_frequency=too_slow)
plant("wrong-volume", "cells", "do not add up to its volume", QuadraticBarElement, volumes=half_of_the_volume)
plant("half-across", "solid-forces", SLOPE, Quad4, force=half_across)
# A linear solid marches by differences of its displacements, in which momentum is balanced whatever its force is.
plant("gains-momentum", "blocks", "the balance of", Quad4, force=one_corner_less, linear=False)
patch_test = {"geometry": mean_volumes, "volumes": volumes_of_these}
plant("mean-volumes", "solid-forces", "it fails the patch test", Quad4, **patch_test)
plant("turns-wrongly", "finite-rotation", "the forces do not turn", Quad4, force=held_along_x, linear=False)
plant("twice-the-mass", "solid-masses", "of a body of", Quad4, volumes_of_cells=twice_the_volume)


# ------------------------------------------------------------------------------------------------------ blocks


def inwards(self, at, refine):
    mesh = Block.mesh(self, at, refine)
    top = mesh.regions["top"]
    turned = top._replace(facets={"line": top.facets["line"][:, ::-1]})
    return mesh._replace(regions={**mesh.regions, "top": turned})


plant("turned-inwards", "mesh", "do not enclose its volume", Block, examples=Block.examples[:1], mesh=inwards)


# ---------------------------------------------------------------------------------------------------- pairings

nodes_of = NodeToSegment.points


def half_of_the_area(self, first, second):
    found = nodes_of(self, first, second)
    return found._replace(weight=0.5 * found.weight)


def pulls_one_side(self, first, second):
    found = nodes_of(self, first, second)
    return found._replace(value=np.where(np.isin(found.node, first.nodes)[:, None], found.value, 0.5 * found.value))


plant("promises-too-much", "patch-test", "pressures at nodes are wrong by", NodeToSegment, passes_patch_test=True)
plant("shy", "shares", "has the share -0.", Mortar, convex=True, passes_patch_test=False, dimensions=(2,))
plant("half-of-the-area", "pairing", "in all, not 0.8", NodeToSegment, points=half_of_the_area)
plant("pulls-one-side", "pairing", "does not change by the distance", NodeToSegment, points=pulls_one_side)

places_of = NodeToSegment.places


def places(name, said, wrong, check="places"):
    """Plant a pairing with other places than those of its points."""

    def wrong_places(self, first, second):
        return wrong(places_of(self, first, second))

    def right_points(self, first, second):
        return paired(first, second, *places_of(self, first, second))

    plant(name, check, said, NodeToSegment, places=wrong_places, points=right_points)


beyond = {"facets": np.zeros(2, dtype=np.int64), "shares": np.array([[1.5, -0.5], [0.5, 0.5]]), "weight": np.ones(2)}
places("beside-its-facet", "has the share -0.5: it is not on its facet", lambda at: at._replace(**beyond))
places("half-a-place", "shares of a place add up to 0.5", lambda at: at._replace(shares=0.5 * at.shares))
places("a-place-too-few", "places and", lambda at: Places(*(each[1:] for each in at)))
places("areas-of-others", "other areas than points", lambda at: at._replace(weight=at.weight[::-1]))
moved = "not those of the points in their order"
places("other-order", moved, lambda at: at._replace(facets=at.facets[::-1], shares=at.shares[::-1]))
places("on-the-next-facet", moved, lambda at: at._replace(facets=np.roll(at.facets, 1)))
places("slides-with-half", "`sliding: small` differs by", lambda at: at._replace(weight=0.5 * at.weight), "slides-far")


def across_its_own(self, first, second):
    """Points that meet what lies across their own facet, not what is nearest."""
    at, out = first.positions, -first.normals[0]
    facet, share = second.nearest(at)
    met = np.einsum("pa,pad->pd", share, second.positions[second.facets[facet]])
    normal = second.normals[facet]
    return nodes_of(self, first, second)._replace(gap=np.einsum("pd,pd->p", at - met, normal) / -(normal @ out))


plant("across-its-own", "places", "does not meet the facet nearest to its place", NodeToSegment, points=across_its_own)


def renewed(name, said, wrong):
    """Plant a mortar whose kernel writes other points than those of the start."""

    def wrong_renew(surfaces, points):
        Mortar.renew(surfaces, points)
        wrong(points)

    plant(name, "renewed", said, Mortar, renew=staticmethod(wrong_renew), dimensions=(2,))


def wide_areas(points):
    for j in range(points.area.size):
        points.area[j] *= 1.25


def late_gaps(points):
    for j in range(points.gap.size):
        points.gap[j] += 0.01


def shares_in_reverse(points):
    for j in range(points.gap.size):
        for k in range(points.meets[j] // 2):
            last = points.meets[j] - 1 - k
            points.share[j, k], points.share[j, last] = points.share[j, last], points.share[j, k]


renewed("wide-areas", "its area is not that of `points`", wide_areas)
renewed("late-gaps", "its gap is not that of `points`", late_gaps)
renewed("shares-the-other-way", "a share is not that of `points`", shares_in_reverse)


# ---------------------------------------------------------------------------------------------------- frictions


def friction(name, said, bound, check="bound", **wrong):
    """Plant a friction like that of Coulomb."""
    plant(name, check, said, Coulomb, bound=bound, examples=({"mu": 0.3},), **wrong)


def falls_with_pressure(data, point, force, rate, before):
    return data.mu * force / (1.0 + force * force)


def grips_without_pressure(data, point, force, rate, before):
    return data.mu * force + 1e-3


def drives(data, point, force, rate, before):
    return -data.mu * force


class Counted:
    asked = 0


def remembers(data, point, force, rate, before):
    Counted.asked += 1
    return data.mu * force * (1.0 + 1e-3 * Counted.asked)


friction("falls-with-pressure", "as the normal force grows", falls_with_pressure)
friction("grips-without-pressure", "without a normal force the largest force is", grips_without_pressure)
friction("drives", "the largest forces are", drives)


def speaks_python(data, point, force, rate, before):
    return data._asdict()["mu"] * force


friction("speaks-python", "cannot be compiled", speaks_python, check="slides")
friction("remembers", "it is another one if it is asked again", remembers)


# ------------------------------------------------------------------------------------------ solutions, measures


def sticks(self, problem, end):
    found = BarsInARow.solve(self, problem, end)
    for contact in found.contacts.values():
        force = contact.force
        object.__setattr__(contact, "force", lambda t, force=force: force(t) - 1e-3)
    return found


plant("sticky", "exact-solution", "pulls with", BarsInARow, solve=sticks)
plant("not-a-number", "measure", "inf", Ripple, of=lambda self, result: float(np.float64("inf")))
