"""The benchmark that holds two versions against each other: what it runs, and how it tells a change; without a run."""

import itertools
import json

import numpy as np
import pytest
from benchmarks import digest_cases, digests

from percuss.methods.registry import Registry

LAW = '''
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw


@dataclass(frozen=True)
class Spring(ContactLaw):
    """A spring."""

    name = "spring-of-mine"
    summary = "Spring"

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1 / points.stiffness)
'''


def entries(run):
    """Return the names of all methods in the case of a run, by family."""
    method, bodies = run.case["method"], run.case["bodies"].values()
    names = {family: {method[key]["name"]} for family, key in digest_cases.KEYS.items()}
    for family, key in (("elements", "element"), ("materials", "material")):
        given = [body[key] for body in bodies]
        names[family] = {entry if isinstance(entry, str) else entry.get("name", "elastic") for entry in given}
    keys = {key for load in run.case.get("loads", {}).values() for key in load}
    return names | {"loads": keys, "shapes": {key for body in bodies for key in body}}


@pytest.fixture(scope="module")
def registry():
    """Return the registry of the built-in methods."""
    return Registry.load()


@pytest.fixture(scope="module")
def runs(registry):
    """Return all runs of the built-in methods."""
    return digest_cases.Runs(registry).every()


@pytest.mark.parametrize("only", ["all", "quick", "plain"])
def test_every_registered_method_is_in_a_run(registry, runs, only):
    chosen = [run for run in runs if only == "all" or (only == "quick" and run.quick) or not run.compiled]
    used = [entries(run) for run in chosen]
    for family in digest_cases.FAMILIES:
        missing = set(registry.names(family)).difference(*(names[family] for names in used))
        assert not missing, f"{family} of {only} runs"
    assert set(digest_cases.FEATURES) <= {run.name.split(" | ")[0] for run in chosen}


def test_each_pair_meets_each_mass_element_and_material(registry, runs):
    product = ("integrators", "contacts", "masses", "elements")
    names = {run.name for run in runs}
    for chosen in itertools.product(*map(registry.names, product)):
        assert " | ".join(["unlike bars", *chosen]) in names
    for pair in itertools.product(registry.names("integrators"), registry.names("contacts")):
        assert {" | ".join(["equal bars", *pair]), " | ".join(["equal bars", *pair, "plain"])} <= names
        for material in set(registry.names("materials")) - {"elastic"}:
            assert " | ".join(["materials", *pair, material]) in names


def test_every_example_of_a_method_is_in_a_run(registry, runs):
    parts = {part for run in runs for part in run.name.split(" | ")}
    for family in digest_cases.FAMILIES:
        for choice in itertools.chain(*digest_cases.choices(registry, family).values()):
            title = {"loads": f"load {choice.label} on a.left, always", "shapes": f"shape {choice.label}"}
            assert title.get(family, choice.label) in parts


def test_a_newly_registered_law_joins_unasked(tmp_path):
    file = tmp_path / "spring.py"
    file.write_text(LAW)
    runs = digest_cases.Runs(Registry.load([file])).every()
    own = [run for run in runs if "spring-of-mine" in run.name.split(" | ")]
    used = [entries(run) for run in own]
    for family in ("integrators", "masses", "elements", "materials"):
        assert set().union(*(names[family] for names in used)) == set(Registry.load().names(family))
    assert all(entries(run)["contacts"] == {"spring-of-mine"} for run in own)


def test_names_are_unique_and_those_of_older_records(registry):
    names = [task.name for task in (*digests.shipped(), *digests.registered(registry))]
    assert len(set(names)) == len(names)
    kinds = ("wu-predictor-corrector | tied | plain", "noh-bathe | penalty | compiled", "exact", "stability by pencil")
    assert {f"hunek | {kind}" for kind in kinds} <= set(names)
    assert {
        "study | refined",
        "three bars at one point, a wall, and a drive that lets go | stability by black-box",
    } <= set(names)


def recorded(arrays, **summary):
    """Return digests and content of a made-up run."""
    made = digests.looked({"arrays": arrays, **{f"summary.{key}": value for key, value in summary.items()}})
    return made.digests, digests.numbers_and_words(made.content)


def differences(before, now, tmp_path, capsys):
    """Return what is printed of two made-up runs, of which the first has been through a file, and the count."""
    file = tmp_path / "before.npz"
    digests.write_contents(file, {"other": recorded({"gap": np.arange(500.0)}, why="no")[1], "run": before[1]})
    count = digests.compare({"run": before[0]}, {"run": now[0]}, digests.read_contents(file), {"run": now[1]})
    return capsys.readouterr().out, count


