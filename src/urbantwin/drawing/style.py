"""Common style of all pictures: colours, figures without a display, common map elements."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.image
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import get_font
from matplotlib.patches import Polygon, Rectangle
from numpy.typing import ArrayLike, NDArray

from urbantwin.errors import InputError
from urbantwin.taxonomy import BOX_SEMANTICS, semantic_classes

__all__ = [
    "ACCENT",
    "FAINT",
    "INK",
    "MUTED",
    "PAPER",
    "actor_colour",
    "bare",
    "class_colours",
    "draw_lines",
    "figure_of_picture",
    "joined",
    "legible",
    "new_figure",
    "north_arrow",
    "save",
    "scale_bar",
    "title",
    "written_attribution",
]

PAPER, INK, MUTED, FAINT, ACCENT = "#10161d", "#eef2f6", "#9aa7b4", "#2c3743", "#ffd24a"

#: Minimum lightness (0..255) of the taxonomy's colours on a dark background; darker ones are
#: raised.
_LEAST_LIGHT = 90.0


class Picture(Figure):
    """A figure that a notebook can show, although it has no pyplot window."""

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        self.savefig(stream, format="png")
        return stream.getvalue()


def new_figure(width: float, height: float, dpi: int = 100, colour: str = PAPER) -> Figure:
    """Return an empty figure of width x height inches with its own canvas, no global state."""
    figure = Picture(figsize=(width, height), dpi=dpi, facecolor=colour)
    FigureCanvasAgg(figure)
    return figure


def figure_of_picture(path: Path) -> Figure:
    """Return a figure that shows a PNG, pixel by pixel.

    Raises:
        InputError: there is no such picture.
    """
    try:
        pixels = mpl.image.imread(path)
    except (OSError, SyntaxError, ValueError):  # Pillow's for a damaged PNG, too
        raise InputError("is no picture", file=path, expected="a PNG") from None
    height, width = pixels.shape[:2]
    figure = new_figure(width / 100, height / 100)
    axes = figure.add_axes((0, 0, 1, 1))
    bare(axes)
    axes.imshow(pixels, interpolation="nearest", aspect="auto")
    return figure


def save(figure: Figure, path: Path) -> Path:
    """Write a PNG or, by the file's name, an SVG; the same figure gives the same bytes."""
    # A user's own matplotlibrc must not change or crop the drawing.
    fixed: dict[Any, Any] = {"savefig.bbox": None, "savefig.facecolor": "auto"}
    fixed |= {"svg.fonttype": "path", "svg.hashsalt": "urbantwin"}
    vector = path.suffix.lower() == ".svg"
    unsaid = {"Date": None, "Creator": None} if vector else {"Software": None}
    with mpl.rc_context(fixed):
        figure.savefig(path, format="svg" if vector else "png", metadata=unsaid)
    return path


@cache
def _glyphs() -> frozenset[int]:
    """Return the characters of the font included in matplotlib."""
    path = Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return frozenset(get_font(str(path)).get_charmap())


def legible(text: str) -> str:
    """Return the text without characters that would be drawn as empty boxes.

    The font has Latin, Greek, Cyrillic, Arabic and more, but not Chinese, Japanese or Korean. If no
    letter or digit remains, the result is empty.
    """
    kept = "".join(one for one in text if ord(one) in _glyphs())
    if len(kept) < len(text):
        kept = " ".join(kept.split())
    return kept if any(one.isalnum() for one in kept) else ""


def class_colours(semantic: ArrayLike) -> NDArray[np.float64]:
    """Return colours (N, 3), 0..1, of class numbers (N,), readable on ``PAPER``."""
    numbers = np.asarray(semantic, np.int64)
    table = np.full((max(256, int(numbers.max(initial=0)) + 1), 3), 0.6)
    for one in semantic_classes().values():
        table[one.id] = _readable(one.colour)
    return np.asarray(table[numbers])


def actor_colour(actor_class: str) -> NDArray[np.float64]:
    """Return the colour (3,), 0..1, of a class of actors."""
    return _readable(semantic_classes()[BOX_SEMANTICS[actor_class]].colour)


