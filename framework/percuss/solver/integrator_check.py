"""What an integrator says of its step, checked: a leap-frog scheme, or stages with a kernel of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.errors import PluginError, RefusedPair
from percuss.methods import slots
from percuss.methods.blame import line_in_plugin
from percuss.methods.interfaces import ContactState, Integrator, LeapFrog, LinearLaw, Stages
from percuss.solver.compiler.specialise import Specialiser

if TYPE_CHECKING:
    from percuss.methods.interfaces import Floats

IN_A_STAGE = ContactState("current", "current", "bulk", (0.0, 0.0, 1.0))
ROUND_OFF = 1e-9
NO_END = "its stages do not say (`end`) at which state a law judged at the end of the step is to be judged"


def scheme(integrator: Integrator, dt: float) -> tuple[Stages | None, tuple[LeapFrog, ...]]:
    """Return the stages of an integrator, None of a leap-frog one, and how contact is judged in each.

    Raises
    ------
    PluginError
        If `bind` returned anything else, or the stages and the kernel `step` do not fit together.
    """
    said = integrator.bind(dt)
    if isinstance(said, LeapFrog):
        return None, (said,)
    if not isinstance(said, Stages):
        raise _wrong(integrator, f"bind returned {type(said).__name__}, expected LeapFrog or Stages")
    ends = ends_of(said, dt)
    numbers = np.array([*said.times, *said.numbers, *ends.ravel()], dtype=float)
    if not said.times or not np.isfinite(numbers).all():
        raise _wrong(integrator, "Stages need one stage or more, and finite numbers throughout")
    if ends.shape != (len(said.times), 3) or (ends <= 0).any():
        raise _wrong(integrator, "Stages.end needs three numbers greater than 0 for each stage, or nothing at all")
    _try(integrator, said, dt)
    _try_again(integrator, said, dt)
    return said, tuple(
        LeapFrog(IN_A_STAGE, ContactState("predicted", "predicted", "bulk", (float(r_a), float(s_a), 1.0)))
        for _, r_a, s_a in ends
    )


def ends_of(stages: Stages, dt: float) -> Floats:
    """Return r_v, r_a, s_a of each stage, (stages, 3); those of a plain step where a scheme says none."""
    return np.array(stages.end or [(dt, dt * dt, dt)] * len(stages.times), dtype=float)


def refuse_end(integrator: Integrator, stages: Stages | None, laws: list[dict[str, Any]]) -> None:
    """Refuse laws judged at the end of the step where the stages do not say what that is.

    Raises
    ------
    RefusedPair
        For the first such law.
    """
    for entry in laws if stages is not None and not stages.end else ():
        if isinstance(entry["bound"], LinearLaw) and entry["bound"].at == "end":
            raise RefusedPair(integrator.name, entry["law"].name, NO_END, integrator.name)


def refuse_unseen(integrator: Integrator, tables: tuple[LeapFrog, ...], laws: list[dict[str, Any]]) -> None:
    """Refuse laws whose row has a weight on what the integrator does not show, as it would silently be left out.

    A law may name what it needs to see only as far as its own multiplier changes it; then the integrator must let the
    multiplier change it.

    Raises
    ------
    RefusedPair
        For the first such law.
    """
    for entry in laws:
        law, bound = entry["law"], entry["bound"]
        if not isinstance(bound, LinearLaw) or not np.any(bound.acceleration):
            continue
        for table in tables:
            shown: ContactState = getattr(table, bound.at)
            if shown.acceleration != "none":
                continue
            unseen = f"{integrator.name} shows {law.name} no acceleration of the gap"
            if "acceleration" not in law.needs_only_response_of:
                reason = f"{unseen}, on which its row has a weight: without it {law.name} would be another method"
                raise RefusedPair(integrator.name, law.name, reason, integrator.name)
            if not shown.response[2]:
                reason = f"{unseen}, and lets its multiplier change none, so that its weight there would do nothing"
                raise RefusedPair(integrator.name, law.name, reason, integrator.name)


def kernel_of(integrator: Integrator) -> Callable[..., None]:
    """Return the kernel of an integrator that is no leap-frog scheme.

    Raises
    ------
    PluginError
        If it has none.
    """
    kernel = getattr(type(integrator), "step", None)
    if kernel is None:
        raise _wrong(
            integrator,
            "bind returned Stages, and the class has no static method `step(numbers, system, u, v, kept, dt)`",
        )
    return kernel  # type: ignore[no-any-return]


def _wrong(integrator: Integrator, what: str) -> PluginError:
    return PluginError(f"integrator {integrator.name}: {what}")


def known(system: Any, stage: int, u: Floats, v: Floats, a: Floats) -> None:
    """Set `a` to what `system` holds: accelerations that do not depend on the state."""
    a[:] = system[0]


def _try(integrator: Integrator, stages: Stages, dt: float) -> None:
    """Make a step with a point that flies and one that is accelerated from rest, in plain Python.

    Raises
    ------
    PluginError
        If v does not change by dt a, or u by dt v: the step is not made in place, or does not take up all of the
        impulse, and its accounts would be wrong.
    """
    asked = []

    def accelerations(system: Any, stage: int, u: Floats, v: Floats, a: Floats) -> None:
        asked.append(stage)
        known(system, stage, u, v, a)

    step = Specialiser({slots.accelerations: accelerations}, jit=False).bind(kernel_of(integrator))
    work_of_nodal_forces = np.array([0.0, 1.0])
    u, v, kept = np.zeros(2), np.array([1.0, 0.0]), np.tile(work_of_nodal_forces, (integrator.kept, 1))
    try:
        step(stages.numbers, (work_of_nodal_forces,), u, v, kept, dt)
    except Exception as error:
        where = line_in_plugin(error)
        text = f"{where + ': ' if where else ''}integrator {integrator.name}: step: {type(error).__name__}: {error}"
        if isinstance(error, IndexError) and not integrator.kept:
            text += " (`kept` is 0: say how many rows the scheme keeps)"
        raise PluginError(text) from error
    if set(asked) - set(range(len(stages.times))):
        raise _wrong(integrator, f"step asks for stage {max(asked)}, and Stages.times has {len(stages.times)}")
    if abs(u[0] - dt) > ROUND_OFF * dt or np.abs(v - [1.0, dt]).max() > ROUND_OFF * max(1.0, dt):
        raise _wrong(
            integrator,
            "step must change u and v in place (u += ..., or u[:] = ...), v by dt times an acceleration that is "
            f"constant and u by dt times a velocity that is; found a change of v by {v[1] / dt:.9g} dt a, and of u by "
            f"{u[0] / dt:.9g} dt v",
        )


def _try_again(integrator: Integrator, stages: Stages, dt: float) -> None:
    """Make steps from some states, and once more from each of them.

    Raises
    ------
    PluginError
        If a step from the same state ends in another one.
    """
    step = Specialiser({slots.accelerations: known}, jit=False).bind(kernel_of(integrator))
    rows = np.cos(np.arange(1.0, 5.0 * (3 + integrator.kept) + 1.0)).reshape(3 + integrator.kept, 5)

    def ends(size: float) -> list[Floats]:
        u, v, a, kept = size * rows[0], size * rows[1], size * rows[2], size * rows[3:]
        step(stages.numbers, (a,), u, v, kept, dt)
        return [u, v, *kept]

    sizes = (1e-3, 1.0, 1e3)
    with np.errstate(all="ignore"):
        first = [ends(size) for size in sizes]
        second = [ends(size) for size in sizes]
    names = ["u", "v", *(f"kept[{k}]" for k in range(integrator.kept))]
    for one, other in zip(first, second, strict=True):
        for name, before, after in zip(names, one, other, strict=True):
            if not np.array_equal(before, after, equal_nan=True):
                raise _wrong(
                    integrator,
                    f"step gives another {name} when it is made again from the same state: the kernel keeps state "
                    "between calls, or draws random numbers; what a scheme remembers is in the rows of `kept`",
                )
