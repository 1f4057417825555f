"""Recommendation of the cheapest methods, options, mesh and step that meet stated bounds on a case.

Its runs are the rows of one session of a study whose plan grows, so that one file holds all of them and a search that
was interrupted goes on.

A *choice* is a pair of methods with its options and its step, on all meshes. What a candidate costs is known before it
runs: its number of steps times nodes times stages. How far it is from the bounds is known afterwards, as its *excess*,
the largest ratio of a number to its bound, which is taken to fall with the refinement. That predicts the coarsest mesh
that meets the bounds. Once one mesh of a choice misses the bounds and a finer one meets them, the meshes between are
halved.

Every pair runs on the mesh of the case first. Then come in turn other meshes of choices that have run, in the order of
the cost that is predicted, and choices beside the most promising one of each pair, which differ in the step or in one
option. A candidate runs only if it is cheaper than the best so far: a choice that is predicted to cost more runs once,
on the finest of its meshes that are cheaper. So a search ends when no such mesh is left or the runs are spent.
"""

from __future__ import annotations

import functools
import json
import math
import os
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from percuss.case.arguments import expect_methods, expect_names
from percuss.case.case import Case, load
from percuss.case.quantities import JUDGED_BY
from percuss.certificate.closed_laws import NEVER_GROWS
from percuss.contact.model import Model
from percuss.errors import InputError, PercussError, PluginError, RefusedPair, wrong_input
from percuss.files import expect_no_input
from percuss.jsonable import Data, Entries
from percuss.march.model_of_case import model_of
from percuss.methods.blame import plugin_faults
from percuss.methods.registry import Registry
from percuss.results.exact import exact_solution
from percuss.studies.candidates import Candidate, defaults, evaluations, meshes, needed_quantities, neighbours
from percuss.studies.perform import Bench
from percuss.studies.spec import read_study
from percuss.studies.study import Progress, Session, session
from percuss.studies.study_table import Study
from percuss.studies.tasks import Task, second_reference

MEASURE = "force_error_l1"  # the error that is bounded
FEWEST_RUNS = 10
SHARE_OF_FIRST_RUNS = 1 / 3  # of all runs; of more pairs than that some are drawn, and the others wait
STABLE, GUARANTEE, UNJUDGED = "certificate.stable", "certificate.energy", "exact_reason"  # of the summary of a run
MOST_CELLS = 100_000  # of a mesh in two or three dimensions, which a search builds to know what it costs
MOST_GROWTH = 0.01  # share by which the energy of a recommended run may grow where no bound on it is given
FINER = 4  # refinement of the finer run that judges where there is no exact solution and the case names no other
SMALLEST_EXCESS = 1e-9  # smaller ones are round-off, and say nothing of a coarser mesh
JUST_BELOW = 1.0 - 1e-9  # a predicted mesh, so that round-off takes no finer one
PARTS = 8  # a batch is this part of the runs that are left
NOT_FINE = 0.5  # largest refinement that the finer run judges, over its own: its error is half of theirs, or less


@dataclass(frozen=True)
class Bounds:
    """What a run has to keep to; None where nothing is asked.

    Attributes
    ----------
    error
        Largest error of the force in L1, of the worst contact.
    energy
        Largest share of the energy put in that contacts, scheme and materials may take or add; None lets them take any.
    """

    error: float | None = None
    energy: float | None = None

    @property
    def growth(self) -> float:
        """Largest share of the energy put in by which the energy may grow: no run is recommended that adds more."""
        return MOST_GROWTH if self.energy is None else self.energy


@dataclass(frozen=True)
class Tried:
    """A candidate that was run.

    Attributes
    ----------
    candidate
        Methods, options, mesh and step.
    status, reason
        As in the table of a study, or why a run is never recommended that is done.
    stable
        What the certificate says; None if the run was not done.
    error, energy, seconds
        The error, true or estimated, the share of energy, and the time of the march; None where they are not known.
        Of errors against two finer runs it is the larger one.
    evaluations
        The cost that the search keeps small: number of steps times nodes times stages, infinite if it was not done.
    excess
        The largest ratio of a number to its bound: at most 1 where all bounds are met, infinite where one is not known.
    key
        Key of its row in the study.
    """

    candidate: Candidate
    status: str
    reason: str
    stable: str | None
    error: float | None
    energy: float | None
    seconds: float | None
    evaluations: float
    excess: float
    key: str

    @property
    def meets(self) -> bool:
        """Whether it meets all bounds."""
        return self.excess <= 1.0

    def as_dict(self) -> Entries:
        """Return the run as plain data for JSON."""
        own = {name: value for name, value in vars(self).items() if name != "candidate"}
        return {**self.candidate.changes, **own, "meets": self.meets}


