"""Blocks of cells that meet along x, and the bars that they are where nothing strains them across."""

import numpy as np

import percuss
from strategies import LAWS_OF_SURFACES

SEAM = {"tip": {"between": ["left.right", "right.left"]}}


def block(at, speed, elements, poisson=0.0, cells=None, size=None, **more):
    """Return a block in as many dimensions as it has numbers of elements; numbers are places and speeds along x."""
    dim = len(elements)
    shape = {"size": list(size or [1.0, 0.2, 0.3][:dim]), "elements": list(elements)}
    at, velocity = (list(one) if isinstance(one, list | tuple) else [one] + [0.0] * (dim - 1) for one in (at, speed))
    return {
        "block": shape | ({"cells": cells} if cells else {}), "at": at, "velocity": velocity,
        "material": {"young": 1.0, "density": 1.0, "poisson": poisson}, **more,
    }  # fmt: skip


def bar(at, speed, elements=20, area=0.2, young=1.0, length=1.0, **more):
    """Return a bar."""
    return {
        "bar": {"length": length, "elements": elements}, "at": at, "velocity": speed, "area": area,
        "material": {"young": young, "density": 1.0}, **more,
    }  # fmt: skip


def plane_at(point, normal):
    """Return a wall."""
    return {"point": list(point), "normal": list(normal)}


def loaded(bodies, contacts=None, method=None, time=None, plugins=(), registry=None, **more):
    """Return the case of some bodies; of one step, unless `time` says otherwise."""
    data = {"percuss": 1, "bodies": bodies, "contacts": contacts or {}, "method": method or {}}
    data |= {"time": time or {"courant": 0.5, "steps": 1}, **more}
    return percuss.load(data, plugins=plugins, registry=registry)


def impact(bodies, integrator, law, step=0.02, pairing=None, contacts=SEAM, end=2.5):
    """Return the run of two bodies that meet, under a law of `LAWS_OF_SURFACES`."""
    method = {"integrator": integrator, "contact": {"name": law, **LAWS_OF_SURFACES[law]}}
    method |= {"pairing": pairing} if pairing else {}
    return percuss.run(loaded(bodies, contacts, method, {"step": step, "end": end, "on_unstable": "warn"}))


def alone(body, wall=None, on="right", **more):
    """Return a case of one body, perhaps at a wall."""
    return loaded({"a": body}, {} if wall is None else {"w": {"body": f"a.{on}", "wall": wall}}, **more)


def chain(places, start=0):
    """Return the surface of a body along a chain of points in the plane, the body on the left."""
    points = np.array(places, dtype=float)
    numbers = np.arange(len(points))
    along = np.diff(points, axis=0)
    lengths = np.linalg.norm(along, axis=1)
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / lengths[:, None]
    return percuss.Surface(start + numbers, points, np.stack([numbers[:-1], numbers[1:]], axis=1), normals, lengths)


def plate(across, up, x=0.0, start=0, out=1.0, triangles=False, bent=0.0):
    """Return a surface across x whose normal is along `out`, with nodes at all pairs of two lists of coordinates.

    With `bent` the nodes inside move by so much along the surface, to and fro.
    """
    across, up = np.array(across, dtype=float), np.array(up, dtype=float)
    y, z = (values.ravel() for values in np.meshgrid(across, up, indexing="ij"))
    inside = (y > across.min()) & (y < across.max()) & (z > up.min()) & (z < up.max())
    to_and_fro = bent * inside * np.array([1.0, -1.0, -1.0])[np.arange(y.size) % 3]
    points = np.stack([np.full(y.size, x), y + to_and_fro, z - to_and_fro], axis=1)
    number = np.arange(y.size).reshape(across.size, up.size)
    facets = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1).reshape(-1, 4)
    facets = facets if out > 0.0 else facets[:, ::-1]
    facets = np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]]) if triangles else facets
    made = percuss.Surface(np.arange(start, start + y.size), points, facets, np.zeros((0, 3)), np.zeros(0))
    vectors = made.outward(np.arange(len(facets)), np.full(facets.shape, 1.0 / facets.shape[1]))
    areas = np.linalg.norm(vectors, axis=1)
    return made._replace(normals=vectors / areas[:, None], areas=areas)
