"""The command line. Everything heavy is imported inside the command that needs it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from percuss.cli_base import print_json, progress_bar, reporting
from percuss.cli_new import new
from percuss.cli_report import report
from percuss.cli_study import study
from percuss.cli_verify import verify
from percuss.errors import InputError, Problem, RunError

if TYPE_CHECKING:
    from percuss.case.case import Case
    from percuss.results.result import Result

app = typer.Typer(
    name="percuss",
    help="A bench on which explicit contact-impact methods are compared.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

CaseFile = Annotated[Path, typer.Argument(metavar="CASE", help="YAML file of the case.")]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Replace a value, as method.contact.beta_s=1; repeatable."),
]
Plugins = Annotated[
    list[Path] | None, typer.Option("--plugin", metavar="FILE", help="A single-file plug-in; repeatable.")
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output, the rest on standard error.")]


def main() -> None:
    """Run the command line: exit code 0 for done, 1 for a run or expectation that failed, 2 for bad input."""
    # the matrices are small: threads of BLAS cost more than they bring, above all beside other runs
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        app(standalone_mode=True)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(1)


# ------------------------------------------------------------------------------------------------- commands


@app.command()
def run(
    case: CaseFile,
    set_: Sets = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE", help="Save the result (NetCDF-4).")] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Draw the result: png, svg or pdf by suffix."),
    ] = None,
    exact_only: Annotated[
        bool, typer.Option("--exact-only", help="The exact solution alone; needs no method, step or elements.")
    ] = False,
    nudge: Annotated[
        bool, typer.Option("--nudge", help="Also run a nudged twin: does the answer hang on round-off?")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run a case; print what came out, save it, draw it."""
    with reporting(as_json):
        from percuss.results.exact_only import load_for_exact, run_exact
        from percuss.results.ledger import open_accounts
        from percuss.results.runner import run as run_case

        if plot is not None:
            _drawable(plot)
        loaded = _load(case, set_, plugin, read=load_for_exact if exact_only else None)
        if plot is not None and loaded.record.fields == 0:
            loaded = loaded.with_overrides({"record.fields": 400})
        if as_json:
            _tell_notes(loaded)
        for path in (out, plot):
            if path is not None:
                _writable(path)
        failure: RunError | None = None
        with progress_bar() as progress:
            try:
                result = run_exact(loaded) if exact_only else run_case(loaded, nudge=nudge, progress=progress)
            except RunError as error:
                failure, result = error, error.result
        _outputs(result, out, plot)
        if as_json:
            print_json({"title": result.title, **result.summary, "error": str(failure) if failure else None})
        else:
            from percuss.tell import tell_result

            tell_result(result)
        if failure is not None:
            print(f"error: {failure}", file=sys.stderr)
        if result.status != "done" or open_accounts(result.summary):
            raise typer.Exit(1)


@app.command()
def check(case: CaseFile, set_: Sets = None, plugin: Plugins = None, as_json: AsJson = False) -> None:
    """Say in words and formulas what a case will do, without running it."""
    with reporting(as_json):
        from percuss.certificate.verdict import settled
        from percuss.explain import explanation

        told = explanation(settled(_load(case, set_, plugin)))
        if as_json:
            print_json(told.data)
        else:
            print(told.text)


