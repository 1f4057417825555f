"""The results of the study of solids: ``python tests/support/solids_study.py [ROWS]`` writes them anew.

As for the whole family, the results are a file of data, and the table of the page is made from this file.
"""

import csv
import sys
import tempfile
from pathlib import Path

import pages
import percuss
import places
from family import short

STUDY = places.ROOT / "cases" / "studies" / "solids.yaml"
RESULTS = STUDY.parent / "results" / "solids.csv"
BARS = STUDY.parent / "results" / "errors.csv"
CD, WU = "central-difference", "wu-predictor-corrector"
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


def main():
    """Write the results into their file, and their table into the page."""
    given = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        study = percuss.open_study(given[0]) if given else percuss.study(STUDY, Path(folder) / "solids.sqlite")
        lines = rows(study.table)
    with RESULTS.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)
    pages.write("errors on surfaces", matrix(Results()))


if __name__ == "__main__":
    main()
