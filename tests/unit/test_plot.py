"""Pictures and the notebook's view: what is drawn is the data, and nothing is left behind where drawing fails."""

import copy
import itertools
import re
import sys
from html.parser import HTMLParser

import numpy as np
import pytest

import percuss
from fake_studies import BAR
from fake_studies import TWO_BARS as BARS
from percuss.case.case import load
from percuss.case.quantities import TRUE_ERRORS, percent
from percuss.errors import InputError, PercussError, RunError
from percuss.march.model_of_case import model_of
from percuss.reporting import animation, case_figure, comparison_figure, deformed, figures, report, run_figure, views
from percuss.results.result import Result, open_result
from percuss.results.runner import run

pytest.importorskip("matplotlib", reason="pictures need the extra percuss[plot]")

TWO_BARS = {
    **BARS,
    "record": {"fields": 40},
    "expect": [
        {"quantity": "contact_force", "during": [0.02, 0.18], "mean": 0.05, "within": "2%", "source": "exact"},
        {"quantity": "contact_force", "during": [0.4, 0.6], "max": 0.06, "within": 0.01, "source": "paper"},
        {"quantity": "energy", "final": 0.0005, "within": "1%", "source": "exact"},
    ],
}
MAGIC = {".png": b"\x89PNG\r\n\x1a\n", ".svg": b"<?xml", ".pdf": b"%PDF-"}


def outcome(changes=None, overrides=None):
    """Return a result without its exact history, so that a test can put its own in."""
    try:
        result = run(load({**copy.deepcopy(TWO_BARS), **(changes or {})}), overrides)
    except RunError as error:
        result = error.result
    result.arrays.pop("contact_force_exact", None)
    return result


def row_of_bars(count):
    bodies = {f"bar{i}": {"bar": {"length": 1, "elements": 4}, "at": i, **BAR} for i in range(count)}
    bodies["bar0"]["velocity"] = 0.1
    contacts = {f"c{i}": {"between": [f"bar{i - 1}.right", f"bar{i}.left"]} for i in range(1, count)}
    return outcome(
        {"title": "Row", "bodies": bodies, "contacts": contacts, "expect": [], "time": {"end": 0.1, "courant": 0.5}}
    )


@pytest.fixture(scope="module")
def good():
    return outcome()


@pytest.fixture(scope="module")
def unstable():
    return outcome({"time": {"end": 0.8, "courant": 1.1}, "record": {"fields": 0}})


def fresh(result, **summary):
    """Return a result of its own that shares the arrays."""
    if "steps" in summary:
        summary["end"] = summary["steps"] * result.summary["dt"]
    provenance = copy.deepcopy(result.provenance)
    return Result(
        dict(result.arrays), result.coordinates, dict(result.field_arrays), {**result.summary, **summary}, provenance
    )


def knowing(result, name="tip"):
    """Return the result with an exact history that is no run's, and that history."""
    out = fresh(result)
    exact = np.where(out.arrays["time"] < 0.2, 0.05, 0.0)
    out.arrays["contact_force_exact"] = exact[:, None]
    assert out.coordinates["contact"] == [name]
    return out, out.arrays["time"], exact


def force_figure(result):
    return run_figure.force_figure(result, figures.axis_end(result))


def words(figure):
    from matplotlib.text import Text

    return "\n".join(text.get_text() for text in figure.findobj(Text))


def drawn(axes):
    return [line.get_xydata() for line in axes.lines]


def holds(axes, x, y):
    """Whether a line of the panel is exactly these data."""
    return any(np.array_equal(data, np.column_stack([x, y])) for data in drawn(axes))


@pytest.mark.parametrize("suffix", [*MAGIC, ".PNG"])
def test_each_suffix_gives_its_kind_of_file(good, tmp_path, suffix):
    path = tmp_path / f"picture{suffix}"
    good.plot(path)
    assert path.read_bytes().startswith(MAGIC[suffix.lower()])
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_the_same_result_gives_the_same_bytes(good, kind):
    draw = run_figure.figure_of if kind == "svg" else force_figure
    first, second = (figures.picture(draw(good), kind) for _ in range(2))
    assert first == second
    assert not re.search(rb"<dc:date>|CreationDate", first)


@pytest.mark.parametrize(("name", "found"), [("a.jpg", ".jpg"), ("picture", "no ending"), (".png", "no ending")])
def test_another_suffix_is_refused_before_anything_is_written(good, tmp_path, name, found):
    path = tmp_path / name
    for draw in (lambda: good.plot(path), lambda: figures.write(path, comparison_figure.comparison_figure([]))):
        with pytest.raises(InputError) as caught:
            draw()
        assert str(caught.value) == (
            f"{path}: expected a picture ending in .png, .svg or .pdf, found {found}\n"
            "  Name the file with one of the three."
        )
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_left_behind_and_nothing_lost_where_drawing_fails(good, tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"before")
    monkeypatch.setattr(run_figure, "_energies", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        good.plot(path)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("a.png", b"before")]


def test_a_missing_folder_is_said(good, tmp_path):
    with pytest.raises(InputError, match="expected a folder"):
        good.plot(tmp_path / "none" / "a.png")


