"""`percuss new`: what it writes runs as it stands, and what it cannot write it refuses whole."""

import ast
import json
import os
import re

import jsonschema
import pytest
import yaml

import percuss
from command_line import percuss_command
from percuss.cli import scaffold
from percuss.errors import InputError
from percuss.methods.registry import Registry
from percuss.results.verify import verify
from percuss.testing import checks
from percuss.testing.kit import outcome_of

KINDS = list(scaffold.KINDS)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a folder with a method of each kind."""
    folder = tmp_path_factory.mktemp("new")
    for kind in KINDS:
        scaffold.new(f"some-{kind}", kind, folder)
    return folder


# These compile a loop or kernels of cells of their own.
LASTING = (
    "shape",
    "integrator",
    "material",
    "solid-material",
    "pairing",
    "element",
    "solid-element",
    "friction",
    "solution",
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.deep) if kind in LASTING else kind for kind in KINDS]
)
def test_a_method_runs_as_its_case_expects(written, kind):
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


@pytest.mark.parametrize("kind", KINDS)
def test_the_files_are_whole(written, kind):
    """A method imports from the door alone, an editor knows its case, and no word of a template is left."""
    tree = ast.parse((written / f"some-{kind}.py").read_text())
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert modules <= {"percuss", "dataclasses", "typing"}
    case = (written / f"some-{kind}.yaml").read_text()
    (schema,) = re.findall(r"^# yaml-language-server: \$schema=(\S+)$", case, re.MULTILINE)
    jsonschema.Draft202012Validator(json.loads((written / schema).read_text())).validate(yaml.safe_load(case))
    for file in written.glob(f"some-{kind}.*"):
        text = file.read_text()
        assert not re.findall(r"my[-_]?method|@[A-Z]+@", text, flags=re.IGNORECASE), file
        assert file.suffix != ".py" or max(map(len, text.splitlines())) <= 120


def test_a_name_that_is_used_already_is_told_apart(tmp_path):
    names = {"linear-law": "LinearLawMethod", "spring_2": "Spring2", "none-": "NoneMethod", "penalty": "Penalty"}
    for name, cls in names.items():
        kind = "load" if name == "penalty" else "contact"  # two families may share a name
        made = scaffold.new(name, kind, tmp_path)
        assert made.component == cls
        assert Registry.load([made.files[0]]).get(f"{kind}s", name).__name__ == cls


@pytest.mark.parametrize(
    ("name", "kind", "said"),
    [
        ("mine", "contakt", "Did you mean 'contact'?"),
        ("penalty", "contact", "contacts 'penalty' is registered by percuss"),
        ("1st", "contact", "Start with a letter"),
        ("../law", "contact", "Start with a letter"),
        ("true", "contact", "a word of YAML, as true, is no name"),
        ("file", "contact", "file.py: this exists already"),
    ],
)
def test_what_cannot_be_written_is_one_clear_message(tmp_path, name, kind, said):
    (tmp_path / "file.py").write_text("precious")
    with pytest.raises(InputError, match=re.escape(said)) as refused:
        scaffold.new(name, kind, tmp_path)
    assert len(refused.value.problems) == 1
    assert [one.name for one in tmp_path.iterdir()] == ["file.py"]
    assert (tmp_path / "file.py").read_text() == "precious"


def test_the_next_commands_are_told_and_work(tmp_path):
    (tmp_path / "sub").mkdir()
    done = percuss_command("new", "mine", "--kind", "mass", "-o", "sub", cwd=tmp_path)
    told = [line.strip() for line in done.stdout.splitlines() if line[0] == " "]
    files = [f"sub{os.sep}mine.{ending}" for ending in ("py", "yaml", "schema.json")]
    assert told == [*files, f"percuss run {files[1]}", f"percuss verify --plugin {files[0]}"]
    assert percuss_command("run", files[1], cwd=tmp_path).returncode == 0
    told = json.loads(percuss_command("new", "rise", "--kind", "measure", "--json", cwd=tmp_path).stdout)
    assert (told["name"], told["kind"], told["family"], told["component"]) == ("rise", "measure", "measures", "Rise")
    assert all((tmp_path / file).is_file() for file in told["files"])
    assert told["next"] == ["percuss study rise.study.yaml", "percuss verify --plugin rise.py"]
