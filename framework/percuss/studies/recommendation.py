"""Search for the cheapest methods, options, mesh and step that meet stated bounds on a case.

The search is a study whose plan grows: each round adds runs to it, so that one file holds all of them and a search that
was interrupted goes on. First every pair runs with its default options on the mesh of the case. In each round the
better half of the pairs is kept; those that miss the bounds run on the mesh that their errors so far suggest, and with
other options and steps, drawn at random. The cheapest run that meets the bounds is then improved from neighbour to
neighbour, until none beside it is cheaper and meets them too. The rule to keep a share of the candidates and to spend
more on each is successive halving (Jamieson, Talwalkar: Non-stochastic best arm identification and hyperparameter
optimization, AISTATS 2016).

What a run costs is the time of its march. A clock is noisy, so that of each pair the least time for a node and a stage
is taken, from all its runs, and multiplied by the number of nodes, steps and stages of the run.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from percuss.case.arguments import expect_methods, expect_names
from percuss.case.case import Case, load
from percuss.case.quantities import METRICS
from percuss.errors import InputError, PluginError, Problem, RefusedPair, shortened, suggestion
from percuss.files import expect_no_input, expect_writable
from percuss.methods.blame import plugin_faults
from percuss.methods.registry import Registry
from percuss.solver.model import Model
from percuss.studies.candidates import Candidate, defaults, drawn, evaluations, needed_quantities, neighbours
from percuss.studies.dispatch import Progress
from percuss.studies.pareto import front_of
from percuss.studies.study import study
from percuss.studies.study_table import Study

__all__ = ["Bounds", "Recommendation", "Tried", "recommend"]

FEWEST_RUNS = 10
FEWEST_PAIRS = 4  # that are kept in every round
ROUNDS_OF_DRAWS = 3
SHARE_OF_FIRST_RUNS = 0.5  # of all runs; more pairs than that are drawn from
SHARE_OF_SEARCH = 0.75  # of all runs; the others are kept for the neighbours of the best
LARGEST_REFINEMENT = 64
USUAL_ORDER = 1.0  # of the error of a force in L1, until two meshes tell
ORDERS = (0.5, 2.0)
STABLE = "certificate.stable"  # of the summary of a run
TWICE_AS_FINE = ("peak_force", "impulse")  # numbers whose change on a finer mesh estimates an error


@dataclass(frozen=True)
class Bounds:
    """What a run has to keep to; None where nothing is asked.

    Attributes
    ----------
    error
        Largest value of `measure`.
    energy
        Largest share of the energy put in that the contacts may take or add.
    seconds
        Longest time of the march.
    measure
        Name of the measured error.
    """

    error: float | None = None
    energy: float | None = None
    seconds: float | None = None
    measure: str = "force_error_l1"


@dataclass(frozen=True)
class Tried:
    """A candidate that was run.

    Attributes
    ----------
    candidate
        Methods, options, mesh and step.
    status, reason
        As in the table of a study.
    stable
        What the certificate says; None if the run was not done. No run is recommended of which it says ``no``.
    error, energy, seconds
        The error, true or estimated, the share of energy, and the time of the march; None where they are not known.
    evaluations
        Number of steps times nodes times stages, which depends on no machine.
    cost
        `evaluations` times the least time of one of them in the runs of the pair.
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
    cost: float
    excess: float
    key: str

    @property
    def meets(self) -> bool:
        """Whether it meets all bounds."""
        return self.excess <= 1.0

    def as_dict(self) -> dict[str, Any]:
        """Return the run as plain data for JSON."""
        names = ("status", "reason", "stable", "error", "energy", "seconds", "evaluations", "cost", "excess", "key")
        return {**self.candidate.changes, **{name: getattr(self, name) for name in names}, "meets": self.meets}


