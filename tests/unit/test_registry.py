"""Plug-ins: what is gathered, what is left out and why; a broken one costs itself alone and is told with its line."""

import importlib.metadata
import inspect
import os
import pickle
import re
import subprocess
import sys
import traceback

import pytest

import percuss
from percuss.errors import PluginError
from percuss.methods import admission
from percuss.methods.interfaces import FAMILIES
from percuss.methods.provenance import Broken, Provenance, display_path
from percuss.methods.registry import Registry

IMPORTS = """\
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw, Load, Shape, hookimpl

"""


def law(cls="MyLaw", name="my-law"):
    return f'''
@dataclass(frozen=True)
class {cls}(ContactLaw):
    """A law."""

    name = "{name}"
    summary = "A law"

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0)

'''


def hook(body="return [MyLaw]", name="percuss_contacts"):
    return f"\n@hookimpl\ndef {name}():\n    {body}\n"


def line_of(text, part):
    return text[: text.index(part)].count("\n") + 1


LAWS = IMPORTS + law() + hook()
ABSTRACT = '@dataclass(frozen=True)\nclass Bad({base}):\n    """Law."""\n    name = "bad"\n    summary = "bad"\n'
LOAD = ABSTRACT.format(base="Load") + "    def amplitude(self, time):\n        return time\n"


@pytest.fixture(autouse=True)
def _modules_as_before():
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if name.partition(".")[0].startswith(("fake_", "percuss_file_")):
            del sys.modules[name]


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Install a throw-away distribution and return its folder; `files` are texts by path, or one text."""

    def do(name, files, *, version="1.0", points=None):
        site, module = tmp_path / f"site-{name}-{version}", name.replace("-", "_")
        info = site / f"{module}-{version}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        (info / "entry_points.txt").write_text(f"[percuss]\n{points or f'laws = {module}'}\n")
        for file, text in ({f"{module}.py": files} if isinstance(files, str) else files).items():
            (site / file).parent.mkdir(parents=True, exist_ok=True)
            (site / file).write_text(text)
        monkeypatch.syspath_prepend(site)
        return site

    return do


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a single-file plug-in into the working directory."""
    monkeypatch.chdir(tmp_path)

    def do(text, name="my_law.py"):
        (tmp_path / name).write_text(text)
        return name

    return do


def refusal(*files):
    with pytest.raises(PluginError) as raised:
        Registry.load(files)
    return str(raised.value)


# ------------------------------------------------------------------------------------------------ what is gathered


def test_built_in_methods_come_by_the_common_door_and_say_where_they_are_from():
    registry = Registry.load()
    assert registry.broken == ()
    assert not registry.clashes
    assert all(registry.names(family) for family in FAMILIES)
    assert set(registry.sources) == set(registry.components)
    for (family, name), source in registry.sources.items():
        component = registry.get(family, name)
        assert issubclass(component, FAMILIES[family])
        file = inspect.getsourcefile(component)
        assert source == Provenance("percuss", importlib.metadata.version("percuss"), component.__module__, file)


def test_a_package_without_hooks_registers_what_its_modules_define(install):
    """As the built-in methods: a new method is one file. A module that fails costs only itself."""
    files = {f"fake_pack/{name}": "" for name in ("__init__.py", "laws/__init__.py")}
    files |= {
        "fake_pack/laws/mine.py": IMPORTS + law(),
        "fake_pack/laws/bad.py": "\nraise RuntimeError('no licence')\n",
    }
    site = install("fake-pack", files)
    assert Registry.load() is Registry.load()
    registry = Registry.load()
    assert registry.get("contacts", "my-law").__module__ == "fake_pack.laws.mine"
    place = f"{site / 'fake_pack' / 'laws' / 'bad.py'}:2"
    assert registry.broken == (Broken("fake-pack 1.0", "module fake_pack.laws.bad: RuntimeError: no licence", place),)


# ------------------------------------------------------------------------------------------- what is broken, and where

