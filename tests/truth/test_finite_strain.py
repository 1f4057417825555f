"""Materials of finite strain: closed forms, spinning bodies, rings that bounce, cells that turn inside out."""

import dataclasses
import itertools
import re

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import percuss
import places
from accounts import ran
from marks import deep
from percuss.errors import InputError
from percuss.march.march import March
from percuss.march.model_of_case import model_of
from percuss.mesh.cells import element_masses, lumping_of
from percuss.mesh.element_probe import ElementProbe
from percuss.methods.registry import Registry

WU, CD = "wu-predictor-corrector", "central-difference"
NEO, KIRCHHOFF, METAL = "neo-hookean", "st-venant-kirchhoff", "j2-plastic"
OF_FEW_POINTS = ("quad4-mean", "hex8-mean", "quad4-one-point", "hex8-one-point")  # or of one volume strain
SOLID = {"young": 1.0, "density": 1.0, "poisson": 0.3}
FIRST, SECOND = 0.3 / (1.3 * 0.4), 0.5 / 1.3  # Lamé's constants of these


def material(name):
    return Registry.load().get("materials", name)(**SOLID)


def stress_of(name, gradient):
    of_it, dim = material(name), len(gradient)
    kernel = of_it.stress_2d if dim == 2 else of_it.stress_3d
    numbers = np.array(of_it.solid_parameters("strain" if dim == 2 else ""))
    return np.reshape(kernel(numbers, tuple(np.ravel(gradient).tolist())), (dim, dim))


def stored_of(name, gradient):
    of_it, dim = material(name), len(gradient)
    kernel = of_it.stored_2d if dim == 2 else of_it.stored_3d
    return kernel(np.array(of_it.solid_parameters("strain" if dim == 2 else "")), np.ravel(gradient))


def in_the_books(name, f):
    """Return P by tensors, of F in space."""
    if name == NEO:
        inverse = np.linalg.inv(f).T
        return SECOND * (f - inverse) + FIRST * np.log(np.linalg.det(f)) * inverse
    strain = 0.5 * (f.T @ f - np.eye(3))
    return f @ (FIRST * np.trace(strain) * np.eye(3) + 2.0 * SECOND * strain)


deformations = st.lists(st.floats(-0.4, 0.4), min_size=9, max_size=9).map(lambda h: np.reshape(h, (3, 3)))


@pytest.mark.parametrize("name", [NEO, KIRCHHOFF])
@given(h=deformations)
def test_stress_and_energy_are_those_of_the_books(name, h):
    """In the plane they are those in space with nothing across; the stress is the slope of the energy."""
    flat = np.zeros((3, 3))
    flat[:2, :2] = h[:2, :2]
    if min(np.linalg.det(np.eye(3) + one) for one in (h, flat)) < 0.1:
        return
    assert stress_of(name, h) == pytest.approx(in_the_books(name, np.eye(3) + h), abs=1e-12)
    assert stress_of(name, flat[:2, :2]) == pytest.approx(in_the_books(name, np.eye(3) + flat)[:2, :2], abs=1e-12)
    assert stored_of(name, flat[:2, :2]) == pytest.approx(stored_of(name, flat), abs=1e-14)
    way = np.random.default_rng(0).normal(size=(3, 3))
    slope = (stored_of(name, h + 1e-5 * way) - stored_of(name, h - 1e-5 * way)) / 2e-5
    assert slope == pytest.approx((stress_of(name, h) * way).sum(), abs=1e-8)


@pytest.mark.parametrize(("name", "dim"), [*itertools.product((NEO, KIRCHHOFF), (2, 3))])
def test_small_strains_have_hookes_stress(name, dim):
    strain = 1e-7 * np.random.default_rng(1).normal(size=(dim, dim))
    hooke = FIRST * np.trace(strain) * np.eye(dim) + SECOND * (strain + strain.T)
    assert stress_of(name, strain) == pytest.approx(hooke, abs=1e-6 * np.abs(hooke).max())


