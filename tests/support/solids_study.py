"""The results of the study of solids: ``python tests/support/solids_study.py [ROWS]`` writes them anew.

As for the whole family, the results are a file of data, and what the page says is made from this file.
"""

import csv
import math
import statistics
import sys
import tempfile
from pathlib import Path

import pages
import percuss
import places
from family import short, span

STUDY = places.ROOT / "cases" / "studies" / "solids.yaml"
RESULTS = STUDY.parent / "results" / "solids.csv"
BARS = STUDY.parent / "results" / "errors.csv"
CD, WU, DAMPS = "central-difference", "wu-predictor-corrector", "tchamwa-wielgosz"
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
KEYS = ("case", "law", "integrator", "pairing", "refine")


def rows(table):
    """Return head and lines of the file of results: the runs that were made, errors and energies in per cent."""
    lines = [[*KEYS, *NUMBERS, "judge"]]
    for one in table.to_dict("records"):
        if one["status"] != "done":
            continue
        values = [one[path] * (100.0 if name in PER_CENT else 1.0) for name, path in NUMBERS.items()]
        digits = [6 if name == "kept" else 3 for name in NUMBERS]
        cells = [short(value, digit) for value, digit in zip(values, digits, strict=True)]
        judge = "estimate" if isinstance(one["estimated.solution"], str) else "exact"
        keys = [*(one[name] for name in ("case", "contact", "integrator", "method.pairing")), f"{one['refine']:g}"]
        lines.append([*keys, *cells, judge])
    return lines


class Results:
    """The file of results: numbers by case, law, integrator, pairing and refinement."""

    def __init__(self):
        with RESULTS.open(encoding="utf-8", newline="") as file:
            self.lines = list(csv.DictReader(file))
        self.cases = list(dict.fromkeys(line["case"] for line in self.lines))
        with BARS.open(encoding="utf-8", newline="") as file:
            self.bars = {(line["law"], line["integrator"]): line for line in csv.DictReader(file)}

    def of(self, name, refine="1", **which):
        """Return the numbers of one column by the keys that are not asked for."""
        left = [key for key in KEYS if key not in which and key != "refine"]
        return {
            tuple(line[key] for key in left): float(line[name])
            for line in self.lines
            if line["refine"] == refine and line[name] != "-" and all(line[key] == which[key] for key in which)
        }


def spread(values, digits=2):
    """Return the least and the largest of some numbers, as ``a to b``."""
    return span([value for value in values if math.isfinite(value)], digits)