WRONG = {
    # what a plug-in says beside its valid law, what is said of it, the text that stands at the place
    "does not import": ("x = 1\nx / 0\n", "ZeroDivisionError: division by zero", "x / 0"),
    "a name near": (
        "from percuss import LinearLew",
        "ImportError: percuss {version} has no 'LinearLew' in percuss; did you mean 'LinearLaw'?",
        "from percuss import LinearLew",
    ),
    "no such module": (
        "import percuss.laws",
        "ModuleNotFoundError: percuss {version} has no module 'percuss.laws'; "
        "a plug-in imports only from percuss and percuss.testing", "import percuss.laws",
    ),
    "wrong family": (
        hook("return [MyLaw]", "percuss_loads"),
        "percuss_loads: MyLaw is one of contacts; return it from percuss_contacts", "@dataclass",
    ),
    "abstract": (
        ABSTRACT.format(base="Shape") + hook("return [Bad]", "percuss_shapes"),
        "percuss_shapes: Bad is still abstract; it lacks `dimension`, `mesh`", "@dataclass(frozen=True)\nclass Bad",
    ),
    "unknown hook": (
        "@hookimpl\ndef percuss_load():\n    return []\n",
        "percuss_load: no such hook; did you mean percuss_loads?", "@hookimpl\ndef percuss_load()",
    ),
    "of a later contract": (
        ABSTRACT.format(base="Load") + "    contract_version = 6\n" + hook("return [Bad]", "percuss_loads"),
        "percuss_loads: Bad is written for contract 6, this percuss has contract 1: upgrade percuss",
        "@dataclass(frozen=True)\nclass Bad",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_mistake_in_a_distribution_costs_only_itself_and_in_a_file_is_raised(install, write, case):
    beside, said, where = WRONG[case]
    said = said.format(version=f"{percuss.__version__} (contract {percuss.CONTRACT})")
    text = LAWS + beside
    line = line_of(text, where)
    site = install("fake-bad", text)
    install("fake-laws", IMPORTS + law("Other", "other") + hook("return [Other]"))
    registry = Registry.load()
    (broken,) = registry.broken
    assert broken.source == "fake-bad 1.0"
    assert broken.error.removeprefix("entry point 'laws = fake_bad': ") == said
    assert broken.file == f"{site / 'fake_bad.py'}:{line}"
    assert {"other", "penalty"} <= set(registry.names("contacts"))
    assert "bad" not in registry.names("loads")
    assert str(broken).startswith("fake-bad 1.0: ")
    assert refusal(write(text.replace("my-law", "of-a-file"))) == f"my_law.py:{line}: {said}"


def test_a_distribution_or_file_that_registers_nothing_is_named(install, write):
    install("fake-laws", IMPORTS)
    (broken,) = Registry.load().broken
    said = "registers nothing: it has no hook and no finished component"
    assert broken.error == f"entry point 'laws = fake_laws': {said}"
    assert refusal(write("from percuss_methods.contacts.penalty import Penalty\n")) == f"my_law.py: {said}"


def test_a_contract_before_the_first_release_is_taken_as_the_first_with_one_note(install, capsys):
    admission._note_on_unreleased_contracts.cache_clear()
    install("fake-laws", LAWS.replace('"my-law"\n', '"my-law"\n    contract_version = 5\n'))
    assert Registry.load().broken == ()
    assert capsys.readouterr().err.count("are taken as contract 1") == 1


# -------------------------------------------------------------------------------------------------------- duplicates


def test_a_name_that_two_distributions_register_is_not_used(install, write):
    install("fake-a", IMPORTS + law() + law("Other", "other") + hook("return [MyLaw, Other]"))
    site = install("fake-b", LAWS, version="2.0")
    registry, by = Registry.load(), "contacts 'my-law' is registered by fake-a 1.0 (fake_a) and by fake-b 2.0 (fake_b)"
    message = f"{by}; none is used: have one renamed, or uninstall it"
    assert Broken("fake-a 1.0 and fake-b 2.0", message, str(site / "fake_b.py")) in registry.broken
    assert {"other", "bipenalty"} <= set(registry.names("contacts"))
    assert "my-law" not in registry.names("contacts")
    with pytest.raises(PluginError, match=re.escape(message)):
        registry.get("contacts", "my-law")
    assert f"{by} already" in refusal(write(IMPORTS + law()))


def test_a_file_that_takes_a_name_of_another_is_refused(write):
    text = IMPORTS + law(name="penalty")
    said = refusal(write(text))
    assert said.startswith(f"my_law.py:{line_of(text, '@data')}: contacts 'penalty' is registered by percuss ")
    assert said.endswith("(percuss_methods.contacts.penalty) already: give this one another `name`")


# ------------------------------------------------------------------------------------------------------ single files


def test_a_file_registers_what_it_defines(write, tmp_path):
    text = (
        IMPORTS
        + "from percuss_methods.contacts.penalty import Penalty\n"
        + 'class Base(Load, contract="loads"):\n    """A contract of one\'s own."""\n'
        + law()
        + LOAD.replace("(Load)", "(Base)")
        + "Alias = MyLaw\n"
    )
    registry = Registry.load([write(text)])
    mine = {key for key, source in registry.sources.items() if not source.distribution}
    assert mine == {("contacts", "my-law"), ("loads", "bad")}
    source = registry.sources["contacts", "my-law"]
    assert re.fullmatch(r"percuss_file_my_law_[0-9a-f]{12}", source.module)
    assert source.file == str(tmp_path / "my_law.py")
    assert str(source) == f"{display_path(source.file)} ({source.version})"


def test_a_class_of_a_file_has_its_source_its_lines_and_its_pickle_in_another_process(write, tmp_path):
    name = "my-law 2.py"
    registry = Registry.load(
        [write(IMPORTS + law().replace("return Linear", "raise RuntimeError; return Linear"), name)]
    )
    cls = registry.get("contacts", "my-law")
    assert inspect.getsourcefile(cls) == str(tmp_path / name)
    with pytest.raises(RuntimeError) as raised:
        cls().bind(None, 0.1)
    assert traceback.extract_tb(raised.value.__traceback__)[-1].line.strip().startswith("raise RuntimeError")
    (tmp_path / "pickle").write_bytes(pickle.dumps((registry, cls())))
    code = (
        "import pickle\nwith open('pickle', 'rb') as stream: registry, law = pickle.load(stream)\n"
        "print(type(law) is registry.get('contacts', 'my-law'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout == "True\n"


def test_an_edited_file_is_seen_anew(write, tmp_path):
    text = IMPORTS + law()
    file = write(text)
    times = (tmp_path / file).stat()
    first = Registry.load([file])
    write(text.replace("sigma=1.0", "sigma=2.0"))
    # same size, same time: only the content tells
    os.utime(tmp_path / file, ns=(times.st_atime_ns, times.st_mtime_ns))
    second = Registry.load([file])
    old, new = (registry.get("contacts", "my-law")().bind(None, 0.1).sigma for registry in (first, second))
    assert (old, new) == (1.0, 2.0)
    assert first.sources["contacts", "my-law"].version != second.sources["contacts", "my-law"].version
    assert not (tmp_path / "__pycache__").exists()


def test_a_file_given_twice_counts_once_and_finds_none_beside_it(write, tmp_path):
    file = write(IMPORTS + law())
    assert len(Registry.load([file, tmp_path / file]).single_files) == 1
    write("C = 1.0\n", "fake_beside.py")
    assert refusal(write("import fake_beside\n" + IMPORTS + law())) == (
        "my_law.py:1: ModuleNotFoundError: No module named 'fake_beside'"
    )


def test_what_is_no_python_file_is_named_with_the_nearest(write, tmp_path):
    write(IMPORTS + law())
    (tmp_path / "folder.py").mkdir()
    os.mkfifo(tmp_path / "pipe.py")  # which would be waited for
    for given, message in {
        "my_lw.py": f"there is no such file in {display_path(str(tmp_path))}. Did you mean 'my_law.py'?",
        write("x", "law.txt"): "this is not a Python file, expected a name that ends in .py",
        "folder.py": "expected a Python file, found a folder",
        "pipe.py": "expected a Python file, found a pipe or a device",
    }.items():
        assert refusal(given) == f"{given}: {message}"


# -------------------------------------------------------------------------------------------------------- asking for


def test_an_unknown_name_is_answered_with_the_nearest(install):
    install("fake-bad", "import fake_nothing\n")
    registry = Registry.load()
    start = "contacts has no 'penlty'. Did you mean 'penalty'? Left out: fake-bad 1.0: entry point"
    with pytest.raises(KeyError, match=re.escape(start)):
        registry.get("contacts", "penlty")
    with pytest.raises(KeyError, match=r"there is no family 'contact'\. Did you mean 'contacts'\?"):
        registry.get("contact", "penalty")