def test_settings_of_matplotlib_stay_as_they_were(good):
    import matplotlib as mpl

    before, had_pyplot = mpl.rcParams.copy(), "matplotlib.pyplot" in sys.modules
    plain = figures.picture(run_figure.figure_of(good), "svg")
    assert mpl.rcParams.copy() == before
    with mpl.rc_context({"axes.grid": False, "font.size": 30, "text.usetex": True}):
        assert figures.picture(run_figure.figure_of(good), "svg") == plain
    assert ("matplotlib.pyplot" in sys.modules) == had_pyplot


def test_the_lines_are_the_data(good):
    force, energy, *_ = run_figure.figure_of(good).axes
    assert holds(force, good.arrays["time"], good.arrays["contact_force"][:, 0])
    half, total = good.arrays["time_half"], good.arrays["kinetic_energy"] + good.arrays["elastic_energy"]
    for name in ("kinetic_energy", "elastic_energy", "external_work", "contact_work"):
        assert holds(energy, half, good.arrays[name]), name
    assert holds(energy, half, total)
    assert holds(energy, half, total - good.arrays["external_work"])
    assert f"ledger closes to {percent(good.summary['energy']['ledger_error'], 2)}" in words(energy)


def test_expected_values_are_drawn_over_their_time_with_their_tolerance(good):
    force = run_figure.figure_of(good).axes[0]
    assert holds(force, [0.02, 0.18], [0.05, 0.05])
    assert holds(force, [0.4, 0.6], [0.06, 0.06])
    assert len(force.lines) == 3
    bands = [band.get_datalim(force.transData).extents for band in force.collections]
    assert np.allclose(bands, [[0.02, 0.049, 0.18, 0.051], [0.4, 0.05, 0.6, 0.07]])


def test_exact_histories_are_laid_over_where_there_are_any(good):
    result, time, exact = knowing(good)
    force = run_figure.figure_of(result).axes[0]
    assert holds(force, time, exact)
    assert len(force.lines) == 4
    assert "exact" in words(force)


def test_the_stress_is_drawn_body_by_body_about_zero(good):
    from matplotlib.collections import QuadMesh

    space_time = run_figure.figure_of(good).axes[2]
    meshes = [mesh for mesh in space_time.collections if isinstance(mesh, QuadMesh)]
    stress, owner = good.field_arrays["stress"], np.array(good.field_arrays["body"])
    for mesh, body in zip(meshes, ("short", "long"), strict=True):
        assert np.array_equal(mesh.get_array(), stress[:, owner == body])
        low, high = mesh.get_clim()
        assert low == -high < 0
    edges = [mesh.get_coordinates()[0, [0, -1], 0] for mesh in meshes]
    assert np.allclose(edges, [[0, 10], [10, 30]])


def test_contacts_are_thick_while_they_carry_force(good):
    from matplotlib.collections import LineCollection

    space_time = run_figure.figure_of(good).axes[2]
    lines = [c for c in space_time.collections if isinstance(c, LineCollection) and c.get_linewidth()[0] == 3.4]
    segments = np.concatenate([one.get_segments() for one in lines])
    assert np.all(segments[:, :, 0] == 10)
    lasting = float(np.diff(segments[:, :, 1]).sum())
    assert lasting == pytest.approx(good.summary["contacts"]["tip"]["closed_time"], abs=2 * good.summary["dt"])


ROD = """
from dataclasses import dataclass

import numpy as np
from percuss import Mesh, Region, Shape, hookimpl


@dataclass(frozen=True)
class Rod(Shape):
    '''An upright rod.

    Formula: ``h = 10 / n``
    '''

    name = "rod"
    references = ("none",)
    summary = "An upright rod"
    regions = ("tip", "root")
    examples = ({"elements": 3},)

    elements: int

    def dimension(self):
        return 2

    def mesh(self, at, refine):
        n, up = self.elements * refine, np.array([0.0, 1.0])
        nodes = at + np.linspace(0.0, 10.0, n + 1)[:, None] * up
        return Mesh.of_line(nodes, np.full(n, 10.0 / n), up, {"tip": Region((n,), up), "root": Region((0,), -up)})


@hookimpl
def percuss_shapes():
    return [Rod]
"""


@pytest.mark.parametrize("elements", [1, 4])
def test_a_contact_is_drawn_at_the_end_it_is_at_whatever_that_is_called(elements, tmp_path):
    from matplotlib.collections import LineCollection

    (tmp_path / "rod.py").write_text(ROD, encoding="utf-8")
    rod = {"rod": {"elements": elements}, "at": [0, 0], **BAR, "velocity": [0, 0.1]}
    case = {
        "percuss": 1,
        "bodies": {"rod": rod},
        "contacts": {"stop": {"body": "rod.tip", "wall": [0, 10]}},
        "method": {"integrator": "central-difference", "contact": "penalty"},
        "time": {"end": 0.1, "courant": 0.5},
        "record": {"fields": 20},
    }
    result = percuss.run(percuss.load(case, plugins=[tmp_path / "rod.py"]))
    space_time = run_figure.figure_of(result).axes[2]
    assert np.allclose(space_time.collections[0].get_coordinates()[0, [0, -1], 0], [0, 10])
    (line, *_) = [c for c in space_time.collections if isinstance(c, LineCollection) and c.get_linewidth()[0] == 3.4]
    assert np.allclose(line.get_segments()[0][:, 0], 10)