def spinning(name, element, turns):
    """Return a block that spins some turns, stretched by its spin, and moves along."""
    cells = element.split("-")[0]
    dim = 3 if cells in {"hex8", "tet4"} else 2
    spin, size = 0.3, [2.0, 1.0, 1.0][:dim]
    material = {"name": name, **SOLID, **({"yield_stress": 0.02, "hardening": 0.1} if name == METAL else {})}
    body = {"block": {"size": size, "elements": [4, 2, 2][:dim], "cells": cells}, "element": element}
    body |= {"material": material}
    body |= {"spin": spin if dim == 2 else [0.1, 0.2, spin], "velocity": [0.1, 0.05, -0.02][:dim], "at": [0.0] * dim}
    return {
        "percuss": 1,
        "bodies": {"block": body},
        "contacts": {},
        "time": {"end": turns * 2.0 * np.pi / spin, "courant": 0.5},
        "method": {"integrator": WU, "contact": "lagrange", "pairing": "node-to-segment"},
    }


SPINS = [*itertools.product((NEO, KIRCHHOFF), ("quad4", "tri3", "hex8", "tet4"))]
SPINS += [deep(*row) for row in itertools.product((NEO, KIRCHHOFF), OF_FEW_POINTS)]
SPINS += [(METAL, "quad4-mean"), deep(METAL, "hex8-mean")]


@pytest.mark.parametrize(("name", "element"), SPINS)
def test_a_free_body_keeps_its_momenta_over_three_turns(name, element):
    march = March(model_of(percuss.load(spinning(name, element, 3.0))))
    outcome, bodies = march.run(), march.model.bodies
    momenta = []
    for velocity, displacement in (
        (outcome.starting_velocity, np.zeros_like(outcome.final_displacement)),
        (outcome.final_velocity, outcome.final_displacement),
    ):
        places = bodies.nodes + displacement.reshape(bodies.nodes.shape)
        momenta.append(bodies.with_moment(places, bodies.mass[:, None] * velocity.reshape(places.shape)).sum(axis=0))
    assert momenta[1] == pytest.approx(momenta[0], abs=1e-13 * np.abs(momenta[0]).max())
    summary = ran(spinning(name, element, 3.0)).summary
    assert summary["energy"]["ledger_error"] < 1e-14
    assert name != METAL or summary["energy"]["dissipated"] > 0.01 * summary["energy"]["initial"]


def ring(friction="none", **changes):
    """Return a ring of rubber that is thrown at a floor; two bounces."""
    case = {
        "percuss": 1,
        "bodies": {
            "ring": {
                "ring": {"inner": 0.8, "outer": 1.0, "elements": [40, 3]},
                "at": [0.0, 1.0],
                "material": {"name": NEO, **SOLID},
                "velocity": [0.02, -0.03],
            }
        },
        "contacts": {"floor": {"body": "ring.outer", "wall": {"point": [0, 0], "normal": [0, 1]}}},
        "loads": {"fall": {"gravity": 0.002, "direction": [0, -1]}},
        "method": {"integrator": WU, "contact": "lagrange", "pairing": "node-to-segment", "friction": friction},
        "time": {"end": 90.0, "courant": 0.5},
    }
    return case | changes


@pytest.mark.parametrize(("friction", "kept"), [("none", 0.93), ({"name": "coulomb", "mu": 0.3}, 0.71)])
def test_a_ring_keeps_what_it_should_over_two_bounces(friction, kept):
    """By a program written apart."""
    result = ran(ring(friction))
    energy = result.summary["energy"]
    assert (energy["final"] - energy["external_work"]) / energy["initial"] == pytest.approx(kept, abs=0.01)
    assert energy["ledger_error"] < 2e-14
    assert result.summary["momentum"]["error"] < 1e-12
    if friction == "none":
        assert result.summary["certificate"]["energy"] == "not guaranteed"


