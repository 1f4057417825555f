"""The tables of the whole family, from the shipped study: ``python tests/support/family.py`` writes them anew.

The study takes hours. The findings are made from the tables as the page shows them, digits and all, so that whoever
has the page can make them again.
"""

import math
import statistics
import sys
import tempfile
from pathlib import Path

import pages
import percuss
import places

STUDY = places.ROOT / "cases" / "studies" / "family.yaml"
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
        ["law", "integrator", "error", "order", "C .9", "kept", "of fifty", "noise", "overlap", "critical C", "cost"]
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
            kept_in_words(kept),
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


def kept_in_words(kept):
    """Return the least and the most of the energies kept."""
    return f"{short(min(kept), 4)} to {short(max(kept), 4)}" if kept else "-"


def masses(table):
    """Return the table of the other masses: a row a mass and pair, its errors beside those with the usual mass."""
    cases = cases_of(table)
    usual = Point(table, 1, COURANT)
    lines = [["mass", "law", "integrator", "error", "over lumped", "kept", "noise", "lumped noise", "critical C"]]
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
                kept_in_words(kept_where_bodies_part(point, cases, pair)),
                short(median([noise[case] for case in both])),
                short(median([noise_before[case] for case in both])),
                short(min(limits), 3) if limits else "-",
            ])  # fmt: skip
    return lines


def refusals(table):
    """Return the reasons for which pairs were refused, each with its pairs."""
    refused = table[(table["status"] == "refused") & (table["method.mass"] == USUAL)]
    reasons = {}
    for one in refused.to_dict("records"):
        law, integrator = one["contact"], one["integrator"]
        key = one["reason"].replace(law, "LAW").replace(integrator, "SCHEME")
        reasons.setdefault(key, []).append((law, integrator))
    return {key: sorted(set(pairs)) for key, pairs in reasons.items()}


def markdown(lines):
    """Return lines of cells, the head first, as a table in Markdown."""
    return pages.table(lines[0], lines[1:])


# ------------------------------------------------------------------------------------------------- the page, read


def read(text):
    """Return the lines of a table in Markdown as lists of cells, without the line below the head."""
    lines = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in text.strip().splitlines()]
    return [lines[0], *lines[2:]]


