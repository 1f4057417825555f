"""Provenance of a result, all that it can be made again with, and the case inside it, which is read again from it.

A result brings no code: its single-file plug-ins are those at their places, or those that the caller names.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime as dt
import platform
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from percuss.case.case import Case, load
from percuss.case.source import Source
from percuss.contact.laws import parameters
from percuss.contact.model import Model
from percuss.contact.pairs import walls_of
from percuss.contact.walls import displacements, round_or_moving
from percuss.digest import own_digest
from percuss.errors import PluginError, Problem, refuse_if_any, wrong_input
from percuss.jsonable import Data, Entries, as_lists, plain
from percuss.march.recording import record_shapes
from percuss.methods.interfaces import Integers
from percuss.methods.registry import Registry
from percuss.methods.single_file import SingleFile
from percuss.version import installed_version

PACKAGES = ("percuss", "numpy", "numba", "llvmlite", "scipy", "xarray", "netCDF4")  # on which numbers may depend


@cache
def processor_model() -> str:
    """Return the processor model as named by the system, or ``unknown`` if it names none."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        named = (line.partition(":")[2].split() for line in lines if line.startswith(("model name", "Model")))
        return " ".join(next(filter(None, named), [])) or "unknown"
    return platform.processor() or "unknown"


def machine() -> Entries:
    """Return versions, the digest of percuss, the processor and the current time for the provenance of a result."""
    return {
        "versions": {"python": platform.python_version(), **{name: installed_version(name) for name in PACKAGES}},
        "source_digest": own_digest(),
        "machine": {"processor": platform.machine(), "cpu": processor_model()},
        "time": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
    }


def resolved_methods(model: Model) -> Data:
    """Return the methods of a model with their resolved parameters and the time step, for the provenance."""
    method, points = model.case.method, model.contact_points
    return {
        "integrator": method.integrator.name,
        "contact": method.contact.name,
        "mass": method.mass.name,
        "contacts": parameters(model),
        "headline": {name: list(law.headline) for name, law in zip(points.names, points.laws, strict=True)},
        "dt": model.dt,
        "steps": model.steps,
        "courant": model.courant,
    }


def components_used(case: Case, *, solution: str | None = None) -> list[tuple[str, str]]:
    """Return family and name of every component that a result of a case depends on, sorted.

    The exact solution that judges the run has the name `solution`; None if there is none.
    """
    method, bodies, contacts = case.method, case.bodies.values(), case.contacts.values()
    components: list[Any] = [load.load for load in case.loads.values()]
    components += [component for body in bodies for component in (body.shape, body.material, body.element)]
    components += [component for contact in contacts for component in (contact.law, contact.pairing, contact.friction)]
    components += [method.integrator, method.contact, method.mass, method.pairing, method.friction]
    used = {(component.family, component.name) for component in components if component is not None}
    return sorted(used | ({("solutions", solution)} if solution else set()))


def origins(case: Case, components: Iterable[tuple[str, str]]) -> Entries:
    """Return where the components of a case and its data files come from.

    Parameters
    ----------
    case
        The case.
    components
        Family and name of each component that counts.

    Returns
    -------
    dict
        ``plugins``: distribution, version, file and digest of the sources of each component, by family and name.
        ``single_files``: digest and text of each single-file plug-in among them, by its path. ``data_files``: texts of
        the files that the case names.
    """
    sources = {"/".join(key): case.registry.sources[key] for key in components}
    files = {source.file for source in sources.values() if not source.distribution}
    return {
        "plugins": {
            name: {about: getattr(source, about) for about in ("distribution", "version", "file", "digest")}
            for name, source in sources.items()
        },
        "single_files": {
            str(file.path): {"digest": file.digest, "texts": {file.path.name: file.content.decode("utf-8")}}
            for file in case.registry.single_files
            if str(file.path) in files
        },
        "data_files": dict(case.data_files),
    }


def provenance_of(model: Model, components: Iterable[tuple[str, str]], **found: Any) -> Entries:
    """Return the provenance of a result of a model that depends on some components, with what else was found.

    A picture of the result needs two entries. ``geometry``: first and last node of each bar, or corners of any other
    body, (2, dim), and body and middle of each side of a contact, at t = 0. ``expected_forces``: of each contact force
    that the case expects its contact, statistic, value, largest allowed difference, and the times over which the
    statistic is taken, None for the whole run. The geometry has `percuss.contact.walls.WallShape.entries` of each wall
    of a body that is no bar, too, and in the snapshots the displacements of those that move, (snapshots, dim).
    """
    case, names = model.case, ("contact", "statistic", "value", "allowed", "during")
    forces = [expectation for expectation in case.expect if expectation.quantity == "contact_force"]
    found["geometry"] = {
        "bodies": {name: body.extent.tolist() for name, body in model.bodies.items()},
        "contacts": {
            name: [[side.body, model.bodies[side.body].middle(side.region).tolist()] for side in spec.sides]
            for name, spec in model.case.contacts.items()
        },
        "walls": {name: wall.entries for name, wall in walls_of(case, model.bodies).items()},
        "wall_displacements": {
            name: displacements(load, _snapshots(model), model.dt, model.dim).tolist()
            for name, (_, load) in round_or_moving(case).items()
            if load is not None
        },
    }
    found["expected_forces"] = [{name: getattr(expected, name) for name in names} for expected in forces]
    return {**machine(), "case": as_lists(case.data), **origins(case, components), **plain(found)}


def _snapshots(model: Model) -> Integers:
    """Return the steps before which displacements are recorded."""
    shapes = record_shapes(model)
    return np.arange(shapes.field[0]) * shapes.field_every


def keys_of(components: Iterable[str]) -> list[tuple[str, str]]:
    """Return family and name of components that are named as in `origins`."""
    return [(family, name) for family, _, name in (component.partition("/") for component in components)]


def case_inside(provenance: Data, *, plugins: Sequence[Path] = (), name: str = "the result") -> Case:
    """Return the case inside a result.

    The texts of its data files are taken from the result. Code is not: a single-file plug-in is one of `plugins`, or
    the file at the place where it was, if that is unchanged to the last byte.

    Parameters
    ----------
    provenance
        Provenance of the result.
    plugins
        Single-file plug-ins that stand in for those of the result, by the components that they register.
    name
        Name of the result for messages.

    Raises
    ------
    InputError
        If the result lacks what is needed, a plug-in is missing or has changed, or the case can no longer be read.
    PluginError
        If one of `plugins` cannot be used.
    """
    if "single_files" not in provenance:
        raise wrong_input(name, "does not hold what its case was run with, as an older percuss has written it")
    here, problems, files = Registry.load(plugins).components, [], dict[Path, None]()
    for key, origin in provenance["plugins"].items():
        (named,), file = keys_of([key]), origin["file"]
        if origin["distribution"] or named in here:
            continue
        files[Path(file)], digest = None, ""
        with contextlib.suppress(PluginError):  # the file may be gone
            digest = SingleFile.read(Path(file)).digest
        if digest != provenance["single_files"].get(file, {}).get("digest"):
            message = f"needs {named[1]} ({named[0]}) of {file}: it is not there, or it has changed since"
            advice = "A result never brings code that is run: name the file with --plugin, even if it has changed."
            problems.append(Problem(name, "", message, advice))
    refuse_if_any(problems)
    data = {key: value for key, value in provenance["case"].items() if key != "plugins"}
    source = dataclasses.replace(Source.of(data), name=name, data_files=provenance["data_files"])
    return load(source, registry=Registry.load([*plugins, *files]))
