"""Stability maps, waves at an interface and the step that chooses itself, in Python and on the command line."""

import csv
import json
import math

import numpy as np
import pytest
from test_blackbox import CD, WU, wall
from test_stability import beside_another

import long_bars
import percuss
import places
from command_line import percuss_command, printed
from percuss.certificate.closed_step import ClosedStep, Motions
from percuss.certificate.verdict import SHARE_OF_CRITICAL_STEP, certificate, settled
from percuss.certificate.waves import waves
from percuss.march.model_of_case import model_of
from percuss.reporting.stability_figure import stability_figure
from strategies import CORE_PAIRS, INVISCID, UNIT, bar, case_of, hunek

CASES = sorted(places.CASES.glob("*.yaml"))
SDNV, HUNEK = (str(places.CASES / f"{name}.yaml") for name in ("sdnv100", "hunek"))
INF = math.inf


# ------------------------------------------------------------------------------------------------------------ maps


def test_a_map_has_a_row_for_every_combination_and_way():
    case = percuss.load(SDNV, {"bodies.beam.bar.elements": 12, "method.integrator": CD})
    vary, curves = {"method.contact.beta_s": [0.25, 1.0, 10.0]}, {"method.contact.ratio": [INF, 2.0, 1.0]}
    found = percuss.stability(case, vary, curves, ["linear-laws", "black-box"])
    assert len(found) == 18
    blank = found[0] | {"courant_critical": None, "reason": "no line"}
    figure = stability_figure([*found[1:], blank], vary, curves, "A map", "methods")
    words = " ".join(text.get_text() for text in figure.texts)
    assert "1 of 18 points have no number" in words
    table = {(r["by"], r["method.contact.ratio"], r["method.contact.beta_s"]): r["courant_critical"] for r in found}
    for ratio in (INF, 2.0, 1.0):
        for beta in (0.25, 1.0, 10.0):
            one = table["linear-laws", ratio, beta]
            assert table["black-box", ratio, beta] == pytest.approx(one, rel=2e-6)
            endless = long_bars.critical_step([(1.0, 1.0)], beta, beta / (4.0 * ratio))
            assert endless == pytest.approx(one, rel=2e-3)
    assert table["linear-laws", INF, 1.0] == pytest.approx(math.sqrt(2 / (1 + math.sqrt(2))), rel=2e-3)


def test_a_map_over_the_step_has_theta_and_margin():
    found = percuss.stability(
        percuss.load(HUNEK), {"time.courant": [0.4, 0.5, 0.6]}, {"method.contact.ratio": [1, "matched"]}
    )
    for row in found:
        c, ratio = row["time.courant"], row["method.contact.ratio"]
        r = 1 / (4 * c**2) if ratio == "matched" else 1.0
        theta = 4 * c**2 * 0.25 / (1 + 0.25 / r)
        assert row["theta"] == pytest.approx(theta, rel=1e-9)
        assert row["margin"] == pytest.approx(c / row["courant_critical"], rel=1e-9)


def test_what_cannot_be_judged_is_a_row_with_its_reason():
    found = percuss.stability(
        percuss.load(HUNEK, {"bodies.short.bar.elements": 5, "bodies.long.bar.elements": 5,
                             "method": {"integrator": "noh-bathe", "contact": "lagrange"}}),
        {"time.courant": [0.5]}, None, ["linear-laws", "black-box"],
    )  # fmt: skip
    assert [row["courant_critical"] is None for row in found] == [True, False]
    assert "lagrange" in found[0]["reason"]


