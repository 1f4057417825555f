"""The definition of an integrator, checked: a leap-frog scheme, or a multi-stage scheme with a kernel."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import PluginError, RefusedPair
from percuss.jit import Binder, plain
from percuss.methods import slots
from percuss.methods.blame import breach
from percuss.methods.interfaces import ContactLaw, ContactState, Integrator, LeapFrog, Stages
from percuss.methods.plugin_calls import Returned, answer

if TYPE_CHECKING:
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Floats

# Explicit laws in a stage use the current gap, its rate and its bulk acceleration; a multiplier changes the last only.
STATE_IN_STAGE = ContactState("current", "current", "bulk", (0.0, 0.0, 1.0))
ROUND_OFF_TOLERANCE = 1e-9
NO_END = "its stages do not say (`end`) at which state a law evaluated at the end of the step is to be evaluated"


def scheme(integrator: Integrator, dt: float) -> tuple[Stages | None, tuple[LeapFrog, ...]]:
    """Return the stages of an integrator, None for a leap-frog scheme, and the states that its contact laws use.

    There is one table of states for a leap-frog scheme, and one for each stage of a multi-stage scheme.

    Raises
    ------
    PluginError
        If `bind` returned anything else, or the stages and the kernel `step` do not fit together.
    """
    definition = answer(integrator, "bind", dt)
    if isinstance(definition, LeapFrog):
        for name in ("explicit", "end"):
            returned = Returned(integrator, "bind", getattr(definition, name).response, f" as the response of `{name}`")
            returned.expect(3)
        viscosity, other = definition.viscosity, answer(integrator, "bind", 0.5 * dt).viscosity
        if not (0.0 <= viscosity < np.inf and abs(viscosity - other) <= ROUND_OFF_TOLERANCE * viscosity):
            raise step_error(
                integrator,
                "LeapFrog.viscosity needs a finite number of at least 0, the same at every step: it is the time of the "
                f"viscosity over the step; found {viscosity!r}, and {other!r} at half the step",
            )
        if definition.own_steps and viscosity:
            raise step_error(
                integrator,
                "LeapFrog.own_steps and LeapFrog.viscosity exclude each other: the strain rate of half a step before "
                "is not known of a body whose forces do not act in every step",
            )
        return None, (definition,)
    if not isinstance(definition, Stages):
        raise step_error(integrator, f"bind returned {type(definition).__name__}, expected LeapFrog or Stages")
    ends = ends_of(definition, dt)
    velocities = velocities_of(definition)
    start = np.array(definition.start, dtype=float)
    numbers = np.array([*definition.times, *definition.numbers, *ends.ravel(), *velocities, *start], dtype=float)
    if not definition.times or not np.isfinite(numbers).all():
        raise step_error(integrator, "Stages need one stage or more, and finite numbers throughout")
    if ends.shape != (len(definition.times), 3) or (ends <= 0).any():
        raise step_error(integrator, "Stages.end needs three numbers greater than 0 for each stage, or nothing at all")
    if start.size and (start.shape != (3,) or (start <= 0).any()):
        raise step_error(integrator, "Stages.start needs three numbers greater than 0, or nothing at all")
    if velocities.shape != (len(definition.times),) or (velocities < 0).any():
        raise step_error(integrator, "Stages.velocity needs a number of at least 0 for each stage, or nothing at all")
    return definition, tuple(table_of_stage(*end) for end in ends.tolist())


def table_of_stage(r_v: float, r_a: float, s_a: float) -> LeapFrog:
    """Return the states in which a stage evaluates contact laws."""
    return LeapFrog(STATE_IN_STAGE, ContactState("predicted", "predicted", "bulk", (r_a, s_a, 1.0)))


def ends_of(stages: Stages, dt: float) -> Floats:
    """Return r_v, r_a, s_a of each stage, (stages, 3); where a scheme gives none, those of a leap-frog step."""
    return np.array(stages.end or [(dt, dt * dt, dt)] * len(stages.times), dtype=float)


def velocities_of(stages: Stages) -> Floats:
    """Return the coefficient c of each stage, (stages,); where a scheme gives none, zero."""
    return np.array(stages.velocity or [0.0] * len(stages.times), dtype=float)


def laws_refused(model: Model) -> Iterator[RefusedPair]:
    """Yield laws that do not work with the scheme of an integrator.

    These are, with a multi-stage scheme, laws at the end of the step if the scheme does not define that state; with any
    scheme, linear laws with a weight on the gap acceleration where the integrator does not provide it. Otherwise that
    weight would have no effect, and no message would say so. A law may declare that it needs the acceleration only as
    far as its own multiplier changes it; then the integrator has to provide this response.
    """
    name, stages = model.case.method.integrator.name, model.stages
    for bound_law in model.laws:
        law, linear = bound_law.law, bound_law.linear
        if linear is not None and linear.at == "end" and stages is not None and not stages.end:
            yield RefusedPair(name, law.name, NO_END, name)
            continue
        states = [getattr(table, linear.at) for table in model.tables] if linear and np.any(linear.acceleration) else []
        reasons = dict.fromkeys(_why_unseen(law, state) for state in states)
        for reason in filter(None, reasons):
            yield RefusedPair(name, law.name, f"{name} shows {law.name} no acceleration of the gap{reason}", name)


def _why_unseen(law: ContactLaw, state: ContactState) -> str:
    """Return what follows for a law with a weight on the gap acceleration, if the state has none; empty if it has."""
    if state.acceleration != "none":
        return ""
    if "acceleration" not in law.needs_only_response_of:
        return f", on which its linear law has a weight: without it {law.name} would be another method"
    if not state.response[2]:
        return ", and lets its multiplier change none, so that its weight there would do nothing"
    return ""


def kernel_of(integrator: Integrator) -> Callable[..., None]:
    """Return the kernel of a multi-stage scheme.

    Raises
    ------
    PluginError
        If the integrator has none.
    """
    kernel = getattr(type(integrator), "step", None)
    if kernel is None:
        raise step_error(
            integrator,
            "bind returned Stages, and the class has no static method `step(numbers, system, u, v, kept, dt)`",
        )
    return kernel  # type: ignore[no-any-return]


def step_error(integrator: Integrator, message: str) -> PluginError:
    """Return the error for an integrator whose kernel, or else `bind`, does what its contract forbids."""
    return breach(integrator, "step" if hasattr(integrator, "step") else "bind", message)


def no_internal_forces(system: object, stage: int, u: Floats, f: Floats) -> None:
    """Set `f` to zero: the internal forces of points that nothing holds together."""
    f[:] = 0.0


def plain_step(integrator: Integrator, accelerations: object, internal: Any) -> Callable[..., None]:
    """Return the step of a multi-stage scheme in plain Python, with functions that fill its two slots."""
    filled: dict[Any, Any] = {slots.accelerations: accelerations, slots.internal: internal}
    return plain(kernel_of(integrator), filled)


def uses_internal(kernel: Callable[..., None]) -> bool:
    """Return whether the kernel of a multi-stage scheme asks for `percuss.internal`."""
    maker = Binder({slots.internal: no_internal_forces}, jit=False)
    maker.bind(kernel)
    return maker.reached(no_internal_forces)
