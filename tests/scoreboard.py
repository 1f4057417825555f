"""The scoreboard of the README, from the shipped study: ``python tests/scoreboard.py`` writes it anew."""

import sys
import tempfile
from pathlib import Path

import percuss

ROOT = Path(__file__).parent.parent
STUDY = ROOT / "cases" / "studies" / "scoreboard.yaml"
BEGIN, END = "<!-- scoreboard -->\n", "<!-- end of scoreboard -->\n"
FLOOR = "tied"


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
    cases = list(dict.fromkeys(table["case"]))
    pairs = list(dict.fromkeys(zip(table["integrator"], table["contact"], strict=True)))
    pairs.sort(key=lambda pair: (pair[1] == FLOOR, pair))
    lines = [f"| pair | {' | '.join(cases)} |", f"| --- |{' --- |' * len(cases)}"]
    for integrator, contact in pairs:
        mine = table[(table["integrator"] == integrator) & (table["contact"] == contact)]
        found = {one["case"]: cell(one) for one in mine.to_dict("records")}
        lines.append(f"| {integrator} + {contact} | {' | '.join(found.get(case, '-') for case in cases)} |")
    return "\n".join(lines) + "\n"


def main():
    """Write the scoreboard into the README."""
    with tempfile.TemporaryDirectory() as folder:
        made = scoreboard(rows(folder))
    readme = ROOT / "README.md"
    before, _, rest = readme.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    readme.write_text(f"{before}{BEGIN}{made}{END}{after}", encoding="utf-8")
    sys.stdout.write(made)


if __name__ == "__main__":
    main()
