"""Gathers the plug-ins: installed ones by the entry-point group ``percuss``, single files by their path.

A plug-in that cannot be imported, or that registers something wrong, costs its own components alone and is
listed in `Registry.broken`. A single file is different: the user asked for it, so its mistakes are raised.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import inspect
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, NamedTuple

import pluggy

from percuss.compiling import LOCK
from percuss.errors import PluginError, nearest, suggestion
from percuss.methods import hookspecs
from percuss.methods.admission import PREFIX, admitted
from percuss.methods.blame import PLUGIN_MODULES, begin_of, described, place_of
from percuss.methods.interfaces import FAMILIES, Component
from percuss.methods.local_modules import companions, importing
from percuss.methods.provenance import Broken, Provenance, shown
from percuss.methods.source_digest import data_named, remember

__all__ = ["Broken", "Provenance", "Registry"]

GROUP = "percuss"
NONE_USED = "none is used: have one renamed, or uninstall it"
HOOKS = {PREFIX + family: family for family in FAMILIES}

Key = tuple[str, str]
Clashes = Mapping[Key, tuple["Provenance", ...]]


@dataclass(frozen=True, eq=False)
class Registry:
    """The components at hand, by family and name; `Registry.load` makes one.

    Attributes
    ----------
    components, sources
        Class of each (family, name), sorted, and where it is from.
    clashes
        Names that are not used because several register them, with all who do.
    broken, files
        What was left out, and why; the single-file plug-ins it was made with.
    distributions
        Whether installed distributions were asked.
    """

    components: Mapping[Key, type[Component]]
    sources: Mapping[Key, Provenance]
    clashes: Clashes
    broken: tuple[Broken, ...]
    files: tuple[Path, ...]
    distributions: bool

    @staticmethod
    def load(files: Sequence[Path | str] = (), *, distributions: bool = True) -> Registry:
        """Return the registry of all installed plug-ins and the single-file plug-ins `files`.

        The same files, unedited, give the same object as long as nothing was installed in between.

        Parameters
        ----------
        files
            Single-file plug-ins; a file given twice counts once.
        distributions
            Whether to ask the installed distributions; without, there are not even the built-in methods.

        Raises
        ------
        PluginError
            If one of `files` is missing, fails, registers something wrong, or a name that is taken.
        """
        given: dict[Path, _File] = {}
        with LOCK:  # another thread would find a module that is half imported, or make a second one
            for file in files:
                read = _File.read(Path(file))
                given.setdefault(read.path, read)
            return _load(_environment() if distributions else None, tuple(given.values()))

    @property
    def families(self) -> tuple[str, ...]:
        """The families of components."""
        return tuple(FAMILIES)

    def names(self, family: str) -> list[str]:
        """Return the names of a family, sorted.

        Raises
        ------
        KeyError
            If there is no such family.
        """
        if family not in FAMILIES:
            raise KeyError(f"there is no family '{family}'. {suggestion(family, FAMILIES, 'family')}")
        return [name for of, name in self.components if of == family]

    def get(self, family: str, name: str) -> type[Component]:
        """Return the class called `name`.

        Raises
        ------
        KeyError
            If nobody registers that name.
        PluginError
            If several do.
        """
        if (family, name) in self.clashes:
            raise PluginError(f"{_taken((family, name), self.clashes[family, name])}; {NONE_USED}")
        names = self.names(family)
        if name not in names:
            left_out = f" Left out: {'; '.join(map(str, self.broken))}." if self.broken else ""
            raise KeyError(f"{family} has no '{name}'. {suggestion(name, names)}{left_out}")
        return self.components[family, name]

    def __reduce__(self) -> tuple[Callable[..., Registry], tuple[Any, ...]]:
        # another process gathers anew: only then are the modules of single files where its pickles look
        return functools.partial(Registry.load, distributions=self.distributions), (self.files,)


@dataclass(frozen=True)
class _File:
    """A single-file plug-in as read, with helpers and data; where one of these is edited it is another plug-in."""

    path: Path
    content: bytes
    helpers: tuple[tuple[Path, tuple[str, bytes]], ...]
    data: tuple[tuple[Path, bytes], ...]
    given: str = field(compare=False)

    @classmethod
    def read(cls, given: Path) -> _File:
        path = given.expanduser().resolve()
        if not path.exists():
            near = nearest(path.name, [other.name for other in path.parent.glob("*.py")])
            advice = f". Did you mean '{near}'?" if near else ""
            raise PluginError(f"{given}: there is no such file in {shown(str(path.parent))}{advice}")
        if path.suffix != ".py":
            raise PluginError(f"{given}: this is not a Python file, expected a name that ends in .py")
        try:
            content = path.read_bytes()
        except OSError as error:
            raise PluginError(f"{given}: cannot be read: {error.strerror}") from error
        helpers = companions(path, content)
        sources = {path: content, **{file: text for file, (_, text) in helpers.items()}}
        named = {file for source, text in sources.items() for file in data_named(source, text)}
        data = tuple((file, file.read_bytes()) for file in sorted(named))
        return cls(path, content, tuple(helpers.items()), data, str(given))

    @property
    def source(self) -> Provenance:
        data = [content for _, content in self.data]
        content = b"\0".join([self.content, *(text for _, (_, text) in self.helpers), *data])
        version = hashlib.sha256(content).hexdigest()[:12]
        # the content counts too: an edited file is a new module, and what the old one defined stays whole
        unique = hashlib.sha256(str(self.path).encode() + b"\0" + content).hexdigest()[:12]
        stem = re.sub(r"[^A-Za-z0-9_]", "_", self.path.stem)
        return Provenance("", version, f"percuss_file_{stem}_{unique}", str(self.path))


class _Found(NamedTuple):
    """A component that keeps the contract, and where it is from."""

    component: type[Component]
    source: Provenance

    @property
    def key(self) -> Key:
        return self.component.family, self.component.name


def _environment() -> tuple[tuple[str, int], ...]:
    """Return what changes when a distribution comes or goes: the folders of the path and their times."""
    return tuple((one, Path(one).stat().st_mtime_ns if Path(one).exists() else 0) for one in sys.path)


@functools.lru_cache(maxsize=32)
def _load(environment: tuple[tuple[str, int], ...] | None, files: tuple[_File, ...]) -> Registry:
    """Gather; `environment` tells one state of the installation from the next, None asks no distribution."""
    manager = _Manager()
    broken: list[Broken] = []
    found: dict[Key, list[_Found]] = {}
    points = importlib.metadata.entry_points(group=GROUP) if environment is not None else ()
    for source, point in sorted(((_source(one), one) for one in points), key=lambda pair: pair[0].label):
        with _isolate(broken, source, f"entry point '{point.name} = {point.value}'"):
            with _forgetting(source.module.partition(".")[0]):
                plugin = point.load()
            for one in _ask(manager, plugin, source, broken):
                found.setdefault(one.key, []).append(one)
    clashes = {key: tuple(one.source for one in many) for key, many in found.items() if len(many) > 1}
    for key, sources in clashes.items():
        labels = dict.fromkeys(source.label for source in sources)
        broken.append(Broken(" and ".join(labels), f"{_taken(key, sources)}; {NONE_USED}", sources[-1].file))
    chosen = {key: many[0] for key, many in found.items() if len(many) == 1}
    remember()
    for file in files:
        _add_file(manager, file, chosen, clashes)
    return Registry(
        components=MappingProxyType({key: chosen[key].component for key in sorted(chosen)}),
        sources=MappingProxyType({key: chosen[key].source for key in sorted(chosen)}),
        clashes=MappingProxyType(clashes),
        broken=tuple(broken),
        files=tuple(file.path for file in files),
        distributions=environment is not None,
    )


def _source(point: importlib.metadata.EntryPoint) -> Provenance:
    """Return who has an entry point, as far as its metadata tell."""
    name, version = (point.dist.name, point.dist.version) if point.dist else ("", "")
    return Provenance(name or "unnamed", version or "?", point.value.partition(":")[0].strip(), "")


@contextlib.contextmanager
def _forgetting(top: str) -> Iterator[None]:
    """Import `top`, or a module in it; where that fails, forget the parts of it that came in."""
    before = set(sys.modules)
    try:
        yield
    except BaseException:
        for name in set(sys.modules) - before:
            if name.partition(".")[0] == top:
                del sys.modules[name]
        raise


def _taken(key: Key, sources: Iterable[Provenance]) -> str:
    """Return who registers a name."""
    return f"{key[0]} '{key[1]}' is registered by {' and by '.join(map(str, sources))}"


def _add_file(manager: _Manager, file: _File, chosen: dict[Key, _Found], clashes: Clashes) -> None:
    """Add what a single file registers to `chosen`; raise PluginError with every mistake found in it."""
    broken: list[Broken] = []
    with _isolate(broken, file.source):
        for one in _ask(manager, _import_file(file), file.source, broken):
            with _isolate(broken, file.source, thing=one.component):
                if one.key in chosen or one.key in clashes:
                    who = clashes.get(one.key) or (chosen[one.key].source,)
                    raise PluginError(f"{_taken(one.key, who)} already: give this one another `name`")
                chosen[one.key] = one
    if broken:
        lines = (f"{one.file or file.path}: {one.error}" for one in broken)
        raise PluginError("\n".join(lines).replace(str(file.path), file.given))


def _import_file(file: _File) -> ModuleType:
    """Return the module of a single-file plug-in, imported once for each content."""
    name = file.source.module
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = str(file.path)
    with _forgetting(name), importing(dict(file.helpers)):
        sys.modules[name] = module  # dataclasses and pickle look it up there
        # not by the loader: its bytecode cache misses an edit within the same second that keeps the size
        exec(compile(file.content, str(file.path), "exec", dont_inherit=True), vars(module))  # noqa: S102
    return module


class _Manager(pluggy.PluginManager):
    """pluggy, but a hook function that it would ignore or refuse is set aside with the reason."""

    def __init__(self) -> None:
        super().__init__(GROUP)
        self.add_hookspecs(hookspecs)
        self.faults: list[tuple[str, object]] = []

    def parse_hookimpl_opts(self, plugin: object, name: str) -> pluggy.HookimplOpts | None:
        """Return the options of a usable hook function, None for anything else."""
        options = super().parse_hookimpl_opts(plugin, name)
        function = getattr(plugin, name, None) if options or name.startswith(PREFIX) else None
        if inspect.isroutine(function):
            try:
                _check_hook(plugin, name, function, options)
            except PluginError as error:
                self.faults.append((f"{name}: {error}", function))
                return None
        return options


def _check_hook(plugin: object, name: str, function: Any, options: pluggy.HookimplOpts | None) -> None:
    """Raise PluginError where pluggy would ignore or refuse a function that looks like a hook."""
    if options is None and isinstance(plugin, ModuleType) and function.__module__ != plugin.__name__:
        return  # somebody else's function, imported
    hook = (options and options.get("specname")) or name
    if hook not in HOOKS:
        if options and options.get("optionalhook"):
            return
        near = nearest(hook, HOOKS)
        advice = f"did you mean {near}?" if near else f"there are {', '.join(HOOKS)}"
        raise PluginError(f"no such hook; {advice}")
    if options is None:
        raise PluginError("not marked as a hook; put @hookimpl of percuss above it")
    if options.get("wrapper") or options.get("hookwrapper"):
        raise PluginError("a hook that returns classes cannot be a wrapper")
    if arguments := list(inspect.signature(function).parameters):
        raise PluginError(f"a hook takes no arguments, this one takes {', '.join(arguments)}")


def _ask(manager: _Manager, plugin: Any, source: Provenance, broken: list[Broken]) -> list[_Found]:
    """Return the components that a plug-in registers; what is wrong with it joins `broken`."""
    manager.faults = []
    manager.register(plugin)
    hooks = [
        (family, implementation.function)
        for hook, family in HOOKS.items()
        for implementation in getattr(manager.hook, hook).get_hookimpls()
        if implementation.plugin is plugin
    ]
    offers: list[tuple[str, object]] = []
    broken += [Broken(source.label, fault, begin_of(one) or source.file) for fault, one in manager.faults]
    for family, function in hooks:
        with _isolate(broken, source, PREFIX + family, function):
            offers += [(family, offer) for offer in _call(function)]
    if not hooks and not manager.faults:
        offers = [] if source.distribution else [(one.family, one) for one in _finished(plugin)]
        if not offers:
            nor = "" if source.distribution else " and no finished component"
            raise PluginError(f"registers nothing: it has no hook{nor}")
    found: list[_Found] = []
    for family, offer in offers:
        with _isolate(broken, source, PREFIX + family if hooks else "", offer):
            component = admitted(family, offer)
            file = getattr(sys.modules.get(component.__module__), "__file__", None) or source.file
            PLUGIN_MODULES.add(component.__module__.partition(".")[0])
            found.append(_Found(component, replace(source, module=component.__module__, file=file)))
    return found


def _call(function: Callable[[], Any]) -> list[object]:
    """Return what a hook returns, refused unless it is a list or the like."""
    result = function()
    if isinstance(result, type | str | Mapping) or not isinstance(result, Iterable):
        what = f"the class {result.__name__}" if isinstance(result, type) else repr(result)
        raise PluginError(f"returned {what}, expected a list of classes")
    return list(result)


def _finished(module: ModuleType) -> list[type[Component]]:
    """Return the finished components that a file defines, once each."""
    classes = dict.fromkeys(one for one in vars(module).values() if isinstance(one, type))
    own = (one for one in classes if issubclass(one, Component) and "name" in vars(one))
    return [one for one in own if one.__module__ == module.__name__]


@contextlib.contextmanager
def _isolate(broken: list[Broken], source: Provenance, what: str = "", thing: Any = None) -> Iterator[None]:
    """Run other people's code: an error joins `broken`, with its place or that of `thing`, and ends there."""
    try:
        yield
    except (Exception, SystemExit) as error:  # noqa: BLE001  nothing a plug-in does may stop the others
        place = place_of(error, source.file) or begin_of(thing) or source.file
        broken.append(Broken(source.label, ": ".join(filter(None, (what, described(error)))), place))
