"""The scoreboard of the pages, from the shipped study: ``python tests/support/scoreboard.py`` writes it anew."""

import tempfile
from pathlib import Path

import pandas as pd

import pages
import percuss
import places

ROOT = places.ROOT
STUDY = ROOT / "cases" / "studies" / "scoreboard.yaml"
REFERENCE = "tied"
CD, WU = "central-difference", "wu-predictor-corrector"
LAWS, SOFT = ["penalty", "bipenalty", "lagrange"], ["penalty", "bipenalty"]
PRESSED = ["preloaded", "smooth-pulse"]  # the bodies stay pressed together
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
    shown = table[table["case"] != MANY].assign(error=table.apply(cell, axis=1))
    cells = shown.pivot(index=["integrator", "contact"], columns="case", values="error")[shown["case"].unique()]
    pairs = sorted(cells.index, key=lambda pair: (pair[1] == REFERENCE, pair))
    return pages.table(("pair", *cells), ((" + ".join(pair), *cells.loc[pair]) for pair in pairs))


def numbers(table, name):
    """Return one measure of the runs: a row a case, a column an integrator and law."""
    found = table.pivot(index="case", columns=["integrator", "contact"], values=name).astype(float)
    return found.loc[[case for case in table["case"].unique() if case != MANY]]


def span(found, digits=2):
    """Return the smallest and the largest of some numbers as ``a to b``."""
    # all digits that are meant are there: 1.0 and not 1
    low, high = (f"{value:#.{digits}g}".rstrip(".") for value in (found.min(axis=None), found.max(axis=None)))
    return low if low == high else f"{low} to {high}"


def findings(table):
    """Return what the scoreboard shows, as a list in Markdown: every number is made from the rows of the study.

    Raises
    ------
    AssertionError
        If a sentence is no longer true, whatever its numbers.
    """
    error, noise = numbers(table, "force_error_l1"), numbers(table, "noise").drop(PRESSED)
    twin, wu = error[WU, REFERENCE], error[WU]
    late = error[CD, "penalty"] / wu["penalty"]
    over = wu["penalty"] / twin
    overlap = pd.concat([error[scheme].loc[PRESSED, SOFT].div(error[scheme].loc[PRESSED, "lagrange"], axis=0)
                         for scheme in (CD, WU)])  # fmt: skip
    pairs = error.drop(columns=REFERENCE, level="contact")
    best = pairs[[WU, CD]].idxmin(axis=1)  # equal errors of both integrators are one winner: the law
    winners = {law: [case for case, pair in best.items() if pair == (WU, law)] for law in LAWS}
    below = (pairs.min(axis=1) < twin).sum()
    hits = error.index.drop(PRESSED)
    assert late.min() > 1
    assert noise[CD, "penalty"].min() > noise[WU, "penalty"].max()
    matters = late > wu[LAWS].max(axis=1) / wu[LAWS].min(axis=1)
    assert set(matters.index[matters]) == set(hits)
    assert (error[CD, "lagrange"] / wu["lagrange"] - 1).abs().max() < 1e-6
    assert not winners["bipenalty"]
    assert len(winners["lagrange"]) + len(winners["penalty"]) == len(error)
    lines = [
        "**For a penalty it matters most where the contact is evaluated.** The same penalty errs "
        f"{span(late)} times as much with central difference as with Wu's predictor-corrector. Where bodies hit, "
        f"its force rings: the total variation is {span(noise[CD, 'penalty'])} times the exact one, and "
        f"{span(noise[WU, 'penalty'])} times with Wu. With Wu its error is {span(over[hits])} times that of the tied "
        f"twin, and {span(over[PRESSED])} times where bodies stay pressed together ({', '.join(PRESSED)}).",
        f"**Lagrange multipliers err {span(wu['lagrange'] / twin)} times as much as the tied twin**, with either "
        f"integrator. Where bodies stay pressed together, a penalty errs {span(overlap)} times as much as they do, "
        "because it lets the bodies overlap.",
        "**No method is the best everywhere.** Lagrange multipliers have the least error in "
        f"{len(winners['lagrange'])} of {len(error)} cases, a penalty with Wu's predictor-corrector in "
        f"{len(winners['penalty'])} ({', '.join(winners['penalty'])}). The tied twin is a reference and no bound: in "
        f"{below} of {len(error)} cases some pair errs less.",
    ]
    return "".join(f"- {line}\n" for line in lines)


def main():
    """Write the scoreboard and its findings into the pages that have them."""
    with tempfile.TemporaryDirectory() as folder:
        table = rows(folder)
    pages.write("scoreboard", scoreboard(table))
    pages.write("findings", findings(table))


if __name__ == "__main__":
    main()
