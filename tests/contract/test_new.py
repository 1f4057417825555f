"""`percuss new`: what it writes runs as it stands, and what it cannot write it refuses whole."""

import ast
import json
import os
import re
import tomllib
from pathlib import Path

import jsonschema
import pytest
import yaml

import percuss
from command_line import percuss_command
from percuss.cli import scaffold
from percuss.errors import InputError
from percuss.methods.interfaces import FAMILIES
from percuss.methods.registry import Registry
from percuss.results.verify import verify
from percuss.testing import checks
from percuss.testing.kit import outcome_of

KINDS = list(scaffold.KINDS)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a folder with a package and a single-file plug-in of each kind."""
    folder = tmp_path_factory.mktemp("new")
    for kind in KINDS:
        scaffold.new(f"some-{kind}", kind, folder)
        scaffold.new(f"some-{kind}", kind, folder, single_file=True)
    return folder


def body(path):
    """Return the lines of the first class of a file that are neither facts nor docstrings."""
    tree = ast.parse(path.read_text())
    cls = next(
        node for node in tree.body if isinstance(node, ast.ClassDef) and not ast.unparse(node).count("NamedTuple")
    )
    for node in ast.walk(cls):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and ast.get_docstring(node):
            del node.body[0]
    cls.body = [node for node in cls.body if not isinstance(node, ast.Assign)]
    lines = ast.unparse(cls).splitlines()[2:]  # behind the decorator and the head
    return [line for line in lines if line.strip() and not line.strip().startswith("@")]


# ---------------------------------------------------------------------------------------- what it writes runs


def test_every_family_has_its_kind():
    assert list(dict.fromkeys(scaffold.KINDS.values())) == list(FAMILIES)


# These compile a loop or kernels of cells of their own.
LASTING = ("integrator", "material", "solid-material", "pairing", "element", "solid-element")


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.deep) if kind in LASTING else kind for kind in KINDS]
)
def test_a_single_file_runs_as_its_case_expects(written, kind):
    case = percuss.load(written / f"some-{kind}.yaml")
    cls = case.registry.get(scaffold.KINDS[kind], f"some-{kind}")
    assert cls.contract_version == percuss.CONTRACT
    assert cls.__name__ == f"Some{kind.title().replace('-', '')}"
    assert "Formula:" in cls.__doc__
    result = percuss.run(case)
    assert result.status == "done"
    assert result.summary["compiled"] == (os.environ.get("NUMBA_DISABLE_JIT", "0") == "0")
    checks = verify(case, result)
    assert checks
    assert all(check.passed for check in checks), [check.as_dict() for check in checks]
    used = json.dumps(result.provenance["case"]) + str(result.summary["exact"])
    assert f"some-{kind}" in used.replace(f"some-{kind}.py", "") or kind == "measure"


@pytest.mark.deep
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in {"contact", "integrator"}])
def test_a_method_conforms(written, kind):
    """Those that come in pairs are held against the kit in test_third_party, as packages."""
    registry = Registry.load([written / f"some-{kind}.py"])
    method = registry.get(scaffold.KINDS[kind], f"some-{kind}")
    outcomes = [outcome_of(check) for _, check in checks(method, registry=registry)]
    assert not [str(one) for one in outcomes if one.status == "failed"]


def test_a_measure_is_used_by_a_study(written):
    study = percuss.study(written / "some-measure.study.yaml", written / "rows.sqlite", workers=1)
    assert list(study.columns) == ["some-measure", "node_steps", "seconds"]  # what each run costs stands in every row
    assert all(abs(row["some-measure"] - 0.2) < 0.01 for row in study.as_records())


@pytest.mark.parametrize("kind", KINDS)
def test_a_package_is_the_same_method(written, kind):
    module, folder = f"some_{kind.replace('-', '_')}", written / f"some-{kind}"
    files = {f"{module}.py", f"tests/test_{module}.py", "case.yaml", "pyproject.toml", "README.md"}
    files |= {f"some-{kind}.schema.json"}
    files |= {"study.yaml"} if kind == "measure" else set()
    assert {file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()} == files
    code = (folder / f"{module}.py").read_text()
    assert code == (written / f"some-{kind}.py").read_text()
    project = tomllib.loads((folder / "pyproject.toml").read_text())
    assert project["project"]["name"] == f"some-{kind}"
    assert project["project"]["dependencies"] == [f"percuss>={percuss.__version__}"]
    assert project["project"]["entry-points"]["percuss"] == {f"some-{kind}": module}
    assert "percuss[kit]" in project["project"]["optional-dependencies"]["test"]
    assert project["tool"]["hatch"]["build"]["targets"]["wheel"]["only-include"] == [f"{module}.py"]
    single = (written / f"some-{kind}.yaml").read_text().replace(f"plugins: [some-{kind}.py]\n", "")
    assert (folder / "case.yaml").read_text() == single
    (schema,) = re.findall(r"^# yaml-language-server: \$schema=(\S+)$", single, re.MULTILINE)
    editor = jsonschema.Draft202012Validator(json.loads((folder / schema).read_text()))
    editor.validate(yaml.safe_load(single))
    test = (folder / "tests" / f"test_{module}.py").read_text()
    assert f"@parametrize(Some{kind.title().replace('-', '')})\ndef test_conformance(check):\n    check()" in test
    for file in folder.rglob("*.*"):
        text = file.read_text()
        assert not re.findall(r"my[-_]?method|@[A-Z]+@", text, flags=re.IGNORECASE), file
        assert max(map(len, text.splitlines())) <= (120 if file.suffix == ".py" else 400)


@pytest.mark.parametrize("kind", KINDS)
def test_a_method_imports_from_the_door_alone(written, kind):
    tree = ast.parse((written / f"some-{kind}.py").read_text())
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert modules <= {"percuss", "dataclasses", "typing"}


@pytest.mark.parametrize(
    ("kind", "most"), [("contact", 5), ("load", 6), ("integrator", 10), ("mass", 5), ("shape", 15)]
)
def test_a_method_is_short(written, kind, most):
    assert len(body(written / f"some-{kind}.py")) <= most


def test_a_name_that_the_code_has_already_is_told_apart(tmp_path):
    for name, cls in [("linear-law", "LinearLawMethod"), ("contact-law", "ContactLawMethod"), ("spring_2", "Spring2")]:
        made = scaffold.new(name, "contact", tmp_path, single_file=True)
        assert made.component == cls
        assert Registry.load([made.files[0]]).get("contacts", name).__name__ == cls


# -------------------------------------------------------------------------------------------- what it refuses


REFUSED = {
    "kind": (["mine", "--kind", "contakt"], "Did you mean 'contact'?"),
    "family for kind": (["mine", "--kind", "contacts"], "Did you mean 'contact'?"),
    "taken": (["penalty", "--kind", "contact"], "contacts 'penalty' is registered by percuss"),
    "digit first": (["1st", "--kind", "contact"], "Start with a letter"),
    "space": (["my law", "--kind", "contact"], "Start with a letter"),
    "dash at the end": (["law-", "--kind", "contact"], "end with a letter or a digit"),
    "path": (["../law", "--kind", "contact"], "Start with a letter"),
    "Python": (["lambda", "--kind", "contact"], "a word of Python"),
    "YAML": (["true", "--kind", "contact"], "a word of YAML"),
    "module": (["numpy", "--kind", "contact"], "there is a module 'numpy' already"),
    "module of Python": (["statistics", "--kind", "contact"], "there is a module 'statistics' already"),
    "no folder": (["mine", "--kind", "contact", "-o", "nowhere"], "expected a folder that exists"),
    "folder": (["there", "--kind", "contact"], "this exists already"),
    "file": (["file", "--kind", "contact", "--single-file"], "file.py: this exists already"),
}


PACKAGES_ONLY = {"module", "module of Python", "folder"}  # a single file is no module, and no folder


@pytest.mark.parametrize(
    ("case", "single"), [(case, single) for case in REFUSED for single in (False, True)[: 2 - (case in PACKAGES_ONLY)]]
)
def test_what_cannot_be_written_is_one_clear_message(tmp_path, case, single):
    args, said = REFUSED[case]
    (tmp_path / "there").mkdir()
    (tmp_path / "file.py").write_text("precious")
    done = percuss_command("new", *args, *(["--single-file"] if single and case != "file" else []), cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert "1 mistake; nothing" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""
    assert sorted(one.name for one in tmp_path.iterdir()) == ["file.py", "there"]
    assert (tmp_path / "file.py").read_text() == "precious"


def test_every_mistake_is_said_at_once(tmp_path):
    done = percuss_command("new", "1st", "--kind", "contakt", "-o", "nowhere", "--json", cwd=tmp_path)
    assert done.returncode == 2
    assert [one["place"] for one in json.loads(done.stdout)["problems"]] == ["--kind contakt", "1st", "nowhere"]


@pytest.mark.parametrize("single", [False, True])
def test_what_fails_half_way_leaves_nothing(tmp_path, monkeypatch, single):
    rename, done = Path.rename, []

    def fails(self, target):
        if done or not single:
            raise OSError(28, "No space left on device")
        done.append(target)
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fails)
    with pytest.raises(InputError, match="No space left"):
        scaffold.new("mine", "contact", tmp_path, single_file=single)
    assert list(tmp_path.iterdir()) == []


def test_two_families_may_share_a_name(tmp_path):
    made = scaffold.new("penalty", "load", tmp_path, single_file=True)
    assert ("loads", "penalty") in Registry.load([made.files[0]]).components


# ---------------------------------------------------------------------------------------------- what it tells


def test_the_next_commands_are_told_and_work(tmp_path):
    done = percuss_command("new", "mine", "--kind", "mass", "--single-file", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [line for line in done.stdout.splitlines() if line.startswith("  ")] == [
        "  mine.py",
        "  mine.yaml",
        "  mine.schema.json",
        "  percuss run mine.yaml",
        "  percuss verify --plugin mine.py",
    ]
    assert percuss_command("run", "mine.yaml", cwd=tmp_path).returncode == 0


def test_json_says_the_same(tmp_path):
    (tmp_path / "sub").mkdir()
    done = percuss_command("new", "mine", "--kind", "measure", "-o", "sub", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["name"], told["kind"], told["family"], told["component"]) == ("mine", "measure", "measures", "Mine")
    assert all((tmp_path / file).is_file() for file in told["files"])
    assert told["next"] == [f"cd sub{os.sep}mine", "pip install -e '.[test]'", "percuss study study.yaml", "pytest"]
