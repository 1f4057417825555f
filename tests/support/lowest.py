"""``python lowest.py PYPROJECT``: the lowest declared version of each dependency, as constraints for pip."""

import re
import sys
import tomllib
from pathlib import Path

BOUND = re.compile(r"(?P<name>[\w.-]+)(\[(?P<extras>[\w,-]+)\])?(>=(?P<lowest>[\w.]+))?")


def declared(project, extra=None):
    """Return name and lowest version of the dependencies of a project, or of one of its extras.

    An extra may name extras of the project itself.
    """
    lines = project["dependencies"] if extra is None else project["optional-dependencies"][extra]
    bounds = {}
    for line in lines:
        found = BOUND.fullmatch(line)
        if found is None:
            raise ValueError(f"expected a dependency with a lower bound alone, found {line!r}")
        if found["name"] == project["name"]:
            for own in found["extras"].split(","):
                bounds |= declared(project, own)
        else:
            bounds[found["name"]] = found["lowest"]
    return bounds


def constraints(project, extra="test"):
    """Return a line of constraints for each dependency of a project and of an extra."""
    bounds = declared(project) | declared(project, extra)
    return [f"{name}=={lowest}" for name, lowest in sorted(bounds.items()) if lowest]


if __name__ == "__main__":
    print("\n".join(constraints(tomllib.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))["project"])))
