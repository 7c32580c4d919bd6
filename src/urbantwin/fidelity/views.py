"""Pictures of one pair of frames, of what the twin lacks, and of objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame

__all__ = ["draw_objects", "draw_pair"]

_INK, _FAINT = "#1d2733", "#d5dbe2"
_REAL, _TWIN, _OTHER, _LOST = "#7b8794", "#1769e0", "#e8710a", "#d11f3a"
_COLOURS = {"real": _REAL, "synthetic": _TWIN, "arbitrary": _OTHER}
_LABELLED = 10
_RANGE_COLUMNS, _RANGE_ROWS = 720, 96


def draw_pair(
    real: Frame,
    twin: Frame,
    missing: NDArray[np.float64],
    places: Sequence[Mapping[str, Any]],
    origin: NDArray[np.float64],
    path: Path,
) -> None:
    """Write a picture: both frames from above, what is missing, and both range images.

    Args:
        real: the real frame.
        twin: the synthetic one.
        missing: (K, 3) real points of all frames that have nothing of the twin near them.
        places: where they are gathered, worst first (`MissingPlaces.places`).
        origin: (3,) the sensor's place.
        path: the PNG to write.
    """
    figure = Figure(figsize=(16, 10.4), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        3,
        3,
        height_ratios=(3.4, 1, 1),
        left=0.04,
        right=0.985,
        top=0.955,
        bottom=0.045,
        hspace=0.24,
        wspace=0.12,
    )
    away = np.abs(real.points[:, :2] - origin[:2]).max(axis=1)
    reach = float(np.clip(np.percentile(away, 97), 10, 80))
    height = [float(value) for value in np.percentile(real.points[:, 2], [2, 98])]
    for place, (frame, title) in enumerate(((real, "Real"), (twin, "Twin"))):
        axes = figure.add_subplot(grid[0, place])
        _plan(axes, f"{title}: {frame.name}, {len(frame.points):,} points", origin, reach)
        order = np.argsort(frame.points[:, 2], kind="stable")
        x, y, z = frame.points[order].T
        axes.scatter(x, y, c=z, s=0.5, cmap="viridis", vmin=height[0], vmax=height[1], linewidths=0)
        _boxes(axes, frame)
    axes = figure.add_subplot(grid[0, 2])
    _plan(axes, "What the twin lacks (real points with nothing near)", origin, reach)
    axes.scatter(real.points[:, 0], real.points[:, 1], color=_FAINT, s=0.5, linewidths=0)
    axes.scatter(missing[:, 0], missing[:, 1], color=_LOST, s=1.2, linewidths=0)
    for number, one in enumerate(places[:_LABELLED], start=1):
        if max(abs(one["x"] - origin[0]), abs(one["y"] - origin[1])) < reach:
            axes.text(
                one["x"],
                one["y"],
                str(number),
                fontsize=9,
                weight="bold",
                color=_INK,
                ha="center",
                va="center",
                bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "ec": _LOST, "alpha": 0.85},
            )
    images = [_range_image(frame, origin, real) for frame in (real, twin)]
    far = float(np.nanpercentile(images[0], 97)) if np.isfinite(images[0]).any() else 1.0
    for row, (image, title) in enumerate(zip(images, ("Real", "Twin"), strict=True), start=1):
        axes = figure.add_subplot(grid[row, :])
        axes.set_title(f"{title}: range, 0 to {far:.0f} m", loc="left", fontsize=10, color=_INK)
        axes.imshow(
            image,
            origin="lower",
            aspect="auto",
            cmap="turbo",
            vmin=0,
            vmax=far,
            extent=(-180, 180, *_elevations(real, origin)),
            interpolation="nearest",
        )
        axes.set_ylabel("elevation, deg", fontsize=8)
        axes.tick_params(labelsize=8)
    axes.set_xlabel("azimuth, deg", fontsize=8)
    figure.savefig(path, metadata={"Software": None})


def _plan(axes: Axes, title: str, origin: NDArray[np.float64], reach: float) -> None:
    axes.set_title(title, loc="left", fontsize=11, color=_INK, weight="bold")
    axes.set_aspect("equal")
    axes.set_xlim(origin[0] - reach, origin[0] + reach)
    axes.set_ylim(origin[1] - reach, origin[1] + reach)
    axes.plot(origin[0], origin[1], marker="+", color=_INK, markersize=10)
    axes.tick_params(labelsize=8)
    for spine in axes.spines.values():
        spine.set_color(_FAINT)


def _boxes(axes: Axes, frame: Frame) -> None:
    if frame.boxes is None:
        return
    for x, y, _, length, width, _, yaw in frame.boxes.box:
        c, s = np.cos(yaw), np.sin(yaw)
        corner = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) / 2 * [length, width]
        turned = corner @ np.array([[c, s], [-s, c]]) + [x, y]
        axes.plot(*turned.T, color=_OTHER, linewidth=0.8)


def _elevations(frame: Frame, origin: NDArray[np.float64]) -> tuple[float, float]:
    seen = frame.points - origin
    elevation = np.degrees(np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1])))
    low, high = np.percentile(elevation, [0.2, 99.8])
    return float(low), float(max(high, low + 1.0))


def _range_image(frame: Frame, origin: NDArray[np.float64], like: Frame) -> NDArray[np.float64]:
    """Return the nearest range by cells of direction, NaN for none: the same cells for both."""
    low, high = _elevations(like, origin)
    seen = frame.points - origin
    distance = np.linalg.norm(seen, axis=1)
    azimuth = np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))
    elevation = np.degrees(np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1])))
    column = np.clip((azimuth + 180) / 360 * _RANGE_COLUMNS, 0, _RANGE_COLUMNS - 1).astype(int)
    row = np.floor((elevation - low) / (high - low) * _RANGE_ROWS).astype(int)
    inside = (row >= 0) & (row < _RANGE_ROWS)
    image = np.full((_RANGE_ROWS, _RANGE_COLUMNS), np.inf)
    np.minimum.at(image, (row[inside], column[inside]), distance[inside])
    return np.where(np.isfinite(image), image, np.nan)


def draw_objects(objects: Mapping[str, Any], path: Path) -> None:
    """Write a picture of labelled objects: boxes a frame, sizes, points a box, heat map.

    Args:
        objects: as ``report.json`` has them.
        path: the PNG to write.
    """
    sides = [side for side in _COLOURS if side in objects]
    names = sorted({name for side in sides for name in objects[side]["classes"]})
    commonest = sorted(names, key=lambda name: -_boxes_of(objects["real"], name))[:3]
    figure = Figure(figsize=(16, 6.6), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2, 4, left=0.045, right=0.985, top=0.93, bottom=0.09, hspace=0.42, wspace=0.22
    )
    shown = {"Boxes a frame": "", "Mean length, m": "length_m"}
    shown |= {"Mean width, m": "width_m", "Mean height, m": "height_m"}
    for place, (title, size) in enumerate(shown.items()):
        axes = figure.add_subplot(grid[0, place])
        _titled(axes, title)
        width = 0.8 / len(sides)
        for number, side in enumerate(sides):
            classes = objects[side]["classes"]
            heights = [_bar(classes.get(name), size) for name in names]
            left = np.arange(len(names)) - 0.4 + width * (number + 0.5)
            axes.bar(left, heights, width * 0.92, color=_COLOURS[side], label=side)
        axes.set_xticks(range(len(names)), names, rotation=25, ha="right")
        if not place:
            axes.legend(fontsize=8, frameon=False)
    for place, name in enumerate(commonest):
        axes = figure.add_subplot(grid[1, place])
        _titled(axes, f"Points a box, {name}: median, P20 to P80")
        for side in sides:
            rows = objects[side]["classes"].get(name, {"points_per_box": []})["points_per_box"]
            if rows:
                middle = [(row["from_m"] + row["to_m"]) / 2 for row in rows]
                axes.plot(middle, [row["median"] for row in rows], marker="o", color=_COLOURS[side])
                axes.fill_between(
                    middle,
                    [row["p20"] for row in rows],
                    [row["p80"] for row in rows],
                    color=_COLOURS[side],
                    alpha=0.15,
                    linewidth=0,
                )
        axes.set_yscale("symlog", linthresh=1)
        axes.set_ylim(bottom=0)
        axes.set_xlabel("distance, m", fontsize=9)
    axes = figure.add_subplot(grid[1, 3])
    _titled(axes, "Where boxes are (m, from above)")
    for side, area in (("real", 34.0), ("synthetic", 7.0)):
        if side in objects and objects[side]["heat_map"]["x_y_boxes"]:
            heat = objects[side]["heat_map"]
            x, y, count = np.array(heat["x_y_boxes"], np.float64).T
            half = heat["cell_m"] / 2
            shade = np.clip(0.25 + 0.75 * count / count.max(), 0, 1)
            axes.scatter(
                x + half, y + half, s=area, c=_COLOURS[side], alpha=shade, marker="s", linewidths=0
            )
    axes.set_aspect("equal", adjustable="datalim")
    figure.savefig(path, metadata={"Software": None})


def _bar(one: Mapping[str, Any] | None, size: str) -> float:
    if one is None:
        return 0.0
    return float(one["dimensions"][size]["mean"] if size else one["per_frame"])


def _boxes_of(side: Mapping[str, Any], name: str) -> int:
    return int(side["classes"].get(name, {"boxes": 0})["boxes"])


def _titled(axes: Axes, title: str) -> None:
    axes.set_title(title, loc="left", fontsize=10, color=_INK, weight="bold")
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, axis="y", color=_FAINT, linewidth=0.6)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(_FAINT)