@dataclass(frozen=True)
class Recommendation:
    """The answer of a search.

    Attributes
    ----------
    bounds
        What was asked.
    front
        The runs of which none is both cheaper and further within the bounds, by rising cost. The last one is the
        nearest where none meets the bounds.
    tried
        All runs, in the order in which they were made.
    refused
        Why pairs were not run, of which one method refuses the other.
    left
        Number of choices of methods, options and step of which a mesh that did not run may still be better.
    judges
        The finer runs against which errors are estimated; none where the exact solution tells them.
    study
        The study with all runs.
    """

    bounds: Bounds
    front: list[Tried]
    tried: list[Tried]
    refused: Mapping[tuple[str, str], str]
    left: int
    judges: list[str]
    study: Study

    @property
    def best(self) -> Tried | None:
        """The cheapest run that meets the bounds; None if none does."""
        return next((one for one in self.front if one.meets), None)

    def as_dict(self) -> Entries:
        """Return the answer as plain data for JSON, with the command of the best run."""
        best = self.best
        return {
            "title": self.study.title,
            "file": str(self.study.path),
            "bounds": vars(self.bounds),
            "best": best and {**best.as_dict(), "command": self.study.command(best.key)},
            "front": [one.as_dict() for one in self.front],
            "tried": [one.as_dict() for one in self.tried],
            "refused": {" + ".join(pair): reason for pair, reason in self.refused.items()},
            "choices_left": self.left,
            "estimated": bool(self.judges),
        }


def recommend(
    path: str | os.PathLike[str],
    *,
    error: float | None = None,
    energy: float | None = None,
    integrators: Sequence[str] = (),
    contacts: Sequence[str] = (),
    runs: int = 400,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    plugins: Sequence[str | Path] = (),
    progress: Progress | None = None,
    changes: Data | None = None,
    longest: float | None = None,
) -> Recommendation:
    """Return the cheapest registered methods with options, mesh and step that meet bounds on a case.

    Parameters
    ----------
    path
        File of the case.
    error, energy
        As in `Bounds`; at least one of them.
    integrators, contacts
        Names of the methods to choose from; by default all that are registered.
    runs
        Largest number of runs.
    out
        File of the runs, as of `percuss.study`; by default ``CASE-recommend.sqlite`` in the current folder.
    workers
        Number of processes; by default one a core.
    plugins
        Single-file plug-ins, whose methods take part.
    progress
        Called with (runs made, runs planned so far).
    changes
        Values of the case by dotted path, as ``{"reference.refine": 4}``.
    longest
        Seconds that a run may take in a worker process; by default any time.

    Raises
    ------
    InputError
        If the case or a bound is wrong, or `out` holds something else or is a file that the search reads.
    """
    bounds, set_ = Bounds(error, energy), {**(changes or {})}
    case = load(Path(path), set_, plugins=plugins)
    _check(bounds, runs)
    model = model_of(case)
    if error is not None and case.reference is None and exact_solution(model, (model.steps + 1) * model.dt)[2]:
        set_["reference.refine"] = FINER
        case = case.with_overrides({"reference.refine": FINER})
    for parameter, names in (("integrators", integrators), ("contacts", contacts)):
        expect_names("percuss.recommend", parameter, names)
    expect_methods(case.registry, integrators, contacts)
    if case.bonds and not contacts:
        message = f"expected a contact whose bodies may part, found a bond ({case.contacts[case.bonds[0]].law.name})"
        advice = "recommend searches laws of contact; name those that may take its place with --contact."
        raise InputError([case.problem(("contacts", case.bonds[0]), message, advice)])
    methods = _methods(case.registry, "integrator", integrators), _methods(case.registry, "contact", contacts)
    pairings = case.registry.names("pairings") if case.method.pairing is not None else ()
    end = model.steps * model.dt if case.time.end is None else case.time.end
    set_ |= _fixed(case, end) | second_reference(case, methods[1], pairings)
    file = Path(out) if out is not None else Path(f"{Path(path).stem}-recommend.sqlite")
    expect_no_input(file, case.inputs)
    plan = {
        "percuss-study": 1,
        "title": f"recommendation for {Path(path).name}",
        "cases": [str(path)],
        "set": set_,
        "measure": [MEASURE, "energy_kept", "energy_max", STABLE, GUARANTEE, UNJUDGED],
    }
    spec = read_study(plan, [Path(plugin) for plugin in plugins])
    bench = Bench.of(spec.cases, spec.rows)
    with session(spec, bench, file, workers=workers, longest=longest, most=runs) as running:
        return _answer(Runs(bench, running, bounds, runs, progress), methods)


