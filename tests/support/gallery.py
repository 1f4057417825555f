"""The pictures of the pages: ``python tests/support/gallery.py`` draws them anew, with names as arguments these alone.

Each one is what a command of percuss draws, made small. Its texts and axes are kept in a file beside the picture: a
test draws again and compares that, since pixels depend on the machine.
"""

import contextlib
import json
import sys
import tempfile
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

import family
import pages
import places
from command_line import percuss_command

FOLDER = places.CASES / "gallery"
SHIPPED = sorted(path.stem for path in places.CASES.glob("*.yaml"))
COMMANDS = {name: f"run cases/{name}.yaml --plot {name}.png" for name in SHIPPED} | {
    "laws": "compare cases/hunek.yaml --plugin spring.py --contact spring,bipenalty,lagrange --plot laws.png",
    "two-bars": "run two-bars.yaml --plot two-bars.png",
    "compared": "compare two-bars.yaml --plugin spring.py --contact spring,penalty,lagrange --plot compared.png",
}
FROM_DATA = {"family": lambda: family.figure(family.Tables())}  # pictures of the results of a study
ALL = [*COMMANDS, *FROM_DATA]
ROUND_OFF = {"fifty-impacts"}  # late forces depend on round-off: of this picture the texts are compared
LARGEST = 60_000  # bytes of a picture at most
SIZES = ((1080, 224), (1080, 128), (960, 128), (960, 96), (840, 96), (840, 64), (840, 32))  # pixels, colours


@contextlib.contextmanager
def figures_caught():
    """Catch each figure that is saved, as a list, and draw no file."""
    caught, save = [], Figure.savefig

    def catch(figure, file, **options):
        caught.append(figure)
        return save(figure, file, **options)

    Figure.savefig = catch
    try:
        yield caught
    finally:
        Figure.savefig = save


def figure_of(name, folder):
    """Return the figure of a picture, and draw it as a large one into a folder."""
    if name in FROM_DATA:
        figure = FROM_DATA[name]()
        figure.savefig(Path(folder) / f"{name}.png", dpi=180)
        return figure
    with figures_caught() as caught:
        done = percuss_command(*pages.shlex.split(COMMANDS[name]), cwd=folder)
    assert done.returncode == 0, done.stderr
    (figure,) = caught
    return figure


def words(texts):
    """Return the words of some texts of a figure."""
    return [text.get_text().strip() for text in texts]


def drawn(figure):
    """Return what a figure shows: its texts, and of each panel the texts, the limits and how many lines it has."""
    panels = []
    for axes in figure.axes:
        legend = axes.get_legend()
        panels.append({
            "words": [axes.get_title(), axes.get_xlabel(), axes.get_ylabel(), *words(axes.texts)],
            "legend": words(legend.get_texts()) if legend else [],
            "limits": [float(f"{value:.5g}") for value in (*axes.get_xlim(), *axes.get_ylim())],
            "lines": len(axes.lines),
        })  # fmt: skip
    return {"words": words(figure.texts), "panels": panels}


def write_picture(large, path):
    """Write a picture small: as wide and colourful as the largest file allows."""
    picture = Image.open(large).convert("RGB")
    for width, colours in SIZES:
        small = picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)
        small.quantize(colours, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= LARGEST:
            return
    raise AssertionError(f"{path.name} has {path.stat().st_size} bytes")


def kept(name):
    """Return what the kept picture of a name shows."""
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def main():
    """Draw the pictures, all or those that are named."""
    with tempfile.TemporaryDirectory() as place:
        pages.fill(Path(place))
        for name in sys.argv[1:] or ALL:
            shown, path = drawn(figure_of(name, place)), FOLDER / f"{name}.png"
            write_picture(Path(place) / f"{name}.png", path)
            path.with_suffix(".json").write_text(json.dumps(shown, indent=1, ensure_ascii=False), encoding="utf-8")
            sys.stdout.write(f"{name}: {path.stat().st_size} bytes\n")


if __name__ == "__main__":
    main()
