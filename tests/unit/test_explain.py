"""What `percuss check` says of a case and `percuss plugins NAME` of a component: every number by its closed formula."""

import json
import math

import pytest

import percuss
import places
from marks import deep
from percuss.case.options import options_of
from percuss.certificate.verdict import settled
from percuss.contact.contact_problem import contact_problem
from percuss.march.model_of_case import model_of
from percuss.methods.interfaces import FAMILIES, ContactProblem
from percuss.methods.registry import Registry
from percuss.reporting.component import component_data, component_text
from percuss.reporting.explanation import explanation
from strategies import hunek

CASES = sorted(path for path in places.CASES.glob("*.yaml") if path.stem != "oblique-spheres")  # a check takes minutes
LARGE = {"ball-on-wall-3d", "box-impact", "gross-slip-disk", "two-spheres"}
REGISTRY = Registry.load()


def told(case, overrides=None):
    return explanation(*settled(percuss.load(case, overrides)))


@pytest.mark.parametrize("height", [0.0, 0.1])
def test_the_gap_of_a_contact_is_the_smallest_of_its_points(height):
    found = told({
        "percuss": 1, "time": {"courant": 0.5, "end": 1.0},
        "bodies": {"d": {"disk": {"radius": 1.0, "elements": 8}, "at": [0.0, 1.0 + height],
                         "material": {"young": 1.0, "density": 1.0, "poisson": 0.3}}},
        "contacts": {"floor": {"body": "d.skin", "wall": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}},
        "method": {"contact": "lagrange", "pairing": "node-to-segment"},
    })  # fmt: skip
    assert found.data["contacts"]["floor"]["gap"] == pytest.approx(height, abs=1e-12)
    assert f"floor: d.skin and a rigid wall, {f'gap {height:g}' if height else 'touching'}; " in found.text


# ------------------------------------------------------------------------------------------------- cases


@pytest.mark.parametrize(
    "path", [deep(path) if path.stem in LARGE else path for path in CASES], ids=lambda path: path.stem
)
def test_a_check_names_all_that_a_case_will_do(path):
    case = percuss.load(path)
    model, found = model_of(case), told(path)
    text = found.text
    assert case.title in text
    assert case.source in text
    method = case.method.integrator
    for component in [method, *(c.law for c in case.contacts.values()), *(one.load for one in case.loads.values())]:
        assert component.summary in text
        assert all(reference in text for reference in component.references)
        formula = component_data(REGISTRY, component.family, component.name)["formula"]
        assert formula
        assert " ".join(formula.split()) in " ".join(text.split())
    for name in case.contacts:
        assert f"  {name}: " in text
        row = found.data["contacts"][name]["row"]
        if row["sigma"]:
            weight = model.contact_points.weight[model.contact_points.names.index(name)]
            assert f"epsilon_s = {1 / row['sigma'] / weight:.6g}" in text
    for name in case.loads:
        assert f"  {name}: " in text
    bars = all(body.shape.cell == "line" for body in case.bodies.values())
    courant = found.data["step"]["courant"] if case.time.courant in {"auto", None} else case.time.courant
    assert f"Courant number {courant:.6g} of the smallest {'h/c' if bars else '2/omega'}" in text
    covered = isinstance(contact_problem(model), ContactProblem)
    assert ("the exact solution is known (bars-in-a-row)" in text) is covered
    assert covered or not bars
    assert found.data["certificate"]["why"] in text
    json.dumps(found.data, allow_nan=False)


