"""Rows of bars that the dense oracles can march, and what a run has in common with such a march."""

import numpy as np
from hypothesis import strategies as st

from strategies import number, unlike_bars

LEAP_FROG = ("central-difference", "wu-predictor-corrector")
ENDINGS = ("wall", "fixed", "loaded", "driven", "driven inside", "held inside")


@st.composite
def rows(draw, laws, fewest_elements=1, endings=ENDINGS, integrators=LEAP_FROG):
    """Draw rows of one to three unlike bars, that hit each other or a wall, held, driven or loaded at an end.

    Elements may be unlike, or single; two contacts may share the first end.
    """
    names, bodies, contacts = draw(unlike_bars(fewest_elements))
    if len(names) > 1 and draw(st.booleans()):  # a wall that the second bar does not see: two contacts at one end
        first = bodies["a"]["bar"]["length"]
        contacts["stop"] = {"body": "a.right", "wall": round(first + draw(st.sampled_from([0.0, 0.01])), 6)}
    ending = draw(st.sampled_from(endings)) if len(names) > 1 else "wall"
    last, end, loads = bodies[names[-1]], f"{names[-1]}.right", {}
    if ending == "fixed":
        last["fixed"] = ["right"]
    elif ending == "held inside":
        last["fixed"] = ["left"]
    elif ending.startswith("driven"):
        on = end if ending == "driven" else f"{names[-1]}.left"
        loads["drive"] = {"prescribed-velocity": draw(number(-0.5, 0.5)), "on": on}
    else:
        wall = round(last["at"] + last["bar"]["length"] + draw(st.sampled_from([0.0, 0.05])), 6)
        contacts["wall"] = {"body": end, "wall": wall}
    if ending == "loaded":
        loads["push"] = {"constant": draw(number(0.1, 1.0)), "on": end}
    if not ending.startswith("driven") and "driven" in endings and draw(st.booleans()):
        loads["weight"] = {"gravity": draw(number(-2.0, 2.0))}
    return {
        "percuss": 1, "bodies": bodies, "contacts": contacts, "loads": loads,
        "method": {"integrator": draw(st.sampled_from(integrators)), "contact": dict(draw(st.sampled_from(laws)))},
        "time": {"steps": 100, "courant": draw(number(0.15, 0.5)), "on_unstable": "warn"},
        "record": {"probes": [f"{name}.{side}" for name in names for side in ("left", "right")]},
    }  # fmt: skip


def agrees(result, truth, within):
    """Hold the histories of a run against those of a dense march; `within` are shares of the peaks."""
    found = {name: result.arrays[name] for name in ("contact_force", "gap")}
    found |= {name: result.arrays[name][:, :, 0] for name in ("displacement", "velocity")}
    nodes = [truth.bars.node(probe) for probe in result.coordinates["probe"]]
    expected = {"contact_force": truth.force, "gap": truth.gap}
    expected |= {"displacement": truth.u[:, nodes], "velocity": truth.v[:, nodes]}
    for name, values in expected.items():
        assert np.abs(found[name] - values).max() <= within[name] * np.abs(values).max(), name
    energy = result.arrays["kinetic_energy"] + result.arrays["elastic_energy"]
    assert np.abs(energy - truth.energy).max() <= 4.0 * within["velocity"] * np.abs(truth.energy).max()
    if not np.isnan(truth.end_force).all():
        assert np.nanmax(np.abs(result.arrays["contact_force_end"] - truth.end_force)) <= (
            within["contact_force"] * np.nanmax(np.abs(truth.end_force))
        )
    assert result.summary["momentum"]["error"] <= 1e-12
    assert result.summary["energy"]["ledger_error"] <= 1e-12
