"""A motion from above: every actor's box and every signal over the plan, which is drawn once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from urbantwin.dataset.motion_interpolation import Rows
from urbantwin.drawing import style
from urbantwin.drawing.film.signal_lamps import Lamps
from urbantwin.drawing.plan_ground import draw_ground, draw_surfaces
from urbantwin.drawing.plan_marks import draw_marks
from urbantwin.drawing.plan_style import DARK
from urbantwin.twin import Twin

__all__ = ["FromAbove"]

#: Pixels are drawn this many times finer than they are shown.
_FINER = 2
#: Radius of a signal's lamp, metres, and its minimum, pixels.
_LAMP_M, _LAMP_PIXELS = 0.8, 2.5
#: Minimum size of an actor, pixels.
_LEAST_PIXELS = 3.0
#: Position of a vehicle's windscreen from its front, and its depth, as shares of the length.
_SCREEN, _SCREEN_DEEP = 0.22, 0.12


class FromAbove:
    """The view from above, north up.

    Args:
        twin: twin of the plan.
        middle: (2,) middle of the picture, site frame, metres.
        half_m: half of the picture's side.
        side: side of the picture, pixels.
    """

    def __init__(self, twin: Twin, middle: NDArray[np.float64], half_m: float, side: int) -> None:
        self._corner = np.array([middle[0] - half_m, middle[1] + half_m])
        self._pixels_per_m = side * _FINER / (2 * half_m)
        self._base = _plan(twin, middle, half_m, side * _FINER)

    def picture(
        self,
        rows: Rows,
        lamps: Lamps,
        time_s: float,
        marked: dict[int, str],
    ) -> NDArray[np.uint8]:
        """Return the picture (side, side, 3) of one moment.

        Args:
            rows: the actors.
            lamps: the signals.
            time_s: time of the moment.
            marked: tracks of an event, which get a ring, and the event's name.
        """
        picture = Image.fromarray(self._base)
        draw = ImageDraw.Draw(picture)
        radius = max(_LAMP_M * self._pixels_per_m, _LAMP_PIXELS * _FINER)
        for (x, y), colour in zip(self._pixel(lamps.places), lamps.colours(time_s), strict=True):
            draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colour)
        for row in rows:
            self._draw_actor(draw, row)
        for row in rows:
            if int(row["track"]) in marked:
                self._draw_ring(draw, row)
        return np.asarray(picture.reduce(_FINER), np.uint8)

    def _draw_actor(self, draw: ImageDraw.ImageDraw, row: np.void) -> None:
        colour = _eight_bit(style.actor_colour(str(row["class"])))
        least = _LEAST_PIXELS * _FINER / self._pixels_per_m
        length, width = max(row["length"], least), max(row["width"], least)
        if row["class"] == "pedestrian":
            x, y = self._pixel(np.array([row["x"], row["y"]]))
            radius = self._pixels_per_m * max(length, width) / 2
            draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=colour)
            return
        draw.polygon(self._box(row, length, width, 0.0, 1.0), fill=colour)
        if row["class"] in ("car", "van", "truck", "bus"):
            dark = _eight_bit(0.3 * np.asarray(style.actor_colour(str(row["class"]))))
            screen = self._box(row, length, 0.84 * width, _SCREEN, _SCREEN + _SCREEN_DEEP)
            draw.polygon(screen, fill=dark)

    def _draw_ring(self, draw: ImageDraw.ImageDraw, row: np.void) -> None:
        x, y = self._pixel(np.array([row["x"], row["y"]]))
        radius = self._pixels_per_m * (float(row["length"]) / 2 + 1.5) + 3 * _FINER
        around = (x - radius, y - radius, x + radius, y + radius)
        draw.ellipse(around, outline=style.ACCENT, width=2 * _FINER)

    def _box(
        self, row: np.void, length: float, width: float, start: float, end: float
    ) -> list[tuple[float, float]]:
        """Return the corners of a part of a box, between two shares of its length."""
        ahead = np.array([np.cos(row["yaw"]), np.sin(row["yaw"])])
        left = np.array([-ahead[1], ahead[0]]) * width / 2
        at = np.array([row["x"], row["y"]])
        ends = [at + ahead * length * (0.5 - share) for share in (start, end)]
        corners = np.array([ends[0] + left, ends[0] - left, ends[1] - left, ends[1] + left])
        return [(float(x), float(y)) for x, y in self._pixel(corners)]

    def _pixel(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the positions of points (..., 2) in the finer picture."""
        return np.asarray((xy - self._corner) * [self._pixels_per_m, -self._pixels_per_m])


def _plan(twin: Twin, middle: NDArray[np.float64], half_m: float, side: int) -> NDArray[np.uint8]:
    dpi = 100 * _FINER
    figure = style.new_figure(side / dpi, side / dpi, dpi=dpi)
    axes = figure.add_axes((0, 0, 1, 1))
    style.bare(axes)
    axes.set_xlim(middle[0] - half_m, middle[0] + half_m)
    axes.set_ylim(middle[1] - half_m, middle[1] + half_m)
    draw_ground(axes, twin.region, twin.mesh, DARK)
    draw_surfaces(axes, twin.roads, twin.lane_model, DARK)
    draw_marks(axes, twin.roads, twin.lane_model, DARK)
    style.scale_bar(axes)
    style.north_arrow(axes)
    canvas: Any = figure.canvas
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:side, :side, :3], np.uint8)


def _eight_bit(colour: NDArray[np.float64]) -> tuple[int, int, int]:
    red, green, blue = (int(255 * value + 0.5) for value in colour)
    return red, green, blue
