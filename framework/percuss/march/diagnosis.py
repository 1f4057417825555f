"""Diagnosis of a kernel of a plug-in that failed during a run: its step is repeated in plain Python.

Compiled code reports an error without its place, and a multiplier left unset only as a motion that is no longer finite.
The same step in plain Python, started from the state before it, gives law, contact, file and line.
"""

from __future__ import annotations

import dataclasses
import re
import traceback
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from percuss.contact.law_trials import describe_state, fault_of_nan
from percuss.errors import PercussError, PluginError
from percuss.march.stop import Stop
from percuss.mesh.cells import is_solid
from percuss.mesh.element_probe import ElementProbe
from percuss.methods.blame import (
    definition_place,
    described,
    is_foreign,
    line_in_plugin,
    plain_function,
    third_party_files,
)
from percuss.step.build import Kernels
from percuss.step.law_kernels import apply_law, multipliers

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.march.arrays import Arrays
    from percuss.methods.interfaces import Array, Floats, Trial
    from percuss.step.actions import Action


MOST_ASKED = 1000  # elements near the nodes whose motion is no longer finite


class Marching(Protocol):
    """The attributes of a run (`percuss.march.march.March`) that are needed to repeat one of its steps."""

    model: Model
    arrays: Arrays
    kernels: Kernels

    def use(self, how: Kernels, actions: Sequence[Action]) -> None:
        """Let the steps of this stretch perform some actions."""

    def changing_arrays(self) -> list[Array]:
        """Return the arrays that a step changes."""

    def advance(self, amplitudes: object, first: int, count: int) -> int:
        """Make `count` steps from step `first`."""


class NoMultiplier(Exception):
    """Error of a law whose kernel left a contact without a multiplier.

    Attributes
    ----------
    contact
        Name of the contact.
    description
        The fault of the kernel, in words.
    cause
        The cause of the fault and its remedy, in words.
    """

    def __init__(self, contact: str, description: str, cause: str) -> None:
        super().__init__(contact, description, cause)
        self.contact, self.description, self.cause = contact, description, cause


def probing_kernel(kernel: Callable[..., None], law: str, contacts: tuple[str, ...]) -> Callable[..., None]:
    """Return a plain Python kernel that calls `kernel` and raises `NoMultiplier` if it leaves a contact without one."""

    def probe(bound: object, trial: Trial, multiplier: Floats) -> None:
        kernel(bound, trial, multiplier)
        state = np.concatenate([trial.gap, trial.predicted_gap, trial.rate, trial.predicted_rate])
        if np.isnan(multiplier).any() and np.isfinite(state).all():
            point = int(np.isnan(multiplier).argmax())
            contact = contacts[point]
            fault, remedy = fault_of_nan(kernel, bound, trial, point, f"contact '{contact}'")
            cause = f"the kernel at {definition_place(kernel)} was called with {describe_state(trial, point)}: {remedy}"
            raise NoMultiplier(contact, f"law {law} {fault}", cause)

    return probe


def repeat_in_python(march: Marching, amplitudes: object, step: int) -> BaseException | None:
    """Repeat one step of a run in plain Python from its present state; return the error of a kernel, or None.

    The state is restored afterwards.

    Parameters
    ----------
    march
        The run, in its state before the step.
    amplitudes
        Amplitudes of the loads in this step.
    step
        Number of the step.
    """
    arrays, compiled = march.arrays, march.kernels
    kernels: Any = iter([law.kernel for law in arrays.kernel_laws])
    names = iter([(law.law.name, law.points.names) for law in arrays.kernel_laws])
    actions = [
        dataclasses.replace(action, slots={multipliers: probing_kernel(next(kernels), *next(names))})
        if action.kernel is apply_law
        else action
        for action in arrays.actions
    ]
    saved = [array.copy() for array in march.changing_arrays()]
    march.use(Kernels(False), actions)
    try:
        with np.errstate(all="ignore"):
            march.advance(amplitudes, step, 1)
    except Exception as error:  # noqa: BLE001  a kernel may raise anything
        return error
    finally:
        march.use(compiled, arrays.actions)
        for array, value in zip(march.changing_arrays(), saved, strict=True):
            array[:] = value
    return None


def missing_multiplier(march: Marching, amplitudes: object, step: int) -> NoMultiplier | None:
    """Return the error of a kernel that leaves a contact without a multiplier in the repeated step, or None."""
    if not march.arrays.kernel_laws:
        return None
    error = repeat_in_python(march, amplitudes, step)
    return error if isinstance(error, NoMultiplier) else None


