"""Animation of a result: bodies and their stress as time goes on, beside the contact forces."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from percuss.case.arguments import expect_suffix
from percuss.errors import InputError, PercussError, Problem
from percuss.files import replacing
from percuss.jsonable import Entries
from percuss.reporting import figures
from percuss.reporting.figures import COLOURS, DASHES
from percuss.reporting.run_figure import body_names, contacts_left_out, strips_of
from percuss.reporting.solids import colour_bar, last_whole, moving_parts, scene_of, still_parts, write_names

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from percuss.results.result import Result

SUFFIXES = (".gif", ".mp4")
MOST_FRAMES = 100
FRAMES_PER_SECOND = 15
SIZE, DOTS_PER_INCH = (9.6, 6.0), 100  # inches; 960 x 600 pixels


def check_animation(path: str | os.PathLike[str]) -> None:
    """Refuse the path of an animation that cannot be made, before a run is made for it.

    Raises
    ------
    InputError
        If `path` does not end in .gif or .mp4.
    PercussError
        If matplotlib is not installed, or ffmpeg, which writes .mp4, is not.
    """
    suffix = expect_suffix(path, "an animation", SUFFIXES, "Name the file with one of the two.")
    with figures.drawing():
        from matplotlib.animation import FFMpegWriter
    if suffix == ".mp4" and not FFMpegWriter.isAvailable():
        message = "an .mp4 needs the program ffmpeg, which is not installed: install it, or name the file .gif"
        raise PercussError(message)


def animate(result: Result, path: str | os.PathLike[str]) -> None:
    """Write the motion and stress of a run or of an exact solution as a gif or mp4, completely or not at all.

    Parameters
    ----------
    result
        A result with stress fields (`record.fields`); of many snapshots 100 are shown, spread evenly.
    path
        File, as for `check_animation`.
    """
    check_animation(path)
    if not result.field_arrays:
        message = "expected a result with stress over space and time to animate, found none"
        raise InputError([Problem(str(path), "", message, "A run records it with record: {fields: 100}.")])
    suffix = Path(path).suffix.lower()
    with figures.drawing():
        from matplotlib.animation import FuncAnimation

        figure, show, frames = frames_of(result)
        figure.set_dpi(DOTS_PER_INCH)
        film = FuncAnimation(figure, show, frames)
        with replacing(path, suffix) as beside:
            writer = "pillow" if suffix == ".gif" else "ffmpeg"
            film.save(beside, writer=writer, fps=FRAMES_PER_SECOND, dpi=DOTS_PER_INCH)


def frames_of(result: Result) -> tuple[Figure, Callable[[int], None], list[int]]:
    """Return the figure of an animation, the function that shows a snapshot in it, and the snapshots to show."""
    fields = result.field_arrays
    time = np.asarray(fields["time"], dtype=float)
    solids = "cell_nodes" in fields
    last = last_whole(fields) if solids else time.size - 1
    frames = np.unique(np.linspace(0, last, min(last + 1, MOST_FRAMES)).round().astype(int)).tolist()
    small = [*figures.subtitle_lines(result)[:1], *contacts_left_out(result.coordinates["contact"])]
    loud = [] if result.status == "done" else [f"{result.status.upper()}: the result is not complete"]
    with figures.new_figure(*SIZE, result.title, small, loud) as figure:
        force, show_bodies = (_deformed_bodies if solids else _stress_lines)(figure, result, frames)
        now = _force_lines(force, result)

        def show(frame: int) -> None:
            show_bodies(frame)
            now.set_xdata([time[frame], time[frame]])
            words = f"time {figures.number(float(time[frame]))} {result.units.get('time') or ''}"
            figure.axes[0].set_title(words.rstrip(), loc="left", size=10, y=None if solids else 1.1)

        show(frames[0])
    return figure, show, frames


def _deformed_bodies(figure: Figure, result: Result, frames: list[int]) -> tuple[Axes, Callable[[int], None]]:
    """Draw solids; return the panel for the forces and the function that shows a snapshot."""
    scene = scene_of(result, frames)
    axes, force = figure.subplots(2, 1, height_ratios=(1.9, 1.0))
    still_parts(axes, scene)
    colour_bar(figure, [axes], scene, result.units)
    moving: list[Artist] = []

    def show(frame: int) -> None:
        while moving:
            moving.pop().remove()
        moving.extend([*moving_parts(axes, scene, frame), *write_names(axes, scene.fields, frame)])

    return force, show


def _stress_lines(figure: Figure, result: Result, _: list[int]) -> tuple[Axes, Callable[[int], None]]:
    """Draw the stress of each bar; return the panel for the forces and the function that shows a snapshot."""
    axes, force = figure.subplots(2, 1, height_ratios=(1.6, 1.0))
    fields = result.field_arrays
    strips, label = strips_of(fields, result.provenance["geometry"]["bodies"])
    stress = np.asarray(fields["stress"], dtype=float)
    largest = float(np.abs(stress[np.isfinite(stress)]).max(initial=0.0)) or 1.0
    lines = []
    for strip in strips.values():
        line = axes.stairs(stress[0, strip.columns], strip.edges, baseline=None, color=COLOURS[0], linewidth=1.8)
        lines.append((line, strip.columns))
        axes.axvspan(*strip.edges[[0, -1]], facecolor="#f4f4f4", edgecolor=figures.FAINT, zorder=0)
    body_names(axes, strips)
    axes.set_ylim(-1.1 * largest, 1.1 * largest)
    figures.set_labels(axes, result.units, xlabel=(label, "length"), ylabel=figures.STRESS)

    def show(frame: int) -> None:
        for line, columns in lines:
            line.set_data(stress[frame, columns])

    return force, show


def _force_lines(axes: Axes, result: Result) -> Line2D:
    """Draw the forces of the first contacts over time, and return the line that marks a moment."""
    entries: Entries = {}
    for k, name in enumerate(result.coordinates["contact"][: figures.OVERLAY]):
        force = result.arrays["contact_force"][:, k]
        entries[name] = figures.draw_line(axes, result.arrays["time"], force, color=COLOURS[k], linestyle=DASHES[k])
    if entries:
        figures.legend(axes, entries, room=100)
    axes.set_xlim(0, result.end)
    figures.set_labels(axes, result.units, xlabel=figures.TIME, ylabel=figures.FORCE)
    return axes.axvline(0.0, color=figures.ALARM, linewidth=1.2)
