"""The results of the study of solids: ``python tests/support/solids_study.py [ROWS]`` writes them anew.

As for the whole family, the results are a file of data, and what the page says is made from this file.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import family
import pages
import percuss
import places
from family import short, span

STUDY = places.ROOT / "cases" / "studies" / "solids.yaml"
RESULTS = STUDY.parent / "results" / "solids.csv"
CD, WU = "central-difference", "wu-predictor-corrector"
STRIPS = {"strip-impact": "hunek", "strip-unlike": "unlike"}  # each with the case of bars that it is
NUMBERS = {  # columns in per cent but for the last two
    "error": "force_error_l1",
    "displacement": "displacement_error",
    "kept": "energy_kept",
    "growth": "growth",
    "noise": "noise",
    "overlap": "penetration",
}
PER_CENT = ("error", "displacement", "kept", "growth")
DIGITS = {**dict.fromkeys(NUMBERS, 3), "kept": 6}
KEYS = ("case", "law", "integrator", "pairing", "refine")


def rows(table):
    """Return the table of results: the runs that were made, errors and energies in per cent."""
    done = table[table["status"] == "done"].rename(columns={"contact": "law", "method.pairing": "pairing"})
    cells = {
        name: (done[path] * (100.0 if name in PER_CENT else 1.0)).map(
            lambda value, name=name: short(value, DIGITS[name])
        )
        for name, path in NUMBERS.items()
    }
    judge = done["estimated.solution"].notna().map({True: "estimate", False: "exact"})
    return done[list(KEYS)].assign(refine=done["refine"].map("{:g}".format), **cells, judge=judge)


class Results:
    """The file of results, and that of the bars."""

    def __init__(self):
        self.rows = pd.read_csv(RESULTS, na_values="-")
        self.cases = list(self.rows["case"].unique())
        self.bars = family.numbers(family.read("errors"))

    def of(self, name, refine=1.0):
        """Return one column on a mesh, by case, law, integrator and pairing."""
        there = self.rows[self.rows["refine"] == refine]
        return there.set_index(list(KEYS[:4]))[name].dropna().sort_index()


def findings(results):
    """Return what the results show, as a list in Markdown.

    Raises
    ------
    AssertionError
        If a sentence is no longer true, whatever its numbers.
    """
    error, moved, kept, noise, grown = (
        results.of(name) for name in ("error", "displacement", "kept", "noise", "growth")
    )
    both, pairings = [CD, WU], error.unstack("pairing")
    # Strips and their bars.
    ratios = pd.concat([
        pairings.loc[strip, "mortar"].loc[LAWS, both] / results.bars.loc[(LAWS, both), bars]
        for strip, bars in STRIPS.items()
    ])  # fmt: skip
    assert 0.95 < ratios.min() <= ratios.max() < 1.05
    # Laws.
    exact = pairings["node-to-segment"].loc[CURVED, "lagrange", both]
    soft = pairings["mortar"].loc[CURVED, PENALTIES, both]
    assert exact.max() < 0.2 * soft.min()
    ringing = noise.loc[FLAT, "penalty", both, "node-to-segment"].unstack("integrator")
    rings = ringing[CD] / ringing[WU]
    assert rings.min() > 1.5
    # Pairings.
    flat = (pairings["node-to-segment"] / pairings["mortar"]).loc[list(STRIPS), LAWS, both]
    assert flat.max() < 1.2
    tilted = {
        name: values.loc["tilted-blocks", LAWS, WU].unstack("pairing")
        for name, values in (("force", error), ("motion", moved))
    }
    apart = {name: (found.max(axis=1) / found.min(axis=1)).max() for name, found in tilted.items()}
    assert max(apart.values()) < 1.6
    walls = (pairings["mortar"] - pairings["node-to-segment"]).loc[CURVED, LAWS, both]
    assert walls.abs().max() == 0.0
    # Energy.
    assert grown.loc[:, ["lagrange", "regularised-lagrange"]].max() < 1e-10
    most = kept.loc[:, "bipenalty", CD].max() - 100.0
    assert most > 0.5
    assert kept["tilted-blocks", "bipenalty", CD, "mortar"] - 100.0 == most
    keeps = (kept.loc[:, "penalty", CD] - 100.0).abs().max()
    assert keeps < 0.3
    # Meshes.
    orders = np.log2(results.of("error", 0.5) / error).loc[:, ["lagrange", "penalty"], WU, "node-to-segment"]
    middle = orders.groupby("law").median()
    assert middle.between(0.5, 1.3).all()
    sentences = [
        f"**A strip errs as its bar.** With `mortar`, between meshes that do not match, every pair errs "
        f"{span(ratios)} times as much in strip-impact and strip-unlike as in hunek and unlike. "
        "So what the [family](RESULTS.md) shows of bars holds for strips.",
        "**A round body needs a law without compliance.** By default a contact point of a penalty "
        "yields as a part of a "
        f"cell does, which is much where few points touch: `lagrange` errs by {span(exact)} % on the disk and the "
        f"ball, `penalty`, `bipenalty` and `regularised-lagrange` by {span(soft)} %.",
        f"**A penalty rings with central difference on surfaces too.** Between flat faces the total variation of its "
        f"force is {span(rings)} times that with Wu's predictor-corrector.",
        "**Between flat faces the pairing matters little.** `node-to-segment` errs up to "
        f"{short(flat.max())} times as "
        "much as `mortar` where meshes do not match. At a wall both are the same.",
        "**Where faces are not parallel the pairings agree**, as each takes the normals of the facets that it meets. "
        "In tilted-blocks, whose faces enclose 1.7 degrees, the errors of the force by two pairings differ by a factor "
        f"of {short(apart['force'])} at most, those of the motion by {short(apart['motion'])} (Wu's "
        "predictor-corrector, any law).",
        "**`lagrange` and `regularised-lagrange` never add energy**, with any pairing, in any of the "
        "cases. With central "
        f"difference `bipenalty` adds up to {short(most)} %, in tilted-blocks, and `penalty` keeps the energy to "
        f"{short(keeps)} %.",
        f"**Finer meshes help as they do with bars.** Twice as fine, the observed order of the force error is "
        f"{short(middle['lagrange'])} with `lagrange` and {short(middle['penalty'])} with `penalty` "
        "(median over the cases, "
        "Wu's predictor-corrector, `node-to-segment`).",
    ]  # fmt: skip
    return "".join(f"- {sentence}\n" for sentence in sentences)


def advice(results):
    """Return which method to take when, as a list in Markdown.

    Raises
    ------
    AssertionError
        If a sentence is no longer true, whatever its numbers.
    """
    error = results.of("error")
    best, sharp = error.groupby("case").min(), error.loc[:, "lagrange", WU, "mortar"]
    damped = error.loc[list(STRIPS), "penalty", WU, "mortar"]
    assert (sharp <= best)[[*CURVED, "tilted-blocks"]].all()
    assert damped.max() < 1.3 * best[list(STRIPS)].max()
    sentences = [
        "**Name the surface with the corner first, and keep the defaults: `lagrange`, `wu-predictor-corrector`, "
        f"`mortar`.** They err by {span(sharp[CURVED])} % on round bodies and by {short(sharp['tilted-blocks'])} "
        "% on tilted blocks, less than any other law, and no energy comes in.",
        "**Flat faces that meet squarely, and a force without jumps: `penalty` with "
        "`wu-predictor-corrector`.** It errs by "
        f"{span(damped)} % there.",
        "**A contact that yields, with a proof that no energy comes in: `regularised-lagrange`.** Its default "
        "stiffness is soft for round bodies: choose it as stiff as you can.",
        "**Gauss points only where a law has a compliance**: with `lagrange` they are refused.",
    ]
    return "".join(f"- {sentence}\n" for sentence in sentences)


def matrix(results):
    """Return the errors of three laws with each pairing, in each case, as a table in Markdown."""
    cells = results.of("error").xs(WU, level="integrator").unstack("case")
    laws = ["lagrange", "penalty", "regularised-lagrange"]
    lines = cells.loc[laws, results.cases].reindex(laws, level="law").reindex(PAIRINGS, level="pairing").itertuples()
    return pages.table(
        ("law", "pairing", *results.cases),
        ((f"`{law}`", f"`{pairing}`", *map(short, line)) for (law, pairing), *line in lines),
    )


PAIRINGS = ("mortar", "node-to-segment", "gauss-points")
CURVED, FLAT = ["disk-on-wall", "ball-on-wall"], [*STRIPS, "box-impact"]
PENALTIES = ["penalty", "bipenalty", "regularised-lagrange"]
LAWS = [*PENALTIES, "lagrange"]
PARTS = {"what solids show": findings, "which method when for solids": advice, "errors on surfaces": matrix}


def main():
    """Write the results, and what they show, into their file and their page."""
    given = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        study = percuss.open_study(given[0]) if given else percuss.study(STUDY, Path(folder) / "solids.sqlite")
        rows(study.table).to_csv(RESULTS, index=False, lineterminator="\n")
    results = Results()
    for name, make in PARTS.items():
        pages.write(name, make(results))


if __name__ == "__main__":
    main()