@pytest.mark.slow
def test_the_command_line_saves_draws_and_prints(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    args = ["stability", SDNV, "--set", "bodies.beam.bar.elements=8", "--set", f"method.integrator={CD}"]
    vary = ["--vary", "method.contact.beta_s=0.1:10:log:4", "--curves", "method.contact.ratio=inf,1"]
    done = percuss_command(
        *args, *vary, "--by", "linear-laws,black-box", "-o", "a.csv", "--plot", "a.svg", "--json", cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)["rows"]
    assert len(told) == 16
    with (tmp_path / "a.csv").open(encoding="utf-8") as file:
        saved = list(csv.DictReader(file))
    assert [float(row["courant_critical"]) for row in saved] == [row["courant_critical"] for row in told]
    drawn = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "<svg" in drawn
    monkeypatch.setattr("percuss.cli.common.SHORT", 5.0)
    plain = percuss_command(*args, *vary, cwd=tmp_path)
    assert plain.returncode == 0
    assert "C critical, linear-laws" in plain.stdout
    assert "The search of 8 critical steps of 9 nodes takes about 40 s.\n" in plain.stderr
    done = percuss_command("waves", HUNEK, "--plot", "w.svg", "--json", cwd=tmp_path)
    told = json.loads(done.stdout)["rows"]
    assert len(told) == 200
    assert all(abs(row["transmission"] - row["formula"]) < 1e-9 for row in told)
    assert (tmp_path / "w.svg").exists()


# ----------------------------------------------------------------------------------------------------------- waves


def transmission(frequency, beta, ratio):
    """Transmission between identical endless bars, central difference (Kopacka et al. 2018)."""
    return 1 / (1 + 1j * frequency * np.sqrt(1 - frequency**2 / 4) / (2 * beta * (1 - frequency**2 / (4 * ratio))))


def by_wu(frequency, beta, ratio, courant):
    turn = 2 * np.arcsin(courant * frequency / 2)
    s = 4 * courant**2  # dt^2 times the Delassus operator, over h/EA
    kappa = beta / (1 + beta * s / (4 * ratio * courant**2) - beta * s)
    return 1 / (1 + 1j * frequency * np.sqrt(1 - frequency**2 / 4) * np.exp(-1j * turn) / (2 * kappa))


@pytest.mark.parametrize(("beta", "ratio"), [(0.25, 1.0), (1.0, INF), (3.0, 2.0), (10.0, 0.7)])
@pytest.mark.parametrize("integrator", [CD, WU])
def test_transmission_is_that_of_the_formula(integrator, beta, ratio):
    law = {"name": "bipenalty", "beta_s": beta, "ratio": ratio}
    found = waves(model_of(percuss.load(hunek(n=8, courant=0.3, integrator=integrator, contact=law))))
    expected = transmission(found.frequency, beta, ratio)
    if integrator == WU:
        expected = by_wu(found.frequency, beta, ratio, 0.3)
    assert np.abs(found.transmitted - expected).max() < 1e-10
    assert np.abs(found.formula - expected).max() < 1e-10
    if integrator == CD:
        assert np.abs(found.kept - 1).max() < 1e-9


@pytest.mark.parametrize("integrator", INVISCID)
@pytest.mark.parametrize("law", ["lagrange", "tied"])
def test_bars_kept_together_are_one_bar(integrator, law):
    found = waves(model_of(percuss.load(hunek(n=6, integrator=integrator, contact={"name": law}))))
    assert np.abs(found.transmitted - 1).max() < 1e-9
    assert np.abs(found.reflected).max() < 1e-9


def test_waves_that_fade_are_no_harmonics():
    with pytest.raises(percuss.PercussError, match="is viscous: harmonics at an interface"):
        waves(model_of(percuss.load(hunek(n=6, integrator="viscous-central-difference", contact={"name": "lagrange"}))))


def test_unlike_bars_keep_the_energy_of_waves_and_a_wall_throws_all_of_it_back():
    back = waves(model_of(percuss.load(wall(1.0, 2.0))))
    assert np.abs(np.abs(back.reflected) - 1).max() < 1e-9
    assert np.abs(back.transmitted).max() == 0
    case = beside_another(wall(2.0, 2.0))
    found = waves(model_of(percuss.load(case)))
    inside = found.frequency * 80 * math.sqrt(1.5) / 60 < 2.0  # of the other bar
    assert np.abs(found.kept - 1).max() < 1e-9
    assert (np.abs(found.reflected[~inside]) > 1 - 1e-9).all()
    impedance = 2 * math.sqrt(6), 1.0
    assert abs(found.transmitted[0]) == pytest.approx(2 * impedance[0] / sum(impedance), rel=1e-2)


# ---------------------------------------------------------------------------------------------- the step chosen


# Bars are asked for all pairs; solids, where the search takes long, for each integrator and each law once.
SOLIDS = {path.stem for path in CASES if "bar: " not in path.read_text(encoding="utf-8")}
EACH_ONCE = {(CD, "penalty"), (CD, "lagrange"), (WU, "bipenalty"), ("noh-bathe", "tied")}
AUTO = {"end": 1e-6, "courant": "auto"}


def mark_of(case, integrator, law):
    """Quick are the bars of Hunek, of other bars each integrator and each law once."""
    once = (integrator, law) in EACH_ONCE and integrator != "noh-bathe"
    return () if case.stem == "hunek" or (once and case.stem not in SOLIDS) else pytest.mark.deep


@pytest.mark.parametrize(
    ("case", "integrator", "law"),
    [
        pytest.param(case, integrator, law["name"], marks=mark_of(case, integrator, law["name"]))
        for case in CASES
        for integrator, law in CORE_PAIRS
        if len(law) == 1 and (case.stem not in SOLIDS or (integrator, law["name"]) in EACH_ONCE)
        if case.stem != "oblique-spheres"  # minutes each
        if case.stem != "two-spheres" or law["name"] in {"lagrange", "bipenalty"}  # half a minute each
    ],
    ids=lambda value: getattr(value, "stem", value),
)
def test_the_chosen_step_is_certified_on_every_case(case, integrator, law):
    loaded = percuss.load(case)
    changes = {"time.courant": "auto"} if "courant" in loaded.data["time"] else {"time": AUTO}
    changes |= {"method.integrator": integrator, "method.contact": law, "method.friction": "none"}
    changes |= {f"contacts.{name}.sliding": "small" for name, one in loaded.contacts.items() if one.sliding == "large"}
    if integrator == "noh-bathe":  # which has no damping
        changes |= {f"bodies.{name}.damping": None for name, body in loaded.bodies.items() if body.damping}
    if getattr(loaded.method.pairing, "more_points_than_nodes", False):
        changes["method.pairing"] = "node-to-segment"
    model, criterion = settled(percuss.load(case, changes))
    found = certificate(model, criterion)
    if model.bodies.why_not_linear:  # whose frequencies change
        assert found["stable"] == "unknown"
        assert "its highest frequency changes with the strain" in found["why"]
        return
    if integrator == "noh-bathe" and law in {"lagrange", "tied"}:  # asked of the black box
        assert found["by"] == "black-box"
        if found["stable"] == "unknown":
            assert "Krylov" in found["why"] or "other combinations" in found["why"]
            return
    assert found["stable"] == "yes"
    lost = 0.01 if criterion.by == "lanczos" else 1e-6
    assert SHARE_OF_CRITICAL_STEP * (1.0 - lost) < found["margin"] < SHARE_OF_CRITICAL_STEP * (1.0 + 1e-6)


def test_a_step_left_open_is_chosen_for_every_point():
    found = percuss.stability(percuss.load(HUNEK), {"method.contact.beta_s": [1, 10], "time.courant": ["auto"]})
    assert [row["margin"] for row in found] == pytest.approx([SHARE_OF_CRITICAL_STEP, SHARE_OF_CRITICAL_STEP], rel=1e-6)


def test_a_wave_packet_gets_through_as_the_interface_says():
    """Two long bars held together by the weight of a load: a packet through the interface, over one through a bar."""
    courant, n, law = 0.5, 300, {"name": "penalty", "beta_s": 0.5}
    bars = {name: bar(n, n, n * k, material=UNIT) for k, name in enumerate(("a", "b"))}
    seam = {"tip": {"between": ["a.right", "b.left"]}}
    case = case_of(bars, seam, {"steps": 1, "courant": courant}, None, CD, law)
    model = model_of(percuss.load(case))
    step = ClosedStep(Motions(model), model.dt, [0])
    x, omega = np.arange(2 * n + 2) - np.r_[np.zeros(n + 1), np.ones(n + 1)], 0.9
    k = 2 * np.arcsin(omega / 2)
    turn = 2 * np.arcsin(courant * omega / 2)
    speed = np.cos(k / 2) / np.sqrt(1 - (courant * omega / 2) ** 2)

    def packet(time):
        at = x - 150 - speed * time
        return np.exp(-((at / 25) ** 2)) * np.cos(k * (x - 150) - turn / courant * time)

    root = np.sqrt(model.bodies.mass)
    now, before = packet(0.0), packet(-courant)
    state = np.concatenate([root * now, root * (now - before)])
    for _ in range(round(300 / speed / courant)):
        state = step(state)
    after = state[: 2 * n + 2] / root
    found = waves(model)
    expected = abs(np.interp(omega, found.frequency, np.abs(found.transmitted)))
    energy = (np.diff(after[n + 1 :]) ** 2).sum() / (np.diff(now[: n + 1]) ** 2).sum()
    assert math.sqrt(energy) == pytest.approx(expected, rel=5e-3)


def test_a_map_of_solids_tells_of_a_pair_that_is_refused_where_the_case_has_it_too(tmp_path):
    """The case as it stands is refused; each row says of its own pair what it is."""
    file = tmp_path / "map.csv"
    vary = "--vary", "method.contact=lagrange,penalty"
    pairing = "--set", "method.pairing=gauss-points", "--set", "method.contact=lagrange"
    printed("stability", places.CASES / "tilted-blocks.yaml", *pairing, *vary, "-o", file)
    with file.open(encoding="utf-8") as rows:
        refused, found = csv.DictReader(rows)
    assert "expected a law with a compliance" in refused["reason"]
    assert float(found["courant_critical"]) > 0.0
