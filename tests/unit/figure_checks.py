"""What every figure is held to: legible, no text over another, distinguishable in grey, repeatable.

As a script, it draws every figure of a finished study, and prints the defects of each as JSON. With the
folder of its figures as second argument, it also compares the bytes of their data and of one picture. The
results are then changed in the thirteenth digit, as on another kind of processor::

    python tests/unit/figure_checks.py results/spmd figures/spmd
"""

import inspect
import json
import sys
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from unittest import mock

import matplotlib as mpl
import numpy as np
import pandas as pd
from accelerated_evaluation.publishing import study as study_module
from accelerated_evaluation.publishing.figures import style
from accelerated_evaluation.publishing.figures.style import COLUMN_WIDTH, paper_style, save_figure
from accelerated_evaluation.publishing.provenance import figure_metadata
from accelerated_evaluation.publishing.published import FIGURES, arguments_of, title_of
from accelerated_evaluation.publishing.study import Study
from matplotlib import pyplot as plt
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.text import Text

SMALLEST_FONT = 6  # [pt]
LEAST_DIFFERENCE = 0.12  # of the luminances of two marks that differ in nothing else
LEAST_RATIO = 1.5  # of the widths of two lines that differ in nothing else
TOUCHING = 1.0  # [px], overlap that nobody sees
ROOT = Path(__file__).resolve().parents[2]


def defects(drawn):
    """Return what is wrong with a figure, in words; it is drawn once."""
    found = []
    texts = _drawn_texts(drawn)
    if drawn.get_size_inches()[0] > 2 * COLUMN_WIDTH + 0.01:
        found.append("wider than two columns, so that it is printed smaller")
    found += [f"{text!r} has {size:g} pt" for text, _, size in texts if size < SMALLEST_FONT]
    page = drawn.bbox.padded(TOUCHING)
    for text, box, _ in texts:
        if not (page.contains(box.x0, box.y0) and page.contains(box.x1, box.y1)):
            found.append(f"{text!r} leaves the figure")
    for (one, box, _), (two, other, _) in combinations(texts, 2):
        if box.padded(-TOUCHING).overlaps(other.padded(-TOUCHING)):
            found.append(f"{one!r} overlaps {two!r}")
    found += [pair for axes in drawn.axes for pair in _alike_in_grey(axes)]
    for legend in drawn.legends:
        if any(legend.get_window_extent().overlaps(axes.get_window_extent()) for axes in drawn.axes):
            found.append("the legend covers a panel")
    return found


def _drawn_texts(drawn):
    """Return each text that is drawn, with its box [px] and its size [pt]."""
    seen = {}
    draw = Text.draw

    def watched(text, renderer, *args, **options):
        if text.get_visible() and text.get_text().strip():
            box = Text.get_window_extent(text, renderer)
            seen[id(text)] = text.get_text(), box, text.get_fontsize()
        return draw(text, renderer, *args, **options)

    with paper_style(), mock.patch.object(Text, "draw", watched):
        drawn.canvas.draw()
    return list(seen.values())


def _alike_in_grey(axes):
    """Yield the pairs of entries of a legend that only their colours tell apart, and these too little."""
    handles, labels = axes.get_legend_handles_labels()
    for (one, first), (two, second) in combinations(zip(labels, map(_look, handles), strict=True), 2):
        width, other = sorted((first["width"], second["width"]))
        same = all(first[name] == second.get(name) for name in first.keys() - {"width", "grey"})
        shades = abs(first["grey"] - second["grey"])
        if one != two and same and shades < LEAST_DIFFERENCE and other <= LEAST_RATIO * width:
            yield f"{one!r} looks like {two!r} in grey"


def _look(handle):
    """Return the properties of an entry of a legend, with its luminance in place of its colour."""
    artist = handle[0] if isinstance(handle, tuple) else handle
    look = {"type": type(artist).__name__, "width": float(np.max(artist.get_linewidth()))}
    if isinstance(artist, Line2D):
        color = artist.get_color()
        hollow = to_rgba(artist.get_markerfacecolor())[:3] == (1, 1, 1) or artist.get_fillstyle() == "none"
        look["marker"] = artist.get_marker(), hollow
        look["dashes"] = artist.get_linestyle() == "None" or artist._unscaled_dash_pattern
    else:
        faces = artist.get_facecolor()
        color = np.atleast_2d(faces if len(faces) else artist.get_color())[0]
        paths = artist.get_paths() if hasattr(artist, "get_paths") else []
        look["marker"] = [path.vertices.shape for path in paths[:1]]
    red, green, blue, alpha = to_rgba(color)
    return look | {"grey": 1 - alpha * (1 - (0.3 * red + 0.59 * green + 0.11 * blue))}


def _given(study, name):
    """Return the arguments that the notebooks do not read from the study."""
    second = name.startswith(("fig05", "fig07"))
    worlds = ROOT / "benchmarks" / "results"
    return {
        "segment": lambda: study.segments[1] if second else study.first_segment,
        "settings": lambda: study.config["cross_entropy"],
        "lead_speed_edges": lambda: study.config["segments"]["lead_speed_edges"],
        "worlds": lambda: pd.read_csv(worlds / "worlds.csv"),
    }


def _on_another_processor(path):
    """Read a table of results whose numbers differ in the thirteenth digit."""
    table = pd.read_csv(path)
    floats = table.select_dtypes("float")
    return table.assign(**{name: column * (1 + 1e-13) for name, column in floats.items()})


def main(results, published=None):
    """Print the defects of all figures of a study as JSON; they are also compared with those published."""
    mpl.use("agg")
    study = Study(results, Path("figures") / Path(results).name)
    if published:
        reader = SimpleNamespace(**{**vars(pd), "read_csv": _on_another_processor})
        mock.patch.object(study_module, "pd", reader).start()
    found = {}
    for name, make in sorted(FIGURES.items()):
        parts = inspect.signature(make).parameters
        given = {part: read for part, read in _given(study, name).items() if part in parts}
        if arguments_of(study, make, given) is None:
            continue  # a figure of another kind of study
        arguments = arguments_of(study, make, {part: read() for part, read in given.items()})
        found[name], made = [], make(**arguments)
        if published:
            title = title_of(name, {**arguments, "data": made[1], "study": study})
            found[name] += _differences(made, published, name, figure_metadata(name, study.name, title))
        found[name] += defects(made[0])
        plt.close("all")
    print(json.dumps(found, indent=2, ensure_ascii=False))


def _differences(made, published, name, metadata):
    """Return the files of a figure whose bytes differ from those that a notebook published.

    Only the picture that is saved first is compared: the layout changes a little whenever a figure is drawn.
    """
    with TemporaryDirectory() as folder, mock.patch.object(style, "FORMATS", ("png",)):
        save_figure(*made, folder, name, metadata)
        files = [f"{name}.{ending}" for ending in ("png", "csv")]
        return [
            f"{file} has other bytes the second time"
            for file in files
            if Path(folder, file).read_bytes() != Path(published, file).read_bytes()
        ]


if __name__ == "__main__":
    main(*sys.argv[1:])
