"""Where things stand and who may know whom: rules that no tool checks otherwise."""

import ast
import functools
import importlib
import inspect
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import percuss
import percuss_methods
import places
from percuss.case.options import options_of
from percuss.methods.interfaces import FAMILIES, Component
from percuss.methods.registry import Registry

ROOT = places.ROOT
FRAMEWORK = Path(percuss.__file__).parent
PLUGINS = Path(percuss_methods.__file__).parent

if not places.has_source_tree:
    pytest.skip("these tests read the source tree, and here are the tests alone", allow_module_level=True)

TOP_LEVEL = {"pyproject.toml", "framework", "plugins", "cases", "tests", "README.md", "LICENSE"}
DOOR = {"percuss", "percuss.testing"}


def python_files(folder):
    return sorted(path for path in folder.rglob("*.py") if "__pycache__" not in path.parts)


def name_of(path):
    root = FRAMEWORK if path.is_relative_to(FRAMEWORK) else PLUGINS
    return path.relative_to(root.parent).as_posix()


@functools.cache
def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def imported(path):
    return tuple(found_imports(path))


def found_imports(path):
    """The modules that a file imports, with their lines: also inside functions, under TYPE_CHECKING, by importlib."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}:{node.lineno}: relative import; write the full name"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                of_a_module = inner in MODULES or node.module in {"percuss", "percuss_methods"}
                yield inner if of_a_module else node.module, node.lineno
        elif isinstance(node, ast.Call) and "import" in ast.unparse(node.func):
            names = (argument.value for argument in node.args if isinstance(argument, ast.Constant))
            yield from ((name, node.lineno) for name in names if isinstance(name, str))


FRAMEWORK_FILES = python_files(FRAMEWORK)
PLUGIN_FILES = python_files(PLUGINS)
METHOD_FILES = [path for path in PLUGIN_FILES if path.parent != PLUGINS and not path.name.startswith("_")]


# ---------------------------------------------------------------------------------------------------- rooms

ROOMS = (
    *("methods", "case", "mesh", "contact", "step", "march"),
    *("certificate", "results", "studies", "reporting", "testing", "cli"),
)
GROUND = {
    *("blas", "cache", "digest", "errors", "files", "interrupt", "jit", "jsonable", "process"),
    *("record_arrays", "threads", "version"),
}
DOORS = {"percuss", "percuss.__main__"}
# a result shows its picture in a notebook
DECLARED = {("percuss.results.result", "percuss.reporting.run_figure")}
NOT_THERE = {"percuss.laws"}  # a name that a test asks for in vain


def module_of(path):
    name = ".".join(path.relative_to(FRAMEWORK.parent).with_suffix("").parts)
    return name.removesuffix(".__init__")


MODULES = {module_of(path): path for path in FRAMEWORK_FILES}


def room_of(module):
    """The number of a module's room, 0 of the ground."""
    room = module.split(".")[1]
    return 0 if room in GROUND else 1 + ROOMS.index(room)


def arrows():
    """Every import between two modules of the framework: from, to, place."""
    for module, path in MODULES.items():
        for name, line in dict.fromkeys(imported(path)):
            if name in MODULES and name != module:
                yield module, name, f"{name_of(path)}:{line}"


def test_every_module_lies_in_a_room_or_on_the_ground():
    top = {module.split(".")[1] for module in MODULES if module not in DOORS}
    assert top == GROUND | set(ROOMS)


def test_imports_go_down_only():
    """Also inside functions and under TYPE_CHECKING."""
    for here, there, place in arrows():
        down = bool({here, there} & DOORS) or room_of(here) >= room_of(there) or (here, there) in DECLARED
        assert down, f"{place}: {here} imports {there}"
        of_the_kit = here.startswith(("percuss.testing", "percuss.cli"))
        assert of_the_kit or not there.startswith("percuss.testing"), f"{place}: only the command line knows the kit"


def test_no_import_circle():
    graph = {module: set() for module in MODULES}
    for here, there, _ in arrows():
        if (here, there) not in DECLARED and there not in DOORS:
            graph[here].add(there)
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as circle:
        pytest.fail(" -> ".join(circle.args[1]))


def test_names_of_modules_in_text_resolve():
    """A dotted name in a string, a docstring, a comment or a page names something that is there."""
    name = re.compile(r"\bpercuss((?:\.[a-z_]\w*)+(?:\.[A-Z]\w*)*)")
    pages = [path for path in places.project_files() if path.suffix in {".md", ".toml", ".txt"}]
    files = [*FRAMEWORK_FILES, *PLUGIN_FILES, *python_files(ROOT / "tests"), *pages]
    for path in files:
        for found in {match[1] for match in name.finditer(path.read_text(encoding="utf-8"))}:
            there = f"percuss{found}" in DOORS | NOT_THERE or resolves(found[1:].split("."))
            assert there, f"{path.relative_to(ROOT)}: percuss{found}"


def resolves(parts):
    thing, name = percuss, "percuss"
    for part in parts:
        name = f"{name}.{part}"
        module = name in MODULES and name not in DOORS
        thing = importlib.import_module(name) if module else getattr(thing, part, None)
        if thing is None:
            return False
    return True