def dropped(name, velocity):
    """Return a soft block that falls on a stiff base, which OpenSees' users found to end a run."""
    soft = {"block": {"size": [1, 1, 1], "elements": [3, 3, 3]}, "at": [4.5, 4.5, 2.0], "velocity": [0, 0, -velocity]}
    stiff = {"block": {"size": [10, 10, 2], "elements": [2, 2, 2]}, "at": [0.0, 0.0, 0.0], "fixed": ["bottom"]}
    soft["material"] = {"name": name, "young": 1e6, "density": 10.0, "poisson": 0.0}
    stiff["material"] = {"name": NEO, "young": 1e10, "density": 1e6, "poisson": 0.0}
    return {
        "percuss": 1,
        "bodies": {"block": soft, "base": stiff},
        "contacts": {"seam": {"between": ["block.bottom", "base.top"], "sliding": "large"}},
        "loads": {"fall": {"gravity": 98.1, "on": "block", "direction": [0, 0, -1]}},
        "method": {"integrator": WU, "contact": "lagrange", "pairing": "node-to-segment"},
        "time": {"end": 0.012, "courant": 0.5},
        "record": {"fields": 100},
    }


def least_stretch(velocity, step, duration):
    """Return the least stretch of three cells of a neo-Hookean column of nu 0 whose end stops, by a march apart."""
    mass, place, least = np.array([1.0, 2.0, 2.0, 1.0]) * 10.0 / 6.0, np.linspace(0.0, 1.0, 4), 1.0
    speed = np.full(4, -velocity)
    for _ in range(int(duration / step)):
        stretch = np.diff(place) * 3.0
        least = min(least, stretch.min())
        force = 0.5e6 * (stretch - 1.0 / stretch)
        speed += step * np.append(force, 0.0) / mass - step * np.append(0.0, force) / mass
        speed[0] = max(speed[0], -place[0] / step)
        place += step * speed
    return least


@pytest.mark.parametrize("velocity", [9.9, 99.0, 200.0])
def test_a_dropped_block(velocity):
    """Contact takes the energy of the layer of nodes that strikes, which has 1/6 of the mass."""
    result = ran(dropped(NEO, velocity), **{"time.courant": 0.02})
    energy = result.summary["energy"]
    assert 1.0 + energy["contact_work"] / energy["initial"] == pytest.approx(5.0 / 6.0, abs=1e-6)
    assert (energy["final"] - energy["external_work"]) / energy["initial"] == pytest.approx(5.0 / 6.0, abs=1e-3)
    assert energy["ledger_error"] < 2e-14
    own = np.array(result.field_arrays["body"]) == "block"
    least = least_stretch(velocity, result.summary["dt"], 0.012)
    assert np.nanmin(result.field_arrays["volume_ratio"][:, own]) == pytest.approx(least, abs=1e-3)


def test_a_cell_that_turns_inside_out_ends_the_run():
    with pytest.raises(percuss.RunError) as told:
        ran(dropped(KIRCHHOFF, 150.0))
    words = str(told.value)
    numbers = r"with (\S+) of its volume at the start, after (\S+) a step before\n  likely cause: its nodes close"
    found = re.search(r"cell \d of body 'block' is inside out at its point \d, " + numbers, words)
    now, before = map(float, found.groups())
    assert now <= 0.0 < before < 0.6


@pytest.mark.parametrize("name", [NEO, KIRCHHOFF])
def test_plane_stress_is_refused(name):
    case = ring()
    case["bodies"]["ring"] |= {"material": {"name": name, **SOLID}, "plane": "stress"}
    with pytest.raises(InputError, match="not in plane stress"):
        ran(case)


@pytest.mark.parametrize(
    ("materials", "given", "slides", "told"),
    [
        ((NEO, NEO), {}, True, False),
        ((NEO, "elastic"), {}, True, False),
        (("elastic", "elastic"), {}, False, False),
        ((NEO, NEO), {"sliding": "small"}, False, True),
        (("elastic", "elastic"), {"sliding": "large"}, True, False),
    ],
)
def test_contacts_of_bodies_of_finite_strain_slide_far_by_default(materials, given, slides, told):
    case = {
        "percuss": 1,
        "bodies": {
            name: {
                "block": {"size": [1, 1], "elements": [2, 2]},
                "at": [0.0, float(k)],
                "material": {"name": kind, **SOLID},
                "velocity": [0.0, 0.01 * (1 - k)],
            }
            for k, (name, kind) in enumerate(zip(("low", "high"), materials, strict=True))
        },
        "contacts": {"seam": {"between": ["low.top", "high.bottom"], **given}},
        "time": {"steps": 5, "courant": 0.5},
    }
    result = ran(case)
    assert ("renewal" in result.summary["contacts"]["seam"]) is slides
    notes = [note for note in result.summary["notes"] if "slides small: its normals and partners" in note]
    assert bool(notes) is told