def stop_by_inversion(model: Model, displacement: Floats, velocity: Floats, failed: Any, step: int) -> Stop | None:
    """Return the stop by a cell of finite strain that is turned inside out before a step, or None.

    Parameters are those of `stop_by_a_body`, with the velocity half a step before.
    """
    worst: tuple[float, Stop] | None = None
    for body in model.bodies.values():
        if not is_solid(body.spec.element) or body.spec.material.linear:
            continue
        nodes, probe = body.element_nodes(np.arange(body.count)), None
        for number in np.flatnonzero(failed[nodes].any(axis=1))[:MOST_ASKED].tolist():
            probe = probe or ElementProbe(body.spec.element, body.spec.material, body.view)
            own = nodes[number]
            now, before = (probe.volumes(number, u[own]) for u in (displacement, displacement - model.dt * velocity))
            point = int(now.argmin())
            if now[point] <= 0.0 and (worst is None or now[point] < worst[0]):
                what = (
                    f"cell {number} of body '{body.name}' is inside out at its point {point}, with {now[point]:.3g} of "
                    f"its volume at the start, after {before[point]:.3g} a step before"
                )
                speed = float(np.ptp(velocity[own], axis=0).max())
                cause = (
                    f"its nodes close at a velocity of {speed:.3g}, and its material does not hold them apart. Take a "
                    "lower velocity, a finer mesh, a shorter step, or a material whose energy has no bound as its "
                    "volume goes to nothing"
                )
                worst = float(now[point]), Stop(step, int(own[0]), "inverted", what, cause)
    return worst[1] if worst is not None else None


def stop_by_a_body(model: Model, displacement: Floats, failed: Any, step: int) -> Stop | None:
    """Return the stop by a kernel of an element or material that gave no finite number in a step, or None.

    Bodies that are linear and have no kernel of a plug-in are not asked, nor those with state variables.

    Parameters
    ----------
    model
        The model.
    displacement : (nodes, dim) array
        Displacement before the step.
    failed : (nodes,) array
        Whether the motion of a node is no longer finite after the step.
    step
        Number of the step.
    """
    for body in model.bodies.values():
        parts = body.spec.element, body.spec.material
        foreign = any(map(is_foreign, parts))
        if body.spec.material.state or not (foreign or body.why_not_linear):
            continue
        nodes = body.element_nodes(np.arange(body.count))
        probe = ElementProbe(*parts, body.view)
        for number in np.flatnonzero(failed[nodes].any(axis=1))[:MOST_ASKED].tolist():
            fault, place = probe.fault(number, displacement[nodes[number]].ravel())
            if fault:
                kernel = f"the kernel at {place}" if place else "a kernel"
                remedy = "if no body can be deformed so, take a shorter step or a softer contact"
                cause = f"{kernel} has no value there: {remedy}"
                what = f"{fault}, in element {number} of body '{body.name}'"
                return Stop(step, int(nodes[number, 0]), "kernel", what, cause)
    return None


def refuse_array_writing(error: Exception) -> None:
    """Raise an error if compilation failed because a kernel writes to a read-only array.

    Raises
    ------
    PluginError
        With file and line of the first such statement.
    """
    _, marker, after = str(error).partition("Cannot modify readonly array")
    if not marker:
        return
    location = re.search(r"typing of [\w ]+ at (.+?) \((\d+)\)", after)
    prefix = f"{location[1]}:{location[2]}: " if location else ""
    raise PluginError(
        f"{prefix}a kernel changes what it was handed to read (bound arrays, the trial): a kernel of a contact law may "
        "write only to the multiplier and `trial.after`, and keeps nothing between calls"
    )


def kernel_failure(march: Marching, amplitudes: object, step: int, raised: BaseException) -> PercussError:
    """Return the error for a kernel that raised an exception: its law, file and line, the step and the time."""
    error = repeat_in_python(march, amplitudes, step) or raised
    if isinstance(error, NoMultiplier):
        error = raised
    description = described(error)
    if isinstance(error, ValueError) and "read-only" in str(error):
        description = "it changes what it was handed; it may write to multiplier and `trial.after`"
    step_and_time = f"in step {step}, at time {step * march.model.dt:.9g}"
    place = line_in_plugin(error) or ", ".join(third_party_files())
    return PluginError(f"{_kernel_of_error(march, error)}: {description} ({step_and_time})", place)


def _kernel_of_error(march: Marching, error: BaseException) -> str:
    """Return in words the kernel in which an error was raised, also in a function that it calls."""
    called = {frame.f_code for frame, _ in traceback.walk_tb(error.__traceback__)}
    of_plugins = (action for action in march.arrays.actions if action.of_plugin)
    kernels: list[tuple[Any, str]] = [
        (kernel, f"{action.name}: {slot.__name__}") for action in of_plugins for slot, kernel in action.slots.items()
    ]
    of_plug_in = (words for kernel, words in kernels if plain_function(kernel).__code__ in called)
    return next(of_plug_in, "the answer of a kernel")
