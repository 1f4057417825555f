"""A finer run of a case, which judges a run where no exact solution covers it: its errors are estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from percuss.case.case import Case, load
from percuss.case.defaults import OF_REFERENCE, OF_SLIDING
from percuss.case.yaml_text import flow
from percuss.certificate import verdict
from percuss.contact.model import Model
from percuss.contact.sliding import sliding
from percuss.errors import PercussError
from percuss.interrupt import interruptible
from percuss.jsonable import as_lists
from percuss.march.march import March
from percuss.march.recording import recordable
from percuss.mesh.body import Body
from percuss.mesh.spots import shares_in
from percuss.methods.interfaces import ExactContact, Floats
from percuss.results.exact import ROUND_OFF
from percuss.results.true_error import relative_l2

# Keys that say how a case is computed, not what it is; the finer run says its own.
COMPUTED_BY = ("time", "method", "refine", "reference", "record", "expect")
MOST_KEPT = 8  # finer runs that are kept for other runs of the same case: those of a study differ in methods alone


class FinerContact(ExactContact):
    """The history of one contact in a finer run, whose force is constant over each of its steps.

    Parameters
    ----------
    edges : (n + 1,) array
        Times between the steps over which the forces act.
    force : (n,) array
        The forces.
    time, gap : (n,) arrays
        Times of the records, and the gaps.
    """

    def __init__(self, edges: Floats, force: Floats, time: Floats, gap: Floats) -> None:
        self.edges, self.forces, self.times, self.gaps = edges, force, time, gap
        self.impulses = np.concatenate([[0.0], np.cumsum(force * np.diff(edges))])

    def force(self, time: Floats) -> Floats:
        """Return the force of the step around each time."""
        step = np.clip(np.searchsorted(self.edges, time) - 1, 0, len(self.forces) - 1)
        return np.asarray(self.forces[step], dtype=np.float64)

    def impulse(self, time: Floats) -> Floats:
        """Return the impulse from 0 to each time."""
        return np.asarray(np.interp(time, self.edges, self.impulses))

    def gap(self, time: Floats) -> Floats:
        """Return the gap at each time."""
        return np.asarray(np.interp(time, self.times, self.gaps))

    @cached_property
    def closed(self) -> tuple[tuple[float, float], ...]:
        """The intervals in which the contact presses."""
        presses = self.forces > ROUND_OFF * self.forces.max(initial=0.0)
        starts, ends = (np.flatnonzero(np.diff(presses, **{side: False}) & presses) for side in ("prepend", "append"))
        return tuple(zip(self.edges[starts].tolist(), self.edges[ends + 1].tolist(), strict=True))

    def largest_force(self, start: float, stop: float) -> float:
        """Return the largest force between two times."""
        within = (self.edges[1:] > start) & (self.edges[:-1] < stop)
        return float(self.forces[within].max(initial=0.0))


@dataclass(frozen=True)
class FinerRun:
    """A finer run, which stands where the exact solution would.

    Attributes
    ----------
    name
        The finer run in words.
    bodies
        Its bodies by name.
    contacts
        The history of each contact.
    displacement, velocity : (nodes, dim) arrays
        Motion at the time `end`.
    reached
        Time up to which the forces are known.
    """

    name: str
    bodies: Mapping[str, Body]
    contacts: Mapping[str, ExactContact]
    displacement: Floats
    velocity: Floats
    end: float
    reached: float
    fronts: int = 0

    def displacement_error(self, model: Model, displacement: Floats, time: float) -> float | None:
        """Return the relative difference of displacements at `time` from this run's, in L2 over all bodies, or None."""
        there = self.displacement_of(model, time)
        if there is None:
            return None
        mass = model.bodies.mass
        error, size = (float(mass @ (field**2).sum(axis=1)) for field in (displacement - there, there))
        return relative_l2(error, size)

    def displacement_of(self, model: Model, time: float) -> Floats | None:
        """Return the displacement of this run at `time` at the nodes of a coarser model; None where they end apart.

        Between the end of this run and `time`, which lie less than a step apart, its nodes move with their velocity.
        """
        if abs(time - self.end) > model.dt * (1.0 + ROUND_OFF):
            return None
        fine = self.displacement + (time - self.end) * self.velocity
        return np.concatenate(
            [
                _at_nodes(body.mesh.nodes, finer, fine[finer.start : finer.stop])
                for body, finer in ((body, self.bodies[name]) for name, body in model.bodies.items())
            ]
        )


