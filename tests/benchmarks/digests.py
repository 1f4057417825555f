"""Digests of the numbers percuss makes, to hold two versions of the code against each other bit for bit.

Record them with one version, and compare with the other on the same machine::

    python tests/benchmarks/digests.py --write before.json
    python tests/benchmarks/digests.py --against before.json

Every shipped case is run with every pair of some integrators and contact laws, compiled and as plain Python (a few
steps), and certified; the exact solution of each case is evaluated; small studies are made. Small cases are run with
every registered method: `digest_cases` says which combinations of methods are all there and which are chosen. For each
integrator and law the critical step is searched by each criterion, and the waves at a closed contact are measured.
Times, versions and file names are left out. Solutions and measures are registered too, but only these studies and the
runs that an exact solution covers use them.

Beside ``before.json`` with the digests, ``before.npz`` keeps the numbers and words themselves. With it each difference
is listed: the name of the array or entry, and its largest change over its largest value. Lengths are measured by the
largest length of the run, energies by its largest energy and shares of it by 1, as some histories are nothing but
round-off. What an older record does not have is counted and not compared.

A record takes 5 to 6 minutes of one processor, and ``--quick``, with each method and each feature once, less than one.
"""

import argparse
import contextlib
import hashlib
import io
import itertools
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import percuss
from percuss.methods.registry import Registry

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from benchmarks import digest_cases  # noqa: E402 - the folder of this script alone is on the path

LONG = {"oblique-spheres", "shallow-ironing"}  # minutes each
CASES = sorted(path for path in (ROOT / "cases").glob("*.yaml") if path.stem not in LONG)
INTEGRATORS = ["central-difference", "wu-predictor-corrector", "noh-bathe"]
CONTACTS = ["penalty", "bipenalty", "lagrange", "tied"]
CRITERIA = ("linear-laws", "black-box")
RECORDED_AS = {"linear-laws": "pencil"}  # what records of earlier versions call a criterion
TIMES = {"seconds", "provenance", "machine", "compiled_why", "threads", "hint"}
PLAIN_STEPS = 25
QUICK_CASE = "hunek"

MOST_ROWS = 64  # kept of an array, at equal distances
ROUND_OFF = 1e-12  # a smaller change, as a share of the largest value, is called round-off
MOST_ENTRIES = 6  # listed of a run, besides its arrays
# Numbers by a part of their path: those of one group are measured by the largest value in the group, shares by 1.
GROUPS = {
    "error": "share",
    "growth": "share",
    "energy": "energy",
    "work": "energy",
    "gap": "length",
    "displacement": "length",
}

BAR = {"bar": {"length": 1.0, "elements": 8}, "material": {"young": 100.0, "density": 0.01}, "area": 1.0}
TURNED = {**BAR["bar"], "direction": [0.6, 0.8]}
OTHERS = {
    "turned in the plane, with gravity and a table": {
        "percuss": 1,
        "bodies": {
            "a": {**BAR, "bar": TURNED, "at": [0.0, 0.0], "velocity": [0.06, 0.08]},
            "b": {**BAR, "bar": TURNED, "at": [0.606, 0.808], "fixed": ["right"]},
        },
        "contacts": {"tip": {"between": ["a.right", "b.left"]}},
        "loads": {
            "pull": {"gravity": [0.0, -0.1]},
            "push": {"table": {"time": [0.0, 0.1, 0.3], "value": [0.0, 0.4, 0.1]}, "on": "a.left"},
        },
        "method": {"integrator": "central-difference", "contact": "penalty"},
        "time": {"end": 0.4, "courant": 0.4},
    },
    "three bars at one point, a wall, and a drive that lets go": {
        "percuss": 1,
        "bodies": {
            "a": {**BAR, "velocity": 0.3},
            "b": {**BAR, "at": 1.0, "area": 0.5},
            "c": {**BAR, "at": 1.0, "area": 0.7, "bar": {"length": 0.7, "elements": 5}},
        },
        "contacts": {
            "ab": {"between": ["a.right", "b.left"]},
            "ac": {"between": ["a.right", "c.left"]},
            "stop": {"body": "b.right", "wall": 2.01},
        },
        "loads": {"hold": {"prescribed-velocity": 0.1, "on": "c.right", "from": 0.05, "until": 0.2}},
        "method": {"integrator": "central-difference", "contact": "penalty"},
        "time": {"end": 0.5, "courant": 0.3},
    },
}


