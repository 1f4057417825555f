"""Figure of an exact solution alone: contact forces, energies, and stress in space and time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from percuss.reporting.figures import number
from percuss.reporting.run_figure import history_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from percuss.results.exact_result import ExactSolutionResult


def exact_figure(result: ExactSolutionResult) -> Figure:
    """Return the figure of an exact solution without a window."""
    closure = f"energies and work agree to {number(result.summary['energy']['ledger_error'])} of the largest energy"
    return history_figure(result, result.end, [solution_line(result)], warning_lines(result), closure)


def solution_line(result: ExactSolutionResult) -> str:
    """Return the line below a title that names the solution and the time up to which it holds."""
    units = "" if result.units else "  ·  consistent units"
    return f"exact solution {result.solution_name}  ·  up to time {number(result.end)}{units}"


def warning_lines(result: ExactSolutionResult) -> list[str]:
    """Return the warnings that must head a solution that ends before its case does; none for a whole one."""
    if result.status == "done":
        return []
    return [f"INTERRUPTED at time {number(result.end)}: the solution is not complete", result.summary["exact_reason"]]
