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
MOST_SPENT = 2  # change of the energy in all these impacts [%]; round-off changes it by about as much
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

    def kept(self):
        """Return the least and the most energy kept [%] by pair."""
        most = self.columns["most kept"]
        return {pair: (least, most[pair]) for pair, least in self.columns["least kept"].items()}


def span(values, digits=2):
    """Return the smallest and the largest of some numbers as ``a to b``."""
    low, high = short(min(values), digits), short(max(values), digits)
    return low if low == high else f"{low} to {high}"


LEAP_FROG = ("central-difference", "wu-predictor-corrector", "viscous-central-difference")
DAMPING = ("viscous-central-difference", "chung-lee", "hulbert-chung", "explicit-hht", "tchamwa-wielgosz", "noh-bathe")
EXACT = ("lagrange", "uzawa", "moreau-jean", "paoli-schatzman")


def findings(tables):
    """Return what the tables show, as a list in Markdown.

    Raises
    ------
    AssertionError
        If a sentence is no longer true, whatever its numbers.
    """
    cd, wu, _ = LEAP_FROG
    error, noise, order, wide = (tables.of(name) for name in ("error", "noise", "order", "C .9"))
    kept, cost, fifty = tables.kept(), tables.of("cost"), tables.of("of fifty")
    # 1
    damped = [pair for pair in error if pair[0] == "penalty" and pair[1] in DAMPING]
    assert max(noise[pair] for pair in damped) < noise["penalty", cd]
    assert max(error[pair] for pair in damped) < error["penalty", cd]
    assert noise["penalty", wu] < noise["penalty", cd]
    assert error["penalty", wu] < min(error[pair] for pair in damped)
    lost_by_damping = [100.0 - kept[pair][0] for pair in damped]
    lost_by_wu = 100.0 - kept["penalty", wu][0]
    assert min(*lost_by_damping, lost_by_wu) > 100.0 - kept["penalty", cd][0]
    # 2
    exact = {pair: value for pair, value in error.items() if pair[0] in EXACT}
    best = min(error.values())
    winners = sorted(pair for pair, value in error.items() if value == best)
    assert all(law in EXACT for law, _ in winners)
    assert max(exact.values()) <= min(value for (law, _), value in error.items() if law not in EXACT)
    # 3
    sharp = [pair for pair in order if math.isfinite(order[pair])]
    assert max(order[pair] for pair in sharp) < 1.1
    # 4
    conserving = ("energy-conserving-penalty", cd)
    assert all(abs(value - 100.0) < 0.01 for value in kept[conserving])
    assert error[conserving] > 1.5 * error["lagrange", cd]
    assert all(abs(fifty[pair] - 100.0) <= MOST_SPENT for pair in (conserving, ("penalty", cd)))
    assert fifty["lagrange", cd] < 50.0
    assert max(fifty[pair] for pair in (*damped, ("penalty", wu)) if math.isfinite(fifty[pair])) < 90.0
    gains = {pair: high - 100.0 for pair, (_, high) in kept.items() if pair[0] == "nitsche" and pair[1] not in DAMPING}
    others = max(high for pair, (_, high) in kept.items() if pair[0] != "nitsche") - 100.0
    assert min(gains.values()) > others
    # 5
    undamped = [wide[law, cd] for law in EXACT]
    assert max(undamped) < 0.8
    one_step = [wide["penalty", scheme] for scheme in ("chung-lee", "hulbert-chung", "tchamwa-wielgosz")]
    assert min(one_step) > 0.9
    # 6
    groups = {}
    for pair, values in tables.errors.items():
        groups.setdefault(tuple(values), []).append(pair)
    same = [group for group in groups.values() if len(group) > 1]
    assert any({("lagrange", cd), ("paoli-schatzman", cd)} <= set(group) for group in same)
    stages = [value for pair, value in cost.items() if pair[1] not in LEAP_FROG]
    assert min(value for pair, value in error.items() if pair[1] not in LEAP_FROG) >= error["lagrange", cd]
    # 8
    without_mass, consistent = (
        {pair[1:]: line for pair, line in tables.masses.items() if pair[0] == mass}
        for mass in ("redistributed", "reciprocal")
    )
    assert max(line["noise"] for line in without_mass.values()) < noise["penalty", cd]
    calmed = without_mass["penalty", cd]
    assert calmed["over lumped"] < 1.0
    exact_without_mass = [without_mass[law, cd] for law in EXACT if (law, cd) in without_mass]
    ringing = consistent["lagrange", cd]
    assert all(line["noise"] < line["lumped noise"] < ringing["noise"] for line in exact_without_mass)
    lines = [
        "**A penalty rings with central difference. Damping in the scheme and Wu's predictor-corrector reduce the "
        "noise and the error; both cost energy.** With central difference the penalty errs by "
        f"{short(error['penalty', cd])} %, and the total variation of its force is {short(noise['penalty', cd])} times "
        "the exact one. With the schemes that damp high frequencies it errs by "
        f"{span([error[pair] for pair in damped])} %, with {span([noise[pair] for pair in damped])} times the exact "
        f"variation, and loses up to {span(lost_by_damping)} % of the energy where bodies part. With Wu's "
        f"predictor-corrector it errs by {short(error['penalty', wu])} %, less than with any of them, and loses up to "
        f"{short(lost_by_wu)} %.",
        "**Laws with no overlap, or nearly none, err least, with every scheme that takes them.** They err by "
        f"{span(exact.values())} %. The least error, {short(best)} %, belongs to "
        f"{', '.join(f'`{law}`' for law in dict.fromkeys(law for law, _ in winners))}.",
        "**The order of the scheme does not show in the contact force.** With a mesh and a step four times finer the "
        f"error falls with an observed order of {span([order[pair] for pair in sharp])} (median over the cases), for "
        "schemes of first and of second order.",
        "**A method that keeps the energy exactly is not therefore accurate.** With central difference "
        "`energy-conserving-penalty` keeps the energy to 0.01 % and errs "
        f"{short(error[conserving] / error['lagrange', cd])} times as much as `lagrange`, which loses up to "
        f"{short(100.0 - kept['lagrange', cd][0])} %.",
        f"**Small losses add up.** In `{MANY}` the exact bar strikes fifty times and loses nothing. The same pair and "
        f"the penalty with central difference keep the energy to {MOST_SPENT} %. `lagrange` loses more than half of "
        "it. A penalty loses more than a tenth with a scheme that damps, or with Wu's predictor-corrector. These "
        "numbers depend on round-off.",
        "**`nitsche` adds energy.** With a scheme that does not damp it adds up to "
        f"{short(max(gains.values()))} % in a case. Every other law adds "
        f"{short(max(others, 0.0))} % at most, fifty impacts apart.",
        f"**The largest step is the best, unless the scheme damps.** From a Courant number of {COURANT} to 0.9 the "
        f"error of exact contact with central difference falls to {span(undamped)} of its value, because the mesh "
        "disperses less, and the run costs less. With the schemes of one stage that damp, the error of a penalty "
        f"changes by a factor of {span(one_step)}.",
        f"**Some names are the same method.** Of {len(tables.errors)} pairs {len(tables.errors) - len(groups)} repeat "
        "the errors of another pair to every digit shown. `paoli-schatzman` without restitution is `lagrange`. "
        "`regularised-lagrange` is a matched `bipenalty` with Wu's predictor-corrector. Laws with a kernel give the "
        "same with either leap-frog scheme. `velocity-verlet` is central difference with velocities at other times, "
        "and `explicit-newmark` without damping is `velocity-verlet`.",
        f"**A multi-stage scheme costs {span(stages)} times as much as central difference for each node and step**, "
        "and no pair with one errs less than `lagrange` with central difference. A part of this cost is percuss: its "
        "loop for leap-frog schemes on uniform bars is the faster one.",
        "**An end without mass calms a penalty and makes exact contact less accurate.** With central difference, mass "
        f"redistribution reduces the noise of the penalty from {short(noise['penalty', cd])} to "
        f"{short(calmed['noise'])} and its error to {short(calmed['over lumped'])} of its value. Exact contact has a "
        f"noise of {span([line['noise'] for line in exact_without_mass])} instead of "
        f"{span([line['lumped noise'] for line in exact_without_mass])}, and errs "
        f"{span([line['over lumped'] for line in exact_without_mass])} times as much.",
        "**A consistent mass makes both worse.** With its inverse (`reciprocal` at its default) `lagrange` has a noise "
        f"of {short(ringing['noise'])} and errs {short(ringing['over lumped'])} times as much. The critical Courant "
        f"number is {short(ringing['critical C'], 3)}.",
    ]  # fmt: skip
    return "".join(f"- {line}\n" for line in lines)