@pytest.mark.parametrize(
    ("second", "label", "ends"),
    [
        ({"direction": [1, 1]}, "distance along the line of 'short'", [[0, 10], [10, 30]]),
        ({"direction": [0, 1]}, "length along each body, one after another", [[0, 10], [10.6, 30.6]]),
    ],
)
def test_bodies_in_the_plane_are_laid_along_one_axis(second, label, ends):
    at = [10 / 2**0.5, 10 / 2**0.5]
    bodies = {
        "short": {"bar": {"length": 10, "elements": 20, "direction": [1, 1]}, "at": [0, 0], **BAR},
        "long": {"bar": {"length": 20, "elements": 40, **second}, "at": at, **BAR},
    }
    result = outcome({"bodies": bodies, "contacts": {}, "expect": [], "time": {"end": 0.1, "courant": 0.5}})
    space_time = run_figure.figure_of(result).axes[2]
    assert space_time.get_xlabel() == label
    assert np.allclose([mesh.get_coordinates()[0, [0, -1], 0] for mesh in space_time.collections[::2][:2]], ends)


def test_the_title_tells_the_methods_and_steps_as_they_came_out(good):
    told = words(run_figure.figure_of(good))
    for part in ("Two bars", "wu-predictor-corrector", "bipenalty (εₛ = 50,", "βₛ = 0.25", "Courant number 0.5"):
        assert part in told
    assert f"Δt = {good.summary['dt']:.4g}" in told
    assert f"{good.summary['steps']} steps" in told
    assert "UNSTABLE" not in told


def test_an_unstable_run_is_marked_everywhere(unstable):
    assert unstable.status == "unstable"
    told = words(run_figure.figure_of(unstable))
    assert "UNSTABLE, no valid result: stopped at step" in told
    assert "Likely cause: " in told
    assert "unstable: not computed" in words(force_figure(unstable))
    assert "UNSTABLE" in report.notebook_html(unstable)


def test_an_interrupted_run_is_marked(good):
    result = fresh(good, status="interrupted", steps=100)
    told = words(run_figure.figure_of(result))
    assert f"INTERRUPTED at step 100 of {good.summary['steps']}" in told
    assert "interrupted: not computed" in told


def test_a_run_that_stopped_at_once_can_be_drawn(unstable):
    result = fresh(unstable, steps=0)
    result.arrays = {name: values[:0] for name, values in unstable.arrays.items()}
    assert figures.picture(run_figure.figure_of(result), "png")
    assert figures.picture(comparison_figure.comparison_figure([{"label": "a", "result": result}]), "png")


def test_what_is_not_there_is_said():
    result = outcome({"contacts": {}, "expect": [], "record": {"fields": 0}})
    told = words(run_figure.figure_of(result))
    assert "This case has no contact." in told
    assert "record: {fields: 200}" in told


def test_each_contact_has_its_panel_and_the_rest_is_said():
    result = row_of_bars(9)
    for figure in (run_figure.figure_of(result), force_figure(result)):
        panels = [axes for axes in figure.axes if axes.get_title("right")]
        assert [axes.get_title("right") for axes in panels] == ["c1", "c2", "c3", "c4", "c5", "c6"]
        for k, axes in enumerate(panels):
            assert holds(axes, result.arrays["time"], result.arrays["contact_force"][:, k])
        assert "the first 6 of 8 contacts are shown" in words(figure)
    assert "are shown" not in words(force_figure(row_of_bars(3)))


def test_a_long_history_keeps_its_extremes():
    time = np.arange(1_000_000.0)
    values = np.sin(time)
    values[123_457] = 9.0
    values[765_433] = -9.0
    boundary, thinned = figures.thinned(time, values)
    assert boundary.size <= figures.MOST_POINTS + 2
    assert (thinned.max(), thinned.min()) == (9.0, -9.0)
    assert np.array_equal(values[boundary.astype(int)], thinned)
    assert np.all(np.diff(boundary) > 0)


@pytest.mark.parametrize(
    ("low", "high"), [(1.4e5, 4.3e5), (1.2e5, 1.3e5), (1e-9, 1e9), (2e-3, 3e-2), (0.97, 1.03), (3e5, 3e5 + 40)]
)
def test_the_ticks_of_a_logarithmic_axis_are_several_and_differ(low, high):
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    figures.log_axis(axes, "x", (low, high))
    figures.percent_axis(axes, low, high)
    for axis, end in ((axes.xaxis, ""), (axes.yaxis, " %")):
        labels = axis.get_major_formatter().format_ticks(axis.get_majorticklocs())
        assert 3 <= len(labels) == len(set(labels)) <= 12
        assert all(label.endswith(end) for label in labels)
    assert axes.get_ylim()[0] < low < high < axes.get_ylim()[1]
    assert (figures.tick_text(1.5e5), figures.percent_text(0.015)) == ("1.5×10⁵", "1.5 %")


@pytest.mark.parametrize(("low", "high"), [(2.5e5, 8.6e5), (1.1e5, 3.6e5), (1.0, 9.0), (1e-6, 3e5)])
def test_labels_of_an_axis_stand_apart(low, high):
    from matplotlib.figure import Figure

    figure = Figure((4.2, 4.0))  # a narrow panel
    axes = figure.subplots()
    figures.log_axis(axes, "x", (low, high))
    figure.draw_without_rendering()
    ends = [label.get_window_extent() for label in axes.get_xticklabels()]
    assert all(one.x1 < other.x0 for one, other in itertools.pairwise(ends))