@pytest.mark.parametrize("integrator", ["central-difference", "wu-predictor-corrector"])
@pytest.mark.parametrize("law", ["penalty", "bipenalty"])
def test_numbers_of_a_contact_are_those_of_the_closed_formulas(integrator, law):
    young, density, area, h, courant, beta, ratio = 80.0, 0.02, 1.5, 0.25, 0.4, 0.7, 0.8
    options = {"name": law, "beta_s": beta} | ({"ratio": ratio} if law == "bipenalty" else {})
    case = hunek(40, courant=courant, integrator=integrator, contact=options)
    for body in case["bodies"].values():
        body |= {"material": {"young": young, "density": density}, "area": area}
    found = told(case)
    c = math.sqrt(young / density)
    eps_s = beta * young * area / h
    eps_m = eps_s / (ratio * (2 * c / h) ** 2) if law == "bipenalty" else 0.0
    s = 2 / (density * area * h / 2)
    dt = courant * h / c
    row = found.data["contacts"]["tip"]["row"]
    point = found.data["contacts"]["tip"]["point"]
    assert found.data["contacts"]["tip"]["resolved"]["epsilon_s"] == pytest.approx(eps_s, rel=1e-12)
    assert row["sigma"] == pytest.approx(1 / eps_s, rel=1e-12)
    assert row["acceleration"] == pytest.approx(eps_m / eps_s, rel=1e-12, abs=1e-300)
    assert row["w"] == pytest.approx(eps_m / eps_s, rel=1e-12, abs=1e-300)
    assert row["stiffness"] == pytest.approx(eps_s / (1 + eps_m * s), rel=1e-12)
    assert point == pytest.approx(
        {"EA/h": young * area / h, "2c/h": 2 * c / h, "rho A h / 2": density * area * h / 2, "s": s}, rel=1e-12
    )
    assert found.data["step"]["dt"] == pytest.approx(dt, rel=1e-12)
    assert found.data["step"]["smallest_transit"] == pytest.approx(h / c, rel=1e-12)
    for value in (eps_s, s, dt, *([eps_m] if eps_m else [])):
        assert f"{value:.6g}" in found.text
    wu = integrator == "wu-predictor-corrector"
    assert row["judged"] == ("predicted" if wu else "current")
    assert ("g'' counts as 0" in found.text) is (wu and law == "bipenalty")
    if wu:
        assert found.data["certificate"]["theta"] == pytest.approx(dt**2 * row["stiffness"] * s, rel=1e-9)


def test_the_element_that_sets_the_step_is_named():
    case = hunek(20)
    case["bodies"]["long"]["bar"] = {"length": 20.0, "elements": 30, "grading": 0.5}
    found = told(case)
    assert (found.data["step"]["body"], found.data["step"]["element"]) == ("long", 29)
    assert "that of element 29 of body 'long'" in found.text


# -------------------------------------------------------------------------------------------- components


@pytest.mark.parametrize(("family", "name"), REGISTRY.components, ids=["-".join(key) for key in REGISTRY.components])
def test_a_component_is_described_in_full(family, name):
    component = REGISTRY.get(family, name)
    text, data = component_text(REGISTRY, family, name), component_data(REGISTRY, family, name)
    parts = [component.summary, "Formula", "Options", *component.references, data["module"], data["file"]]
    parts += [f"{one.key} [{one.unit or '1'}]" for one in options_of(component).values()]
    parts += [one.doc for one in options_of(component).values()] + list(component.expected_failures.values())
    parts += [*getattr(component, "measured", {}).values(), data["distribution"], data["version"]]
    for part in parts:
        assert " ".join(part.split()) in " ".join(text.split())
    assert all(len(line) <= 80 for line in text.splitlines() if data["file"] not in line)
    places = [text.index(part) for part in (f"{name} ({family}): ", "\nFormula", "\nOptions", "\nFrom ")]
    assert places == sorted(places)
    assert data["formula"], "say the formula in a paragraph that begins with `Formula:`"
    assert all(one["what"] for one in data["options"])
    assert set(data["facts"]) >= {one for one in FAMILIES[family].__annotations__ if hasattr(component, one)}
    json.dumps(data, allow_nan=False)


def test_a_single_file_is_described(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    percuss.new("soft", "contact")
    text = component_text(Registry.load(["soft.py"]), "contacts", "soft")
    for words in ("lambda >= 0", "beta_s [1]: stiffness over EA/h", "default 1.0", str(tmp_path / "soft.py")):
        assert words in text


@pytest.mark.parametrize(
    ("case", "courant", "told_of"),
    [("disk-on-wall", 0.8, True), ("disk-on-wall", "auto", False), ("disk-on-wall", 1.2, False),
     ("box-impact", 0.4, False), ("hunek", 0.3, False)],
)  # fmt: skip
def test_a_fast_cell_that_sets_the_courant_number_is_told(case, courant, told_of):
    """Where `courant: auto` would take less than .7 of the steps, of bodies whose cells are unlike."""
    notes = told(places.CASES / f"{case}.yaml", {"time.courant": courant}).data["notes"]
    found = [note for note in notes if note.startswith("one fast cell sets the Courant number")]
    assert bool(found) is told_of
    assert not found or "0.8 is 0.457 of the longest stable step, and `courant: auto` takes 90 % of that" in found[0]


def test_a_long_run_tells_of_a_fast_cell_too():
    """A short one does not search the step up to which its bodies are stable."""
    for steps, told_of in ((10, False), (3_000, True)):
        time = {"steps": steps, "courant": 0.8}
        case = percuss.load(places.CASES / "disk-on-wall.yaml", {"time": time, "record.every": steps, "expect": ()})
        notes = percuss.run(case).summary["notes"]
        assert any("0.46 of the longest stable step without contact" in note for note in notes) is told_of
