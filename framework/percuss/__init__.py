"""Public interface of percuss, a test bench that compares explicit contact-impact methods.

Read a case with ``load``, compute it with ``run`` and inspect the `Result`; to add a method, subclass one of the
component families. A plug-in may import only the names in ``__all__`` of this module and of `percuss.testing`. These
names are stable: `CONTRACT` is their version number, which increases when plug-ins have to change; see
`percuss.methods.interfaces` for the details. Every name is imported when it is first used.
"""

# This module imports nothing, not even from the standard library, until a name is used: the command has to put the path
# in order first. The file of the types, whose lines are `from MODULE import NAME as NAME`, is the list of the names.
with open(f"{__path__[0]}/__init__.pyi", encoding="utf-8") as _file:  # noqa: PTH123
    _MODULE_OF = {words[3]: words[1] for words in map(str.split, _file) if words[:1] == ["from"]}

__all__ = [name for name in _MODULE_OF if name != "__version__"]


def __getattr__(name):
    """Return a public name, imported from its module when it is first used."""
    from importlib import import_module

    if name in _MODULE_OF:
        return getattr(import_module(_MODULE_OF[name]), name)
    from percuss.errors import nearest
    from percuss.version import CONTRACT

    near = nearest(name, __all__)
    advice = f". Did you mean '{near}'?" if near else ""
    raise AttributeError(f"module 'percuss' (contract {CONTRACT}) has no attribute {name!r}{advice}")


def __dir__():
    """Return the public names, including those that are not imported yet."""
    return sorted(_MODULE_OF)
