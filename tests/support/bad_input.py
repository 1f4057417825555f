"""Bad input of every kind, drawn from a seed, and what percuss makes of it.

`python tests/support/bad_input.py 100000` tries so many inputs in several processes and tells of each that ended in
any other way than with success or with a clear message, took longer than a second, or more memory than it may.
"""

import argparse
import contextlib
import copy
import json
import math
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import traceback
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import get_args

if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml

import percuss
import places
from command_line import percuss_command
from percuss.case.options import options_of
from percuss.case.specs import CaseSection
from percuss.case.type_words import bounds, branches, fact, is_union, item_type
from percuss.case.validation import NO_KEY, Keyed, Named, Section
from percuss.certificate.verdict import settled
from percuss.errors import PercussError
from percuss.methods.registry import Registry
from percuss.process import INTERRUPTED

SHARES = {
    "case": 25, "value": 20, "edge": 20, "study": 5, "table": 9, "command": 5, "result": 10, "store": 3, "plug-in": 3,
}  # fmt: skip
CHUNK = 2000  # inputs of one kind that a process tries
GOOD = {"fine", "refused"}
SECOND = 1.0  # of processor time, that no input may take
MEMORY = 500e6  # bytes that no process may take
ADDRESSES = 8 * 2**30  # bytes that a process may ask for, so that the machine survives it
GIVE_UP = 90.0  # seconds of processor time after which an input counts as hanging
SECONDS_OF_WORK = 60.0  # of a study, whose plan may have thousands of runs at 1 to 3 ms each, or of a picture
PATIENCE = 1200.0  # seconds after which a process that hangs outside Python is ended
LONGEST = 20_000  # letters of a message
MOST_ELEMENTS = 2000  # a case with more is no bad input, and takes the time that it takes

NASTY = [
    *("0", "-1", "1", "1e308", "-1e308", "1e-308", "1e400", ".inf", "-.inf", ".nan", "1" + 30 * "0", 400 * "1"),
    *("5e-324", "9223372036854775807", "9223372036854775808", "1000000", "0x7fffffff", "-0.0", "1_000", "0:1:1000000"),
    *("null", "true", "~", "''", '""', "[]", "{}", "[[]]", "[1, 2, 3]", "{a: 1}", "{name: x}", "!!python/none x"),
    *("*a", "&a 1", "<<: *a", "auto", "matched", "short.right", "nobody.left", "lagrange", "a" * 300, "../..", "."),
    *("\u0000", "\ufeff", "é", "名前", "\u202e", "\U0001f4a5", "\ud7ff"),
    *("%s%n", "${HOME}", "--- ", "\t", "#", "? a", "|", ">"),
]  # fmt: skip


# ------------------------------------------------------------------------------------------------- mutations


def of_bytes(draw, content):
    """Return bytes with the usual accidents: other bytes, lost blocks, a missing end, two files mixed."""
    bad = bytearray(content)
    for _ in range(few(draw)):
        at = int(draw.integers(len(bad) + 1))
        length = int(2 ** draw.integers(0, 12))
        match int(draw.integers(7)):
            case 0 if at < len(bad):
                bad[at] ^= int(draw.integers(1, 256))
            case 1:
                bad[at : at + length] = bytes(len(bad[at : at + length]))
            case 2:
                del bad[at : at + length]
            case 3:
                del bad[at:]
            case 4:
                bad[at:at] = draw.bytes(min(length, 64))
            case 5:
                start = int(draw.integers(len(bad) + 1))
                bad[at : at + length] = bad[start : start + length]
            case _:
                bad[at : at + 4] = draw.bytes(4)
    return bytes(bad)


def of_text(draw, text):
    """Return a text with up to three mistakes as typing makes them, and worse ones."""
    for _ in range(few(draw)):
        lines = text.splitlines(keepends=True) or [""]
        at, line = int(draw.integers(len(text) + 1)), int(draw.integers(len(lines)))
        numbers = list(re.finditer(r"[-+]?[0-9][0-9.]*(?:e[-+]?[0-9]+)?", text))
        words = list(re.finditer(r"[A-Za-z_][A-Za-z_-]*", text))
        match int(draw.integers(12)):
            case 0:
                text = text[:at] + chr(int(draw.integers(32, 127))) + text[at + 1 :]
            case 1:
                text = text[:at] + text[at + int(draw.integers(1, 30)) :]
            case 2:
                text = text[:at] + one_of(draw, NASTY) + text[at:]
            case 3:
                del lines[line]
                text = "".join(lines)
            case 4:
                lines.insert(int(draw.integers(len(lines) + 1)), lines[line])
                text = "".join(lines)
            case 5:
                lines[line] = " " * int(draw.integers(5)) + lines[line].lstrip(" ")
                text = "".join(lines)
            case 6 | 7 if numbers:
                text = spliced(text, one_of(draw, numbers), one_of(draw, NASTY))
            case 8 if words:
                text = spliced(text, one_of(draw, words), one_of(draw, words)[0])
            case 9 if words:
                text = spliced(text, one_of(draw, words), one_of(draw, NASTY))
            case 10:
                text = text[:at]
            case _:
                text = text[:at] + one_of(draw, "[]{}:,#&*!|>'\"%@`-?\n\t\\\0\u2028\x85") + text[at:]
    return text