@app.command()
def compare(
    case: CaseFile,
    integrator: Annotated[str, typer.Option("--integrator", metavar="A,B", help="Integrators to run.")] = "",
    contact: Annotated[str, typer.Option("--contact", metavar="X,Y", help="Contact laws to run.")] = "",
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="PATH=VALUES", help="1,2,5 or 0:1:11 or 0.01:100:log:30; repeatable."),
    ] = None,
    set_: Sets = None,
    plugin: Plugins = None,
    tied: Annotated[
        bool, typer.Option("--tied", help="Also run with interfaces tied while the exact contact is closed.")
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE", help="Overlay the forces; with several `refine`, errors against it."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run pairs of methods on one case and put them side by side."""
    with reporting(as_json):
        from percuss import comparison, convergence
        from percuss.vary import varied

        loaded = _load_to_write(case, set_, plugin, plot)
        contacts = _names(contact)
        own = comparison.own_laws(loaded) if contacts else []
        if own:
            print(f"note: the own method of {', '.join(own)} is replaced in every run", file=sys.stderr)
        axes = varied(vary or [])
        rows = comparison.compare(loaded, _names(integrator), contacts, axes, tied=tied)
        for note in comparison.notes_of_swaps(loaded, _names(integrator), contacts, axes):
            print(f"note: {note}", file=sys.stderr)
        orders = convergence.orders(rows)
        if plot is not None:
            from percuss.overlay import plot_comparison

            if orders:
                convergence.plot_convergence(orders, loaded.title, plot)
            else:
                plot_comparison([{"label": r.label, "result": r.result, "reason": r.reason} for r in rows], plot)
        if as_json:
            print_json({"title": loaded.title, "rows": [row.as_dict() for row in rows], "orders": orders})
        else:
            from percuss.tell import tell_orders, tell_rows

            tell_rows(loaded.title, rows)
            if orders:
                tell_orders(orders)
        if not any(row.status == "done" for row in rows):
            raise typer.Exit(1)


app.command()(study)


@app.command()
def stability(
    case: CaseFile,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="PATH=VALUES", help="1,2,5 or 0:1:11 or 0.01:100:log:30; two make a map."),
    ] = None,
    curves: Annotated[
        list[str] | None, typer.Option("--curves", metavar="PATH=VALUES", help="One curve, or one map, a value.")
    ] = None,
    by: Annotated[
        str, typer.Option("--by", metavar="A,B", help="closed-form, pencil, black-box; several are overlaid.")
    ] = "",
    set_: Sets = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", metavar="FILE", help="Save the rows (csv).")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="Draw curves or maps.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say up to which Courant number a case is stable, over varied parameters."""
    with reporting(as_json):
        from percuss.certificate import maps
        from percuss.vary import varied

        axes, families = varied(vary or []), varied(curves or [], "--curves")
        if plot is not None and not 1 <= len(axes) <= 2:
            raise InputError([Problem("--plot", "", f"expected one or two --vary, found {len(axes)}", "")])
        loaded = _load_to_write(case, set_, plugin, plot, out)
        _tell_notes(loaded)
        with progress_bar("combinations") as progress:
            rows = maps.stability(loaded, axes, families, _names(by), progress=progress)
        if out is not None:
            maps.save(rows, out)
        if plot is not None:
            from percuss.stability_plot import plot_stability

            plot_stability(rows, axes, families, loaded.title, _methods(loaded), plot)
        if as_json:
            print_json({"title": loaded.title, "rows": maps.as_json(rows)})
        else:
            from percuss.tell import tell_stability

            tell_stability(loaded.title, rows)
        if not any(row["courant_critical"] for row in rows):
            raise typer.Exit(1)


@app.command()
def waves(
    case: CaseFile,
    contact: Annotated[str, typer.Option("--contact", metavar="NAME", help="By default the first.")] = "",
    set_: Sets = None,
    plugin: Plugins = None,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="Draw them over frequency.")] = None,
    as_json: AsJson = False,
) -> None:
    """Say what a closed contact lets through of waves, and what it throws back, measured from the step itself."""
    with reporting(as_json):
        from percuss.certificate.verdict import settled
        from percuss.certificate.waves import waves as measure

        loaded = _load_to_write(case, set_, plugin, plot)
        _tell_notes(loaded)
        found = measure(settled(loaded), contact)
        if plot is not None:
            from percuss.stability_plot import plot_waves

            plot_waves(found, loaded.title, _methods(loaded), plot)
        if as_json:
            print_json({"title": loaded.title, "reason": found.reason or None, "rows": found.rows()})
        else:
            from percuss.tell import tell_waves

            tell_waves(loaded.title, found)


app.command()(report)


app.command()(verify)


@app.command()
def plugins(
    name: Annotated[str, typer.Argument(metavar="[NAME]", help="A component to describe.")] = "",
    plugin: Plugins = None,
    as_json: AsJson = False,
) -> None:
    """List the registered components and where they come from, or describe one."""
    with reporting(as_json):
        from percuss import describe
        from percuss.methods.registry import Registry

        registry = Registry.load(plugin or [])
        if name:
            found = describe.components_named(registry, name)
            if as_json:
                print_json({"components": [describe.component_data(registry, *key) for key in found]})
            else:
                print("\n\n".join(describe.component_text(registry, *key) for key in found))
        elif as_json:
            print_json(describe.registry_data(registry))
        else:
            from percuss.tell import tell_registry

            tell_registry(registry)


app.command()(new)


@app.command()
def schema(
    plugin: Plugins = None,
    study: Annotated[bool, typer.Option("--study", help="That of a study file.")] = False,
) -> None:
    """Print the JSON schema of a case, with every registered component; editors complete cases with it."""
    with reporting(as_json=False):
        from percuss.case.json_schema import case_schema
        from percuss.methods.registry import Registry
        from percuss.studysections import study_schema

        registry = Registry.load(plugin or [])
        print_json(study_schema(registry) if study else case_schema(registry))


# -------------------------------------------------------------------------------------------------- helpers


def _load(
    path: Path, sets: list[str] | None, files: list[Path] | None, read: Callable[..., Case] | None = None
) -> Case:
    from percuss.case.case import load

    overrides = {}
    problems = []
    for item in sets or []:
        key, equals, value = item.partition("=")
        if not equals or not key:
            problems.append(Problem(f"--set {item}", "", "expected PATH=VALUE", "Write it as time.end=0.5."))
        overrides[key] = value
    if problems:
        raise InputError(problems)
    return (read or load)(path, overrides, plugins=files or [])


def _load_to_write(
    path: Path, sets: list[str] | None, files: list[Path] | None, plot: Path | None, out: Path | None = None
) -> Case:
    """Return a case; refuse a picture or a file that could not be written, before anything is run for it."""
    if plot is not None:
        _drawable(plot)
    loaded = _load(path, sets, files)
    for target in (out, plot):
        if target is not None:
            _writable(target)
    return loaded


def _tell_notes(case: Case) -> None:
    """Print the notes of a case on standard error, for commands whose report has no place for them."""
    for note in case.notes:
        print(f"note: {note}", file=sys.stderr)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _methods(case: Case) -> str:
    laws = list(dict.fromkeys(contact.law.name for contact in case.contacts.values())) or ["no contact"]
    return f"{case.method.integrator.name} integrator  ·  {', '.join(laws)}"


def _drawable(path: Path) -> None:
    from percuss.figures import check_suffix

    check_suffix(path)


def _writable(path: Path) -> None:
    """Refuse a place that cannot be written to before anything is run."""
    from percuss.files import replacing

    attempt = replacing(path, path.suffix)
    attempt.__enter__()
    attempt.__exit__(OSError, None, None)


def _outputs(result: Result, out: Path | None, plot: Path | None) -> None:
    if result.status == "unstable" and result.summary["steps"] == 0:
        return  # not started: there is nothing to keep
    if out is not None:
        result.save(out)
    if plot is not None:
        from percuss.plot import plot_result

        plot_result(result, plot)