def bound_of(text: str, option: str) -> float | None:
    """Return the number of a bound, given as 1% or 0.01; None for an empty text.

    Raises
    ------
    InputError
        If the text is no number.
    """
    try:
        return float(text.removesuffix("%")) * (0.01 if text.endswith("%") else 1.0) if text else None
    except ValueError:
        message = f"expected a number, found '{text[:60]}'"
        raise wrong_input(option, message, "Write it as 1% or 0.01.") from None


def _check(bounds: Bounds, runs: int) -> None:
    """Raise InputError for bounds or a number of runs that no search can start from."""
    for name, value in vars(bounds).items():
        if value is not None and not (value > 0 and math.isfinite(value)):
            raise wrong_input(f"--{name}", f"expected a finite number greater than 0, found {value:g}")
    if bounds.error is None and bounds.energy is None:
        advice = "Give --error, as 1%, or --energy."
        raise wrong_input("recommend", "expected a bound on the error or on the energy, found none", advice)
    if runs < FEWEST_RUNS:
        raise wrong_input("--runs", f"expected a number of at least {FEWEST_RUNS}, found {runs}")


def _methods(registry: Registry, kind: str, names: Sequence[str]) -> list[str]:
    """Return the names of the integrators or of the contact laws to choose from.

    Raises
    ------
    InputError
        If one needs a quantity that belongs to the case.
    """
    chosen = []
    for name in names or registry.names(f"{kind}s"):
        method: Any = registry.get(f"{kind}s", name)
        needed = " and ".join(needed_quantities(method))
        if needed and names:
            raise wrong_input(f"--{kind}", f"'{name}' needs a value of {needed}, which no search knows")
        if not needed and (names or not getattr(method, "tied_during", False)):
            chosen.append(name)  # a law that ties a contact at times is none to choose, unless it is named
    return chosen


def _fixed(case: Case, end: float) -> Entries:
    """Return what all candidates have in common, by path: the end of the run, no contact with methods of its own."""
    fixed = {"time.step": None, "time.steps": None, "time.end": end, "record.every": 1, "record.fields": 0}
    if case.time.courant is None:  # the case has to be one before a candidate says its own
        fixed["time.courant"] = 1.0
    return fixed | {f"contacts.{name}.{key}": None for name in case.contacts for key in ("method", "pairing")}


def _answer(runs: Runs, methods: tuple[list[str], list[str]]) -> Recommendation:
    """Search and return the answer."""
    case = runs.case
    pairing = case.method.pairing.name if case.method.pairing is not None else ""
    usable = [one for one in defaults(*methods, case.registry, pairing) if runs.fits(one)]
    if not usable:
        raise runs.reason
    of_pair = list({one.pair: one for one in reversed(usable)}.values())
    drawn = np.random.default_rng(0).permutation(len(of_pair))[: max(1, int(SHARE_OF_FIRST_RUNS * runs.room))]
    first = [of_pair[k] for k in drawn]
    search = Search(first, usable, runs.meshes(first[0]), case.registry, runs)
    search.run()
    if runs.made is None:
        raise AssertionError("a search has made no run")
    cost = search.best()
    return Recommendation(
        bounds=runs.bounds,
        front=front(runs.tried.values()),
        tried=list(runs.tried.values()),
        refused=runs.refused,
        left=sum(bool(search.left(choice, cost)) for choice in search.choices.values()),
        judges=[*dict.fromkeys(row[JUDGED_BY] for row in runs.made.as_records() if row.get(JUDGED_BY))],
        study=runs.made,
    )