def pressed(cells="quad4", time=None, name=NEO):
    """Return a block that is pressed flat between rollers."""
    dim = 3 if cells in {"hex8", "tet4"} else 2
    up = "z" if dim == 3 else "y"
    sides = [("left", "x"), ("right", "x"), ("bottom", up), *([("front", "y"), ("back", "y")] if dim == 3 else [])]
    body = {"block": {"size": [1.0] * dim, "elements": [2] * dim, "cells": cells}, "at": [0.0] * dim}
    body |= {"material": {"name": name, **SOLID}, "fixed": [{"on": side, "along": axis} for side, axis in sides]}
    return {
        "percuss": 1,
        "bodies": {"block": body},
        "contacts": {},
        "loads": {"press": {"prescribed-velocity": 0.01, "on": "block.top", "direction": [0.0] * (dim - 1) + [-1.0]}},
        "time": time or {"end": 60.0, "courant": 0.2},
        "method": {"integrator": CD, "contact": "lagrange"},
    }


@pytest.mark.parametrize("cells", ["quad4", "tri3", "hex8", "tet4"])
def test_the_stretch_of_cells_is_that_of_their_slopes_where_they_are(cells):
    """Of a body pressed to 0.4 of its height: frequencies of the slopes of shape functions on the mesh of the end."""
    march = March(model_of(percuss.load(pressed(cells))))
    outcome = march.run()
    (body,) = march.model.bodies.values()
    moved = body.mesh.nodes + outcome.final_displacement.reshape(body.mesh.nodes.shape)
    frequencies = []
    for nodes in (body.mesh.nodes, moved):
        view = dataclasses.replace(body.view, mesh=body.mesh._replace(nodes=nodes))
        every = np.arange(body.count)
        slopes = ElementProbe(body.spec.element, body.spec.material, view).slopes(every, 1e-7)
        shares = lumping_of(body.spec.element, body.view).shares
        masses = shares * element_masses(body.spec.element, body.view, 1.0)[:, None]
        inertia = np.einsum("kqai,kqaj,ka->kqij", slopes, slopes, 1.0 / masses)
        frequencies.append(np.sqrt(np.linalg.eigvalsh(inertia)[..., -1]))
    found = ran(pressed(cells)).summary["stretch"]
    assert found["largest"] == pytest.approx(
        (frequencies[1] / frequencies[0]).max(), rel=0.03
    )  # it looks every 20 steps
    assert found["largest"] > 1.9
    assert found["courant_stretched"] == pytest.approx(found["courant"] * found["largest"])
    assert found["time"] > 55.0


def test_a_step_that_becomes_too_long_ends_the_run():
    """With the Courant number to start with, which is enough."""
    with pytest.raises(percuss.RunError) as told:
        ran(pressed(time={"end": 60.0, "courant": 0.6}))
    words = str(told.value)
    assert "the step is too long for cell" in words
    (courant,) = re.findall(r"--set time.courant=(\S+)` or below", words)
    time = {"end": told.value.result.summary["end"], "courant": float(courant)}
    assert ran(pressed(time=time)).status == "done"


def test_the_automatic_step_leaves_room_for_a_stretch():
    for time, courant in (({"courant": "auto"}, 0.45), ({"courant": "auto", "stretch": 4}, 0.225)):
        result = ran(pressed(time={"end": 1.0, **time}))
        assert result.summary["courant"] == pytest.approx(courant)
        assert result.summary["stretch"]["courant"] == pytest.approx(courant)