GAP = np.linspace(1.0, 4.0, 200)
ENERGY = {"kinetic_energy": np.full(3, 8.0), "contact_work": np.array([0.0, 1.6e-15]), "energy_error": np.zeros(2)}


@pytest.mark.parametrize(
    ("changed", "text", "round_off"),
    [
        ({"gap": GAP * (1.0 + 2.0**-50)}, "arrays; gap 8.9e-16", 1),
        ({"gap": np.append(GAP[:-1], 3.96)}, "arrays; gap 1.0e-02", 0),
        ({"contact_work": 2 * ENERGY["contact_work"]}, "arrays; contact_work 2.0e-16", 1),
        ({"energy_error": np.full(2, 3e-15)}, "arrays; energy_error 3.0e-15", 1),
        ({"gap": GAP[:150]}, "gap rows '200' -> '150'", 0),
        ({"gap": GAP[:50]}, "gap shape (64,) -> (50,)", 0),
        ({"gap": np.concatenate([GAP[:1], [1.5], GAP[2:]])}, "arrays; only in rows that the record leaves out", 0),
        ({"gap": np.where(GAP > 2.0, np.nan, GAP)}, "infinite or no number in other places", 0),
        ({"force": GAP}, "arrays; force new", 0),
        ({"gap_exact": np.array([-0.0, 1.0])}, "arrays; gap_exact 0.0e+00", 1),
    ],
)
def test_a_change_of_an_array_is_told_with_its_size(changed, text, round_off, tmp_path, capsys):
    arrays = {"gap": GAP, "gap_exact": np.array([0.0, 1.0]), **ENERGY}
    told, count = differences(recorded(arrays), recorded(arrays | changed), tmp_path, capsys)
    assert count == 1
    assert text in told
    assert f"1 compared, 1 differ, {round_off} of them by round-off" in told


def test_an_energy_of_the_summary_is_measured_by_the_largest_energy(tmp_path, capsys):
    before, now = (recorded(ENERGY, energy={"contact_work": work}) for work in (1.6e-9, 1.6e-9 + 8e-15))
    told, _ = differences(before, now, tmp_path, capsys)
    assert told.startswith("run: summary.energy; summary.energy.contact_work 1.0e-15\n1 compared, 1 differ, 1 of them")


def test_a_changed_word_or_number_of_the_summary_is_told(tmp_path, capsys):
    before = recorded({}, certificate={"stable": "yes", "dt_critical": 0.5}, work=[1, 2.0], dt=1e-17, kept=None)
    now = recorded({}, certificate={"stable": "no", "dt_critical": 0.25}, work=[1, 2.0], dt=3e-17, kept=None)
    told, count = differences(before, now, tmp_path, capsys)
    assert count == 1
    assert "summary.certificate, summary.dt; summary.certificate.stable 'yes' -> 'no'" in told
    assert "summary.certificate.dt_critical 5.0e-01" in told
    assert "0 of them by round-off" in told


def test_the_same_numbers_do_not_differ(tmp_path, capsys):
    same = {"gap": np.array([0.0, np.nan]), "phase": np.array([1j])}
    told, count = differences(recorded(same, why="rest"), recorded(dict(same), why="rest"), tmp_path, capsys)
    assert (told, count) == ("1 compared, 0 differ\n", 0)


def test_a_run_that_is_refused_now_differs(tmp_path, capsys):
    refused = digests.refusal(ValueError("no such law"))
    now = refused.digests, digests.numbers_and_words(refused.content)
    told, count = differences(recorded({"gap": GAP}), now, tmp_path, capsys)
    assert count == 1
    assert "arrays, refused; gap gone; gap rows gone; refused new" in told
    assert json.loads(json.dumps(now[0])) == {"refused": "no such law"}


def test_changed_words_of_a_refusal_are_told_from_where_they_differ(tmp_path, capsys):
    texts = ("the law is refused by the scheme: it " + "reads and " * 20 + end for end in ("pulls", "pushes"))
    looked = [digests.refusal(ValueError(text)) for text in texts]
    before, now = ((one.digests, digests.numbers_and_words(one.content)) for one in looked)
    told, _ = differences(before, now, tmp_path, capsys)
    assert "reads and pulls' -> '" in told
    assert "reads and pushes'" in told
    assert "0 of them by round-off, 1 in the words of a refusal" in told