@pytest.mark.slow
def test_a_title_is_never_mathematics(good, tmp_path):
    result = fresh(good)
    result.provenance["case"]["title"] = "costs $1 and $\\nonsense{ 2\nin two lines"
    result.plot(tmp_path / "a.png")
    assert "costs $1 and $\\nonsense{ 2 in two lines" in words(run_figure.figure_of(result))


@pytest.mark.slow
def test_a_saved_result_gives_the_same_picture(good, tmp_path):
    good.save(tmp_path / "a.nc")
    again = open_result(tmp_path / "a.nc")
    assert figures.picture(run_figure.figure_of(again), "svg") == figures.picture(run_figure.figure_of(good), "svg")


# -- several runs ------------------------------------------------------------------------------------------


def test_a_comparison_overlays_the_runs_and_lists_the_others(good, unstable, tmp_path):
    other = outcome(overrides={"method.contact": "lagrange"})
    rows = [
        {"label": "bipenalty", "result": good},
        {"label": "_lagrange $x", "result": other},
        {"label": "too fast", "result": unstable},
        {"label": "nitsche", "result": None, "reason": "is refused:\nno stress"},
    ]
    figure = comparison_figure.comparison_figure(rows)
    (axes,) = figure.axes
    for result in (good, other, unstable):
        assert holds(axes, result.arrays["time"], result.arrays["contact_force"][:, 0])
    told = words(figure)
    assert "_lagrange $x" in told
    assert re.search(r"too fast: unstable at [\d.]+", told)
    assert "not shown: nitsche: is refused: no stress" in told
    assert "contact force of 3 of 4 runs" in told
    assert axes.get_ylim()[1] < 2 * max(good.arrays["contact_force"].max(), other.arrays["contact_force"].max())
    figures.write(tmp_path / "a.svg", comparison_figure.comparison_figure(rows))
    assert (tmp_path / "a.svg").read_bytes().startswith(MAGIC[".svg"])


def test_runs_of_one_label_are_all_in_the_legend(good):
    (axes,) = comparison_figure.comparison_figure([{"label": "a", "result": good}] * 3).axes
    assert [text.get_text().strip() for text in axes.get_legend().get_texts()][:3] == ["a", "a (2)", "a (3)"]


@pytest.mark.slow
def test_more_than_six_runs_stand_beside_each_other(good):
    rows = [{"label": f"run {k}", "result": good} for k in range(8)]
    figure = comparison_figure.comparison_figure(rows)
    assert [axes.get_title("left") for axes in figure.axes] == [*(f"run {k}" for k in range(8)), ""]
    assert all(holds(axes, good.arrays["time"], good.arrays["contact_force"][:, 0]) for axes in figure.axes[:8])
    assert figures.picture(figure, "png")


def test_each_contact_has_its_panel_in_a_comparison():
    result = row_of_bars(4)
    figure = comparison_figure.comparison_figure([{"label": "a", "result": result}, {"label": "b", "result": result}])
    assert [axes.get_ylabel() for axes in figure.axes] == ["force at c1", "force at c2", "force at c3"]
    for k, axes in enumerate(figure.axes):
        assert holds(axes, result.arrays["time"], result.arrays["contact_force"][:, k])


def test_contacts_of_more_than_six_runs_have_a_legend_clear_of_the_runs_that_are_not_shown():
    result = row_of_bars(9)
    rows = [{"label": f"run {k}", "result": result} for k in range(7)]
    figure = comparison_figure.comparison_figure([*rows, {"label": "lost", "result": None, "reason": "refused"}])
    (legend,) = figure.legends
    assert [text.get_text().strip() for text in legend.get_texts()] == [f"c{k}" for k in range(1, 7)]
    assert "the first 6 of 8 contacts are shown" in words(figure)
    for line, force in zip(legend.get_lines(), result.arrays["contact_force"].T, strict=False):
        (drawn,) = (one for one in figure.axes[0].lines if one.get_color() == line.get_color())
        assert np.array_equal(drawn.get_ydata(), force)
    (foot,) = (text for text in figure.texts if text.get_text().startswith("not shown: lost"))
    below, at = foot.get_window_extent(), legend.get_window_extent()
    assert below.y1 <= at.y0
    assert at.y1 <= min(axes.get_tightbbox().y0 for axes in figure.axes)


@pytest.mark.parametrize("rows", [[], [{"label": "a", "result": None, "reason": None}]])
def test_a_comparison_without_any_result_says_so(rows):
    assert "None of the runs has a result." in words(comparison_figure.comparison_figure(rows))


def test_the_exact_history_of_one_run_stands_for_all(good):
    known, time, exact = knowing(good)
    rows = [{"label": "a", "result": good}, {"label": "b", "result": known}]
    for panels in (
        comparison_figure.comparison_figure(rows).axes,
        comparison_figure.comparison_figure(rows * 4).axes[:8],
    ):
        assert all(holds(axes, time, exact) for axes in panels)