def few(draw):
    """Return how many accidents an input suffers: mostly one, so that most of it is still read."""
    return one_of(draw, (1, 1, 1, 1, 2, 3))


def one_of(draw, items):
    return items[int(draw.integers(len(items)))]


def spliced(text, match, new):
    return text[: match.start()] + new + text[match.end() :]


def paths_in(data, path=()):
    yield path
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, item in items:
        yield from paths_in(item, (*path, key))


def value_at(data, path):
    for part in path:
        data = data[part]
    return data


def of_structure(draw, data):
    """Return plain data in which up to three entries are lost, doubled, moved, renamed or of another kind."""
    data = copy.deepcopy(data)
    for _ in range(few(draw)):
        paths = [path for path in paths_in(data) if path]
        if not paths:
            return data
        path, other = one_of(draw, paths), one_of(draw, paths)
        owner, moved = value_at(data, path[:-1]), copy.deepcopy(value_at(data, other))
        match int(draw.integers(6)):
            case 0:
                del owner[path[-1]]
            case 1:
                owner[path[-1]] = moved
            case 2 if isinstance(owner, dict):
                owner[str(one_of(draw, [*NASTY, *map(str, other)]))] = owner.pop(path[-1])
            case 3 if isinstance(owner, list):
                owner.insert(path[-1], moved)
            case 4:
                owner[path[-1]] = [owner[path[-1]]]
            case _:
                owner[path[-1]] = any_value(draw)
    return data


def any_value(draw, depth=0):
    """Return a value of any kind and size that YAML can give."""
    match int(draw.integers(-6, 12 if depth < 3 else 8)):
        case -6 | -5 | -4:
            return float(10.0 ** draw.normal(0, 2))
        case -3 | -2:
            return int(draw.integers(1, 9))
        case -1:
            return float(10.0 ** draw.normal(0, 80))
        case 0:
            return float(10.0 ** draw.integers(-320, 309)) * one_of(draw, (-1, 1))
        case 1:
            return one_of(draw, (float("nan"), float("inf"), float("-inf"), 0.0, -0.0, 5e-324, 1e308))
        case 2:
            return int(10 ** int(draw.integers(0, 18)))
        case 3:
            return one_of(draw, (10**30, -(10**30), int(400 * "1"), 2**63, 2**63 - 1, 2**31, -1, 0, 1, 2))
        case 4:
            return one_of(
                draw, (True, False, None, "", " ", "auto", "matched", "left", "short.left", "bar", "lagrange")
            )
        case 5:
            return "".join(chr(int(c)) for c in draw.integers(1, 0xD7FF, int(draw.integers(1, 12))))
        case 6:
            return str(one_of(draw, NASTY)) * int(draw.integers(1, 4))
        case 7:
            return one_of(
                draw, ("x" * 100_000, "1" * 5000, "-" * 1000, "a.b.c.d.e.f.g", "file.csv", "/", "\\", "cases")
            )
        case 8 | 9:
            return [any_value(draw, depth + 1) for _ in range(int(draw.integers(4)))]
        case 10:
            names = (*("name", "beta_s", "value", "bar", "constant", "elements"), str(any_value(draw, 3))[:20])
            return {one_of(draw, names): any_value(draw, depth + 1) for _ in range(int(draw.integers(3)))}
        case _:
            return [1.0] * int(draw.integers(3, 2000))


# ------------------------------------------------------------------------------------------- what is mutated


def as_yaml(data):
    return yaml.safe_dump(data, sort_keys=False, allow_unicode=True)


def small(text):
    """Return a shipped case with few elements."""
    return re.sub(r"elements: [0-9]+", "elements: 4", text)


