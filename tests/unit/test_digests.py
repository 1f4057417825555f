"""The benchmark that holds two versions against each other: what it runs, and how it tells a change; without a run."""

import numpy as np
import pytest
from benchmarks import digest_cases, digests

from percuss.methods.registry import Registry


def entries(run):
    """Return the names of all methods in the case of a run, by family."""
    method, bodies = run.case["method"], run.case["bodies"].values()
    names = {family: {method[key]["name"]} for family, key in digest_cases.KEYS.items()}
    for family, key in (("elements", "element"), ("materials", "material")):
        given = [body[key] for body in bodies]
        names[family] = {entry if isinstance(entry, str) else entry.get("name", "elastic") for entry in given}
    keys = {key for load in run.case.get("loads", {}).values() for key in load}
    names["frictions"] = {method.get("friction", {"name": ""})["name"]}
    return names | {"loads": keys, "shapes": {key for body in bodies for key in body}}


def test_every_registered_method_is_in_a_quick_run():
    registry = Registry.load()
    chosen = [run for run in digest_cases.Runs(registry).every() if run.quick]
    used = [entries(run) for run in chosen]
    for family in digest_cases.FAMILIES:
        assert not set(registry.names(family)).difference(*(names[family] for names in used)), family
    assert set(digest_cases.FEATURES) <= {run.name.split(" | ")[0] for run in chosen}


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
        ({"contact_work": 2 * ENERGY["contact_work"]}, "arrays; contact_work 2.0e-16", 1),
        ({"gap": np.concatenate([GAP[:1], [1.5], GAP[2:]])}, "arrays; only in rows that the record leaves out", 0),
        ({"gap": np.where(GAP > 2.0, np.nan, GAP)}, "infinite or no number in other places", 0),
        ({"certificate": {"stable": "no"}}, "summary.certificate; summary.certificate.stable 'yes' -> 'no'", 0),
    ],
)
def test_a_change_is_told_with_its_size(changed, text, round_off, tmp_path, capsys):
    arrays, words = {"gap": GAP, **ENERGY}, changed if "certificate" in changed else {"certificate": {"stable": "yes"}}
    now = recorded(arrays | {name: values for name, values in changed.items() if name in arrays}, **words)
    told, count = differences(recorded(arrays, certificate={"stable": "yes"}), now, tmp_path, capsys)
    assert count == 1
    assert text in told
    assert f"1 compared, 1 differ, {round_off} of them by round-off" in told
