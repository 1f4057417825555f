"""Where things stand and who may know whom: rules that no tool checks otherwise."""

import ast
import importlib
import inspect
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import percuss
import percuss_methods
from percuss.methods.interfaces import FAMILIES, Component
from percuss.methods.registry import Registry

ROOT = Path(__file__).resolve().parent.parent
FRAMEWORK = Path(percuss.__file__).parent
PLUGINS = Path(percuss_methods.__file__).parent

TOP_LEVEL = {"pyproject.toml", "framework", "plugins", "cases", "tests", "README.md", "LICENSE"}
DROPPINGS = {"build", "dist", "__pycache__", "PKG-INFO"}
DOOR = {"percuss", "percuss.testing"}
LONGEST_HOOKSPECS = 54


def python_files(folder):
    return sorted(path for path in folder.rglob("*.py") if "__pycache__" not in path.parts)


def name_of(path):
    root = FRAMEWORK if path.is_relative_to(FRAMEWORK) else PLUGINS
    return path.relative_to(root.parent).as_posix()


def project_files():
    """The files that belong to the project: git's, else all but what building and testing leave."""
    git = shutil.which("git")
    if git and (ROOT / ".git").exists():
        command = [git, "-C", str(ROOT), "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
        listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")
        return [ROOT / name for name in listed if name and (ROOT / name).is_file()]
    return [path for path in ROOT.rglob("*") if path.is_file() and not is_dropping(path.relative_to(ROOT))]


def is_dropping(path):
    """Whether a file is what building, testing or the commands of the README leave behind."""
    made = path.suffix in {".png", ".svg", ".pdf", ".nc", ".html", ".csv", ".sqlite"} and len(path.parts) == 1
    return (
        made or bool(DROPPINGS & set(path.parts)) or any(p.startswith(".venv") or "egg-info" in p for p in path.parts)
    )


def imported(path):
    """The modules that a file imports, also inside functions and under TYPE_CHECKING, and by importlib."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}:{node.lineno}: relative import; write the full name"
            yield node.module
            if node.module in {"percuss", "percuss_methods"}:
                yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and "import" in ast.unparse(node.func):
            yield from (one.value for one in node.args if isinstance(one, ast.Constant) and isinstance(one.value, str))


def lines(path):
    return len(path.read_text(encoding="utf-8").splitlines())


FRAMEWORK_FILES = python_files(FRAMEWORK)
PLUGIN_FILES = python_files(PLUGINS)
METHOD_FILES = [path for path in PLUGIN_FILES if path.parent != PLUGINS and not path.name.startswith("_")]


# ------------------------------------------------------------------------------------------- who knows whom


@pytest.mark.parametrize("path", FRAMEWORK_FILES, ids=name_of)
def test_framework_knows_no_method(path):
    assert not [name for name in imported(path) if name.partition(".")[0] == "percuss_methods"]


@pytest.mark.parametrize("path", PLUGIN_FILES, ids=name_of)
def test_plugins_know_only_the_door_of_framework(path):
    used = {name for name in imported(path) if name.partition(".")[0] == "percuss"}
    public = {f"percuss.{name}" for name in vars(percuss).get("__all__", ())}
    assert used <= DOOR | public, f"{name_of(path)} reaches behind the contracts"


def test_import_percuss_loads_no_plugin_and_nothing_heavy():
    heavy = [
        "percuss_methods",
        "numba",
        "pydantic",
        "matplotlib",
        "xarray",
        "netCDF4",
        "scipy",
        "typer",
        "rich",
    ]
    code = f"import sys, percuss; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# ------------------------------------------------------------------------------------------ one method a file


def test_plugins_have_a_folder_a_family():
    folders = {path.parent.name for path in METHOD_FILES}
    assert folders == set(FAMILIES)
    assert {path.parent.parent for path in METHOD_FILES} == {PLUGINS}


@pytest.mark.parametrize("path", METHOD_FILES, ids=name_of)
def test_a_method_file_holds_one_registered_method_named_after_it(path):
    family = path.parent.name
    module = importlib.import_module(f"percuss_methods.{family}.{path.stem}")
    own = [
        one
        for one in vars(module).values()
        if inspect.isclass(one) and issubclass(one, Component) and one.__module__ == module.__name__
    ]
    assert len(own) == 1, [one.__name__ for one in own]
    (method,) = own
    assert method.family == family
    assert path.stem == method.name.replace("-", "_")
    assert Registry.load().get(family, method.name) is method, "percuss_methods/__init__.py does not list it"


@pytest.mark.parametrize("path", METHOD_FILES, ids=name_of)
def test_a_method_file_explains_itself(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert ast.get_docstring(tree), "the file has no docstring"
    documented = [node for node in tree.body if isinstance(node, ast.ClassDef) and ast.get_docstring(node)]
    assert documented, "the method has no docstring"
    if path.parent.name in {"integrators", "contacts"}:
        method = Registry.load().get(path.parent.name, path.stem.replace("_", "-"))
        assert method.references, "an integrator or a contact law names its source"
        assert all(reference.strip() for reference in method.references)


# ----------------------------------------------------------------------------------------------------- hooks


def test_the_hooks_fit_a_page():
    path = FRAMEWORK / "methods" / "hookspecs.py"
    tree = ast.parse(path.read_text(encoding="utf-8"))
    hooks = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    assert len(hooks) == len(FAMILIES)
    assert all(not ast.unparse(hook.args) and ast.get_docstring(hook) for hook in hooks)
    assert lines(path) <= LONGEST_HOOKSPECS


# ----------------------------------------------------------------------------------------------- the project


def test_the_top_level_is_what_it_should_be():
    top = {path.relative_to(ROOT).parts[0] for path in project_files()}
    assert {name for name in top if not name.startswith(".")} <= TOP_LEVEL
    assert not {name for name in TOP_LEVEL if not (ROOT / name).exists()}


def test_no_file_knows_a_place_on_somebodys_machine():
    private = re.compile(r"(?<![\w.~])/(?:work|home|root|Users|tmp/venv)/\w")
    found = []
    for path in project_files():
        text = path.read_bytes().decode("utf-8", errors="ignore")
        found += [
            f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
            for number, line in enumerate(text.splitlines(), 1)
            if private.search(line)
        ]
    assert not found, "\n".join(found)