TABLE = "# time, force\ntime;force\n0;0\n0.1;1.5\n0.2;-2e-1\n0.4;0\n"
STUDY = {
    "percuss-study": 1,
    "title": "a study to be damaged",
    "cases": ["hunek.yaml", "table.yaml"],
    "methods": {"integrators": ["central-difference"], "contacts": ["penalty", {"name": "lagrange"}]},
    "vary": {"method.contact.beta_s": [0.1, 1.0], "time.courant": "0.3:0.9:2"},
    "measure": ["force_error_l1", "ripple", {"name": "plateau", "quantity": "contact_force", "take": "max"}],
    "set": {"time.end": 0.1},
    "keep": {"histories": 20},
    "repeats": 1,
    "where": [{"path": "time.courant", "op": "<", "value": 2}],
}
# a case small enough to be run, in which most numbers of a case have a place
EDGE = {
    "percuss": 1,
    "bodies": {
        "short": {"bar": {"length": 1.0, "elements": 2}, "area": 1.0, "velocity": 0.1},
        "long": {"bar": {"length": 2.0, "elements": 3, "direction": [1.0]}, "at": 1.0, "area": 1.0},
    },
    "contacts": {"tip": {"between": ["short.right", "long.left"]}, "top": {"body": "long.right", "wall": 3.01}},
    "loads": {"pull": {"on": "short.left", "from": 0.01, "until": 0.05}},
    "time": {"end": 0.1, "courant": 0.5},
    "record": {"every": 1, "probes": ["short.left"], "fields": 2},
    "refine": 1,
    "expect": [
        {"quantity": "impulse", "contact": "tip", "value": 0.02, "within": 0.1, "source": "paper"},
        {"quantity": "gap", "contact": "tip", "during": [0.02, 0.05], "mean": 0.0, "within": "1%", "source": "paper"},
    ],
}
SIZES = (1e12, 1e30, 1e60, 1e99, 1e100, 1e154, 1.7e308)
EDGES = (*SIZES, *(1.0 / size for size in SIZES), 5e-324, 0.0)  # and their negatives
WHOLE_EDGES = (0, 1, 2, 11, 2**31, 2**62)
MOST_STEPS = 500  # or nodes, of a case that is run
MARCHING = {"run", "compare", "verify"}
EDGE_COMMANDS = [  # PATH has been set to a number at the edge, VALUES are three about it
    *("check CASE", "check CASE --json", "run CASE", "run CASE", "run CASE --json", "run CASE --json"),
    *("run CASE --nudge", "run CASE --tied --json", "run CASE --plot out.svg", "run CASE -o out.nc"),
    *("run CASE --exact-only --json", "run CASE --exact-only", "run CASE --exact-only --plot out.svg"),
    *("stability CASE --json", "stability CASE --vary PATH=VALUES --json", "stability CASE --by linear-laws,black-box"),
    *("compare CASE --vary PATH=VALUES --json", "waves CASE --json", "waves CASE --contact top", "verify CASE"),
]
WRONG_WORDS = re.compile(r"\bNone\b|\bNaN\b|\binf%|np\.|\bSingular\b|object at 0x")
# command lines that are right, beside files of the ground
COMMANDS = [
    "check hunek.yaml --set time.courant=0.4 --set method.contact=lagrange --json",
    "check table.yaml --set loads.pull.table.file=pull.csv",
    "run hunek.yaml -o out.nc --plot out.svg --nudge",
    "run hunek.yaml --exact-only --json --set bodies.short.velocity=[0.1]",
    "compare hunek.yaml --integrator central-difference --contact penalty,lagrange --vary refine=1,2 --tied --json",
    "compare hunek.yaml --vary method.contact.beta_s=0.01:100:log:3",
    "stability hunek.yaml --vary method.contact.beta_s=0.1,1 --by black-box,linear-laws -o out.csv --json",
    "stability hunek.yaml --curves method.contact.ratio=0.5,1 --vary method.contact.beta_s=0.5:1:2",
    "waves hunek.yaml --contact tip --json",
    "study study.yaml -o rows.sqlite --workers 1 --export rows.csv --again failed",
    "report store.sqlite -o page.html",
    "report store.sqlite --figures figures",
    "verify hunek.yaml --json",
    "verify --plugin spring.py",
    "plugins bipenalty --json",
    "plugins --plugin spring.py",
    "schema --study",
    "new my-law --kind contact -o here",
]


def at_edge(draw, kind, annotation=None):
    """Return a number at the edge of what a machine or an option's bounds allow."""
    if kind is int:
        return int(one_of(draw, WHOLE_EDGES))
    low, high, *_ = bounds(annotation)
    limits = [limit for limit in (low, high) if math.isfinite(limit)]
    near = [math.nextafter(limit, other) for limit in limits for other in (-math.inf, limit, math.inf)]
    return one_of(draw, near) if near and draw.integers(2) else one_of(draw, EDGES) * (1 if draw.integers(8) else -1)


