"""A kernel of a plug-in that failed in the middle of a run: its step made again in plain Python, to say where and why.

Compiled code tells an error by its words alone, and a multiplier that a kernel left unset by a motion that is no
longer a number. The same step in plain Python, from the state before it, tells law, contact, file and line.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from percuss.errors import PercussError, PluginError
from percuss.methods.blame import line_in_plugin
from percuss.methods.kernel_trial import kernel_of, seen
from percuss.solver.build import Kernels, LoopParts, bind

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats, Trial
    from percuss.solver.model import Model

SENTINEL = -1.2345678901234567e-301  # no kernel arrives at this number by itself


class Marching(Protocol):
    """The parts of a march (`percuss.solver.march.March`) that are needed to make one of its steps again."""

    model: Model
    own_laws: list[dict[str, Any]]
    parts: LoopParts
    kernels: Kernels

    def changing(self) -> list[Any]:
        """Return the arrays that a step changes."""

    def advance(self, drive: Any, first: int, count: int) -> int:
        """March `count` steps."""


class NoMultiplier(Exception):
    """The kernel of a law left a contact without a multiplier.

    Attributes
    ----------
    law, contact
        Their names.
    kind
        ``"unset"``, ``"used before it was set"`` or ``"not a number"``.
    state
        In words, what the kernel saw of the contact.
    """

    def __init__(self, law: str, contact: str, kind: str, state: str) -> None:
        super().__init__(law, contact, kind, state)
        self.law, self.contact, self.kind, self.state = law, contact, kind, state

    @property
    def what(self) -> str:
        """What happened."""
        verb = {
            "unset": "left the multiplier of contact '{}' unset",
            "used before it was set": "used the multiplier of contact '{}' before it had set it",
            "not a number": "gave a multiplier of contact '{}' that is not a number",
        }[self.kind]
        return f"law {self.law} {verb.format(self.contact)}"

    @property
    def cause(self) -> str:
        """Why, and what to do."""
        cure = "every branch of its kernel has to set every multiplier, 0.0 where nothing presses"
        if self.kind == "not a number":
            cure = "its kernel divides by zero, takes the root of a negative number, or the like"
        return f"the kernel was called with {self.state}: {cure}"


class KernelError(Exception):
    """The kernel of a contact law raised an error; its cause is that error."""


def probed(kernel: Callable[..., None], law: str, contacts: tuple[str, ...]) -> Callable[..., None]:
    """Return a kernel in plain Python that raises `NoMultiplier` and `KernelError` where `kernel` fails."""

    def probe(bound: Any, trial: Trial, multiplier: Floats) -> None:
        try:
            kernel(bound, trial, multiplier)
        except Exception as error:
            raise KernelError(law) from error
        state = np.concatenate([trial.gap, trial.predicted_gap, trial.rate, trial.predicted_rate])
        if np.isnan(multiplier).any() and np.isfinite(state).all():
            point = int(np.isnan(multiplier).argmax())
            filled = np.full(multiplier.size, SENTINEL)
            kernel(bound, trial, filled)
            kind = "not a number"
            if filled[point] == SENTINEL:
                kind = "unset"
            elif not np.isnan(filled[point]):
                kind = "used before it was set"
            raise NoMultiplier(law, contacts[point], kind, seen(trial, point))

    return probe


def repeat_in_python(march: Marching, drive: Any, step: int) -> BaseException | None:
    """Make one step of a march in plain Python from its present state; return the error that a kernel raised, or None.

    The state is left as it was.

    Parameters
    ----------
    march
        The run, as it stands before the step.
    drive
        Amplitudes of the loads in this step alone.
    step
        Number of the step.
    """
    laws = [
        {**entry, "kernel": probed(kernel_of(entry["law"]), entry["law"].name, entry["points"].names)}
        for entry in march.own_laws
    ]
    before = [array.copy() for array in march.changing()]
    compiled = march.kernels
    march.kernels = bind(dataclasses.replace(march.parts, laws=laws), compiled=False)
    try:
        with np.errstate(all="ignore"):
            march.advance(drive, step, 1)
    except Exception as error:  # noqa: BLE001  a kernel may raise anything
        return error
    finally:
        march.kernels = compiled
        for array, value in zip(march.changing(), before, strict=True):
            array[:] = value
    return None


def without_multiplier(march: Marching, drive: Any, step: int) -> NoMultiplier | None:
    """Return which contact the kernel of a law left without a multiplier in a step that is made again, or None."""
    if not march.own_laws:
        return None
    error = repeat_in_python(march, drive, step)
    return error if isinstance(error, NoMultiplier) else None


def refuse_writing(error: Exception) -> None:
    """Refuse kernels that the compiler did not take because they write to arrays that can only be read.

    Raises
    ------
    PluginError
        With the place of the first such line.
    """
    _, found, after = str(error).partition("Cannot modify readonly array")
    if not found:
        return
    place = re.search(r"typing of [\w ]+ at (.+?) \((\d+)\)", after)
    where = f"{place[1]}:{place[2]}: " if place else ""
    raise PluginError(
        f"{where}a kernel changes what it was handed to read (bound arrays, the trial): a kernel of a contact law may "
        "write to the multiplier alone, and keeps nothing between calls"
    )


def told(march: Marching, drive: Any, step: int, raised: BaseException) -> PercussError:
    """Return the error that tells of a kernel that raised one in a step: where, which law, step and time."""
    error = repeat_in_python(march, drive, step) or raised
    law = ""
    if isinstance(error, KernelError):
        law = f"contact law {error}: multipliers: "
        error = error.__cause__ or raised
    if isinstance(error, NoMultiplier):
        error = raised
    where = line_in_plugin(error)
    what = f"{type(error).__name__}: {error}"
    if isinstance(error, ValueError) and "read-only" in str(error):
        what = "it changes what it was handed; it may write to the multiplier alone"
    when = f"in step {step}, at time {step * march.model.dt:.9g}"
    return PluginError(f"{where + ': ' if where else ''}{law or 'a kernel: '}{what} ({when})")