def number(cell):
    """Return the number of a cell, nan if it has none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


class Tables:
    """The tables of the page as numbers by (law, integrator), that of the masses by (mass, law, integrator)."""

    def __init__(self, errors_text, summary_text, masses_text):
        head, *lines = read(masses_text)
        self.masses = {tuple(line[:3]): dict(zip(head[3:], map(number, line[3:]), strict=True)) for line in lines}
        head, *lines = read(errors_text)
        self.cases = head[2:]
        self.errors = {(law, integrator): [number(cell) for cell in cells] for law, integrator, *cells in lines}
        head, *lines = read(summary_text)
        self.columns = {
            name: {(line[0], line[1]): line[k] for line in lines} for k, name in enumerate(head) if k > 1
        }  # fmt: skip

    def of(self, name, law=None, integrator=None):
        """Return one column of the medians as numbers, of all pairs or those of a law or an integrator."""
        return {
            pair: number(cell)
            for pair, cell in self.columns[name].items()
            if law in (None, pair[0]) and integrator in (None, pair[1])
        }

    def kept(self):
        """Return the least and the most energy kept [%] by pair."""
        parts = {pair: cell.partition(" to ")[::2] for pair, cell in self.columns["kept"].items()}
        return {pair: (number(low), number(high)) for pair, (low, high) in parts.items()}


def span(values, digits=2):
    """Return the smallest and the largest of some numbers as ``a to b``."""
    low, high = short(min(values), digits), short(max(values), digits)
    return low if low == high else f"{low} to {high}"


LEAP_FROG = ("central-difference", "wu-predictor-corrector", "viscous-central-difference")
DAMPING = ("viscous-central-difference", "chung-lee", "hulbert-chung", "explicit-hht", "tchamwa-wielgosz", "noh-bathe")
EXACT = ("lagrange", "uzawa", "moreau-jean", "paoli-schatzman", "decomposition-contact-response")


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
        "**Damping in the scheme silences a penalty, moving the contact to the predicted state is better still, and "
        f"both cost energy.** With central difference the penalty errs {short(error['penalty', cd])} % "
        f"and rings {short(noise['penalty', cd])} times the exact force; the schemes that damp high frequencies err "
        f"{span([error[pair] for pair in damped])} % and ring {span([noise[pair] for pair in damped])} times, and lose "
        f"up to {span(lost_by_damping)} % of the energy where bodies part. Wu's predictor-corrector errs "
        f"{short(error['penalty', wu])} % and loses up to {short(lost_by_wu)} %.",
        f"**Laws that allow no overlap, or nearly none, err least, with every scheme.** They err "
        f"{span(exact.values())} %; the least, {short(best)} %, by "
        f"{', '.join(dict.fromkeys(law for law, _ in winners))}.",
        f"**The order of the scheme does not show in the contact force.** Where mesh and step are refined fourfold, "
        f"the error falls with an observed order of {span([order[pair] for pair in sharp])} (median over the cases), "
        "for schemes of first and of second order alike.",
        "**Energy kept exactly is no accuracy, and small losses add up.** With central difference "
        "`energy-conserving-penalty` keeps the energy to 0.01 % and errs "
        f"{short(error[conserving] / error['lagrange', cd])} times as much as `lagrange`, which loses up to "
        f"{short(100.0 - kept['lagrange', cd][0])} %. When the exact bar of `{MANY}` has struck fifty times, "
        f"this pair has kept its energy to {MOST_SPENT} %, as a penalty has; `lagrange` has lost more than half "
        "of it, and "
        "a penalty with a scheme that damps, or with Wu's predictor-corrector, more than a tenth. How much depends on "
        "round-off there. "
        f"`nitsche` with a scheme that does not damp adds {span(gains.values())} %, more than any other law "
        f"({short(max(others, 0.0))} % at most).",
        f"**The largest step is the best one, unless the scheme damps.** From a Courant number of {COURANT} to 0.9 the "
        f"error of exact contact with central difference falls to {span(undamped)} of what it was, as the mesh "
        "disperses less, and a run costs less. With the schemes that damp in one stage the error of a penalty changes "
        f"by a factor of {span(one_step)}.",
        f"**Many names, fewer methods.** Of {len(tables.errors)} pairs {len(tables.errors) - len(groups)} repeat the "
        "errors of another to every digit shown: `paoli-schatzman` without restitution is `lagrange`, "
        "`regularised-lagrange` is a matched `bipenalty` with Wu's predictor-corrector, laws with a kernel see the "
        "same with either leap-frog scheme, `velocity-verlet` is central difference read at other times and "
        "`explicit-newmark` without damping is `velocity-verlet`.",
        f"**A multi-stage scheme costs {span(stages)} times central difference a node and a step here**, for errors "
        "that are not smaller. Part of that is percuss, whose loop for leap-frog schemes on uniform bars is the faster "
        "one.",
        "**An end without mass calms a penalty, and costs exact contact accuracy; a consistent mass makes both "
        "worse.** With central difference mass redistribution takes the noise of the penalty from "
        f"{short(noise['penalty', cd])} to {short(calmed['noise'])} and its error to {short(calmed['over lumped'])} of "
        f"what it was; exact contact rings {span([line['noise'] for line in exact_without_mass])} in the place of "
        f"{span([line['lumped noise'] for line in exact_without_mass])}, and errs "
        f"{span([line['over lumped'] for line in exact_without_mass])} times as much. With the inverse of the "
        f"consistent mass (`reciprocal` at its default) `lagrange` rings {short(ringing['noise'])} and errs "
        f"{short(ringing['over lumped'])} times as much, at a critical Courant number of "
        f"{short(ringing['critical C'], 3)}.",
    ]  # fmt: skip
    return "".join(f"- {line}\n" for line in lines)


def shown_pairs(pairs):
    """Return pairs in words, by law."""
    by_law = {}
    for law, integrator in pairs:
        by_law.setdefault(law, []).append(integrator)
    return "; ".join(f"`{law}` with {', '.join(schemes)}" for law, schemes in by_law.items())


def advice(tables):
    """Return which method suits which wish, as a table in Markdown, by rules that stand in its second column."""
    error, noise, overlap = (tables.of(name) for name in ("error", "noise", "overlap"))
    fifty = tables.of("of fifty")
    best = min(error.values())

    finite = [pair for pair in error if math.isfinite(error[pair])]
    calm = [pair for pair in finite if error[pair] <= 2.0 * best]
    largest = {}
    for name in ("pressed", "hit"):
        columns = [k for k, case in enumerate(tables.cases) if (case in PRESSED) == (name == "pressed")]
        worst = {pair: max((values[k] for k in columns), default=math.nan) for pair, values in tables.errors.items()}
        largest[name] = {pair: value for pair, value in worst.items() if math.isfinite(value)}
    wishes = [
        ("force history over all cases", "least median error", error, finite, " %"),
        ("no bad surprise where bodies hit", "least largest error over these cases", largest["hit"], None, " %"),
        (
            "bodies that stay pressed together",
            f"least largest error on {' and '.join(PRESSED)}",
            largest["pressed"],
            None,
            " %",
        ),
        (
            "a smooth force",
            "total variation nearest to the exact one, among errors up to twice the least",
            {pair: abs(noise[pair] - 1.0) for pair in calm},
            None,
            "",
        ),
        (
            "energy over many impacts",
            f"all energy kept to {MOST_SPENT} % in {MANY}, whatever takes it: contacts, scheme or material",
            {pair: max(abs(value - 100.0), MOST_SPENT) for pair, value in fifty.items() if math.isfinite(value)},
            None,
            " %",
        ),
        (
            "no overlap at all",
            "least error of those whose median overlap is below 1e-12 of a penalty's",
            error,
            [pair for pair in finite if overlap[pair] < 1e-12],
            " %",
        ),
    ]
    lines = [["wish", "rule", "value", "pairs"]]
    for wish, rule, values, among, unit in wishes:
        pairs = list(values) if among is None else among
        value = min(values[pair] for pair in pairs)
        text = short(value) + unit if unit else f"{short(value)} from 1"
        lines.append([wish, rule, text, shown_pairs([pair for pair in pairs if values[pair] == value])])
    return markdown(lines)


PARTS = ("errors", "medians", "masses", "refusals", "what the family shows", "which method when")


def refused(table):
    """Return the reasons for which pairs are refused, as a list in Markdown."""
    lines = []
    for reason, pairs in sorted(refusals(table).items(), key=lambda item: -len(item[1])):
        by_scheme = {}
        for law, integrator in pairs:
            by_scheme.setdefault(integrator, []).append(f"`{law}`")
        listed = "; ".join(f"`{scheme}` with {', '.join(laws)}" for scheme, laws in sorted(by_scheme.items()))
        text = reason.replace("SCHEME", "the scheme").replace("LAW", "the law")
        lines.append(f"- {listed}: {text}.\n")
    return "".join(lines)


def main():
    """Write the tables, and what they show, into the page."""
    given = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        table = percuss.open_study(given[0]).table if given else rows(Path(folder) / "family.sqlite")
    made = {"errors": markdown(errors(table)), "medians": markdown(summary(table)), "masses": markdown(masses(table))}
    made["refusals"] = refused(table)
    tables = Tables(made["errors"], made["medians"], made["masses"])
    made |= {"what the family shows": findings(tables), "which method when": advice(tables)}
    for name in PARTS:
        pages.write(name, made[name])


if __name__ == "__main__":
    main()
