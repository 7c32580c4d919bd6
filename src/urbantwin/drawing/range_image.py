"""A labelled frame as seen by its sensor: channels by azimuth, coloured by range and by class."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from urbantwin.drawing import style
from urbantwin.drawing.labelled_frame import LabelledPoints
from urbantwin.errors import InputError
from urbantwin.geometry import box_corners

__all__ = ["RangeImage", "range_image", "range_image_figure", "spread_rays"]

#: Number of rows if the channels of the points are not known.
_ROWS_WITHOUT_CHANNELS = 64
#: Cells of a sensor without channels and columns: half a degree.
_PATTERN_COLUMNS = 720
_EDGES = [(k, (k + 1) % 4) for k in range(4)]
_EDGES += [(a + 4, b + 4) for a, b in _EDGES] + [(k, k + 4) for k in range(4)]


@dataclass(frozen=True, eq=False)
class RangeImage:
    """The rays of one sensor as an image: row 0 is the highest, column 0 points straight back.

    Columns are in clockwise order, as seen from the sensor: the left of the image is the sensor's
    left.

    Attributes:
        range_m: (R, C) metres, nan without a return.
        semantic: (R, C) class numbers, 0 without a return.
        elevation: (R,) elevation of each row, radians, descending.
    """

    range_m: NDArray[np.float64]
    semantic: NDArray[np.int64]
    elevation: NDArray[np.float64]


def range_image(
    frame: LabelledPoints,
    path: Path,
    *,
    sensor: int = 0,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw the view of one sensor: range above, class with the boxes below.

    Args:
        frame: the frame.
        path: the PNG to write.
        sensor: number of the sensor in the rig.
        title: title of the picture.
        attribution: sources of the data.

    Raises:
        InputError: the rig has no such sensor, or it has no point in this frame.
    """
    return style.save(
        range_image_figure(frame, sensor=sensor, title=title, attribution=attribution), path
    )


def range_image_figure(
    frame: LabelledPoints,
    *,
    sensor: int = 0,
    title: str = "",
    attribution: str | Iterable[str] = (),
) -> Figure:
    """Return the figure of ``range_image``."""
    image = spread_rays(frame, sensor)
    figure = style.new_figure(16, 8.4)
    shape = image.range_m.shape
    upper = figure.add_axes((0.045, 0.505, 0.885, 0.375))
    lower = figure.add_axes((0.045, 0.085, 0.885, 0.375))
    for axes in (upper, lower):
        _plain(axes, image, shape)

    far = float(np.nanpercentile(image.range_m, 99))
    colours = mpl.colormaps["turbo_r"].with_extremes(bad=style.PAPER)
    drawn = upper.imshow(
        image.range_m,
        cmap=colours,
        norm=PowerNorm(0.5, float(np.nanmin(image.range_m)), far),
        aspect="auto",
        interpolation="nearest",
    )
    bar = figure.colorbar(drawn, cax=figure.add_axes((0.94, 0.505, 0.011, 0.375)))
    bar.ax.tick_params(colors=style.MUTED, labelsize=9)
    bar.outline.set_visible(False)
    figure.text(0.94, 0.888, "range, m", color=style.MUTED, fontsize=9.5, va="bottom")

    picture = style.class_colours(image.semantic)
    picture[np.isnan(image.range_m)] = mpl.colors.to_rgb(style.PAPER)
    lower.imshow(picture, aspect="auto", interpolation="nearest")
    for axes in (upper, lower):
        _outline_boxes(axes, frame, sensor, image)
        axes.set_xlim(-0.5, shape[1] - 0.5)
        axes.set_ylim(shape[0] - 0.5, -0.5)
    lower.set_xlabel("azimuth in the sensor's frame, degrees (left is +)", color=style.MUTED)

    place = frame.sensors[sensor]
    share = float(np.isfinite(image.range_m).mean())
    rays = f"{shape[0]} channels x {shape[1]} columns, {100 * share:.0f} % with a return"
    if place.has_pattern:
        rays = f"a pattern in {shape[0]} x {shape[1]} cells"
    below = f"frame {frame.name}   sensor {place.name}, {place.model}: {rays}"
    style.title(figure, title or "As the sensor sees it", below, x=0.045)
    style.written_attribution(figure, attribution)
    return figure


