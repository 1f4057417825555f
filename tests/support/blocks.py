"""Blocks of cells that meet along x, and the bars that they are where nothing strains them across."""

import percuss
from strategies import LAWS_OF_SURFACES

SEAM = {"tip": {"between": ["left.right", "right.left"]}}


def block(at, speed, elements, poisson=0.0, cells=None, size=None, **more):
    """Return a block in as many dimensions as it has numbers of elements, at a place along x, which moves along x."""
    dim = len(elements)
    shape = {"size": list(size or [1.0, 0.2, 0.3][:dim]), "elements": list(elements)}
    still = [0.0] * (dim - 1)
    return {
        "block": shape | ({"cells": cells} if cells else {}), "at": [at, *still], "velocity": [speed, *still],
        "material": {"young": 1.0, "density": 1.0, "poisson": poisson}, **more,
    }  # fmt: skip


def bar(at, speed, elements=20, area=0.2, young=1.0, **more):
    """Return a bar of length 1."""
    return {
        "bar": {"length": 1.0, "elements": elements}, "at": at, "velocity": speed, "area": area,
        "material": {"young": young, "density": 1.0}, **more,
    }  # fmt: skip


def impact(bodies, integrator, law, step=0.02, pairing=None, contacts=SEAM, end=2.5):
    """Return the run of two bodies that meet, under a law of `LAWS_OF_SURFACES`."""
    method = {"integrator": integrator, "contact": {"name": law, **LAWS_OF_SURFACES[law]}}
    return percuss.run(percuss.load({
        "percuss": 1, "bodies": bodies, "contacts": contacts,
        "method": method | ({"pairing": pairing} if pairing else {}),
        "time": {"step": step, "end": end, "on_unstable": "warn"},
    }))  # fmt: skip


def alone(body, wall=None, on="right", **more):
    """Return a case of one body, perhaps at a wall; of one step, unless `time` says otherwise."""
    contacts = {} if wall is None else {"w": {"body": f"a.{on}", "wall": wall}}
    time = {"courant": 0.5, "steps": 1}
    return percuss.load({"percuss": 1, "bodies": {"a": body}, "contacts": contacts, "time": time, **more})
