"""Plug-ins: what is gathered, what is left out and why, and the exact words."""

import hashlib
import importlib.metadata
import inspect
import os
import pickle
import re
import subprocess
import sys
import traceback
from pathlib import Path

import pytest

import percuss
from percuss.errors import PluginError
from percuss.methods import admission
from percuss.methods.interfaces import FAMILIES
from percuss.methods.provenance import Broken, Provenance, display_path
from percuss.methods.registry import Registry
from percuss.reporting.component import component_text, registry_data

IMPORTS = """\
from dataclasses import dataclass
from percuss.methods.interfaces import Component, ContactLaw, Integrator, Load, LinearLaw
from percuss.methods.hooks import hookimpl

"""


def law(cls: str = "MyLaw", name: str = "my-law") -> str:
    return f'''
@dataclass(frozen=True)
class {cls}(ContactLaw):
    """A law."""

    name = "{name}"
    summary = "A law"

    def bind(self, points, dt):
        return LinearLaw(at="explicit", sigma=1.0)

'''


def hook(body: str = "return [MyLaw]", name: str = "percuss_contacts") -> str:
    return f"\n@hookimpl\ndef {name}():\n    {body}\n"


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


@pytest.fixture(autouse=True)
def _modules_as_before():
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if name.partition(".")[0].startswith(("fake_", "percuss_file_")):
            del sys.modules[name]


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Install a throw-away distribution and return its folder; `files` are texts by path."""

    def do(name, files, *, version="1.0", points=None):
        site = tmp_path / f"site-{name}-{version}"
        module = name.replace("-", "_")
        info = site / f"{module}-{version}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        (info / "entry_points.txt").write_text(f"[percuss]\n{points or f'laws = {module}'}\n")
        for file, text in files.items():
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


# ---------------------------------------------------------------------------------------- what comes with it


def test_built_in_methods_come_by_the_common_door():
    registry = Registry.load()
    assert registry.broken == ()
    assert not registry.clashes
    assert {"central-difference", "wu-predictor-corrector"} <= set(registry.names("integrators"))
    assert {"penalty", "bipenalty", "lagrange"} <= set(registry.names("contacts"))
    assert {"constant", "gravity", "half-sine", "harmonic", "prescribed-velocity", "ramp", "table"} <= set(
        registry.names("loads")
    )
    for family in FAMILIES:
        assert registry.names(family), f"{family} has no built-in method: a family appears with its first"


def test_each_built_in_method_says_where_it_is_from():
    registry = Registry.load()
    assert set(registry.sources) == set(registry.components)
    for (family, name), source in registry.sources.items():
        component = registry.get(family, name)
        assert issubclass(component, FAMILIES[family])
        assert (component.family, component.name) == (family, name)
        assert source.distribution == "percuss"
        assert source.version == importlib.metadata.version("percuss")
        assert source.module == component.__module__
        assert Path(source.file).samefile(inspect.getsourcefile(component))


def test_the_registry_is_light_and_plugins_come_in_only_with_load():
    code = (
        "import sys, percuss.methods.registry\n"
        "heavy = ['numba', 'pydantic', 'xarray', 'matplotlib', 'scipy', 'percuss_methods']\n"
        "print([name for name in heavy if name in sys.modules])\n"
        "percuss.methods.registry.Registry.load()\n"
        "print('percuss_methods' in sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[]", "True"]


def test_what_load_returns_cannot_be_changed():
    registry = Registry.load()
    with pytest.raises(TypeError):
        registry.components["contacts", "mine"] = object
    registry.names("contacts").clear()
    assert registry.names("contacts")


# --------------------------------------------------------------------------------------------- distributions


def test_an_installed_distribution_is_found(install):
    site = install("fake-laws", {"fake_laws.py": IMPORTS + law() + hook()}, version="2.3")
    registry = Registry.load()
    assert registry.broken == ()
    assert registry.get("contacts", "my-law").__name__ == "MyLaw"
    assert registry.sources["contacts", "my-law"] == Provenance(
        "fake-laws", "2.3", "fake_laws", str(site / "fake_laws.py")
    )
    assert str(registry.sources["contacts", "my-law"]) == "fake-laws 2.3 (fake_laws)"
    assert "penalty" in registry.names("contacts")
    assert registry.names("contacts") == sorted(registry.names("contacts"))


def test_repeated_loads_are_the_same_object_until_something_is_installed(install, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # a new __pycache__ looks like something installed
    first = Registry.load()
    assert Registry.load() is first
    install("fake-laws", {"fake_laws.py": IMPORTS + law() + hook()})
    second = Registry.load()
    assert second is not first
    assert second is Registry.load()
    assert second.get("contacts", "penalty") is first.get("contacts", "penalty")


def test_an_entry_point_may_name_an_object(install):
    body = (
        IMPORTS
        + law()
        + "class Hooks:\n    @hookimpl\n    def percuss_contacts(self):\n        yield MyLaw\n\n"
        + "hooks = Hooks()\n"
    )
    install("fake-laws", {"fake_laws.py": body}, points="laws = fake_laws:hooks")
    registry = Registry.load()
    assert registry.broken == ()
    assert "my-law" in registry.names("contacts")


def test_a_hook_function_may_have_another_name(install):
    body = (
        IMPORTS + law() + "\n@hookimpl(specname='percuss_contacts')\ndef laws():\n    return (MyLaw,)\n"
        "\n@hookimpl(optionalhook=True)\ndef percuss_frictions():\n    return []\n"
    )
    install("fake-laws", {"fake_laws.py": body})
    registry = Registry.load()
    assert registry.broken == ()
    assert "my-law" in registry.names("contacts")


def test_imported_helpers_are_not_taken_for_hooks(install):
    body = "from fake_helpers import percuss_helper\n" + IMPORTS + law() + hook()
    install("fake-laws", {"fake_laws.py": body, "fake_helpers.py": "def percuss_helper():\n    pass\n"})
    assert Registry.load().broken == ()


def test_the_order_of_the_path_does_not_matter(install, monkeypatch):
    install("fake-b", {"fake_b.py": IMPORTS + law("B", "b-law") + hook("return [B]")})
    install(
        "fake-a",
        {"fake_a.py": IMPORTS + law("A", "a-law") + hook("return [A]") + hook("return 3", "percuss_loads")},
    )
    install("fake-c", {"fake_c.py": "import fake_nothing\n"})
    first = Registry.load()
    monkeypatch.setattr(sys, "path", [*sys.path[:3][::-1], *sys.path[3:]])
    second = Registry.load()
    assert second is not first
    assert list(first.components) == list(second.components) == sorted(first.components)
    assert dict(first.sources) == dict(second.sources)
    assert first.broken == second.broken
    assert [one.source for one in first.broken] == ["fake-a 1.0", "fake-c 1.0"]


# ------------------------------------------------------------------------------------------------- isolation

LAWS = IMPORTS + law() + hook()
NOT_IMPORTABLE = {
    "missing module": ("import fake_nothing\n", "ModuleNotFoundError: No module named 'fake_nothing'", 1),
    "error": ("x = 1\nx / 0\n", "ZeroDivisionError: division by zero", 2),
    "syntax": ("x = 1\ndef f(:\n    pass\n", "SyntaxError: invalid syntax", 2),
    "nothing said": ("raise ValueError\n", "ValueError", 1),
    "no name": (
        IMPORTS + 'class L(ContactLaw):\n    """Law."""\n',
        'TypeError: L does not say its `name`: add `name = "..."` to the class',
        line_of(IMPORTS, "\n\n") + 2,
    ),
}


@pytest.mark.parametrize("case", NOT_IMPORTABLE)
def test_a_distribution_that_cannot_be_imported_costs_only_itself(install, case):
    text, error, line = NOT_IMPORTABLE[case]
    site = install("fake-bad", {"fake_bad.py": text})
    install("fake-laws", {"fake_laws.py": LAWS})
    registry = Registry.load()
    assert registry.broken == (
        Broken("fake-bad 1.0", f"entry point 'laws = fake_bad': {error}", f"{site / 'fake_bad.py'}:{line}"),
    )
    assert str(registry.broken[0]).startswith("fake-bad 1.0: entry point")
    assert {"my-law", "penalty"} <= set(registry.names("contacts"))
    assert "fake_bad" not in sys.modules


def test_a_missing_object_and_a_missing_module_are_named(install):
    install("fake-laws", {"fake_laws.py": LAWS}, points="a = fake_laws:hooks\nb = fake_law\nc = fake_laws")
    registry = Registry.load()
    assert [(one.source, one.error) for one in registry.broken] == [
        (
            "fake-laws 1.0",
            "entry point 'a = fake_laws:hooks': AttributeError: module 'fake_laws' has no attribute 'hooks'",
        ),
        ("fake-laws 1.0", "entry point 'b = fake_law': ModuleNotFoundError: No module named 'fake_law'"),
    ]
    assert "my-law" in registry.names("contacts")


def test_ctrl_c_is_not_swallowed(install):
    press = "import os, signal\nsignal.signal(2, signal.default_int_handler)\nos.kill(os.getpid(), 2)\n"
    install("fake-laws", {"fake_laws.py": f"{press}while True: pass\n"})
    with pytest.raises(KeyboardInterrupt):
        Registry.load()
    assert "fake_laws" not in sys.modules


def test_a_plugin_named_twice_is_used_once(install):
    install("fake-laws", {"fake_laws.py": LAWS}, points="a = fake_laws\nb = fake_laws")
    registry = Registry.load()
    (broken,) = registry.broken
    assert broken.error.startswith("entry point 'b = fake_laws': ValueError: Plugin")
    assert "my-law" in registry.names("contacts")


HOOK_NAMES = ", ".join(f"percuss_{family}" for family in FAMILIES)
ABSTRACT = '@dataclass(frozen=True)\nclass Bad({base}):\n    """Law."""\n    name = "bad"\n    summary = "bad"\n'
LOAD = ABSTRACT.format(base="Load") + "    def amplitude(self, time):\n        return time\n"
WRONG = {
    # what the plug-in says beside its valid law, what is said of it, the text that stands at the place
    "raises": (
        hook("raise RuntimeError('no licence')", "percuss_loads"),
        "percuss_loads: RuntimeError: no licence",
        "raise RuntimeError",
    ),
    "raises late": (
        hook("yield MyLaw\n    raise KeyError('x')", "percuss_loads"),
        "percuss_loads: KeyError: 'x'",
        "raise KeyError",
    ),
    "nothing": (
        hook("pass", "percuss_loads"),
        "percuss_loads: TypeError: 'NoneType' object is not iterable",
        "@hook",
    ),
    "not a class": (
        hook("return [3]", "percuss_loads"),
        "percuss_loads: 3 is not a class; return the class itself",
        None,
    ),
    "an object": (
        hook("return [MyLaw()]", "percuss_loads"),
        "percuss_loads: an object of class MyLaw is not a class; return the class itself",
        None,
    ),
    "no component": (
        "class Bad:\n    pass\n" + hook("return [Bad]", "percuss_loads"),
        "percuss_loads: Bad is not a subclass of percuss.Load",
        "class Bad",
    ),
    "the root": (
        hook("return [Component]", "percuss_loads"),
        "percuss_loads: Component is not a subclass of percuss.Load",
        None,
    ),
    "wrong family": (
        hook("return [MyLaw]", "percuss_loads"),
        "percuss_loads: MyLaw is one of contacts; return it from percuss_contacts",
        "@dataclass",
    ),
    "a contract": (
        hook("return [Load]", "percuss_loads"),
        "percuss_loads: Load is a contract, not a finished method; it has no `name`",
        None,
    ),
    "abstract": (
        ABSTRACT.format(base="Load") + hook("return [Bad]", "percuss_loads"),
        "percuss_loads: Bad is still abstract; it lacks `amplitude`",
        "@dataclass(frozen=True)\nclass Bad",
    ),
    "abstract twice": (
        ABSTRACT.format(base="Material").replace("Material", "Shape") + hook("return [Bad]", "percuss_shapes"),
        "percuss_shapes: Bad is still abstract; it lacks `dimension`, `mesh`",
        "@dataclass(frozen=True)\nclass Bad",
    ),
    "no dataclass": (
        LOAD.replace("@dataclass(frozen=True)\n", "") + hook("return [Bad]", "percuss_loads"),
        "percuss_loads: Bad is not a frozen dataclass; put @dataclass(frozen=True) above it",
        "class Bad",
    ),
    "undecorated below a dataclass": (
        '@dataclass(frozen=True)\nclass Base(Load, contract="loads"):\n    """Contract."""\n'
        + LOAD.replace("@dataclass(frozen=True)\n", "").replace("(Load)", "(Base)")
        + hook("return [Bad]", "percuss_loads"),
        "percuss_loads: Bad is not a frozen dataclass; put @dataclass(frozen=True) above it",
        "class Bad",
    ),
    "not frozen": (
        LOAD.replace("(frozen=True)", "") + hook("return [Bad]", "percuss_loads"),
        "percuss_loads: Bad is not a frozen dataclass; put @dataclass(frozen=True) above it",
        "@dataclass\nclass Bad",
    ),
    "bad name": (
        LOAD + "Bad.name = 'so bad'\n" + hook("return [Bad]", "percuss_loads"),
        "percuss_loads: Bad has the name 'so bad'; a letter, then letters, digits, _ and -",
        "@dataclass(frozen=True)\nclass Bad",
    ),
    "unknown hook": (
        hook(name="percuss_load"),
        "percuss_load: no such hook; did you mean percuss_loads?",
        "@hook",
    ),
    "unknown name": (
        "\n@hookimpl\ndef gather():\n    return []\n",
        f"gather: no such hook; there are {HOOK_NAMES}",
        "@hookimpl\ndef gather",
    ),
    "unknown specname": (
        "\n@hookimpl(specname='percuss_shape')\ndef gather():\n    return []\n",
        "percuss_shape: no such hook; did you mean percuss_shapes?",
        "@hookimpl(specname",
    ),
}


def wrong_text(case):
    beside, said, where = WRONG[case]
    text = IMPORTS.replace("LinearLaw", "LinearLaw, Shape") + law() + hook() + beside
    if where == "@hook":
        return text, said, line_of(text, beside.strip())
    return text, said, line_of(text, where) if where else None


@pytest.mark.parametrize("case", WRONG)
def test_a_mistake_in_a_distribution_costs_only_itself(install, case):
    text, said, line = wrong_text(case)
    site = install("fake-laws", {"fake_laws.py": text})
    registry = Registry.load()
    (broken,) = registry.broken
    assert (broken.source, broken.error) == ("fake-laws 1.0", said)
    if line is not None:
        assert broken.file == f"{site / 'fake_laws.py'}:{line}"
    assert {"my-law", "penalty"} <= set(registry.names("contacts"))
    assert "bad" not in registry.names("loads")


@pytest.mark.parametrize("case", WRONG)
def test_the_same_mistake_in_a_single_file_is_raised(write, case):
    text, said, line = wrong_text(case)
    with pytest.raises(PluginError) as raised:
        Registry.load([write(text)])
    if line is None:
        assert str(raised.value).endswith(f": {said}")
    else:
        assert str(raised.value) == f"my_law.py:{line}: {said}"
    assert "\n" not in str(raised.value)


def test_a_package_without_hooks_registers_what_its_modules_define(install):
    """As the built-in methods: a new method is one file. A module that fails costs only itself."""
    files = {
        "fake_pack/__init__.py": "",
        "fake_pack/laws/__init__.py": "",
        "fake_pack/laws/mine.py": IMPORTS + law(),
        "fake_pack/laws/bad.py": "\nraise RuntimeError('no licence')\n",
    }
    site = install("fake-pack", files)
    registry = Registry.load()
    assert registry.get("contacts", "my-law").__module__ == "fake_pack.laws.mine"
    (broken,) = registry.broken
    assert broken.error == "module fake_pack.laws.bad: RuntimeError: no licence"
    assert broken.file == f"{site / 'fake_pack' / 'laws' / 'bad.py'}:2"


def test_a_distribution_that_registers_nothing_is_named(install):
    install("fake-laws", {"fake_laws.py": IMPORTS})
    (broken,) = Registry.load().broken
    assert broken.error == "entry point 'laws = fake_laws': registers nothing: it has no hook and no finished component"


def test_a_hook_with_an_argument_costs_its_plug_in(install):
    install("fake-laws", {"fake_laws.py": IMPORTS + law() + "\n@hookimpl\ndef percuss_loads(case):\n    return []\n"})
    (broken,) = Registry.load().broken
    assert "percuss_loads(case)" in broken.error
    assert "\n" not in broken.error


def test_every_mistake_of_a_file_is_said_at_once(write):
    text = IMPORTS + law() + hook("return [MyLaw, 3]") + "\n@hookimpl\ndef percuss_load():\n    return []\n"
    with pytest.raises(PluginError) as raised:
        Registry.load([write(text)])
    first, second = str(raised.value).splitlines()
    assert first.endswith(": percuss_load: no such hook; did you mean percuss_loads?")
    assert second.endswith(": percuss_contacts: 3 is not a class; return the class itself")


# ------------------------------------------------------------------------------------- versions of the contract


def stating(version, text=LAWS):
    return text.replace('    name = "my-law"\n', f'    name = "my-law"\n    contract_version = {version}\n')


@pytest.mark.parametrize("stated", [None, 1, 5])
def test_a_contract_that_is_kept_is_fine(install, capsys, stated):
    """A contract before the first release is taken as the first, with one note."""
    admission._note_on_unreleased_contracts.cache_clear()
    text = stating(stated, IMPORTS + law()) + law("Other", "other").replace(
        "summary", f"contract_version = {stated}\n    summary"
    )
    install("fake-laws", {"fake_laws.py": text + hook("return [MyLaw, Other]")})
    registry = Registry.load()
    assert registry.broken == ()
    contract = 1 if stated else None
    told = next(one for one in registry_data(registry)["components"] if one["name"] == "my-law")
    assert told["contract_version"] == contract
    assert (registry_data(registry)["contract"], registry_data(registry)["percuss"]) == (1, percuss.__version__)
    assert ("written for contract 1" in component_text(registry, "contacts", "my-law")) == (contract == 1)
    assert capsys.readouterr().err.count("are taken as contract 1") == (stated == 5)


VERSIONS = {
    "newer": ("6", "MyLaw is written for contract 6, this percuss has contract 1: upgrade percuss"),
    "no number": ("'two'", "MyLaw has the contract_version 'two'; expected a whole number from 1, now 1"),
    "zero": ("0", "MyLaw has the contract_version 0; expected a whole number from 1, now 1"),
}


@pytest.mark.parametrize("case", VERSIONS)
def test_a_contract_that_is_not_kept_costs_that_component_alone(install, write, case):
    stated, said = VERSIONS[case]
    text = stating(stated, IMPORTS + law()) + law("Other", "other") + hook("return [MyLaw, Other]")
    site = install("fake-laws", {"fake_laws.py": text})
    registry = Registry.load()
    place = f"{site / 'fake_laws.py'}:{line_of(text, '@dataclass')}"
    assert registry.broken == (Broken("fake-laws 1.0", f"percuss_contacts: {said}", place),)
    assert {"other", "penalty"} <= set(registry.names("contacts"))
    assert "my-law" not in registry.names("contacts")
    with pytest.raises(PluginError) as raised:
        Registry.load([write(stating(stated, IMPORTS + law()))])
    assert str(raised.value) == f"my_law.py:{line_of(IMPORTS + law(), '@dataclass')}: {said}"


def test_the_contract_comes_before_what_it_asks_for(install):
    """A method of a later contract may lack what this one asks for: the contract is what is told."""
    text = stating(6, IMPORTS + ABSTRACT.format(base="Load").replace('"bad"', '"my-law"', 1))
    install("fake-laws", {"fake_laws.py": text + hook("return [Bad]", "percuss_loads")})
    (broken,) = Registry.load().broken
    assert broken.error.endswith("Bad is written for contract 6, this percuss has contract 1: upgrade percuss")


HERE = f"percuss {percuss.__version__} (contract {percuss.CONTRACT})"
NAMES = {
    "near": (
        "from percuss import LinearLew",
        f"ImportError: {HERE} has no 'LinearLew' in percuss; did you mean 'LinearLaw'?",
    ),
    "not near": (
        "from percuss import Frictional",
        f"ImportError: {HERE} has no 'Frictional' in percuss; was it written for another percuss?",
    ),
    "elsewhere": (
        "from percuss.errors import LinearLaw",
        f"ImportError: {HERE} has no 'LinearLaw' in percuss.errors; it stands in percuss itself",
    ),
    "no module": (
        "import percuss.laws",
        f"ModuleNotFoundError: {HERE} has no module 'percuss.laws'; "
        "a plug-in imports only from percuss and percuss.testing",
    ),
    "attribute": (
        "import percuss\nLaw = percuss.ContactLow",
        f"AttributeError: module 'percuss' (contract {percuss.CONTRACT}) has no attribute 'ContactLow'. "
        "Did you mean 'ContactLaw'?",
    ),
}


@pytest.mark.parametrize("case", NAMES)
def test_a_name_that_percuss_does_not_have_is_told_with_the_nearest(install, write, case):
    text, said = NAMES[case]
    site = install("fake-bad", {"fake_bad.py": text + "\n"})
    (broken,) = Registry.load().broken
    line = 1 + text.count("\n")
    assert broken.error == f"entry point 'laws = fake_bad': {said}"
    assert broken.file == f"{site / 'fake_bad.py'}:{line}"
    with pytest.raises(PluginError) as raised:
        Registry.load([write(text + "\n")])
    assert str(raised.value) == f"my_law.py:{line}: {said}"


def test_asking_percuss_for_what_it_has_not_stays_cheap():
    assert not hasattr(percuss, "Rowz")
    assert not hasattr(percuss, "__wrapped__")
    assert getattr(percuss, "Rowz", None) is None


# ------------------------------------------------------------------------------------------------ duplicates


def test_a_name_that_two_distributions_register_is_not_used(install):
    install(
        "fake-a",
        {
            "fake_a.py": LAWS
            + law("Other", "other")
            + hook("return [Other]", "percuss_contacts")
            .replace("@hookimpl", "@hookimpl(specname='percuss_contacts')")
            .replace("def percuss_contacts", "def more")
        },
    )
    site = install("fake-b", {"fake_b.py": LAWS}, version="2.0")
    registry = Registry.load()
    message = (
        "contacts 'my-law' is registered by fake-a 1.0 (fake_a) and by fake-b 2.0 (fake_b); "
        "none is used: have one renamed, or uninstall it"
    )
    assert registry.broken == (Broken("fake-a 1.0 and fake-b 2.0", message, str(site / "fake_b.py")),)
    assert {"other", "penalty"} <= set(registry.names("contacts"))
    assert "my-law" not in registry.names("contacts")
    assert ("contacts", "my-law") not in registry.components
    assert [source.distribution for source in registry.clashes["contacts", "my-law"]] == ["fake-a", "fake-b"]
    with pytest.raises(PluginError) as raised:
        registry.get("contacts", "my-law")
    assert str(raised.value) == message


def test_a_built_in_name_can_be_taken_away_but_not_taken_over(install):
    install("fake-laws", {"fake_laws.py": IMPORTS + law(name="penalty") + hook()})
    registry = Registry.load()
    with pytest.raises(PluginError, match=r"by fake-laws 1\.0 \(fake_laws\) and by percuss .*contacts\.penalty"):
        registry.get("contacts", "penalty")
    assert "bipenalty" in registry.names("contacts")


def test_the_same_name_in_two_families_is_no_duplicate(install):
    install(
        "fake-laws",
        {"fake_laws.py": IMPORTS + LOAD.replace('"bad"', '"penalty"', 1) + hook("return [Bad]", "percuss_loads")},
    )
    registry = Registry.load()
    assert registry.broken == ()
    assert "penalty" in registry.names("loads")
    assert "penalty" in registry.names("contacts")


def test_a_class_registered_twice_is_a_duplicate_too(install):
    install("fake-laws", {"fake_laws.py": IMPORTS + law() + hook("return [MyLaw, MyLaw]")})
    registry = Registry.load()
    (broken,) = registry.broken
    assert broken.source == "fake-laws 1.0"
    assert broken.error.startswith(
        "contacts 'my-law' is registered by fake-laws 1.0 (fake_laws) and by fake-laws 1.0 (fake_laws);"
    )


@pytest.mark.parametrize("name", ["penalty", "my-law"])
def test_a_file_that_takes_an_installed_name_is_refused(install, write, name):
    install("fake-a", {"fake_a.py": LAWS})
    text = IMPORTS + law(name=name)
    by = {
        "penalty": r"percuss \S+ \(percuss_methods\.contacts\.penalty\)",
        "my-law": r"fake-a 1\.0 \(fake_a\)",
    }[name]
    said = f"contacts '{name}' is registered by {by} already: give this one another `name`"
    with pytest.raises(PluginError, match=f"^my_law\\.py:{line_of(text, '@data')}: {said}$"):
        Registry.load([write(text)])


def test_a_file_that_takes_a_clashing_name_is_refused(install, write):
    install("fake-a", {"fake_a.py": LAWS})
    install("fake-b", {"fake_b.py": LAWS})
    with pytest.raises(PluginError, match=r"by fake-a 1\.0 \(fake_a\) and by fake-b 1\.0 \(fake_b\) already"):
        Registry.load([write(IMPORTS + law())])


def test_two_files_with_one_name_are_refused(write):
    one, two = write(IMPORTS + law(), "one.py"), write(IMPORTS + law(), "two.py")
    with pytest.raises(
        PluginError, match=r"^two\.py:6: contacts 'my-law' is registered by .*one\.py \(\w{12}\) already"
    ):
        Registry.load([one, two])


def test_a_class_registered_twice_by_one_file_is_refused(write):
    with pytest.raises(PluginError, match=r"^my_law\.py:6: contacts 'my-law' is registered by .*my_law\.py"):
        Registry.load([write(IMPORTS + law() + hook("return [MyLaw, MyLaw]"))])


# ---------------------------------------------------------------------------------------------- single files


def test_a_file_without_hooks_registers_what_it_defines(write, tmp_path):
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
    assert source.version == hashlib.sha256(text.encode()).hexdigest()[:12]
    assert source.file == str(tmp_path / "my_law.py")
    assert re.fullmatch(r"percuss_file_my_law_[0-9a-f]{12}", source.module)
    assert str(source) == f"{display_path(source.file)} ({source.version})"
    assert [file.path for file in registry.single_files] == [tmp_path / "my_law.py"]


def test_a_file_with_hooks_registers_what_they_return(write):
    registry = Registry.load([write(IMPORTS + law() + law("Unfinished", "unfinished") + hook())])
    assert "my-law" in registry.names("contacts")
    assert "unfinished" not in registry.names("contacts")


@pytest.mark.parametrize("name", ["my_law.py", "my-law 2.py", "1.py"])
def test_a_class_of_a_file_has_its_source_and_its_pickle(write, tmp_path, name):
    text = IMPORTS + law()
    registry = Registry.load([write(text, name)])
    cls = registry.get("contacts", "my-law")
    assert inspect.getsourcefile(cls) == str(tmp_path / name)
    assert inspect.getsource(cls).strip() == law().strip()
    assert pickle.loads(pickle.dumps(cls())) == cls()


def test_an_error_in_a_method_of_a_file_shows_the_real_path(write, tmp_path):
    text = IMPORTS + law().replace("return LinearLaw", "raise RuntimeError; return LinearLaw")
    cls = Registry.load([write(text)]).get("contacts", "my-law")
    with pytest.raises(RuntimeError) as raised:
        cls().bind(None, 0.1)
    last = traceback.extract_tb(raised.value.__traceback__)[-1]
    assert last.filename == str(tmp_path / "my_law.py")
    assert last.line.strip().startswith("raise RuntimeError")


def test_another_process_finds_the_classes_of_a_file(write, tmp_path):
    registry = Registry.load([write(IMPORTS + law())])
    with (tmp_path / "pickle").open("wb") as stream:
        pickle.dump((registry, registry.get("contacts", "my-law")()), stream)
    code = (
        "import pickle\nwith open('pickle', 'rb') as stream: registry, law = pickle.load(stream)\n"
        "print(type(law) is registry.get('contacts', 'my-law'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout == "True\n"
    assert pickle.loads(pickle.dumps(registry)) is registry


def test_an_edited_file_is_seen_anew(write, tmp_path):
    text = IMPORTS + law()
    file = write(text)
    times = (tmp_path / file).stat()
    first = Registry.load([file])
    assert Registry.load([file]) is first
    write(text.replace("sigma=1.0", "sigma=2.0"))
    # same size, same time: only the content tells
    os.utime(tmp_path / file, ns=(times.st_atime_ns, times.st_mtime_ns))
    second = Registry.load([file])
    old, new = (registry.get("contacts", "my-law")().bind(None, 0.1).sigma for registry in (first, second))
    assert (old, new) == (1.0, 2.0)
    assert first.sources["contacts", "my-law"].version != second.sources["contacts", "my-law"].version
    assert pickle.loads(pickle.dumps(first.get("contacts", "my-law")())) == first.get("contacts", "my-law")()
    write(text)
    third = Registry.load([file])
    assert third.get("contacts", "my-law") is first.get("contacts", "my-law")
    assert not (tmp_path / "__pycache__").exists()


def test_a_file_does_not_find_another_beside_it(write):
    """Its folder is not on the path of Python: make a package of both."""
    write("C = 1.0\n", "fake_beside.py")
    with pytest.raises(PluginError, match=r"^my_law\.py:1: ModuleNotFoundError: No module named 'fake_beside'$"):
        Registry.load([write("import fake_beside\n" + IMPORTS + law())])


def test_a_file_given_twice_counts_once(write, tmp_path):
    file = write(IMPORTS + law())
    (tmp_path / "sub").mkdir()
    registry = Registry.load([file, tmp_path / file, tmp_path / "sub" / ".." / file])
    assert len(registry.single_files) == 1
    assert Registry.load([tmp_path / file]) is registry


def test_a_file_in_two_registries_is_one_module(write):
    file, other = write(IMPORTS + law()), write(IMPORTS + law("Other", "other"), "other.py")
    one, two = Registry.load([file]), Registry.load([file, other])
    assert one is not two
    assert one.get("contacts", "my-law") is two.get("contacts", "my-law")


def test_a_file_cannot_invent_a_family(write):
    text = (
        IMPORTS
        + 'class Contact(Component, contract="contact"):\n    """Contract."""\n'
        + LOAD.replace("(Load)", "(Contact)")
    )
    said = f"my_law.py:{line_of(text, '@data')}: there is no family 'contact'. Did you mean 'contacts'?"
    with pytest.raises(PluginError) as raised:
        Registry.load([write(text)])
    assert str(raised.value) == said


def test_two_files_of_one_stem_are_two_plugins(write, tmp_path):
    (tmp_path / "sub").mkdir()
    registry = Registry.load([write(IMPORTS + law()), write(IMPORTS + law(name="other"), "sub/my_law.py")])
    assert {"my-law", "other"} <= set(registry.names("contacts"))


@pytest.mark.parametrize("case", NOT_IMPORTABLE)
def test_a_file_that_fails_is_raised_with_its_line(write, case):
    text, error, line = NOT_IMPORTABLE[case]
    before = set(sys.modules)
    with pytest.raises(PluginError) as raised:
        Registry.load([write(text)])
    assert str(raised.value) == f"my_law.py:{line}: {error}"
    assert not [name for name in set(sys.modules) - before if name.startswith("percuss_file_")]


def test_a_file_that_fails_deeper_shows_its_own_line(write):
    text = "import json\n\njson.loads('{')\n"
    with pytest.raises(PluginError, match=r"^my_law\.py:3: JSONDecodeError: Expecting property name"):
        Registry.load([write(text)])


def test_a_file_that_failed_works_once_repaired(write):
    with pytest.raises(PluginError):
        Registry.load([write("import fake_nothing\n")])
    assert "my-law" in Registry.load([write(IMPORTS + law())]).names("contacts")


def test_a_file_that_defines_nothing_is_refused(write):
    with pytest.raises(PluginError) as raised:
        Registry.load([write("from percuss_methods.contacts.penalty import Penalty\n")])
    assert str(raised.value) == "my_law.py: registers nothing: it has no hook and no finished component"


def test_a_missing_file_is_named_with_the_nearest(write, tmp_path):
    write(IMPORTS + law())
    folder = display_path(str(tmp_path))
    for given, message in {
        "my_lw.py": f"my_lw.py: there is no such file in {folder}. Did you mean 'my_law.py'?",
        "my_law": f"my_law: there is no such file in {folder}. Did you mean 'my_law.py'?",
        "zzz.py": f"zzz.py: there is no such file in {folder}",
        "no/zzz.py": f"no/zzz.py: there is no such file in {display_path(str(tmp_path / 'no'))}",
    }.items():
        with pytest.raises(PluginError) as raised:
            Registry.load([given])
        assert str(raised.value) == message


def test_only_python_files_are_plugins(write, tmp_path):
    (tmp_path / "folder").mkdir()
    for given in (write("x", "law.txt"), "folder"):
        with pytest.raises(PluginError) as raised:
            Registry.load([given])
        assert str(raised.value) == f"{given}: this is not a Python file, expected a name that ends in .py"
    (tmp_path / "folder.py").mkdir()
    os.mkfifo(tmp_path / "pipe.py")  # which would be waited for
    for given, kind in (("folder.py", "a folder"), ("pipe.py", "a pipe or a device")):
        with pytest.raises(PluginError) as raised:
            Registry.load([given])
        assert str(raised.value) == f"{given}: expected a Python file, found {kind}"


# ----------------------------------------------------------------------------------------------- asking for


def test_an_unknown_name_is_answered_with_the_nearest(install):
    install("fake-bad", {"fake_bad.py": "import fake_nothing\n"})
    registry = Registry.load()
    with pytest.raises(KeyError) as raised:
        registry.get("contacts", "penlty")
    assert raised.value.args[0].startswith(
        "contacts has no 'penlty'. Did you mean 'penalty'? Left out: fake-bad 1.0: entry point"
    )
    with pytest.raises(KeyError) as raised:
        registry.get("contact", "penalty")
    assert raised.value.args[0] == "there is no family 'contact'. Did you mean 'contacts'?"
    with pytest.raises(KeyError):
        registry.names("frictions")


def test_a_path_below_home_is_shown_short(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    assert display_path(str(tmp_path / "law.py")) == f"~{os.sep}law.py"
    assert display_path(f"{tmp_path}er{os.sep}law.py") == f"{tmp_path}er{os.sep}law.py"
    assert str(Broken("a 1", "b", f"{tmp_path / 'law.py'}:3")) == f"a 1: b [~{os.sep}law.py:3]"
    assert str(Broken("a 1", "b", "")) == "a 1: b"
