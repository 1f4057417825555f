"""Say in words and formulas what a case will do, and what a component is."""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import percuss
from percuss.admission import OLDEST
from percuss.certificate import SAFETY, certificate
from percuss.contracts import Component, Rows
from percuss.errors import InputError, Problem, suggestion
from percuss.options import options_of

if TYPE_CHECKING:
    from percuss.model import Model
    from percuss.registry import Registry


@dataclass(frozen=True)
class Explanation:
    """What a case will do: as text, and the same numbers as data."""

    text: str
    data: dict[str, Any]


def explanation(model: Model) -> Explanation:
    """Return what the run of a model will do."""
    from percuss.runner import plain

    known = certificate(model)
    parameters, chosen = model.parameters(), _chosen(model)
    measured = _measured(model, known["energy"])
    case = model.case
    lines = [case.title or "Untitled case"]
    lines += [f"  source: {case.source}"] if case.source else []
    lines += _bodies(model) + _contacts(model, parameters, chosen) + _loads(model)
    method = case.method.integrator
    lines += [
        "Integrator",
        f"  {method.name}: {method.summary}",
        *_formula(type(method)),
        *_stages(model),
        "Step",
        f"  {model.dt:.9g}, Courant number {model.courant:.6g} of the element with the smallest h/c; "
        f"{model.steps} steps to {model.steps * model.dt:.9g}"
        + (f"; chosen as {SAFETY} of the critical step" if case.time.courant == "auto" else ""),
        f"  the bodies without contact allow {known['dt_critical_free']:.9g}, the worst combination of closed "
        f"contacts {known['dt_critical']:.9g}",
        "Stability of the closed linear step",
        f"  {known['stable']}: {known['why']}",
        "Energy over opening and closing",
        f"  {known['energy']}: {known['energy_why']}",
    ]
    lines += [f"  measured, {law}: {words}" for law, words in measured.items()]
    if known["stable"] == "no":
        warned = case.time.on_unstable == "warn"
        lines.append("  the run goes on all the same (on_unstable: warn)" if warned else "  the run is not started")
        lines.append(f"  to be stable, {known['cure']}")
    lines += [f"note: {note}" for note in case.notes]
    data = {
        "title": case.title,
        "dt": model.dt,
        "steps": model.steps,
        "courant": model.courant,
        "certificate": known,
        "contacts": parameters,
        "chosen": chosen,
        "measured": measured,
        "nodes": model.n_nodes,
        "notes": list(case.notes),
    }
    return Explanation("\n".join(lines), plain(data))


def _stages(model: Model) -> list[str]:
    """Return what is told of an integrator that is no leap-frog scheme."""
    if model.stages is None:
        return []
    times = ", ".join(f"{one:.6g}" for one in model.stages.times)
    end = "is judged there too, ahead to the next stage" if model.stages.end else "has no place in it, and is refused"
    return [
        f"  no leap-frog scheme: accelerations, contact included, at {times} of each step; a law judged at the end of "
        f"the step {end}",
        "  forces and impulses are those of whole steps; energies stand at the end of each, and their closure counts "
        "what the scheme itself gains or loses",
    ]


def _bodies(model: Model) -> list[str]:
    lines = [f"Bodies ({model.n_nodes} nodes in {model.dim} dimension{'s' if model.dim > 1 else ''})"]
    for body in model.bodies.values():
        material = body.spec.material
        c = math.sqrt(material.modulus / material.rho)
        length = float(body.mesh.lengths.sum())
        h = body.mesh.lengths
        size = f"h = {h.min():.6g}" if np.ptp(h) < 1e-9 * h.max() else f"h from {h.min():.6g} to {h.max():.6g}"
        lines.append(
            f"  {body.name}: {body.spec.shape.name} of {h.size} elements, {size}, {material.name}; c = {c:.6g}, "
            f"transit {length / c:.6g}, impedance {body.spec.area * math.sqrt(material.modulus * material.rho):.6g}"
            + (f", fixed at {', '.join(body.spec.fixed)}" if body.spec.fixed else "")
        )
    return lines


def _chosen(model: Model) -> dict[str, dict[str, str]]:
    """Return, for each contact, what its law set by itself."""
    out: dict[str, dict[str, str]] = {}
    delassus = model.delassus(0.5 * model.dt)
    for meeting, s in zip(model.meetings, delassus, strict=True):
        out[meeting.name] = dict(meeting.law.chosen(model.points([meeting], s[None]), model.dt))
    return out


def _measured(model: Model, energy: str) -> dict[str, str]:
    """Return, by law, what was measured with the integrator, where `energy` is no guarantee that none is gained."""
    if energy == "never grows":
        return {}
    integrator = model.case.method.integrator.name
    laws = [entry["law"] for entry in model.laws]
    return {law.name: law.measured[integrator] for law in laws if integrator in law.measured}


def _contacts(model: Model, parameters: dict[str, Any], chosen: dict[str, dict[str, str]]) -> list[str]:
    lines = ["Contacts" if model.meetings else "No contact"]
    for meeting in model.meetings:
        spec = model.case.contacts[meeting.name]
        ends = " and ".join(str(side) for side in spec.sides) + (" and a rigid wall" if spec.wall is not None else "")
        gap = "touching" if meeting.gap == 0 else f"gap {meeting.gap:.9g}"
        lines.append(f"  {meeting.name}: {ends}, {gap}; {meeting.law.name}: {meeting.law.summary}")
        lines += [f"  {line}" for line in _formula(type(meeting.law))]
        resolved = {k: v for k, v in parameters[meeting.name].items() if k != "law"}
        if resolved:
            lines.append("    " + ", ".join(f"{k} = {v:.6g}" for k, v in resolved.items()))
        lines += [f"    {option} {words}" for option, words in chosen[meeting.name].items()]
    for entry in model.laws:
        if not isinstance(entry["bound"], Rows):
            lines.append(f"  {entry['law'].name} is no row of the contact equation: its own kernel gives the force")
    return lines


