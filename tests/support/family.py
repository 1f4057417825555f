"""The results of the whole family, from the shipped study: ``python tests/support/family.py`` writes them anew.

With the file of rows of the study as an argument no run is made. The results are files of data; what the pages say is
made from these files, digits and all, so that whoever has them can make it again.
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

import pages
import percuss
import places

STUDY = places.ROOT / "cases" / "studies" / "family.yaml"
RESULTS = STUDY.parent / "results"  # errors.csv, medians.csv and masses.csv
COURANT, FINER = 0.5, 4
PRESSED = ["preloaded", "smooth-pulse"]  # the bodies stay pressed together
MANY = "fifty-impacts"  # late impacts come at another time than the exact ones: its energy is judged, not its force
MOST_SPENT = 2  # change of the energy in all these impacts [%]; round-off changes it by about as much
FIRST = ("penalty", "central-difference")  # to which costs and overlaps are compared
USUAL = "lumped"  # the mass of all tables but that of the masses
DIGITS = {"least kept": 4, "most kept": 4, "critical C": 3}  # of the columns that show more than two


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


def texts(frame):
    """Return a table of numbers as texts."""
    return frame.apply(lambda column: column.map(lambda value: short(value, DIGITS.get(column.name, 2))))


class Runs:
    """The rows of the study, as tables with a row a pair of methods and a column a case."""

    def __init__(self, table):
        self.table = table.rename(columns={"contact": "law"})
        self.cases = [case for case in dict.fromkeys(table["case"]) if case != MANY]
        made = self.table[(table["status"] != "refused") & (table["method.mass"] == USUAL)]
        self.pairs = pd.MultiIndex.from_frame(made[["law", "integrator"]].drop_duplicates()).sort_values()

    def of(self, name, refine=1, courant=COURANT, mass=USUAL):
        """Return one number of the runs that were done on a mesh, at a Courant number, with a mass."""
        one = self.table
        chosen = one[(one["refine"] == refine) & (one["time.courant"] == courant) & (one["method.mass"] == mass)]
        if name != "status":
            chosen = chosen[chosen["status"] == "done"].astype({name: float})
        return chosen.pivot(index=["law", "integrator"], columns="case", values=name).reindex(
            index=self.pairs, columns=[*self.cases, MANY]
        )

    def kept(self, mass=USUAL):
        """Return the energy that is kept [%] where bodies part at the end: pressed ones store what they have."""
        return 100.0 * self.of("energy_kept", mass=mass)[self.cases].drop(columns=PRESSED)


def finite(frame):
    """Return a table with no infinite number."""
    return frame.replace([np.inf, -np.inf], np.nan)


def errors(table):
    """Return the table of errors [%]: a row a pair, a column a case."""
    runs = Runs(table)
    status = runs.of("status")
    return texts(100.0 * runs.of("force_error_l1")).where(status == "done", status)[runs.cases]


def summary(table):
    """Return the table of medians over the cases: a row a pair."""
    runs = Runs(table)
    error, noise, overlap, limit = (
        runs.of(name)[runs.cases] for name in ("force_error_l1", "noise", "penetration", "critical Courant number")
    )
    finer, wide = (runs.of("force_error_l1", **at)[runs.cases] for at in ({"refine": FINER}, {"courant": 0.9}))
    seconds = (runs.of("seconds", FINER) / runs.of("node_steps", FINER))[runs.cases]
    kept, fifty, status = runs.kept(), 100.0 * runs.of("energy_kept")[MANY], runs.of("status")[MANY]
    order = np.log(finite(error / finer)[(error > 0.0) & (finer > 0.0)]) / math.log(FINER)
    medians = {
        "error": 100.0 * error, "order": order, "C .9": wide / error, "noise": noise,
        "overlap": overlap / overlap.loc[FIRST], "cost": seconds / seconds.loc[FIRST],
    }  # fmt: skip
    found = {name: finite(values).median(axis=1) for name, values in medians.items()}
    found |= {"least kept": kept.min(axis=1), "most kept": kept.max(axis=1), "critical C": finite(limit).min(axis=1)}
    told = texts(pd.DataFrame(found))
    told["of fifty"] = fifty.map("{:.0f}".format).where(status == "done", status)
    first = ["error", "order", "C .9", "least kept", "most kept", "of fifty", "noise", "overlap", "critical C", "cost"]
    return told[first]


def masses(table):
    """Return the table of the other masses: a row a mass and pair, its errors beside those with the usual mass."""
    runs, found = Runs(table), {}
    before, rang = (runs.of(name)[runs.cases] for name in ("force_error_l1", "noise"))
    for mass in table["method.mass"].unique():
        error, noise, limit = (
            runs.of(name, mass=mass)[runs.cases] for name in ("force_error_l1", "noise", "critical Courant number")
        )
        kept, both = runs.kept(mass), error.notna() & before.notna()
        numbers = {
            "error": 100.0 * error.median(axis=1), "over lumped": (error / before).median(axis=1),
            "least kept": kept.min(axis=1), "most kept": kept.max(axis=1), "noise": noise[both].median(axis=1),
            "lumped noise": rang[both].median(axis=1), "critical C": finite(limit).min(axis=1),
        }  # fmt: skip
        if mass != USUAL:
            found[mass] = texts(pd.DataFrame(numbers))[both.any(axis=1)]
    return pd.concat(found, names=["mass"])


MADE = {"errors": errors, "medians": summary, "masses": masses}


# ------------------------------------------------------------------------------------------------- the results, read


def read(name):
    """Return a file of results as texts: a row a pair of law and integrator, of the masses a mass and pair."""
    keys = ["mass", "law", "integrator"] if name == "masses" else ["law", "integrator"]
    return pd.read_csv(RESULTS / f"{name}.csv", dtype=str, keep_default_na=False).set_index(keys)


def numbers(frame):
    """Return a table of texts as numbers, nan where there is none."""
    return frame.apply(pd.to_numeric, errors="coerce")


class Tables:
    """The files of results as numbers."""

    def __init__(self):
        self.errors, self.medians, self.masses = (numbers(read(name)) for name in MADE)


def span(values, digits=2):
    """Return the smallest and the largest of some numbers as ``a to b``."""
    low, high = (short(extreme(list(values)), digits) for extreme in (np.nanmin, np.nanmax))
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
    error, noise, order, wide, cost, fifty, least, most = (
        tables.medians[name]
        for name in ("error", "noise", "order", "C .9", "cost", "of fifty", "least kept", "most kept")
    )
    # 1
    damped = [("penalty", scheme) for scheme in DAMPING]
    assert noise[damped].max() < noise["penalty", cd]
    assert error[damped].max() < error["penalty", cd]
    assert noise["penalty", wu] < noise["penalty", cd]
    assert error["penalty", wu] < error[damped].min()
    lost_by_damping, lost_by_wu = 100.0 - least[damped], 100.0 - least["penalty", wu]
    assert min(lost_by_damping.min(), lost_by_wu) > 100.0 - least["penalty", cd]
    # 2
    exact, best = error[list(EXACT)], error.min()
    winners = error[error == best].index.unique("law")
    assert set(winners) <= set(EXACT)
    assert exact.max() <= error.drop(list(EXACT)).min()
    # 3
    assert order.max() < 1.1
    # 4
    conserving = ("energy-conserving-penalty", cd)
    assert (tables.medians.loc[conserving, ["least kept", "most kept"]] - 100.0).abs().max() < 0.01
    assert error[conserving] > 1.5 * error["lagrange", cd]
    assert (fifty[[conserving, ("penalty", cd)]] - 100.0).abs().max() <= MOST_SPENT
    assert fifty["lagrange", cd] < 50.0
    assert fifty[[*damped, ("penalty", wu)]].max() < 90.0
    gains, others = most["nitsche"].drop(list(DAMPING), errors="ignore") - 100.0, most.drop("nitsche").max() - 100.0
    assert gains.min() > others
    # 5
    undamped = wide[[(law, cd) for law in EXACT]]
    assert undamped.max() < 0.8
    one_step = wide[[("penalty", scheme) for scheme in ("chung-lee", "hulbert-chung", "tchamwa-wielgosz")]]
    assert one_step.min() > 0.9
    # 6
    same = tables.errors.duplicated()
    assert tables.errors.loc["lagrange", cd].equals(tables.errors.loc["paoli-schatzman", cd])
    staged = ~error.index.isin(LEAP_FROG, level="integrator")
    assert error[staged].min() >= error["lagrange", cd]
    # 8
    without_mass, consistent = (tables.masses.loc[mass] for mass in ("redistributed", "reciprocal"))
    assert without_mass["noise"].max() < noise["penalty", cd]
    calmed, ringing = without_mass.loc["penalty", cd], consistent.loc["lagrange", cd]
    assert calmed["over lumped"] < 1.0
    exact_without_mass = without_mass[without_mass.index.isin([(law, cd) for law in EXACT])]
    assert (exact_without_mass["noise"] < exact_without_mass["lumped noise"]).all()
    assert exact_without_mass["lumped noise"].max() < ringing["noise"]
    lines = [
        "**A penalty rings with central difference. Damping in the scheme and Wu's predictor-corrector reduce the "
        "noise and the error; both cost energy.** With central difference the penalty errs by "
        f"{short(error['penalty', cd])} %, and the total variation of its force is {short(noise['penalty', cd])} times "
        "the exact one. With the schemes that damp high frequencies it errs by "
        f"{span(error[damped])} %, with {span(noise[damped])} times the exact "
        f"variation, and loses up to {span(lost_by_damping)} % of the energy where bodies part. With Wu's "
        f"predictor-corrector it errs by {short(error['penalty', wu])} %, less than with any of them, and loses up to "
        f"{short(lost_by_wu)} %.",
        "**Laws with no overlap, or nearly none, err least, with every scheme that takes them.** They err by "
        f"{span(exact)} %. The least error, {short(best)} %, belongs to "
        f"{', '.join(f'`{law}`' for law in sorted(winners))}.",
        "**The order of the scheme does not show in the contact force.** With a mesh and a step four times finer the "
        f"error falls with an observed order of {span(order)} (median over the cases), for "
        "schemes of first and of second order.",
        "**A method that keeps the energy exactly is not therefore accurate.** With central difference "
        "`energy-conserving-penalty` keeps the energy to 0.01 % and errs "
        f"{short(error[conserving] / error['lagrange', cd])} times as much as `lagrange`, which loses up to "
        f"{short(100.0 - least['lagrange', cd])} %.",
        f"**Small losses add up.** In `{MANY}` the exact bar strikes fifty times and loses nothing. The same pair and "
        f"the penalty with central difference keep the energy to {MOST_SPENT} %. `lagrange` loses more than half of "
        "it. A penalty loses more than a tenth with a scheme that damps, or with Wu's predictor-corrector. These "
        "numbers depend on round-off.",
        "**`nitsche` adds energy.** With a scheme that does not damp it adds up to "
        f"{short(gains.max())} % in a case. Every other law adds "
        f"{short(max(others, 0.0))} % at most, fifty impacts apart.",
        f"**The largest step is the best, unless the scheme damps.** From a Courant number of {COURANT} to 0.9 the "
        f"error of exact contact with central difference falls to {span(undamped)} of its value, because the mesh "
        "disperses less, and the run costs less. With the schemes of one stage that damp, the error of a penalty "
        f"changes by a factor of {span(one_step)}.",
        f"**Some names are the same method.** Of {len(tables.errors)} pairs {same.sum()} repeat "
        "the errors of another pair to every digit shown. `paoli-schatzman` without restitution is `lagrange`. "
        "`regularised-lagrange` is a matched `bipenalty` with Wu's predictor-corrector. Laws with a kernel give the "
        "same with either leap-frog scheme. `velocity-verlet` is central difference with velocities at other times, "
        "and `explicit-newmark` without damping is `velocity-verlet`.",
        f"**A multi-stage scheme costs {span(cost[staged])} times as much as central difference for each node and "
        "step**, and no pair with one errs less than `lagrange` with central difference. A part of this cost is "
        "percuss: its loop for leap-frog schemes on uniform bars is the faster one.",
        "**An end without mass calms a penalty and makes exact contact less accurate.** With central difference, mass "
        f"redistribution reduces the noise of the penalty from {short(noise['penalty', cd])} to "
        f"{short(calmed['noise'])} and its error to {short(calmed['over lumped'])} of its value. Exact contact has a "
        f"noise of {span(exact_without_mass['noise'])} instead of "
        f"{span(exact_without_mass['lumped noise'])}, and errs "
        f"{span(exact_without_mass['over lumped'])} times as much.",
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
    error, noise, overlap, fifty, least = (
        tables.medians[name] for name in ("error", "noise", "overlap", "of fifty", "least kept")
    )
    cd, wu, _ = LEAP_FROG
    first, smooth, calm = ("lagrange", cd), ("penalty", wu), ("uzawa", "tchamwa-wielgosz")
    lasting, best = [("energy-conserving-penalty", cd), ("penalty", cd)], error.min()
    of_all = tables.errors[error.notna()].dropna()  # of pairs that run in every case
    pressed, hit = of_all[PRESSED].max(axis=1), of_all.drop(columns=PRESSED).max(axis=1)
    assert error[first] == best
    assert overlap[first] < 1e-12
    assert pressed[first] == pressed.min()
    rings = (noise[of_all.index] - 1.0).abs()[error[of_all.index] <= 2.0 * best]
    assert rings[smooth] == rings.min()
    assert noise[smooth] < noise[first]
    assert hit[calm] == hit.min()
    keeps = (fifty - 100.0).abs() <= MOST_SPENT
    assert keeps[lasting].all()
    assert error[of_all.index][keeps[of_all.index]].min() >= error[lasting[0]]
    assert fifty[first] < 50.0
    lines = [
        f"**Start with `lagrange` and `{cd}`.** No pair has a smaller error of the contact force: {short(best)} %, the "
        f"median over {tables.errors.shape[1]} cases. The bodies do not overlap, and there is no stiffness to choose.",
        f"**Bodies that stay pressed together: the same pair.** It errs by {short(pressed[first])} % at most on "
        f"{' and '.join(PRESSED)}. A penalty with Wu's predictor-corrector errs by up to "
        f"{short(pressed[smooth])} % there.",
        f"**A smooth force: take `penalty` with `{wu}`.** The total variation of its force is {short(noise[smooth])} "
        f"times the exact one, and {short(noise[first])} times with the first pair. It errs by "
        f"{short(error[smooth])} % and loses up to {short(100.0 - least[smooth])} % of the energy in a case.",
        f"**No large error in any impact: take `{calm[0]}` with `{calm[1]}`.** It errs by "
        f"{short(hit[calm])} % at most where bodies hit. The first pair errs by "
        f"{short(hit[first])} % there.",
        f"**Energy over many impacts: take `{lasting[0][0]}` or `penalty` with `{cd}`.** They keep the energy of fifty "
        f"impacts to {MOST_SPENT} %. The first pair loses more than half of it.",
        "**A stiffness, a restitution or a bond that is a property of your contact: take the law that has it**, "
        "whatever its error against rigid contact.",
    ]
    return "".join(f"- {line}\n" for line in lines)


def brief(tables):
    """Return the most important findings in three sentences, as a list in Markdown; the two above test them."""
    cd, wu, _ = LEAP_FROG
    error, fifty = tables.medians["error"], tables.medians["of fifty"]
    lines = [
        f"`lagrange` with `{cd}` has the least error of the contact force: {short(error['lagrange', cd])} %, the "
        f"median over {tables.errors.shape[1]} cases. It has no parameters.",
        f"The same penalty errs by {short(error['penalty', cd])} % with `{cd}`, and by {short(error['penalty', wu])} % "
        f"with `{wu}`.",
        f"No method is the best in everything: after fifty impacts `lagrange` has {short(fifty['lagrange', cd])} % of "
        f"the energy, and a penalty {short(fifty['penalty', cd])} %.",
    ]
    return "".join(f"- {line}\n" for line in lines)


def matrix(name):
    """Return one column of the medians as a table in Markdown: a row a law, a column a scheme."""
    cells = read("medians")[name].unstack("integrator", fill_value="-")
    schemes = sorted(cells, key=lambda scheme: (scheme not in LEAP_FROG[:2], scheme))
    return pages.table(("law", *schemes), ((f"`{law}`", *line) for law, *line in cells[schemes].itertuples()))


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
    error = tables.medians["error"].groupby("law").min()
    laws = sorted(error.index, key=lambda law: (-error[law], law))
    for axes, (name, (title, scale)) in zip(places, panels.items(), strict=True):
        values = tables.medians[name]
        for place, (words, (marker, colour, schemes)) in enumerate(classes.items()):
            points = values[values.index.isin(schemes, level="integrator")]
            heights = [
                laws.index(law) + 0.27 - 0.18 * place for law, _ in points.index
            ]  # so that no mark hides another
            axes.plot(points, heights, marker, color=colour, label=words, alpha=0.8, markersize=5)
        axes.set(xlabel=title, xscale=scale, yticks=range(len(laws)), yticklabels=laws)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
        axes.grid(color="#dddddd")
    places[0].set_xticks([1, 2, 3, 5, 8, 12])
    places[1].set_xticks([0.5, 1, 2, 4, 8])
    places[2].axvline(100.0, color="#1a1a1a", linewidth=1.0)
    places[2].set_xlim(0.0, 130.0)
    fifty = tables.medians["of fifty"]
    assert set(fifty[fifty > 130.0].index.unique("law")) == {"nitsche"}
    words = f"up to {short(fifty.max(), 3)} → "
    places[2].text(130.0, laws.index("nitsche"), words, ha="right", va="center", color="#5f5f5f")
    drawn.legend(*places[0].get_legend_handles_labels(), loc="outside upper left", ncols=len(classes), frameon=False)
    return drawn


PARTS = {
    "what the family shows": findings,
    "which method when": advice,
    "what the bench has found": brief,
    "median errors": lambda _: matrix("error"),
    "energy after fifty impacts": lambda _: matrix("of fifty"),
}


def main():
    """Write the results, and what they show, into their files and pages."""
    given = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder:
        table = percuss.open_study(given[0]).table if given else rows(Path(folder) / "family.sqlite")
    for name, make in MADE.items():
        make(table).to_csv(RESULTS / f"{name}.csv", lineterminator="\n")
    tables = Tables()
    for name, make in PARTS.items():
        pages.write(name, make(tables))


if __name__ == "__main__":
    main()