def test_a_convergence_figure_shows_errors_in_per_cent_orders_and_a_slope():
    from matplotlib.patches import Polygon

    fit = {"integrator": "a", "contact": "b", "method.contact.k": 2, "refine": [1, 2, 4]}
    for name in TRUE_ERRORS:
        fit |= {name: [0.08, 0.02, 0.005], f"{name}_order": 2.04}
    fit |= {TRUE_ERRORS[1]: [None, None, 0.0], f"{TRUE_ERRORS[1]}_order": None}
    figure = comparison_figure.convergence_figure([fit], "Title " * 40)
    first, second, *_ = figure.axes
    assert holds(first, [1, 2, 4], [0.08, 0.02, 0.005])
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["2.04"]
    assert all(label.get_text().endswith(" %") for label in first.get_yticklabels())
    (triangle,) = first.findobj(Polygon)
    (left, top), (_, bottom), (right, _) = triangle.get_xy()[:3]
    assert np.log(top / bottom) / np.log(right / left) == pytest.approx(2.0)
    assert "No run has this error." in words(second)
    assert "a + b k=2" in words(figure)
    title = [text for text in figure.texts if "Title" in text.get_text()]
    figure.set_dpi(180)  # as it is saved
    assert all(text.get_window_extent().x1 < figure.bbox.x1 for text in title)


def test_an_animation_shows_each_snapshot(good, tmp_path):
    from matplotlib.patches import StepPatch

    result = fresh(good)
    result.field_arrays["time"] = good.field_arrays["time"][::14][:3]
    result.field_arrays["stress"] = good.field_arrays["stress"][::14][:3]
    with figures.drawing():
        figure, show, shown = animation.frames_of(result)
        show(shown[-1])
    assert shown == [0, 1, 2]
    time, stress = result.field_arrays["time"][-1], result.field_arrays["stress"][-1]
    steps = figure.axes[0].findobj(StepPatch)
    assert np.array_equal(np.concatenate([step.get_data().values for step in steps]), stress)
    assert f"time {time:.4g}" in words(figure)
    assert figure.axes[1].lines[-1].get_xdata() == [time, time]
    animation.animate(result, tmp_path / "a.gif")
    from PIL import Image

    with Image.open(tmp_path / "a.gif") as picture:
        assert (picture.n_frames, picture.size) == (3, (960, 600))
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]


def test_an_animation_that_cannot_be_made_is_refused_before_the_run(good, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(PercussError, match=r"an \.mp4 needs the program ffmpeg, .* or name the file \.gif"):
        animation.check_animation("a.mp4")
    with pytest.raises(InputError, match=r"expected an animation ending in \.gif or \.mp4, found \.avi"):
        animation.check_animation("a.avi")
    result = fresh(good)
    result.field_arrays.clear()
    with pytest.raises(InputError, match="with stress over space and time to animate, found none"):
        animation.animate(result, tmp_path / "a.gif")


# -- the notebook ------------------------------------------------------------------------------------------


class Tags(HTMLParser):
    """Checks that tags close in order, and gathers the text of the cells."""

    def __init__(self):
        super().__init__()
        self.open, self.cells, self.seen = [], [], []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))
        if tag != "img":
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.cells.append(data)


def parsed(html):
    tags = Tags()
    tags.feed(html)
    tags.close()
    assert tags.open == []
    return tags


def test_a_notebook_shows_table_and_picture(good):
    html = good._repr_html_()
    tags = parsed(html)
    cells, tip = tags.cells, good.summary["contacts"]["tip"]
    assert cells[cells.index("status") + 1] == "done"
    assert "bipenalty" in cells[cells.index("methods") + 1]
    assert f"{good.summary['steps']} steps" in cells[cells.index("steps") + 1]
    assert percent(good.summary["energy"]["ledger_error"], 2) in cells[cells.index("energy") + 1]
    assert percent(good.summary["momentum"]["error"], 2) in cells[cells.index("momentum and impulses") + 1]
    error = good.summary["exact"]["contacts"]["tip"]["force_error_l1"]
    assert cells[:2] == ["true error", f"the contact force is off by {percent(error, 2)}"]
    start = cells.index("tip")
    keys = ("impulse", "peak_force", "first_closed", "last_open", "closed_time")
    numbers = [*(tip[key] for key in keys), tip["penetration"]["largest"]]
    assert cells[start - 7 : start + 7] == [
        *("contact", "impulse", "peak force", "first closed", "last open", "closed for", "penetration"),
        *("tip", *(f"{number:.6g}" for number in numbers)),
    ]
    (picture,) = [attributes for tag, attributes in tags.seen if tag == "img"]
    assert picture["src"].startswith("data:image/png;base64,")


def test_every_cell_says_its_colours_for_dark_notebooks(good):
    for tag, attributes in parsed(report.notebook_html(good)).seen:
        if tag in ("td", "th", "table"):
            assert "background:#" in attributes["style"]
            assert re.search(r";color:#", attributes["style"])


def test_the_users_text_is_escaped(good):
    result = fresh(good)
    result.provenance["case"]["title"] = "<script>alert('1')</script> & more"
    result.summary["contacts"] = {"<b>tip</b>": good.summary["contacts"]["tip"]}
    result.summary["exact"] = {
        **good.summary["exact"],
        "contacts": {"<b>tip</b>": good.summary["exact"]["contacts"]["tip"]},
    }
    html = report.notebook_html(result)
    assert "<script>" not in html
    assert "<b>" not in html
    assert "&lt;script&gt;alert(&#x27;1&#x27;)&lt;/script&gt; &amp; more" in html
    parsed(html)