class Looked(NamedTuple):
    """Digests by part of what was looked at, or the text of a refusal; and the numbers and words themselves."""

    digests: dict[str, Any]
    content: dict[str, Any]


class Task(NamedTuple):
    """Something to look at: its name, a function that returns what it `Looked` at, and the arguments of that."""

    name: str
    look: Callable[..., Looked]
    arguments: tuple[Any, ...]
    quick: bool = False


def digest(value, path=""):
    """Return a hash of nested numbers, text and arrays; of floating-point numbers every bit counts."""
    out = hashlib.sha256()

    def feed(item):
        if isinstance(item, dict):
            for key in sorted(item):
                if key not in TIMES:
                    out.update(repr(str(key)).encode())
                    feed(item[key])
        elif isinstance(item, (list, tuple)):
            out.update(b"[")
            for entry in item:
                feed(entry)
            out.update(b"]")
        elif isinstance(item, np.ndarray):
            out.update(f"{item.dtype}{item.shape}".encode())
            out.update(np.ascontiguousarray(item).tobytes() if item.dtype != object else repr(item.tolist()).encode())
        elif isinstance(item, (float, np.floating)):
            out.update(float(item).hex().encode())
        else:
            out.update(repr(item.item() if isinstance(item, np.generic) else item).encode())

    feed(value)
    return out.hexdigest()[:16]


def looked(content):
    """Return the digests of each part of something."""
    return Looked({key: digest(value) for key, value in content.items()}, content)


def refusal(refused):
    """Return the text of a refusal in place of digests."""
    text = str(refused).replace(str(ROOT), "")
    return Looked({"refused": text}, {"refused": text})


def of_run(case, overrides, compiled, nudge=False):
    """Return digests of histories, fields and summary of a run, or of why there is none."""
    try:
        result = percuss.run(percuss.load(case, overrides), compiled=compiled, nudge=nudge)
    except percuss.RunError as stopped:
        result = stopped.result
    except percuss.PercussError as refused:
        return refusal(refused)
    certificate = result.summary["certificate"]
    certificate["by"] = RECORDED_AS.get(certificate["by"], certificate["by"])
    content = {"arrays": {name: np.asarray(array) for name, array in result.arrays.items()}}
    if result.field_arrays:
        content["fields"] = {name: np.asarray(array) for name, array in result.field_arrays.items()}
    return looked(content | {f"summary.{key}": value for key, value in result.summary.items() if key not in TIMES})


def of_exact(case):
    """Return a digest of what the command prints and draws from the exact solution alone."""
    from percuss.cli.main import app

    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()) as text:
        out = Path(folder) / "exact.nc"
        with contextlib.suppress(SystemExit):
            app(["run", str(case), "--exact-only", "-o", str(out)], standalone_mode=False)
        arrays = {}
        if out.exists():
            saved = percuss.open_result(out)
            arrays = {name: np.asarray(array) for name, array in saved.arrays.items()}
    lines = [line for line in text.getvalue().splitlines() if folder not in line and " s" not in line[-12:]]
    return looked({"arrays": arrays, "text": lines})


def of_stability(case, vary, by):
    """Return a digest of critical steps."""
    try:
        rows = percuss.stability(percuss.load(case), vary=vary, by=[by])
        return looked({"rows": [{**row, "by": RECORDED_AS.get(by, by)} for row in rows]})
    except percuss.PercussError as refused:
        return refusal(refused)


def of_waves(case):
    """Return digests of the waves that a closed contact reflects and transmits."""
    try:
        return looked(vars(percuss.waves(percuss.load(case))))
    except percuss.PercussError as refused:
        return refusal(refused)


