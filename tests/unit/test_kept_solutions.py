"""Runs of the same problem share its exact solution, and only they do."""

import math

import numpy as np

import percuss
import places
from percuss.results import exact


def test_runs_that_differ_in_their_methods_alone_share_their_exact_solution(monkeypatch):
    case = percuss.load(
        places.ROOT / "cases" / "hunek.yaml", {"bodies.short.bar.elements": 5, "bodies.long.bar.elements": 10}
    )
    exact._solved.cache_clear()
    problems, engine = [], case.registry.get("solutions", "bars-in-a-row")
    solve = engine.solve
    monkeypatch.setattr(engine, "solve", lambda *given: problems.append(given) or solve(*given))
    first = percuss.run(case)
    forces = first.arrays["contact_force_exact"].copy()
    first.arrays["contact_force_exact"][:] = 7.0  # a reader may change his result
    again = percuss.run(case, {"method.contact": "lagrange"})
    assert len(problems) == 1
    assert first.solution is again.solution
    assert np.array_equal(again.arrays["contact_force_exact"], forces)
    last_bits = [{"bodies.short.velocity": math.nextafter(0.1, 1.0)}, {"bodies.short.area": math.nextafter(1.0, 2.0)}]
    for change in (*last_bits, {"time.end": 1.9}):
        before = len(problems)
        percuss.run(case, change)
        assert len(problems) == before + 1