def test_a_contact_that_never_closed_says_never(good):
    result = fresh(good)
    never = {"impulse": 0.0, "peak_force": 0.0, "first_closed": None, "last_open": None, "closed_time": 0.0}
    never["penetration"] = {"largest": 0.0}
    result.summary["contacts"] = {"tip": never}
    cells = parsed(report.notebook_html(result)).cells
    assert cells[-7:] == ["tip", "0", "0", "never", "never", "0", "0"]


# -- without matplotlib ------------------------------------------------------------------------------------


@pytest.fixture
def no_matplotlib(monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)


@pytest.mark.usefixtures("no_matplotlib")
def test_a_picture_without_matplotlib_says_what_to_install(good, tmp_path):
    message = "a picture needs matplotlib, which is not installed: pip install 'percuss[plot]'"
    path = tmp_path / "a.png"
    for draw in (
        lambda: good.plot(path),
        lambda: comparison_figure.comparison_figure([{"label": "a", "result": good}]),
        lambda: figures.check_suffix(path),
    ):
        with pytest.raises(PercussError) as caught:
            draw()
        assert str(caught.value) == message
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("no_matplotlib")
def test_a_notebook_without_matplotlib_shows_the_table_alone(good):
    html = report.notebook_html(good)
    assert "No picture: a picture needs matplotlib" in html
    assert "<img" not in html
    assert "tip" in parsed(html).cells


MATERIAL = {"young": 1, "density": 1, "poisson": 0.3}
BLOCKS = {
    "percuss": 1,
    "title": "Blocks",
    "units": {"force": "N", "length": "m"},
    "bodies": {
        "lower": {"block": {"size": [2, 0.6], "elements": [10, 3]}, "material": MATERIAL, "fixed": ["bottom"]},
        "upper": {
            "block": {"size": [0.8, 0.5], "elements": [5, 3], "cells": "tri3"},
            "material": MATERIAL,
            "at": [0.55, 0.62],
            "velocity": [0, -0.1],
        },
    },
    "contacts": {"seam": {"between": ["upper.bottom", "lower.top"]}},
    "time": {"end": 4, "courant": 0.5},
    "record": {"fields": 50},
}
FALLING = {
    **{key: value for key, value in BLOCKS.items() if key != "units"},
    "bodies": {"upper": BLOCKS["bodies"]["upper"]},
    "contacts": {"floor": {"body": "upper.bottom", "wall": {"point": [0, 0.6], "normal": [0, 1]}}},
}


@pytest.fixture(scope="module")
def of_blocks():
    return run(load(BLOCKS))


def pictures(figure):
    """Return the panels of deformed bodies."""
    from matplotlib.collections import PolyCollection

    return [axes for axes in figure.axes if any(type(drawn) is PolyCollection for drawn in axes.collections)]


def drawn_cells(axes):
    from matplotlib.collections import PolyCollection

    (cells,) = [drawn for drawn in axes.collections if type(drawn) is PolyCollection]
    return cells


def test_bodies_are_drawn_where_they_are_in_the_colours_of_their_stress(of_blocks):
    fields, figure = of_blocks.field_arrays, run_figure.figure_of(of_blocks)
    chosen = deformed.chosen_times(fields)
    assert list(chosen.values()) == ["largest force", "half of the contact", "release", "end"]
    panels = pictures(figure)
    assert len(panels) == len(chosen)
    for axes, (snapshot, why) in zip(panels, chosen.items(), strict=True):
        cells, place = drawn_cells(axes), fields["node_position"] + fields["displacement"][snapshot]
        assert np.array_equal(cells.get_array(), fields["von_mises"][snapshot])
        corners = [path.vertices[:-1] for path in cells.get_paths()]
        assert [len(corner) for corner in corners] == [4] * 30 + [3] * 30
        assert np.array_equal(corners[0], place[fields["cell_nodes"][0]])
        assert axes.get_title("left").endswith(f"\n{why}")
        assert axes.get_aspect() == 1.0
        assert (axes.get_xlim(), axes.get_ylim()) == (panels[0].get_xlim(), panels[0].get_ylim())
        assert place[:, 0].min() > axes.get_xlim()[0]
        assert place[:, 1].max() < axes.get_ylim()[1]
    assert len({drawn_cells(axes).get_clim() for axes in panels}) == 1
    assert "von Mises stress [N/m²]" in words(figure)
    assert "lower" in words(panels[-1])


def test_arrows_are_the_contact_pressures_and_point_into_the_first_side(of_blocks):
    from matplotlib.quiver import Quiver

    fields, figure = of_blocks.field_arrays, run_figure.figure_of(of_blocks)
    (snapshot,) = [k for k, why in deformed.chosen_times(fields).items() if why == "largest force"]
    (arrows,) = [drawn for drawn in pictures(figure)[0].collections if isinstance(drawn, Quiver)]
    pressure = fields["contact_pressure"][snapshot]
    assert pressure.min() > 0
    assert np.array_equal(arrows.XY, fields["point_position"][snapshot])
    assert np.all(arrows.V > 0)
    assert np.allclose(arrows.V / arrows.V.max(), pressure / pressure.max())
    assert f"longest arrow: contact pressure {pressure.max():.4g} [N/m²]" in words(figure)
    assert not [drawn for drawn in pictures(figure)[-1].collections if isinstance(drawn, Quiver)]