@pytest.mark.parametrize(
    ("time", "name", "message"),
    [
        ({"end": 1.0, "courant": 0.5, "stretch": 2}, NEO, "has a `stretch`, which belongs to `courant: auto`"),
        ({"end": 1.0, "courant": "auto", "stretch": 2}, "elastic", "expected a body of finite strain"),
        ({"end": 1.0, "courant": "auto", "stretch": 0.5}, NEO, "expected a number of at least 1"),
    ],
)
def test_a_stretch_that_has_no_meaning_is_refused(time, name, message):
    with pytest.raises(InputError, match=message):
        ran(pressed(time=time, name=name))


def discs(friction, pairing):
    """Return two discs of rubber that roll past each other."""
    disc = {"disk": {"radius": 1.0, "elements": 12}, "material": {"name": NEO, **SOLID}}
    law = "regularised-lagrange" if pairing == "gauss-points" else "lagrange"
    return {
        "percuss": 1,
        "bodies": {
            "left": {**disc, "at": [0.0, 0.0], "velocity": [0.05, 0.0]},
            "right": {**disc, "at": [2.0, 0.9], "velocity": [-0.05, 0.0], "spin": 0.02},
        },
        "contacts": {"seam": {"between": ["left.skin", "right.skin"]}},
        "method": {"integrator": WU, "contact": law, "pairing": pairing, "friction": friction},
        "time": {"end": 30.0, "courant": 0.5},
    }


COULOMB = {"name": "coulomb", "mu": 0.3}
ROLLING = [*itertools.product(("none", COULOMB), ("gauss-points", "node-to-segment", "mortar"))]


@pytest.mark.parametrize(("friction", "pairing"), ROLLING)
def test_angular_momentum_of_discs_that_roll_past_each_other(friction, pairing):
    """All that changes it is the couple of the contact: of friction over the gap, or of a normal at a vertex."""
    result = ran(discs(friction, pairing))
    summary = result.summary
    assert summary["contacts"]["seam"]["impulse"] > 0.01
    assert summary["energy"]["ledger_error"] < 1e-13
    account = summary["angular_momentum"]
    assert account["error"] < 1e-12
    assert account["balanced"] is True
    assert account["couple_of_contacts"] == account["impulse_of_contacts"]
    change = np.array(account["final"]) - account["initial"]
    assert change == pytest.approx(account["couple_of_contacts"], abs=1e-13)
    assert np.abs(change).max() < 0.01 * np.abs(account["initial"]).max()


def test_angular_momentum_of_a_disc_of_small_strains_that_rolls_past_one_of_rubber():
    """Places at the start count for the linear disc, those of each step for the other."""
    case = discs(COULOMB, "node-to-segment")
    case["bodies"]["right"] |= {"material": {"name": "elastic", **SOLID}, "damping": {"mass": 0.02}}
    case["loads"] = {"fall": {"gravity": 0.001, "direction": [0.0, -1.0]}}
    account = ran(case).summary["angular_momentum"]
    assert account["error"] < 1e-12
    for name in ("loads", "damping", "contacts"):
        assert abs(account[f"impulse_of_{name}"][0]) > 1e-4, name