def advice(tables):
    """Return which method suits which wish, as sentences in Markdown.

    Raises
    ------
    AssertionError
        If a sentence is no longer true, whatever its numbers.
    """
    error, noise, overlap, fifty = (tables.of(name) for name in ("error", "noise", "overlap", "of fifty"))
    kept, (cd, wu, _) = tables.kept(), LEAP_FROG
    first, smooth, calm = ("lagrange", cd), ("penalty", wu), ("uzawa", "tchamwa-wielgosz")
    lasting = [("energy-conserving-penalty", cd), ("penalty", cd)]

    def largest(pair, pressed):
        """Return the largest error of a pair in the cases whose bodies stay pressed, or in the others."""
        values = zip(tables.cases, tables.errors[pair], strict=True)
        return max(value for case, value in values if (case in PRESSED) == pressed)

    pairs = [pair for pair in error if math.isfinite(error[pair]) and all(map(math.isfinite, tables.errors[pair]))]
    best = min(error.values())
    assert error[first] == best
    assert overlap[first] < 1e-12
    assert largest(first, True) == min(largest(pair, True) for pair in pairs)
    rings_less = {pair: abs(noise[pair] - 1.0) for pair in pairs if error[pair] <= 2.0 * best}
    assert rings_less[smooth] == min(rings_less.values())
    assert noise[smooth] < noise[first]
    assert largest(calm, False) == min(largest(pair, False) for pair in pairs)
    assert all(abs(fifty[pair] - 100.0) <= MOST_SPENT for pair in lasting)
    assert not any(abs(fifty[pair] - 100.0) <= MOST_SPENT and error[pair] < error[lasting[0]] for pair in pairs)
    assert fifty[first] < 50.0
    lines = [
        f"**Start with `lagrange` and `{cd}`.** No pair has a smaller error of the contact force: {short(best)} %, the "
        f"median over {len(tables.cases)} cases. The bodies do not overlap, and there is no stiffness to choose.",
        f"**Bodies that stay pressed together: the same pair.** It errs by {short(largest(first, True))} % at most on "
        f"{' and '.join(PRESSED)}. A penalty with Wu's predictor-corrector errs by up to "
        f"{short(largest(smooth, True))} % there.",
        f"**A smooth force: take `penalty` with `{wu}`.** The total variation of its force is {short(noise[smooth])} "
        f"times the exact one, and {short(noise[first])} times with the first pair. It errs by "
        f"{short(error[smooth])} % and loses up to {short(100.0 - kept[smooth][0])} % of the energy in a case.",
        f"**No large error in any impact: take `{calm[0]}` with `{calm[1]}`.** It errs by "
        f"{short(largest(calm, False))} % at most where bodies hit. The first pair errs by "
        f"{short(largest(first, False))} % there.",
        f"**Energy over many impacts: take `{lasting[0][0]}` or `penalty` with `{cd}`.** They keep the energy of fifty "
        f"impacts to {MOST_SPENT} %. The first pair loses more than half of it.",
        "**A stiffness, a restitution or a bond that is a property of your contact: take the law that has it**, "
        "whatever its error against rigid contact.",
    ]
    return "".join(f"- {line}\n" for line in lines)