def test_the_outline_is_the_boundary_of_the_bodies(of_blocks):
    fields = of_blocks.field_arrays
    edges = views.Faces.of(fields["cell_nodes"], 2).edges(fields["node_position"])
    length = np.linalg.norm(np.diff(fields["node_position"][edges], axis=1), axis=-1).sum()
    assert length == pytest.approx(2 * (2 + 0.6) + 2 * (0.8 + 0.5))


def test_inner_faces_are_hidden_though_cells_have_unlike_numbers_of_corners():
    """Two tetrahedra that share a face, its corners in another order, beside a hexahedron."""
    tetrahedra = [[0, 1, 2, 3], [1, 0, 2, 4]]
    cells = np.array([*(tetrahedron + [-1] * 4 for tetrahedron in tetrahedra), list(range(5, 13))])
    faces = views.Faces.of(cells, 3)
    assert sorted(faces.sizes) == [3] * 6 + [4] * 6
    assert not any(set(face) == {0, 1, 2} for face in faces.corners)


def test_a_wall_is_drawn_and_the_arrows_before_it():
    result = run(load(FALLING))
    figure = run_figure.figure_of(result)
    for axes in pictures(figure):
        assert any(np.allclose(line[:, 1], 0.6) for line in drawn(axes))
        (hatched,) = axes.patches
        assert hatched.get_xy()[:, 1].max() == pytest.approx(0.6)
        assert axes.get_ylim()[0] < 0.55
    assert "upper" not in words(pictures(figure)[-1])


def test_contact_pressures_are_left_out_if_a_case_says_so(tmp_path):
    result = run(load(FALLING, {"record.pressure": False}))
    assert not [name for name in result.field_arrays if name.startswith(("point_", "contact_"))]
    assert "longest arrow" not in words(run_figure.figure_of(result))
    asked = run(load(FALLING, {"record.pressure": True}))
    assert asked.field_arrays["contact_pressure"].max() > 0
    assert np.array_equal(asked.field_arrays["stress"], result.field_arrays["stress"])
    result.save(tmp_path / "run.vtkhdf")


def test_snapshots_of_an_unstable_run_show_what_is_whole():
    fields = {"node_position": np.array([[0.0, 0.0], [1.0, 0.0]]), "displacement": np.zeros((40, 2, 2))}
    assert list(deformed.chosen_times(fields)) == [0, 13, 26, 39]
    fields["displacement"][30:] = 6.0
    assert list(deformed.chosen_times(fields))[-1] == 29
    fields["contact_pressure"], fields["point_area"] = np.zeros((40, 1)), np.ones(1)
    fields["contact_pressure"][4:20] = 1.0
    fields["contact_pressure"][6] = 2.0
    expected = {6: "largest force", 12: "half of the contact", 20: "release", 29: "end"}
    assert deformed.chosen_times(fields) == expected
    fields["contact_pressure"][20:] = 1.0
    assert list(deformed.chosen_times(fields).values()) == [
        "first touch",
        "largest force",
        "half of the contact",
        "end",
    ]


def test_without_the_stress_across_the_largest_shear_is_drawn(of_blocks):
    fields = {**of_blocks.field_arrays, "von_mises": np.full_like(of_blocks.field_arrays["von_mises"], np.nan)}
    label, shear = deformed.stress_of_cells(fields)
    xx, yy, xy = np.moveaxis(fields["stress"], -1, 0)
    assert label.startswith("largest shear")
    assert np.allclose(shear, np.abs(np.linalg.eigvalsh(np.stack([[xx, xy], [xy, yy]]).T) @ [-0.5, 0.5]).T)


def moments(result, *snapshots):
    """Return a result with some of its snapshots alone."""
    result, some = fresh(result), list(snapshots)
    for name in ("time", "displacement", "stress", "von_mises", "contact_pressure", "point_position"):
        result.field_arrays[name] = result.field_arrays[name][some]
    return result


def test_an_animation_of_blocks_shows_motion_stress_and_pressure_of_each_snapshot(of_blocks, tmp_path):
    from matplotlib.collections import LineCollection
    from matplotlib.quiver import Quiver
    from PIL import Image

    largest, *_, end = deformed.chosen_times(of_blocks.field_arrays)
    result = moments(of_blocks, 0, largest, end)
    fields = result.field_arrays
    with figures.drawing():
        figure, show, shown = animation.frames_of(result)
        assert shown == [0, 1, 2]
        for k in shown:
            show(k)
            (axes,), place = pictures(figure), fields["node_position"] + fields["displacement"][k]
            cells = drawn_cells(axes)
            assert np.array_equal(cells.get_array(), fields["von_mises"][k])
            assert np.array_equal(cells.get_paths()[0].vertices[:-1], place[fields["cell_nodes"][0]])
            (edges,) = [lines for lines in axes.collections if isinstance(lines, LineCollection)]
            assert len(edges.get_segments()) == len(views.Faces.of(fields["cell_nodes"], 2).edges(place))
            arrows = [drawn for drawn in axes.collections if isinstance(drawn, Quiver)]
            assert len(arrows) == (fields["contact_pressure"][k].max() > 0)
            figure.canvas.draw()
            title = axes._left_title
            assert title.get_text() == f"time {fields['time'][k]:.4g}"
            assert title.get_window_extent().y1 < figure.bbox.y1
    assert f"longest arrow: contact pressure {fields['contact_pressure'].max():.4g}" in words(figure)
    animation.animate(result, tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as picture:
        assert (picture.n_frames, picture.size) == (3, (960, 600))
        frames = []
        for k in range(3):
            picture.seek(k)
            frames.append(np.asarray(picture.convert("RGB")).astype(int))
    changed = [np.abs(frame - frames[0]).sum(axis=2) > 60 for frame in frames[1:]]
    upper, below = slice(60, 330), slice(400, 600)  # rows of the bodies, and of the forces
    assert all(change[upper].mean() > 0.01 for change in changed)
    assert all(change[below].any() for change in changed)
    assert not any(change[:60].any() for change in changed)
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]