@pytest.mark.parametrize("held_material", [KIRCHHOFF, "elastic"])
@pytest.mark.parametrize("dim", [2, 3])
def test_angular_momentum_with_supports_loads_walls_damping_and_a_fall(dim, held_material):
    spin = 0.1 if dim == 2 else [0.1, 0.05, -0.02]
    block = {"block": {"size": [2.0, 1.0, 1.0][:dim], "elements": [4, 2, 2][:dim]}, "at": [0.0] * (dim - 1) + [0.05]}
    block |= {"material": {"name": NEO, **SOLID}, "velocity": [0.1, 0.0, -0.1][-dim:], "spin": spin}
    block |= {"damping": {"mass": 0.1}}
    held = {"block": {"size": [1.0] * dim, "elements": [2] * dim}, "at": [9.0] * dim, "fixed": ["left"]}
    held |= {"material": {"name": held_material, **SOLID}, "damping": {"mass": 0.05}}
    down = [0.0] * (dim - 1) + [-1.0]
    case = {
        "percuss": 1,
        "bodies": {"block": block, "held": held},
        "contacts": {
            "floor": {
                "body": "block.bottom",
                "wall": {"point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0], "moving": "lift"},
                "friction": COULOMB,
            }
        },
        "loads": {
            "fall": {"gravity": 0.02, "direction": down},
            "pull": {"constant": 0.01, "on": "held.right", "direction": down},
            "lift": {"prescribed-velocity": 0.02, "direction": [0.0] * (dim - 1) + [1.0]},
            "drive": {"prescribed-velocity": 0.01, "on": "held.right", "along": "x", "until": 4.0},
        },
        "method": {"integrator": WU, "contact": "lagrange", "pairing": "node-to-segment"},
        "time": {"end": 10.0, "courant": 0.4},
    }
    account = ran(case).summary["angular_momentum"]
    assert account["error"] < 1e-12
    for name in ("loads", "supports", "contacts", "damping"):
        assert np.abs(account[f"impulse_of_{name}"]).max() > 1e-4, name
    assert np.abs(account["couple_of_contacts"]).max() == 0.0


def test_a_block_that_spins_between_a_floor_and_a_ceiling():
    """Walls take its angular momentum and give no energy, but for an error of the second order in the step."""
    case, excess = percuss.load(places.CASES / "spinning-block.yaml"), []
    for courant in (0.4, 0.2):
        result = percuss.run(case, {"time.courant": courant})
        account, energy = result.summary["angular_momentum"], result.summary["energy"]
        assert account["error"] < 1e-12
        assert np.abs(account["impulse_of_contacts"]) > np.abs(account["initial"])  # its spin turns round
        assert min(contact["impulse"] for contact in result.summary["contacts"].values()) > 0.1  # by each corner
        assert energy["contact_work_max"] <= 1e-15
        assert result.arrays["friction_dissipated"][-1].min() > 0.01 * energy["initial"]
        assert energy["ledger_error"] < 1e-14
        excess.append(energy["max"] / energy["initial"] - 1.0)
    assert excess[0] < 3e-4
    assert excess[0] == pytest.approx(4.0 * excess[1], rel=0.05)


def test_a_corner_that_slips_backwards_as_it_touches_gives_no_energy():
    """Its friction takes a third of the energy; in the first step of the touch it gives some millionths."""
    changes = {"bodies.block.velocity": [0.02, 0.05], "time.courant": 0.4, "time.end": 10.0}
    result = percuss.run(percuss.load(places.CASES / "spinning-block.yaml", changes))
    assert result.arrays["friction_dissipated"].min() < -1e-6 * result.summary["energy"]["max"]
    assert result.arrays["friction_dissipated"][-1].sum() > 0.2 * result.summary["energy"]["max"]
    assert not [note for note in result.summary["notes"] if "not a valid result" in note]


# ----------------------------------------------------------------------------------------------------- shallow ironing


def ironing(**changes):
    """Return the run of the shipped case, with the places of bodies and files as they are there."""
    return percuss.run(percuss.load(places.CASES / "shallow-ironing.yaml", changes))


FINE = 50.0 * 689.6  # stiffness per area, 50 times the modulus of the foundation per unit length
SPRINGS = {"contact": {"name": "regularised-lagrange", "epsilon_s": FINE}, "pairing": "gauss-points"}
SPRINGS |= {"friction": {"name": "coulomb", "mu": 0.3, "stiffness": FINE}}


@pytest.mark.deep
@pytest.mark.parametrize(
    ("changes", "pressed", "drawn"),
    [
        ({}, (312.5, 66.4), (403.2, 137.6)),
        ({f"method.{key}": value for key, value in SPRINGS.items()}, (307.4, 64.7), (393.6, 132.2)),
        (
            {"contacts.seam.between": ["foundation.top", "block.foot"], "time.courant": 0.25},
            (310.8, 65.7),
            (404.0, 181.3),
        ),
    ],
    ids=["as shipped", "springs at Gauss points", "foundation first"],
)
def test_shallow_ironing(changes, pressed, drawn):
    """Forces of the contact, of a program written apart: pressed by 1, and drawn by 4.5 to 5.5.

    With the foundation first its nodes catch on the front corner of the block: they draw a third more.
    """
    result = ironing(**{"time.end": 325.0, **changes})
    time, force = result.arrays["time"], result.arrays["contact_force_vector"][:, 0]
    sign = -1.0 if changes.get("contacts.seam.between") else 1.0  # the force is that on the first body
    for during, (up, along) in (((49.0, 50.0), pressed), ((275.0, 325.0), drawn)):
        mean = sign * force[(time >= during[0]) & (time <= during[1])].mean(axis=0)
        assert mean == pytest.approx([-along, up], rel=0.03 if sign < 0.0 else 0.01)
        assert -mean[0] / mean[1] == pytest.approx(along / up, rel=0.03 if sign < 0.0 else 0.01)
    energy = result.summary["energy"]
    assert energy["ledger_error"] < 1e-12
    for account in ("momentum", "angular_momentum"):
        assert result.summary[account]["error"] < 1e-12, account
    assert energy["contact_work_max"] <= energy["renewal"] < 0.02 * energy["max"]
    taken = result.arrays["friction_dissipated"][:, 0]
    assert taken.min() > -1e-9 * taken[-1]
    assert taken[-1] > 0.4 * energy["external_work"]
    start = np.searchsorted(time, 50.0)
    kinetic = result.arrays["kinetic_energy"][start] / result.arrays["external_work"][start]
    assert kinetic == pytest.approx(0.018, abs=0.002)


# ------------------------------------------------------------------------------------------------ pressure that follows


def inflated(cells, *, follows=True, plane="strain"):
    """Return a block that spins under a pressure on all of its sides, which rises."""
    dim = 3 if cells in {"hex8", "tet4"} else 2
    block = {"block": {"size": [2.0, 1.0, 0.8][:dim], "elements": [3, 2, 2][:dim], "cells": cells}, "at": [0.0] * dim}
    block |= {"material": {"name": NEO, **SOLID}}
    block |= {"plane": plane} if dim == 2 else {}
    if plane == "strain":
        block |= {"spin": 0.3 if dim == 2 else [0.1, 0.2, 0.3], "velocity": [0.1, 0.05, -0.02][:dim]}
    sides = [
        "right",
        "bottom",
        "top",
        *(["left"] if plane == "strain" else []),
        *(["front", "back"] if dim == 3 else []),
    ]
    return {
        "percuss": 1,
        "bodies": {"block": block},
        "contacts": {},
        "loads": {
            "air": {
                "ramp": {"value": 0.1, "duration": 5.0},
                "as": "pressure",
                "on": [f"block.{side}" for side in sides],
                "follows": follows,
            }
        },
        "method": {"integrator": CD, "contact": "lagrange"},
        "time": {"end": 20.0, "courant": 0.4},
    }


@pytest.mark.parametrize("cells", ["quad4", "tri3", "hex8", "tet4"])
def test_a_pressure_on_all_sides_that_follows_moves_and_turns_nothing(cells):
    """The forces on a closed surface vanish together, and their moments, wherever it is."""
    summary = ran(inflated(cells)).summary
    for account in ("momentum", "angular_momentum"):
        found = summary[account]
        assert found["error"] < 1e-12
        size = np.abs(found["initial"]).max()
        assert found["final"] == pytest.approx(found["initial"], abs=1e-12 * size)
    assert summary["energy"]["external_work"] > 0.005
    assert summary["energy"]["ledger_error"] < 1e-13
    dead = ran(inflated(cells, follows=False)).summary["angular_momentum"]
    assert np.abs(np.subtract(dead["final"], dead["initial"])).max() > 0.01 * np.abs(dead["initial"]).max()


@pytest.mark.parametrize(("cells", "plane"), [("quad4", "strain"), ("tri3", "strain"), ("hex8", ""), ("tet4", "")])
def test_a_pressure_begins_as_one_that_does_not_follow(cells, plane):
    forces = []
    for follows in (True, False):
        case = inflated(cells, follows=follows)
        case["bodies"]["block"].pop("spin")
        case["bodies"]["block"].pop("velocity")
        case["time"] = {"steps": 3, "courant": 1e-3}
        forces.append(March(model_of(percuss.load(case))).run().final_velocity)
    assert np.abs(forces[0]).max() > 0.0
    assert forces[0] == pytest.approx(forces[1], abs=1e-6 * np.abs(forces[1]).max())


def test_a_pressure_on_a_ring_about_an_axis_is_that_on_its_area():
    """A column stands on a support under a pressure on all sides: the reaction is the pressure on its foot."""
    case = inflated("quad4", plane="axisymmetric")
    case["bodies"]["block"] |= {"fixed": [{"on": "left", "along": "x"}, {"on": "bottom", "along": "y"}]}
    case["bodies"]["block"]["damping"] = {"mass": 1.0}
    case["loads"]["air"]["on"] = ["block.right", "block.top"]
    case["time"]["end"], case["record"] = 60.0, {"fields": 10}
    result = ran(case)
    places_ = result.field_arrays["node_position"] + result.field_arrays["displacement"][-1]
    radius = places_[np.isclose(result.field_arrays["node_position"][:, 1], 0.0), 0].max()
    reaction = np.asarray(result.arrays["support_force"])[-1, :, 1].sum()
    assert radius < 1.97
    assert reaction == pytest.approx(0.1 * np.pi * radius**2, rel=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bodies.block.material.name": "elastic"}, "expected bodies of finite strain, found 'block'"),
        ({"loads.air.as": "traction", "loads.air.direction": [1, 0]}, "expected `as: pressure`, found traction"),
        ({"method.integrator": "noh-bathe", "method.contact": "penalty"}, "expected a leap-frog scheme"),
    ],
)
def test_pressures_that_cannot_follow_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        percuss.run(percuss.load(inflated("quad4"), change))


