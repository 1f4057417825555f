"""Runs of small cases, enumerated from the registry, whose numbers `digests.py` records.

A method that is registered joins with its `examples`; the first of these is the one that others are combined with.
All bodies are a few elements long and in contact from the first step on. Combinations that percuss refuses are
enumerated too: the text of the refusal is recorded in place of numbers.

Full products, on bars of unlike elements, of which one may have a longer step than the other:

- integrator x contact law x mass x element,
- integrator x contact law x material,
- mass x element x material, each with all its examples, with two pairs of integrator and law,
- load x what it acts as x where it acts, with four integrators.

Covered, but not in all combinations:

- integrator x contact law on equal bars, which have a loop of their own, compiled and (few steps) as plain Python,
- each further example of an integrator or a mass with some laws, and of a law with some integrators,
- each load with every integrator, mass, element and material, and switched on and off,
- each case of `FEATURES` with every integrator and two laws, with every law and three integrators, and with every
  mass, element and material and some pairs,
- each mass, element, material, load, shape and feature once as plain Python.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from percuss.case.mesh_file import mesh_in, read_mesh
from percuss.methods.registry import Registry

STEPS, PLAIN_STEPS = 50, 25
FAMILIES = ("integrators", "contacts", "frictions", "masses", "elements", "materials", "loads", "shapes")
KEYS = {"integrators": "integrator", "contacts": "contact", "masses": "mass"}

# Methods with which the others are combined where a product is not full.
DEFAULTS = {
    "integrators": "central-difference",
    "contacts": "penalty",
    "masses": "lumped",
    "elements": "bar",
    "materials": "elastic",
}
SOME_INTEGRATORS = ("central-difference", "wu-predictor-corrector", "velocity-verlet")
SOME_LAWS = ("penalty", "lagrange")
SOME_PAIRS = (
    ("central-difference", "penalty"),
    ("velocity-verlet", "penalty"),
    ("asynchronous", "lagrange"),
)

BAR = {"length": 10.0, "elements": 4}
GRADED = {"length": 4.0, "elements": 3, "grading": 1.5}
TURNED = {"length": 10.0, "elements": 5, "grading": 1.5, "direction": [0.6, 0.8]}
IN_SPACE = {"length": 7.0, "elements": 4, "direction": [2.0, 3.0, 6.0]}

# The left bar has the shorter steps and bounces off.
LEFT = {"bar": GRADED, "area": 1.0, "at": 6.0, "velocity": 0.1}
RIGHT = {"bar": {"length": 10.0, "elements": 3}, "area": 1.5, "at": 10.0, "velocity": 0.03}
TIP = {"between": ["a.right", "b.left"]}
STOP = {"body": "b.right", "wall": 20.0}

EQUAL_BARS = {
    "bodies": {
        "a": {"bar": BAR, "area": 1.0, "velocity": 0.1},
        "b": {"bar": BAR, "area": 1.0, "velocity": 0.03, "at": 10.0},
    },
    "contacts": {"tip": TIP, "stop": STOP},
}
UNLIKE_BARS = {
    "bodies": {"a": LEFT, "b": RIGHT},
    "contacts": {"tip": TIP, "stop": STOP},
    "record": {"fields": 3},
}
IN_A_PLANE = {
    "bodies": {
        "a": {"bar": TURNED, "area": 1.0, "velocity": [0.06, 0.08]},
        "b": {"bar": {**TURNED, "elements": 3}, "area": 0.7, "at": [6.0, 8.0], "velocity": [0.02, 0.02]},
    },
    "contacts": {"tip": TIP, "stop": {"body": "b.right", "wall": [12.0, 16.0]}},
}

# One case for each feature of the solver; a body without element or material gets those of the run.
FEATURES: Mapping[str, Mapping[str, Any]] = {
    "bars turned in a plane, with gravity": {**IN_A_PLANE, "loads": {"fall": {"gravity": [0.1, -0.2]}}},
    "bars turned in space, with a fixed end": {
        "bodies": {
            "a": {"bar": IN_SPACE, "area": 1.0, "velocity": [0.1, 0.05, 0.02]},
            "b": {"bar": IN_SPACE, "area": 0.7, "at": [2.0, 3.0, 6.0], "fixed": ["right"]},
        },
        "contacts": {"tip": TIP},
        "loads": {"pull": {"constant": 0.02, "on": "a.left", "direction": [0.0, 1.0, 1.0]}},
    },
    "oblique drives and supports in a plane": {
        **IN_A_PLANE,
        "loads": {
            "slide": {"prescribed-velocity": 0.05, "on": "b.right", "direction": [1.0, 0.0], "from": 0.1},
            "turn": {"prescribed-velocity": 0.02, "on": "a.left", "direction": [1.0, 1.0], "until": 0.15},
            "across": {"prescribed-velocity": 0.0, "on": "a.left", "direction": [-1.0, 1.0], "from": 0.2},
        },
    },
    "velocities across the bars": {
        "bodies": {
            "a": {"bar": TURNED, "area": 1.0, "velocity": [0.2, -0.1]},
            "b": {"bar": TURNED, "area": 0.7, "at": [6.0, 8.0], "fixed": ["right"]},
        },
        "contacts": {"tip": TIP},
        "record": {"fields": 3},
    },
    "several laws at one end": {
        "bodies": {
            "a": LEFT,
            "b": RIGHT,
            "c": {"bar": {"length": 7.0, "elements": 3}, "area": 0.5, "at": 10.0},
        },
        "contacts": {
            "ab": TIP,
            "ac": {"between": ["a.right", "c.left"], "method": {"name": "penalty", "beta_s": 0.2}},
            "aw": {"body": "a.right", "wall": 10.001, "method": "tied"},
            "stop": {**STOP, "method": "lagrange"},
        },
    },
    "laws with kernels at one end": {
        "bodies": {"a": LEFT, "b": RIGHT, "c": {"bar": {"length": 7.0, "elements": 3}, "area": 0.5, "at": 10.0}},
        "contacts": {
            "ab": TIP,
            "ac": {"between": ["a.right", "c.left"], "method": "hunt-crossley"},
            "aw": {"body": "a.right", "wall": 10.001, "method": "walton-braun"},
            "stop": {**STOP, "method": "uzawa"},
        },
    },
    "several contacts of one law at one end": {
        "bodies": {"a": LEFT, "b": RIGHT, "c": {"bar": {"length": 7.0, "elements": 3}, "area": 0.5, "at": 10.0}},
        "contacts": {
            "ab": TIP,
            "ac": {"between": ["a.right", "c.left"]},
            "aw": {"body": "a.right", "wall": 10.001},
            "stop": STOP,
        },
    },
    "stretches with drives, laws with state and a tie for a while": {
        "bodies": {"a": LEFT, "b": RIGHT, "c": {"bar": BAR, "area": 1.0, "at": 20.0}},
        "contacts": {
            "ab": TIP,
            "bc": {"between": ["b.right", "c.left"], "method": {"name": "tied", "during": [[0.05, 0.15], [0.2, 0.3]]}},
            "bond": {"body": "c.right", "wall": 30.0, "method": {"name": "cohesive", "strength": 0.02, "length": 0.5}},
            "spring": {"body": "c.right", "wall": 30.001, "method": "walton-braun"},
        },
        "loads": {
            "push": {"prescribed-velocity": 0.1, "on": "a.left", "from": 0.05, "until": 0.2},
            "back": {"prescribed-velocity": -0.1, "on": "a.left", "from": 0.25},
            "hold": {"prescribed-velocity": 0.0, "on": "b.left", "from": 0.1, "until": 0.12},
        },
    },
    "a drive that lets go of a closed contact": {
        "bodies": {"a": LEFT, "b": RIGHT},
        "contacts": {"tip": TIP},
        "loads": {"hold": {"prescribed-velocity": 0.02, "on": "b.left", "from": 0.02, "until": 0.2}},
    },
    "forces and accelerations on ends and bodies": {
        **UNLIKE_BARS,
        "loads": {
            "fall": {"gravity": 0.5},
            "wind": {"ramp": {"value": 0.1, "duration": 0.1}, "on": "a"},
            "shake": {"harmonic": {"value": 1.0, "frequency": 5.0}, "on": ["b"], "as": "acceleration", "from": 0.05},
            "pull": {"table": {"time": [0.0, 0.1, 0.3], "value": [0.0, 0.04, 0.01]}, "on": "a.left", "until": 0.25},
            "knock": {"half-sine": {"peak": -0.05, "duration": 0.1}, "on": "b.left", "from": 0.1},
        },
    },
    "following loads at a free end and at ends in contact": {
        **UNLIKE_BARS,
        "loads": {
            "leave": {"absorbing": {}, "on": "a.left"},
            "spring": {"spring-dashpot": {"stiffness": 3.0, "damping": 0.2}, "on": "b.left", "from": 0.02},
            "drag": {"absorbing": {}, "on": "b.right", "from": 0.05, "until": 0.2},
        },
    },
    "following loads in a plane": {
        **IN_A_PLANE,
        "loads": {
            "spring": {
                "spring-dashpot": {"stiffness": 3.0, "damping": 0.1},
                "on": "a.right",
                "direction": [1.0, 0.0],
                "until": 0.2,
            },
            "leave": {"absorbing": {}, "on": "b.right"},
        },
    },
    "shaken supports": {
        "bodies": {"a": LEFT, "b": RIGHT},
        "contacts": {"tip": TIP},
        "loads": {
            "quake": {"base-excitation": {"time": [0.0, 0.1, 0.2], "value": [0.0, 2.0, -1.0]}, "on": "a.left"},
            "shore": {"harmonic": {"value": 0.1, "frequency": 4.0}, "on": "b.right", "as": "velocity"},
        },
    },
    "no contact": {
        "bodies": {"a": {**LEFT, "fixed": ["right"]}, "b": {**RIGHT, "at": 12.0}},
        "loads": {"pull": {"constant": 0.05, "on": "a.left"}, "fall": {"gravity": -1.0}},
        "record": {"probes": ["a.left", "b.right"], "fields": 2},
    },
    "gaps that close later, both ends fixed": {
        "bodies": {"a": {**LEFT, "fixed": ["left"]}, "b": {**RIGHT, "at": 10.002, "velocity": -0.05}},
        "contacts": {"tip": TIP, "stop": {"body": "b.right", "wall": 20.003}},
    },
    "a wall that moves": {
        "bodies": {
            "a": {"bar": {"length": 1.0, "elements": 1}, "area": 1.0, "at": 9.0},
            "b": RIGHT,
        },
        "contacts": {"tip": TIP},
        "loads": {"drive": {"prescribed-velocity": 0.1, "on": ["a.left", "a.right"]}},
    },
    "probes, fields and every third step": {
        **UNLIKE_BARS,
        "record": {"every": 3, "probes": ["a.left", "b.right", "a.right"], "fields": 7},
    },
    "bodies of unlike elements and materials": {
        "bodies": {
            "a": {**LEFT, "element": {"name": "spectral-bar", "order": 3}},
            "b": {
                **RIGHT,
                "material": {"name": "bilinear-plastic", "young": 50.0, "density": 0.02, "yield_stress": 0.02},
            },
            "c": {
                "bar": BAR,
                "area": 0.4,
                "at": 20.0,
                "element": "green-bar",
                "material": {"name": "ramberg-osgood", "young": 100.0, "density": 0.01, "yield_stress": 0.05},
            },
            "d": {"bar": BAR, "area": 0.6, "at": 30.0, "element": "quadratic-bar"},
        },
        "contacts": {
            "ab": TIP,
            "bc": {"between": ["b.right", "c.left"]},
            "cd": {"between": ["c.right", "d.left"]},
        },
        "record": {"fields": 3},
    },
    "bodies of unlike stiffness": {
        "bodies": {
            "a": LEFT,
            "b": {**RIGHT, "material": {"young": 4.0, "density": 0.01}},
            "c": {"bar": BAR, "area": 2.0, "at": 20.0, "material": {"young": 25.0, "density": 0.03}},
        },
        "contacts": {"ab": TIP, "bc": {"between": ["b.right", "c.left"]}},
        "loads": {"push": {"constant": 0.01, "on": "b.right"}, "hold": {"prescribed-velocity": 0.0, "on": "c.right"}},
    },
    "more nodes than a block of the loop, graded": {
        "bodies": {
            "a": {**LEFT, "bar": {**GRADED, "elements": 1100}},
            "b": {**RIGHT, "bar": {**GRADED, "elements": 1100}},
        },
        "contacts": {"tip": TIP, "stop": {"body": "b.right", "wall": 14.0}},
        "record": {"fields": 1},
        "time": {"steps": 20, "courant": 0.5},
    },
    "more nodes than a block of the loop, equal elements": {
        "bodies": {
            "a": {**LEFT, "bar": {**BAR, "elements": 2500}},
            "b": {**RIGHT, "bar": {**BAR, "elements": 2500}},
        },
        "contacts": {"tip": TIP, "stop": STOP},
        "time": {"steps": 20, "courant": 0.5},
    },
    "more nodes than a block of the loop, in a plane": {
        "bodies": {
            "a": {"bar": {**TURNED, "elements": 1100}, "area": 1.0, "velocity": [0.06, 0.08]},
            "b": {"bar": {**TURNED, "elements": 1100}, "area": 0.7, "at": [6.0, 8.0]},
        },
        "contacts": {"tip": TIP},
        "time": {"steps": 20, "courant": 0.5},
    },
    "the step chooses itself": {**UNLIKE_BARS, "time": {"steps": STEPS, "courant": "auto"}},
    "a given step and a given end": {**UNLIKE_BARS, "time": {"end": 0.2, "step": 0.007}},
    "the step of the bodies without contact": {**EQUAL_BARS, "time": {"steps": STEPS, "courant": 1.0}},
    "a step too long, refused": {**UNLIKE_BARS, "time": {"steps": STEPS, "courant": 2.5, "on_unstable": "stop"}},
    "a step too long, run all the same": {**UNLIKE_BARS, "time": {"steps": 200, "courant": 2.5}},
    "refined twice": {**UNLIKE_BARS, "refine": 2},
}


SOLID = {"element": "quad4", "material": {"young": 1.0, "density": 1.0, "poisson": 0.3}}
OBLIQUE_BLOCKS = {
    "bodies": {
        "a": {"block": {"size": [1.0, 0.5], "elements": [4, 2]}, "at": [0.0, 0.0], "velocity": [0.004, 0.01], **SOLID},
        "b": {
            "block": {"size": [1.0, 0.5], "elements": [7, 2]},
            "at": [0.0, 0.5],
            "velocity": [-0.004, -0.01],
            **SOLID,
        },
    },
    "contacts": {"seam": {"between": ["a.top", "b.bottom"]}},
    "record": {"fields": 3},
}


class Run(NamedTuple):
    """A run whose numbers are recorded: its name, its case as `percuss.load` takes it, and how it is made."""

    name: str
    case: dict[str, Any]
    compiled: bool = True
    nudge: bool = False
    quick: bool = False


class Choice(NamedTuple):
    """A method with one of its examples: its label in names of runs, and its entry in a case."""

    label: str
    entry: dict[str, Any]
    options: dict[str, Any]


def choices(registry: Registry, family: str) -> dict[str, list[Choice]]:
    """Return all methods of a family by name, each with all its examples; the first is labelled by its name alone."""
    found: dict[str, list[Choice]] = {}
    for name in registry.names(family):
        folder = Path(registry.sources[family, name].file).parent
        for example in registry.get(family, name).examples:
            options = json.loads(json.dumps(dict(example)))  # a case has lists where a class has tuples
            words = " ".join(f"{key}={value}" for key, value in options.items())
            label = f"{name} {words}" if found.get(name) and words else name
            files = {key for key, value in options.items() if isinstance(value, str) and (folder / value).is_file()}
            options |= {key: str(folder / options[key]) for key in files}
            found.setdefault(name, []).append(Choice(label, {"name": name, **options}, options))
    return found


def loaded(parts: Mapping[str, Any], load: Choice, where: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parts of a case with a load."""
    return {**parts, "loads": {"acting": {load.entry["name"]: load.options, **where}}}