def test_bodies_that_are_not_wide_stand_beside_the_forces_and_those_that_flew_away_are_not_shown(of_blocks):
    result = moments(of_blocks, 0, 1, 2)
    result.field_arrays["displacement"] = result.field_arrays["displacement"].copy()
    result.field_arrays["displacement"][2] = 100.0
    for name in ("node_position", "point_position"):
        result.field_arrays[name] = result.field_arrays[name] * [0.3, 1.0]
    figure, _, shown = animation.frames_of(result)
    assert shown == [0, 1]
    bodies, force = figure.axes[:2]
    assert bodies.get_position().x1 < force.get_position().x0


def test_a_case_is_drawn_with_its_regions_contacts_supports_and_loads():
    from matplotlib.collections import LineCollection
    from matplotlib.quiver import Quiver

    bodies = {
        **BLOCKS["bodies"],
        "lower": {**BLOCKS["bodies"]["lower"], "fixed": ["bottom", {"on": "left", "along": "x"}]},
    }
    push = {"constant": {"value": 0.1}, "on": "upper.top", "as": "pressure"}
    model = model_of(load({**BLOCKS, "bodies": bodies, "loads": {"push": push}}))
    figure = case_figure.case_figure(model)
    (axes,) = figure.axes
    thick = [lines for lines in axes.collections if isinstance(lines, LineCollection) and lines.get_linewidth()[0] > 2]
    assert [len(lines.get_segments()) for lines in thick] == [5, 10]
    assert {round(y, 9) for _, y in np.concatenate(thick[0].get_segments())} == {0.62}
    arrows = [drawn for drawn in axes.collections if isinstance(drawn, Quiver)]
    assert [(drawn.V > 0).all() for drawn in arrows] == [False, True, False]
    assert np.allclose(arrows[1].V, arrows[1].V[0])
    assert len(arrows[2].V) == 6
    marks = {line.get_marker(): line.get_xydata() for line in axes.lines if len(line.get_xydata())}
    assert np.allclose(marks["^"], [[x, 0.0] for x in np.linspace(0, 2, 11)])
    assert np.allclose(sorted(marks["o"][:, 1]), [0.2, 0.4, 0.6])
    said = words(figure)
    for text in (
        "upper",
        "lower",
        "bottom",
        "left",
        "contact seam, with normals",
        "held along x",
        "load push",
        "x [m]",
    ):
        assert text in said


def test_names_arrows_and_marks_of_a_case_do_not_hide_each_other():
    """A strip, too thin for the names of its long sides, with a support of many nodes, that a disk touches."""
    from matplotlib.quiver import Quiver

    case = {
        **{key: value for key, value in BLOCKS.items() if key != "units"},
        "bodies": {
            "strip": {"block": {"size": [20, 1], "elements": [200, 2]}, "material": MATERIAL, "fixed": ["bottom"]},
            "disk": {"disk": {"radius": 3, "elements": 32}, "at": [10, 4], "material": MATERIAL},
        },
        "contacts": {"seam": {"between": ["disk.skin", "strip.top"]}},
        "method": {"pairing": "node-to-segment"},
    }
    figure = case_figure.case_figure(model_of(load(case)))
    (axes,) = figure.axes
    figure.draw_without_rendering()
    boxes = {text.get_text(): text.get_window_extent() for text in axes.texts}
    assert set(boxes) == {"strip", "disk", "left", "right", "bottom", "top", "skin"}
    names = list(boxes)
    assert not [(a, b) for k, a in enumerate(names) for b in names[:k] if boxes[a].overlaps(boxes[b])]
    (marks,) = [line.get_xydata() for line in axes.lines if line.get_marker() == "^" and len(line.get_xydata())]
    assert 20 < len(marks) < 50
    assert np.diff(marks[:, 0]).min() > 0.025 * 20
    around, along = [drawn for drawn in axes.collections if isinstance(drawn, Quiver)]
    assert len(around.XY) == len(along.XY) == 24
    apart = np.linalg.norm(around.XY - np.roll(around.XY, 1, axis=0), axis=1)
    assert apart.max() < 1.6 * apart.min()
    assert boxes["top"].x0 > axes.transData.transform([13.0, 1.0])[0]  # the top runs from right to left
    assert boxes["bottom"].y1 < axes.transData.transform([0.0, 0.0])[1]


def test_a_wall_of_a_case_is_drawn_and_bars_are_refused():
    (axes,) = case_figure.case_figure(model_of(load(FALLING))).axes
    assert any(np.allclose(line[:, 1], 0.6) for line in drawn(axes) if len(line))
    with pytest.raises(InputError, match="expected bodies that are no bars to draw"):
        case_figure.case_figure(model_of(load(TWO_BARS)))