# ---------------------------------------------------------------------------------------- runs and their judgement


class Runs:
    """Where the candidates of a search run: the runs so far, and the session of the study that holds them."""

    def __init__(self, bench: Bench, session: Session, bounds: Bounds, runs: int, progress: Progress | None) -> None:
        self._bench, self._session, self.bounds, self._runs, self._progress = bench, session, bounds, runs, progress
        ((self._label, self.case),) = bench.cases.items()
        self.tried: dict[str, Tried] = {}
        self.refused: dict[tuple[str, str], str] = {}
        self.reason: PercussError = InputError([])
        self.made: Study | None = None
        self._planned: dict[str, tuple[Candidate, Task]] = {}
        self._usual: Entries = {}  # methods that fit, to count nodes and steps with
        self._node_steps = functools.cache(self._count_node_steps)
        self._stages = functools.cache(self._count_stages)

    @property
    def room(self) -> int:
        """Number of candidates that may still be run."""
        return 0 if self.made is not None and not self.made.complete else self._runs - len(self._planned)

    def cost(self, candidate: Candidate) -> float:
        """Return the number of steps times nodes times stages of a candidate; it rises with the refinement."""
        options = json.dumps(candidate.integrator_options)
        return self._node_steps(candidate.refine, candidate.courant) * self._stages(candidate.integrator, options)

    def _count_node_steps(self, refine: float, courant: float) -> float:
        try:
            model = self._model({**self._usual, "refine": refine, "time.courant": courant})
        except InputError:  # too large for this machine
            return math.inf
        return float(model.steps * len(model.bodies.nodes))

    def _count_stages(self, name: str, options: str) -> int:
        integrator: Any = self.case.registry.get("integrators", name)
        return evaluations(integrator(**json.loads(options)))

    def _model(self, changes: Data) -> Model:
        return model_of(self.case.with_overrides(changes))

    def fits(self, candidate: Candidate) -> bool:
        """Return whether the options of a candidate go together, and neither method refuses the other."""
        if candidate.pair in self.refused:
            return False
        try:
            with plugin_faults():
                self._model(candidate.changes)
        except (RefusedPair, InputError) as error:
            self.reason = error
            if isinstance(error, RefusedPair) and not (candidate.integrator_options or candidate.contact_options):
                self.refused[candidate.pair] = error.sentence
            return False
        except PluginError:
            pass  # its run fails, and says why
        return True

    def meshes(self, candidate: Candidate) -> list[float]:
        """Return the refinements to choose from; a candidate that fits tells numbers of elements, nodes and steps."""
        self._usual = candidate.changes
        bodies = self._model(self._usual).bodies
        found = meshes([body.in_a_row for body in bodies.values()])
        # A bar has one row of elements, other bodies as many rows as elements in a row, and as many layers.
        others = [body for body in bodies.values() if body.count > body.in_a_row]
        found = [refine for refine in found if sum(body.count * refine**bodies.dim for body in others) <= MOST_CELLS]
        if self.case.reference is not None:
            found = [refine for refine in found if refine <= NOT_FINE * self.case.reference.refine]
        try:
            self._model({**self._usual, "refine": found[0]})
        except (InputError, PluginError):  # of a shape that knows whole numbers alone
            return [refine for refine in found if isinstance(refine, int)]
        return found

    def ask(self, candidates: Sequence[Candidate]) -> list[float]:
        """Run candidates and return the excess of each, infinite if it is not known."""
        for one in [one for one in candidates if one.key not in self._planned][: self.room]:
            task = Task(self._label, one.integrator, one.contact, one.changes, one.changes)
            self._planned[one.key] = one, self._bench.with_key(task)[0]
        self.made = self._session.make([task for _, task in self._planned.values()], self._progress)
        rows = zip(self._planned.values(), self.made.as_records(), strict=True)
        self.tried = {one.key: judged(row, one, self.bounds) for (one, _), row in rows}
        return [self.tried[one.key].excess if one.key in self.tried else math.inf for one in candidates]