def _readable(colour: tuple[int, int, int]) -> NDArray[np.float64]:
    """Mix white into a dark colour; its hue stays the taxonomy's."""
    rgb = np.array(colour, np.float64)
    light = float(rgb @ [0.299, 0.587, 0.114])
    share = max(0.0, (_LEAST_LIGHT - light) / (255.0 - light))
    return (rgb + share * (255.0 - rgb)) / 255.0


def draw_lines(
    axes: Axes,
    lines: Sequence[NDArray[np.float64]],
    colours: Sequence[ArrayLike],
    **look: Any,  # noqa: ANN401 - matplotlib's properties of a collection
) -> None:
    """Draw lines (N, 2), each in its colour, as ``Axes.plot`` but much faster.

    The limits of the axes are not changed.
    """
    usual: dict[str, Any] = {"zorder": 2, "capstyle": "projecting", "joinstyle": "round"}
    axes.add_collection(LineCollection(lines, colors=colours, **(usual | look)), autolim=False)


def bare(axes: Axes) -> None:
    """Remove ticks and frame."""
    axes.set_facecolor(PAPER)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def title(
    figure: Figure,
    text: str,
    below: str = "",
    *,
    x: float = 0.03,
    top: float = 0.97,
    colour: str = MUTED,
) -> None:
    """Write a title and a line below it at the top left."""
    inch = 1.0 / figure.get_figheight()
    figure.text(x, top, legible(text), color=INK, fontsize=17, weight="bold", va="top")
    if below:
        figure.text(x, top - 0.34 * inch, legible(below), color=colour, fontsize=11, va="top")


def joined(sources: str | Iterable[str]) -> str:
    """Return attributions as one line, each once."""
    several = [sources] if isinstance(sources, str) else sources
    return " · ".join(one for one in dict.fromkeys(map(legible, several)) if one)


def written_attribution(figure: Figure, sources: str | Iterable[str]) -> None:
    """Write the sources of the data at the lower right."""
    text = joined(sources)
    if text:
        inch = 1.0 / figure.get_figheight()
        figure.text(0.985, 0.1 * inch, text, color=MUTED, fontsize=8.5, ha="right", va="bottom")


def scale_bar(axes: Axes) -> None:
    """Draw a bar of a round length in metres at the lower left; the limits must be set."""
    x0, x1 = axes.get_xlim()
    y0, y1 = axes.get_ylim()
    width = x1 - x0
    length = max(m for m in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if m <= width / 4 or m == 1)
    left, bottom = x0 + 0.03 * width, y0 + 0.035 * (y1 - y0)
    thick = 0.006 * (y1 - y0)
    for number in range(2):
        axes.add_patch(
            Rectangle(
                (left + number * length / 2, bottom),
                length / 2,
                thick,
                facecolor=INK if number == 0 else PAPER,
                edgecolor=INK,
                linewidth=1,
                zorder=50,
            )
        )
    axes.text(
        left + length,
        bottom + 2 * thick,
        f"{length} m",
        color=INK,
        fontsize=10,
        ha="right",
        va="bottom",
        zorder=50,
    )


def north_arrow(axes: Axes, yaw: float = 0.0) -> None:
    """Draw an arrow to the north at the upper right.

    Args:
        axes: with their limits set and an equal aspect.
        yaw: heading of the frame's x axis, counter-clockwise from east, radians.
    """
    x0, x1 = axes.get_xlim()
    y1 = axes.get_ylim()[1]
    size = 0.024 * (x1 - x0)
    shape = np.array([[0, 1.3], [0.55, -0.9], [0, -0.45], [-0.55, -0.9]]) * size
    c, s = np.cos(-yaw), np.sin(-yaw)
    turn = np.array([[c, -s], [s, c]])
    centre = np.array([x1 - 2.4 * size, y1 - 2.8 * size])
    axes.add_patch(Polygon(shape @ turn.T + centre, facecolor=INK, linewidth=0, zorder=50))
    x, y = turn @ np.array([0, 2.0 * size]) + centre
    axes.text(x, y, "N", color=INK, fontsize=11, weight="bold", ha="center", va="center", zorder=50)
