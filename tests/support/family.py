"""The results of the whole family, from the shipped study: ``python tests/support/family.py`` writes them anew.

With the file of rows of the study as an argument no run is made. The results are files of data; what the pages say is
made from these files, digits and all, so that whoever has them can make it again.
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

STUDY = places.ROOT / "cases" / "studies" / "family.yaml"
RESULTS = STUDY.parent / "results"  # errors.csv, medians.csv and masses.csv
COURANT, MESHES = 0.5, (1, 4)
PRESSED = ("preloaded", "smooth-pulse")  # the bodies stay pressed together
MANY = "fifty-impacts"  # late impacts come at another time than the exact ones: its energy is judged, not its force
FIRST = ("central-difference", "penalty")  # to which costs and overlaps are compared
USUAL = "lumped"  # the mass of all tables but that of the masses


def cases_of(table):
    """Return the cases whose forces are compared with the exact ones."""
    return [case for case in dict.fromkeys(table["case"]) if case != MANY]


def rows(path, plan=STUDY):
    """Return the rows of the study as a table of pandas."""
    return percuss.study(plan, path).table


def short(value, digits=2):
    """Return a number in two digits, without an exponent where it needs none."""
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0.0:
        return "0"
    if abs(value) >= 10.0**digits:
        return f"{float(f'{value:.{digits}g}'):.0f}"
    return f"{value:.{digits}g}"


def pairs_of(table):
    """Return the pairs of methods that made a run, law by law."""
    done = table[(table["status"] != "refused") & (table["method.mass"] == USUAL)]
    return sorted(set(zip(done["contact"], done["integrator"], strict=True)))


class Point:
    """The rows of one mesh, one Courant number and one mass, by case and pair."""

    def __init__(self, table, refine, courant, mass=USUAL):
        there = table[(table["refine"] == refine) & (table["time.courant"] == courant)]
        there = there[there["method.mass"] == mass]
        self.rows = {(one["case"], one["contact"], one["integrator"]): one for one in there.to_dict("records")}

    def value(self, case, law, integrator, name):
        """Return one number of a run; nan if it was not done."""
        one = self.rows.get((case, law, integrator))
        return float(one[name]) if one is not None and one["status"] == "done" and one[name] is not None else math.nan


def errors(table):
    """Return the table of errors [%]: a row a pair, a column a case."""
    cases = cases_of(table)
    point = Point(table, 1, COURANT)
    lines = [["law", "integrator", *cases]]
    for law, integrator in pairs_of(table):
        cells = []
        for case in cases:
            one = point.rows[case, law, integrator]
            value = point.value(case, law, integrator, "force_error_l1")
            cells.append(short(100.0 * value) if one["status"] == "done" else one["status"])
        lines.append([law, integrator, *cells])
    return lines


def median(values):
    """Return the median of the numbers that are finite, nan if there is none."""
    finite = [value for value in values if math.isfinite(value)]
    return statistics.median(finite) if finite else math.nan


def summary(table):
    """Return the table of medians over the cases: a row a pair."""
    cases = cases_of(table)
    coarse, fine, wide = Point(table, 1, COURANT), Point(table, MESHES[1], COURANT), Point(table, 1, 0.9)
    lines = [
        [
            *("law", "integrator", "error", "order", "C .9", "least kept", "most kept", "of fifty", "noise", "overlap"),
            *("critical C", "cost"),
        ]
    ]
    first = {case: seconds_of_a_node(table, case, *reversed(FIRST)) for case in cases}
    for pair in pairs_of(table):
        values = {name: [coarse.value(case, *pair, name) for case in cases] for name in
                  ("force_error_l1", "noise", "penetration", "critical Courant number")}  # fmt: skip
        finer = [fine.value(case, *pair, "force_error_l1") for case in cases]
        larger = [wide.value(case, *pair, "force_error_l1") for case in cases]
        kept = kept_where_bodies_part(coarse, cases, pair)  # pressed contacts store what they have not given back
        fifty = coarse.rows[MANY, *pair]
        reference = [coarse.value(case, *reversed(FIRST), "penetration") for case in cases]
        orders = [
            math.log(one / other) / math.log(MESHES[1]) if one > 0 and other > 0 else math.nan
            for one, other in zip(values["force_error_l1"], finer, strict=True)
        ]
        limits = [value for value in values["critical Courant number"] if math.isfinite(value)]
        lines.append([
            *pair,
            short(100.0 * median(values["force_error_l1"])),
            short(median(orders)),
            short(median([one / other for one, other in zip(larger, values["force_error_l1"], strict=True)])),
            *least_and_most(kept),
            f"{100.0 * fifty['energy_kept']:.0f}" if fifty["status"] == "done" else fifty["status"],
            short(median(values["noise"])),
            short(median([one / other for one, other in zip(values["penetration"], reference, strict=True)])),
            short(min(limits), 3) if limits else "-",
            short(median([seconds_of_a_node(table, case, *pair) / first[case] for case in cases])),
        ])  # fmt: skip
    return lines


def seconds_of_a_node(table, case, law, integrator):
    """Return the least time of the march for a node and a step, on the finest mesh; nan if there is none."""
    there = table[(table["case"] == case) & (table["contact"] == law) & (table["integrator"] == integrator)]
    there = there[(there["refine"] == MESHES[1]) & (there["status"] == "done")]
    return float((there["seconds"] / there["node_steps"]).min()) if len(there) else math.nan


def kept_where_bodies_part(point, cases, pair):
    """Return the energy that is kept [%] in each case in which the bodies part at the end."""
    values = ((case, point.value(case, *pair, "energy_kept")) for case in cases)
    return [100.0 * value for case, value in values if case not in PRESSED and math.isfinite(value)]


def least_and_most(kept):
    """Return the least and the most of the energies kept, as cells."""
    return (short(min(kept), 4), short(max(kept), 4)) if kept else ("-", "-")


def masses(table):
    """Return the table of the other masses: a row a mass and pair, its errors beside those with the usual mass."""
    cases = cases_of(table)
    usual = Point(table, 1, COURANT)
    head = ["mass", "law", "integrator", "error", "over lumped", "least kept", "most kept", "noise", "lumped noise"]
    lines = [[*head, "critical C"]]
    for mass in dict.fromkeys(table["method.mass"]):
        point = Point(table, 1, COURANT, mass)
        for pair in pairs_of(table) if mass != USUAL else ():
            error, before, noise, noise_before, limit = (
                {case: place.value(case, *pair, name) for case in cases}
                for place, name in (
                    (point, "force_error_l1"),
                    (usual, "force_error_l1"),
                    (point, "noise"),
                    (usual, "noise"),
                    (point, "critical Courant number"),
                )
            )
            both = [case for case in cases if math.isfinite(error[case]) and math.isfinite(before[case])]
            if not both:
                continue
            limits = [value for value in limit.values() if math.isfinite(value)]
            lines.append([
                mass,
                *pair,
                short(100.0 * median(error.values())),
                short(median([error[case] / before[case] for case in both])),
                *least_and_most(kept_where_bodies_part(point, cases, pair)),
                short(median([noise[case] for case in both])),
                short(median([noise_before[case] for case in both])),
                short(min(limits), 3) if limits else "-",
            ])  # fmt: skip
    return lines


# ------------------------------------------------------------------------------------------------- the results, read


def read(name):
    """Return the lines of a file of results as lists of cells, the head first."""
    with (RESULTS / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def write(name, lines):
    """Write the lines of a file of results."""
    with (RESULTS / f"{name}.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)


def number(cell):
    """Return the number of a cell, nan if it has none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


