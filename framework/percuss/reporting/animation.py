"""Animation of a result: bodies and their stress as time goes on, beside the contact forces."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from percuss.case.arguments import expect_suffix
from percuss.errors import InputError, PercussError, Problem
from percuss.files import replacing
from percuss.jsonable import Data, Entries
from percuss.reporting.deformed import colour_bar, last_whole, moving_parts, names_in_bodies, scene_of, still_parts
from percuss.reporting.figures import (
    ALARM,
    COLOURS,
    DASHES,
    FAINT,
    FORCE,
    INK,
    OVERLAY,
    SOFT,
    STRESS,
    TIME,
    drawing,
    legend,
    new_figure,
    number,
    set_labels,
    subtitle_lines,
    thinned,
)
from percuss.reporting.run_figure import contacts_left_out
from percuss.reporting.space_time import body_names, contact_positions, strips_of

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
WIDE = 1.5  # width over height from which bodies stand above the forces, not beside them
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
    with drawing():
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
    with drawing():
        from matplotlib.animation import FFMpegWriter, PillowWriter

        figure, show, frames = frames_of(result)
        _freeze(figure)
        writer = (PillowWriter if suffix == ".gif" else FFMpegWriter)(fps=FRAMES_PER_SECOND)
        with replacing(path, suffix) as beside, writer.saving(figure, str(beside), DOTS_PER_INCH):
            for frame in frames:
                show(frame)
                writer.grab_frame()


def frames_of(result: Result) -> tuple[Figure, Callable[[int], None], list[int]]:
    """Return the figure of an animation, the function that shows a snapshot in it, and the snapshots to show."""
    fields = result.field_arrays
    time = np.asarray(fields["time"], dtype=float)
    last = last_whole(fields) if "cell_nodes" in fields else time.size - 1
    frames = np.unique(np.linspace(0, last, min(last + 1, MOST_FRAMES)).round().astype(int)).tolist()
    small = subtitle_lines(result)[:1]
    loud = [] if result.status == "done" else [f"{result.status.upper()}: the result is not complete"]
    small += contacts_left_out(result.coordinates["contact"])
    with new_figure(*SIZE, result.title, small, loud) as figure:
        if "cell_nodes" in fields:
            force, show_bodies = _deformed_bodies(figure, result, frames)
        else:
            waves, force = figure.subplots(2, 1, height_ratios=(1.6, 1.0))
            show_bodies = _stress_lines(waves, result)
        now = _force_lines(force, result)

    def show(frame: int) -> None:
        show_bodies(frame)
        now.set_xdata([time[frame], time[frame]])

    show(frames[0])
    return figure, show, frames


def _freeze(figure: Figure) -> None:
    """Turn all that stands still into one image, so that each frame draws the moving parts alone."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(DOTS_PER_INCH)
    figure.set_layout_engine(None)  # with one, even one that does nothing, each frame would be drawn twice
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()  # which leaves out the moving parts
    still = np.array(canvas.buffer_rgba())
    panels = (artist for axes in figure.axes for artist in axes.get_children())
    for artist in (*figure.texts, *figure.patches, *figure.artists, *panels):
        artist.set_visible(artist.get_animated())
        artist.set_animated(False)
    figure.figimage(still, zorder=-1)


def _moment(time: float, units: Data) -> str:
    return f"time {number(time)} {units.get('time') or ''}".rstrip()


def _deformed_bodies(figure: Figure, result: Result, frames: list[int]) -> tuple[Axes, Callable[[int], None]]:
    """Draw the bodies of two dimensions; return the panel for the forces and the function that shows a snapshot."""
    scene = scene_of(result, frames)
    width, height = scene.high - scene.low
    rows: Any = {"nrows": 2, "height_ratios": (1.9, 1.0)}
    columns: Any = {"ncols": 2, "width_ratios": (1.4, 1.0)}
    axes, force = figure.subplots(**(rows if width > WIDE * height else columns))
    still_parts(axes, scene)
    colour_bar(figure, [axes], scene, result.units)
    title = axes.set_title("time", loc="left", size=10, y=1.0, animated=True)
    moving: list[Artist] = []

    def show(frame: int) -> None:
        while moving:
            moving.pop().remove()
        moving.extend([*moving_parts(axes, scene, frame), *names_in_bodies(axes, scene.fields, frame)])
        for artist in moving:
            artist.set_animated(True)
        title.set_text(_moment(float(scene.fields["time"][frame]), result.units))

    return force, show


def _stress_lines(axes: Axes, result: Result) -> Callable[[int], None]:
    """Draw the stress of each body, and return the function that shows a snapshot."""
    fields, units = result.field_arrays, result.units
    strips, label = strips_of(fields, result.provenance["geometry"]["bodies"])
    time, stress = np.asarray(fields["time"], dtype=float), np.asarray(fields["stress"], dtype=float)
    largest = float(np.abs(stress[np.isfinite(stress)]).max(initial=0.0)) or 1.0
    lines = {}
    for name, strip in strips.items():
        values = stress[0, strip.columns]
        lines[name] = axes.stairs(values, strip.edges, baseline=None, color=COLOURS[0], linewidth=1.8, animated=True)
        axes.axvspan(*strip.edges[[0, -1]], facecolor="#f4f4f4", edgecolor=FAINT, zorder=0)
    contacts, k = result.provenance["geometry"]["contacts"], range(len(result.coordinates["contact"]))
    places = [contact_positions(contacts[name], strips) for name in result.coordinates["contact"]]
    # A contact presses in a snapshot if it carries a force at the recorded time that is nearest.
    nearest = np.abs(result.arrays["time"][:, None] - time).argmin(axis=0) if result.arrays["time"].size else time
    (pressed,) = axes.plot([], [], "o", color=INK, markersize=7, animated=True)
    body_names(axes, strips)
    moment = axes.text(0.99, 0.97, "", transform=axes.transAxes, ha="right", va="top", animated=True)
    axes.set_ylim(-1.1 * largest, 1.1 * largest)
    set_labels(axes, units, xlabel=(label, "length"), ylabel=STRESS)
    axes.set_title("compression is negative; ● contact with force", loc="left", size=9, color=SOFT, y=1.1)

    def show(frame: int) -> None:
        for name, strip in strips.items():
            lines[name].set_data(stress[frame, strip.columns])
        forces = result.arrays["contact_force"][nearest[frame]]
        here = [place for j in k for place in places[j] if forces[j] > 0]
        pressed.set_data(here, [0.0] * len(here))
        moment.set_text(_moment(float(time[frame]), units))

    return show


def _force_lines(axes: Axes, result: Result) -> Line2D:
    """Draw the forces of the first contacts over time, and return the line that marks a moment."""
    names = result.coordinates["contact"][:OVERLAY]
    entries: Entries = {}
    for k, name in enumerate(names):
        force = thinned(result.arrays["time"], result.arrays["contact_force"][:, k])
        (entries[name],) = axes.plot(*force, color=COLOURS[k], linestyle=DASHES[k])
    if entries:
        legend(axes, entries, room=100)
    axes.set_xlim(0, result.end)
    set_labels(axes, result.units, xlabel=TIME, ylabel=FORCE)
    return axes.axvline(0.0, color=ALARM, linewidth=1.2, animated=True)
