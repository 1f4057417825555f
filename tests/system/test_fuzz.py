"""Bad input of every kind ends with success or with one clear message: no traceback, no warning, no breakdown.

``HYPOTHESIS_PROFILE=deep pytest tests/system/test_fuzz.py`` takes 10 000 inputs, new ones in every run.
"""

import contextlib
import json
import re
import shutil

import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import percuss
import places
from command_line import percuss_command
from percuss.case.json_schema import case_schema
from percuss.errors import PercussError
from percuss.methods.registry import Registry

REGISTRY = Registry.load()
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
TABLE = "# time, force\ntime;force\n0;0\n0.1;1.5\n0.2;-2e-1\n0.4;0\n"
STUDY = {
    "percuss-study": 1,
    "cases": ["hunek.yaml", "table.yaml"],
    "methods": {"integrators": ["central-difference"], "contacts": ["penalty", {"name": "lagrange"}]},
    "vary": {"method.contact.beta_s": [0.1, 1.0], "time.courant": "0.3:0.9:2"},
    "measure": ["force_error_l1", "ripple", {"name": "plateau", "quantity": "contact_force", "take": "max"}],
    "set": {"time.end": 0.1},
    "keep": {"histories": 20},
    "where": [{"path": "time.courant", "op": "<", "value": 2}],
}
COMMANDS = [  # that are right
    "check hunek.yaml --set time.courant=0.4 --set method.contact=lagrange --json",
    "check table.yaml --set loads.pull.table.file=pull.csv",
    "run hunek.yaml -o out.nc --plot out.svg --nudge",
    "run hunek.yaml --exact-only --json --set bodies.short.velocity=[0.1]",
    "compare hunek.yaml --integrator central-difference --contact penalty,lagrange --vary refine=1,2 --json",
    "stability hunek.yaml --vary method.contact.beta_s=0.1,1 --by black-box,linear-laws -o out.csv --json",
    "waves hunek.yaml --contact tip --json",
    "study study.yaml -o rows.sqlite --workers 1 --export rows.csv --dry-run",
    "report store.sqlite -o page.html",
    "verify hunek.yaml --json",
    "plugins bipenalty --json",
    "plugins --plugin spring.py",
    "schema --study",
    "new my-law --kind contact -o here",
]


TEXTS = (
    ("bad.yaml", "study.yaml", "study bad.yaml -o rows.sqlite --dry-run"),
    ("bad.py", "spring.py", "plugins --plugin bad.py --json"),
)