def _loads(model: Model) -> list[str]:
    lines = ["Loads"] if model.case.loads else []
    for spec in model.case.loads.values():
        where = ", ".join(str(address) for address in spec.on) or "every body"
        when = "".join(
            f" {word} {instant:.6g}"
            for word, instant in (("from", spec.start), ("until", spec.stop))
            if math.isfinite(instant)
        )
        clock = "; its time counts from there" if math.isfinite(spec.start) and spec.start > 0 else ""
        along = f"along {list(spec.direction)}" if spec.direction is not None else "along the body"
        lines.append(f"  {spec.name}: {spec.load.name} as {spec.acts_as} on {where} {along}{when}{clock}")
    return lines


def _formula(component: type[Component]) -> list[str]:
    """Return the paragraph of a docstring that begins with "Formula:", indented."""
    paragraphs = inspect.cleandoc(component.__doc__ or "").split("\n\n")
    found = next((p for p in paragraphs if p.startswith("Formula:")), "")
    return [f"  {line}" for line in found.replace("``", "").splitlines()]


def components_named(registry: Registry, name: str) -> list[tuple[str, str]]:
    """Return the (family, name) of every component called `name`.

    Raises
    ------
    InputError
        If there is none.
    """
    found = [key for key in registry.components if key[1] == name]
    if not found:
        known = {key[1] for key in registry.components}
        raise InputError([Problem("percuss plugins", "", f"unknown component '{name}'", suggestion(name, known))])
    return found


def component_data(registry: Registry, family: str, name: str) -> dict[str, Any]:
    """Return all that is known of a component, in the terms of JSON."""
    from percuss.options import schema_of
    from percuss.runner import plain

    component = registry.get(family, name)
    source = registry.sources[family, name]
    facts = {
        fact: getattr(component, fact)
        for fact in ("order", "conserves", "linear", "acts_as", "everywhere", "regions")
        if hasattr(component, fact)
    }
    return plain(  # type: ignore[no-any-return]
        {
            "family": family,
            "name": name,
            "summary": component.summary,
            "distribution": source.distribution,
            "version": source.version,
            "module": source.module,
            "file": source.file,
            "contract_version": component.contract_version,
            "facts": facts,
            "references": list(component.references),
            "options": schema_of(component),
            "examples": list(component.examples),
        }
    )


def component_text(registry: Registry, family: str, name: str) -> str:
    """Return a component's docstring, options with units and bounds, facts, references and a case snippet."""
    data = component_data(registry, family, name)
    component = registry.get(family, name)
    lines = [f"{name} ({family})", "", inspect.cleandoc(component.__doc__ or ""), "", "Options"]
    for option in options_of(component).values():
        given = data["options"]["properties"].get(option.key, {})
        default = "required" if option.required else f"default {option.default}"
        lines.append(f"  {option.key} [{option.unit or '1'}] {option.doc} ({_bounds(given)}{default})")
    lines += ["  none"] if not options_of(component) else []
    if data["facts"]:
        lines += ["", "Facts", *(f"  {k}: {v}" for k, v in data["facts"].items())]
    if data["references"]:
        lines += ["", "References", *(f"  {reference}" for reference in data["references"])]
    lines += ["", "In a case", *(f"  {line}" for line in _snippet(component))]
    origin = f"{data['distribution']} {data['version']}".strip() or data["version"]
    origin += f", written for contract {component.contract_version}" if component.contract_version else ""
    lines += ["", f"From {origin}, {data['file']}"]
    return "\n".join(lines)


def _bounds(schema: dict[str, Any]) -> str:
    words = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
    branches = [schema, *schema.get("anyOf", [])]
    found = [f"{sign} {branch[key]:g}" for branch in branches for key, sign in words.items() if key in branch]
    allowed = [str(value) for branch in branches for value in branch.get("enum", [])]
    allowed += [str(branch["const"]) for branch in branches if "const" in branch]
    text = " or ".join([*dict.fromkeys(found), *allowed])
    return f"{text}; " if text else ""


def _snippet(component: type[Component]) -> list[str]:
    """Return lines of a case that use the component with its last example."""
    from percuss.yamltext import flow

    example = dict(component.examples[-1])
    named = f"{{name: {component.name}, {flow(example)[1:]}" if example else component.name
    families = {
        "integrators": ["method:", f"  integrator: {named}"],
        "contacts": ["method:", f"  contact: {named}"],
        "masses": ["method:", f"  mass: {named}"],
        "materials": ["bodies:", "  BODY:", f"    material: {named}"],
        "elements": ["bodies:", "  BODY:", f"    element: {named}"],
        "shapes": ["bodies:", "  BODY:", f"    {component.name}: {flow(example)}"],
    }
    if component.family == "loads":
        return ["loads:", f"  LOAD: {{{component.name}: {flow(example)}, on: BODY.right}}"]
    return families.get(component.family, [named])


def registry_data(registry: Registry) -> dict[str, Any]:
    """Return every component and every failure, in the terms of JSON."""
    return {
        "percuss": percuss.__version__,
        "contract": percuss.CONTRACT,
        "oldest_contract": OLDEST,
        "components": [
            {
                "family": family,
                "name": name,
                "summary": component.summary,
                "distribution": registry.sources[family, name].distribution,
                "version": registry.sources[family, name].version,
                "module": registry.sources[family, name].module,
                "file": registry.sources[family, name].file,
                "contract_version": component.contract_version,
            }
            for (family, name), component in registry.components.items()
        ],
        "broken": [{"source": b.source, "error": b.error, "file": b.file} for b in registry.broken],
    }
