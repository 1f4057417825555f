"""Wrong inputs, each with the whole of what it says: the table is `input_errors.yaml`."""

from pathlib import Path

import pytest
import yaml

import percuss
from percuss.case import source
from percuss.case.case import load
from percuss.case.source import Source
from percuss.errors import InputError
from percuss.march.model_of_case import model_of
from percuss.methods.registry import Registry

TABLE, REFUSALS = (
    yaml.safe_load((Path(__file__).parent / f"{name}.yaml").read_text(encoding="utf-8"))
    for name in ("input_errors", "refusals")
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("words.csv").write_text("time,value\n0,0\n1,high\n")
    Path("column.csv").write_text("0\n1\n")
    return tmp_path


def message(text, overrides=None):
    Path("case.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load("case.yaml", overrides)
    assert all(problem.message for problem in caught.value.problems)
    return str(caught.value)


@pytest.mark.parametrize("row", TABLE["rows"], ids=lambda row: row["name"])
def test_message(row, folder):
    text = row.get("text", TABLE["base"])
    for old, new in row.get("change", {}).items():
        assert old in text
        text = text.replace(old, new, 1)
    expected = row["message"].rstrip("\n")
    for family, words in (("contacts", "CONTACT LAWS"), ("loads", "THE LOADS")):
        expected = expected.replace(words, ", ".join(Registry.load().names(family)))
    assert message(text, row.get("set")).replace(str(folder), "FOLDER") == expected


def said_of(*loaded, of=load):
    with pytest.raises(InputError) as caught:
        of(*loaded)
    return str(caught.value)


@pytest.mark.parametrize("row", REFUSALS["rows"], ids=lambda row: row["name"])
def test_what_is_not_built_is_refused_with_its_reason(row):
    """The table is `refusals.yaml`."""
    case = load(REFUSALS["bases"][row["of"]])
    assert row["said"] in said_of(case, row["set"], of=lambda case, changes: model_of(case.with_overrides(changes)))


def test_a_file_that_is_no_case_is_told_as_such(folder):
    Path("impact.yaml").write_text("")
    Path("latin.yaml").write_bytes("percuss: 1\ntitle: Hun\xecek".encode("latin-1"))
    Path("mine.py").write_text("x = 1\n")
    assert said_of("impct.yaml") == "impct.yaml: no such file\n  Did you mean 'impact.yaml'?"
    assert said_of("latin.yaml") == "latin.yaml:2: not UTF-8 text\n  Save the file as UTF-8."
    assert "found a Python file\n  Name it as --plugin mine.py" in said_of("mine.py")
    assert "Name the file as --plugin mine.py" in said_of("mine.py", of=percuss.plugins)
    assert "expected a YAML file, found a pipe or a device" in said_of("/dev/zero")  # it has no end


@pytest.mark.parametrize(
    ("ends", "advice"),
    [
        ("[short.left, long.right]", "Did you mean the ends [short.right, long.left]?"),
        ("[short.right, long.left]", "Move them apart by 0.3, or drop the contact."),
    ],
)
def test_bars_that_overlap_may_have_swapped_ends(folder, ends, advice):
    Path("case.yaml").write_text(TABLE["base"].replace("at: 10", "at: 9.7" if "0.3" in advice else "at: 10"))
    assert advice in said_of(load("case.yaml", {"contacts.tip.between": ends}), of=model_of)


def test_an_alias_bomb_is_refused_quickly(folder):
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    assert message("\n".join(lines)).startswith("case.yaml:6:")
    assert "more than 200000 values, aliases included" in message("\n".join(lines))


@pytest.mark.parametrize("text", ["[" * 100_000, "{a: " * 100_000, "- " * 10_000, "a: &a [*a]"])
def test_no_nesting_breaks_the_reader(folder, text):
    assert message(text).startswith("case.yaml:1:")


def test_a_file_that_is_too_large_is_not_read(folder, monkeypatch):
    monkeypatch.setattr(source, "MAX_BYTES", 1_000_000)
    assert message("# " + "x" * 1_000_000) == (
        "case.yaml: expected at most 1 MB of text, found more\n  Keep tables in a CSV file."
    )


def test_an_anchor_is_that_of_a_value_or_a_key_and_stands_once(folder):
    source = Source.parse("&word bar: *word\nb: &b {c: [1]}\nd: *b", "x")
    assert source.data == {"bar": "bar", "b": {"c": (1,)}, "d": {"c": (1,)}}
    assert [source.place(path) for path in [("bar",), ("d",), ("d", "c", 0)]] == ["x:1:12", "x:3:4", "x:2:12"]
    assert message("a: &x 1\nb: &x 2").splitlines()[0] == (
        "case.yaml:2:4: the anchor &x occurs twice: here and in line 1"
    )
    assert message("&x a: 1\n*x : 2").startswith("case.yaml:2:1: expected a word as key")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e3", 1000.0), ("1.0e-4", 1e-4), ("1e9", 1e9), (".5", 0.5), ("5.", 5.0), ("-7", -7), ("0x1f", 31),
        ("on", "on"), ("no", "no"), ("yes", "yes"), ("true", True), ("False", False), ("~", None),
        ("null", None), ("0o17", 15), ("'1'", "1"), ("1_000", "1_000"), ("12:30", "12:30"), ("1e", "1e"),
        ("2026-01-01", "2026-01-01"), ("0b1", "0b1"), ("!!str 1", "1"), ("!!float 1", 1.0),
        ("-.inf", float("-inf")), ("1" * 5000, float("inf")), ("-010", -10), ("!!float 0x10", 16.0), ("'<<'", "<<"),
    ],
)  # fmt: skip
def test_scalars_are_those_of_yaml_1_2(text, value):
    data = Source.parse(f"a: {text}", "x").data["a"]
    assert data == value
    assert type(data) is type(value)