# ------------------------------------------------------------------------------------------------ bounds and limits

BOUNDED = [
    ("node-to-segment", "lagrange"), deep("node-to-segment", "regularised-lagrange"),
    deep("gauss-points", "regularised-lagrange"), deep("mortar", "lagrange"),
]  # fmt: skip


@pytest.mark.parametrize(("pairing", "law"), BOUNDED)
@pytest.mark.parametrize(("speed", "offset"), [(0.03, 0.3), (0.05, 0.9), (0.1, 1.4)])
def test_the_bound_of_the_energy_holds_on_bodies_of_finite_strain(pairing, law, speed, offset):
    """Contact work and what laws store never exceed R, the renewal of rows, whatever the bodies are."""
    case = discs("none", pairing)
    case["method"]["contact"] = law
    case["bodies"]["left"]["velocity"], case["bodies"]["right"]["velocity"] = [speed, 0.0], [-speed, 0.0]
    case["bodies"]["right"]["at"] = [2.0, offset]
    march = March(model_of(percuss.load(case)))
    books = march.run().histories
    assert books["renewal_so_far"].max() > 0.0
    assert books["excess"].max() <= 1e-12 * march.initial_energy


@pytest.mark.deep
@pytest.mark.parametrize(("name", "end"), [("ball-on-wall", 26.0), ("disk-on-wall", 13.0)])
def test_a_slow_impact_of_rubber_is_that_of_hookes_law(name, end):
    """At a thousandth of the wave speed: time within .3 %, force within .7 %."""
    case = yaml.safe_load((places.CASES / f"{name}.yaml").read_text(encoding="utf-8"))
    case["expect"], case["time"] = [], {"end": end, "courant": 0.9}
    (body,) = case["bodies"].values()
    body["velocity"] = [0, -0.001]
    found = []
    for kind in ("elastic", NEO):
        body["material"] = {"name": kind, **SOLID}
        found.append(ran(case).summary["contacts"]["floor"])
    assert found[1]["closed_time"] == pytest.approx(found[0]["closed_time"], rel=0.003)
    assert found[1]["peak_force"] == pytest.approx(found[0]["peak_force"], rel=0.007)
    assert found[1]["impulse"] == pytest.approx(found[0]["impulse"], rel=1e-4)


def test_a_step_that_becomes_too_long_is_told_where_the_case_goes_on():
    case = pressed(time={"end": 60.0, "courant": 0.6, "on_unstable": "warn"})
    try:
        result = ran(case)
    except percuss.RunError as error:
        result = error.result
    assert any("the step became too long for cell" in note for note in result.summary["notes"])
