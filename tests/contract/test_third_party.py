"""Somebody else's packages: built as wheels, installed beside percuss, used, and taken away again.

Everything happens in one fresh virtual environment that sees nothing of the environment in which the tests run:
percuss comes from a wheel of this checkout, the packages from wheels of what `percuss new` writes and the page of
packages shows, third-party dependencies from the package index. That takes half a minute, once for the module;
borrowing the dependencies of the running environment by a ``.pth`` would save most of it, but where percuss itself is
installed there, as in a check of the whole project, it would come along.
"""

import json
import os
import subprocess
import venv
from pathlib import Path

import pytest

import pages
import percuss
import places

pytestmark = pytest.mark.deep

ROOT = places.ROOT
BIN = "Scripts" if os.name == "nt" else "bin"


class World:
    """A folder with a fresh environment, and the packages `soft-stop`, `leaper` and `crooked` in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environ = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"}}
        self.environ |= {"PIP_DISABLE_PIP_VERSION_CHECK": "1", "COLUMNS": "200", "NO_COLOR": "1"}

    def run(self, *args: str, program: str = "percuss", cwd: str = ".") -> subprocess.CompletedProcess[str]:
        words = [str(self.folder / "venv" / BIN / program), *args]
        where = self.folder / cwd
        return subprocess.run(
            words, cwd=where, env=self.environ, capture_output=True, text=True, timeout=600, check=False
        )

    def pip(self, *args: str) -> None:
        done = self.run("-m", "pip", *args, program="python")
        assert done.returncode == 0, done.stderr

    def json(self, *args: str, cwd: str = ".") -> dict:
        done = self.run(*args, "--json", cwd=cwd)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    def wheels(self, *names: str) -> list[str]:
        return [str(next((self.folder / "wheels").glob(f"{name.replace('-', '_')}-*.whl"))) for name in names]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """Build and install everything."""
    world = World(tmp_path_factory.mktemp("third_party"))
    venv.create(world.folder / "venv", with_pip=True)
    world.pip("install", "-q", "hatchling")
    world.pip("wheel", "-q", "--no-deps", "--no-build-isolation", "-w", "wheels", str(ROOT))
    (wheel,) = world.wheels("percuss")
    world.pip("install", "-q", "--no-compile", f"{wheel}[kit]", "pytest")  # most modules are never imported
    made = {"soft-stop": "contact", "leaper": "integrator", "crooked": "load"}
    for name, kind in made.items():
        package(world, name, kind)
    edit(world, "crooked/crooked.py", "from percuss import Doc, Floats,", "from percuss import Doc, Float,")
    folders = [f".{os.sep}{name}" for name in made]
    world.pip("wheel", "-q", "--no-deps", "--no-build-isolation", "-w", "wheels", *folders)
    world.pip("install", "-q", "--no-deps", *world.wheels(*made))
    return world


def package(world: World, name: str, kind: str) -> None:
    """Write a method and make it a package, as the page says."""
    assert world.run("new", name, "--kind", kind).returncode == 0
    module, folder, page = name.replace("-", "_"), world.folder / name, pages.texts()["plugins/PACKAGE.md"]
    (folder / "tests").mkdir(parents=True)
    (world.folder / f"{name}.py").rename(folder / f"{module}.py")
    case = (world.folder / f"{name}.yaml").read_text()
    (folder / "case.yaml").write_text(case.replace(f"plugins: [{name}.py]\n", ""))
    (project,) = pages.blocks(page, "toml")
    (folder / "pyproject.toml").write_text(project.replace("soft-stop", name).replace("soft_stop", module))
    (test,) = pages.blocks(page, "python")
    imported = f"from {module} import {name.title().replace('-', '')} as Penalty"
    test = test.replace("from percuss_methods.contacts.penalty import Penalty", imported)
    (folder / "tests" / "test_it.py").write_text(test)


def edit(world: World, file: str, old: str, new: str) -> None:
    path = world.folder / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def listed(world: World) -> dict[str, dict]:
    return {one["name"]: one for one in world.json("plugins")["components"]}


def test_a_package_is_listed_with_where_it_is_from(world: World) -> None:
    one = listed(world)["soft-stop"]
    assert (one["distribution"], one["version"], one["module"]) == ("soft-stop", "0.1.0", "soft_stop")
    assert Path(one["file"]).is_relative_to(world.folder / "venv")
    assert one["contract_version"] == percuss.CONTRACT


def test_a_broken_package_costs_only_itself(world: World) -> None:
    (crooked,) = world.json("plugins")["broken"]
    assert crooked["source"] == "crooked 0.1.0"
    assert "has no 'Float' in percuss; did you mean 'Floats'?" in crooked["error"]
    assert crooked["file"].endswith("crooked.py:8")
    assert {"soft-stop", "leaper", "penalty"} <= set(listed(world)) - {"crooked"}


def test_a_case_is_verified_with_it(world: World) -> None:
    assert world.json("verify", "soft-stop/case.yaml", "leaper/case.yaml")["passed"]


@pytest.mark.parametrize("name", ["soft-stop", "leaper"])
def test_its_own_tests_pass(world: World, name: str) -> None:
    done = world.run("-q", "tests", program="pytest", cwd=name)
    assert done.returncode == 0, done.stdout
    assert " passed" in done.stdout


def test_once_uninstalled_it_is_gone(world: World) -> None:
    world.pip("uninstall", "-q", "-y", "soft-stop")
    try:
        told = listed(world)
        assert "soft-stop" not in told
        assert {"leaper", "penalty"} <= set(told)
        done = world.run("run", "case.yaml", cwd="soft-stop")
        assert done.returncode == 2
        assert "case.yaml:20:19: method.contact.name: unknown contact law" in done.stderr
    finally:
        world.pip("install", "-q", "--no-deps", *world.wheels("soft-stop"))