def findings(results):
    """Return what the results show, as a list in Markdown.

    Raises
    ------
    AssertionError
        If a sentence is no longer true, whatever its numbers.
    """
    error, moved, kept = (results.of(name) for name in ("error", "displacement", "kept"))
    coarse = results.of("error", "0.5")
    # Strips and their bars.
    ratios = [
        error[strip, law, scheme, "mortar"] / float(results.bars[law, scheme][bars])
        for strip, bars in STRIPS.items()
        for law in LAWS
        for scheme in (CD, WU)
    ]
    assert 0.95 < min(ratios) <= max(ratios) < 1.05
    # Laws.
    exact = [error[case, "lagrange", scheme, "node-to-segment"] for case in CURVED for scheme in (CD, WU)]
    soft = [error[case, law, scheme, "mortar"] for case in CURVED for law in PENALTIES for scheme in (CD, WU)]
    assert max(exact) < 0.2 * min(soft)
    rings = [
        results.of("noise")[case, "penalty", CD, "node-to-segment"]
        / results.of("noise")[case, "penalty", WU, "node-to-segment"]
        for case in FLAT
    ]
    assert min(rings) > 1.5
    # Pairings.
    flat = [
        error[strip, law, scheme, "node-to-segment"] / error[strip, law, scheme, "mortar"]
        for strip in STRIPS for law in LAWS for scheme in (CD, WU)
    ]  # fmt: skip
    assert max(flat) < 1.2
    apart = {
        name: max(
            max(found) / min(found)
            for law in LAWS
            if (
                found := [values[key] for pairing in PAIRINGS if (key := ("tilted-blocks", law, WU, pairing)) in values]
            )
        )
        for name, values in (("force", error), ("motion", moved))
    }
    assert max(apart.values()) < 1.6
    walls = [
        abs(error[case, law, scheme, "mortar"] - error[case, law, scheme, "node-to-segment"])
        for case in CURVED for law in LAWS for scheme in (CD, WU)
    ]  # fmt: skip
    assert max(walls) == 0.0
    # Energy.
    grown = results.of("growth")
    never = [grown[key] for key in grown if key[1] in ("regularised-lagrange", "lagrange")]
    assert max(never) < 1e-10
    adds = [kept[case, "bipenalty", CD, pairing] - 100.0 for case in results.cases for pairing in PAIRINGS
            if (case, "bipenalty", CD, pairing) in kept]  # fmt: skip
    most = max(adds)
    assert most > 0.5
    assert kept["tilted-blocks", "bipenalty", CD, "mortar"] - 100.0 == most
    keeps = [abs(kept[key] - 100.0) for key in kept if key[1] == "penalty" and key[2] == CD]
    assert max(keeps) < 0.3
    # Meshes.
    orders = {
        law: [
            math.log2(coarse[case, law, WU, "node-to-segment"] / error[case, law, WU, "node-to-segment"])
            for case in results.cases
        ]
        for law in ("lagrange", "penalty")
    }
    middle = {law: statistics.median(values) for law, values in orders.items()}
    assert all(0.5 < value < 1.3 for value in middle.values())
    sentences = [
        f"**A strip errs as its bar.** With `mortar`, between meshes that do not match, every pair errs "
        f"{spread(ratios)} times as much in strip-impact and strip-unlike as in hunek and unlike. "
        "So what the [family](RESULTS.md) shows of bars holds for strips.",
        "**A round body needs a law without compliance.** By default a contact point of a penalty "
        "yields as a part of a "
        f"cell does, which is much where few points touch: `lagrange` errs by {spread(exact)} % on the disk and the "
        f"ball, `penalty`, `bipenalty` and `regularised-lagrange` by {spread(soft)} %.",
        f"**A penalty rings with central difference on surfaces too.** Between flat faces the total variation of its "
        f"force is {spread(rings)} times that with Wu's predictor-corrector.",
        "**Between flat faces the pairing matters little.** `node-to-segment` errs up to "
        f"{short(max(flat))} times as "
        "much as `mortar` where meshes do not match. At a wall both are the same.",
        "**Where faces are not parallel the pairings agree**, as each takes the normals of the facets that it meets. "
        "In tilted-blocks, whose faces enclose 1.7 degrees, the errors of the force by two pairings differ by a factor "
        f"of {short(apart['force'])} at most, those of the motion by {short(apart['motion'])} (Wu's "
        "predictor-corrector, any law).",
        "**`lagrange` and `regularised-lagrange` never add energy**, with any pairing, in any of the "
        "cases. With central "
        f"difference `bipenalty` adds up to {short(most)} %, in tilted-blocks, and `penalty` keeps the energy to "
        f"{short(max(keeps))} %.",
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
    best = {case: min((value, key[1:]) for key, value in error.items() if key[0] == case) for case in results.cases}
    sharp = {case: error[case, "lagrange", WU, "mortar"] for case in results.cases}
    assert all(sharp[case] <= best[case][0] for case in CURVED)
    damped = {case: error[case, "penalty", WU, "mortar"] for case in STRIPS}
    assert max(damped.values()) < 1.3 * max(best[case][0] for case in STRIPS)
    tilted = error["tilted-blocks", "lagrange", WU, "mortar"]
    assert tilted <= best["tilted-blocks"][0]
    sentences = [
        "**Name the surface with the corner first, and keep the defaults: `lagrange`, `wu-predictor-corrector`, "
        f"`mortar`.** They err by {spread([sharp[case] for case in CURVED])} % on round bodies and by {short(tilted)} "
        "% on tilted blocks, less than any other law, and no energy comes in.",
        "**Flat faces that meet squarely, and a force without jumps: `penalty` with "
        "`wu-predictor-corrector`.** It errs by "
        f"{spread(damped.values())} % there.",
        "**A contact that yields, with a proof that no energy comes in: `regularised-lagrange`.** Its default "
        "stiffness is soft for round bodies: choose it as stiff as you can.",
        "**Gauss points only where a law has a compliance**: with `lagrange` they are refused.",
    ]
    return "".join(f"- {sentence}\n" for sentence in sentences)


def matrix(results):
    """Return the errors of three laws with each pairing, in each case, as a table in Markdown."""
    error = results.of("error")
    lines = [f"| law | pairing | {' | '.join(results.cases)} |", f"| --- | --- |{' --- |' * len(results.cases)}"]
    for law in ("lagrange", "penalty", "regularised-lagrange"):
        for pairing in PAIRINGS:
            cells = [error.get((case, law, WU, pairing)) for case in results.cases]
            if any(cell is not None for cell in cells):
                shown = " | ".join("-" if cell is None else short(cell) for cell in cells)
                lines.append(f"| `{law}` | `{pairing}` | {shown} |")
    return "\n".join(lines) + "\n"


PAIRINGS = ("mortar", "node-to-segment", "gauss-points")
CURVED, FLAT = ("disk-on-wall", "ball-on-wall"), (*STRIPS, "box-impact")
PENALTIES = ("penalty", "bipenalty", "regularised-lagrange")
LAWS = (*PENALTIES, "lagrange")
PARTS = {"what solids show": findings, "which method when for solids": advice, "errors on surfaces": matrix}


def main():
    """Write the results, and what they show, into their file and their page."""
    given = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        study = percuss.open_study(given[0]) if given else percuss.study(STUDY, Path(folder) / "solids.sqlite")
        lines = rows(study.table)
    with RESULTS.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)
    results = Results()
    for name, make in PARTS.items():
        pages.write(name, make(results))


if __name__ == "__main__":
    main()