@dataclass(frozen=True)
class Recommendation:
    """The answer of a search.

    Attributes
    ----------
    bounds
        What was asked.
    best
        The cheapest run that meets the bounds; None if none does.
    second
        The cheapest of another pair.
    nearest
        The run that comes nearest to the bounds, where none meets them.
    front
        The runs of which none is both cheaper and more accurate, by rising cost.
    tried
        All runs, in the order in which they were made.
    refused
        Why pairs were not run, of which one method refuses the other.
    beside
        Neighbours of the best that were examined; None if the search ended before all of them were.
    untried
        Number of pairs that were not run, because the number of runs is smaller.
    estimated
        Whether errors are estimated from a mesh twice as fine, because no exact solution covers the case.
    study
        The study with all runs.
    """

    bounds: Bounds
    best: Tried | None
    second: Tried | None
    nearest: Tried | None
    front: list[Tried]
    tried: list[Tried]
    refused: Mapping[tuple[str, str], str]
    beside: int | None
    untried: int
    estimated: bool
    study: Study

    def as_dict(self) -> dict[str, Any]:
        """Return the answer as plain data for JSON, with the command of each run that it names."""

        def told(one: Tried | None) -> dict[str, Any] | None:
            return None if one is None else {**one.as_dict(), "command": self.study.command(one.key)}

        return {
            "title": self.study.title,
            "file": str(self.study.path),
            "bounds": dataclasses.asdict(self.bounds),
            "best": told(self.best),
            "second": told(self.second),
            "nearest": told(self.nearest),
            "front": [told(one) for one in self.front],
            "tried": [one.as_dict() for one in self.tried],
            "refused": {" + ".join(pair): reason for pair, reason in self.refused.items()},
            "neighbours": self.beside,
            "untried_pairs": self.untried,
            "estimated": self.estimated,
        }


def recommend(
    path: str | os.PathLike[str],
    *,
    error: float | None = None,
    energy: float | None = None,
    seconds: float | None = None,
    measure: str = "force_error_l1",
    integrators: Sequence[str] = (),
    contacts: Sequence[str] = (),
    runs: int = 400,
    seed: int = 0,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    plugins: Sequence[str | Path] = (),
    progress: Progress | None = None,
    outputs: Sequence[str | os.PathLike[str]] = (),
) -> Recommendation:
    """Return the cheapest registered methods with options, mesh and step that meet bounds on a case.

    Parameters
    ----------
    path
        File of the case.
    error, energy, seconds, measure
        As in `Bounds`; at least one of the first two.
    integrators, contacts
        Names of the methods to choose from; by default all that are registered.
    runs
        Largest number of runs.
    seed
        Seed of the draws.
    out
        File of the runs, as of `percuss.study`; by default ``CASE-recommend.sqlite`` in the current folder.
    workers
        Number of processes; by default one a core.
    plugins
        Single-file plug-ins, whose methods take part.
    progress
        Called with (runs made, largest number of runs).
    outputs
        Files that the caller writes afterwards, checked before any run is made.

    Raises
    ------
    InputError
        If the case or a bound is wrong, `out` holds something else, or an output cannot be written or is a file that
        the search reads.
    """
    case = load(Path(path), plugins=plugins)
    bounds = Bounds(error, energy, seconds, measure)
    _check(bounds, runs, seed)
    expect_names("percuss.recommend", "integrators", integrators)
    expect_names("percuss.recommend", "contacts", contacts)
    methods = _methods(case.registry, integrators, contacts)
    file = Path(out) if out is not None else Path(f"{Path(path).stem}-recommend.sqlite")
    expect_no_input(file, case.inputs)
    for output in outputs:
        expect_writable(output, [*case.inputs, ("file of runs", file)])
    search = _Search(case, Path(path), methods, bounds, runs, file, workers, plugins, progress)
    return search.answer(np.random.default_rng(seed))


def bound_of(text: str, option: str) -> float | None:
    """Return the number of a bound, given as 1% or 0.01; None for an empty text.

    Raises
    ------
    InputError
        If the text is no number.
    """
    if not text:
        return None
    digits, percent = (text[:-1], 0.01) if text.endswith("%") else (text, 1.0)
    try:
        return float(digits) * percent
    except ValueError:
        message = f"expected a number, found '{shortened(text, 60)}'"
        raise InputError([Problem(option, "", message, "Write it as 1% or 0.01.")]) from None


def _check(bounds: Bounds, runs: int, seed: int) -> None:
    """Raise InputError for bounds, a number of runs or a seed that no search can start from."""
    problems = [
        Problem(f"--{name}", "", f"expected a finite number greater than 0, found {value:g}")
        for name, value in (("error", bounds.error), ("energy", bounds.energy), ("time", bounds.seconds))
        if value is not None and not (value > 0 and math.isfinite(value))
    ]
    if bounds.error is None and bounds.energy is None:
        advice = "Give --error, as 1%, or --energy."
        problems.append(Problem("recommend", "", "expected a bound on the error or on the energy, found none", advice))
    errors = [name for name, quantity in METRICS.items() if quantity.is_error and quantity.against_exact]
    if bounds.measure not in errors:
        advice = suggestion(bounds.measure, errors)
        problems.append(Problem("--measure", "", f"expected a true error, found '{bounds.measure}'", advice))
    if runs < FEWEST_RUNS:
        problems.append(Problem("--runs", "", f"expected a number of at least {FEWEST_RUNS}, found {runs}"))
    if seed < 0:
        problems.append(Problem("--seed", "", f"expected a whole number of at least 0, found {seed}"))
    if problems:
        raise InputError(problems)