class Tables:
    """The files of results as numbers by (law, integrator), those of the masses by (mass, law, integrator)."""

    def __init__(self):
        head, *lines = read("masses")
        self.masses = {tuple(line[:3]): dict(zip(head[3:], map(number, line[3:]), strict=True)) for line in lines}
        head, *lines = read("errors")
        self.cases = head[2:]
        self.errors = {(law, integrator): [number(cell) for cell in cells] for law, integrator, *cells in lines}
        head, *lines = read("medians")
        self.columns = {
            name: {(line[0], line[1]): number(line[k]) for line in lines} for k, name in enumerate(head) if k > 1
        }  # fmt: skip
        self.cells = {(name, *line[:2]): line[k] for line in lines for k, name in enumerate(head) if k > 1}

    def of(self, name, law=None, integrator=None):
        """Return one column of the medians as numbers, of all pairs or those of a law or an integrator."""
        return {
            pair: value
            for pair, value in self.columns[name].items()
            if law in (None, pair[0]) and integrator in (None, pair[1])
        }


LEAP_FROG = ("central-difference", "wu-predictor-corrector", "viscous-central-difference")
DAMPING = ("viscous-central-difference", "chung-lee", "hulbert-chung", "explicit-hht", "tchamwa-wielgosz", "noh-bathe")