def spread_rays(frame: LabelledPoints, sensor: int = 0) -> RangeImage:
    """Return the points of one sensor as an image.

    A point's row is its channel, highest first; its column is its azimuth, so that channels with an
    azimuth offset from the encoder's angle appear in their true direction. If rays are unknown, or
    the pattern does not repeat, both are derived from the point's direction.

    Raises:
        InputError: the rig has no such sensor, or it has no point in this frame.
    """
    if not 0 <= sensor < len(frame.sensors):
        raise InputError(
            f"the dataset has no sensor {sensor}",
            place=frame.name,
            expected=f"0 to {len(frame.sensors) - 1}",
        )
    place = frame.sensors[sensor]
    mine = np.arange(len(frame.points))
    if frame.sensor is not None:
        mine = np.flatnonzero(frame.sensor == sensor)
    if not len(mine):
        raise InputError(f"sensor {place.name} has no points", place=f"frame {frame.name}")
    local = place.dataset_SE3_sensor.inverse().apply(frame.points[mine, :3])
    azimuth, elevation, distance = _spherical(local)
    columns = _PATTERN_COLUMNS if place.has_pattern else place.columns
    if frame.ring is None or place.has_pattern:
        rows = _ROWS_WITHOUT_CHANNELS
        low, high = float(elevation.min()), float(elevation.max())
        share = (high - elevation) / max(high - low, 1e-9)
        row = np.minimum((share * rows).astype(np.int64), rows - 1)
        heights = high - (np.arange(rows) + 0.5) / rows * (high - low)
        phase = np.zeros(rows)
    else:
        channels = np.radians(place.elevation_deg)
        order = np.argsort(-channels, kind="stable")
        rows = len(order)
        row = np.argsort(order)[frame.ring[mine]]
        heights = channels[order]
        # Mean phase of each channel's points between two columns.
        turn = np.exp(1j * azimuth * columns)
        each = np.bincount(row, turn.real, rows) + 1j * np.bincount(row, turn.imag, rows)
        phase = np.angle(each) / columns
    step = 2 * np.pi / columns
    column = np.round((np.pi - (azimuth - phase[row])) / step).astype(np.int64) % columns
    shape = (rows, columns)
    ranges = np.full(shape, np.nan)
    classes = np.zeros(shape, np.int64)
    far_first = np.argsort(-distance, kind="stable")  # the nearer one of a cell is last
    ranges[row[far_first], column[far_first]] = distance[far_first]
    classes[row[far_first], column[far_first]] = frame.semantic[mine][far_first]
    return RangeImage(ranges, classes, heights)


def _spherical(
    local: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    azimuth = np.arctan2(local[:, 1], local[:, 0])
    elevation = np.arctan2(local[:, 2], np.hypot(local[:, 0], local[:, 1]))
    return azimuth, elevation, np.linalg.norm(local, axis=1)


def _plain(axes: Axes, image: RangeImage, shape: tuple[int, int]) -> None:
    axes.set_facecolor(style.PAPER)
    axes.tick_params(colors=style.MUTED, labelsize=9, length=3)
    for spine in axes.spines.values():
        spine.set_color(style.FAINT)
    degrees = np.arange(180, -181, -30)
    axes.set_xticks((180 - degrees) / 360 * shape[1] - 0.5, [f"{d}" for d in degrees])
    rows = np.linspace(0, shape[0] - 1, 5).round().astype(int)
    axes.set_yticks(rows, [f"{np.degrees(image.elevation[row]):+.0f}°" for row in rows])
    axes.set_ylabel("elevation", color=style.MUTED)


def _outline_boxes(axes: Axes, frame: LabelledPoints, sensor: int, image: RangeImage) -> None:
    """Draw the edges of boxes that have points, as seen from the sensor."""
    place = frame.sensors[sensor]
    rows, columns = image.range_m.shape
    if rows < 2:
        return
    steps = np.linspace(0, 1, 12)[:, None]
    lines, colours = [], []
    for box, name, count in zip(frame.boxes, frame.classes, frame.box_points, strict=True):
        if not count:
            continue
        corners = place.dataset_SE3_sensor.inverse().apply(box_corners(box))
        for a, b in _EDGES:
            azimuth, elevation, _ = _spherical(corners[a] + steps * (corners[b] - corners[a]))
            x = (np.pi - azimuth) / (2 * np.pi) * columns - 0.5
            # Rows are channels, which are not evenly spaced: beyond the ends the spacing is even.
            y = np.interp(-elevation, -image.elevation, np.arange(rows))
            y[elevation > image.elevation[0]] = -1
            y[elevation < image.elevation[-1]] = rows
            x[1:][np.abs(np.diff(x)) > columns / 2] = np.nan
            lines.append(np.column_stack([x, y]))
            colours.append(style.actor_colour(name))
    style.draw_lines(axes, lines, colours, linewidth=0.9)
