"""What stands in the table of quantities is what a run really has."""

import numpy as np
import pytest

import percuss
import places
from percuss.case.quantities import (
    CONTACT_NUMBERS,
    QUANTITIES,
    of_column,
    percent,
    ranking,
    unit_name,
    values_at,
    with_unit,
)
from percuss.reporting.run_figure import figure_of
from percuss.reporting.tables import show
from percuss.reporting.terminal import result_lines
from percuss.studies.columns import metric
from percuss.testing.draws import unit_factor
from strategies import hunek


def result_of(case, changes):
    return percuss.run(percuss.load(case, changes), compiled=False)


@pytest.fixture(scope="module")
def result():
    """The tip has the force at the end of the step, the wall a law with state variables."""
    wall = {"body": "short.left", "wall": -1.0, "method": {"name": "walton-braun", "beta_s": 0.5}}
    law = {"name": "penalty", "beta_s": 0.5}
    return result_of(hunek(10, end=0.3, contact=law), {"record.fields": 3, "contacts.wall": wall})


@pytest.fixture(scope="module")
def of_plastic_body():
    plastic = {"bodies.long.material.name": "bilinear-plastic", "bodies.long.material.yield_stress": 0.02}
    return result_of(hunek(10, end=0.3), plastic)


@pytest.fixture(scope="module")
def of_blocks():
    changes = {"refine": 0.05, "record.fields": 3, "reference": {"refine": 2}, "bodies.long.element": "quad4-one-point"}
    asked = {"quantity": "certificate.courant_critical", "value": 1, "within": 1, "source": "exact"}
    changes |= {
        "bodies.long.material.poisson": 0.3,
        "bodies.long.damping": {"mass": 0.1},
        "method.friction.name": "coulomb",
        "method.friction.mu": 0.1,
        "contacts.press": {"body": "short.left", "wall": {"point": [-99, 0], "normal": [1, 0], "moving": "tool"}},
        "loads.tool": {"prescribed-velocity": 0.1, "along": "x"},
        "expect": [asked],
    }  # a run searches it where it is asked for
    return result_of(places.CASES / "strip-impact.yaml", changes)


@pytest.fixture(scope="module")
def of_rubber():
    solid = {"young": 100.0, "density": 0.01, "poisson": 0.3}
    rubber = {"bodies.short.material": {"name": "neo-hookean", **solid}}
    rubber["bodies.long.material"] = {"name": "j2-plastic", **solid, "yield_stress": 0.01}
    return result_of(places.CASES / "strip-impact.yaml", {"refine": 0.05, "record.fields": 3, "expect": [], **rubber})


# No result of bars with an exact solution has them.
OF_BLOCKS = ("hourglass_energy", "von_mises", "contact_pressure", "contact_area", "contact_force_finer", "gap_finer")
OF_BLOCKS += ("point_traction", "point_slip", "point_status", "contact_force_vector", "contact_slip", "sticking_area")
OF_BLOCKS += (
    "damped_energy",
    "wall_work",
    "volume_ratio",
    "plastic_strain",
    "sliding_area",
    "friction_work",
    "friction_stored",
    "friction_dissipated",
)
OF_OTHER_BODIES = ("internal_work", "dissipated_energy")  # no result with linear bodies has them


@pytest.mark.parametrize("name", [name for name, quantity in QUANTITIES.items() if quantity.axis])
def test_every_history_is_in_a_result(result, of_plastic_body, of_blocks, of_rubber, name):
    quantity = QUANTITIES[name]
    of_blocks = of_rubber if name in {"volume_ratio", "plastic_strain"} else of_blocks
    result = of_plastic_body if name in OF_OTHER_BODIES else of_blocks if name in OF_BLOCKS else result
    if name == "energy":  # the sum of two histories, see `percuss.results.verify`
        return
    dataset = result.fields if quantity.of in ("element", "point", "point vector") else result.histories
    axes = {"contact": ["contact"], "probe": ["probe", "component"], "element": ["element"], "run": []}
    axes["point"] = ["point"]
    axes["contact state"] = ["contact", "state_variable"]
    axes |= {f"{of} vector": [of, "component"] for of in ("contact", "point")} | {"support": ["support", "component"]}
    assert list(dataset[name].dims) == ["time", *axes[quantity.of]]
    assert dataset[name].attrs["long_name"] == quantity.label
    assert dataset[name].attrs["definition"] == quantity.definition != ""
    assert dataset[name].attrs["units"] == quantity.unit
    assert (dataset[name].attrs.get("at") == "time_half") == (quantity.axis == "time_half")
    assert np.isfinite(dataset[name]).any()


