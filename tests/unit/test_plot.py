"""Pictures and the notebook's view: what is drawn is the data, and nothing is left behind where drawing fails."""

import copy
import re
import sys

import numpy as np
import pytest

from blocks import bar, block, loaded, plane_at
from fake_studies import BAR
from fake_studies import TWO_BARS as BARS
from marks import deep
from percuss.case.case import load
from percuss.case.quantities import percent
from percuss.errors import InputError, PercussError, RunError
from percuss.march.model_of_case import model_of
from percuss.mesh.cells import cells_of
from percuss.reporting import animation, case_figure, comparison_figure, figures, run_figure, solids
from percuss.results.result import Result
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
    bodies = {f"bar{i}": bar(i, 0.0 if i else 0.1, 4) for i in range(count)}
    contacts = {f"c{i}": {"between": [f"bar{i - 1}.right", f"bar{i}.left"]} for i in range(1, count)}
    return run(loaded(bodies, contacts, time={"steps": 40, "courant": 0.5}))


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


def knowing(result):
    """Return the result with an exact history that is no run's, and that history."""
    out = fresh(result)
    exact = np.where(out.arrays["time"] < 0.2, 0.05, 0.0)
    out.arrays["contact_force_exact"] = exact[:, None]
    return out, out.arrays["time"], exact


def words(figure):
    from matplotlib.text import Text

    return "\n".join(text.get_text() for text in figure.findobj(Text))


def holds(axes, x, y):
    """Whether a line of the panel is exactly these data."""
    return any(np.array_equal(line.get_xydata(), np.column_stack([x, y])) for line in axes.lines)


def collections(axes, kind):
    return [each for each in axes.collections if type(each).__name__ == kind]


# -- files -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".png", *map(deep, (".svg", ".pdf"))])
def test_each_suffix_gives_its_kind_of_file_and_the_same_result_the_same_bytes(good, tmp_path, suffix):
    path = tmp_path / f"picture{suffix}"
    good.plot(path)
    content = path.read_bytes()
    assert content.startswith(MAGIC[suffix])
    assert not re.search(rb"<dc:date>|CreationDate", content)
    good.plot(path)
    assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


