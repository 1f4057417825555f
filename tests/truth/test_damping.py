"""Damped bodies: exact decay, terminal speed, limit of the step, balances."""

import itertools

import numpy as np
import pytest

import percuss
from accounts import balanced, ran
from percuss.certificate.verdict import certificate
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from strategies import bar, case_of

WU, CD = "wu-predictor-corrector", "central-difference"
SOLID = {"young": 1.0, "density": 1.0, "poisson": 0.3}
GRAVITY = {"fall": {"gravity": 0.02, "on": "block", "direction": [0, -1]}}
BEND = {"name": "ramberg-osgood", "young": 1.0, "density": 1.0, "alpha": 0.3, "n": 3, "reference_stress": 0.1}


def block(alpha, dim=2, **more):
    """Return a block that falls obliquely on a floor with friction."""
    body = {"block": {"size": [1.0] * dim, "elements": [3] * dim}, "at": [0.0] * (dim - 1) + [0.02]}
    body |= {"material": SOLID, "velocity": [0.05, *[0.0] * (dim - 2), -0.1]}
    floor = {"point": [0] * dim, "normal": [0] * (dim - 1) + [1]}
    friction = {"name": "coulomb", "mu": 0.3}
    return {
        "percuss": 1,
        "bodies": {"block": body | {"damping": {"mass": alpha}}},
        "contacts": {"floor": {"body": "block.bottom", "wall": floor, "friction": friction}},
        "method": {"integrator": WU, "contact": "lagrange"},
        "time": {"end": 3.0, "courant": 0.5},
        **more,
    }


def free_flight(alpha, end=4.0, **more):
    """Return a bar that flies and meets nothing."""
    bodies = {"rod": bar(1.0, 4, velocity=0.1) | {"damping": {"mass": alpha}}}
    return case_of(bodies, {}, {"end": end, "courant": 0.5}, **more)


@pytest.mark.parametrize("alpha", [0.3, 5.0])
def test_a_free_body_loses_the_same_share_of_its_speed_in_each_step(alpha):
    """By (1 - c)/(1 + c), c = alpha dt / 2: exp(-alpha t) to second order."""
    result = balanced(ran(free_flight(alpha)))
    c, steps = 0.5 * alpha * result.summary["dt"], result.summary["steps"]
    last = result.summary["bodies"]["rod"]["velocity_x"]
    assert last == pytest.approx(0.1 * (1.0 + c) * ((1.0 - c) / (1.0 + c)) ** steps, rel=1e-12)


def test_a_damped_body_falls_at_its_terminal_speed():
    loads = {"fall": {"gravity": 0.02, "on": "rod"}}
    result = ran(free_flight(4.0, 20.0, loads=loads))
    assert result.summary["energy"]["ledger_error"] < 1e-11
    assert result.summary["bodies"]["rod"]["velocity_x"] == pytest.approx(0.02 / 4.0, rel=1e-11)


def test_a_mode_decays_as_a_damped_oscillator_does():
    """Error of second order in the step, against x = v/w exp(-alpha t/2) sin(w t)."""
    alpha, errors = 0.4, []
    for courant in (0.02, 0.01, 0.005):
        rod = bar(1.0, 1, velocity=0.1, fixed=["left"]) | {"damping": {"mass": alpha}}
        model = model_of(percuss.load(case_of({"rod": rod}, {}, {"end": 5.0, "courant": courant})))
        body = model.bodies["rod"]
        omega = np.sqrt(float(body.stiffness[0]) / body.mass[1] - 0.25 * alpha**2)
        march = March(model)
        end = march.run().final_displacement[1]
        time = model.steps * model.dt
        errors.append(abs(end - 0.1 / omega * np.exp(-0.5 * alpha * time) * np.sin(omega * time)))
    assert [a / b for a, b in itertools.pairwise(errors)] == pytest.approx([4.0, 4.0], rel=0.1)


@pytest.mark.parametrize("alpha", [0.1, 3.0])
@pytest.mark.parametrize(("contact", "integrator"), [("penalty", CD), ("bipenalty", CD), ("regularised-lagrange", WU)])
def test_the_certificate_is_that_of_undamped_bodies_and_the_step_agrees(alpha, contact, integrator):
    """Spectral radius of the step of a bar that touches a wall: at most 1 just below the critical step, more above."""
    certificates, radii = [], []
    for damping, factor in itertools.product(({}, {"damping": {"mass": alpha}}), (0.9999, 1.0001)):
        rod = bar(1.0, 4) | damping
        law = {"name": contact, "epsilon_s": 3.0} if contact != "bipenalty" else {"name": contact, "beta_s": 0.4}
        case = case_of({"rod": rod}, {"wall": {"body": "rod.left", "wall": 0.0}}, {"steps": 1, "courant": 0.5})
        case["method"] = {"integrator": integrator, "contact": law}
        critical = certificate(model_of(percuss.load(case)))["courant_critical"]
        model = model_of(percuss.load(case, {"time.courant": factor * critical}))
        certificates.append((critical, certificate(model)["stable"]))
        radii.append(radius_of_step(model))
    assert certificates[:2] == certificates[2:]
    assert [verdict for _, verdict in certificates[2:]] == ["yes", "no"]
    assert radii[2] < 1.0 < radii[3]


