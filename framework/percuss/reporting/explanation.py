"""The explanation of a case before its run, in words and formulas that hold the numbers of the case."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.options import options_of
from percuss.case.type_words import found
from percuss.certificate.verdict import SHARE_OF_CRITICAL_STEP, certificate
from percuss.methods.interfaces import Component
from percuss.reporting.component import Explanation, docs
from percuss.results.encounters import expected_meetings
from percuss.results.exact import engine_for
from percuss.solver.bound_law import OF_END_FORCE
from percuss.solver.cells import cells_of
from percuss.solver.contact_problem import contact_problem
from percuss.solver.contact_rows import law_records
from percuss.solver.recording import recordable

if TYPE_CHECKING:
    from percuss.case.specs import LoadSpec
    from percuss.certificate.criteria import RunCriterion
    from percuss.solver.entities import ContactPair
    from percuss.solver.model import Model

MOST_LETTERS = 60  # The value of an option, such as a table, is cut after this many letters.


@np.errstate(all="ignore")  # what is not finite is said in words
def explanation(model: Model, criterion: RunCriterion | None = None) -> Explanation:
    """Return the explanation of a model's run: bodies, contacts, loads, step, stability, exact solution and methods.

    Parameters
    ----------
    model
        The case as arrays.
    criterion
        The criterion with which its step was chosen, if it was (`percuss.certificate.verdict.settled`).
    """
    from percuss.jsonable import plain

    verdict = certificate(recordable(model), criterion)
    measured = _measured_energy(model, verdict["energy"])
    contacts = [_contact_data(model, p, contact_pair) for p, contact_pair in enumerate(model.contact_pairs)]
    loads = [_load_data(spec) for spec in model.case.loads.values()]
    step, exact = _step_data(model), _exact_solution(model)
    methods = [_method_data(component) for component in _components(model)]
    case = model.case
    lines = [case.title or "Untitled case"]
    lines += [f"  source: {case.source}"] if case.source else []
    lines += _body_lines(model)
    lines += ["Contacts" if contacts else "No contact"]
    explained_laws: set[str] = set()
    for contact in contacts:
        lines += _contact_lines(model, contact, explained_laws)
    lines += ["Loads"] if loads else []
    lines += [f"  {load['text']}" for load in loads]
    lines += ["Step", f"  {step['text']}"]
    if verdict["dt_critical_free"] is not None:
        critical = "is unknown" if verdict["dt_critical"] is None else f"{verdict['dt_critical']:.9g}"
        lines.append(
            f"  the bodies without contact{' but ties' if model.tied_points else ''} allow "
            f"{verdict['dt_critical_free']:.9g}, the worst combination of closed contacts {critical}"
        )
    lines += _certificate_lines(model, verdict, measured)
    lines += ["Exact solution"]
    lines += (
        [f"  {exact['name']} will tell the true error of the run"] if exact["name"] else [f"  none: {exact['why']}"]
    )
    lines += ["Methods"]
    for method in methods:
        lines += _method_lines(method)
        lines += _stage_lines(model) if method["family"] == "integrators" else []
    notes = [*case.notes, *verdict["ignores"], *expected_meetings(model)]
    lines += [f"note: {note}" for note in notes]
    data = {
        "title": case.title,
        "dt": model.dt,
        "steps": model.steps,
        "courant": model.courant,
        "step": step,
        "certificate": verdict,
        "contacts": {contact["name"]: contact["resolved"] | {"law": contact["law"]} for contact in contacts},
        "rows": {contact["name"]: contact for contact in contacts},
        "chosen": {contact["name"]: contact["chosen"] for contact in contacts},
        "loads": loads,
        "exact": exact,
        "methods": methods,
        "measured": measured,
        "nodes": model.n_nodes,
        "notes": notes,
    }
    return Explanation("\n".join(lines), plain(data))


def _non_default_options(component: Component) -> dict[str, str]:
    """Return the options of a component that differ from their defaults, as a case would write them."""
    values = {
        option.key: (getattr(component, option.field), option.default)
        for option in options_of(type(component)).values()
    }
    return {
        key: _short_text(value) for key, (value, default) in values.items() if value is not default and value != default
    }


def _short_text(value: Any) -> str:
    text = f"{value:.9g}" if isinstance(value, float) else found(getattr(value, "path", value))
    return text if len(text) <= MOST_LETTERS else f"{text[:MOST_LETTERS]}..."


def _assignments(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {value}" for key, value in values.items())


def _numbers_as_text(values: Mapping[str, float]) -> dict[str, str]:
    return {key: f"{value:.6g}" for key, value in values.items()}


def _stage_lines(model: Model) -> list[str]:
    """Return the lines about the stages of a multi-stage scheme; none for a leap-frog scheme."""
    if model.own_steps:
        steps = ", ".join(f"{number} in '{name}'" for name, number in zip(model.bodies, model.own_steps, strict=True))
        return [
            f"    bodies have steps of their own: steps from one action of the internal forces to the next, {steps}; "
            "contacts and loads on ends act in every step",
        ]
    if model.implicit:
        return [
            "    implicit, in NumPy and SciPy: a reference that shows what implicit costs, and no contender; contact "
            "is solved at the end of each step, an explicit penalty too",
            "    forces, works and energies are those at t_n; what the scheme takes from bodies is dissipated energy",
        ]
    if model.stages is None:
        return []
    times = ", ".join(f"{time:.6g}" for time in model.stages.times)
    end = (
        "is evaluated there too, ahead to the next stage" if model.stages.end else "has no place in it, and is refused"
    )
    return [
        f"    no leap-frog scheme: accelerations, contact included, at {times} of each step; a law evaluated at "
        f"the end of the step {end}",
        "    forces and impulses are those of whole steps; energies stand at the end of each, and their closure counts "
        "what the scheme itself gains or loses",
    ]


# ---------------------------------------------------------------------------------------------- bodies, step


def _body_lines(model: Model) -> list[str]:
    lines = [f"Bodies ({model.n_nodes} nodes in {model.dim} dimension{'s' if model.dim > 1 else ''})"]
    for body in model.bodies.values():
        material = body.spec.material
        c = math.sqrt(material.modulus / material.rho)
        length = float(body.mesh.lengths.sum())
        h = body.mesh.lengths
        size = f"h = {h.min():.6g}" if np.ptp(h) < 1e-9 * h.max() else f"h from {h.min():.6g} to {h.max():.6g}"
        nodes = f" of {cells_of(body.mesh).shape[1]} nodes" if body.mesh.cells else ""
        moves = f", velocity {found(body.spec.velocity)}" if np.any(body.velocity) else ""
        lines.append(
            f"  {body.name}: {body.spec.shape.name} of {h.size} elements{nodes}, {size}, {material.name} "
            f"({_assignments(_non_default_options(material))}), area {body.spec.area:.6g}{moves}"
            + (f", fixed at {', '.join(body.spec.fixed)}" if body.spec.fixed else "")
        )
        lines.append(
            f"    c = {c:.6g}, transit {length / c:.6g}, "
            f"impedance {body.spec.area * math.sqrt(material.modulus * material.rho):.6g}"
        )
        if body.why_not_linear:
            lines.append(f"    {body.why_not_linear}")
            lines.append(
                "    c, EA/h, 2c/h and all that follows from them are those of its modulus, whatever its strain"
            )
    return lines


def _step_data(model: Model) -> dict[str, Any]:
    """Return the time step, the element with the highest frequency, and the origin of the step in words."""
    time = model.case.time
    body = max(model.bodies.values(), key=lambda body: float(body.frequency.max()))
    element = int(np.argmax(body.frequency))
    smallest = 2.0 / model.omega
    where = "every element" if np.ptp(body.frequency) <= 1e-9 * model.omega else f"element {element}"
    size = "2/omega" if body.mesh.cells else "h/c"  # omega is the highest frequency, 2c/h of a two-node bar
    of = f"the smallest {size} = {smallest:.9g}, that of {where} of body '{body.name}'"
    if time.step is not None:
        how = f"dt = {model.dt:.9g} as given, Courant number {model.courant:.6g} of {of}"
    elif time.courant == "auto":
        critical = model.dt / SHARE_OF_CRITICAL_STEP
        how = (
            f"dt = {model.dt:.9g}, chosen as {SHARE_OF_CRITICAL_STEP} of the critical step {critical:.9g}: "
            f"Courant number {model.courant:.6g} of {of}"
        )
    else:
        times = "* " if body.mesh.cells else ""
        how = f"dt = {model.courant:.6g} {times}{size} = {model.dt:.9g}, Courant number {model.courant:.6g} of {of}"
    return {
        "dt": model.dt,
        "courant": model.courant,
        "smallest_transit": smallest,
        "body": body.name,
        "element": element,
        "steps": model.steps,
        "end": model.steps * model.dt,
        "text": f"{how}; {model.steps} steps to {model.steps * model.dt:.9g}",
    }


def _certificate_lines(model: Model, verdict: Mapping[str, Any], measured: Mapping[str, str]) -> list[str]:
    lines = ["Stability of the closed linear step", f"  {verdict['stable']}: {verdict['why']}"]
    if verdict["stable"] == "no":
        warns = model.case.time.on_unstable == "warn"
        lines.append("  the run goes on all the same (on_unstable: warn)" if warns else "  the run is not started")
        lines.append(f"  to be stable, {verdict['cure']}")
    lines += ["Energy over opening and closing", f"  {verdict['energy']}: {verdict['energy_why']}"]
    return lines + [f"  measured, {law}: {words}" for law, words in measured.items()]


def _measured_energy(model: Model, energy: str) -> dict[str, str]:
    """Return by contact law the measured energy behaviour with the integrator, unless energy is known never to grow."""
    # The measurements were made with linear bodies, so they do not hold for other bodies.
    if energy == "never grows" or model.why_not_linear:
        return {}
    integrator = model.case.method.integrator.name
    laws = [bound_law.law for bound_law in model.laws]
    return {law.name: law.measured[integrator] for law in laws if integrator in law.measured}


def _exact_solution(model: Model) -> dict[str, str]:
    """Return the name of the exact solution that judges the run, or the reasons why none does."""
    engine, why = engine_for(model, contact_problem(model), (model.steps + 1) * model.dt)
    return {"name": engine.name if engine else "", "why": why}


# -------------------------------------------------------------------------------------------------- contacts


def _contact_data(model: Model, number: int, contact_pair: ContactPair) -> dict[str, Any]:
    """Return the data of a contact: its sides, gap and law, the numbers given to the law, and its linear law if any."""
    spec = model.case.contacts[contact_pair.name]
    s = float(model.delassus(0.5 * model.dt)[number])
    points = model.points([number], model.dt)
    resolved = {key: value for key, value in model.parameters()[contact_pair.name].items() if key != "law"}
    return {
        "name": contact_pair.name,
        "sides": [str(side) for side in spec.sides] + (["a rigid wall"] if spec.wall is not None else []),
        "gap": contact_pair.gap,
        "law": contact_pair.law.name,
        "given": _non_default_options(contact_pair.law),
        "resolved": resolved,
        "chosen": dict(contact_pair.law.chosen(points, model.dt)),
        "point": {
            **dict(
                zip(
                    _names_at_end(model, contact_pair),
                    (contact_pair.stiffness, contact_pair.mass, contact_pair.frequency),
                    strict=True,
                )
            ),
            "s": s,
        },
        "s_formula": "1/(k dt^2) of each end without mass" if model.points_without_mass[number] else "N^T M^-1 N",
        "row": _linear_law_data(model, number, s),
    }


def _linear_law_data(model: Model, number: int, s: float) -> dict[str, Any] | None:
    """Return the linear law of a contact as the integrator evaluates it, or None where the law has its own kernel."""
    bound_law = next(bound_law for bound_law in model.laws if number in bound_law.where)
    linear = bound_law.linear
    if linear is None or model.implicit:
        return None
    massless = model.points_without_mass[list(bound_law.where)]
    records = law_records(bound_law, model.tables[-1], bound_law.points.delassus, massless, model.dt)
    record = records[bound_law.where.index(number)]
    w = float(record["response"])
    judged = "predicted" if record["sees_predicted_gap"] else "current"
    end_force = model.end_forces(0.5 * model.dt).get(number)
    if end_force is not None:
        s = sum(float(side.sees @ side.response) for side in end_force.sides)
    return {
        "at": linear.at,
        "judged": "balanced" if massless[bound_law.where.index(number)] else judged,
        "sees_acceleration": bool(record["sees_acceleration"]),
        "sigma": float(record["sigma"]),
        "gap": float(record["weight_gap"]),
        "rate": float(record["weight_rate"]),
        "acceleration": float(record["weight_acceleration"]),
        "active": linear.active,
        "sign": linear.sign,
        "w": w,
        **{name: float(getattr(linear, name)[bound_law.where.index(number)]) for name in OF_END_FORCE},
        "stiffness": 1.0 / (float(record["sigma"]) + w * s),
    }


def _names_at_end(model: Model, contact_pair: ContactPair) -> tuple[str, str, str]:
    """Return the names of stiffness, mass and frequency of the ends in contact (`ContactPoints`)."""
    if any(model.body_of(node).mesh.cells for node in contact_pair.nodes):
        return "m omega^2 / 2", "m", "omega"
    return "EA/h", "rho A h / 2", "2c/h"


def _contact_lines(model: Model, contact: Mapping[str, Any], explained_laws: set[str]) -> list[str]:
    """Return the lines about a contact, with the formula of its law unless the law is in `explained_laws`.

    The law is added to `explained_laws`.
    """
    gap = "touching" if contact["gap"] == 0 else f"gap {contact['gap']:.9g}"
    law = next(bound_law.law for bound_law in model.laws if bound_law.law.name == contact["law"])
    lines = [f"  {contact['name']}: {' and '.join(contact['sides'])}, {gap}; {law.name}: {law.summary}"]
    if law.name not in explained_laws:
        lines += [f"    {line}" for line in docs(type(law)).formula.splitlines()]
        explained_laws.add(law.name)
    lines.append(f"    given: {_assignments(contact['given']) or 'nothing, all by default'}")
    lines += [f"    {option} {words}" for option, words in contact["chosen"].items()]
    point = _numbers_as_text(contact["point"])
    stiffness, mass, frequency = list(point)[:3]
    of_bars = "omega = " if frequency != "omega" else ""
    lines.append(
        f"    with {stiffness} = {point[stiffness]} and {mass} = {point[mass]} of the softer side, "
        f"{of_bars}{frequency} = {point[frequency]}, s = {contact['s_formula']} = {point['s']}, dt = {model.dt:.6g}"
    )
    if frequency == "omega":
        lines.append(
            "    m is the mass of an element at its end, omega its highest frequency, beta_s over m omega^2 / 2"
        )
    lines += [f"    {_assignments(_numbers_as_text(contact['resolved']))}"] if contact["resolved"] else []
    if model.implicit:
        return [
            *lines,
            "    solved at the end of the step with N^T K_eff^-1 N of the whole bodies, which adds to sigma",
        ]
    if contact["row"] is None:
        return [*lines, f"    {law.name} is no row of the contact equation: its own kernel gives the force"]
    lines += [f"    {line}" for line in _linear_law_lines(contact["row"])]
    if contact["row"]["acceleration"] and not contact["row"]["sees_acceleration"]:
        lines.append(f"    g'' counts as 0: {law.needs_only_response_of['acceleration']}")
    return lines


BALANCED_GAP = "the gap at t_n, in static balance of the end without mass, whatever the integrator"


def _linear_law_lines(law: Mapping[str, Any]) -> Iterator[str]:
    """Yield a linear law with its numbers in words, and the multiplier that follows if only this contact is closed."""
    terms = [(law["gap"], "g"), (law["rate"], "g'"), (law["acceleration"], "g''")]
    right = " ".join(f"- {'' if weight == 1.0 else f'{weight:.6g} '}{name}" for weight, name in terms if weight)
    right = right.replace("- ", "-", 1) or "0"
    state = {
        ("end", "predicted"): "the gap at the end of the step",
        ("explicit", "predicted"): "the predicted gap",
        ("explicit", "balanced"): BALANCED_GAP,
        ("end", "balanced"): BALANCED_GAP,
    }.get((law["at"], law["judged"]), "the current gap")
    if law["sees"]:
        state += f" + {law['sees']:.6g} F"
    remark = "" if law["sees_acceleration"] or not law["acceleration"] else ", g'' counts as 0"
    left = f"{law['sigma']:.6g} lambda" if law["sigma"] else "0"
    when = "while g < 0" if law["active"] == "gap < 0" else "at all times"
    sign = "lambda may be of either sign"
    if law["sign"] != "free":
        relation, sign = f"{left} >= {right}", "lambda >= 0, and one of the two is an equation"
    else:
        relation = f"{left} = {right}"
    yield f"{relation} {when}, where g is {state}{remark}; {sign}"
    if pushed := [
        *([f"lambda pushes N + {law['pushes']:.6g} Sigma"] if law["pushes"] else []),
        *([f"{law['softens']:.6g} Sigma F_n acts at all times"] if law["softens"] else []),
    ]:
        yield "; ".join(pushed)
    if law["sees"] or pushed:
        yield "F = Sigma^T u is the mean normal force of the end elements, and s is that of what is seen and pushed"
    if remark:
        right = " ".join(right.split(" ")[:-3]) if right.count(" ") > 2 else right.split(" - ")[0]
    yield (
        f"closed alone: lambda = ({right}) / (sigma + w s) = {law['stiffness']:.6g} ({right}), "
        f"sigma = {law['sigma']:.6g}, w = {law['w']:.6g}"
    )


# ------------------------------------------------------------------------------------------- loads, methods


def _load_data(spec: LoadSpec) -> dict[str, Any]:
    targets = ", ".join(str(address) for address in spec.on) or "every body"
    when = "".join(
        f" {word} {instant:.6g}"
        for word, instant in (("from", spec.start), ("until", spec.stop))
        if math.isfinite(instant)
    )
    clock = "; its time counts from there" if math.isfinite(spec.start) and spec.start > 0 else ""
    along = f"along {list(spec.direction)}" if spec.direction is not None else "along the body"
    options = {
        option.key: _short_text(getattr(spec.load, option.field))
        for option in options_of(type(spec.load)).values()
        if getattr(spec.load, option.field) is not None
    }
    formula = docs(type(spec.load)).formula
    text = f"{spec.name}: {spec.load.name} as {spec.acts_as} on {targets} {along}{when}{clock}; {_assignments(options)}"
    return {
        "name": spec.name,
        "load": spec.load.name,
        "as": spec.acts_as,
        "on": [str(address) for address in spec.on],
        "options": options,
        "formula": formula,
        "text": f"{text}\n    {' '.join(formula.split())}" if formula else text,
    }


def _components(model: Model) -> list[Component]:
    """Return one instance of each component that the run uses, including the exact solution."""
    case = model.case
    components: list[Component] = [case.method.integrator, *(contact_pair.law for contact_pair in model.contact_pairs)]
    components += [load.load for load in case.loads.values()]
    components += [part for body in case.bodies.values() for part in (body.shape, body.material, body.element)]
    components.append(case.method.mass)
    exact = _exact_solution(model)["name"]
    components += [case.registry.get("solutions", exact)()] if exact else []
    return list({type(component): component for component in components}.values())


def _method_data(component: Component) -> dict[str, Any]:
    facts = {fact: getattr(component, fact) for fact in ("order", "conserves") if hasattr(component, fact)}
    return {
        "family": component.family,
        "name": component.name,
        "summary": component.summary,
        "formula": docs(type(component)).formula,
        "facts": facts,
        "references": list(component.references),
    }


def _method_lines(method: Mapping[str, Any]) -> list[str]:
    lines = [f"  {method['name']} ({method['family']}): {method['summary']}"]
    # The formulas of contact laws and loads stand with the contacts and loads themselves.
    lines += [f"    {line}" for line in method["formula"].splitlines() if method["family"] not in {"contacts", "loads"}]
    properties = [f"order {method['facts']['order']}"] if "order" in method["facts"] else []
    conserves = " and ".join(method["facts"].get("conserves", ()))
    properties += [f"conserves {conserves} without contact"] if conserves else []
    lines += [f"    {'; '.join(properties)}"] if properties else []
    return lines + [f"    see {reference}" for reference in method["references"]]