def of_study(plan):
    """Return digests of the rows of a study, but for what they cost."""
    with tempfile.TemporaryDirectory() as folder:
        made = percuss.study(plan, out=Path(folder) / "rows.sqlite", workers=1)
        rows = [dict(row) for row in made.as_records()]
    kept = {}
    for row in rows:
        flat = {k: v for k, v in row.items() if not any(word in k for word in ("second", "key", "when", "percuss"))}
        kept.setdefault(digest(flat), []).append(flat)
    digests = sorted(key for key, alike in kept.items() for _ in alike)
    return Looked({"rows": digest(digests), "count": len(digests)}, {"rows": [kept[key][0] for key in digests]})


def shipped() -> Iterator[Task]:
    """Yield what is looked at of the shipped cases, of `OTHERS` and of studies."""
    for name, case in [(path.stem, path) for path in CASES] + list(OTHERS.items()):
        quick = name == QUICK_CASE
        for integrator, contact in itertools.product(INTEGRATORS, CONTACTS):
            methods = {
                "method.integrator": integrator,
                "method.contact": contact,
                "time.on_unstable": "warn",
            }
            label = f"{name} | {integrator} | {contact}"
            yield Task(f"{label} | compiled", of_run, (case, methods, True), quick)
            short = {**methods, "time.end": None, "time.steps": PLAIN_STEPS}
            yield Task(f"{label} | plain", of_run, (case, short, False), quick)
        if not isinstance(case, dict):
            yield Task(f"{name} | exact", of_exact, (case,), quick)
        for by in CRITERIA:
            vary = {"method.contact": ["penalty", "bipenalty"], "method.integrator": INTEGRATORS}
            yield Task(f"{name} | stability by {RECORDED_AS.get(by, by)}", of_stability, (case, vary, by), quick)
    for name, vary in (("refined", {"refine": [1, 2]}), ("softer", {"method.contact.beta_s": [0.1, 1.0]})):
        plan = {
            "percuss-study": 1,
            "cases": [str(ROOT / "cases" / "hunek.yaml"), str(ROOT / "cases" / "unlike.yaml")],
            "methods": {"integrators": INTEGRATORS[:2], "contacts": ["penalty", "bipenalty"]},
            "vary": vary,
            "tied": True,
            "keep": {"histories": 10},
        }
        yield Task(f"study | {name}", of_study, (plan,))


def registered(registry) -> Iterator[Task]:
    """Yield what is looked at of small cases with every registered method."""
    runs = digest_cases.Runs(registry)
    for run in runs.every():
        yield Task(run.name, of_run, (run.case, {}, run.compiled, run.nudge), run.quick)
    for run in runs.pairs():
        yield Task(f"waves in {run.name}", of_waves, (run.case,), run.quick)
    laws = [examples[0].entry for examples in runs.all["contacts"].values()]
    for integrator, by in itertools.product(runs.names("integrators"), CRITERIA):
        vary = {"method.contact": laws, "method.integrator": [integrator]}
        arguments = (runs.case(digest_cases.EQUAL_BARS), vary, by)
        name = f"stability of equal bars | {integrator} | by {RECORDED_AS.get(by, by)}"
        yield Task(name, of_stability, arguments, by == "linear-laws")


def done(task):
    """Return what a task looked at."""
    return task.look(*task.arguments)


def all_done(tasks, jobs):
    """Yield what each task looked at, in the order of the tasks, by a number of processes."""
    if jobs == 1:
        yield from map(done, tasks)
        return
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(done, tasks, chunksize=16)


def leaves(value, path=""):
    """Yield the path and value of each number or array, as floats, and of each text in nested values."""
    if isinstance(value, dict):
        for key in sorted(value, key=str):
            if key not in TIMES:
                yield from leaves(value[key], f"{path}.{key}" if path else str(key))
    elif isinstance(value, (list, tuple)) and any(isinstance(entry, (dict, list, tuple)) for entry in value):
        for number, entry in enumerate(value):
            yield from leaves(entry, f"{path}[{number}]")
    elif isinstance(value, (bool, str)) or value is None:
        yield path, str(value)
    else:
        array = np.asarray(value)
        if array.dtype.kind == "c":
            array = np.stack([array.real, array.imag], axis=-1)
        yield path, array.astype(float) if array.dtype.kind in "iuf" else str(array.tolist())


