"""The scoreboard of the pages, from the shipped study: ``python tests/support/scoreboard.py`` writes it anew."""

import tempfile
from pathlib import Path

import pages
import percuss
import places

ROOT = places.ROOT
STUDY = ROOT / "cases" / "studies" / "scoreboard.yaml"
REFERENCE = "tied"
CD, WU = "central-difference", "wu-predictor-corrector"
MANY = "fifty-impacts"  # late impacts come at another time than the exact ones: its energy is judged, not its force


def rows(folder):
    """Return the rows of the study as a table of pandas."""
    return percuss.study(STUDY, Path(folder) / "scoreboard.sqlite").table


def cell(one):
    """Return the true error of the force in L1 [%], or what kept the run from having one."""
    if one["status"] != "done":
        return one["status"]
    if one["force_error_l1"] != one["force_error_l1"]:
        return "-"
    return f"{100 * one['force_error_l1']:.2g}" + ("*" if one["fragile"] else "")


def scoreboard(table):
    """Return the table in Markdown: a row a pair, a column a case."""
    cases = [case for case in dict.fromkeys(table["case"]) if case != MANY]
    pairs = list(dict.fromkeys(zip(table["integrator"], table["contact"], strict=True)))
    pairs.sort(key=lambda pair: (pair[1] == REFERENCE, pair))
    lines = [f"| pair | {' | '.join(cases)} |", f"| --- |{' --- |' * len(cases)}"]
    for integrator, contact in pairs:
        mine = table[(table["integrator"] == integrator) & (table["contact"] == contact)]
        found = {one["case"]: cell(one) for one in mine.to_dict("records")}
        lines.append(f"| {integrator} + {contact} | {' | '.join(found.get(case, '-') for case in cases)} |")
    return "\n".join(lines) + "\n"


def values(table, name):
    """Return one measure by case, integrator and law."""
    keys = zip(table["case"], table["integrator"], table["contact"], strict=True)
    return dict(zip(keys, table[name].astype(float), strict=True))


def main():
    """Write the scoreboard into its page."""
    with tempfile.TemporaryDirectory() as folder:
        table = rows(folder)
    pages.write("scoreboard", scoreboard(table))


if __name__ == "__main__":
    main()