def radius_of_step(model):
    """Return the larger spectral radius of the step of a model: with a wall that pulls too, and far from it."""
    march, radii = March(model), []
    march.compile()
    march._start_stepper()
    points, size = march.arrays.step.points, march.u.size
    for always, gap in ((1, 0.0), (0, 1e9)):
        points.law["always"], points.law["never_pulls"], points.row["initial_gap"] = always, 1 - always, gap
        states = np.eye(2 * size).reshape(-1, 2, size)
        columns = [march.stepper.step_without_loads(march.arrays.record, state).ravel() for state in states]
        radii.append(float(np.abs(np.linalg.eigvals(np.array(columns).T)).max()))
    return max(radii)


LAWS = (
    (WU, "lagrange"), (CD, "lagrange"), (WU, "penalty"), (CD, "bipenalty"), (CD, "hunt-crossley"),
    (WU, "regularised-lagrange"), ("viscous-central-difference", "lagrange"),
)  # fmt: skip


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("integrator", "contact"), LAWS)
def test_accounts_close_and_damping_takes_energy(integrator, contact, dim):
    loads = {"fall": {"gravity": 0.02, "on": "block", "direction": [0] * (dim - 1) + [-1]}}
    method = {"integrator": integrator, "contact": contact}
    result = balanced(ran(block(0.7, dim, method=method, loads=loads)))
    assert (np.diff(result.arrays["damped_energy"]) >= 0.0).all()
    assert result.summary["energy"]["damped"] == result.arrays["damped_energy"][-1] > 0.0
    assert result.summary["angular_momentum"]["error"] < 1e-12
    assert result.summary["energy_growth"]["kept"] is not False
    assert result.arrays["contact_force"].max() > 0.0


def two_blocks(sliding):
    """Return a damped block that is drawn over one of another damping, held below; a force pushes it down."""
    blocks = {
        "lower": {"block": {"size": [2.0, 0.5], "elements": [6, 2]}, "at": [0, 0], "fixed": ["bottom"]},
        "upper": {"block": {"size": [1.0, 0.5], "elements": [4, 2]}, "at": [0.2, 0.5], "velocity": [0, -0.02]},
    }
    for (name, one), alpha in zip(blocks.items(), (0.2, 1.3), strict=True):
        blocks[name] = one | {"material": SOLID, "damping": {"mass": alpha}}
    blocks["upper"]["fixed"] = [{"on": "left", "along": "y"}]
    draw = {"prescribed-velocity": 0.1, "on": "upper.right", "direction": [1, 0], "until": 1.5}
    push = {"constant": 0.01, "on": "upper.top", "direction": [0, -1]}
    seam = {"between": ["upper.bottom", "lower.top"], "sliding": sliding, "friction": {"name": "coulomb", "mu": 0.3}}
    return {
        "percuss": 1,
        "bodies": blocks,
        "contacts": {"seam": seam},
        "loads": {"draw": draw, "push": push},
        "method": {"integrator": WU, "contact": "lagrange", "pairing": "node-to-segment"},
        "time": {"end": 3.0, "courant": 0.5},
    }


@pytest.mark.parametrize("sliding", ["small", "large"])
def test_supports_drives_and_loads_on_damped_bodies_close(sliding):
    result = balanced(ran(two_blocks(sliding)))
    assert result.summary["angular_momentum"]["error"] < 1e-12
    compiled, plain = (percuss.run(percuss.load(two_blocks(sliding)), compiled=how) for how in (True, False))
    for name in ("damped_energy", "contact_force", "support_force"):
        one, other = compiled.arrays[name], plain.arrays[name]
        assert np.nanmax(np.abs(one - other)) < 1e-12 * np.nanmax(np.abs(one))


@pytest.mark.parametrize("loads", [{}, {"push": {"constant": 0.01, "on": "rod.right"}}, "gravity"])
def test_the_work_of_bodies_that_are_not_linear_closes(loads):
    if loads == "gravity":
        loads = {"fall": {"gravity": 0.02, "on": "rod", "direction": [-1]}}
    plastic = {"name": "bilinear-plastic", "young": 1.0, "density": 1.0, "yield_stress": 0.03, "tangent": 0.3}
    rod = bar(1.0, 8, at=0.01, velocity=-0.1, material=plastic) | {"damping": {"mass": 0.7}}
    case = case_of({"rod": rod}, {"wall": {"body": "rod.left", "wall": 0.0}}, {"end": 2.0, "courant": 0.5}, loads)
    result = balanced(ran(case | {"method": {"integrator": WU, "contact": "lagrange"}}))
    assert result.summary["energy"]["dissipated"] > 0.0
    assert result.summary["energy"]["damped"] > 0.0


def test_no_exact_solution_judges_a_damped_bar():
    rod = bar(1.0, 8, at=0.01, velocity=-0.1) | {"damping": {"mass": 0.7}}
    case = case_of({"rod": rod}, {"wall": {"body": "rod.left", "wall": 0.0}}, {"end": 2.0, "courant": 0.5})
    summary = ran(case).summary
    assert summary["exact"] is None
    assert "body 'rod' is damped" in summary["exact_reason"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"method.integrator": "noh-bathe"}, "expected a leap-frog scheme, found noh-bathe"),
        ({"bodies.block.damping": {"mass": -1}}, "damping.mass: expected .* 0"),
        ({"bodies.block.damping": 3}, r"damping: expected a mapping as \{mass: 0.05\}, found 3"),
        ({"bodies.block.damping": {"stiffness": 1}}, "mass"),
    ],
)
def test_what_does_not_go_with_damping_is_refused_at_its_key(changes, said):
    with pytest.raises(percuss.errors.InputError, match=said):
        ran(block(0.5), **changes)
