"""How a march stopped before its end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

NOT_STARTED = "the certificate says no, so no step was made"


Kind = Literal["contact work", "energy", "not solved", "kernel", "not started"]


@dataclass(frozen=True)
class Stop:
    """Where and why a march stopped before its end.

    Attributes
    ----------
    step
        The step after which it was stopped.
    node
        The node at which that shows most.
    kind
        What ran away after that step: the ``"contact work"``, the ``"energy"`` of the bodies; or the contact equation
        was ``"not solved"``, a ``"kernel"`` of a plug-in is at fault, or the run was ``"not started"``.
    what
        What was seen, in words.
    cause
        Why, where the march itself knows; else the certificate is asked.
    """

    step: int
    node: int
    kind: Kind
    what: str
    cause: str = ""
