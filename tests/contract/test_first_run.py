"""A method is asked everything twice before the first run of its source, and not again until the source changes."""

import contextlib
import weakref

import numpy as np
import pytest

import percuss
from percuss import cache
from percuss.march.model import Model
from percuss.methods import first_run
from percuss.methods.plugin_calls import answer
from percuss.methods.registry import Registry
from percuss.testing.kit import checks_of, perform
from percuss.testing.subject import Subject

PLUGIN = '''
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from percuss import ContactLaw


class Bound(NamedTuple):
    stiffness: np.ndarray


@dataclass(frozen=True)
class Counted(ContactLaw):
    """A penalty that counts how often it is asked."""

    name = "counted"
    summary = "a penalty"
    beta_s: float = 0.25

    def bind(self, points, dt):
        Counted.counts["bind"] += 1
        return Bound(self.beta_s * points.stiffness)

    @staticmethod
    def multipliers(bound, trial, multiplier):
        Counted.counts["multipliers"] += 1
        for p in range(multiplier.size):
            multiplier[p] = max(-bound.stiffness[p] * trial.gap[p], 0.0)


class Counts(dict):
    """What no trial call takes for a change of the law: its text is always the same."""

    def __repr__(self):
        return "counts"


Counted.counts = Counts(bind=0, multipliers=0)
'''
CASE = {
    "percuss": 1,
    "bodies": {
        "a": {"bar": {"length": 1.0, "elements": 4}, "material": {"young": 100.0, "density": 0.01}, "area": 1.0},
    },
    "contacts": {"w": {"body": "a.right", "wall": 1.0}},
    "time": {"steps": 4, "courant": 0.5},
}


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """Return a function that makes a model in what stands for a new process, and counts the calls."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    file = tmp_path / "counted.py"
    file.write_text(PLUGIN)

    def ask(*, edit="", beta_s=0.25, again=False):
        monkeypatch.setattr(first_run, "_ANSWERS", weakref.WeakKeyDictionary())
        with file.open("a") as text:
            text.write(edit)
        registry = Registry.load([file])
        law = registry.get("contacts", "counted")
        law.counts.update(bind=0, multipliers=0)
        method = {"contact": {"name": "counted", "beta_s": beta_s}}
        asking = first_run.asked_again(law, Subject.of(law, registry).answers) if again else contextlib.nullcontext()
        with asking:
            Model(percuss.load({**CASE, "method": method}, registry=registry))
        return tuple(law.counts.values())

    return ask


ONCE = (1, 0)


def test_a_source_is_asked_twice_until_it_has_answered(asked):
    calls, kernel_calls = asked()
    assert calls == 2
    assert kernel_calls > 0
    assert kernel_calls % 2 == 0
    assert asked() == ONCE


def test_a_changed_source_and_other_options_are_asked(asked):
    first = asked()
    assert asked(edit="# edited\n") == first
    assert asked() == ONCE
    assert asked(beta_s=0.5) == first
    assert asked(beta_s=0.5) == asked() == ONCE


def test_the_kit_asks_always(asked):
    first = asked()
    assert asked(again=True) == first
    assert asked() == ONCE


def test_without_a_cache_folder_each_process_asks(asked, monkeypatch):
    monkeypatch.setattr(cache, "cache_folder", lambda: None)
    assert asked() == asked() > ONCE


def test_a_source_that_answers_wrongly_is_asked_again(asked, tmp_path):
    random = PLUGIN.replace("bound.stiffness[p] *", "np.random.rand() * bound.stiffness[p] *")
    assert random != PLUGIN
    (tmp_path / "counted.py").write_text(random)
    for _ in range(2):
        with pytest.raises(percuss.PluginError, match="multipliers gives another answer when it is asked the same"):
            asked()


def test_one_right_answer_does_not_outweigh_a_wrong_one(tmp_path, monkeypatch):
    """In one process: a load that shakes now and then is watched until it is given up, whatever it answered before."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "shaky.py").write_text(
        "from dataclasses import dataclass\nimport numpy as np\nimport percuss\n\n\n"
        "@dataclass(frozen=True)\nclass Shaky(percuss.Load):\n    's'\n    name = 'shaky'\n    summary = 's'\n\n"
        "    def amplitude(self, time):\n        return np.full(np.shape(time), np.random.rand() * (time > 0.5))\n"
    )
    cls = Registry.load([tmp_path / "shaky.py"]).get("loads", "shaky")
    answer(cls(), "amplitude", np.zeros(3))
    for _ in range(5):
        with pytest.raises(percuss.PluginError, match="amplitude gives another answer"):
            answer(cls(), "amplitude", np.ones(3))
    first_run.note_answers()
    monkeypatch.setattr(first_run, "_ANSWERS", weakref.WeakKeyDictionary())
    with pytest.raises(percuss.PluginError, match="amplitude gives another answer"):
        answer(cls(), "amplitude", np.ones(3))


def test_a_cached_property_is_no_change_of_the_component(tmp_path):
    (tmp_path / "ramp.py").write_text(
        "from dataclasses import dataclass\nfrom functools import cached_property\nimport percuss\n\n\n"
        "@dataclass(frozen=True)\nclass Ramp(percuss.Load):\n    'r'\n    name = 'cached-ramp'\n    summary = 'r'\n\n"
        "    @cached_property\n    def slope(self):\n        return 2.0\n\n"
        "    def amplitude(self, time):\n        return self.slope * time\n"
    )
    load = Registry.load([tmp_path / "ramp.py"]).get("loads", "cached-ramp")()
    assert answer(load, "amplitude", np.ones(2)).tolist() == [2.0, 2.0]
    type(load).amplitude = lambda self, time: self.__dict__.update(order=3) or time
    with pytest.raises(percuss.PluginError, match="amplitude changes the component itself"):
        answer(load, "amplitude", np.ones(2))


def test_the_kit_asks_a_method_of_percuss_in_its_checks_alone():
    """Runs of the same process are those of any other: nothing is asked twice because the kit was there before."""
    law = Registry.load().get("contacts", "penalty")
    subject = Subject.of(law)
    found = [perform(check, subject, partner) for check, partner in checks_of(subject) if check.first]
    assert [outcome.status for outcome in found] == ["passed"]
    assert subject.answers.now
    assert not first_run.is_watched(law())
