"""A contact law bound to its contact points: its linear law with one value for each point, or its kernel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np

from percuss.jsonable import Entries
from percuss.methods.blame import breach
from percuss.methods.interfaces import ContactLaw, ContactPoints, Floats, LinearLaw
from percuss.methods.plugin_calls import Returned, answer, read_only

COEFFICIENTS = ("sigma", "gap", "rate", "acceleration")
# The words that each of the other fields of a linear law may have.
WORDS = {name: get_args(hint) for name, hint in get_type_hints(LinearLaw).items() if get_origin(hint) is Literal}


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
    bound, kind = answer(law, "bind", points, dt), type(law)
    linear = broadcast(bound, points, law) if isinstance(bound, LinearLaw) else None
    if linear is None and not hasattr(bound, "_fields"):
        returned = "nothing" if bound is None else f"a {type(bound).__name__}"
        expected = "LinearLaw, or a NamedTuple of what its kernel `multipliers` needs"
        raise breach(law, "bind", f"bind returned {returned}, expected {expected}")
    if linear is None and not hasattr(kind, "multipliers"):
        missing = "the class has no static method `multipliers(bound, trial, multiplier)`"
        raise breach(law, "bind", f"bind returned no LinearLaw, and {missing}")
    return BoundLaw(
        law=law,
        where=where,
        points=points,
        linear=linear,
        during=linear.during if linear is not None else None,
        kernel=kind.multipliers if linear is None else None,  # type: ignore[attr-defined]
        kernel_data=read_only(bound) if linear is None else None,
        resolved=law.resolved(points, dt),
    )


def broadcast(linear_law: LinearLaw, points: ContactPoints, law: ContactLaw) -> LinearLaw:
    """Return a linear law with one value of each coefficient for each point, or refuse invalid ones.

    Raises
    ------
    PluginError
        If a coefficient is out of bounds or has the wrong shape, or an option is unknown.
    """
    count = len(points.names)
    coefficients: Entries = {}
    for name in COEFFICIENTS:
        value = getattr(linear_law, name)
        Returned(law, "bind", value, f" LinearLaw.{name} as").expect(*((count,) if np.ndim(value) else ()))
        coefficients[name] = read_only(np.full(count, value, dtype=float))
    if (coefficients["sigma"] < 0).any():
        raise breach(law, "bind", "LinearLaw.sigma is negative, expected a compliance of at least 0")
    for name, allowed in WORDS.items():
        if (word := getattr(linear_law, name)) not in allowed:
            raise breach(law, "bind", f"LinearLaw.{name} is {word!r}, expected one of {allowed}")
    if (during := linear_law.during) is not None:
        during = np.asarray(during, dtype=float)
        if during.ndim != 2 or during.shape[1] != 2 or not (during[:, 0] <= during[:, 1]).all():
            message = f"LinearLaw.during is {during}, expected pairs (start, stop), stop not before start"
            raise breach(law, "bind", message)
    return linear_law._replace(during=during, **coefficients)
