"""Every command and snippet of every page is executed."""

import contextlib
import dataclasses
import json
import os
import re
import shlex
import tempfile
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml

import held_against
import notebook
import pages
import percuss
import places
from command_line import percuss_command, printed
from marks import deep
from percuss.case import specs
from percuss.methods.registry import Registry

ROOT = places.ROOT
PAGES = pages.texts()
README = PAGES["README.md"]
LONGEST, MOST_WORDS = 120, 900  # lines and words of the first page
CHECKED = {"sh", "python", "yaml", "console"}  # kinds of blocks that the tests below execute or load
CHECKED |= {"toml"}  # test_third_party installs the package that it describes
FREE = {"text", "bibtex"}  # and those that they do not


def all_blocks(kind: str) -> list[str]:
    """Return the blocks of one kind in all pages, each once."""
    return list(dict.fromkeys(text for page in PAGES.values() for text in pages.blocks(page, kind)))


SHELL = pages.blocks(README, "sh")
PYTHON = all_blocks("python")
YAML = all_blocks("yaml")
COMMANDS = list(
    dict.fromkeys(line for text in all_blocks("sh") if text not in SHELL[:2] for line in text.strip().splitlines())
)

NEW = [command for command in COMMANDS if command.startswith("percuss new ")]


def beginning(text: str) -> str:
    """Return the first line of a block."""
    return text.splitlines()[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the cases and the plug-ins of the pages, as a reader would have it."""
    here = tmp_path_factory.mktemp("readme")
    pages.fill(here)
    for command in NEW:
        printed(*shlex.split(command)[1:], cwd=here)
    return here


def test_every_block_is_of_a_kind_that_is_checked() -> None:
    for name, page in PAGES.items():
        fences = re.findall(r"^ *```(.*)$", page, re.MULTILINE)
        assert len(fences) % 2 == 0, name
        kinds = {kind for kind in fences[::2] if not (kind.startswith("{") and name.startswith("framework/docs/"))}
        assert kinds <= CHECKED | FREE, name
        assert set(fences[1::2]) <= {""}, name
        for text in (text for kind in FREE for text in pages.blocks(page, kind)):
            assert not re.search(r"^(\$ )?percuss ", text, re.MULTILINE), f"{name}: a command that no test runs"


@pytest.mark.skipif(not places.has_source_tree, reason="reads the source tree, and here are the tests alone")
def test_exactly_two_commands_set_up() -> None:
    first, second = SHELL[:2]
    assert len(first.strip().splitlines()) == len(second.strip().splitlines()) == 1
    assert "percuss run cases/hunek.yaml" in first
    assert "pytest" in second
    # the script that checks everything runs these two blocks as they stand
    assert "command_of 1" in (ROOT / ".ci" / "run").read_text()
    assert "command_of 2" in (ROOT / ".ci" / "run").read_text()


# What takes long even on the first page: deep checks; and the longest of all.
LASTING = ("percuss verify --plugin", "percuss stability", "--vary", "element=")
LONGEST_OF_ALL = ("percuss verify cases", "percuss study", "percuss report", "percuss recommend", ".sqlite")


def marks_of(command: str) -> tuple[pytest.MarkDecorator, ...]:
    """Return when a command is executed."""
    if any(words in command for words in LONGEST_OF_ALL):
        return (pytest.mark.nightly,)
    return (pytest.mark.deep,) if command not in README or any(words in command for words in LASTING) else ()


@pytest.mark.slow
@pytest.mark.parametrize("command", [pytest.param(one, marks=marks_of(one)) for one in COMMANDS if one not in NEW])
def test_a_command_runs(command: str, folder: Path) -> None:
    if "--plot" in command:
        pytest.importorskip("matplotlib")
    words = shlex.split(command.partition(" > ")[0])
    assert words[0] == "percuss"
    file = words[2] if len(words) > 2 else ""
    if words[1] != "study" and file.endswith((".sqlite", ".nc")) and not (folder / file).exists():
        # what makes it may have run in another process
        made = (f"percuss study cases/studies/{Path(file).stem}.", f"-o {file}")
        maker = next(one for one in COMMANDS if any(words in one for words in made))
        assert percuss_command(*shlex.split(maker)[1:], cwd=folder).returncode == 0
    assert printed(*words[1:], cwd=folder)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [deep(name) if "TEN_MINUTES" in name else name for name, page in PAGES.items() if "```console" in page]
)
def test_a_command_shows_what_the_page_says(name: str, tmp_path: Path) -> None:
    """`python tests/support/pages.py` writes the output anew."""
    if "--plot" in PAGES[name]:
        pytest.importorskip("matplotlib")
    pages.fill(tmp_path)
    assert len(pages.SESSION.findall(PAGES[name])) == PAGES[name].count("```console")
    for command, shown, made in pages.sessions(PAGES[name], tmp_path):
        assert pages.alike(shown, made), f"{command}\n{made}"


@pytest.mark.slow
def test_the_notebook_runs_from_top_to_bottom_and_shows_what_it_stores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`python tests/support/notebook.py` writes the outputs anew."""
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    cells = json.loads(notebook.TOUR.read_text(encoding="utf-8"))
    for cell, made in notebook.outputs(cells):
        assert pages.alike(notebook.stored(cell), made), made


@pytest.mark.parametrize("text", [text if text in README else deep(text) for text in PYTHON], ids=beginning)
def test_a_snippet_runs(text: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if ".table" in text:
        pytest.importorskip("pandas")
    monkeypatch.chdir(folder)
    drawn = ".plot(" in text or "matplotlib" in text
    with pytest.importorskip("matplotlib").rc_context() if drawn else contextlib.nullcontext():
        exec(compile(text, "snippet", "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize(
    "text",
    [text if text in README else deep(text) for text in YAML if beginning(text).startswith("percuss")],
    ids=beginning,
)
def test_what_is_shown_is_a_case_or_a_study_in_an_editor_that_reads_yaml_1_1_too(text: str, folder: Path) -> None:
    data = yaml.safe_load(text)
    named = [file for file in folder.glob("*.py") if file.stem in text]
    jsonschema.validate(data, percuss.schema(study="percuss-study" in data, files=named))
    if "percuss" in data:
        (folder / "shown-case.yaml").write_text(text, encoding="utf-8")
        assert percuss.run(percuss.load(folder / "shown-case.yaml")).summary["steps"] > 100


def run_of(folder: Path, plugin: str, law: object, **changes: object) -> percuss.Result:
    """Run the impact of two bars with a law and a plug-in of a page."""
    case = percuss.load(folder / "cases" / "hunek.yaml", plugins=[folder / plugin])
    return percuss.run(case, {"method.contact": law, **changes})


SPRING = {"name": "penalty", "beta_s": 0.25}


def test_the_laws_shown_do_what_they_say(folder: Path) -> None:
    """Without its dashpot a law is the penalty method."""
    spring = run_of(folder, "damped.py", SPRING)
    for plugin, law in (("damped.py", "spring-and-dashpot"), ("spring.py", "spring")):
        same = run_of(folder, plugin, law)
        assert (same.arrays["contact_force"] == spring.arrays["contact_force"]).all()
        assert same.summary["compiled"] == (os.environ.get("NUMBA_DISABLE_JIT", "0") == "0")


def test_the_integrator_shown_does_what_it_says(folder: Path) -> None:
    """With it a penalty is that of Wu's method with the mass `matched`, and stable however stiff."""
    file, mine = "implicit_contact.py", {"method.integrator": "implicit-contact"}
    force = run_of(folder, file, SPRING, **mine).arrays["contact_force"]
    other = run_of(folder, file, {"name": "bipenalty", "beta_s": 0.25, "ratio": "matched"})
    assert abs(force - other.arrays["contact_force"]).max() < 1e-11 * force.max()
    stiff = run_of(folder, file, {"name": "penalty", "beta_s": 1e4}, **mine, **{"time.courant": 0.99})
    assert stiff.summary["certificate"]["stable"] == "yes"
    assert stiff.summary["energy_growth"]["kept"]


@pytest.mark.deep
def test_the_law_that_remembers_is_crushed_at_its_strength(folder: Path) -> None:
    result = run_of(folder, "crushing.py", "crushing")
    arrays, crushed = result.arrays, result.arrays["contact_state"][:, 0, 0]
    assert arrays["contact_force"].max() == pytest.approx(0.04, rel=1e-12)
    assert (np.diff(crushed) >= 0.0).all()
    assert crushed[-1] > 0.0
    assert arrays["contact_dissipation"][-1] == pytest.approx(0.04 * crushed[-1], rel=1e-12)
    accounted = arrays["contact_dissipation"] + arrays["contact_energy"]
    assert abs(arrays["contact_work"] + accounted).max() < 0.01 * arrays["contact_dissipation"][-1]


@pytest.mark.deep
@pytest.mark.parametrize("name", ["crushing", "newton_impact"])
def test_the_laws_shown_conform_but_where_they_say_so(folder: Path, name: str) -> None:
    printed("verify", "--plugin", f"{name}.py", cwd=folder)


@pytest.mark.deep
def test_the_kit_finds_the_dashpot_of_the_wrong_sign(folder: Path) -> None:
    law = (folder / "damped.py").read_text(encoding="utf-8")
    assert "rate=self.tau" in law
    (folder / "wrong_sign.py").write_text(law.replace("rate=self.tau", "rate=-self.tau"), encoding="utf-8")
    done = percuss_command("verify", "--plugin", "wrong_sign.py", cwd=folder)
    assert done.returncode == 1
    assert "a dashpot of this sign adds energy" in " ".join(done.stdout.split())


@pytest.mark.parametrize(
    ("file", "test"), list(held_against.tests_named()), ids=lambda value: getattr(value, "stem", value)
)
def test_what_a_method_is_held_against_is_there(file: Path, test: str) -> None:
    assert re.search(rf"^def {test}\(", file.read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("name", pages.TABLES)
def test_a_table_says_what_the_code_says(name: str) -> None:
    """`python tests/support/pages.py` writes the tables anew."""
    shown = pages.shown(name)
    assert len(shown.splitlines()) > 2
    assert shown == pages.TABLES[name](Registry.load())


NESTED = {
    "contacts.NAME.wall": specs.RigidWall,
    "contacts.NAME.wall.circle": specs.Ball,
    "contacts.NAME.wall.cylinder": specs.Cylinder,
    "record.probes[]": specs.Spot,
    "bodies.NAME.damping": specs.DampingSpec,
}


@pytest.mark.parametrize("path", NESTED)
def test_the_keys_of_a_mapping_that_may_stand_for_another_value_are_listed_too(path: str) -> None:
    listed = re.findall(r"^\| `(\S+)` ", PAGES["cases/REFERENCE.md"], re.MULTILINE)
    assert {f"{path}.{field.name}" for field in dataclasses.fields(NESTED[path])} <= set(listed)


def test_no_part_that_a_program_writes_is_empty() -> None:
    """Marks without a program, or a program without lines, leave a hole that a page does not show."""
    parts = [
        (f"{name}: {mark}", part)
        for name, page in PAGES.items()
        for mark, part in re.findall(r"^<!-- (.+?) -->\n(.*?)^<!-- end of \1 -->", page, re.MULTILINE | re.DOTALL)
    ]
    assert len(parts) >= len(pages.TABLES)
    assert [mark for mark, part in parts if len(part.split()) < 5] == []


@pytest.mark.skipif(not places.has_source_tree, reason="reads the source tree, and here are the tests alone")
def test_files_named_in_the_pages_are_there() -> None:
    named = {path for page in PAGES.values() for path in re.findall(r"`((?:\w+/)+\w+\.(?:py|yaml|c))`", page)}
    assert len(named) > 20
    roots = (ROOT, ROOT / "framework" / "percuss", ROOT / "tests")
    assert not [path for path in named if not any((root / path).is_file() for root in roots)]


def test_the_first_page_is_short_and_of_the_version_of_today() -> None:
    assert len(README.splitlines()) <= LONGEST
    assert len(README.split()) <= MOST_WORDS
    assert f"This is version {percuss.__version__};" in README
    assert f"version = {{{percuss.__version__}}}" in README