@pytest.mark.parametrize("name", [name for name, quantity in QUANTITIES.items() if not quantity.axis or quantity.path])
def test_every_number_is_in_a_result(result, of_blocks, name):
    quantity = QUANTITIES[name]
    # The certificate knows no critical step of a law with state variables.
    result = of_blocks if name == "courant_critical" else result
    if quantity.path:
        numbers = list(values_at(result.summary, quantity.path))
        assert len(numbers) == (2 if "*" in quantity.path else 1)
        assert isinstance(numbers[0], int | float)
    assert quantity.path or quantity.metric
    if quantity.metric:
        assert isinstance(metric(result, name), int | float)


def test_every_history_and_number_of_a_contact_is_in_the_table(result):
    assert set(result.arrays) - {"time", "time_half"} <= set(QUANTITIES)
    assert set(result.field_arrays) - {"time", "body", "position"} <= set(QUANTITIES)
    assert set(result.summary["contacts"]["tip"]) == set(CONTACT_NUMBERS)
    exact = set(result.summary["exact"]["contacts"]["tip"]) - {"closed"}
    assert exact == {name for name, quantity in QUANTITIES.items() if quantity.path.startswith("exact.contacts.")}


def test_the_words_of_the_table_are_whole():
    for name, quantity in QUANTITIES.items():
        assert quantity.label, name
        assert quantity.of == "contact state" or unit_factor(quantity.unit) > 0, name
    labels = [quantity.label for quantity in QUANTITIES.values()]
    assert len(set(labels)) == len(labels)


@pytest.mark.parametrize(
    ("unit", "names", "name"),
    [
        ("length/time", {"length": "mm", "time": "ms"}, "mm/ms"),
        ("length/time", {"length": "mm"}, ""),
        ("force/length^2", {"length": "m", "force": "N"}, "N/m²"),
        ("force/length^2", {"length": "m", "force": "N", "stress": "Pa"}, "Pa"),
        ("energy", {"length": "m", "force": "N"}, "N·m"),
        ("energy", {"energy": "J"}, "J"),
        ("1", {"length": "m"}, ""),
    ],
)
def test_a_unit_has_a_name_where_the_case_names_its_parts(unit, names, name):
    assert unit_name(unit, names) == name
    assert with_unit("words", unit, names) == (f"words [{name}]" if name else "words")


def test_named_units_stand_in_results_figures_and_tables(tmp_path, capsys):
    named = percuss.run(percuss.load(hunek(4, end=0.1) | {"units": {"length": "mm", "force": "kN"}}), compiled=False)
    named.save(tmp_path / "a.nc")
    again = percuss.open_result(tmp_path / "a.nc")
    units = {name: again.histories[name].attrs["units"] for name in ("contact_force", "gap", "velocity")}
    assert units == {"contact_force": "kN", "gap": "mm", "velocity": "length/time"}
    show(result_lines(again))
    assert "peak force [kN]" in capsys.readouterr().out
    pytest.importorskip("matplotlib")
    figure = figure_of(again)
    assert [axes.get_ylabel() for axes in figure.axes[:2]] == ["contact force [kN]", "energy [kN·mm]"]
    assert figure.axes[1].get_xlabel() == "time"


@pytest.mark.parametrize(
    ("fraction", "text"),
    [(0.996, "100 %"), (0.0996, "10 %"), (0.994, "99 %"), (9.996, "1000 %"), (2e4, "2e+06 %"), (1e-12, "1e-10 %")],
)
def test_per_cent_has_no_power_of_ten_where_a_number_is_as_short(fraction, text):
    assert percent(fraction, 2) == text


def test_runs_are_ranked_by_errors_true_ones_first():
    names = ["steps", "ledger_error", "ripple_error", "penetration", "exact.contacts.*.force_error_l2", "impulse_error"]
    ranked = ranking(names)
    assert ranked[:2] == ["exact.contacts.*.force_error_l2", "impulse_error"]
    assert set(ranked[2:]) == {"ripple_error", "penetration"}
    assert of_column("exact.contacts.*.force_error_l2").text(0.0858) == "8.58 %"