def edge_case(draw, registry):
    """Return a small case with components of all that are registered, and the path of an option at its edge, if any."""
    data, path = copy.deepcopy(EDGE), ()

    def component(at, family, *names):
        nonlocal path
        name = one_of(draw, names or registry.names(family))
        cls = registry.get(family, name)
        options = dict(one_of(draw, cls.examples))
        numeric = [
            (key, kind, part)
            for key, option in options_of(cls).items()
            for part in parts(option.annotation)
            for kind in branches(part)
            if kind in {int, float}
        ]
        if numeric and draw.integers(3) == 0:
            key, kind, annotation = one_of(draw, numeric)
            options[key] = at_edge(draw, kind, annotation)
            path = (*at, key)
        return name, options

    simple = draw.integers(3) > 0  # with bars of lumped masses alone other components reach further
    for part, family, usual in (("material", "materials", "elastic"), ("element", "elements", "bar")):
        name, options = component(("bodies", "short", part), family, *([usual] if simple else []))
        for body in data["bodies"].values():
            body[part] = {"name": name, **options}
    data["method"] = {}
    for part, family, usual in (
        ("integrator", "integrators", "central-difference" if draw.integers(2) else "wu-predictor-corrector"),
        ("contact", "contacts", ""),
        ("mass", "masses", "lumped"),
    ):
        name, options = component(("method", part), family, *([usual] if simple and usual else []))
        data["method"][part] = {"name": name, **options}
    name, options = component(("loads", "pull"), "loads")
    if draw.integers(2):
        data["loads"]["pull"][name] = options
        path = (*path[:2], name, *path[2:]) if path[:1] == ("loads",) else path
    else:
        data["loads"], path = {}, path if path[:1] != ("loads",) else ()
    if name == "gravity" and data["loads"]:
        del data["loads"]["pull"]["on"]
    data["time"]["courant"] = "auto" if draw.integers(5) == 0 else 0.5
    if draw.integers(4) == 0:
        data["time"], data["expect"] = {"steps": 10, "step": 0.001}, []
    return json.loads(json.dumps(data)), path


def parts(annotation):
    """Yield each branch of the type of an option, with its bounds."""
    if is_union(annotation):
        for branch in get_args(annotation):
            yield from parts(branch)
    else:
        yield annotation


def no_constant(name):
    raise ValueError(f"{name} is no JSON")


class Ground:
    """A folder with whole files of each kind, made once for all processes."""

    def __init__(self, folder):
        self.folder = Path(folder)

    def make(self):
        cases = self.folder / "cases"
        cases.mkdir(parents=True)
        for file in [*places.CASES.glob("*.yaml"), *places.CASES.glob("studies/*.yaml")]:
            (cases / file.name).write_text(small(file.read_text(encoding="utf-8")).replace("../", ""), encoding="utf-8")
        hunek = yaml.safe_load((cases / "hunek.yaml").read_text(encoding="utf-8"))
        hunek["loads"] = {"pull": {"on": "short.left", "table": {"file": "pull.csv"}}}
        (cases / "pull.csv").write_text(TABLE, encoding="utf-8")
        (cases / "table.yaml").write_text(as_yaml(hunek), encoding="utf-8")
        (cases / "study.yaml").write_text(as_yaml(STUDY), encoding="utf-8")
        result = percuss.run(percuss.load(cases / "hunek.yaml", {"record.fields": 3}), compiled=False)
        result.save(cases / "result.nc")
        shutil.copy(cases / "result.nc", self.folder / "result.nc")
        plug_ins = self.folder / "plug-ins"
        for kind in ("integrator", "contact", "load", "shape", "element", "material", "mass", "solution", "measure"):
            (plug_ins / kind).mkdir(parents=True)
            made = percuss_command("new", "my-method", "--kind", kind, "-o", plug_ins / kind)
            assert made.returncode == 0, made.stderr
            shutil.move(next((plug_ins / kind).glob("*.py")), plug_ins / f"my_{kind}.py")
            shutil.rmtree(plug_ins / kind)
        for file in [*places.SUPPORT.glob("bodies/*.py"), *places.SUPPORT.glob("schemes/*.py")]:
            shutil.copy(file, plug_ins)
        shutil.copy(plug_ins / "my_contact.py", cases / "spring.py")
        done = percuss_command("study", "study.yaml", "-o", "store.sqlite", "--workers", "1", cwd=cases, plain=True)
        assert done.returncode == 0, done.stderr
        shutil.copy(cases / "store.sqlite", self.folder / "store.sqlite")
        return self