def inputs(share):
    """Take so many inputs of each 80."""
    unchanged = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large]
    return settings(max_examples=share * settings.default.max_examples // 8, suppress_health_check=unchanged)


@st.composite
def damaged(draw, text):
    """Return a text of which up to three pieces are lost, doubled, moved or replaced by what does not belong there."""
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        pieces = [match.span() for match in re.finditer(r"[\w.+-]+|\n *|.", text)] or [(0, 0)]
        start, stop = draw(st.sampled_from(pieces))
        first, last = draw(st.sampled_from(pieces))
        new = draw(st.sampled_from(["", text[start:stop] * 2, text[first:last], *NASTY]) | st.characters())
        text = text[:start] + new + text[draw(st.sampled_from([stop, stop, stop, max(stop, last), len(text)])) :]
    return text.encode(errors="surrogatepass")


@st.composite
def damaged_bytes(draw, content):
    """Return bytes of which up to three blocks are lost, zero, doubled, moved or others."""
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        at, other = draw(st.integers(0, len(content))), draw(st.integers(0, len(content)))
        length = 2 ** draw(st.integers(0, 12))
        new = draw(st.sampled_from([b"", bytes(length), content[other : other + length]]) | st.binary(max_size=64))
        content = content[:at] + new + content[draw(st.sampled_from([at, at + len(new), at + length, len(content)])) :]
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


def clear(message):
    return 0 < len(message.strip()) < 20_000 and "Traceback" not in message


@contextlib.contextmanager
def refused(name=""):
    """Let one clear message that names a file end what is in the block."""
    said = name or "fine"
    try:
        yield
    except PercussError as error:
        said = str(error)
    assert clear(said)
    assert name in said


@pytest.fixture(scope="module")
def ground(tmp_path_factory):
    """A folder with whole files of each kind, cases of few elements."""
    folder = tmp_path_factory.mktemp("ground")
    for name, text in CASES.items():
        (folder / name).write_text(text, encoding="utf-8")
    hunek = yaml.safe_load(CASES["hunek.yaml"])
    (folder / "pull.csv").write_text(TABLE)
    pulled = {**hunek, "loads": {"pull": {"on": "short.left", "table": {"file": "pull.csv"}}}}
    (folder / "table.yaml").write_text(json.dumps(pulled))
    (folder / "study.yaml").write_text(yaml.safe_dump(STUDY))
    percuss.run(percuss.load(hunek, {"record.fields": 3}), compiled=False).save(folder / "result.nc")
    shutil.copy(places.SUPPORT / "bodies" / "laws.py", folder / "spring.py")
    done = percuss_command("study", "study.yaml", "-o", "store.sqlite", "--workers", "1", cwd=folder, plain=True)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def work(ground, tmp_path):
    return shutil.copytree(ground, tmp_path / "work")


@pytest.fixture
def without_marches(work, monkeypatch):
    """Put a result that is there instead of every march."""
    ready = percuss.open_result(work / "result.nc")
    for module in ("percuss.results.runner", "percuss.studies.perform"):
        monkeypatch.setattr(f"{module}.run", lambda *given, **more: ready)


def ends_well(done):
    assert done.returncode in {0, 1, 2}, done.stderr
    assert "Warning" not in re.sub(r"(Syntax|Deprecation)Warning: ", "", done.stderr), done.stderr
    assert done.returncode < 2 or clear(done.stderr), done.stderr


PLACES = sorted({*places_of(case_schema(REGISTRY))})


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
    with refused():
        percuss.load(case)


@inputs(20)
@given(data=st.data())
def test_no_text_of_a_case_or_a_table_ends_badly(data, work):
    name = data.draw(st.sampled_from([*CASES, "pull.csv"]))
    (work / name).write_bytes(data.draw(damaged(TABLE if name == "pull.csv" else CASES[name])))
    with refused():
        percuss.load(work / ("table.yaml" if name == "pull.csv" else name))
    (work / "pull.csv").write_text(TABLE)


@inputs(8)
@given(data=st.data())
def test_no_text_of_a_study_or_a_plug_in_ends_badly(data, work):
    bad, whole, command = data.draw(st.sampled_from(TEXTS))
    (work / bad).write_bytes(data.draw(damaged((work / whole).read_text())))
    done = percuss_command(*command.split(), cwd=work, plain=True)
    ends_well(done)
    assert done.returncode == 0 or bad == "bad.yaml" or bad in done.stderr


@inputs(16)
@given(data=st.data())
def test_no_words_of_a_command_end_badly(data, work, without_marches):
    words = data.draw(damaged(data.draw(st.sampled_from(COMMANDS)))).decode(errors="replace").replace("\0", "0").split()
    assume(words and not any(word.startswith(("/", "~", "..")) or "/.." in word for word in words))
    ends_well(percuss_command(*words, cwd=work, plain=True))


@inputs(16)
@given(data=st.data())
def test_no_damaged_result_or_study_ends_badly(data, work):
    """A result is cut short: other bytes in the structure of an HDF5 file can make HDF5 itself break the process."""
    name = data.draw(st.sampled_from(["result.nc", "store.sqlite"]))
    bad, content = work / f"bad-{name}", (work / name).read_bytes()
    cut = st.integers(0, len(content) - 1).map(lambda length: content[:length])
    bad.write_bytes(data.draw(cut if name == "result.nc" else damaged_bytes(content)))
    with refused(bad.name):
        if name == "result.nc":
            json.dumps(percuss.open_result(bad).summary)
        else:
            study = percuss.open_study(bad)
            assert repr((study, [study.histories(row["key"]) for row in study.as_records()]))