def brief(tables):
    """Return the most important findings in three sentences, as a list in Markdown; the two above test them."""
    cd, wu, _ = LEAP_FROG
    error, fifty = tables.of("error"), tables.of("of fifty")
    lines = [
        f"`lagrange` with `{cd}` has the least error of the contact force: {short(error['lagrange', cd])} %, the "
        f"median over {len(tables.cases)} cases. It has no parameters.",
        f"The same penalty errs by {short(error['penalty', cd])} % with `{cd}`, and by {short(error['penalty', wu])} % "
        f"with `{wu}`.",
        f"No method is the best in everything: after fifty impacts `lagrange` has {short(fifty['lagrange', cd])} % of "
        f"the energy, and a penalty {short(fifty['penalty', cd])} %.",
    ]
    return "".join(f"- {line}\n" for line in lines)


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
    "what the family shows": findings,
    "which method when": advice,
    "what the bench has found": brief,
    "median errors": lambda tables: matrix(tables, "error"),
    "energy after fifty impacts": lambda tables: matrix(tables, "of fifty"),
}


def main():
    """Write the results, and what they show, into their files and pages."""
    given = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        table = percuss.open_study(given[0]).table if given else rows(Path(folder) / "family.sqlite")
    for name, make in (("errors", errors), ("medians", summary), ("masses", masses)):
        write(name, make(table))
    write_parts()


def write_parts():
    """Write what the files of results show into the pages."""
    tables = Tables()
    for name, make in PARTS.items():
        pages.write(name, make(tables))


if __name__ == "__main__":
    main()
