"""Provenance of a result besides its case: versions, plug-ins and machine."""

from __future__ import annotations

import contextlib
import datetime as dt
import platform
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from percuss.version import installed_version

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.case.case import Case
    from percuss.methods.provenance import Provenance
    from percuss.solver.model import Model


def versions() -> dict[str, str]:
    """Return the versions in use."""
    names = ("percuss", "numpy", "numba", "scipy", "xarray", "netCDF4")
    return {"python": platform.python_version(), **{name: installed_version(name) for name in names}}


@cache
def processor_model() -> str:
    """Return the processor model as named by the system, or ``unknown`` if it names none."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        named_lines = (line.partition(":") for line in lines if line.startswith(("model name", "Model", "cpu model")))
        for _, _, name in named_lines:
            if name.strip():
                return " ".join(name.split())
    if sys.platform == "darwin":
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            command = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
            return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()  # noqa: S603
    return platform.processor() or "unknown"


def machine() -> dict[str, Any]:
    """Return versions, machine and current time for the provenance of a result."""
    return {
        "versions": versions(),
        "machine": {
            "system": platform.platform(),
            "processor": platform.machine(),
            "cpu": processor_model(),
            "byteorder": sys.byteorder,
        },
        "time": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
    }


def resolved_methods(model: Model) -> Mapping[str, Any]:
    """Return the methods of a model with their resolved parameters and the time step, for the provenance."""
    method = model.case.method
    return {
        "integrator": method.integrator.name,
        "contact": method.contact.name,
        "mass": method.mass.name,
        "contacts": model.parameters(),
        "headline": {pair.name: list(pair.law.headline) for pair in model.contact_pairs},
        "dt": model.dt,
        "steps": model.steps,
        "courant": model.courant,
    }


def geometry(model: Model) -> dict[str, Any]:
    """Return the places that a picture of a result needs.

    Returns
    -------
    dict
        ``bodies``: first and last node of each body, (2, dim); ``contacts``: body and node of each side of a contact,
        at t = 0.
    """
    return {
        "bodies": {name: body.mesh.nodes[[0, -1]].tolist() for name, body in model.bodies.items()},
        "contacts": {
            contact_pair.name: [[model.body_of(node).name, model.nodes[node].tolist()] for node in contact_pair.nodes]
            for contact_pair in model.contact_pairs
        },
    }


def expected_forces(case: Case) -> list[dict[str, Any]]:
    """Return the expected contact forces of a case as plain data, which a picture of its result shows.

    Returns
    -------
    list of dict
        ``contact``, ``statistic``, ``value``, ``allowed`` (the largest difference from it) and ``during``, the times
        over which the statistic is taken, None for the whole run.
    """
    return [
        {
            "contact": expectation.contact,
            "statistic": expectation.statistic,
            "value": expectation.value,
            "allowed": expectation.allowed,
            "during": expectation.during,
        }
        for expectation in case.expect
        if expectation.quantity == "contact_force"
    ]


def plugins_used(case: Case, *, solution: str | None = None) -> dict[str, dict[str, str]]:
    """Return distribution, version and file of every component of a case, by family and name.

    Parameters
    ----------
    case
        The case.
    solution
        Name of the exact solution that stands in for the methods of the case; None for a run.
    """
    components: list[Any] = [load.load for load in case.loads.values()]
    components += [
        component for body in case.bodies.values() for component in (body.shape, body.material, body.element)
    ]
    used = {(component.family, component.name) for component in components}
    if solution is None:
        laws = [contact.law for contact in case.contacts.values()]
        methods: list[Any] = [case.method.integrator, case.method.contact, case.method.mass, *laws]
        used |= {(component.family, component.name) for component in methods}
    else:
        used.add(("solutions", solution))
    return {"/".join(key): _origin(case.registry.sources[key]) for key in sorted(used)}


def _origin(source: Provenance) -> dict[str, str]:
    return {"distribution": source.distribution, "version": source.version, "file": source.file}
