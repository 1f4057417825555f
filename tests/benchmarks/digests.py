"""Digests of the numbers percuss makes, to hold two versions of the code against each other bit for bit.

Record them with one version, and compare with the other::

    python tests/benchmarks/digests.py --write before.json
    python tests/benchmarks/digests.py --against before.json

Every shipped case is run with every pair of integrator and contact law, compiled and as plain Python (a few steps),
and certified; the exact solution of each case is evaluated; small studies are made. Times, versions and file names are
left out.
"""

import argparse
import contextlib
import hashlib
import io
import itertools
import json
import sys
import tempfile
from pathlib import Path

import numpy as np

import percuss

ROOT = Path(__file__).resolve().parents[2]
CASES = sorted((ROOT / "cases").glob("*.yaml"))
INTEGRATORS = ["central-difference", "wu-predictor-corrector", "noh-bathe"]
CONTACTS = ["penalty", "bipenalty", "lagrange", "tied"]
TIMES = {"seconds", "provenance", "machine", "compiled_why", "hint"}
PLAIN_STEPS = 25

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


def of_run(case, overrides, *, compiled):
    """Return digests of histories and summary of a run, or of why there is none."""
    overrides = {"time.on_unstable": "warn", **overrides}
    try:
        result = percuss.run(percuss.load(case, overrides), compiled=compiled)
    except percuss.RunError as stopped:
        result = stopped.result
    except percuss.PercussError as refused:
        return {"refused": str(refused).replace(str(ROOT), "")}
    arrays = {name: np.asarray(array) for name, array in result.arrays.items()}
    parts = {"arrays": digest(arrays)}
    return {**parts, **{f"summary.{key}": digest(value) for key, value in result.summary.items() if key not in TIMES}}


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
            # Histories of a run that files of an exact solution had at first; they kept digests comparable.
            nothing = np.zeros_like(arrays["time"])
            arrays |= {"contact_work": nothing, "contact_energy": nothing}
            arrays |= {"energy_growth": arrays["energy_error"], "time_half": arrays["time"]}
    lines = [line for line in text.getvalue().splitlines() if folder not in line and " s" not in line[-12:]]
    return {"arrays": digest(arrays), "text": digest(lines)}


def of_study(plan):
    """Return digests of the rows of a study, but for what they cost."""
    with tempfile.TemporaryDirectory() as folder:
        made = percuss.study(plan, out=Path(folder) / "rows.sqlite", workers=1)
        rows = [dict(row) for row in made.as_records()]
    kept = []
    for row in rows:
        flat = {k: v for k, v in row.items() if not any(word in k for word in ("second", "key", "when", "percuss"))}
        kept.append(digest(flat))
    return {"rows": digest(sorted(kept)), "count": len(kept)}


def everything(quick=False):
    """Yield a name and digests of all that is looked at."""
    pairs = list(itertools.product(INTEGRATORS, CONTACTS))
    cases = [(path.stem, path) for path in CASES] + list(OTHERS.items())
    for name, case in cases[:2] if quick else cases:
        for integrator, contact in pairs:
            methods = {"method.integrator": integrator, "method.contact": contact}
            label = f"{name} | {integrator} | {contact}"
            yield f"{label} | compiled", of_run(case, methods, compiled=True)
            short = {**methods, "time.end": None, "time.steps": PLAIN_STEPS}
            yield f"{label} | plain", of_run(case, short, compiled=False)
        if not isinstance(case, dict):
            yield f"{name} | exact", of_exact(case)
        for by in ("pencil", "black-box", "closed-form"):
            try:
                vary = {"method.contact": ["penalty", "bipenalty"], "method.integrator": INTEGRATORS}
                rows = percuss.stability(percuss.load(case), vary=vary, by=[by])
                yield f"{name} | stability by {by}", {"rows": digest(rows)}
            except percuss.PercussError as refused:
                yield f"{name} | stability by {by}", {"refused": str(refused).replace(str(ROOT), "")}
    for name, vary in (("refined", {"refine": [1, 2]}), ("softer", {"method.contact.beta_s": [0.1, 1.0]})):
        plan = {
            "percuss-study": 1,
            "cases": [str(ROOT / "cases" / "hunek.yaml"), str(ROOT / "cases" / "unlike.yaml")],
            "methods": {"integrators": INTEGRATORS[:2], "contacts": ["penalty", "bipenalty"]},
            "vary": vary,
            "tied": True,
            "keep": {"histories": 10},
        }
        yield f"study | {name}", of_study(plan)


def main():
    """Write digests, or compare with those of another version."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--quick", action="store_true", help="two cases only")
    chosen = parser.parse_args()
    made = {}
    for name, value in everything(chosen.quick):
        made[name] = value
        print(f"{len(made):4d} {name}", file=sys.stderr, end="\r")
    if chosen.write:
        chosen.write.write_text(json.dumps(made, indent=1), encoding="utf-8")
    if not chosen.against:
        return 0
    before = json.loads(chosen.against.read_text(encoding="utf-8"))
    differing = 0
    for name, value in made.items():
        changed = [key for key in {*value, *before.get(name, {})} if value.get(key) != before.get(name, {}).get(key)]
        if changed:
            differing += 1
            print(f"{name}: {', '.join(sorted(changed))}")
    print(f"{len(made)} compared, {differing} differ")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
