"""A picture of cleaning: the source before and after, from above, and the removed parts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from urbantwin.drawing import style
from urbantwin.reconstruct import PointCloud, TriangleMesh
from urbantwin.reconstruct.cleaning import CleaningPicture, Removal
from urbantwin.reconstruct.cleaning.height_grid import Grid
from urbantwin.reconstruct.cleaning.rays import Rays

__all__ = ["cleaning_picture"]

#: Pixels along the longer side of one panel.
_PIXELS = 1000
_SUN = np.array([-0.45, 0.45, 0.77])
_PLURAL = {"truck or bus": "trucks and buses", "row of cars": "rows of cars"}
_VEHICLE, _SHARD, _KEPT, _OTHER = "#ff7a1a", "#ff3355", "#57d977", "#7fb4ff"


def cleaning_picture(
    picture: CleaningPicture,
    path: Path,
    *,
    title: str = "Cleaning",
    attribution: str | Iterable[str] = (),
) -> Path:
    """Draw a source before and after cleaning, side by side.

    Args:
        picture: result of ``cleaned`` or ``cleaned_cloud``.
        path: the PNG to write.
        title: title above the picture.
        attribution: sources of the data.
    """
    bounds = _bounds(picture)
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    panel_w = 7.4
    panel_h = float(np.clip(panel_w * height / width, 3.0, 10.0))
    figure = style.new_figure(2 * panel_w + 0.6, panel_h + 1.55)
    total = figure.get_figheight()
    for number, (name, what) in enumerate((("before", picture.before), ("after", picture.after))):
        axes = figure.add_axes(
            (
                (0.2 + number * (panel_w + 0.2)) / figure.get_figwidth(),
                0.35 / total,
                panel_w / figure.get_figwidth(),
                panel_h / total,
            )
        )
        style.bare(axes)
        axes.imshow(
            _from_above(what, bounds),
            extent=(bounds[0], bounds[2], bounds[1], bounds[3]),
            origin="lower",
            interpolation="antialiased",
        )
        axes.set_xlim(bounds[0], bounds[2])
        axes.set_ylim(bounds[1], bounds[3])
        axes.set_aspect("equal")
        _border(axes, picture.region, style.INK, 1.2)
        _border(axes, picture.roads, style.ACCENT, 0.6)
        _marks(axes, picture, before=number == 0)
        size = len(what.faces) if isinstance(what, TriangleMesh) else len(what.points)
        unit = "triangles" if isinstance(what, TriangleMesh) else "points"
        axes.text(
            0.015,
            0.985,
            f"{name}: {size:,} {unit}",
            transform=axes.transAxes,
            color=style.INK,
            fontsize=12,
            va="top",
            bbox={"facecolor": style.PAPER, "alpha": 0.75, "lw": 0, "pad": 4},
            zorder=60,
        )
        style.scale_bar(axes)
    left = 0.2 / figure.get_figwidth()
    style.title(figure, title, _summary(picture), x=left, top=1 - 0.2 / total)
    _legend(figure)
    style.written_attribution(figure, attribution)
    return style.save(figure, path)


def _bounds(picture: CleaningPicture) -> tuple[float, float, float, float]:
    """Return the bounds of the picture: the region and the source in it, with a margin."""
    west, south, east, north = shapely.buffer(picture.region, 4.0).bounds
    before = picture.before
    places = before.vertices if isinstance(before, TriangleMesh) else before.points
    if len(places):
        low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
        west, south = max(west, low[0] - 1), max(south, low[1] - 1)
        east, north = min(east, high[0] + 1), min(north, high[1] + 1)
    if east - west < 1 or north - south < 1:
        west, south, east, north = shapely.buffer(picture.region, 4.0).bounds
    return float(west), float(south), float(east), float(north)


def _from_above(
    what: TriangleMesh | PointCloud, bounds: tuple[float, float, float, float]
) -> NDArray[np.float64]:
    """Return the picture from above (rows from south, columns, 3), 0..1."""
    step = max(bounds[2] - bounds[0], bounds[3] - bounds[1]) / _PIXELS
    grid = Grid.over(bounds, step)
    if isinstance(what, PointCloud):
        height = grid.highest(what.points) if len(what.points) else np.full(grid.shape, np.nan)
        return _by_height(height, step)
    if not len(what.faces):
        return np.tile(np.array([0.06, 0.09, 0.11]), (*grid.shape, 1))
    top = float(what.vertices[:, 2].max()) + 1.0
    centres = grid.centres()
    start = np.column_stack([centres, np.full(len(centres), top)])
    rays = Rays(what.vertices, what.faces)
    face, distance = rays.first(start, [0.0, 0.0, -1.0])
    hit = face >= 0
    a, b, c = np.moveaxis(what.vertices[what.faces], 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    normal *= np.where(normal[:, 2:] < 0, -1.0, 1.0)
    place = start[hit] - [0, 0, 1] * distance[hit, None] + [0, 0, 0.01]
    lit = np.clip(normal[face[hit]] @ _SUN, 0, 1)
    _, shadow = rays.first(place, _SUN / np.linalg.norm(_SUN))
    lit = np.where(np.isfinite(shadow), 0.0, lit)
    out = np.tile(np.array([0.06, 0.09, 0.11]), (len(centres), 1))
    base = np.full((len(what.faces), 3), 0.62)
    if what.colour is not None:
        base = np.clip(what.colour / 255.0 * 1.25 + 0.08, 0, 1)
    out[hit] = base[face[hit]] * (0.38 + 0.72 * lit)[:, None]
    return np.asarray(np.clip(out, 0, 1).reshape(*grid.shape, 3))


def _by_height(height: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return colours of heights, shaded, dark where there is no height."""
    known = np.isfinite(height)
    out = np.tile(np.array([0.06, 0.09, 0.11]), (*height.shape, 1))
    if known.any():
        low, high = np.percentile(height[known], [1, 99])
        share = np.clip((height - low) / max(high - low, 1.0), 0, 1)[known][:, None]
        out[known] = (1 - share) * np.array([0.30, 0.38, 0.46]) + share * np.array([0.98, 0.9, 0.7])
    return out