class Runs:
    """The runs of all methods of a registry."""

    def __init__(self, registry: Registry) -> None:
        self.all = {family: choices(registry, family) for family in FAMILIES}
        self.shape_classes = {name: registry.get("shapes", name) for name in registry.names("shapes")}

    def names(self, family: str) -> list[str]:
        """Return the names of a family."""
        return list(self.all[family])

    def others(self, family: str) -> list[str]:
        """Return the names of a family but for its default."""
        return [name for name in self.all[family] if name != DEFAULTS[family]]

    def examples(self, family: str, *, first: bool = True) -> Iterator[Choice]:
        """Yield every method of a family with all its examples, or with all but the first."""
        for found in self.all[family].values():
            yield from found if first else found[1:]

    def case(self, parts: Mapping[str, Any], **methods: str | Choice) -> dict[str, Any]:
        """Return a case of the given parts with methods by family, others being the defaults."""
        case = json.loads(json.dumps(dict(parts)))
        chosen = {family: methods.get(family, default) for family, default in DEFAULTS.items()}
        entry = {
            family: self.all[family][choice][0].entry if isinstance(choice, str) else choice.entry
            for family, choice in chosen.items()
        }
        for body in case["bodies"].values():
            body.setdefault("element", entry["elements"])
            body.setdefault("material", entry["materials"])
        return {
            "percuss": 1,
            **case,
            "method": {key: entry[family] for family, key in KEYS.items()},
            "time": {"on_unstable": "warn", **case.get("time", {"steps": STEPS, "courant": 0.5})},
        }

    def run(self, title: str, parts: Mapping[str, Any], *, quick: bool = False, **methods: str | Choice) -> Run:
        """Return a compiled run, named by its title and methods."""
        labels = [choice if isinstance(choice, str) else choice.label for choice in methods.values()]
        return Run(" | ".join([title, *labels]), self.case(parts, **methods), quick=quick)

    def every(self) -> list[Run]:
        """Return every run, each name once."""
        parts = (self.pairs, self.product, self.materials, self.options, self.bodies, self.loads, self.shapes)
        made = [run for part in (*parts, self.frictions, self.sliding, self.features, self.nudged) for run in part()]
        made += list(self.as_plain_python(made))
        by_name: dict[str, Run] = {}
        for run in made:  # the same run may belong to two parts
            if by_name.setdefault(run.name, run).case != run.case:
                raise ValueError(f"two cases have the name {run.name}")
        return list(by_name.values())

    def pairs(self) -> Iterator[Run]:
        """Yield each integrator with each law on equal bars."""
        for integrator, law in itertools.product(self.names("integrators"), self.names("contacts")):
            yield self.run("equal bars", EQUAL_BARS, integrators=integrator, contacts=law, quick=True)

    def product(self) -> Iterator[Run]:
        """Yield each integrator with each law, mass and element."""
        families = ("integrators", "contacts", "masses", "elements")
        for names in itertools.product(*map(self.names, families)):
            methods = dict(zip(families, names, strict=True))
            quick = (methods["integrators"], methods["contacts"]) in SOME_PAIRS
            yield self.run("unlike bars", UNLIKE_BARS, **methods, quick=quick)

    def materials(self) -> Iterator[Run]:
        """Yield each integrator with each law and material but the default one, which `product` has."""
        families = ("integrators", "contacts")
        for *pair, material in itertools.product(*map(self.names, families), self.others("materials")):
            methods = dict(zip(families, pair, strict=True))
            yield self.run("materials", UNLIKE_BARS, **methods, materials=material)

    def options(self) -> Iterator[Run]:
        """Yield each further example of an integrator, a law and a mass with some other methods."""
        for integrator, law in itertools.product(self.examples("integrators", first=False), SOME_LAWS):
            for title, parts in (("equal bars", EQUAL_BARS), ("unlike bars", UNLIKE_BARS)):
                yield self.run(f"options, {title}", parts, integrators=integrator, contacts=law, quick=True)
        for mass in self.examples("masses", first=False):
            for integrator, law in itertools.product(self.names("integrators"), SOME_LAWS):
                methods = {"integrators": integrator, "contacts": law, "masses": mass}
                yield self.run("options, unlike bars", UNLIKE_BARS, **methods)
            for law in self.names("contacts"):
                methods = {"integrators": DEFAULTS["integrators"], "contacts": law, "masses": mass}
                yield self.run("options, unlike bars", UNLIKE_BARS, **methods)
        laws = list(self.examples("contacts", first=False))
        for integrator, law in itertools.product(SOME_INTEGRATORS, laws):
            for title, parts in (("equal bars", EQUAL_BARS), ("unlike bars", UNLIKE_BARS)):
                quick = integrator == DEFAULTS["integrators"] and parts is EQUAL_BARS
                yield self.run(f"options, {title}", parts, integrators=integrator, contacts=law, quick=quick)

    def bodies(self) -> Iterator[Run]:
        """Yield each mass with each element and material, all with all their examples."""
        families = ("masses", "elements", "materials")
        for integrator, law in SOME_PAIRS[:2]:
            for chosen in itertools.product(*map(self.examples, families)):
                methods = dict(zip(families, chosen, strict=True))
                quick = (integrator, law) == SOME_PAIRS[0] and methods["masses"].label == DEFAULTS["masses"]
                yield self.run("bodies", UNLIKE_BARS, **methods, integrators=integrator, contacts=law, quick=quick)

    def loads(self) -> Iterator[Run]:
        """Yield each load, as a force, an acceleration and a velocity, on ends and bodies, and with other methods."""
        kinds, places = (None, "force", "acceleration", "velocity"), ("a.left", "b.left", "a")
        for load in self.examples("loads"):
            title = f"load {load.label}"
            for kind, place, integrator in itertools.product(kinds, places, SOME_INTEGRATORS):
                acting = loaded(UNLIKE_BARS, load, {"on": place, **({"as": kind} if kind else {})})
                quick = kind is None and place == "a.left"
                name = f"{title} as {kind or 'declared'} on {place}"
                yield self.run(name, acting, integrators=integrator, quick=quick)
            always, switched = {"on": "a.left"}, {"on": "a.left", "from": 0.03, "until": 0.25}
            for integrator in self.names("integrators"):
                for name, when in (("always", always), ("switched", switched)):
                    acting = loaded(UNLIKE_BARS, load, when)
                    yield self.run(f"{title} on a.left, {name}", acting, integrators=integrator, contacts="lagrange")
            for family in ("masses", "elements", "materials"):
                for choice, place in itertools.product(self.others(family), ("a.left", "b.left")):
                    acting = loaded(UNLIKE_BARS, load, {"on": place})
                    yield self.run(f"{title} on {place}", acting, **{family: choice})
            yield self.run(f"{title} on a.left, in a plane", loaded(IN_A_PLANE, load, always))
            for name, parts in (("along a line", UNLIKE_BARS), ("in a plane", IN_A_PLANE)):
                yield self.run(f"{title} everywhere, {name}", loaded(parts, load, {}), quick=True)

    def shapes(self) -> Iterator[Run]:
        """Yield each shape, held at its first region and pulled at its last."""
        for shape in self.examples("shapes"):
            name = shape.entry["name"]
            meshes = {key: mesh_in(read_mesh(value, Path()), value) for key, value in shape.options.items()
                      if str(value).endswith(".msh")}  # fmt: skip
            ends = self.shape_classes[name](**{**shape.options, **meshes}).regions
            body = {name: shape.options, "area": 1.0, "fixed": list(ends[:1])}
            parts = {
                "bodies": {"a": body},
                "loads": {"pull": {"constant": 0.05, "on": f"a.{ends[-1]}"}},
                "record": {"probes": [f"a.{end}" for end in ends], "fields": 3},
            }
            for integrator in self.names("integrators"):
                quick = integrator == DEFAULTS["integrators"]
                yield self.run(f"shape {shape.label}", parts, integrators=integrator, quick=quick)

    def frictions(self) -> Iterator[Run]:
        """Yield each friction with each law of two blocks that meet obliquely."""
        for friction, law in itertools.product(self.examples("frictions"), self.names("contacts")):
            run = self.run(f"friction {friction.label}", OBLIQUE_BLOCKS, contacts=law, quick=True)
            run.case["method"] |= {"friction": friction.entry, "pairing": "node-to-segment"}
            yield run

    def sliding(self) -> Iterator[Run]:
        """Yield two blocks that slide far, with each pairing and each law."""
        far = {"contacts": {"seam": {**OBLIQUE_BLOCKS["contacts"]["seam"], "sliding": "large"}}}
        for pairing, law in itertools.product(("gauss-points", "node-to-segment"), self.names("contacts")):
            run = self.run(f"sliding by {pairing}", {**OBLIQUE_BLOCKS, **far}, contacts=law, quick=True)
            run.case["method"] |= {"friction": {"name": "coulomb", "mu": 0.3}, "pairing": pairing}
            yield run

    def features(self) -> Iterator[Run]:
        """Yield each feature with every method, in some combinations."""
        for title, parts in FEATURES.items():
            for integrator, law in itertools.product(self.names("integrators"), SOME_LAWS):
                quick = (integrator, law) in SOME_PAIRS
                yield self.run(title, parts, integrators=integrator, contacts=law, quick=quick)
            for integrator, law in itertools.product(SOME_INTEGRATORS, self.names("contacts")):
                yield self.run(title, parts, integrators=integrator, contacts=law)
            for integrator, law in SOME_PAIRS:
                for family in ("masses", "elements", "materials"):
                    for name in self.others(family):
                        yield self.run(title, parts, integrators=integrator, contacts=law, **{family: name})

    def nudged(self) -> Iterator[Run]:
        """Yield runs with a twin that is slightly thicker."""
        for integrator, law in SOME_PAIRS:
            run = self.run("nudged", UNLIKE_BARS, integrators=integrator, contacts=law, quick=True)
            yield run._replace(nudge=True)

    def as_plain_python(self, made: list[Run]) -> Iterator[Run]:
        """Yield runs of few steps as plain Python: each pair, and each other method and feature once."""
        for run in made:
            pair = run.name.startswith("equal bars")
            if pair or run.quick:
                time = {**run.case["time"], "steps": PLAIN_STEPS}
                time.pop("end", None)
                quick = not pair or any(word in run.name.split(" | ") for word in (*SOME_LAWS, DEFAULTS["integrators"]))
                yield run._replace(
                    name=f"{run.name} | plain", case={**run.case, "time": time}, compiled=False, quick=quick
                )
