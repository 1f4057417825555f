"""Numbers from CSV files: what is no number is an error with its place, and no line is ever left out in silence."""

import os
import re

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

import percuss
from percuss.case.csv_file import read_text, table_in
from strategies import hunek

VALUES = st.floats(-1e100, 1e100)
TABLES = st.integers(1, 3).flatmap(
    lambda width: st.lists(st.lists(VALUES, min_size=width, max_size=width), min_size=1, max_size=5)
)


def written(folder, rows, separator=","):
    (folder / "pulse.csv").write_text("\n".join(separator.join(map(repr, row)) for row in rows), encoding="utf-8")
    return "pulse.csv"


@given(
    rows=TABLES,
    separator=st.sampled_from([",", ";", ", ", " ;\t", " ", "   "]),
    header=st.sampled_from(["", "t [s]{0}f\n"]),
)
def test_a_table_is_read_as_it_was_written(tmp_path_factory, rows, separator, header):
    folder = tmp_path_factory.mktemp("table")
    file = written(folder, rows, separator)
    if header:
        text = (folder / file).read_text(encoding="utf-8")
        (folder / file).write_text(header.format(separator.strip()) + text, encoding="utf-8")
    assert table_in(read_text(file, folder), file).table.T.tolist() == rows


@given(data=st.data(), rows=TABLES)
def test_one_wrong_character_is_an_error_at_its_place(tmp_path_factory, data, rows):
    """Also in the first line, which is no header as soon as one field of it begins as a number does."""
    folder = tmp_path_factory.mktemp("table")
    file = written(folder, rows)
    lines = (folder / file).read_text(encoding="utf-8").split("\n")
    line = data.draw(st.integers(0, len(lines) - 1))
    fields = lines[line].split(",")
    field = data.draw(st.integers(0, len(fields) - 1))
    after = data.draw(st.integers(len(fields[field]) - len(fields[field].lstrip("-")) + 1, len(fields[field])))
    wrong = data.draw(st.sampled_from(["_", "O", "l", " ", "\u0663", "'", "\x0c", "_0", "d1"]))
    if wrong == " " and (after == len(fields[field]) or len(fields) == 1):
        wrong = "x"  # blanks at the end of a field are none of its number, and without commas they separate columns
    fields[field] = fields[field][:after] + wrong + fields[field][after:]
    lines[line] = ",".join(fields)
    (folder / file).write_text("\n".join(lines), encoding="utf-8")
    column = 1 + sum(len(one) + 1 for one in fields[:field])
    with pytest.raises(ValueError, match=re.escape(f"pulse.csv:{line + 1}:{column}: expected a number")):
        _ = table_in(read_text(file, folder), file).table


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,1O\n1,2\n", "pulse.csv:1:3: expected a number as 1.5 or 2e-3, found '1O'"),
        ("nan,inf\n1,2\n", "pulse.csv:1:1: expected a finite number, found 'nan'"),
        ("0,1\n1,1e999\n", "pulse.csv:2:3: expected a number of at most 1e+100 in size, found '1e999', which is"),
        ("0,1\n1\n", "pulse.csv:2:1: expected 2 columns as above, found 1"),
        ("time,force\ns,N\n0,1\n", "pulse.csv:2:1: expected a number as 1.5 or 2e-3, found 's'"),
        ("time,force\n", "pulse.csv holds no numbers"),
    ],
)
def test_what_is_wrong_in_a_table_is_told_with_its_place(text, said, tmp_path):
    (tmp_path / "pulse.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(said)):
        table_in(read_text("pulse.csv", tmp_path), "pulse.csv")


def refusal(folder, table):
    """Return the one message by which a table of a load is refused."""
    load = {"table": table, "on": "short.left"}
    (folder / "case.yaml").write_text(yaml.safe_dump({**hunek(4, end=0.1), "loads": {"push": load}}))
    with pytest.raises(percuss.InputError) as refused:
        percuss.load(folder / "case.yaml")
    assert len(refused.value.problems) == 1
    return str(refused.value).replace(f"{folder}{os.sep}", "")


RECORD = '# gauges\ntime\t"near end"\tforce\n0\t0\t0\n0.1\t1\t2\n\n0.2\t1\t3\n'


def test_a_file_of_tabs_has_named_columns_and_lines(tmp_path):
    (tmp_path / "record.tsv").write_text(RECORD, encoding="utf-8")
    table = table_in(read_text("record.tsv", tmp_path), "record.tsv")
    assert table.names == ("time", "near end", "force")
    assert [table.place(row) for row in range(3)] == ["record.tsv:3", "record.tsv:4", "record.tsv:6"]
    assert table.column("force").tolist() == table.column(3).tolist() == [0.0, 2.0, 3.0]
    assert table != table_in(RECORD.replace("force", "strain"), "record.tsv")


@pytest.mark.parametrize(
    ("record", "options", "said"),
    [
        (RECORD, {"columns": ["time", "stress"]}, "has no column 'stress': its first line names 'time', 'near end'"),
        (RECORD, {"columns": [1, 4]}, "record.tsv has no column 4: it has 3, numbered from 1"),
        (RECORD, {}, "record.tsv has 3 columns: name the two for time and value with `columns`"),
        (RECORD, {"columns": [2, 3]}, "record.tsv:6: times must increase: 1 follows 1 of record.tsv:4"),
        (RECORD, {"columns": [1, 2], "time": [0]}, "expected both `time` and `value`, or `file`, found both ways"),
        (RECORD.replace("force", "time"), {"columns": ["time", 2]}, "several columns 'time'"),
        (None, {}, "no such file: "),
        (None, {"file": None}, "expected points: give both `time` and `value`, or `file`"),
        (None, {"file": None, "time": [0], "value": [0], "columns": [1, 2]}, "`columns` are those of a `file`"),
    ],
)
def test_a_wrong_record_is_one_message(record, options, said, tmp_path):
    if record:
        (tmp_path / "record.tsv").write_text(record, encoding="utf-8")
    assert said in refusal(tmp_path, {"file": "record.tsv", **options})


NOTES = "time,note,force\n0,,0\n0.1,3 blows,2\n0.2,ok,3\n"


@pytest.mark.parametrize(("name", "columns"), [("table", ["time", "force"]), ("base-excitation", [1, 3])])
def test_only_the_columns_that_are_named_need_be_numbers(name, columns, tmp_path):
    (tmp_path / "record.csv").write_text(NOTES, encoding="utf-8")
    load = {name: {"file": "record.csv", "columns": columns}, "on": "short.left"}
    (tmp_path / "case.yaml").write_text(yaml.safe_dump({**hunek(4, end=0.1), "loads": {"push": load}}))
    times, forces = percuss.load(tmp_path / "case.yaml").loads["push"].load.points
    assert times.tolist() == [0.0, 0.1, 0.2]
    assert forces.tolist() == [0.0, 2.0, 3.0]


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_a_record_is_text_in_utf_8(encoding, tmp_path):
    (tmp_path / "record.csv").write_bytes("time,größe\n0,1\n1,2\n".encode(encoding))
    told = refusal(tmp_path, {"file": "record.csv"})
    assert "loads.push.table.file: record.csv:1: not UTF-8 text" in told
    assert "Save the file as UTF-8." in told