def judged(row: Data, candidate: Candidate, bounds: Bounds) -> Tried:
    """Return the run of a candidate, judged by the bounds, from its row in the table of a study."""
    ran = row["status"] == "done" and row["seconds"] is not None
    doubt = why_never(row) if ran else ""
    kept, most, error = row["energy_kept"], row["energy_max"], row[MEASURE]
    energy = None if kept is None else abs(1.0 - kept)
    growth = None if None in (kept, most) else max(kept, most) - 1.0
    asked = (error, bounds.error), (energy, bounds.energy), (growth, bounds.growth)
    ratios = [math.nan if value is None else value / bound for value, bound in asked if bound is not None]
    return Tried(
        candidate,
        row["status"],
        row["reason"] or doubt or (row[UNJUDGED] or "" if error is None and bounds.error is not None else ""),
        stable=row[STABLE] if row["status"] == "done" else None,
        error=error,
        energy=energy,
        seconds=row["seconds"] if ran else None,
        evaluations=float(row["node_steps"]) if ran else math.inf,
        excess=max(ratios) if ran and not doubt and all(map(math.isfinite, ratios)) else math.inf,
        key=row["key"],
    )


def why_never(row: Data) -> str:
    """Return why a run that is done is never recommended, whatever its numbers; empty if it may be.

    Parameters
    ----------
    row
        The run in the table of a study, with the columns `STABLE`, `GUARANTEE` and ``energy_kept``.
    """
    if row["reason"]:  # a doubt about a run that is done
        return str(row["reason"])
    if row[STABLE] == "no":
        return "the certificate says unstable"
    if row[STABLE] == "marginal" and row[GUARANTEE] != NEVER_GROWS:
        return "the step is at the edge of stability, and the pair does not guarantee that energy never grows"
    return "" if row["energy_kept"] is not None else "by how much its energy changed is not known"


def front(runs: Iterable[Tried]) -> list[Tried]:
    """Return the runs of which none is both cheaper and further within the bounds, by rising cost."""
    kept: list[Tried] = []
    for one in sorted(runs, key=lambda one: (one.evaluations, one.excess, one.candidate.key)):
        if one.excess < (kept[-1].excess if kept else math.inf):
            kept.append(one)
    return kept


# ------------------------------------------------------------------------------------------- what runs next


@dataclass(eq=False)
class Choice:
    """A pair with its options, its pairing and its step, on all meshes.

    Attributes
    ----------
    candidate
        The candidate on the mesh of the case.
    parent
        The choice beside which it was found, whose prediction is its own until it has run.
    runs
        Excess of its runs, by refinement.
    followed
        Whether the choices beside it take part.
    """

    candidate: Candidate
    parent: Choice | None = None
    runs: dict[float, float] = field(default_factory=dict)
    followed: bool = False

    def on(self, refine: float) -> Candidate:
        """Return its candidate on a mesh."""
        return replace(self.candidate, refine=refine)

    @property
    def bracket(self) -> tuple[float, float]:
        """The finest mesh that misses the bounds, 0 if none does, and the coarsest finer one that meets them."""
        met = min((refine for refine, excess in self.runs.items() if excess <= 1.0), default=math.inf)
        return max((refine for refine in self.runs if refine < met), default=0.0), met

    @property
    def meeting(self) -> float:
        """The refinement that is predicted to meet the bounds, from its run beside them; infinite if none tells."""
        if not self.runs:
            return self.parent.meeting if self.parent is not None else 1.0
        known = [(refine, max(excess, SMALLEST_EXCESS)) for refine, excess in self.runs.items() if excess < math.inf]
        return math.prod(min(known, key=lambda one: abs(math.log(one[1])), default=(math.inf,)))


