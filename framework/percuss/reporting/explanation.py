"""The explanation of a case before its run: facts as data, and the same in words by one template."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.options import PER_AREA, options_of
from percuss.case.quantities import in_unit
from percuss.case.specs import RigidWall
from percuss.case.type_words import found
from percuss.certificate.flutter import flutter_of
from percuss.certificate.verdict import SHARE_OF_CRITICAL_STEP, USUAL_STRETCH, certificate
from percuss.contact.frictions import frictional, stick_in_words
from percuss.contact.laws import parameters, points_of_law
from percuss.contact.pairs import unlike_sides
from percuss.contact.sliding import late_corners, normals_of_the_start, slides
from percuss.jsonable import Data, Entries, plain
from percuss.march.estimate import bytes_of_run, seconds_of_steps
from percuss.march.recording import recordable
from percuss.mesh.cells import cells_of
from percuss.mesh.size_limits import bytes_in_words
from percuss.methods.interfaces import Component, ContactLaw
from percuss.reporting.component import Explanation, docs, filled
from percuss.reporting.tables import duration
from percuss.reporting.verdict import check_verdict
from percuss.results.doubts import doubts_about, expected_meetings, slow_step
from percuss.results.exact import engine_for

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.case.specs import LoadSpec
    from percuss.certificate.criteria import RunCriterion
    from percuss.contact.model import Model
    from percuss.mesh.body import Body

MOST_LETTERS = 60  # The value of an option, such as a table, is cut after this many letters.


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
    case, verdict = model.case, certificate(recordable(model), criterion)
    flutter = flutter_of(model)
    engine, _, why_not_exact = engine_for(model, (model.steps + 1) * model.dt)
    name, refused = engine.name if engine else "", case.time.on_unstable == "stop"
    dt = in_unit(model.dt, 6, "time", case.data.get("units") or {})
    used = _components(model) + ([engine] if engine else [])
    data: Entries = {
        "verdict": list(check_verdict(model.steps, dt, verdict, name, why_not_exact, refused=refused)),
        "title": case.title,
        "bodies": {body.name: _body(body) for body in model.bodies.values()},
        "contacts": {name: _contact(model, name) for name in dict.fromkeys(model.contact_points.names)},
        "loads": {spec.name: _load(spec, case) for spec in case.loads.values()},
        "step": _step(model),
        "estimate": {"seconds": seconds_of_steps(model), "bytes": bytes_of_run(model)},
        "nodes": model.bodies.n_nodes,
        "certificate": verdict,
        "flutter": flutter._asdict() if flutter is not None else None,
        "measured": _measured_energy(model, verdict["energy"]),
        "exact": {"name": name, "why": why_not_exact},
        "methods": {f"{component.family}/{component.name}": _method(component) for component in used},
        "notes": [
            *case.notes,
            *unlike_sides(case, model.bodies),
            *late_corners(case, model.bodies),
            *normals_of_the_start(case, model.bodies),
            *verdict["ignores"],
            *expected_meetings(model),
            *slow_step(model, verdict),
        ],
    }
    words = {
        "model": model,
        "case": case,
        "used": used,
        "beside": {name: _beside(model, name) for name in data["contacts"]},
        "share": SHARE_OF_CRITICAL_STEP,
        "usual_stretch": USUAL_STRETCH,
        "of_scheme": [*filter(None, [model.why("step")]), *(model.stages.in_words if model.stages else ())],
        # The number of sweeps over coupled points is not known.
        "coupled": model.rows_at(0.5 * model.dt).other.size > 0,
        "uniform": lambda body: np.ptp(body.frequency) <= 1e-9 * model.bodies.omega,
        "doubts": lambda body: list(_doubts(body, model.steps * model.dt)),
        "options": lambda component: _options(component, with_defaults=False),
        "docs": lambda component: docs(type(component)),
        "any_of": np.any,
        "assigned": _assigned,
        "per_area": partial(_per_area, model),
        "found": found,
        "cells_of": cells_of,
        "takes": duration,
        "bytes_in_words": bytes_in_words,
    }
    return Explanation(filled("check.txt.jinja", data | words), plain(data))


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


def _assigned(values: Data) -> str:
    """Return values by name in words."""
    return ", ".join(f"{key} = {value}" for key, value in values.items())


def _per_area(model: Model, law: ContactLaw, values: Data) -> Data:
    """Return values of a law by name as texts, with the word that those of surfaces which are per area need."""
    known = {} if model.bodies.of_lines else options_of(type(law))
    per_area = {key for key, option in known.items() if option.unit in PER_AREA}
    texts = {key: value if isinstance(value, str) else f"{value:.6g}" for key, value in values.items()}
    return {key: f"{text} per area" if key in per_area else text for key, text in texts.items()}


# ---------------------------------------------------------------------------------------------- bodies, step


def _body(body: Body) -> Entries:
    """Return the mesh of a body, the speed of its waves, and its impedance or its mass."""
    material = body.spec.material
    c = math.sqrt(body.modulus / material.rho)
    about: Entries = {"c": c, "why_not_linear": body.why_not_linear, "elements": body.count}
    if body.mesh.line is None:
        return about | {"nodes": int(body.mass.size), "plane": body.view.plane, "mass": float(body.mass.sum())}
    h = body.mesh.lengths
    impedance = body.spec.section * math.sqrt(material.modulus * material.rho)
    about |= {"elements": int(h.size), "h": [float(h.min()), float(h.max())]}
    return about | {"transit": float(h.sum()) / c, "impedance": impedance}


def _doubts(body: Body, end: float) -> Iterator[str]:
    """Yield what is known against the mesh and the material of a body in a run of some length."""
    yield from doubts_about(body, float(np.linalg.norm(body.spec.spin)) * end)
    if body.why_not_linear:
        yield body.why_not_linear
        yield "c, EA/h, 2c/h and all that follows from them are those of its modulus, whatever its strain"


def _step(model: Model) -> Entries:
    """Return the time step, and the element with the highest frequency."""
    body = max(model.bodies.values(), key=lambda body: float(body.frequency.max()))
    return {
        "dt": model.dt,
        "courant": model.courant,
        "smallest_transit": 2.0 / model.bodies.omega,
        "body": body.name,
        "element": int(np.argmax(body.frequency)),
        "steps": model.steps,
        "end": model.steps * model.dt,
    }


def _measured_energy(model: Model, energy: str) -> dict[str, str]:
    """Return by contact law the measured energy behaviour with the integrator, unless energy is known never to grow."""
    # The measurements were made with linear bars, so they do not hold for other bodies.
    if energy == "never grows" or model.bodies.why_not_linear or not model.bodies.of_lines:
        return {}
    integrator = model.case.method.integrator.name
    laws = [bound_law.law for bound_law in model.laws]
    return {law.name: law.measured[integrator] for law in laws if integrator in law.measured}


# -------------------------------------------------------------------------------------------------- contacts


def _contact(model: Model, name: str) -> Entries:
    """Return a contact: its sides, gap and law, the numbers given to the law, and its linear law if there is one."""
    points, number = model.contact_points, model.contact_points.names.index(name)
    spec, law, own = model.case.contacts[name], points.laws[number], points.of_contact(name)
    at_end = [float(values[number]) for values in (points.stiffness, points.mass, points.frequency)]
    point = dict(zip(_names_at_end(model, number), at_end, strict=True))
    point["s"] = float(model.rows_at(0.5 * model.dt).delassus[number])
    value: Entries = {
        "sides": [*map(str, spec.sides), *([_wall(spec.wall)] if spec.wall is not None else [])],
        "gap": float(points.gap[own].min()),
        "law": law.name,
        "given": _options(law, with_defaults=False),
        "resolved": {key: one for key, one in parameters(model)[name].items() if key != "law"},
        "chosen": dict(law.chosen(points_of_law(model, [number], model.dt), model.dt)),
        "point": point,
        "row": _linear_law_data(model, number, point["s"]),
    }
    if (friction := frictional(model).get(name)) is not None:
        given, stick = _options(friction, with_defaults=False), stick_in_words(model, name)
        value["friction"] = {"name": friction.name, "given": given, "stick": stick}
    if slides(spec):
        value["slides"] = {
            "largest": model.largest_response(name),
            "overlap": spec.overlap,
            "wall": spec.wall is not None,
        }
    if (count := int(own.sum())) > 1:
        value |= {"points": count, "area": model.bodies[spec.sides[0].body].area_of(spec.sides[0].region)}
        value["covered"] = sum(points.weight[own].tolist())
    return value


def _beside(model: Model, name: str) -> Entries:
    """Return the law of a contact, its largest gap and the formula of s."""
    points, number = model.contact_points, model.contact_points.names.index(name)
    return {
        "law": points.laws[number],
        "largest_gap": float(points.gap[points.of_contact(name)].max()),
        "s_formula": model.why("delassus") if model.balanced[number] else "N^T M^-1 N",
    }


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


# ------------------------------------------------------------------------------------------- loads, methods


def _wall(wall: object) -> str:
    """Return what a wall is, in words."""
    if not isinstance(wall, RigidWall) or wall.stays:
        return "a rigid wall"
    return f"a rigid {wall.shape}{f' that moves by {wall.moving}' if wall.moving is not None else ''}"


def _load(spec: LoadSpec, case: Case) -> Entries:
    """Return a load: what it acts as, where, and its options."""
    options, walls = _options(spec.load, with_defaults=True), (one.wall for one in case.contacts.values())
    on = [*map(str, spec.on), *(_wall(wall) for wall in walls if getattr(wall, "moving", None) == spec.name)]
    return {"load": spec.load.name, "as": spec.acts_as, "on": on, "options": options}


def _components(model: Model) -> list[Component]:
    """Return one instance of each component that the run uses, without the exact solution."""
    case = model.case
    components: list[Component] = [case.method.integrator, *model.contact_points.laws]
    components += [load.load for load in case.loads.values()]
    components += [part for body in case.bodies.values() for part in (body.shape, body.material, body.element)]
    components += filter(None, (case.method.mass, *(contact.pairing for contact in case.contacts.values())))
    components += filter(None, (contact.friction for contact in case.contacts.values()))
    return list({type(component): component for component in components}.values())


def _method(component: Component) -> Entries:
    """Return a component: what it is, its formula, its order, what it conserves, and its references."""
    return {
        "family": component.family,
        "summary": component.summary,
        "formula": docs(type(component)).formula,
        "facts": {fact: getattr(component, fact) for fact in ("order", "conserves") if hasattr(component, fact)},
        "references": list(component.references),
    }