def _at_nodes(nodes: Floats, finer: Body, displacement: Floats) -> Floats:
    """Return the displacements of a finer body at the nodes of the coarse one: at a node of its own, or in a cell."""
    from scipy.spatial import cKDTree

    apart, nearest = cKDTree(finer.mesh.nodes).query(nodes)
    found: Floats = displacement[nearest].copy()
    for k in np.flatnonzero(apart > ROUND_OFF * np.ptp(finer.mesh.nodes, axis=0).max()):
        # A node that the finer boundary cuts off moves as the nearest node.
        if shares := shares_in(finer.mesh, nodes[k]):
            found[k] = sum(share * displacement[node] for node, share in shares)
    return found


def case_of(case: Case, end: float, *, second: bool = False) -> Case:
    """Return the case of the finer run, or of the second one, which lasts until `end`."""
    chosen: Any = case.reference
    given = case.data["reference"]
    given = {**given, **{key: value for key, value in given["second"].items() if value}} if second else given
    source = replace(case.origin, data={key: value for key, value in case.data.items() if key not in COMPUTED_BY})
    contacts = case.data.get("contacts", {})
    own = {name: {key: value for key, value in one.items() if key != "pairing"} for name, one in contacts.items()}
    for name in case.bonds:  # a bond is a part of the problem
        own[name].setdefault("method", case.data["method"]["contact"])
    usual: dict[str, Any] = {"contact": OF_REFERENCE["contacts"]}
    if friction := case.data.get("method", {}).get("friction"):  # it is a part of the problem, too
        usual["friction"] = friction
    if case.method.pairing is not None:
        usual["pairing"] = OF_SLIDING if case.dimension == 3 and sliding(case) else OF_REFERENCE["pairings"]
    sections = {
        "contacts": own,
        "time": {"end": end, "courant": chosen.courant},
        "method": usual | {key: given[key] for key in ("contact", "pairing") if given.get(key) is not None},
        "refine": chosen.refine,
        "record": {"probes": ()},
    }
    for key, value in sections.items():
        source = source.replaced((key,), value)
    return load(source, registry=case.registry, plugins=case.files)


_kept: dict[object, FinerRun] = {}


def finer_runs(model: Model, threads: int) -> list[FinerRun] | str:
    """Return the finer run that judges a run of a model, and the second if its case has one; or why there is none.

    As many threads share out their steps, where their bodies are large.
    """
    case, chosen = model.case, model.case.reference
    if chosen is not None and case.refine >= chosen.refine:
        return f"the finer run (refine {chosen.refine:g}) is not finer than this run (refine {case.refine:g})"
    end = case.time.known_end or model.steps * model.dt
    seconds = (False, True) if chosen is not None and chosen.second is not None else (False,)
    try:
        return [_kept_or_made(case_of(case, end, second=second), threads) for second in seconds]
    except PercussError as error:
        return f"the finer run that would judge it was not made: {error}"


def _kept_or_made(finer: Case, threads: int) -> FinerRun:
    """Return the finer run of its case, which is kept for other runs of the case that it judges."""
    key = flow(as_lists(finer.data)), tuple(finer.data_files.items()), id(finer.registry)
    found = _kept[key] = _kept.get(key) or _march(finer, threads)
    while len(_kept) > MOST_KEPT:
        del _kept[next(iter(_kept))]
    return found


def _march(case: Case, threads: int) -> FinerRun:
    """Return the finer run of its case.

    Raises
    ------
    PercussError
        If it cannot be run, or did not come to its end.
    """
    with interruptible() as interrupted:
        model, criterion = verdict.settled(case)
        certificate = verdict.verdict_alone(model, criterion)
        if certificate["stable"] == "no":
            raise PercussError(f"it is unstable: {certificate['why']}")
        march = March(recordable(model), threads=threads)
        march.compile()
        outcome = march.run(marginal=certificate["stable"] == "marginal", interrupted=interrupted)
    if interrupted.is_set():  # also in its last steps
        raise KeyboardInterrupt
    if outcome.stop is not None:
        raise PercussError(f"it stopped at step {outcome.stop.step}: {outcome.stop.what}")
    time, record = outcome.time[: outcome.records], outcome.record
    middle = time + march.stepper.force_at * model.dt
    edges = np.append(middle - 0.5 * model.dt, middle[-1] + 0.5 * model.dt)
    contacts = {
        name: FinerContact(edges, record.contact_force[: len(time), k], time, record.gap[: len(time), k])
        for k, name in enumerate(case.contacts)
    }
    moved, velocity = (
        field.reshape(-1, march.dim).copy() for field in (outcome.final_displacement, outcome.final_velocity)
    )
    methods = [case.method.integrator.name, *dict.fromkeys(contact.law.name for contact in case.contacts.values())]
    pairings = dict.fromkeys(contact.pairing.name for contact in case.contacts.values() if contact.pairing is not None)
    name = f"refine {case.refine:g} with {', '.join([' and '.join(methods), *pairings])}"
    return FinerRun(
        name, dict(model.bodies.items()), contacts, moved, velocity, outcome.done * model.dt, float(edges[-1])
    )
