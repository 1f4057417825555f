"""The notebook of the cases, run cell by cell: ``python tests/support/notebook.py`` writes its outputs anew."""

import ast
import contextlib
import io
import json
import os
import shutil
import tempfile
from pathlib import Path

import places

TOUR = places.CASES / "tour.ipynb"


def outputs(notebook):
    """Run the cells in a copy of the folder of cases; yield each code cell with what it prints and shows as text."""
    namespace, here = {"__name__": "__main__"}, Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(places.CASES, folder, dirs_exist_ok=True)
        os.chdir(folder)
        try:
            for cell in notebook["cells"]:
                if cell["cell_type"] == "code":
                    yield cell, output("".join(cell["source"]), namespace)
        finally:
            os.chdir(here)


def output(source, namespace):
    """Return what a cell prints, and the text of its last expression if it ends with one."""
    tree, printed = ast.parse(source), io.StringIO()
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), namespace)
        shown = eval(ast.unparse(last), namespace) if last is not None else None
    return printed.getvalue() + (f"{shown!r}\n" if shown is not None else "")


def stored(cell):
    """Return the text of the outputs of a cell in the notebook."""
    return "".join("".join(one["text"]) for one in cell["outputs"])


def main():
    """Write the outputs of all cells."""
    notebook = json.loads(TOUR.read_text(encoding="utf-8"))
    for number, (cell, text) in enumerate(outputs(notebook), 1):
        stream = {"name": "stdout", "output_type": "stream", "text": text.splitlines(keepends=True)}
        cell |= {"outputs": [stream] if text else [], "execution_count": number}
    TOUR.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