def _border(axes: Axes, shape: shapely.Geometry, colour: str, width: float) -> None:
    lines = [
        shapely.get_coordinates(ring)
        for part in shapely.get_parts(shape)
        if part.geom_type == "Polygon"
        for ring in shapely.get_rings(part)
    ]
    axes.add_collection(
        LineCollection(lines, colors=colour, linewidths=width, alpha=0.7, zorder=20), autolim=False
    )


def _marks(axes: Axes, picture: CleaningPicture, *, before: bool) -> None:
    """Draw outlines of removed parts (before) or closed areas (after), kept and skipped ones."""
    for removals, colour in (
        (picture.removed, _VEHICLE),
        (picture.kept, _KEPT),
        (picture.passed, _OTHER),
    ):
        outlined = [one for one in removals if one.outline is not None]
        for one in outlined:
            if colour == _OTHER and not before:
                continue
            _border(axes, one.outline or shapely.Point(), colour, 1.4 if before else 0.8)
        points = np.array([one.at[:2] for one in removals if one.outline is None])
        if len(points) and before:
            axes.scatter(
                points[:, 0],
                points[:, 1],
                s=9,
                marker="x",
                linewidths=0.8,
                c=_SHARD if colour == _VEHICLE else colour,
                zorder=30,
            )


def _legend(figure: Figure) -> None:
    handles = [
        Line2D([], [], color=_VEHICLE, label="traffic, cut out and closed"),
        Line2D([], [], color=_SHARD, marker="x", lw=0, label="shard or stray point"),
        Line2D([], [], color=_KEPT, label="kept by an override"),
        Line2D([], [], color=_OTHER, label="no vehicle by the rules"),
        Line2D([], [], color=style.ACCENT, label="carriageway"),
    ]
    figure.legend(
        handles=handles,
        loc="upper right",
        bbox_to_anchor=(1 - 0.2 / figure.get_figwidth(), 1 - 0.12 / figure.get_figheight()),
        ncols=len(handles),
        fontsize=9,
        frameon=False,
        labelcolor=style.INK,
        borderaxespad=0.0,
    )


def _summary(picture: CleaningPicture) -> str:
    def counted(removals: tuple[Removal, ...]) -> str:
        number = Counter(one.what for one in removals)
        return ", ".join(
            f"{count:,} {what if count == 1 else _PLURAL.get(what, what + 's')}"
            for what, count in sorted(number.items())
        )

    text = f"taken out: {counted(picture.removed) or 'nothing'}"
    if picture.kept:
        text += f"   kept: {counted(picture.kept)}"
    return text