def numbers_and_words(content):
    """Return arrays, each thinned to some rows, and texts by path."""
    numbers, words = {}, {}
    for path, value in leaves(content):
        if isinstance(value, str):
            words[path] = value
        elif value.ndim and len(value) > MOST_ROWS:
            numbers[path] = value[np.linspace(0, len(value) - 1, MOST_ROWS).astype(int)]
            words[f"{path} rows"] = str(len(value))
        else:
            numbers[path] = value
    return numbers, words


def write_contents(path, contents):
    """Write the numbers and words of each task: one long array, and the names and shapes of its parts."""
    layout = {
        name: {"numbers": {key: array.shape for key, array in numbers.items()}, "words": words}
        for name, (numbers, words) in contents.items()
    }
    parts = [array.ravel() for numbers, _ in contents.values() for array in numbers.values()]
    text = np.frombuffer(json.dumps(layout).encode(), dtype=np.uint8)
    np.savez_compressed(path, layout=text, numbers=np.concatenate([np.zeros(0), *parts]))


def read_contents(path):
    """Return the numbers and words of each task; none where there is no such file."""
    if not path.exists():
        return {}
    with np.load(path) as file:
        layout, numbers = json.loads(file["layout"].tobytes()), file["numbers"]
    contents, at = {}, 0
    for name, kept in layout.items():
        arrays = {}
        for key, shape in kept["numbers"].items():
            size = int(np.prod(shape))
            arrays[key] = numbers[at : at + size].reshape(shape)
            at += size
        contents[name] = arrays, kept["words"]
    return contents


class Change(NamedTuple):
    """A change of an array, an entry or a text: its path, its size over the largest value, and words that tell it."""

    path: str
    size: float
    words: str

    @property
    def of_array(self):
        """Whether it is that of a history or a field."""
        return self.path.startswith(("arrays.", "fields."))


def group_of(path):
    """Return the name of those numbers whose largest value measures a change."""
    of_run = path.startswith(("arrays.", "summary."))
    return next((group for word, group in GROUPS.items() if of_run and word in path), path)


def changes(before, now):
    """Return all changes between the numbers and words of one task in two versions, arrays first and by size."""
    (numbers, words), (new_numbers, new_words) = before, now
    largest = {"share": 1.0}
    for path, array in numbers.items():
        finite = np.abs(array[np.isfinite(array)])
        largest[group_of(path)] = max(largest.get(group_of(path), 0.0), finite.max(initial=0.0))
    found = []
    for path in {**numbers, **words, **new_numbers, **new_words}:
        if path in numbers and path in new_numbers:
            found += change_of_numbers(path, numbers[path], new_numbers[path], largest[group_of(path)])
        elif path in words and path in new_words:
            if words[path] != new_words[path]:
                found.append(Change(path, np.inf, change_of_words(words[path], new_words[path])))
        else:
            known = path in numbers or path in words
            still = path in new_numbers or path in new_words
            found.append(Change(path, np.inf, "another kind" if known and still else "gone" if known else "new"))
    return sorted(found, key=lambda change: (not change.of_array, -change.size))


def change_of_words(before, now):
    """Return two texts from shortly before the place where they begin to differ."""
    alike = sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], zip(before, now, strict=False)))
    start = max(alike - 30, 0)
    return f"{before[start : start + 150]!r} -> {now[start : start + 150]!r}"