def _methods(registry: Registry, integrators: Sequence[str], contacts: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the names of the integrators and of the contact laws to choose from.

    Raises
    ------
    InputError
        If one is not registered, or needs a quantity that belongs to the case.
    """
    expect_methods(registry, integrators, contacts)
    problems = []
    open_to_search: dict[str, list[str]] = {}
    for option, family, names in (("integrator", "integrators", integrators), ("contact", "contacts", contacts)):
        methods: dict[str, Any] = {name: registry.get(family, name) for name in names or registry.names(family)}
        needed = {name: quantities for name, method in methods.items() if (quantities := needed_quantities(method))}
        problems += [
            Problem(f"--{option}", "", f"'{name}' needs a value of {' and '.join(needed[name])}, which no search knows")
            for name in names
            if name in needed
        ]
        tie = [name for name, law in methods.items() if family == "contacts" and not names and law.tied_during]
        open_to_search[family] = [name for name in methods if name not in needed and name not in tie]
    if problems:
        raise InputError(problems)
    return open_to_search["integrators"], open_to_search["contacts"]


def _fixed(case: Case) -> dict[str, Any]:
    """Return what all candidates have in common, by path: the end of the run, and one contact law for all contacts."""
    end = case.time.end
    if end is None:
        model = Model(case)
        end = model.steps * model.dt
    fixed: dict[str, Any] = {"time.step": None, "time.steps": None, "time.end": end, "record.every": 1}
    own = (name for name, contact in case.contacts.items() if contact.own_law)
    return fixed | {"record.fields": 0} | {f"contacts.{name}.method": None for name in own}


class _Search:
    """A search: the candidates run so far, and the study that holds them."""

    def __init__(
        self,
        case: Case,
        path: Path,
        methods: tuple[list[str], list[str]],
        bounds: Bounds,
        runs: int,
        out: Path,
        workers: int | None,
        plugins: Sequence[str | Path],
        progress: Progress | None,
    ) -> None:
        self.case, self.path, self.bounds, self.runs = case, path, bounds, runs
        self.out, self.workers, self.plugins, self.progress = out, workers, plugins, progress
        self.methods, self.registry = methods, case.registry
        self.candidates: dict[str, Candidate] = {}
        self.rows: dict[str, dict[str, Any]] = {}
        self.made: Study | None = None
        self.estimated = False
        self.interrupted = False
        self.fixed = _fixed(case)
        self.untried = 0
        self.refused: dict[tuple[str, str], str] = {}

    # ------------------------------------------------------------------------------------------------- runs

    def run(self, candidates: Iterable[Candidate]) -> None:
        """Run candidates that were not run yet, as many as the number of runs allows."""
        wanted = [one for one in candidates if self._fits(one)]
        if self.estimated:  # each with the one on a finer mesh, without which it has no error
            wanted = [each for one in wanted for each in (one, dataclasses.replace(one, refine=2 * one.refine))]
        new = {one.key: one for one in wanted if one.key not in self.candidates}
        room = self.runs - len(self.candidates)
        if not new or room <= 0 or self.interrupted:
            return
        self.candidates |= dict(list(new.items())[:room])
        plan = self._plan([one.changes for one in self.candidates.values()])
        self.made = study(plan, self.out, self.workers, None, self._progress, plugins=self.plugins)
        records = self.made.as_records()
        self.rows = dict(zip(self.candidates, records, strict=True))
        self.interrupted = any(row["status"] == "waiting" for row in records)

    def _fits(self, candidate: Candidate) -> bool:
        """Return whether the options of a candidate go together, and neither method refuses the other."""
        if candidate.key in self.candidates:
            return True
        try:
            with plugin_faults():
                Model(self.case.with_overrides({**self.fixed, **candidate.changes}))
        except RefusedPair as refusal:
            if not (candidate.integrator_options or candidate.contact_options):
                self.refused[candidate.pair] = str(refusal)
            return False
        except InputError:
            return False
        except PluginError:
            return True  # its run fails, and says why
        return True

    def _progress(self, done: int, total: int) -> None:  # noqa: ARG002 - of the round, not of the search
        if self.progress is not None:
            self.progress(done, self.runs)

    def _plan(self, points: list[dict[str, Any]]) -> dict[str, Any]:
        """Return the study of the search: all points so far, of which those that are stored are not made again."""
        return {
            "percuss-study": 1,
            "title": f"recommendation for {self.path.name}",
            "cases": [str(self.path)],
            "set": self.fixed,
            "paired": points,
            "measure": list(dict.fromkeys([self.bounds.measure, "energy_kept", *TWICE_AS_FINE, STABLE])),
        }

    # -------------------------------------------------------------------------------------------- judgement

    def tried(self) -> list[Tried]:
        """Return the runs, judged by the bounds."""
        rates: dict[tuple[str, str], float] = {}
        for key, candidate in self.candidates.items():
            count, seconds = self._evaluations(key), self.rows[key]["seconds"]
            if math.isfinite(count):
                rate = seconds / count
                rates[candidate.pair] = min(rate, rates.get(candidate.pair, math.inf))
        return [
            self._judged(key, candidate, rates.get(candidate.pair, 0.0)) for key, candidate in self.candidates.items()
        ]

    def _evaluations(self, key: str) -> float:
        """Return the number of steps times nodes times stages of a run, infinite if it was not done."""
        candidate, row = self.candidates[key], self.rows[key]
        if row["status"] != "done" or not row["node_steps"] or row["seconds"] is None:
            return math.inf
        integrator: Any = self.registry.get("integrators", candidate.integrator)
        return float(row["node_steps"] * evaluations(integrator(**candidate.integrator_options)))

    def _judged(self, key: str, candidate: Candidate, rate: float) -> Tried:
        row = self.rows[key]
        # A case may ask that a run goes on though it is known to be unstable.
        done = row["status"] == "done" and row[STABLE] != "no"
        kept = row["energy_kept"]
        error, energy = self._error(candidate, row), None if kept is None else abs(1.0 - kept)
        bounds = self.bounds
        excess = 0.0 if done else math.inf
        for value, bound in ((error, bounds.error), (energy, bounds.energy), (row["seconds"], bounds.seconds)):
            if bound is not None:
                number = math.inf if value is None or not done else float(value)
                excess = max(excess, number / bound if math.isfinite(number) else math.inf)
        count = self._evaluations(key)
        cost = rate * count if math.isfinite(count) else math.inf
        numbers = error, energy, row["seconds"] if done else None
        stable = row[STABLE] if row["status"] == "done" else None
        return Tried(candidate, row["status"], row["reason"], stable, *numbers, count, cost, excess, row["key"])

    def _error(self, candidate: Candidate, row: Mapping[str, Any]) -> float | None:
        """Return the true error of a run, or what a mesh twice as fine changes where errors are estimated."""
        if not self.estimated:
            value = row[self.bounds.measure]
            return None if value is None else float(value)
        finer = self.rows.get(dataclasses.replace(candidate, refine=2 * candidate.refine).key)
        if finer is None or finer["status"] != "done" or row["status"] != "done":
            return None
        changes: list[float] = [
            abs(row[name] - finer[name]) / abs(finer[name]) if finer[name] else abs(row[name]) for name in TWICE_AS_FINE
        ]
        return max(changes)

    def _prediction(self, one: Tried, order: float) -> float:
        """Return the cost at which a run would meet the bounds on a finer mesh, if its excess falls with that order."""
        return one.cost * _power(max(one.excess, 1.0), 2.0 / order)

    def _order(self, one: Tried, meshes: Sequence[Tried]) -> float:
        """Return the order with which the excess of a candidate has fallen from a coarser of its meshes to its own."""
        coarser = [other for other in meshes if other.candidate.refine < one.candidate.refine and other.excess > 0]
        if not coarser or not one.excess > 0:
            return USUAL_ORDER
        nearest = max(coarser, key=lambda other: other.candidate.refine)
        fallen = math.log(nearest.excess / one.excess) / math.log(one.candidate.refine / nearest.candidate.refine)
        return min(max(fallen, ORDERS[0]), ORDERS[1])

    # ----------------------------------------------------------------------------------------------- search

    def answer(self, random: np.random.Generator) -> Recommendation:
        """Search and return the answer."""
        first = [one for one in defaults(*self.methods, self.registry) if self._fits(one)]
        most = int(SHARE_OF_FIRST_RUNS * self.runs)
        pairs = list(dict.fromkeys(one.pair for one in first))
        if len(first) > most:
            first = list({one.pair: one for one in reversed(first)}.values())[::-1]
        if len(first) > most:
            first = [first[k] for k in sorted(random.choice(len(first), most, replace=False))]
        self.untried = len(pairs) - len({one.pair for one in first})
        self.run(first)
        if self.bounds.error is not None and all(one.error is None for one in self.tried()):
            self.estimated = True
            self.run([one.candidate for one in self.tried() if one.status == "done"])
        kept = max(len({one.candidate.pair for one in self.tried()}), FEWEST_PAIRS)
        rounds = 0
        while len(self.candidates) < SHARE_OF_SEARCH * self.runs and not self.interrupted:
            before = len(self.candidates)
            kept = max(kept // 2, FEWEST_PAIRS)
            self.run(self._next(kept, random if rounds < ROUNDS_OF_DRAWS else None))
            rounds += 1
            if len(self.candidates) == before:
                break
        beside = self._improve()
        return self._recommendation(beside)

    def _next(self, kept: int, random: np.random.Generator | None) -> list[Candidate]:
        """Return the candidates of a round, from the pairs that are predicted to meet the bounds at the least cost."""
        runs = [one for one in self.tried() if math.isfinite(one.excess)]
        cheapest = min((one.cost for one in runs if one.meets), default=math.inf)
        meshes: dict[str, list[Tried]] = {}  # of the same methods, options and step
        for one in runs:
            meshes.setdefault(_unrefined(one), []).append(one)
        orders = {one.key: self._order(one, meshes[_unrefined(one)]) for one in runs}
        predicted = sorted(runs, key=lambda one: (self._prediction(one, orders[one.key]), one.candidate.key))
        best: dict[tuple[str, str], Tried] = {}
        for one in predicted:
            best.setdefault(one.candidate.pair, one)
        out = []
        for one in list(best.values())[:kept]:
            order = orders[one.key]
            if not one.meets and self._prediction(one, order) < cheapest:
                factor = min(_power(one.excess, 1.0 / order), 2.0)
                refine = max(math.ceil(one.candidate.refine * factor), one.candidate.refine + 1)
                out.append(dataclasses.replace(one.candidate, refine=min(refine, LARGEST_REFINEMENT)))
            if random is not None:
                out += [drawn(one.candidate, self.registry, random) for _ in range(2)]
        return out

    def _improve(self) -> int | None:
        """Go from the best run to its cheapest neighbour that meets the bounds until there is none; return how many.

        The result is the number of neighbours of the last, None if not all of them could be run.
        """
        while True:
            best = _cheapest(self.tried())
            if best is None:
                return None
            beside = [one for one in neighbours(best.candidate, self.registry) if self._fits(one)]
            self.run(beside)
            if self.interrupted or any(one.key not in self.candidates for one in beside):
                return None
            if _cheapest(self.tried()) == best:
                return len(beside)

    def _recommendation(self, beside: int | None) -> Recommendation:
        if self.made is None:
            raise AssertionError("a search has made no run")
        tried = self.tried()
        best = _cheapest(tried)
        others = [one for one in tried if best is not None and one.candidate.pair != best.candidate.pair]
        known = [one for one in tried if math.isfinite(one.excess)]
        nearest = min(known, key=lambda one: (one.excess, one.cost), default=None) if best is None else None
        return Recommendation(
            self.bounds,
            best,
            _cheapest(others),
            nearest,
            front(known),
            tried,
            self.refused,
            beside,
            self.untried,
            self.estimated,
            self.made,
        )


def _power(base: float, exponent: float) -> float:
    """Return a power of a positive number, infinite where no number is that large."""
    try:
        return math.pow(base, exponent)
    except OverflowError:
        return math.inf


def _unrefined(one: Tried) -> str:
    """Return the key of the candidate of a run on the mesh of the case."""
    return dataclasses.replace(one.candidate, refine=1).key


def _cheapest(runs: Iterable[Tried]) -> Tried | None:
    """Return the cheapest run that meets the bounds; of equal costs that with the least excess."""
    return min(
        (one for one in runs if one.meets), key=lambda one: (one.cost, one.excess, one.candidate.key), default=None
    )


def front(runs: Sequence[Tried]) -> list[Tried]:
    """Return the runs of which none is both cheaper and further within the bounds, by rising cost."""
    rows = front_of(np.array([one.cost for one in runs]), np.array([one.excess for one in runs]))
    return [runs[row] for row in rows]
