"""A film of a motion: its moments, its views, and the text on the pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from urbantwin.dataset.motion_interpolation import rows_at
from urbantwin.drawing import style
from urbantwin.drawing.film.from_above import FromAbove
from urbantwin.drawing.film.from_corner import FromCorner, corner_camera
from urbantwin.drawing.film.signal_lamps import LAMPS, Lamps
from urbantwin.errors import InputError
from urbantwin.taxonomy import BOX_SEMANTICS
from urbantwin.traffic.motion import Motion
from urbantwin.twin import Twin

__all__ = ["VIEWS", "FilmPlan", "film_colours", "film_pictures", "plan_film"]

VIEWS = ("above", "corner", "both")
#: Height of the strip below the pictures for time, classes and sources, pixels.
_STRIP = 46
#: Start of the classes to the right of the time, and distance between rows of them, pixels.
_LEFT, _ROW = 120.0, 18
#: Sides of a picture that can be drawn, pixels.
_NARROWEST, _WIDEST = 160, 3840
#: Maximum number of pictures of a film.
_MOST_PICTURES = 20_000
#: Default half side of the view from above, metres.
_USUAL_M = 100.0
#: Time for which an event's name stays on the picture after the event, seconds.
_STAYS_S = 1.0


@dataclass(frozen=True, eq=False)
class FilmPlan:
    """Moments of a motion shown in a film, and its views.

    Attributes:
        view: ``above``, ``corner`` or ``both``, side by side.
        times_s: moments of the motion, one for each picture.
        rate_hz: pictures per second.
        width: width of the picture, pixels.
        middle: (2,) middle of the views, site frame, metres.
        half_m: half of the side of the view from above.
    """

    view: str
    times_s: tuple[float, ...]
    rate_hz: float
    width: int
    middle: NDArray[np.float64]
    half_m: float


def plan_film(  # noqa: PLR0913 - what is shown, when and from where
    motion: Motion,
    twin: Twin,
    *,
    view: str = "both",
    start_s: float = 0.0,
    stop_s: float | None = None,
    rate_hz: float = 10.0,
    speed: float = 1.0,
    width: int = 1280,
    at: tuple[float, float] | None = None,
    radius_m: float | None = None,
) -> FilmPlan:
    """Choose the moments of a film.

    Args:
        motion: the motion.
        twin: its twin.
        view: ``above``, ``corner`` or ``both``.
        start_s: first moment, seconds of the motion.
        stop_s: last moment; default: the motion's last.
        rate_hz: pictures per second.
        speed: seconds of the motion in a second of the film.
        width: width of the picture, pixels.
        at: the middle of the views, site frame, metres; default: the site's anchor.
        radius_m: half side of the view from above; default: all of the region, but at most 100 m.

    Raises:
        InputError: a value is not valid.
    """
    last = float(motion.times()[-1])
    stop = last if stop_s is None else stop_s
    if view not in VIEWS:
        raise InputError(
            f"there is no view {view!r:.40}", place="view", expected="one of above, corner, both"
        )
    if not 0 <= start_s <= stop <= last + 1e-6:
        raise InputError(
            f"{start_s:g} to {stop:g} s",
            place="start, stop",
            expected=f"times within the motion, 0 to {last:g} s",
        )
    for name, value, low, high in (
        ("fps", rate_hz, 0.1, 50.0),
        ("speed", speed, 0.01, 1000.0),
        ("width", float(width), _NARROWEST, _WIDEST),
        ("radius", radius_m, 5.0, 2000.0),
    ):
        if value is not None and not low <= value <= high:
            raise InputError(f"{value:g}", place=name, expected=f"{low:g} to {high:g}")
    step = speed / rate_hz
    count = int((stop - start_s) / step + 1e-6) + 1
    if count > _MOST_PICTURES:
        raise InputError(
            f"{count:,} pictures", expected=f"{_MOST_PICTURES:,} at most: a shorter part, or faster"
        )
    times = np.minimum(np.round(start_s + step * np.arange(count), 9), last)
    x0, y0, x1, y1 = twin.region.bounds
    half = min(max(x1 - x0, y1 - y0) / 2, _USUAL_M) if radius_m is None else radius_m
    middle = np.array((0.0, 0.0) if at is None else at, np.float64)
    return FilmPlan(view, tuple(times.tolist()), rate_hz, width // 4 * 4, middle, half)


def film_pictures(
    plan: FilmPlan, motion: Motion, twin: Twin, *, attribution: str = ""
) -> Callable[[float], NDArray[np.uint8]]:
    """Return a function that draws the picture (height, width, 3) of a moment.

    Args:
        plan: see `plan_film`.
        motion: the motion.
        twin: its twin.
        attribution: sources of the data.
    """
    lamps = Lamps(motion)
    views: list[FromAbove | FromCorner] = []
    both = plan.view == "both"
    # The view from above is square; the view from the corner has the remaining width (4:3).
    side = plan.width * 3 // 7 // 2 * 2 if both else plan.width
    if plan.view in ("above", "both"):
        views.append(FromAbove(twin, plan.middle, plan.half_m, side))
    if plan.view in ("corner", "both"):
        wide = plan.width - side if both else plan.width
        size = (wide, side if both else wide * 9 // 16 // 2 * 2)
        views.append(FromCorner(twin, motion, corner_camera(twin, plan.middle), size))
    classes = set(motion.rows.distinct(["class"])["class"].to_pylist())
    strip = _strip(plan.width, [name for name in BOX_SEMANTICS if name in classes], attribution)

    def picture(time_s: float) -> NDArray[np.uint8]:
        rows = rows_at(motion, time_s)
        events = _happening(motion.manifest.get("events", ()), time_s)
        marked = {track: str(one["event"]) for one in events for track in one["tracks"]}
        seen = np.concatenate([one.picture(rows, lamps, time_s, marked) for one in views], axis=1)
        whole = Image.fromarray(np.concatenate([seen, strip]))
        draw = ImageDraw.Draw(whole)
        base = len(seen)
        draw.text((10, base + 11), f"{time_s:7.1f} s", font=_font(20), fill=style.INK)
        for number, one in enumerate(events):
            words = str(one["event"]).replace("_", " ")
            draw.text((11, 11 + 24 * number), words, font=_font(18), fill=style.PAPER)
            draw.text((10, 10 + 24 * number), words, font=_font(18), fill=style.ACCENT)
        return np.asarray(whole, np.uint8)

    return picture


def film_colours() -> list[tuple[int, int, int]]:
    """Return the colours (0..255) that have a meaning: of classes, lamps and text."""
    classes = [_class_colour(name) for name in BOX_SEMANTICS]
    written = [_hex_colour(text) for text in (style.PAPER, style.INK, style.ACCENT)]
    return list(dict.fromkeys([*classes, *LAMPS.values(), *written]))


def _class_colour(name: str) -> tuple[int, int, int]:
    red, green, blue = (int(255 * value + 0.5) for value in style.actor_colour(name))
    return red, green, blue


def _hex_colour(text: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue


def _happening(events: list[dict[str, Any]], time_s: float) -> list[dict[str, Any]]:
    """Return the events of a motion that happen at a time."""
    return [one for one in events if one["from_s"] <= time_s <= one["until_s"] + _STAYS_S]


def _strip(width: int, classes: list[str], attribution: str) -> NDArray[np.uint8]:
    """Return the strip below every picture: classes by colour, and sources.

    Its height depends on its number of rows; narrow pictures have several.
    """
    pen = ImageDraw.Draw(Image.new("RGB", (1, 1)))
    places, x, row = [], _LEFT, 0
    for name in classes:
        wide = 32 + pen.textlength(name, font=_font(14))
        if x > _LEFT and x + wide - 16 > width:
            x, row = _LEFT, row + 1
        places.append((x, row * _ROW))
        x += wide
    size = pen.textlength(attribution, font=_font(10))
    beside = size <= width - x - 8
    strip = Image.new("RGB", (width, _STRIP + row * _ROW), style.PAPER)
    draw = ImageDraw.Draw(strip)
    for name, (left, down) in zip(classes, places, strict=True):
        draw.rectangle((left, down + 17, left + 11, down + 28), fill=_class_colour(name))
        draw.text((left + 16, down + 14), name, font=_font(14), fill=style.INK)
    at = (max(width - size - 8, 8), row * _ROW + (17 if beside else 31))
    draw.text(at, attribution, font=_font(10), fill=style.MUTED)
    return np.asarray(strip, np.uint8)


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    path = Path(mpl.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"
    return ImageFont.truetype(str(path), size)
