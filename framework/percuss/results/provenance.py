"""What a result depends on besides its case: versions, plug-ins and machine."""

from __future__ import annotations

import contextlib
import datetime as dt
import platform
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from percuss.case.case import Case


@cache
def versions() -> dict[str, str]:
    """Return the versions in use; to look them up takes longer than a short run."""
    from importlib.metadata import version

    names = ("percuss", "numpy", "numba", "scipy", "xarray", "netCDF4")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}


@cache
def processor_model() -> str:
    """Return the model of the processor as the system calls it; ``unknown`` where it does not tell."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        named = (line.partition(":") for line in lines if line.startswith(("model name", "Model", "cpu model")))
        for _, _, name in named:
            if name.strip():
                return " ".join(name.split())
    if sys.platform == "darwin":
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            command = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
            return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()  # noqa: S603
    return platform.processor() or "unknown"


def machine() -> dict[str, Any]:
    """Return what a result depends on besides the case: versions and machine."""
    return {
        "versions": dict(versions()),
        "machine": {
            "system": platform.platform(),
            "processor": platform.machine(),
            "cpu": processor_model(),
            "byteorder": sys.byteorder,
        },
        "time": dt.datetime.now(dt.UTC).isoformat(timespec="seconds"),
    }


def plugins_used(case: Case) -> dict[str, dict[str, str]]:
    """Return, for every component of a case, the distribution, version and file it comes from."""
    method = case.method
    parts: list[Any] = [method.integrator, method.contact, method.mass]
    parts += [part for body in case.bodies.values() for part in (body.shape, body.material, body.element)]
    parts += [contact.law for contact in case.contacts.values()]
    parts += [load.load for load in case.loads.values()]
    out = {}
    for part in parts:
        source = case.registry.sources[part.family, part.name]
        out[f"{part.family}/{part.name}"] = {
            "distribution": source.distribution,
            "version": source.version,
            "file": source.file,
        }
    return dict(sorted(out.items()))
