"""Registry of the components of plug-ins: installed ones by the entry-point group ``percuss``, single files by path.

A plug-in registers what its hooks return. One without a hook, as `percuss_methods` is, registers each finished
component that it defines, in all modules if it is a package.

A plug-in that cannot be imported, or that registers something wrong, loses only its own components and is listed in
`Registry.broken`. A single file is different: the user asked for it, so its mistakes are raised.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.metadata
import pkgutil
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, NamedTuple, cast

from pluggy import PluginManager

from percuss.digest import source_digest
from percuss.errors import PluginError, nearest, suggestion
from percuss.jit import LOCK
from percuss.methods.admission import PREFIX, admitted
from percuss.methods.blame import PLUGIN_MODULES, definition_place, error_text, place_of
from percuss.methods.hooks import GROUP, hookspec
from percuss.methods.interfaces import FAMILIES, Component
from percuss.methods.provenance import Broken, Provenance
from percuss.methods.single_file import SingleFile

NONE_USED = "none is used: have one renamed, or uninstall it"

Key = tuple[str, str]
Clashes = Mapping[Key, tuple["Provenance", ...]]


@dataclass(frozen=True, eq=False)
class Registry:
    """The available components, by family and name; `Registry.load` makes a registry.

    Attributes
    ----------
    components, sources
        Class and provenance of each (family, name), sorted.
    clashes
        Names that are not used because several plug-ins register them, with the provenance in each.
    broken
        Plug-ins and components that were left out, with the reason.
    single_files
        The single-file plug-ins as they were read.
    """

    components: Mapping[Key, type[Component]]
    sources: Mapping[Key, Provenance]
    clashes: Clashes
    broken: tuple[Broken, ...]
    single_files: tuple[SingleFile, ...]

    @staticmethod
    def load(files: Sequence[Path | str] = ()) -> Registry:
        """Return the registry of all installed plug-ins and the single-file plug-ins `files`.

        The same files, unedited, give the same object as long as no distribution is installed or removed in between.

        Parameters
        ----------
        files
            Single-file plug-ins; a file given twice counts once.

        Raises
        ------
        PluginError
            If one of `files` is missing, fails, or registers something wrong or a name that is taken.
        """
        with LOCK:  # Another thread could find a module half imported, or import it a second time.
            read = dict.fromkeys(SingleFile.read(Path(file)) for file in files)
            return _load(_environment(), tuple(read))

    def names(self, family: str) -> list[str]:
        """Return the names of a family, sorted.

        Raises
        ------
        KeyError
            If there is no such family.
        """
        if family not in FAMILIES:
            raise KeyError(f"there is no family '{family}'. {suggestion(family, FAMILIES, 'family')}")
        return [name for component_family, name in self.components if component_family == family]

    def get(self, family: str, name: str) -> type[Component]:
        """Return the class called `name`.

        Raises
        ------
        KeyError
            If no plug-in registers that name.
        PluginError
            If several plug-ins register it.
        """
        if (family, name) in self.clashes:
            raise PluginError(f"{_registered_by((family, name), self.clashes[family, name])}; {NONE_USED}")
        component = self.components.get((family, name))
        if component is None:
            names = self.names(family)
            left_out = f" Left out: {'; '.join(map(str, self.broken))}." if self.broken else ""
            raise KeyError(f"{family} has no '{name}'. {suggestion(name, names)}{left_out}")
        return component

    def __reduce__(self) -> tuple[Callable[..., Registry], tuple[object, ...]]:
        # Another process loads the plug-ins itself, so that pickle finds the modules of single files there.
        return Registry.load, (tuple(file.path for file in self.single_files),)


class _Registered(NamedTuple):
    """A registered component that keeps the contract, and its provenance."""

    component: type[Component]
    source: Provenance

    @property
    def key(self) -> Key:
        """Family and name of the component."""
        return self.component.family, self.component.name


def _environment() -> tuple[tuple[str, int], ...]:
    """Return the folders of the import path and their modification times, which installing or removing changes."""
    return tuple((folder, Path(folder).stat().st_mtime_ns if Path(folder).exists() else 0) for folder in sys.path)


@functools.lru_cache(maxsize=32)
def _load(environment: tuple[tuple[str, int], ...], files: tuple[SingleFile, ...]) -> Registry:  # noqa: ARG001
    """Return the registry of installed distributions and `files`, cached until the installation changes.

    Parameters
    ----------
    environment
        State of the installation, which serves only as a key of the cache.
    files
        The single-file plug-ins.
    """
    manager = PluginManager(GROUP)
    manager.add_hookspecs(type("Specs", (), {PREFIX + family: hookspec(lambda: None) for family in FAMILIES}))
    broken: list[Broken] = []
    by_key: dict[Key, list[_Registered]] = {}
    points = importlib.metadata.entry_points(group=GROUP)
    for source, point in sorted(((_provenance_of(point), point) for point in points), key=lambda pair: pair[0].label):
        with _isolate(broken, source, f"entry point '{point.name} = {point.value}'"):
            PLUGIN_MODULES.add(source.module.partition(".")[0])
            for registered in _components_of(manager, point.load(), source, broken):
                by_key.setdefault(registered.key, []).append(registered)
    clashes = {key: tuple(one.source for one in several) for key, several in by_key.items() if len(several) > 1}
    for key, sources in clashes.items():
        labels = dict.fromkeys(source.label for source in sources)
        broken.append(Broken(" and ".join(labels), f"{_registered_by(key, sources)}; {NONE_USED}", sources[-1].file))
    chosen = {key: candidates[0] for key, candidates in by_key.items() if len(candidates) == 1}
    for registered in chosen.values():
        source_digest(registered.source.file)  # of the sources that were imported now, and not after a later edit
    for file in files:
        _add_file(manager, file, chosen, clashes)
    return Registry(
        components=MappingProxyType({key: chosen[key].component for key in sorted(chosen)}),
        sources=MappingProxyType({key: chosen[key].source for key in sorted(chosen)}),
        clashes=MappingProxyType(clashes),
        broken=tuple(broken),
        single_files=files,
    )


def _provenance_of(point: importlib.metadata.EntryPoint) -> Provenance:
    """Return the provenance of an entry point, as far as its metadata contain it."""
    name, version = (point.dist.name, point.dist.version) if point.dist else ("", "")
    return Provenance(name or "unnamed", version or "?", point.value.partition(":")[0].strip(), "")


def _registered_by(key: Key, sources: Iterable[Provenance]) -> str:
    """Return a clause that names the plug-ins that register a component of this family and name."""
    return f"{key[0]} '{key[1]}' is registered by {' and by '.join(map(str, sources))}"


def _add_file(manager: PluginManager, file: SingleFile, chosen: dict[Key, _Registered], clashes: Clashes) -> None:
    """Add the components of a single file to `chosen`; raise PluginError with all mistakes in the file."""
    broken: list[Broken] = []
    with _isolate(broken, file.source):
        for registered in _components_of(manager, file.module(), file.source, broken):
            with _isolate(broken, file.source, culprit=registered.component):
                if registered.key in chosen or registered.key in clashes:
                    owners = clashes.get(registered.key) or (chosen[registered.key].source,)
                    raise PluginError(f"{_registered_by(registered.key, owners)} already: give this one another `name`")
                chosen[registered.key] = registered
    if broken:
        lines = (f"{fault.file or file.path}: {fault.error}" for fault in broken)
        raise PluginError("\n".join(lines).replace(str(file.path), file.given))


def _components_of(manager: PluginManager, plugin: Any, source: Provenance, broken: list[Broken]) -> list[_Registered]:
    """Return the components that a plug-in registers; add its mistakes to `broken`."""
    manager.register(plugin)  # which refuses one that is registered already, and a hook with arguments
    offers: list[tuple[str, str, object]] = []  # hook, family, and what is offered
    callers = {caller.name: caller for caller in manager.get_hookcallers(plugin) or ()}
    for caller in callers.values():
        for hook in (implementation for implementation in caller.get_hookimpls() if implementation.plugin is plugin):
            with _isolate(broken, source, caller.name, hook.function):
                if caller.has_spec():
                    family = caller.name.removeprefix(PREFIX)
                    offers += [(caller.name, family, offer) for offer in cast("Iterable[object]", hook.function())]
                elif not hook.optionalhook:
                    names = [PREFIX + family for family in FAMILIES]
                    near = nearest(caller.name, names)
                    advice = f"did you mean {near}?" if near else f"there are {', '.join(names)}"
                    raise PluginError(f"no such hook; {advice}")
    if not callers:
        known = len(broken)
        modules = _modules_of(plugin, source, broken)
        offers = [("", offer.family, offer) for module in modules for offer in _finished_components(module)]
        if not offers and len(broken) == known:
            raise PluginError("registers nothing: it has no hook and no finished component")
    components: list[_Registered] = []
    for hook_name, family, offer in offers:
        with _isolate(broken, source, hook_name, offer):
            component = admitted(family, offer)
            file = getattr(sys.modules.get(component.__module__), "__file__", None) or source.file
            PLUGIN_MODULES.add(component.__module__.partition(".")[0])
            components.append(_Registered(component, replace(source, module=component.__module__, file=file)))
    return components


def _modules_of(plugin: ModuleType, source: Provenance, broken: list[Broken]) -> list[ModuleType]:
    """Return a module and, of a package, all modules in it; add those that cannot be imported to `broken`."""
    modules = [plugin]
    folders = getattr(plugin, "__path__", ())
    for found in pkgutil.walk_packages(folders, f"{plugin.__name__}.", onerror=lambda _: None):
        with _isolate(broken, source, f"module {found.name}"):
            modules.append(importlib.import_module(found.name))
    return modules


def _finished_components(module: ModuleType) -> list[type[Component]]:
    """Return the finished components that a module defines, each of them once."""
    classes = dict.fromkeys(value for value in vars(module).values() if isinstance(value, type))
    components = (cls for cls in classes if issubclass(cls, Component) and "name" in vars(cls))
    return [component for component in components if component.__module__ == module.__name__]


@contextlib.contextmanager
def _isolate(broken: list[Broken], source: Provenance, part: str = "", culprit: object = None) -> Iterator[None]:
    """Run plug-in code inside this context; an error is added to `broken`, with its place, and goes no further.

    Parameters
    ----------
    broken
        List to which an error is added.
    source
        Provenance of the plug-in.
    part
        Name of its part that is run, for the text of the error.
    culprit
        Class or function to blame where the error itself has no place in the plug-in.
    """
    try:
        yield
    except Exception as error:  # noqa: BLE001  no error of a plug-in may stop the others
        place = place_of(error) or definition_place(culprit) or source.file
        broken.append(Broken(source.label, ": ".join(filter(None, (part, error_text(error)))), place))