# Where a method may be named: the defaults of a case, and the name of a tied twin in a table.
MAY_NAME_METHODS = {"percuss.case.defaults": None, "percuss.studies.tasks": {"TIED"}}
# Names of methods and options that are words of the framework too.
COMMON = {
    *(
        "alpha",
        "beta",
        "columns",
        "constant",
        "damping",
        "direction",
        "during",
        "elastic",
        "elements",
        "file",
        "frequency",
    ),
    *("gamma", "initial", "length", "mean", "order", "p", "peak", "pressure", "ramp", "scale", "stiffness", "table"),
    *("mesh", "part", "size", "theta", "time", "value", "none"),
}
VALUES_OF_ONE_OPTION = {"from-step", "matched"}


def constants_outside(tree, exempt):
    """Yield the string constants of a module, but for docstrings and the values of the exempted global names."""
    exempted = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        or (isinstance(node, ast.Assign) and any(getattr(name, "id", None) in exempt for name in node.targets))
        for inner in ([node.value] if isinstance(node, ast.Expr) else ast.walk(node))
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in exempted:
            yield node


def test_framework_knows_no_method_by_its_name():
    """No name of a method, of an option, or of an option in a dotted path, is a string of the framework.

    The kit, which draws bars of its own, is not asked.
    """
    registry = Registry.load()
    names = {name for family in FAMILIES for name in registry.names(family)} | VALUES_OF_ONE_OPTION
    names |= {option for component in registry.components.values() for option in options_of(component)}
    names -= COMMON
    for module, path in MODULES.items():
        exempt = MAY_NAME_METHODS.get(module, set())
        if exempt is not None and not module.startswith("percuss.testing"):
            for node in constants_outside(parsed(path), exempt):
                assert not names & {node.value, *node.value.split(".")}, f"{name_of(path)}:{node.lineno}"


def test_framework_knows_no_method_and_plugins_only_the_door():
    allowed = {f"percuss.{name}" for name in percuss.__all__} | DOOR
    for files, package in ((FRAMEWORK_FILES, "percuss_methods"), (PLUGIN_FILES, "percuss")):
        found = {f"{name_of(path)}: {name}": name for path in files for name, _ in imported(path)}
        assert not [at for at, name in found.items() if name.partition(".")[0] == package and name not in allowed]


# ---------------------------------------------------------------------------------------------- inside numba

PUBLIC_OF_NUMBA = {"numba", "numba.types", "numba.extending", "llvmlite", "llvmlite.ir", "llvmlite.binding"}
# Attributes of what numba hands out, which its manual does not have.
INSIDE_NUMBA = {"fndesc", "library", "overloads", "targetctx", "target_context", "targetdescr", "typingctx"}


def names_of(tree):
    """Yield line and text of each import, of each text of one word, and of each attribute in a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.lineno, node.module
            yield from ((node.lineno, f"{node.module}.{one.name}") for one in node.names if one.name.startswith("_"))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and " " not in node.value:
            yield node.lineno, node.value
        elif isinstance(node, ast.Attribute):
            yield node.lineno, f".{node.attr}"


def test_nothing_is_taken_from_inside_numba():
    """Four options that its manual does not have stand in one place."""
    from percuss.jit import UNDOCUMENTED

    wrong = []
    for path in [*FRAMEWORK_FILES, *PLUGIN_FILES]:
        for line, name in names_of(parsed(path)):
            inside = name.partition(".")[0] in {"numba", "llvmlite"} and name not in PUBLIC_OF_NUMBA
            option = name in UNDOCUMENTED and path != MODULES["percuss.jit"]
            if inside or option or name[1:] in INSIDE_NUMBA:
                wrong.append(f"{name_of(path)}:{line}: {name}")
    assert not wrong, "\n".join(wrong)


# ------------------------------------------------------------------------------------------ one method a file


def test_a_method_file_holds_one_registered_method_named_after_it_and_explains_itself():
    assert {path.parent.name for path in METHOD_FILES} == set(FAMILIES)
    assert {path.parent.parent for path in METHOD_FILES} == {PLUGINS}
    for path in METHOD_FILES:
        module = importlib.import_module(f"percuss_methods.{path.parent.name}.{path.stem}")
        components = [one for one in vars(module).values() if inspect.isclass(one) and issubclass(one, Component)]
        (method,) = [one for one in components if one.__module__ == module.__name__]
        assert (method.family, method.name.replace("-", "_")) == (path.parent.name, path.stem)
        assert Registry.load().get(method.family, method.name) is method
        assert module.__doc__, "the file has no docstring"
        assert vars(method)["__doc__"], "the method has no docstring"
        assert method.references or method.family not in {"integrators", "contacts"}


# ----------------------------------------------------------------------------------------------- the project


def test_the_top_level_is_what_it_should_be():
    top = {path.relative_to(ROOT).parts[0] for path in places.project_files(tracked=True)}
    assert {name for name in top if not name.startswith(".")} <= TOP_LEVEL
    assert not {name for name in TOP_LEVEL if not (ROOT / name).exists()}


def test_no_file_knows_a_place_on_somebodys_machine():
    private = re.compile(r"(?<![\w.~])/(?:work|home|root|Users|tmp/venv)/\w")
    files = places.project_files()
    assert not [path for path in files if private.search(path.read_bytes().decode("utf-8", errors="ignore"))]