class Bench:
    """The ground in a process, with a place to work in; marches and long maps are left out."""

    def __init__(self, ground):
        self.ground = ground
        self.folder = Path(tempfile.mkdtemp(prefix="bad-"))
        self.work = self.folder / "cases"
        shutil.copytree(ground.folder / "cases", self.work)
        self.registry = Registry.load()
        self.texts = {file.name: file.read_text(encoding="utf-8") for file in sorted(self.work.glob("*.yaml"))}
        self.data = {name: yaml.safe_load(text) for name, text in self.texts.items()}
        self.case_names = [name for name, data in self.data.items() if "percuss" in data]
        self.study_names = [name for name, data in self.data.items() if "percuss-study" in data]
        self.plug_ins = {
            file.name: file.read_text(encoding="utf-8") for file in sorted(ground.folder.glob("plug-ins/*"))
        }
        self.result = (ground.folder / "result.nc").read_bytes()
        self.store = (ground.folder / "store.sqlite").read_bytes()
        self.paths = [path for path in schema_paths(CaseSection, self.registry) if path]
        self.ready = percuss.open_result(ground.folder / "result.nc")
        self.undo = without_marches(self.ready)

    def close(self):
        self.undo()
        shutil.rmtree(self.folder, ignore_errors=True)

    def refresh(self):
        """Put back what an input may have written over or left behind."""
        for file in self.work.iterdir():
            if not (self.ground.folder / "cases" / file.name).exists():
                shutil.rmtree(file) if file.is_dir() else file.unlink()
        for name in ("store.sqlite", "pull.csv", "spring.py"):
            shutil.copy(self.ground.folder / "cases" / name, self.work / name)

    def command(self, *words):
        done = percuss_command(*words, cwd=self.work, plain=True)
        return judged(done)

    # --------------------------------------------------------------- one function for each kind of input

    def case(self, draw):
        name = one_of(draw, self.case_names)
        return self.check(self.damaged(draw, name), draw)

    def damaged(self, draw, name):
        """Return a shipped text, damaged."""
        match int(draw.integers(4)):
            case 0:
                return of_bytes(draw, self.texts[name].encode())
            case 1:
                return as_yaml(of_structure(draw, self.data[name])).encode()
            case _:
                return of_text(draw, self.texts[name]).encode(errors="surrogatepass")

    def value(self, draw):
        data = copy.deepcopy(self.data[one_of(draw, self.case_names)])
        path = one_of(draw, self.paths)
        owner = data
        for entry in path[:-1]:
            names = list(owner) if isinstance(owner, dict) else []
            part = one_of(draw, names) if entry == "*" and names else entry
            if not isinstance(owner.get(part), dict):
                owner[part] = (
                    {} if owner.get(part) is None or not isinstance(owner[part], str) else {"name": owner[part]}
                )
            owner = owner[part]
        owner["new" if path[-1] == "*" else path[-1]] = any_value(draw)
        if draw.integers(2):
            return self.check(as_yaml(data).encode(), draw)
        return self.checked(lambda: percuss.load(data), draw)

    def check(self, content, draw):
        (self.work / "bad.yaml").write_bytes(content)
        if draw.integers(4):
            return self.checked(lambda: percuss.load(self.work / "bad.yaml"), draw)
        with contextlib.suppress(PercussError):
            if too_large(percuss.load(self.work / "bad.yaml")):
                return "fine", ""
        return self.command("check", "bad.yaml", *(["--json"] if draw.integers(2) else []))

    def checked(self, load, draw):
        try:
            load()
        except PercussError as error:
            return clear(str(error))
        return "fine", ""

    def study(self, draw):
        name = one_of(draw, self.study_names)
        (self.work / "bad.yaml").write_bytes(self.damaged(draw, name))
        return self.command("study", "bad.yaml", "-o", "rows.sqlite", *(["--json"] if draw.integers(2) else []))

    def table(self, draw):
        damaged = of_bytes(draw, TABLE.encode()) if draw.integers(3) == 0 else of_text(draw, TABLE).encode()
        (self.work / "pull.csv").write_bytes(damaged)
        return self.checked(lambda: percuss.load(self.work / "table.yaml"), draw)

    def result_(self, draw):
        file = self.work / "bad.nc"
        file.write_bytes(of_bytes(draw, self.result))
        try:
            contents(percuss.open_result(file))
        except PercussError as error:
            return clear(str(error), "bad.nc")
        return "fine", ""  # `percuss verify` tells whether it is what its run gives

    def store_(self, draw):
        file = self.work / "bad.sqlite"
        file.write_bytes(of_bytes(draw, self.store))
        match int(draw.integers(40)):
            case 0:
                return self.command("report", "bad.sqlite", "--figures", "figures")
            case 1 | 2 | 3 | 4 | 5:
                return self.command("report", "bad.sqlite", "-o", "page.html")
            case 6 | 7 | 8 | 9 | 10 | 11 | 12 | 13 | 14 | 15:
                return self.command("study", "study.yaml", "-o", "bad.sqlite", "--json", "--export", "rows.csv")
        try:
            study_contents(file)
        except PercussError as error:
            return clear(str(error), "bad.sqlite")
        return "fine", ""  # `percuss verify` tells whether a row is what its run gives

    def plug_in(self, draw):
        name = one_of(draw, sorted(self.plug_ins))
        text = of_text(draw, self.plug_ins[name])
        (self.work / "bad.py").write_bytes(text.encode(errors="surrogatepass"))
        word, detail = self.command("plugins", "--plugin", "bad.py", *(["--json"] if draw.integers(2) else []))
        return ("unclear", detail) if word == "refused" and "bad.py" not in detail else (word, detail)

    def edge(self, draw):
        """Check, run or draw a small case with up to three numbers at the edge of what is allowed."""
        data, path = edge_case(draw, self.registry)
        for _ in range(few(draw) - bool(path)):
            numbers = [one for one in paths_in(data) if type(value_at(data, one)) in {int, float} and len(one) > 1]
            path = one_of(draw, numbers)
            value_at(data, path[:-1])[path[-1]] = at_edge(draw, type(value_at(data, path)))
        (self.work / "edge.yaml").write_text(as_yaml(data), encoding="utf-8")
        path = path if all(isinstance(part, str) for part in path) and path else ("time", "courant")
        value = value_at(data, path) if path in paths_in(data) else 0.5
        values = f"{value}:{one_of(draw, (-1, 0.5, 2)) * value if isinstance(value, float | int) else value}:3"
        words = one_of(draw, EDGE_COMMANDS).replace("PATH", ".".join(path)).replace("VALUES", values)
        self.words = words.replace("CASE", "edge.yaml").split()
        if self.words[0] in MARCHING and self.lasts():
            self.words = ["check", "edge.yaml"]
        with self.marching():
            done = percuss_command(*self.words, cwd=self.work, plain=True)
        word, detail = judged(done)
        said = done.stdout + done.stderr
        if word in GOOD and (wrong := WRONG_WORDS.search(said)):
            return "unclear", f"{wrong[0]!r} in {said[max(0, wrong.start() - 200) : wrong.end() + 100]!r}"
        if "--json" in self.words:
            json.loads(done.stdout, parse_constant=no_constant)
        return word, detail

    def lasts(self):
        """Return whether the case at the edge is a right one that takes its time."""
        with contextlib.suppress(PercussError):
            model = settled(percuss.load(self.work / "edge.yaml")).model
            return max(model.steps, model.bodies.n_nodes) > MOST_STEPS
        return False

    @contextlib.contextmanager
    def marching(self):
        """Let cases be run meanwhile."""
        self.undo()
        try:
            yield
        finally:
            self.undo = without_marches(self.ready)

    def command_(self, draw):
        words = one_of(draw, COMMANDS).split()
        for _ in range(int(draw.integers(1, 4))):
            at = int(draw.integers(len(words)))
            match int(draw.integers(6)):
                case 0:
                    words[at] = of_text(draw, words[at]).replace("\0", "0")
                case 1:
                    del words[at]
                case 2:
                    words.insert(at, words[int(draw.integers(len(words)))])
                case 3:
                    words.insert(at, one_of(draw, one_of(draw, COMMANDS).split()))
                case 4:
                    head, equals, _ = words[at].partition("=")
                    words[at] = head + equals + str(any_value(draw)).replace("\0", "0") if equals else words[at]
                case _:
                    path = ".".join(one_of(draw, self.paths)).replace("*", "short")
                    words += ["--set", f"{path}={str(any_value(draw))[:2000]}".replace("\0", "0")]
            words = words or ["check"]
        if any(word.startswith(("/", "~", "..")) or "/.." in word for word in words):
            return "fine", ""  # nothing may be written elsewhere
        for word in words:
            with contextlib.suppress(Exception):
                sets = dict(w.split("=", 1) for w, o in zip(words[1:], words, strict=False) if o == "--set")
                if word.endswith(".yaml") and too_large(percuss.load(self.work / word, sets)):
                    return "fine", ""
        self.words = words
        return self.command(*words)

    KINDS = {
        "case": case,
        "value": value,
        "edge": edge,
        "study": study,
        "table": table,
        "command": command_,
        "result": result_,
        "store": store_,
        "plug-in": plug_in,
    }

    def try_(self, kind, seed):
        """Return how an input ends: ``fine``, ``refused``, or what is wrong and where."""
        before = spent()
        signal.signal(signal.SIGPROF, hanging)
        signal.setitimer(signal.ITIMER_PROF, GIVE_UP)
        try:
            word, detail = self.KINDS[kind](self, np.random.default_rng([seed, list(SHARES).index(kind)]))
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt):
                raise
            word, detail = ("hangs" if isinstance(error, Hanging) else "traceback"), traced(error)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        seconds = spent() - before
        # Runs, plans and pictures are work; so is a value that a study tries with all its pairs before it is refused.
        works = kind in {"edge", "study"} or (word == "fine" and kind in {"store", "command"})
        if word in {"fine", "refused"} and seconds > (SECONDS_OF_WORK if works else SECOND):
            word, detail = "slow", f"{seconds:.2f} s; {word}: {detail[:200]}"
        self.refresh()
        return word, detail


