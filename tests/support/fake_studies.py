"""Studies for the tests of what is made of one, whose numbers are drawn: of several cases, and a large one."""

import itertools
from pathlib import Path

import numpy as np
import pandas as pd

from strategies import hunek

BAR = {"material": {"young": 100, "density": 0.01}, "area": 1}
TWO_BARS = {**hunek(20), "title": "Two bars", "record": {}}
INTEGRATORS = ("central-difference", "wu-predictor-corrector")
CONTACTS = ("penalty", "bipenalty", "lagrange")
VARIED = {"method.contact.beta_s": [0.05, 0.2, 0.5, 1.0, 3.0], "time.courant": [0.3, 0.5, 0.9], "refine": [1, 2]}


LAW = """\
import os, signal, time
from dataclasses import dataclass
from typing import Annotated
from percuss import ContactLaw
from percuss.methods.interfaces import Gt, LinearLaw, Unit


@dataclass(frozen=True)
class Mine(ContactLaw):
    '''A law of mine.'''

    name = "mine"
    summary = "Mine"

    beta_s: Annotated[float, Gt(0), Unit("1")] = 0.25

    def bind(self, points, dt):
        FATE
        return LinearLaw("explicit", 1.0 / (SOFT * self.beta_s * points.stiffness))
"""


def law(folder, soft=1.0, fate="pass"):
    """Write a plug-in of a contact law, so many times as soft, that does something whenever it is bound."""
    path = folder / "mine.py"
    path.write_text(LAW.replace("SOFT", str(soft)).replace("FATE", fate))
    return path


class FakeStudy:
    """What a study gives a report."""

    def __init__(self, table, kept=None, **given):
        self.title = given.get("title", "Penalty stiffness of two bars")
        self.spec = {
            "title": self.title,
            "question": "How stiff may a penalty be before its force is noise?",
            "cases": ["two-bars.yaml"],
            "methods": {"integrator": list(INTEGRATORS), "contact": list(CONTACTS)},
            "vary": given.get("vary", VARIED),
        }
        self.provenance = {
            "percuss": "0.1.0",
            "versions": {"python": "3.11.2", "numpy": "2.3.1", "numba": "0.62.0"},
            "machine": {"system": "Linux", "processor": "x86_64", "cores": 2},
            "plugins": [{"file": "damped.py", "sha256": "0f" * 32}],
        }
        self.table, self.units = table, {}
        self.kept = kept or {}
        self.path = Path("fake.sqlite")
        about = {"case", "integrator", "contact", "status", "reason", "said_by", "fragile", "key", *self.spec["vary"]}
        self.columns = {str(name): f"what {name} is" for name in table.columns if name not in about}

    @property
    def with_histories(self):
        return set(self.kept)

    def histories(self, key):
        return self.kept.get(key)


def several_cases(seed=2):
    """Return a study of four cases, whose numbers are drawn: each pair at each value that it has, some runs lost."""
    rng = np.random.default_rng(seed)
    lines = []
    scales = {"hunek": 1.0, "carpenter": 3.0, "doyen-impact": 0.2, "cradle": 1.5}
    pairs = itertools.product(INTEGRATORS, (*CONTACTS, "tied"))
    for (case, scale), (integrator, contact) in itertools.product(scales.items(), list(pairs)):
        stiff = contact in {"lagrange", "tied"}  # without a stiffness to vary
        for beta, refine in itertools.product((None,) if stiff else (0.1, 0.3, 1.0, 3.0), (1, 2, 4)):
            error = scale * (0.1 / refine + 0.02 * (beta or 0.2) + 0.005 / (beta or 0.4)) * 10 ** rng.normal(0, 0.08)
            status = "done"
            if (integrator, contact) == ("central-difference", "penalty") and (beta > 2 or (beta == 1 and refine == 4)):
                status = "unstable"
            if (case, integrator, contact) == ("cradle", "wu-predictor-corrector", "bipenalty"):
                status = "refused"
            measured = {
                "force_error_l1": 0.6 * error if contact == "tied" else error,
                "noise": 2 * error,
                "penetration": 0.0 if stiff else 0.01 / beta,
                "node_steps": 400 * refine * (60 * refine + 2),
                "seconds.march": 4e-4 * refine**2 * 10 ** rng.normal(0, 0.1),
            }
            lines.append({
                "case": case, "integrator": integrator, "contact": contact, "method.contact.beta_s": beta,
                "refine": refine, "status": status, "reason": "" if status == "done" else "a reason", "said_by": "",
                "fragile": None, **{name: value if status == "done" else None for name, value in measured.items()},
                "key": f"s{len(lines):04d}",
            })  # fmt: skip
    varied = {"method.contact.beta_s": [0.1, 0.3, 1.0, 3.0], "refine": [1, 2, 4]}
    return FakeStudy(pd.DataFrame(lines), title="Several cases", vary=varied)


def drawn_study(count, seed=1):
    """Return a study of `count` rows whose numbers are drawn, as of a sample over four values."""
    rng = np.random.default_rng(seed)
    pairs = np.array(list(itertools.product(INTEGRATORS, CONTACTS)))[rng.integers(0, 6, count)]
    beta, courant = 10 ** rng.uniform(-2, 2, count), rng.uniform(0.1, 1.2, count)
    ratio, refine = 10 ** rng.uniform(-1, 1, count), 2.0 ** rng.integers(0, 6, count)
    unstable = courant * np.sqrt(1 + 0.4 * beta) > 2.0 + 0.3 * rng.normal(size=count)
    error = (0.2 / refine + 0.05 / beta + 0.02 * beta) * 10 ** rng.normal(0, 0.15, count)
    measured = {
        "force_error_l1": error,
        "force_error_l2": 1.7 * error,
        "impulse_error": 0.1 * error,
        "displacement_error": 0.05 * error,
        "noise": 0.5 * beta * 10 ** rng.normal(0, 0.2, count),
        "overshoot": 0.1 * np.sqrt(beta),
        "penetration": 0.01 / beta,
        "peak_force": 0.05 * (1 + 0.1 * np.sqrt(beta)),
        "energy_kept": 1 - 0.01 * error,
        "energy_max": 1 + 0.001 * rng.random(count),
        "courant_critical": 2 / np.sqrt(1 + 0.4 * beta),
        "steps": np.round(400 * refine / courant),
        "node_steps": np.round(400 * refine / courant) * (60 * refine + 2),
        "seconds.march": 1e-6 * 400 * refine**2 / courant * 10 ** rng.normal(0, 0.1, count),
    }
    measured = {name: np.where(unstable, np.nan, values) for name, values in measured.items()}
    step = rng.integers(3, 900, count)
    reason = [f"energy grew by {s} in step {s}" if bad else "" for s, bad in zip(step, unstable, strict=True)]
    varied = {"method.contact.beta_s": beta, "time.courant": courant, "method.contact.ratio": ratio, "refine": refine}
    table = pd.DataFrame(
        {
            "case": np.array(["hunek", "carpenter", "doyen-impact"])[rng.integers(0, 3, count)],
            "integrator": pairs[:, 0],
            "contact": pairs[:, 1],
            **varied,
            "status": np.where(unstable, "unstable", "done"),
            "reason": reason,
            "said_by": "",
            "fragile": rng.random(count) < 0.01,
            **measured,
            "key": [f"k{k:07d}" for k in range(count)],
        }
    )
    return FakeStudy(table, title=f"{count} drawn runs", vary=dict.fromkeys(varied, "drawn"))
