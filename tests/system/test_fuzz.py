"""Bad input of every kind ends with success or with one clear message: no traceback, no warning, no breakdown.

``HYPOTHESIS_PROFILE=deep pytest tests/system/test_fuzz.py`` takes 10 000 inputs, new ones in every run.
"""

import json
import re
import shutil

import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import percuss
import places
from command_line import percuss_command, printed
from percuss.case.json_schema import case_schema
from percuss.certificate import maps
from percuss.errors import PercussError
from percuss.methods.registry import Registry
from percuss.studies import layout

NASTY = [
    *("0", "-1", "1e308", "5e-324", "1e400", ".inf", "-.inf", ".nan", "-0.0", 400 * "1", "9223372036854775808"),
    *("1000000", "0x7fffffff", "1_000", "0:1:1000000", "null", "true", "''", "[]", "{}", "[[]]", "{a: 1}", "{name: x}"),
    *("!!python/none x", "*a", "&a 1", "<<: *a", "auto", "matched", "short.right", "nobody.left", "lagrange", "."),
    *("a" * 300, ">", "? a", "|", "#", "\0", "\ufeff", "名前", "\u202e", "\ud7ff", "\x85", "\t", "\n", "%s%n", "--- "),
]  # fmt: skip
NUMBERS = st.floats() | st.integers() | st.integers(-(10**30), 10**30) | st.sampled_from([10**4000, -(10**400)])
VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(max_size=40) | st.sampled_from([*NASTY, "x" * 10_000]),
    lambda items: st.lists(items, max_size=4) | st.dictionaries(st.text(max_size=8), items, max_size=3),
    max_leaves=8,
)
CASES = {
    file.name: re.sub(r"elements: [0-9]+", "elements: 4", file.read_text(encoding="utf-8"))
    for file in sorted(places.CASES.glob("*.yaml"))
}
STUDY = (places.CASES / "studies" / "work-precision.yaml").read_text(encoding="utf-8")
STUDY = STUDY.replace("../", "").replace("[1, 2, 4, 8]", "[1]").replace("tied: true", "tied: false")
COMMANDS = [  # that are right
    "check hunek.yaml --set time.courant=0.4 --set method.contact=lagrange --json",
    "run hunek.yaml -o out.nc --plot out.svg --nudge",
    "run hunek.yaml --exact-only --json --set bodies.short.velocity=[0.1]",
    "compare hunek.yaml --integrator central-difference --contact penalty,lagrange --vary refine=1,2 --json",
    "stability hunek.yaml --vary method.contact.beta_s=0.1,1 --by black-box,linear-laws -o out.csv --json",
    "study study.yaml -o rows.sqlite --workers 1 --export rows.csv --dry-run",
    "report store.sqlite -o page.html",
    "plugins bipenalty --plugin spring.py --json",
]
# Files to damage, and commands that read them if they are no case, result or study.
FILES = {
    **dict.fromkeys([*CASES, "result.nc", "store.sqlite"], ""),
    "pull.csv": "check table.yaml",
    "study.yaml": "study study.yaml -o rows.sqlite --dry-run",
    "spring.py": "plugins --plugin spring.py --json",
}