def matrix(tables, name):
    """Return one column of the medians as a table in Markdown: a row a law, a column a scheme."""
    values = tables.of(name)
    laws, schemes = (list(dict.fromkeys(pair[place] for pair in values)) for place in (0, 1))
    schemes.sort(key=lambda scheme: (scheme not in LEAP_FROG[:2], scheme))
    lines = ((f"`{law}`", *(tables.cells.get((name, law, scheme), "-") for scheme in schemes)) for law in laws)
    return pages.table(("law", *schemes), lines)


def figure(tables):
    """Return a figure of the medians: a row a law, a mark a scheme."""
    from matplotlib.figure import Figure

    classes = {
        "central difference": ("o", "#0072B2", {LEAP_FROG[0]}),
        "Wu's predictor-corrector": ("s", "#D55E00", {LEAP_FROG[1]}),
        "schemes that damp": ("^", "#009E73", set(DAMPING)),
        "other schemes": ("x", "#5f5f5f", {"explicit-newmark", "velocity-verlet"}),
    }
    panels = {
        "error": ("median error of the contact force [%]", "log"),
        "noise": ("noise: total variation over the exact one", "log"),
        "of fifty": ("energy left after fifty impacts [%]", "linear"),
    }
    drawn = Figure(figsize=(12.8, 5.2), facecolor="white", layout="constrained")
    places = drawn.subplots(1, len(panels), sharey=True)
    error = tables.of("error")
    laws = sorted({law for law, _ in error}, key=lambda law: (-min(tables.of("error", law).values()), law))
    for axes, (name, (title, scale)) in zip(places, panels.items(), strict=True):
        values = tables.of(name)
        for place, (words, (marker, colour, schemes)) in enumerate(classes.items()):
            points = {pair: value for pair, value in values.items() if pair[1] in schemes}
            heights = [laws.index(law) + 0.27 - 0.18 * place for law, _ in points]  # so that no mark hides another
            axes.plot(list(points.values()), heights, marker, color=colour, label=words, alpha=0.8, markersize=5)
        axes.set(xlabel=title, xscale=scale, yticks=range(len(laws)), yticklabels=laws)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
        axes.grid(color="#dddddd")
    places[0].set_xticks([1, 2, 3, 5, 8, 12])
    places[1].set_xticks([0.5, 1, 2, 4, 8])
    places[2].axvline(100.0, color="#1a1a1a", linewidth=1.0)
    places[2].set_xlim(0.0, 130.0)
    beyond = {value for value in tables.of("of fifty").values() if value > 130.0}
    assert beyond == set(tables.of("of fifty", "nitsche").values()) & beyond
    words = f"up to {short(max(beyond), 3)} → "
    places[2].text(130.0, laws.index("nitsche"), words, ha="right", va="center", color="#5f5f5f")
    drawn.legend(*places[0].get_legend_handles_labels(), loc="outside upper left", ncols=len(classes), frameon=False)
    return drawn


PARTS = {
    "median errors": lambda tables: matrix(tables, "error"),
    "energy after fifty impacts": lambda tables: matrix(tables, "of fifty"),
}


def main():
    """Write the results into their files, and the tables made from them into the pages."""
    given = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        table = percuss.open_study(given[0]).table if given else rows(Path(folder) / "family.sqlite")
    for name, make in (("errors", errors), ("medians", summary), ("masses", masses)):
        write(name, make(table))
    tables = Tables()
    for name, make in PARTS.items():
        pages.write(name, make(tables))


if __name__ == "__main__":
    main()
