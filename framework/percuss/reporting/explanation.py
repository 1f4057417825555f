"""Say in words and formulas what a case will do, with the numbers of the case filled in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.options import options_of
from percuss.case.type_words import found
from percuss.certificate.verdict import SAFETY, certificate
from percuss.methods.interfaces import Component, LinearLaw
from percuss.reporting.component import docs
from percuss.results.exact import why_not_covered
from percuss.solver.contact_rows import broadcast, law_records
from percuss.solver.recording import recordable

if TYPE_CHECKING:
    from percuss.case.specs import LoadSpec
    from percuss.solver.entities import ContactPair
    from percuss.solver.model import Model

MOST_LETTERS = 60  # of the value of an option, as a table's


@dataclass(frozen=True)
class Explanation:
    """What a case will do: as text, and the same numbers as data."""

    text: str
    data: dict[str, Any]


def explanation(model: Model) -> Explanation:
    """Return what the run of a model will do."""
    from percuss.jsonable import plain

    known = certificate(recordable(model))
    measured = _measured(model, known["energy"])
    contacts = [_contact(model, p, contact_pair) for p, contact_pair in enumerate(model.contact_pairs)]
    loads = [_load(spec) for spec in model.case.loads.values()]
    step, exact = _step(model), _exact(model)
    methods = [_method(component) for component in _components(model)]
    case = model.case
    lines = [case.title or "Untitled case"]
    lines += [f"  source: {case.source}"] if case.source else []
    lines += _bodies(model)
    lines += ["Contacts" if contacts else "No contact"]
    told: set[str] = set()
    for one in contacts:
        lines += _contact_lines(model, one, told)
    lines += ["Loads"] if loads else []
    lines += [f"  {one['text']}" for one in loads]
    lines += ["Step", f"  {step['text']}"]
    if known["dt_critical_free"] is not None:
        critical = "is unknown" if known["dt_critical"] is None else f"{known['dt_critical']:.9g}"
        lines.append(
            f"  the bodies without contact allow {known['dt_critical_free']:.9g}, the worst combination of closed "
            f"contacts {critical}"
        )
    lines += _certificate_lines(model, known, measured)
    lines += ["Exact solution"]
    lines += (
        [f"  {exact['name']} will tell the true error of the run"] if exact["name"] else [f"  none: {exact['why']}"]
    )
    lines += ["Methods"]
    for one in methods:
        lines += _method_lines(one)
        lines += _stages(model) if one["family"] == "integrators" else []
    notes = [*case.notes, *known["ignores"]]
    lines += [f"note: {note}" for note in notes]
    data = {
        "title": case.title,
        "dt": model.dt,
        "steps": model.steps,
        "courant": model.courant,
        "step": step,
        "certificate": known,
        "contacts": {one["name"]: one["resolved"] | {"law": one["law"]} for one in contacts},
        "rows": {one["name"]: one for one in contacts},
        "chosen": {one["name"]: one["chosen"] for one in contacts},
        "loads": loads,
        "exact": exact,
        "methods": methods,
        "measured": measured,
        "nodes": model.n_nodes,
        "notes": notes,
    }
    return Explanation("\n".join(lines), plain(data))


def _given(component: Component) -> dict[str, str]:
    """Return the options of a component that are not their defaults, as a case would write them."""
    values = {one.key: (getattr(component, one.field), one.default) for one in options_of(type(component)).values()}
    return {key: _short(value) for key, (value, default) in values.items() if value is not default and value != default}


def _short(value: Any) -> str:
    text = f"{value:.9g}" if isinstance(value, float) else found(getattr(value, "path", value))
    return text if len(text) <= MOST_LETTERS else f"{text[:MOST_LETTERS]}..."


def _listed(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {value}" for key, value in values.items())


def _numbers(values: Mapping[str, float]) -> dict[str, str]:
    return {key: f"{value:.6g}" for key, value in values.items()}


def _stages(model: Model) -> list[str]:
    """Return what is told of an integrator that is no leap-frog scheme."""
    if model.stages is None:
        return []
    times = ", ".join(f"{one:.6g}" for one in model.stages.times)
    end = "is judged there too, ahead to the next stage" if model.stages.end else "has no place in it, and is refused"
    return [
        f"    no leap-frog scheme: accelerations, contact included, at {times} of each step; a law judged at the end "
        f"of the step {end}",
        "    forces and impulses are those of whole steps; energies stand at the end of each, and their closure counts "
        "what the scheme itself gains or loses",
    ]


# ---------------------------------------------------------------------------------------------- bodies, step


def _bodies(model: Model) -> list[str]:
    lines = [f"Bodies ({model.n_nodes} nodes in {model.dim} dimension{'s' if model.dim > 1 else ''})"]
    for body in model.bodies.values():
        material = body.spec.material
        c = math.sqrt(material.modulus / material.rho)
        length = float(body.mesh.lengths.sum())
        h = body.mesh.lengths
        size = f"h = {h.min():.6g}" if np.ptp(h) < 1e-9 * h.max() else f"h from {h.min():.6g} to {h.max():.6g}"
        moves = f", velocity {found(body.spec.velocity)}" if np.any(body.velocity) else ""
        lines.append(
            f"  {body.name}: {body.spec.shape.name} of {h.size} elements, {size}, {material.name} "
            f"({_listed(_given(material))}), area {body.spec.area:.6g}{moves}"
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


def _step(model: Model) -> dict[str, Any]:
    """Return the step, and where it comes from."""
    time = model.case.time
    body = max(model.bodies.values(), key=lambda one: float(one.frequency.max()))
    element = int(np.argmax(body.frequency))
    smallest = 2.0 / model.omega
    where = "every element" if np.ptp(body.frequency) <= 1e-9 * model.omega else f"element {element}"
    of = f"the smallest h/c = {smallest:.9g}, that of {where} of body '{body.name}'"
    if time.step is not None:
        how = f"dt = {model.dt:.9g} as given, Courant number {model.courant:.6g} of {of}"
    elif time.courant == "auto":
        how = (
            f"dt = {model.dt:.9g}, chosen as {SAFETY} of the critical step {model.dt / SAFETY:.9g}: "
            f"Courant number {model.courant:.6g} of {of}"
        )
    else:
        how = f"dt = {model.courant:.6g} h/c = {model.dt:.9g}, Courant number {model.courant:.6g} of {of}"
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


def _certificate_lines(model: Model, known: Mapping[str, Any], measured: Mapping[str, str]) -> list[str]:
    lines = ["Stability of the closed linear step", f"  {known['stable']}: {known['why']}"]
    if known["stable"] == "no":
        warned = model.case.time.on_unstable == "warn"
        lines.append("  the run goes on all the same (on_unstable: warn)" if warned else "  the run is not started")
        lines.append(f"  to be stable, {known['cure']}")
    lines += ["Energy over opening and closing", f"  {known['energy']}: {known['energy_why']}"]
    return lines + [f"  measured, {law}: {words}" for law, words in measured.items()]


def _measured(model: Model, energy: str) -> dict[str, str]:
    """Return, by law, what was measured with the integrator, where `energy` is no guarantee that none is gained."""
    if energy == "never grows" or model.why_not_linear:  # it was measured with linear bodies
        return {}
    integrator = model.case.method.integrator.name
    laws = [entry["law"] for entry in model.laws]
    return {law.name: law.measured[integrator] for law in laws if integrator in law.measured}


def _exact(model: Model) -> dict[str, str]:
    """Return which exact solution will judge the run, or why none will."""
    registry = model.case.registry
    reasons = []
    for name in registry.names("solutions"):
        engine: Any = registry.get("solutions", name)()
        why = why_not_covered(engine, model)
        if why is None:
            return {"name": name, "why": ""}
        reasons.append(f"{name}: {why}")
    return {"name": "", "why": "; ".join(reasons) or "no solution is registered"}


# -------------------------------------------------------------------------------------------------- contacts


def _contact(model: Model, number: int, contact_pair: ContactPair) -> dict[str, Any]:
    """Return what is known of a contact: its sides, the numbers its law is handed, and the row that follows."""
    spec = model.case.contacts[contact_pair.name]
    s = float(model.delassus(0.5 * model.dt)[number])
    points = model.points([number], model.dt)
    resolved = {key: value for key, value in model.parameters()[contact_pair.name].items() if key != "law"}
    return {
        "name": contact_pair.name,
        "sides": [str(side) for side in spec.sides] + (["a rigid wall"] if spec.wall is not None else []),
        "gap": contact_pair.gap,
        "law": contact_pair.law.name,
        "given": _given(contact_pair.law),
        "resolved": resolved,
        "chosen": dict(contact_pair.law.chosen(points, model.dt)),
        "point": {
            "EA/h": contact_pair.stiffness,
            "2c/h": contact_pair.frequency,
            "rho A h / 2": contact_pair.mass,
            "s": s,
        },
        "row": _row(model, number, s),
    }


def _row(model: Model, number: int, s: float) -> dict[str, Any] | None:
    """Return the row of a contact as the integrator judges it, None where its law has a kernel of its own."""
    entry = next(one for one in model.laws if number in one["where"])
    if not isinstance(entry["bound"], LinearLaw):
        return None
    rows = broadcast(entry["bound"], entry["points"], entry["law"].name)
    delassus = entry["points"].delassus
    one = law_records(rows, model.tables[-1], delassus, entry["law"].name)[entry["where"].index(number)]
    w = float(one["response"])
    return {
        "at": rows["at"],
        "judged": "predicted" if one["sees_predicted_gap"] else "current",
        "sees_acceleration": bool(one["sees_acceleration"]),
        "sigma": float(one["sigma"]),
        "gap": float(one["weight_gap"]),
        "rate": float(one["weight_rate"]),
        "acceleration": float(one["weight_acceleration"]),
        "active": rows["active"],
        "sign": rows["sign"],
        "w": w,
        "stiffness": 1.0 / (float(one["sigma"]) + w * s),
    }


def _contact_lines(model: Model, one: Mapping[str, Any], told: set[str]) -> list[str]:
    """Return what is known of a contact in words; the formula of its law where it is not among those `told`."""
    gap = "touching" if one["gap"] == 0 else f"gap {one['gap']:.9g}"
    law = next(entry["law"] for entry in model.laws if entry["law"].name == one["law"])
    lines = [f"  {one['name']}: {' and '.join(one['sides'])}, {gap}; {law.name}: {law.summary}"]
    if law.name not in told:
        lines += [f"    {line}" for line in docs(type(law)).formula.splitlines()]
        told.add(law.name)
    lines.append(f"    given: {_listed(one['given']) or 'nothing, all by default'}")
    lines += [f"    {option} {words}" for option, words in one["chosen"].items()]
    point = _numbers(one["point"])
    lines.append(
        f"    with EA/h = {point['EA/h']} and rho A h / 2 = {point['rho A h / 2']} of the softer side, "
        f"omega = 2c/h = {point['2c/h']}, s = N^T M^-1 N = {point['s']}, dt = {model.dt:.6g}"
    )
    lines += [f"    {_listed(_numbers(one['resolved']))}"] if one["resolved"] else []
    if one["row"] is None:
        return [*lines, f"    {law.name} is no row of the contact equation: its own kernel gives the force"]
    lines += [f"    {line}" for line in _row_lines(one["row"])]
    if one["row"]["acceleration"] and not one["row"]["sees_acceleration"]:
        lines.append(f"    g'' counts as 0: {law.needs_only_response_of['acceleration']}")
    return lines


def _row_lines(row: Mapping[str, Any]) -> Iterator[str]:
    """Yield the row with its numbers, and what a single closed contact makes of it."""
    terms = [(row["gap"], "g"), (row["rate"], "g'"), (row["acceleration"], "g''")]
    right = " ".join(f"- {'' if weight == 1.0 else f'{weight:.6g} '}{name}" for weight, name in terms if weight)
    right = right.replace("- ", "-", 1) or "0"
    state = {
        ("end", "predicted"): "the gap at the end of the step",
        ("explicit", "predicted"): "the predicted gap",
    }.get((row["at"], row["judged"]), "the current gap")
    seen = "" if row["sees_acceleration"] or not row["acceleration"] else ", g'' counts as 0"
    left = f"{row['sigma']:.6g} lambda" if row["sigma"] else "0"
    when = "while g < 0" if row["active"] == "gap < 0" else "at all times"
    sign = "lambda may be of either sign"
    if row["sign"] != "free":
        relation, sign = f"{left} >= {right}", "lambda >= 0, and one of the two is an equation"
    else:
        relation = f"{left} = {right}"
    yield f"{relation} {when}, where g is {state}{seen}; {sign}"
    if seen:
        right = " ".join(right.split(" ")[:-3]) if right.count(" ") > 2 else right.split(" - ")[0]
    yield (
        f"closed alone: lambda = ({right}) / (sigma + w s) = {row['stiffness']:.6g} ({right}), "
        f"sigma = {row['sigma']:.6g}, w = {row['w']:.6g}"
    )


# ------------------------------------------------------------------------------------------- loads, methods


def _load(spec: LoadSpec) -> dict[str, Any]:
    where = ", ".join(str(address) for address in spec.on) or "every body"
    when = "".join(
        f" {word} {instant:.6g}"
        for word, instant in (("from", spec.start), ("until", spec.stop))
        if math.isfinite(instant)
    )
    clock = "; its time counts from there" if math.isfinite(spec.start) and spec.start > 0 else ""
    along = f"along {list(spec.direction)}" if spec.direction is not None else "along the body"
    given = {
        one.key: _short(getattr(spec.load, one.field))
        for one in options_of(type(spec.load)).values()
        if getattr(spec.load, one.field) is not None
    }
    formula = docs(type(spec.load)).formula
    text = f"{spec.name}: {spec.load.name} as {spec.acts_as} on {where} {along}{when}{clock}; {_listed(given)}"
    return {
        "name": spec.name,
        "load": spec.load.name,
        "as": spec.acts_as,
        "on": [str(address) for address in spec.on],
        "options": given,
        "formula": formula,
        "text": f"{text}\n    {' '.join(formula.split())}" if formula else text,
    }


def _components(model: Model) -> list[Component]:
    """Return one of each component that the run uses, the exact solution included."""
    case = model.case
    found_: list[Component] = [case.method.integrator, *(contact_pair.law for contact_pair in model.contact_pairs)]
    found_ += [load.load for load in case.loads.values()]
    found_ += [part for body in case.bodies.values() for part in (body.shape, body.material, body.element)]
    found_.append(case.method.mass)
    exact = _exact(model)["name"]
    found_ += [case.registry.get("solutions", exact)()] if exact else []
    return list({type(one): one for one in found_}.values())


def _method(component: Component) -> dict[str, Any]:
    facts = {fact: getattr(component, fact) for fact in ("order", "conserves") if hasattr(component, fact)}
    return {
        "family": component.family,
        "name": component.name,
        "summary": component.summary,
        "formula": docs(type(component)).formula,
        "facts": facts,
        "references": list(component.references),
    }


def _method_lines(one: Mapping[str, Any]) -> list[str]:
    lines = [f"  {one['name']} ({one['family']}): {one['summary']}"]
    # those of laws and loads stand where they act
    lines += [f"    {line}" for line in one["formula"].splitlines() if one["family"] not in {"contacts", "loads"}]
    told = [f"order {one['facts']['order']}"] if "order" in one["facts"] else []
    conserves = " and ".join(one["facts"].get("conserves", ()))
    told += [f"conserves {conserves} without contact"] if conserves else []
    lines += [f"    {'; '.join(told)}"] if told else []
    return lines + [f"    see {reference}" for reference in one["references"]]