def inputs(share):
    """Take so many inputs of each 80."""
    unchanged = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large]
    return settings(max_examples=share * settings.default.max_examples // 8, suppress_health_check=unchanged)


@st.composite
def damaged(draw, content):
    """Return bytes of which up to three pieces are lost, doubled, moved or replaced by what does not belong there."""
    nasty = [text.encode(errors="surrogatepass") for text in NASTY]
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        pieces = [match.span() for match in re.finditer(rb"[\w.+-]+|\n *|.", content, re.DOTALL)] or [(0, 0)]
        (start, stop), (first, last) = (draw(st.sampled_from(pieces)) for _ in range(2))
        moved = st.sampled_from([b"", content[start:stop] * 2, content[first:last], *nasty])
        rest = draw(st.sampled_from([stop, stop, stop, max(stop, last), len(content)]))
        content = content[:start] + draw(moved | st.binary(max_size=64)) + content[rest:]
    return content


def places_of(schema, at=()):
    """Yield the place of each value that a schema knows; `*` is any name."""
    for key, part in {**schema.get("properties", {}), "*": schema.get("additionalProperties")}.items():
        if isinstance(part, dict):
            yield (*at, key)
            yield from places_of(part, (*at, key))
    for part in [*schema.get("anyOf", ()), *schema.get("allOf", ()), schema.get("then")]:
        if part:
            yield from places_of(part, at)


def assert_clear(message, name=""):
    assert name in message
    assert 0 < len(message.strip()) < 20_000
    assert not re.search(r"Traceback|(?<!Syntax)(?<!Deprecation)Warning: ", message)


def assert_ends_well(command, folder):
    done = percuss_command(*command, cwd=folder, plain=True)
    assert done.returncode in {0, 1, 2}
    assert_clear(f".{done.stderr}")


@pytest.fixture
def work(tmp_path, monkeypatch):
    """Return a folder with whole files of each kind, cases of few elements; a result stands for every march."""
    for name, text in CASES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    hunek = yaml.safe_load(CASES["hunek.yaml"])
    (tmp_path / "pull.csv").write_text("# time, force\ntime;force\n0;0\n0.1;1.5\n0.2;-2e-1\n0.4;0\n")
    pulled = {**hunek, "loads": {"pull": {"on": "short.left", "table": {"file": "pull.csv"}}}}
    (tmp_path / "table.yaml").write_text(json.dumps(pulled))
    (tmp_path / "study.yaml").write_text(STUDY)
    ready = percuss.run(percuss.load(hunek, {"record.fields": 3}), compiled=False)
    ready.save(tmp_path / "result.nc")
    shutil.copy(places.SUPPORT / "bodies" / "laws.py", tmp_path / "spring.py")
    for module in ("percuss.results.runner", "percuss.studies.perform"):
        monkeypatch.setattr(f"{module}.run", lambda *given, **more: ready)
    printed("study", "study.yaml", "-o", "store.sqlite", "--workers", "1", cwd=tmp_path, plain=True)
    return tmp_path


PLACES = sorted({*places_of(case_schema(Registry.load()))})


@inputs(20)
@given(data=st.data())
def test_no_value_at_any_place_of_a_case_ends_badly(data):
    case = yaml.safe_load(CASES[data.draw(st.sampled_from([*CASES]))])
    *path, key = data.draw(st.sampled_from(PLACES))
    owner = case
    for part in path:
        name = data.draw(st.sampled_from([*owner])) if part == "*" and owner else part
        if not isinstance(owner.get(name), dict):
            owner[name] = {"name": owner[name]} if isinstance(owner.get(name), str) else {}
        owner = owner[name]
    owner[key] = data.draw(VALUES)
    try:
        percuss.load(case)
    except PercussError as refusal:
        assert_clear(str(refusal))


@inputs(44)
@given(data=st.data())
def test_no_damaged_file_ends_badly(data, work):
    """A result is cut short: other bytes in the structure of an HDF5 file can make HDF5 itself break the process."""
    name = data.draw(st.sampled_from([*FILES]))
    bad, whole = work / name, (work / name).read_bytes()
    cut = st.integers(0, len(whole) - 1).map(lambda length: whole[:length])
    bad.write_bytes(data.draw(cut if name == "result.nc" else damaged(whole)))
    try:
        if name == "result.nc":
            json.dumps(percuss.open_result(bad).summary)
        elif name == "store.sqlite":
            study = percuss.open_study(bad)
            assert repr((study, [study.histories(row["key"]) for row in study.as_records()]))
        elif FILES[name]:
            assert_ends_well(FILES[name].split(), work)
        else:
            percuss.load(bad)
    except PercussError as refusal:
        assert_clear(str(refusal), name)
    finally:
        bad.write_bytes(whole)


@pytest.fixture
def few_values(monkeypatch):
    """Refuse a thousand combinations of values as a million are: their maps take a second, not an hour."""
    monkeypatch.setattr(layout, "MOST", 1000)
    monkeypatch.setattr(maps, "MOST_COMBINATIONS", 1000)


@inputs(16)
@given(data=st.data())
def test_no_words_of_a_command_end_badly(data, work, few_values):
    command = data.draw(damaged(data.draw(st.sampled_from(COMMANDS)).encode()))
    words = command.decode(errors="replace").replace("\0", "0").split()
    assume(words and not any(word.startswith(("/", "~", "..")) or "/.." in word for word in words))
    assert_ends_well(words, work)
