"""The explanation of a case before its run: a table of facts; the text shows their words, JSON their values."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from percuss.case.options import PER_AREA, options_of
from percuss.case.quantities import in_unit
from percuss.case.type_words import found
from percuss.certificate.verdict import SHARE_OF_CRITICAL_STEP, certificate
from percuss.contact.laws import parameters, points_of_law
from percuss.contact.pairs import unlike_sides
from percuss.jsonable import Data, Entries
from percuss.march.estimate import bytes_of_run, seconds_of_steps
from percuss.march.recording import recordable
from percuss.mesh.cells import cells_of
from percuss.mesh.size_limits import bytes_in_words
from percuss.methods.interfaces import Component, ContactLaw
from percuss.reporting.component import Explanation, docs
from percuss.reporting.tables import duration
from percuss.reporting.verdict import check_verdict
from percuss.results.doubtful_solids import why_it_must_not_turn, why_not_joined, why_too_stiff
from percuss.results.encounters import expected_meetings
from percuss.results.exact import engine_for

if TYPE_CHECKING:
    from percuss.case.specs import LoadSpec
    from percuss.certificate.criteria import RunCriterion
    from percuss.certificate.verdict import Certificate
    from percuss.contact.model import Model
    from percuss.mesh.body import Body

MOST_LETTERS = 60  # The value of an option, such as a table, is cut after this many letters.


class Fact(NamedTuple):
    """A fact about a run: its key and value in the data, and the lines of the text, with details indented."""

    key: str
    value: object
    words: Sequence[str] = ()
    details: Sequence[str] = ()

    @property
    def lines(self) -> list[str]:
        """All lines of the text."""
        return [*self.words, *(f"  {line}" for line in self.details)]


@np.errstate(all="ignore")  # what is not finite is said in words
def explanation(model: Model, criterion: RunCriterion | None = None) -> Explanation:
    """Return the explanation of a model's run, as text and as data.

    Parameters
    ----------
    model
        The case as arrays.
    criterion
        The criterion with which its step was chosen, if it was (`percuss.certificate.verdict.settled`).
    """
    from percuss.jsonable import plain

    facts = list(_facts(model, certificate(recordable(model), criterion)))
    text = "\n".join(line for fact in facts for line in fact.lines)
    return Explanation(text, plain({fact.key: fact.value for fact in facts}))


def _facts(model: Model, verdict: Certificate) -> Iterator[Fact]:
    """Yield the facts about a run in the order of the text: the verdict first, then the details."""
    case = model.case
    engine, _, why_not_exact = engine_for(model, (model.steps + 1) * model.dt)
    name, refused = engine.name if engine else "", case.time.on_unstable == "stop"
    dt = in_unit(model.dt, 6, "time", case.data.get("units") or {})
    words = list(check_verdict(model.steps, dt, verdict, name, why_not_exact, refused=refused))
    yield Fact("verdict", words, words)
    source = [f"source: {case.source}"] if case.source else []
    yield Fact("title", case.title, ["", case.title or "Untitled case"], source)
    dimensions = f"{model.dim} dimension{'s' if model.dim > 1 else ''}"
    heading = f"Bodies ({model.bodies.n_nodes} nodes in {dimensions})"
    yield _group("bodies", heading, (_body(body, model.steps * model.dt) for body in model.bodies.values()))
    explained: set[str] = set()
    contacts = [_contact(model, name, explained) for name in dict.fromkeys(model.contact_points.names)]
    yield _group("contacts", "Contacts" if contacts else "No contact", contacts)
    yield _group("loads", "Loads" if case.loads else "", (_load(spec) for spec in case.loads.values()))
    yield _step(model, verdict)
    seconds, size = seconds_of_steps(model), bytes_of_run(model)
    time = "less than 1 s" if seconds < 1.0 else f"about {duration(seconds)}"
    takes = f"the steps take {time} once they are compiled"
    if model.rows_at(0.5 * model.dt).other.size:
        takes += ", more if many coupled contact points press"  # the number of sweeps over them is not known
    takes += f", and the run about {bytes_in_words(size)} of memory, estimated"
    yield Fact("estimate", {"seconds": seconds, "bytes": size}, [], [takes])
    yield Fact("nodes", model.bodies.n_nodes)
    yield Fact("certificate", verdict, ["Stability of the closed linear step"], [verdict["why"]])
    measured = _measured_energy(model, verdict["energy"])
    energy = [f"measured, {law}: {told}" for law, told in measured.items()]
    energy = [f"{verdict['energy']}: {verdict['energy_why']}", *energy]
    yield Fact("measured", measured, ["Energy over opening and closing"], energy)
    yield Fact("exact", {"name": name, "why": why_not_exact})
    used = _components(model) + ([engine] if engine else [])
    yield _group("methods", "Methods", (_method(model, component) for component in used))
    notes = [*case.notes, *unlike_sides(case, model.bodies), *verdict["ignores"], *expected_meetings(model)]
    yield Fact("notes", notes, [f"note: {note}" for note in notes])


def _group(key: str, heading: str, facts: Iterable[Fact]) -> Fact:
    """Return facts of one kind as one fact, whose value is theirs by key, with a heading over their words."""
    facts = list(facts)
    lines = [line for fact in facts for line in fact.lines]
    return Fact(key, {fact.key: fact.value for fact in facts}, list(filter(None, [heading])), lines)


def _options(component: Component, *, with_defaults: bool) -> dict[str, str]:
    """Return the options of a component as a case would write them: those given, or all that differ from defaults."""
    pairs = {
        option.key: (getattr(component, option.field), None if with_defaults else option.default)
        for option in options_of(type(component)).values()
    }
    return {key: _short_text(value) for key, (value, usual) in pairs.items() if value is not usual and value != usual}


def _short_text(value: Any) -> str:
    text = f"{value:.9g}" if isinstance(value, float) else found(getattr(value, "path", value))
    return text if len(text) <= MOST_LETTERS else f"{text[:MOST_LETTERS]}..."


def _assignments(values: Data) -> str:
    return ", ".join(f"{key} = {value}" for key, value in values.items())


def _per_area(model: Model, law: ContactLaw, values: Data) -> Data:
    """Return values of a law by name, with the word that those of surfaces which are per area need."""
    known = {} if model.bodies.of_lines else options_of(type(law))
    return {
        key: f"{value} per area" if key in known and known[key].unit in PER_AREA else value
        for key, value in values.items()
    }


def _numbers_as_text(values: Mapping[str, float]) -> dict[str, str]:
    return {key: f"{value:.6g}" for key, value in values.items()}


# ---------------------------------------------------------------------------------------------- bodies, step


def _body(body: Body, end: float) -> Fact:
    """Return a body: its mesh, its material, the speed of its waves, and what is known against it until the end."""
    spec, material = body.spec, body.spec.material
    c = math.sqrt(body.modulus / material.rho)
    about: Entries = {"c": c, "why_not_linear": body.why_not_linear}
    mesh, section, waves = _along_line(body, c, about) if body.mesh.line is not None else _of_cells(body, about)
    moves = f", velocity {found(spec.velocity)}" if np.any(body.velocity) else ""
    moves += f", spin {found(spec.spin)}" if np.any(spec.spin) else ""
    fixed = f", fixed at {', '.join(map(str, spec.fixed))}" if spec.fixed else ""
    words = (
        f"{body.name}: {spec.shape.name} of {mesh}, {material.name} "
        f"({_assignments(_options(material, with_defaults=False))}), {section}{moves}{fixed}"
    )
    details = [
        f"c = {c:.6g}{waves}",
        *why_not_joined(body),
        *filter(None, (why_too_stiff(body), why_it_must_not_turn(body, float(np.linalg.norm(spec.spin)) * end))),
    ]
    if body.why_not_linear:
        follows = "c, EA/h, 2c/h and all that follows from them are those of its modulus, whatever its strain"
        details += [body.why_not_linear, follows]
    return Fact(body.name, about, [words], details)


def _along_line(body: Body, c: float, about: Entries) -> tuple[str, str, str]:
    """Add what is known of a bar; return its mesh, its section and its waves in words."""
    material, h = body.spec.material, body.mesh.lengths
    about["elements"], about["h"] = int(h.size), [float(h.min()), float(h.max())]
    about["transit"] = float(h.sum()) / c
    about["impedance"] = body.spec.section * math.sqrt(material.modulus * material.rho)
    size = f"h = {h.min():.6g}" if np.ptp(h) < 1e-9 * h.max() else f"h from {h.min():.6g} to {h.max():.6g}"
    nodes = f" of {cells_of(body.mesh).shape[1]} nodes" if body.of_cells else ""
    waves = "".join(f", {name} {about[name]:.6g}" for name in ("transit", "impedance"))
    return f"{h.size} elements{nodes}, {size}", f"area {body.spec.section:.6g}", waves


def _of_cells(body: Body, about: Entries) -> tuple[str, str, str]:
    """Add what is known of a body that is no bar; return its mesh, its section and its waves in words."""
    plane = body.view.plane
    about["elements"], about["nodes"], about["plane"] = body.count, int(body.mass.size), plane
    about["mass"] = float(body.mass.sum())
    section = f"plane {plane}, thickness {body.spec.section:.6g}" if plane else "three dimensions"
    section = "a body of revolution about x = 0" if plane == "axisymmetric" else section
    mesh = f"{body.count} cells {body.spec.element.name} and {body.mass.size} nodes"
    return mesh, f"{section}, mass {about['mass']:.6g}", " of longitudinal waves"


def _step(model: Model, verdict: Certificate) -> Fact:
    """Return the time step, the element with the highest frequency, the origin of the step, and the critical steps."""
    time = model.case.time
    body = max(model.bodies.values(), key=lambda body: float(body.frequency.max()))
    element = int(np.argmax(body.frequency))
    smallest = 2.0 / model.bodies.omega
    where = "every element" if np.ptp(body.frequency) <= 1e-9 * model.bodies.omega else f"element {element}"
    size = "2/omega" if body.of_cells else "h/c"  # omega is the highest frequency, 2c/h of a two-node bar
    how = f"dt = {model.dt:.9g}"
    if time.step is not None:
        how += " as given, "
    elif time.courant == "auto":
        found_step = model.dt / SHARE_OF_CRITICAL_STEP
        how += f", chosen as {SHARE_OF_CRITICAL_STEP} of the critical step {found_step:.9g}: "
    else:
        how = f"dt = {model.courant:.6g} {'* ' if body.of_cells else ''}{size} = {model.dt:.9g}, "
    value = {
        "dt": model.dt,
        "courant": model.courant,
        "smallest_transit": smallest,
        "body": body.name,
        "element": element,
        "steps": model.steps,
        "end": model.steps * model.dt,
    }
    details = [
        f"{how}Courant number {model.courant:.6g} of the smallest {size} = {smallest:.9g}, that of {where} of body "
        f"'{body.name}'; {model.steps} steps to {model.steps * model.dt:.9g}",
    ]
    if verdict["dt_critical_free"] is not None:
        critical = "is unknown" if verdict["dt_critical"] is None else f"{verdict['dt_critical']:.9g}"
        details.append(
            f"the bodies without contact{' but ties' if model.tied_points else ''} allow "
            f"{verdict['dt_critical_free']:.9g}, the worst combination of closed contacts {critical}"
        )
    return Fact("step", value, ["Step"], details)


def _measured_energy(model: Model, energy: str) -> dict[str, str]:
    """Return by contact law the measured energy behaviour with the integrator, unless energy is known never to grow."""
    # The measurements were made with linear bars, so they do not hold for other bodies.
    if energy == "never grows" or model.bodies.why_not_linear or not model.bodies.of_lines:
        return {}
    integrator = model.case.method.integrator.name
    laws = [bound_law.law for bound_law in model.laws]
    return {law.name: law.measured[integrator] for law in laws if integrator in law.measured}


# -------------------------------------------------------------------------------------------------- contacts


def _contact(model: Model, name: str, explained: set[str]) -> Fact:
    """Return a contact: its sides, gap and law, the numbers given to the law, and its linear law if there is one.

    The formula of a law is told once; `explained` has the names of those that were.
    """
    points, number = model.contact_points, model.contact_points.names.index(name)
    spec, law, own = model.case.contacts[name], points.laws[number], points.contact == points.contact[number]
    stiffness, mass, frequency = names = _names_at_end(model, number)
    at_end = [float(values[number]) for values in (points.stiffness, points.mass, points.frequency)]
    s_formula = model.why("delassus") if model.balanced[number] else "N^T M^-1 N"
    value: Entries = {
        "sides": [str(side) for side in spec.sides] + (["a rigid wall"] if spec.wall is not None else []),
        "gap": float(points.gap[own].min()),
        "law": law.name,
        "given": _options(law, with_defaults=False),
        "resolved": {key: one for key, one in parameters(model)[name].items() if key != "law"},
        "chosen": dict(law.chosen(points_of_law(model, [number], model.dt), model.dt)),
        "point": dict(zip(names, at_end, strict=True)) | {"s": float(model.rows_at(0.5 * model.dt).delassus[number])},
    }
    value["row"] = _linear_law_data(model, number, value["point"]["s"])
    gap = "touching" if value["gap"] == 0 else f"gap {value['gap']:.9g}"
    words = f"{name}: {' and '.join(value['sides'])}, {gap}; {law.name}: {law.summary}"
    details = [] if law.name in explained else docs(type(law)).formula.splitlines()
    explained.add(law.name)
    details.append(f"given: {_assignments(_per_area(model, law, value['given'])) or 'nothing, all by default'}")
    details += [f"{option} {chosen}" for option, chosen in value["chosen"].items()]
    point = _numbers_as_text(value["point"])
    details.append(
        f"with {stiffness} = {point[stiffness]} and {mass} = {point[mass]} of the softer side, "
        f"{'omega = ' if frequency != 'omega' else ''}{frequency} = {point[frequency]}, "
        f"s = {s_formula} = {point['s']}, dt = {model.dt:.6g}"
    )
    if frequency == "omega":
        details.append("m is the mass of an element at its end, omega its highest frequency, beta_s over m omega^2 / 2")
    if (count := int(own.sum())) > 1:
        area, covered = model.bodies[spec.sides[0].body].area_of(spec.sides[0].region), sum(points.weight[own].tolist())
        gaps = f"gaps from {value['gap']:.6g} to {points.gap[own].max():.6g}"
        details.append(f"{count} points on {covered:.6g} of the area {area:.6g} of {spec.sides[0]}, {gaps}")
        value |= {"points": count, "area": area, "covered": covered}
    details += filter(None, [_assignments(_per_area(model, law, _numbers_as_text(value["resolved"])))])
    if value["row"] is None:
        details.append(f"{law.name} is no row of the contact equation: its own kernel gives the force")
    else:
        details += _linear_law_lines(value["row"])
        if value["row"]["acceleration"] and not value["row"]["sees_acceleration"]:
            details.append(f"g'' counts as 0: {law.needs_only_response_of['acceleration']}")
    return Fact(name, value, [words], details)


def _linear_law_data(model: Model, number: int, s: float) -> Entries | None:
    """Return the linear law of a contact as the integrator evaluates it, or None where the law has its own kernel."""
    bound_law = next(bound_law for bound_law in model.laws if number in bound_law.where)
    linear = bound_law.linear
    if linear is None:
        return None
    record = model.records_of(bound_law, model.tables[-1], bound_law.points.delassus)[bound_law.where.index(number)]
    numbers = {name: float(record[field]) for name, field in OF_RECORD.items()}
    judged = "predicted" if record["sees_predicted_gap"] else "current"
    return {
        "at": linear.at,
        "judged": "balanced" if model.balanced[number] else judged,
        "sees_acceleration": bool(record["sees_acceleration"]),
        "active": linear.active,
        "sign": linear.sign,
        **numbers,
        "stiffness": 1.0 / (numbers["sigma"] + numbers["w"] * s),
    }


def _names_at_end(model: Model, number: int) -> tuple[str, str, str]:
    """Return the names of stiffness, mass and frequency of the sides of a contact (`ContactPoints`)."""
    if not model.bodies.of_lines:
        return "M w/h", "rho w h / 2", "2c/h"
    if any(model.bodies.at(node).of_cells for node in model.contact_points.nodes_of(number)):
        return "m omega^2 / 2", "m", "omega"
    return "EA/h", "rho A h / 2", "2c/h"


# The numbers of a linear law, by their names in the record of a contact point.
OF_RECORD = {
    "sigma": "sigma",
    "gap": "weight_gap",
    "rate": "weight_rate",
    "acceleration": "weight_acceleration",
    "w": "response",
}
BALANCED_GAP = "the gap at t_n, in static balance of the end without mass, whatever the integrator"


def _linear_law_lines(law: Data) -> Iterator[str]:
    """Yield a linear law with its numbers in words, and the multiplier that follows if only this contact is closed."""
    terms = [(law["gap"], "g"), (law["rate"], "g'"), (law["acceleration"], "g''")]
    parts = [f"{'' if weight == 1.0 else f'{weight:.6g} '}{name}" for weight, name in terms if weight]
    right = f"-{' - '.join(parts)}" if parts else "0"
    state = {
        ("end", "predicted"): "the gap at the end of the step",
        ("explicit", "predicted"): "the predicted gap",
        ("explicit", "balanced"): BALANCED_GAP,
        ("end", "balanced"): BALANCED_GAP,
    }.get((law["at"], law["judged"]), "the current gap")
    remark = "" if law["sees_acceleration"] or not law["acceleration"] else ", g'' counts as 0"
    left = f"{law['sigma']:.6g} lambda" if law["sigma"] else "0"
    when = "while g < 0" if law["active"] == "gap < 0" else "at all times"
    sign = "lambda may be of either sign"
    if law["sign"] != "free":
        relation, sign = f"{left} >= {right}", "lambda >= 0, and one of the two is an equation"
    else:
        relation = f"{left} = {right}"
    yield f"{relation} {when}, where g is {state}{remark}; {sign}"
    if remark:
        right = f"-{' - '.join(parts[:-1])}"
    yield (
        f"closed alone: lambda = ({right}) / (sigma + w s) = {law['stiffness']:.6g} ({right}), "
        f"sigma = {law['sigma']:.6g}, w = {law['w']:.6g}"
    )


# ------------------------------------------------------------------------------------------- loads, methods


def _load(spec: LoadSpec) -> Fact:
    """Return a load: where and when it acts, and its options."""
    targets = ", ".join(map(str, spec.on)) or "every body"
    times = {"from": spec.start, "until": spec.stop}
    when = "".join(f" {word} {instant:.6g}" for word, instant in times.items() if math.isfinite(instant))
    clock = "; its time counts from there" if math.isfinite(spec.start) and spec.start > 0 else ""
    along = f"along {list(spec.direction)}" if spec.direction is not None else "along the body"
    options = _options(spec.load, with_defaults=True)
    formula = docs(type(spec.load)).formula
    value = {"load": spec.load.name, "as": spec.acts_as, "on": list(map(str, spec.on)), "options": options}
    text = f"{spec.name}: {spec.load.name} as {spec.acts_as} on {targets} {along}{when}{clock}; {_assignments(options)}"
    return Fact(spec.name, value, [text], list(filter(None, [" ".join(formula.split())])))


def _components(model: Model) -> list[Component]:
    """Return one instance of each component that the run uses, without the exact solution."""
    case = model.case
    components: list[Component] = [case.method.integrator, *model.contact_points.laws]
    components += [load.load for load in case.loads.values()]
    components += [part for body in case.bodies.values() for part in (body.shape, body.material, body.element)]
    components += filter(None, (case.method.mass, *(contact.pairing for contact in case.contacts.values())))
    return list({type(component): component for component in components}.values())


def _method(model: Model, component: Component) -> Fact:
    """Return a component: what it is, its formula, its order, what it conserves, and its references."""
    facts: Entries = {fact: getattr(component, fact) for fact in ("order", "conserves") if hasattr(component, fact)}
    value: Entries = {
        "family": component.family,
        "summary": component.summary,
        "formula": docs(type(component)).formula,
        "facts": facts,
        "references": list(component.references),
    }
    # The formulas of contacts and loads stand with each of them.
    details: list[str] = [] if component.family in {"contacts", "loads"} else value["formula"].splitlines()
    properties = [f"order {facts['order']}"] if "order" in facts else []
    properties += [f"conserves {' and '.join(facts['conserves'])} without contact"] if facts.get("conserves") else []
    details += filter(None, ["; ".join(properties)])
    details += [f"see {reference}" for reference in component.references]
    if component.family == "integrators":
        details += filter(None, [model.why("step")])
        details += model.stages.in_words if model.stages else ()
    words = [f"{component.name} ({component.family}): {component.summary}"]
    return Fact(f"{component.family}/{component.name}", value, words, details)