def test_another_suffix_is_refused_before_anything_is_written(good, tmp_path):
    for name, found in (("a.jpg", ".jpg"), ("picture", "no ending")):
        with pytest.raises(InputError, match=rf"expected a picture ending in \.png, \.svg or \.pdf, found {found}\n"):
            good.plot(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.deep
def test_settings_of_matplotlib_stay_as_they_were_and_do_not_matter(good):
    import matplotlib as mpl

    before, had_pyplot = mpl.rcParams.copy(), "matplotlib.pyplot" in sys.modules
    plain = figures.picture(run_figure.figure_of(good), "svg")
    assert mpl.rcParams.copy() == before
    with mpl.rc_context({"axes.grid": False, "font.size": 30, "text.usetex": True}):
        assert figures.picture(run_figure.figure_of(good), "svg") == plain
    assert ("matplotlib.pyplot" in sys.modules) == had_pyplot


# -- a run -------------------------------------------------------------------------------------------------


def test_the_lines_are_the_data(good):
    result, time, exact = knowing(good)
    force, energy, *_ = run_figure.figure_of(result).axes
    assert holds(force, time, result.arrays["contact_force"][:, 0])
    assert holds(force, time, exact)
    assert holds(force, [0.02, 0.18], [0.05, 0.05])  # what the case expects
    assert holds(force, [0.4, 0.6], [0.06, 0.06])
    assert len(force.lines) == 4
    bands = [band.get_datalim(force.transData).extents for band in force.collections]
    assert np.allclose(bands, [[0.02, 0.049, 0.18, 0.051], [0.4, 0.05, 0.6, 0.07]])
    half, total = good.arrays["time_half"], good.arrays["kinetic_energy"] + good.arrays["elastic_energy"]
    for name in ("kinetic_energy", "elastic_energy", "external_work", "contact_work"):
        assert holds(energy, half, good.arrays[name]), name
    assert holds(energy, half, total)
    assert holds(energy, half, total - good.arrays["external_work"])
    assert f"ledger closes to {percent(good.summary['energy']['ledger_error'], 2)}" in words(energy)


def test_the_stress_is_drawn_body_by_body_and_contacts_are_thick_while_they_carry_force(good):
    space_time = run_figure.figure_of(good).axes[2]
    stress, owner = good.field_arrays["stress"], np.array(good.field_arrays["body"])
    meshes = collections(space_time, "QuadMesh")
    for mesh, body, ends in zip(meshes, ("short", "long"), ([0, 10], [10, 30]), strict=True):
        assert np.array_equal(mesh.get_array(), stress[:, owner == body])
        low, high = mesh.get_clim()
        assert low == -high < 0
        assert np.allclose(mesh.get_coordinates()[0, [0, -1], 0], ends)
    lines = [lines for lines in collections(space_time, "LineCollection") if lines.get_linewidth()[0] == 3.4]
    segments = np.concatenate([one.get_segments() for one in lines])
    assert np.all(segments[:, :, 0] == 10)
    lasting = float(np.diff(segments[:, :, 1]).sum())
    assert lasting == pytest.approx(good.summary["contacts"]["tip"]["closed_time"], abs=2 * good.summary["dt"])


@pytest.mark.parametrize(
    ("direction", "label", "ends"),
    [
        ([1, 1], "distance along the line of 'short'", [[0, 10], [10, 30]]),
        ([0, 1], "length along each body, one after another", [[0, 10], [10.6, 30.6]]),
    ],
)
def test_bars_in_the_plane_are_laid_along_one_axis_with_their_contacts(direction, label, ends):
    corner = np.array([10, 10]) / 2**0.5
    bodies = {
        "short": {"bar": {"length": 10, "elements": 20, "direction": [1, 1]}, "at": [0, 0], **BAR},
        "long": {"bar": {"length": 20, "elements": 40, "direction": direction}, "at": corner.tolist(), **BAR},
    }
    result = outcome({"bodies": bodies, "contacts": {}, "expect": [], "time": {"end": 0.1, "courant": 0.5}})
    strips, words = run_figure.strips_of(result.field_arrays, result.provenance["geometry"]["bodies"])
    assert words == label
    assert np.allclose([strip.edges[[0, -1]] for strip in strips.values()], ends)
    # One line stands for both sides of a contact where the axis shows them at one place.
    places = run_figure.contact_positions([("short", corner), ("long", corner)], strips)
    assert np.allclose(places, sorted({ends[0][1], ends[1][0]}))
    assert np.allclose(run_figure.contact_positions([("short", [0, 0])], strips), 0)


@pytest.mark.deep
def test_title_and_marks_tell_methods_steps_and_what_went_wrong(good, unstable):
    told = words(run_figure.figure_of(good))
    dt, steps = f"Δt = {good.summary['dt']:.4g}", f"{good.summary['steps']} steps"
    methods = ("wu-predictor-corrector", "bipenalty (εₛ = 50,", "βₛ = 0.25", "Courant number 0.5")
    for part in ("Two bars", *methods, dt, steps):
        assert part in told
    assert "UNSTABLE" not in told
    told = words(run_figure.figure_of(unstable))
    assert "UNSTABLE, no valid result: stopped at step" in told
    assert "Likely cause: " in told
    told = words(run_figure.figure_of(fresh(good, status="interrupted", steps=100)))
    assert f"INTERRUPTED at step 100 of {good.summary['steps']}" in told
    result = fresh(good)
    result.provenance["case"]["title"] = "costs $1 and $\\nonsense{ 2\nin two lines"  # is never mathematics
    figure = run_figure.figure_of(result)
    assert "costs $1 and $\\nonsense{ 2 in two lines" in words(figure)
    assert figures.picture(figure, "png")


def test_what_is_not_there_is_said(unstable):
    told = words(run_figure.figure_of(outcome({"contacts": {}, "expect": [], "record": {"fields": 0}})))
    assert "This case has no contact." in told
    assert "record: {fields: 200}" in told
    result = fresh(unstable, steps=0)  # a run that stopped at once
    result.arrays = {name: values[:0] for name, values in unstable.arrays.items()}
    assert figures.picture(run_figure.figure_of(result), "png")
    assert figures.picture(comparison_figure.comparison_figure([{"label": "a", "result": result}]), "png")


def test_each_contact_has_its_panel_and_the_rest_is_said():
    result = row_of_bars(9)
    figure = run_figure.figure_of(result)
    panels = [axes for axes in figure.axes if axes.get_title("right")]
    assert [axes.get_title("right") for axes in panels] == ["c1", "c2", "c3", "c4", "c5", "c6"]
    for k, axes in enumerate(panels):
        assert holds(axes, result.arrays["time"], result.arrays["contact_force"][:, k])
    assert "the first 6 of 8 contacts are shown" in words(figure)


def test_a_long_history_keeps_its_extremes():
    time = np.arange(1_000_000.0)
    values = np.sin(time)
    values[123_457], values[765_433] = 9.0, -9.0
    boundary, thinned = figures.thinned(time, values)
    assert boundary.size <= figures.MOST_POINTS + 2
    assert (thinned.max(), thinned.min()) == (9.0, -9.0)
    assert np.array_equal(values[boundary.astype(int)], thinned)
    assert np.all(np.diff(boundary) > 0)


# -- several runs ------------------------------------------------------------------------------------------


def test_a_comparison_overlays_the_runs_and_lists_the_others(good, unstable):
    other, _, exact = knowing(outcome(overrides={"method.contact": "lagrange"}))
    rows = [
        {"label": "bipenalty", "result": good},
        {"label": "_lagrange $x", "result": other},
        {"label": "too fast", "result": unstable},
        {"label": "bipenalty", "result": good},
        {"label": "nitsche", "result": None, "reason": "is refused:\nno stress"},
    ]
    figure = comparison_figure.comparison_figure(rows)
    (axes,) = figure.axes
    for result in (good, other, unstable):
        assert holds(axes, result.arrays["time"], result.arrays["contact_force"][:, 0])
    assert holds(axes, other.arrays["time"], exact)  # of one run it stands for all
    told = words(figure)
    assert "_lagrange $x" in told
    assert "bipenalty (4)" in told
    assert re.search(r"too fast: unstable at [\d.]+", told)
    assert "not shown: nitsche: is refused: no stress" in told
    assert "contact force of 4 of 5 runs" in told
    assert "None of the runs has a result." in words(comparison_figure.comparison_figure(rows[4:]))
    assert axes.get_ylim()[1] < 2 * max(good.arrays["contact_force"].max(), other.arrays["contact_force"].max())


def test_without_matplotlib_a_picture_says_what_to_install(good, tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(PercussError, match=r"a picture needs matplotlib, .* pip install 'percuss\[plot\]'"):
        good.plot(tmp_path / "a.png")
    assert good._repr_png_() is None  # a notebook shows the words of the result then
    assert list(tmp_path.iterdir()) == []


# -- solids ------------------------------------------------------------------------------------------------


LOWER = block([0, 0], [0, 0], (10, 3), 0.3, size=(2, 0.6), fixed=["bottom"])
UPPER = block([0.55, 0.62], [0, -0.1], (5, 3), 0.3, "tri3", (0.8, 0.5))
RUN = {"time": {"end": 4, "courant": 0.5}, "record": {"fields": 50}}


def blocks(lower=LOWER, **more):
    """Return the case of a block that falls on another."""
    seam = {"seam": {"between": ["upper.bottom", "lower.top"]}}
    return loaded({"lower": lower, "upper": UPPER}, seam, units={"force": "N", "length": "m"}, **RUN, **more)


def falling(**record):
    """Return the case of a block that falls on a wall."""
    floor = {"floor": {"body": "upper.bottom", "wall": plane_at([0, 0.6], [0, 1])}}
    return loaded({"upper": UPPER}, floor, **{**RUN, "record": {"fields": 50, **record}})


@pytest.fixture(scope="module")
def of_blocks():
    return run(blocks())


def panels_of_solids(figure):
    """Return the panels of deformed bodies."""
    return [axes for axes in figure.axes if collections(axes, "PolyCollection")]


def polygons(collection, corners):
    return [path.vertices[:-1] for path in collection.get_paths() if len(path.vertices) == corners + 1]


def drawn_in(axes):
    """Return the corners of the cells and lines of a panel, and their colours."""
    cells = collections(axes, "PolyCollection")[0]
    return [path.vertices[:-1] for path in cells.get_paths()], cells.get_facecolors()


def colours(fields, snapshot, limit):
    from matplotlib import colormaps

    return colormaps[solids.COLOUR_MAP](fields["von_mises"][snapshot] / limit)


def test_solids_are_drawn_where_they_are_in_the_colours_of_their_stress(of_blocks):
    fields, figure = of_blocks.field_arrays, run_figure.figure_of(of_blocks)
    chosen = solids.chosen_times(fields, of_blocks.end)
    assert list(chosen.values()) == ["largest force", "half of the contact", "release", "end"]
    limit = solids.scene_of(of_blocks, list(chosen)).limit
    panels = panels_of_solids(figure)
    for axes, (snapshot, why) in zip(panels, chosen.items(), strict=True):
        corners, shown = drawn_in(axes)
        place = fields["node_position"] + fields["displacement"][snapshot]
        order = [*range(30, 60), *range(30)]  # triangles come first
        assert np.allclose(shown[:60], colours(fields, snapshot, limit)[order])
        assert np.array_equal(corners[30], place[fields["cell_nodes"][0]])
        assert len(corners) == 60 + 2 * (10 + 3) + 2 * (5 + 3)  # and the outline
        assert axes.get_title("left").endswith(f"\n{why}")
        assert axes.get_aspect() == 1.0
        assert (axes.get_xlim(), axes.get_ylim()) == (panels[0].get_xlim(), panels[0].get_ylim())
        assert place[:, 0].min() > axes.get_xlim()[0]
        assert place[:, 1].max() < axes.get_ylim()[1]
    assert "von Mises stress [N/m²]" in words(figure)
    assert "lower" in words(panels[-1])


def test_arrows_are_the_contact_pressures_and_point_into_the_first_side(of_blocks):
    fields, figure = of_blocks.field_arrays, run_figure.figure_of(of_blocks)
    chosen = solids.chosen_times(fields, of_blocks.end)
    (snapshot,) = [k for k, why in chosen.items() if why == "largest force"]
    _, arrows = collections(panels_of_solids(figure)[0], "PolyCollection")
    pressure = fields["contact_pressure"][snapshot]
    order = np.argsort(-pressure, kind="stable")
    corners = np.array(polygons(arrows, 7))
    assert np.allclose(corners[:, 0], fields["point_position"][snapshot][order])  # the tips
    push = corners[:, 0] - corners[:, [3, 4]].mean(axis=1)
    assert np.allclose(push / np.abs(push).max(), np.outer(pressure[order] / pressure.max(), [0, 1]))
    assert f"longest arrow: contact pressure {pressure.max():.4g} [N/m²]" in words(figure)
    assert len(collections(panels_of_solids(figure)[-1], "PolyCollection")) == 1


def test_faces_within_solids_and_behind_others_are_hidden():
    """Two tetrahedra that share a face, its corners in another order, beside a hexahedron; and two boxes."""
    tetrahedra = [[0, 1, 2, 3], [1, 0, 2, 4]]
    cells = np.array([*(tetrahedron + [-1] * 4 for tetrahedron in tetrahedra), list(range(5, 13))])
    faces = solids.Faces.of(cells, 3)
    assert sorted(len(set(corners)) for corners in faces.corners.tolist()) == [3] * 6 + [4] * 6
    assert not any(set(face) == {0, 1, 2} for face in faces.corners.tolist())
    boxes = {
        "low": block(0, 0, (2, 1, 1), size=(2, 1, 1)),
        "high": block([0, 0, 1.01], [0, 0, 0], (1, 1, 1), size=(1, 1, 1)),
    }
    low, high = (body.mesh for body in model_of(loaded(boxes)).bodies.values())
    faces = [solids.Faces.of(cells_of(mesh), 3) for mesh in (low, high)]
    assert [faces[k].seen(mesh.nodes).sum() for k, mesh in enumerate((low, high))] == [5, 3]  # front, right and top
    assert len(faces[1].outline(high.nodes)) == 9  # of twelve edges, three are behind
    from matplotlib.figure import Figure

    far, near = np.zeros((1, 3, 3)), np.ones((1, 4, 3)) * solids.TO_CAMERA
    drawn = solids.draw(Figure().subplots(), [solids.Part(near, "red"), solids.Part(far, "blue")])
    assert [len(path.vertices) - 1 for path in drawn.get_paths()] == [3, 4]


def test_a_wall_is_drawn_and_pressures_are_left_out_if_a_case_says_so():
    figure = run_figure.figure_of(run(falling()))
    for axes in panels_of_solids(figure):
        assert any(np.allclose(line.get_ydata(), 0.6) for line in axes.lines)
        (hatched,) = axes.patches
        assert hatched.get_xy()[:, 1].max() == pytest.approx(0.6)
        assert axes.get_ylim()[0] < 0.55
    assert "upper" not in words(panels_of_solids(figure)[-1])
    assert "longest arrow" in words(figure)
    result = run(falling(pressure=False))
    assert not [name for name in result.field_arrays if name.startswith(("point_", "contact_"))]
    assert "longest arrow" not in words(run_figure.figure_of(result))


def moments(result, *snapshots):
    """Return a result with some of its snapshots alone."""
    result = fresh(result)
    for name in ("time", "displacement", "stress", "von_mises", "contact_pressure", "point_position"):
        if name in result.field_arrays:
            result.field_arrays[name] = result.field_arrays[name][list(snapshots)].copy()
    return result


def test_an_animation_shows_motion_stress_and_pressure_of_solids_and_not_those_that_flew_away(of_blocks, tmp_path):
    from PIL import Image

    largest, *_ = solids.chosen_times(of_blocks.field_arrays, of_blocks.end)
    result = moments(of_blocks, 0, largest, 10, 20)
    result.field_arrays["displacement"][3] = 100.0
    fields = result.field_arrays
    with figures.drawing():
        figure, show, shown = animation.frames_of(result)
        limit = solids.scene_of(result, shown).limit
        assert shown == [0, 1, 2]
        for k in shown:
            show(k)
            (axes,), place = panels_of_solids(figure), fields["node_position"] + fields["displacement"][k]
            corners, seen = drawn_in(axes)
            assert np.allclose(seen[30:60], colours(fields, k, limit)[:30])
            assert np.array_equal(corners[30], place[fields["cell_nodes"][0]])
            assert len(collections(axes, "PolyCollection")) == 1 + (fields["contact_pressure"][k].max() > 0)
            assert axes.get_title("left") == f"time {fields['time'][k]:.4g}"
    assert axes.get_position().y0 > figure.axes[1].get_position().y1  # wide bodies stand above the forces
    animation.animate(result, tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as picture:
        assert (picture.n_frames, picture.size) == (3, (960, 600))


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


# -- a case ------------------------------------------------------------------------------------------------


def test_a_case_is_drawn_with_its_regions_contacts_supports_and_loads():
    supports = ["bottom", {"on": "left", "along": "x"}]
    push = {"constant": {"value": 0.1}, "on": "upper.top", "as": "pressure"}
    figure = case_figure.case_figure(model_of(blocks({**LOWER, "fixed": supports}, loads={"push": push})))
    (axes,) = figure.axes
    (drawn,) = collections(axes, "PolyCollection")
    shapes = list(zip(drawn.get_paths(), drawn.get_linewidths(), strict=True))
    thick = [path.vertices[:2] for path, width in shapes if width > 2]
    assert len(thick) == 5 + 10
    assert {round(y, 9) for _, y in np.concatenate(thick[:5])} == {0.62}
    arrows = np.array(polygons(drawn, 7))
    up = (arrows[:, 0] - arrows[:, [3, 4]].mean(axis=1))[:, 1]
    assert (up[:5] < 0).all()  # normals of the upper block,
    assert (up[5:15] > 0).all()  # of the lower one,
    assert (up[15:] < 0).all()  # and the load
    assert np.allclose(arrows[15:, 0, 1], 1.12)
    assert np.allclose(sorted(np.mean(polygons(drawn, 20), axis=1)[:, 1]), [0.2, 0.4, 0.6])
    told = words(figure)
    for text in ("upper", "bottom", "contact seam, with normals", "held along x", "load push", "x [m]"):
        assert text in told


def test_a_wall_of_a_case_is_drawn_and_bars_are_refused():
    (axes,) = case_figure.case_figure(model_of(falling())).axes
    assert any(np.allclose(line.get_ydata(), 0.6) for line in axes.lines if len(line.get_ydata()))
    with pytest.raises(InputError, match="expected bodies that are no bars to draw"):
        case_figure.case_figure(model_of(load(TWO_BARS)))
