"""Prisms that move along their axis alone are bars: the exact solution of bars judges them unasked."""

from dataclasses import dataclass

import numpy as np
import pytest

import percuss
from blocks import bar, block, loaded
from marks import deep
from percuss import Mesh, Region, Shape, SolidMaterial
from percuss.contact.contact_problem import contact_problem
from percuss.march.model_of_case import model_of
from percuss.results.exact_only import run_exact
from percuss_methods.shapes.block import Block
from strategies import with_methods

MODULUS = 0.7 / (1.3 * 0.4)  # of longitudinal waves, Young's modulus 1 and Poisson's ratio .3
ROLLERS = [{"on": "bottom", "along": "y"}, {"on": "top", "along": "y"}]


def strip(at, speed, elements=(10, 2), **more):
    return block(at, speed, elements, **more)


def case(bodies, contacts=None, loads=None, **more):
    return loaded(bodies, contacts, time={"courant": 0.5, "end": 3.0}, loads=loads or {}, **more)


SEAM = {"seam": {"between": ["left.right", "right.left"]}}
UP = {"seam": {"between": ["left.top", "right.bottom"]}}
EQUAL = {
    "two strips of unlike meshes": (
        {"left": strip(0, 0.5), "right": strip(1, -0.5, (10, 3))}, {"left": bar(0, 0.5), "right": bar(1, -0.5)},
        SEAM, {},
    ),
    "with a gap, unlike in stiffness and length, one held": (
        {"left": strip(0, 0.5), "right": strip(1.1, 0, size=(2, 0.2), fixed=["right"], cells="tri3")},
        {"left": bar(0, 0.5), "right": bar(1.1, 0, length=2.0, fixed=["right"])},
        SEAM, {},
    ),
    "between rollers": (
        {"left": strip(0, 0.5, poisson=0.3, fixed=ROLLERS),
         "right": strip(1, -0.5, poisson=0.3, fixed=[*ROLLERS, {"on": "right", "along": "x"}])},
        {"left": bar(0, 0.5, young=MODULUS), "right": bar(1, -0.5, young=MODULUS, fixed=["right"])},
        SEAM, {},
    ),
    "at a wall, under pressure and gravity": (
        {"left": strip(0, 0.5, thickness=2.0)}, {"left": bar(0, 0.5, area=0.4)},
        {"w": {"body": "left.right", "wall": 1.05}},
        {"p": {"constant": 0.3, "on": "left.left", "as": "pressure"}, "g": {"gravity": [0.1, 0.0]}},
    ),
    "driven": (
        {"left": strip(0, 0), "right": strip(1, 0)}, {"left": bar(0, 0.0), "right": bar(1, 0.0)},
        SEAM, {"d": {"prescribed-velocity": 0.2, "on": "left.left", "direction": [1, 0]}},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", [deep(name) if name.startswith(("with", "at")) else name for name in EQUAL])
def test_the_exact_solution_of_a_row_of_prisms_is_that_of_its_bars(name):
    prisms, bars, contacts, loads = EQUAL[name]
    found = percuss.run(case(prisms, contacts, loads))
    lines = {body: {**data, "at": [data["at"], 0.0]} for body, data in bars.items()}
    expected = percuss.run(case(lines, contacts, loads))
    assert found.solution is not None, found.summary["exact_reason"]
    time = np.linspace(0.0, 2.9, 57)
    for contact in contacts:
        of_prisms, of_bars = found.solution.contacts[contact], expected.solution.contacts[contact]
        assert of_prisms.force(time) == pytest.approx(of_bars.force(time), abs=1e-12)
        assert of_prisms.gap(time) == pytest.approx(of_bars.gap(time), abs=1e-12)
        assert found.summary["exact"]["contacts"][contact]["force_error_l1"] < 0.4


def test_a_strip_along_any_axis_is_a_bar():
    tall = {"elements": (2, 10), "size": (0.2, 1)}
    up = {"left": strip(0, (0, 0.5), **tall), "right": strip((0, 1), (0, -0.5), **tall)}
    across = {"left": strip(0, 0.5), "right": strip(1, -0.5)}
    results = [percuss.run(case(up, UP)), percuss.run(case(across, SEAM))]
    errors = [result.summary["exact"]["contacts"]["seam"]["force_error_l2"] for result in results]
    assert errors[0] == pytest.approx(errors[1], rel=1e-9)


@pytest.mark.parametrize("grading", [1.0, 3.0])
def test_true_errors_of_quadrilaterals_are_those_of_bars(grading):
    """Of a strip and of bars with as many elements, force and displacement are equal, and so are their errors."""
    strips = {"left": strip(0, 0.5, (20, 4)), "right": strip(1, -0.5, (20, 4))}
    bars = {"left": bar(0, 0.5), "right": bar(1, -0.5)}
    for side, given in (("left", grading), ("right", 1.0 / grading)):
        strips[side]["block"]["grading"] = [given, 2.0]
        bars[side]["bar"]["grading"] = given
    found, expected = (
        percuss.run(loaded(bodies, SEAM, {"contact": "regularised-lagrange"}, {"step": 0.01, "end": 1.5})).summary[
            "exact"
        ]
        for bodies in (strips, bars)
    )
    assert found["displacement_error"] == pytest.approx(expected["displacement_error"], rel=1e-9)
    of_contact, of_bars = (summary["contacts"]["seam"] for summary in (found, expected))
    for name in ("force_error_l1", "force_error_l2", "impulse_error", "noise", "overshoot"):
        assert of_contact[name] == pytest.approx(of_bars[name], rel=1e-9), name


def with_left(speed=0.5, **changes):
    return {"left": strip(0, speed, **changes), "right": strip(1, -0.5)}


NONE = {
    "the body 'left' contracts": (with_left(poisson=0.3), SEAM, {}, "contracts, and no rollers hold its side"),
    "rollers at one side": (
        with_left(poisson=0.3, fixed=ROLLERS[:1]), SEAM, {}, "no rollers hold its side at [0.05, 0.2]",
    ),
    "a side is held": (
        with_left(fixed=["bottom"]), SEAM, {}, "'left.bottom', which is held along the axis, is no face across",
    ),
    "faces of unlike size": (
        {"left": strip(0, 0.5), "right": strip(1, 0, size=(1, 0.3))}, SEAM, {},
        "the faces of contact 'seam' do not cover each other",
    ),
    "a velocity across": (with_left((0.5, 0.1)), SEAM, {}, "body 'left' moves across the axis"),
    "gravity across": (with_left(), SEAM, {"g": {"gravity": [0, -1]}}, "load 'g' acts across the axis"),
    "pressure on a side": (
        with_left(), SEAM, {"p": {"constant": 1, "on": "left.top", "as": "pressure"}},
        "'left.top', which is loaded, is no face across the axis",
    ),
    "contacts along two lines": (
        with_left(), {**SEAM, "w": {"body": "left.bottom", "wall": [0.0, -0.1]}}, {},
        "the case has a contact along more than one line",
    ),
    "nothing moves": ({"left": strip(0, 0)}, {}, {}, "nothing moves"),
    "a support oblique to the axis": (
        {"left": strip(0, (0.3, 0.4), angle=float(np.degrees(np.arctan2(0.4, 0.3))),
                       fixed=[{"on": "left", "along": "x"}])}, {}, {},
        "'left.left' is held in a direction oblique to the axis",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Part(Shape):
    """A block without the cells whose middles lie in a box, with half of each side as a region.

    Formula: ``half = facets whose middles are below the middle of the side``.
    """

    name = "part"
    summary = "a block without a box"
    examples = ({"size": (1.0, 0.5), "elements": (2, 2)},)
    size: tuple[float, ...]
    elements: tuple[int, ...]
    box: tuple[float, ...] = ()

    @property
    def regions(self):
        return tuple(name + half for name in Block(self.size, self.elements).regions for half in ("", "half"))

    @property
    def cell(self):
        return Block(self.size, self.elements).cell

    def dimension(self):
        return len(self.size)

    def mesh(self, at, refine):
        whole = Block(self.size, self.elements).mesh(at, refine)
        ((kind, cells),) = whole.cells.items()
        if self.box:
            middles = whole.nodes[cells].mean(axis=1) - at
            low, high = np.reshape(self.box, (2, -1))
            cells = cells[~((middles > low) & (middles < high)).all(axis=1)]
        used, numbers = np.unique(cells, return_inverse=True)
        cells = numbers.reshape(cells.shape)
        number = np.full(len(whole.nodes), -1)
        number[used] = np.arange(used.size)
        regions = {}
        for name, region in whole.regions.items():
            ((of, facets),) = region.facets.items()
            middles = whole.nodes[facets].mean(axis=1)
            halves = (middles <= middles.mean(axis=0) + 1e-9).all(axis=1)
            facets = number[facets]
            stays = np.array([np.isin(cells, facet).sum(axis=1).max() == facet.size for facet in facets])
            for half, kept in (("", stays), ("half", stays & halves)):
                chosen = facets[kept]
                regions[name + half] = Region(tuple(np.unique(chosen).tolist()), region.outward, {of: chosen})
        return Mesh(whole.nodes[used], {kind: cells}, regions)


def part(at, speed, size=(1.0, 0.2), elements=(4, 2), box=(), **more):
    made = block(at, speed, elements, size=size, **more)
    return {"part": {**made.pop("block"), "box": list(box)}, **made}


WALL = {"w": {"body": "a.left", "wall": {"point": [0, 0], "normal": [1, 0]}}}
FALLS = {"a": part((0, 0), (-0.1, 0))}
BOX = {"size": (1, 1, 1), "elements": (2, 2, 2)}
CORNER = (-1, 0.5, 0.5, 2, 2, 2)
FACES = {"w": {"between": ["a.right", "b.left"]}}
HALF = "has not the area of its face"
PARTS = {
    "whole": (FALLS, WALL, {}, ""),
    "half of a face on a wall": (
        FALLS, {"w": {"body": "a.lefthalf", "wall": {"point": [0, 0], "normal": [1, 0]}}}, {}, f"in contact, {HALF}",
    ),
    "half of a face held": (
        {"a": part((0, 0), (-0.1, 0), fixed=["righthalf"])}, WALL, {}, f"held along the axis, {HALF}",
    ),
    **{
        f"half of a face under a {name}": (FALLS, WALL, {"p": {**load, "on": "a.righthalf"}}, f"loaded, {HALF}")
        for name, load in {
            "pressure": {"constant": 0.1, "as": "pressure"},
            "drive": {"prescribed-velocity": 0.1, "direction": [1, 0]},
        }.items()
    },
    "whole, of revolution": (
        {"a": part((0, 0), (0, -0.1), poisson=0.3, fixed=[{"on": "right", "along": "x"}], plane="axisymmetric")},
        {"w": {"body": "a.bottom", "wall": {"point": [0, 0], "normal": [0, 1]}}}, {}, "",
    ),
    "two pieces": (
        {"a": part((0, 0), (-0.1, 0), elements=(4, 3), box=(-1, 0.07, 2, 0.13))}, WALL, {}, "body 'a' is in 2 pieces",
    ),
    "a neck that no region names": (
        {"a": part((0, 0), (-0.1, 0), elements=(5, 2), box=(0.3, 0.1, 0.7, 1))}, WALL, {}, "is no prism",
    ),
    "rollers on half of a side": (
        {"a": part((0, 0), (-0.1, 0), poisson=0.3, fixed=[ROLLERS[0], {"on": "tophalf", "along": "y"}])}, WALL, {},
        "no rollers hold its side at [",
    ),
    "a corner before a square": (
        {"a": part((0, 0, 0), (0.1, 0, 0), box=CORNER, **BOX), "b": part((1, 0, 0), (0, 0, 0), **BOX)}, FACES, {},
        "do not cover each other",
    ),
    "two equal corners of unlike meshes": (
        {"a": part((0, 0, 0), (0.1, 0, 0), box=CORNER, **BOX),
         "b": part((1, 0, 0), (0, 0, 0), box=CORNER, size=(1, 1, 1), elements=(2, 4, 6))}, FACES, {}, "",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", [*NONE, *PARTS])
def test_a_row_of_prisms_meets_acts_and_is_held_with_its_whole_faces_alone(name):
    """What is no such row is not judged by bars, for the reason that is said."""
    bodies, contacts, loads, said = (NONE | PARTS)[name]
    reason = contact_problem(model_of(case(bodies, contacts, loads, registry=REGISTRY)))
    assert said in reason if said else not isinstance(reason, str)


@dataclass(frozen=True)
class Sheet(SolidMaterial):
    """Orthotropic, with the stiffness 1, 4 and .3 of both.

    Formula: ``xx = e_xx + across e_yy``, ``yy = across e_xx + 4 e_yy``.
    """

    name = "sheet"
    summary = "orthotropic"
    linear = True
    across: float = 0.3
    rho = 1.0

    def solid_parameters(self, plane):
        return (self.across,)

    def wave_modulus(self, plane):
        return 4.0

    @staticmethod
    def stress_2d(parameters, gradient):
        xx, xy, yx, yy = gradient
        shear = 0.4 * (xy + yx)
        return xx + parameters[0] * yy, shear, shear, parameters[0] * xx + 4.0 * yy


REGISTRY = with_methods(Part, Sheet)


@pytest.mark.parametrize(
    ("axis", "across", "modulus"),
    [((1.0, 0.0), 0.0, 1.0), ((1.0, 0.0), 0.3, 1.0), ((0.0, 1.0), 0.3, 4.0), ((0.6, 0.8), 0.0, None)],
)
def test_the_modulus_of_a_prism_is_that_along_its_axis(axis, across, modulus):
    """`wave_modulus` is that of the fastest waves, in whatever direction they run."""
    upright, (x, y) = axis == (0.0, 1.0), axis
    sides = [{"on": side, "along": "xy"[not upright]} for side in (("left", "right") if upright else ("bottom", "top"))]
    size = {"size": (0.2, 1.0), "elements": (2, 20)} if upright else {"size": (1.0, 0.2), "elements": (20, 2)}
    material = {"name": "sheet", "across": across}
    turned = {"angle": float(np.degrees(np.arctan2(y, x)))} if modulus is None else {}
    bodies = {
        name: block(at, (way * x, way * y), **size, **turned, **({"fixed": sides} if across else {}))
        | {"material": material}
        for name, at, way in (("left", (0.0, 0.0), 1e-3), ("right", axis, -1e-3))
    }
    time = {"courant": 0.5, "end": 0.8}
    found = loaded(bodies, UP if upright else SEAM, time=time, registry=REGISTRY)
    problem = contact_problem(model_of(found))
    if modulus is None:
        assert "shears" in problem
        return
    assert {body.modulus for body in problem.bodies.values()} == {modulus}
    force = run_exact(found).arrays["contact_force"]
    assert force.max() == pytest.approx(1e-3 * 0.2 * modulus**0.5, rel=1e-9)