class Search:
    """A search for the cheapest candidate.

    Parameters
    ----------
    first
        Candidates that run before all others.
    later
        Candidates that run if nothing else is left.
    meshes
        Refinements, rising.
    registry
        The methods, whose options candidates differ in.
    bench
        Where candidates are run.
    """

    def __init__(
        self,
        first: Iterable[Candidate],
        later: Iterable[Candidate],
        meshes: list[float],
        registry: Registry,
        bench: Runs,
    ) -> None:
        self.meshes, self.registry, self.bench = meshes, registry, bench
        self.choices: dict[str, Choice] = {}
        self.first = [self._choice(one) for one in first]
        for one in later:
            self._choice(one)

    def _choice(self, candidate: Candidate, parent: Choice | None = None) -> Choice:
        """Return the choice of a candidate, which takes part from now on."""
        start = replace(candidate, refine=1)
        return self.choices.setdefault(start.key, Choice(start, parent))

    def run(self) -> None:
        """Run candidates until nothing is left or the runs are spent."""
        batch = [choice.on(1) for choice in self.first]
        while batch and self.bench.room > 0:
            for one, excess in zip(batch, self.bench.ask(batch), strict=False):
                self._choice(one).runs[one.refine] = excess
            ran = sorted((choice for choice in self.choices.values() if choice.runs), key=self._predicted)
            self._follow({choice.candidate.pair: choice for choice in reversed(ran)}.values())
            batch = self._batch()
            if not batch and self.best() == math.inf:
                self._follow(ran)  # not those of each pair alone
                batch = self._batch()

    def best(self) -> float:
        """Return the cost of the cheapest candidate that meets the bounds, infinite if none does."""
        met = [one.on(refine) for one in self.choices.values() for refine, excess in one.runs.items() if excess <= 1.0]
        return min(map(self.bench.cost, met), default=math.inf)

    def left(self, choice: Choice, cost: float) -> list[float]:
        """Return the meshes of a choice that could meet the bounds at less than a cost: those within its bracket.

        A choice of which no run tells anything has none, but where nothing meets the bounds.
        """
        if choice.meeting == math.inf > cost:
            return []
        missed, met = choice.bracket
        cheaper = bisect_left(self.meshes, cost, key=lambda refine: self.bench.cost(choice.on(refine)))
        return self.meshes[bisect_right(self.meshes, missed) : min(bisect_left(self.meshes, met), cheaper)]

    def _predicted(self, choice: Choice) -> float:
        """Return what a choice is predicted to cost where it meets the bounds."""
        return self.bench.cost(choice.on(_meeting(choice, self.meshes)))

    def _follow(self, choices: Iterable[Choice]) -> None:
        """Let the choices beside others take part."""
        for choice in [one for one in choices if not one.followed]:
            choice.followed = True
            for one in filter(self.bench.fits, neighbours(choice.candidate, self.registry)):
                self._choice(one, choice)

    def _batch(self) -> list[Candidate]:
        """Return the candidates to run next, of one choice each.

        They come in turn from those that have run, by their predicted cost, and from those that have not, of the pair
        first of which fewest have. Once something meets the bounds, another step alone stands among those that have
        run. Those that are not beside another one come last.
        """
        cost = self.best()
        tries = Counter(choice.candidate.pair for choice in self.choices.values() if choice.runs)
        known, new, later = list[Choice](), list[Choice](), list[Choice]()
        for choice in sorted(self.choices.values(), key=self._predicted):
            beside, own = choice.parent, choice.candidate
            other_step = beside is not None and own.courant != beside.candidate.courant and cost < math.inf
            (known if choice.runs or other_step else new if beside is not None else later).append(choice)
        new.sort(key=lambda choice: tries[choice.candidate.pair])
        open_ = ([choice for choice in some if self.left(choice, cost)] for some in (known, new))
        batch: list[Candidate] = []
        for choice in (*filter(None, chain.from_iterable(zip_longest(*open_))), *later):
            if len(batch) == max(2, self.bench.room // PARTS):
                break
            if left := self.left(choice, cost):
                missed, met = choice.bracket
                halved = missed > 0.0 and met < math.inf
                one = choice.on(left[len(left) // 2] if halved else _meeting(choice, left))
                if self.bench.fits(one):
                    batch.append(one)
                else:
                    choice.runs[one.refine] = math.inf
        return batch


def _meeting(choice: Choice, meshes: Sequence[float]) -> float:
    """Return the mesh on which a choice is predicted to meet the bounds, or the finest if none is as fine."""
    return meshes[min(bisect_left(meshes, choice.meeting * JUST_BELOW), len(meshes) - 1)]