def change_of_numbers(path, before, now, largest):
    """Yield the change of an array or number, if there is one."""
    if before.shape != now.shape:
        yield Change(path, np.inf, f"shape {before.shape} -> {now.shape}")
        return
    same = ((before == now) & (np.signbit(before) == np.signbit(now))) | (np.isnan(before) & np.isnan(now))
    if same.all():
        return
    if not np.array_equal(np.isfinite(before), np.isfinite(now)) or not np.isfinite(before[~same]).all():
        yield Change(path, np.inf, "infinite or no number in other places")
        return
    difference = np.abs(now - before)[~same].max()
    share = difference / largest if largest > 0.0 else np.inf if difference else 0.0
    negligible = before.ndim == 0 and max(abs(before), abs(now)) <= ROUND_OFF  # as the errors of ledgers that close
    yield Change(path, min(share, ROUND_OFF) if negligible else share, f"{share:.1e}")


def told(changed, found):
    """Return a line about the parts whose digests have changed, with each change if the record keeps the numbers."""
    if not found:
        return ", ".join(changed) + ("; only in rows that the record leaves out" if found == [] else "")
    arrays = [change for change in found if change.of_array]
    entries = [change for change in found if not change.of_array]
    words = [f"{change.path.partition('.')[2]} {change.words}" for change in arrays]
    words += [f"{change.path} {change.words}" for change in entries[:MOST_ENTRIES]]
    if len(entries) > MOST_ENTRIES:
        words.append(f"and {len(entries) - MOST_ENTRIES} more entries")
    return "; ".join([", ".join(changed), *words])


def compare(before, made, contents_before, contents):
    """Print each difference between two records and return how many tasks differ."""
    new = [name for name in made if name not in before]
    differing, only_round_off, only_refusals = 0, 0, 0
    for name, digests in made.items():
        old = before.get(name, digests)
        changed = sorted(key for key in {**digests, **old} if digests.get(key) != old.get(key))
        if not changed:
            continue
        differing += 1
        only_refusals += "refused" in digests and "refused" in old
        found = changes(contents_before[name], contents[name]) if name in contents_before else None
        only_round_off += bool(found) and max(change.size for change in found) <= ROUND_OFF
        print(f"{name}: {told(changed, found)}")
    print(f"{len(made) - len(new)} compared, {differing} differ", end="")
    if differing:
        print(f", {only_round_off} of them by round-off, {only_refusals} in the words of a refusal", end="")
    print(f"; {len(new)} are not in the record, as {new[0]}" if new else "")
    return differing


def main():
    """Write digests, or compare with those of another version."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", type=Path, help="file of the digests; numbers go into the .npz beside it")
    parser.add_argument("--against", type=Path, help="file of the digests to compare with")
    parser.add_argument("--quick", action="store_true", help="each method and each feature once")
    parser.add_argument("--only", default="", metavar="TEXT", help="only what has this text in its name")
    parser.add_argument("--jobs", type=int, default=1, help="number of processes")
    chosen = parser.parse_args()
    began = time.perf_counter()
    tasks = [*shipped(), *registered(Registry.load())]
    names = {task.name for task in tasks}
    tasks = [task for task in tasks if (task.quick or not chosen.quick) and chosen.only in task.name]
    made, contents = {}, {}
    for task, result in zip(tasks, all_done(tasks, chosen.jobs), strict=True):
        made[task.name] = result.digests
        contents[task.name] = numbers_and_words(result.content)
        if sys.stderr.isatty():
            print(f"{len(made):5d} of {len(tasks)} {task.name:.90}\x1b[K", file=sys.stderr, end="\r")
    refused = sum("refused" in digests for digests in made.values())
    print(f"{len(made)} looked at in {time.perf_counter() - began:.0f} s, {refused} of them refused")
    if chosen.write:
        chosen.write.write_text(json.dumps(made, indent=1), encoding="utf-8")
        write_contents(chosen.write.with_suffix(".npz"), contents)
    if not chosen.against:
        return 0
    before = json.loads(chosen.against.read_text(encoding="utf-8"))
    differing = compare(before, made, read_contents(chosen.against.with_suffix(".npz")), contents)
    gone = [name for name in before if name not in names]
    for name in gone:
        print(f"{name}: no longer made")
    return 1 if differing or gone else 0


if __name__ == "__main__":
    sys.exit(main())