class Hanging(BaseException):
    """An input takes far too long."""


def hanging(number, frame):
    raise Hanging


def spent():
    """Return the processor time of this process and of its children [s]."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def peak_memory():
    """Return the largest memory that this process has had [bytes], without that of the process that started it."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024 * int(next(line.split()[1] for line in lines if line.startswith("VmHWM")))


def traced(error):
    """Return the last places of a traceback and the error in one line."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "/tests/" not in frame.filename][-3:] or frames[-1:]
    where = " > ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in own)
    return f"{where}: {type(error).__name__}: {str(error)[:200]}"


def clear(message, *names):
    if not message.strip() or len(message) > LONGEST or "Traceback" in message:
        return "unclear", message[:500]
    return ("refused", message) if all(name in message for name in names) else ("unclear", message[:500])


def judged(done):
    """Return how a command ended."""
    if done.returncode not in {0, 1, 2, INTERRUPTED}:  # runs that are left out here wait, as after an interruption
        return "unclear", f"exit code {done.returncode}"
    if "Warning" in re.sub(r"(Syntax|Deprecation)Warning: ", "", done.stderr):  # Python says these of a plug-in
        return "warning", done.stderr[-500:]
    if done.returncode == 2:
        return clear(done.stderr)
    return ("unclear", done.stderr[:500]) if len(done.stderr) > LONGEST else ("fine", "")


def too_large(case):
    """Return whether a case is a right one that takes its time: many elements, or a fine map."""
    elements = [np.prod(getattr(body.shape, "elements", 1), dtype=float) for body in case.bodies.values()]
    total = case.refine * sum(elements)
    return MOST_ELEMENTS < total < 1e12


def contents(result):
    told = [json.dumps(part) for part in (result.summary, result.provenance, result.coordinates)]
    arrays = {**result.arrays, **{"field " + name: values for name, values in result.field_arrays.items()}}
    return told + [(name, np.asarray(values).astype(str).tolist()) for name, values in sorted(arrays.items())]


def study_contents(path):
    """Return all that a study says, as one text."""
    study = percuss.open_study(path)
    rows = study.as_records()
    kept = [study.histories(row["key"]) for row in rows]
    arrays = [one and {name: array.tolist() for name, array in one.items()} for one in kept]
    return repr((rows, arrays, study.provenance, study.spec, study.columns, study.files, study.plan, study))


def schema_paths(cls, registry):
    """Yield the path of every key of a section, with those of every component that may stand there."""
    for key, option in options_of(cls).items():
        named, keyed = fact(option.annotation, Named), fact(option.annotation, Keyed)
        if named is not None or keyed is not None:
            family = (named or keyed).family
            head = () if key == NO_KEY else (key,)
            yield head
            for name in registry.names(family):
                inner = head if named is not None else (*head, name)
                yield inner
                yield from ((*inner, option_key) for option_key in options_of(registry.get(family, name)))
            continue
        yield (key,)
        item = item_type(option.annotation)
        for section in [*branches(option.annotation), *(branches(item) if item is not None else ())]:
            if Section in getattr(section, "__mro__", ()):
                inner = (key,) if section in branches(option.annotation) else (key, "*")
                yield inner
                yield from ((*inner, *rest) for rest in schema_paths(section, registry))


def without_marches(result):
    """Put a result that is there already instead of every march, cut maps short; return a function to undo it."""
    from percuss.cli import verify
    from percuss.results import runner
    from percuss.studies import parameters as grammar
    from percuss.studies import perform, study

    def ready(case, overrides=None, **given):
        return result

    values = grammar.values

    def few_values(*given):
        out = values(*given)
        return out if len(out) < 5 or len(out) >= 1000 else [*out[:2], *out[-2:]]

    changes = [
        *((runner, "run", ready), (perform, "run", ready), (study, "make", lambda *given, **more: None)),
        (grammar, "values", few_values),
        (verify, "_run_kit", lambda *given, **more: []),
    ]
    old = [(module, name, getattr(module, name)) for module, name, _ in changes]
    for module, name, new in changes:
        setattr(module, name, new)
    return lambda: [setattr(*one) for one in old]


# --------------------------------------------------------------------------------------------------- survey


def serve(folder, kind, first, last):
    """Try inputs in this process, and tell of each on standard output as it begins and as it ends."""
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    bench = Bench(Ground(folder))
    out = os.fdopen(os.dup(1), "w")
    for warm in range(4):  # imports and caches are no fault of an input
        bench.try_(kind, 10**9 + warm)
    high = peak_memory()
    for seed in range(first, last):
        print(json.dumps([seed]), file=out, flush=True)
        word, detail = bench.try_(kind, seed)
        if word == "slow":  # once more: the machine may have been the reason
            word, detail = bench.try_(kind, seed)
        if peak_memory() > max(MEMORY, high):
            high = peak_memory()
            word, detail = "memory", f"{high / 1e6:.0f} MB; {word}: {detail[:200]}"
        print(json.dumps([seed, word, detail[:600], peak_memory()]), file=out, flush=True)
    bench.close()


def chunk_of_survey(folder, kind, first, last):
    """Return ending and detail of each input, and the peak memory; after a process that breaks down comes another."""
    endings, peak = {}, 0.0
    while first < last:
        command = [sys.executable, __file__, "--serve", str(folder), kind, str(first), str(last)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            watch = threading.Timer(PATIENCE, process.kill)  # of what hangs outside Python
            watch.start()
            seed, under_way = first, False
            for line in process.stdout:
                seed, *ending = json.loads(line)
                under_way = not ending
                if ending:
                    endings[seed] = tuple(ending[:2])
                    peak = max(peak, ending[2])
                    if ending[0] not in GOOD:
                        print(f"{kind} {seed} {ending[0]}: {ending[1]}", flush=True)
                    watch.cancel()
                    watch = threading.Timer(PATIENCE, process.kill)
                    watch.start()
            watch.cancel()
            said = process.stderr.read()
        if process.returncode and not under_way:
            raise RuntimeError(said[-2000:])
        if under_way:
            endings[seed] = "dies", f"exit code {process.returncode}: {said[-300:]}"
        first = seed + 1
    return endings, peak


def survey(count, processes, start=0, kinds=SHARES):
    """Try `count` inputs of some kinds from a seed on, in so many processes; return those that ended badly.

    Returns
    -------
    dict
        Ending and detail by kind and seed.
    """
    bad, counts, peaks = {}, {kind: Counter() for kind in kinds}, Counter()
    with tempfile.TemporaryDirectory(prefix="ground-") as folder, ThreadPoolExecutor(processes) as pool:
        Ground(folder).make()
        chunks = []
        for kind in kinds:
            last = start + max(1, count * SHARES[kind] // sum(SHARES[kind] for kind in kinds))
            chunks += [(kind, first, min(first + CHUNK, last)) for first in range(start, last, CHUNK)]
        done = pool.map(lambda chunk: chunk_of_survey(folder, *chunk), chunks)
        for (kind, *_), (endings, peak) in zip(chunks, done, strict=True):
            peaks[kind] = max(peaks[kind], peak)
            counts[kind].update(word for word, _ in endings.values())
            bad |= {(kind, seed): ending for seed, ending in endings.items() if ending[0] not in GOOD}
    for kind, words in counts.items():
        print(f"{kind:8} {sum(words.values()):6d} inputs: {dict(words)}; peak {peaks[kind] / 1e6:.0f} MB")
    return bad


def main():
    if sys.argv[1] == "--serve":
        serve(sys.argv[2], sys.argv[3], int(sys.argv[4]), int(sys.argv[5]))
        return
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("count", type=int, help="number of inputs")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--start", type=int, default=0, help="first seed")
    parser.add_argument("--kind", action="append", choices=list(SHARES), help="kind of input; repeatable")
    given = parser.parse_args()
    sys.exit(bool(survey(given.count, given.processes, given.start, given.kind or list(SHARES))))


if __name__ == "__main__":
    main()
