"""A contact law bound to its contact points: its linear law with one value for each point, or its kernel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from percuss.contact.law_trials import kernel_of
from percuss.jsonable import Entries
from percuss.methods.blame import breach
from percuss.methods.interfaces import ContactLaw, ContactPoints, Floats, LinearLaw
from percuss.methods.plugin_calls import answer, as_numbers, read_only

COEFFICIENTS = ("sigma", "gap", "rate", "acceleration")


@dataclass(frozen=True, eq=False)
class BoundLaw:
    """A contact law bound to its contact points for one time step.

    Attributes
    ----------
    law
        The law with its options.
    where
        Numbers of its contact points, in the order of the case.
    points
        Properties of these points.
    linear
        Its linear law, with coefficients checked and of one value for each point; None for a law with a kernel.
    during
        Intervals of time, (K, 2), in which the law acts; None if it always acts.
    kernel, kernel_data
        The kernel of a law that is not linear, and the data that its `bind` returned for the kernel.
    resolved
        Its parameters with the values used, one number or one for each point.
    """

    law: ContactLaw
    where: tuple[int, ...]
    points: ContactPoints
    linear: LinearLaw | None
    during: Floats | None
    kernel: Callable[..., None] | None
    kernel_data: Any
    resolved: Mapping[str, Floats | float]

    @property
    def bonds(self) -> bool:
        """Whether the law holds bodies together that would part: it says so, or its line pulls at any gap."""
        line = self.linear
        return self.law.bond or (line is not None and (line.active, line.sign) == ("all", "free"))

    @property
    def ties(self) -> bool:
        """Whether the law holds the gap rates of its contacts at zero at the end of each step in which it acts."""
        line = self.linear
        return (
            line is not None
            and (line.at, line.active, line.sign) == ("end", "all", "free")
            and bool(np.all(line.rate))
            and not any(np.any(getattr(line, name)) for name in ("sigma", "gap", "acceleration"))
        )


def bind_law(law: ContactLaw, where: tuple[int, ...], points: ContactPoints, dt: float) -> BoundLaw:
    """Return a law bound to the contact points `where` for a time step.

    Raises
    ------
    PluginError
        If `bind` of the law returned an invalid linear law, or neither that nor the data of a kernel.
    ValueError
        If the options of the law do not fit together or do not fit its points.
    """
    bound, resolved = answer(law, "bind", points, dt), law.resolved(points, dt)
    linear = broadcast(bound, points, law) if isinstance(bound, LinearLaw) else None
    if linear is None:
        if not (isinstance(bound, tuple) and hasattr(bound, "_fields")):
            returned = "nothing" if bound is None else f"a {type(bound).__name__}"
            expected = "LinearLaw, or a NamedTuple of what its kernel `multipliers` needs"
            raise breach(law, "bind", f"bind returned {returned}, expected {expected}")
        bound = read_only(bound)
    return BoundLaw(
        law=law,
        where=where,
        points=points,
        linear=linear,
        during=linear.during if linear is not None else None,
        kernel=kernel_of(law) if linear is None else None,
        kernel_data=bound if linear is None else None,
        resolved=resolved,
    )


def broadcast(linear_law: LinearLaw, points: ContactPoints, law: ContactLaw) -> LinearLaw:
    """Return a linear law with one value of each coefficient for each point, or refuse invalid ones.

    Raises
    ------
    PluginError
        If a coefficient is out of bounds or has the wrong shape, or an option is unknown.
    """
    count = len(points.names)
    values = np.empty((len(COEFFICIENTS), count))
    for field, row in zip(COEFFICIENTS, values, strict=True):
        value = as_numbers(getattr(linear_law, field))
        if value is None:
            raise breach(law, "bind", f"LinearLaw.{field} is {getattr(linear_law, field)!r}, expected real numbers")
        if value.shape not in {(), (count,)}:
            message = f"LinearLaw.{field} has shape {value.shape}, expected ({count},) or a number"
            raise breach(law, "bind", message)
        row[:] = value
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        raise breach(law, "bind", f"LinearLaw.{COEFFICIENTS[int(np.argmin(finite))]} is not finite")
    values.flags.writeable = False
    coefficients: Entries = dict(zip(COEFFICIENTS, values, strict=True))
    if (coefficients["sigma"] < 0).any():
        raise breach(law, "bind", "LinearLaw.sigma is negative, expected a compliance of at least 0")
    for field, allowed in (
        ("at", ("explicit", "end")),
        ("active", ("gap < 0", "all")),
        ("sign", ("free", ">= 0")),
    ):
        if getattr(linear_law, field) not in allowed:
            message = f"LinearLaw.{field} is {getattr(linear_law, field)!r}, expected one of {allowed}"
            raise breach(law, "bind", message)
    return linear_law._replace(during=_intervals(linear_law, law), **coefficients)


def _intervals(linear_law: LinearLaw, law: ContactLaw) -> Floats | None:
    """Return the (K, 2) intervals of time in which a linear law is active, None if it always is.

    Raises
    ------
    PluginError
        If they are not pairs (start, stop) with stop not before start.
    """
    if linear_law.during is None:
        return None
    during = as_numbers(linear_law.during)
    if during is not None and during.size == 0:
        return np.zeros((0, 2))
    if during is None or during.ndim != 2 or during.shape[1] != 2 or not (during[:, 0] <= during[:, 1]).all():
        message = f"LinearLaw.during is {linear_law.during!r}, expected pairs (start, stop), stop not before start"
        raise breach(law, "bind", message)
    return during
