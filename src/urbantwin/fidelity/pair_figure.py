"""Pictures of one pair of frames, of what the twin lacks, and of labelled objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.missing import NEAR_M, SPACING_SHARE
from urbantwin.fidelity.nearest_point import nearest_distances
from urbantwin.fidelity.report_style import (
    COLOURS,
    FAINT,
    INK,
    LOST,
    blank,
    from_above,
    legend,
    plain,
    save,
)

__all__ = ["draw_missing", "draw_objects", "draw_pair"]

#: Number of places numbered in the picture.
_LABELLED = 20
_COLUMNS, _ROWS = 720, 96
#: Number of rings below which range images have a third of the rows.
_DENSE_RINGS = 48


def draw_pair(real: Frame, twin: Frame, origin: NDArray[np.float64], path: Path) -> None:
    """Draw both frames from above, their differences, and both range images.

    Args:
        real: the real frame.
        twin: the synthetic frame.
        origin: (3,) position of the sensor.
        path: the PNG to write.
    """
    figure = blank(15, 8.6)
    grid = figure.add_gridspec(
        3,
        3,
        height_ratios=(3.4, 1, 1),
        left=0.035,
        right=0.99,
        top=0.965,
        bottom=0.05,
        hspace=0.25,
        wspace=0.1,
    )
    reach = _reach(real.points, origin)
    low, high = np.percentile(real.points[:, 2], [2, 98])
    for place, (frame, title) in enumerate(((real, "Real"), (twin, "Twin"))):
        axes = figure.add_subplot(grid[0, place])
        height = np.clip((frame.points[:, 2] - low) / max(high - low, 1e-3), 0, 1)
        shades = colormaps["viridis"](0.92 * height)[:, :3]
        said = f"{title}: {frame.name}, {len(frame.points):,} points"
        from_above(axes, said, origin, reach, [(frame.points, shades)])
        _boxes(axes, frame, origin, reach)
    near = nearest_distances(real.points, twin.points)
    lacks = _alone(real.points, near.real_to_synthetic, origin)
    adds = _alone(twin.points, near.synthetic_to_real, origin)
    axes = figure.add_subplot(grid[0, 2])
    layers = [
        (real.points, to_rgb(FAINT)),
        (twin.points[adds], to_rgb(COLOURS["synthetic"])),
        (real.points[lacks], to_rgb(LOST)),
    ]
    from_above(axes, f"Nothing of the other within {NEAR_M:g} m", origin, reach, layers)
    for height, text, colour in (
        (0.97, "■ real alone", LOST),
        (0.925, "■ twin alone", COLOURS["synthetic"]),
    ):
        axes.text(
            0.03,
            height,
            text,
            transform=axes.transAxes,
            color=colour,
            fontsize=9,
            weight="bold",
            va="top",
            bbox={"fc": "white", "ec": "none", "pad": 1.5},
        )
    dense = real.ring is None or len(np.unique(real.ring)) >= _DENSE_RINGS
    rows = _ROWS if dense else _ROWS // 3
    images = [_range_image(frame, origin, real, rows) for frame in (real, twin)]
    far = float(np.nanpercentile(images[0], 97)) if np.isfinite(images[0]).any() else 1.0
    for row, (image, title) in enumerate(zip(images, ("Real", "Twin"), strict=True), start=1):
        axes = figure.add_subplot(grid[row, :])
        said = f"{title}: range from {far:.0f} m (red) to 0 (blue); white: no return"
        axes.set_title(said, loc="left", fontsize=10, color=INK)
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
        axes.set_xticks(range(-180, 181, 45))
    axes.set_xlabel("azimuth, deg", fontsize=8)
    save(figure, path)


def draw_missing(
    sample: Frame,
    missing: NDArray[np.float64],
    places: Sequence[Mapping[str, Any]],
    origin: NDArray[np.float64],
    path: Path,
) -> None:
    """Draw a map of what the twin lacks, from above and from the side.

    Args:
        sample: a real frame.
        missing: (K, 3) real points of all frames without points of the twin nearby.
        places: their cells, worst first (`MissingPlaces.places`).
        origin: (3,) position of the sensor.
        path: the PNG to write.
    """
    figure = blank(15, 7.4)
    grid = figure.add_gridspec(1, 2, left=0.035, right=0.99, top=0.95, bottom=0.06, wspace=0.1)
    above, side = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    reach = _reach(np.concatenate([sample.points, missing]), origin)
    layers = [(sample.points, to_rgb(FAINT)), (missing, to_rgb(LOST))]
    from_above(above, "From above, m", origin, reach, layers)
    side.set_title("By distance and height, m", loc="left", fontsize=11, color=INK, weight="bold")
    for points, colour in ((sample.points, FAINT), (missing, LOST)):
        away = np.hypot(*(points[:, :2] - origin[:2]).T)
        side.scatter(away, points[:, 2], color=colour, s=0.6, linewidths=0, rasterized=True)
    side.set_xlim(0, reach * 1.3)
    low, high = np.percentile(sample.points[:, 2], [0.5, 99.5])
    side.set_ylim(low - 1, high + 2)
    side.tick_params(labelsize=8)
    for number, one in list(enumerate(places[:_LABELLED], start=1))[::-1]:
        if max(abs(one["x"] - origin[0]), abs(one["y"] - origin[1])) < reach:
            _number(above, one["x"], one["y"], number)
            away = float(np.hypot(one["x"] - origin[0], one["y"] - origin[1]))
            _number(side, away, (one["low"] + one["high"]) / 2, number)
    save(figure, path)


def _alone(
    points: NDArray[np.float64], nearest: NDArray[np.float64], origin: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return the mask of (N, 3) points without points of the other cloud nearby."""
    away = np.linalg.norm(points - origin, axis=1)
    return np.asarray(nearest > np.maximum(NEAR_M, SPACING_SHARE * away))


def _number(axes: Axes, x: float, y: float, number: int) -> None:
    axes.text(
        x,
        y,
        str(number),
        fontsize=8,
        weight="bold",
        color=INK,
        ha="center",
        va="center",
        clip_on=True,
        bbox={"boxstyle": "circle,pad=0.15", "fc": "white", "ec": LOST, "alpha": 0.85},
    )


def _reach(points: NDArray[np.float64], origin: NDArray[np.float64]) -> float:
    away = np.abs(points[:, :2] - origin[:2]).max(axis=1)
    return float(np.clip(np.percentile(away, 97), 10, 80))


def _boxes(axes: Axes, frame: Frame, origin: NDArray[np.float64], reach: float) -> None:
    if frame.boxes is None:
        return
    for x, y, _, length, width, _, yaw in frame.boxes.box:
        if max(abs(x - origin[0]), abs(y - origin[1])) > reach:
            continue
        c, s = np.cos(yaw), np.sin(yaw)
        corner = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) / 2 * [length, width]
        turned = corner @ np.array([[c, s], [-s, c]]) + [x, y]
        axes.plot(*turned.T, color=COLOURS["arbitrary"], linewidth=0.8)


def _elevations(frame: Frame, origin: NDArray[np.float64]) -> tuple[float, float]:
    seen = frame.points - origin
    elevation = np.degrees(np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1])))
    low, high = np.percentile(elevation, [0.2, 99.8])
    return float(low), float(max(high, low + 1.0))


def _range_image(
    frame: Frame, origin: NDArray[np.float64], like: Frame, rows: int
) -> NDArray[np.float64]:
    """Return the nearest range by cells of direction, NaN for none, with equal cells for both."""
    low, high = _elevations(like, origin)
    seen = frame.points - origin
    distance = np.linalg.norm(seen, axis=1)
    azimuth = np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))
    elevation = np.degrees(np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1])))
    column = np.clip((azimuth + 180) / 360 * _COLUMNS, 0, _COLUMNS - 1).astype(int)
    row = np.floor((elevation - low) / (high - low) * rows).astype(int)
    inside = (row >= 0) & (row < rows)
    image = np.full((rows, _COLUMNS), np.inf)
    np.minimum.at(image, (row[inside], column[inside]), distance[inside])
    return np.where(np.isfinite(image), image, np.nan)


_SIDES = {"real": "real", "synthetic": "twin", "arbitrary": "arbitrary site"}
#: Number of classes whose points per box are drawn, the most frequent.
_DRAWN = 3
#: Maximum half edge of the maps, metres.
_FARTHEST_M = 120.0


def draw_objects(objects: Mapping[str, Any], path: Path) -> None:
    """Draw the statistics of labelled objects.

    Args:
        objects: entry ``objects`` of ``report.json``.
        path: the PNG to write.
    """
    sides = [side for side in COLOURS if side in objects]
    names = sorted({name for side in sides for name in objects[side]["classes"]})
    figure = blank(15, 10.6)
    grid = figure.add_gridspec(
        3,
        12,
        height_ratios=(1, 1, 1.7),
        left=0.04,
        right=0.99,
        top=0.93,
        bottom=0.045,
        hspace=0.42,
        wspace=1.1,
    )
    legend(figure, [(_SIDES[side], COLOURS[side]) for side in sides], 0.035, 0.995)
    shown = {"Boxes a frame": "", "Mean length, m": "length_m"}
    shown |= {"Mean width, m": "width_m", "Mean height, m": "height_m"}
    for place, (title, size) in enumerate(shown.items()):
        axes = figure.add_subplot(grid[0, 3 * place : 3 * place + 3])
        plain(axes, title)
        width = 0.8 / len(sides)
        for number, side in enumerate(sides):
            heights = [_bar(objects[side]["classes"].get(name), size) for name in names]
            left = np.arange(len(names)) - 0.4 + width * (number + 0.5)
            axes.bar(left, heights, width * 0.92, color=COLOURS[side])
        axes.set_xticks(range(len(names)), names, rotation=25, ha="right")
    commonest = sorted(names, key=lambda name: -_count(objects["real"], name))[:_DRAWN]
    for place, name in enumerate(commonest):
        axes = figure.add_subplot(grid[1, 4 * place : 4 * place + 4])
        _points_a_box(axes, objects, sides, name)
    there = [side for side in sides if objects[side]["heat_map"]["x_y_boxes"]]
    reach = max((_object_figure_reach(objects[side]["heat_map"]) for side in there), default=1.0)
    for place, side in enumerate(there):
        axes = figure.add_subplot(grid[2, 4 * place : 4 * place + 4])
        _heat_map(axes, objects[side]["heat_map"], objects[side]["frames"], reach)
        title = f"Boxes a frame in 2 m cells, {_SIDES[side]}"
        axes.set_title(title, loc="left", fontsize=10, weight="bold")
    save(figure, path)


def _points_a_box(axes: Axes, objects: Mapping[str, Any], sides: list[str], name: str) -> None:
    plain(axes, f"Points a box, {name}, by m: median, P20 to P80")
    for side in sides:
        rows = objects[side]["classes"].get(name, {"points_per_box": []})["points_per_box"]
        if rows:
            middle = [(row["from_m"] + row["to_m"]) / 2 for row in rows]
            axes.plot(middle, [row["median"] for row in rows], marker="o", color=COLOURS[side])
            axes.fill_between(
                middle,
                [row["p20"] for row in rows],
                [row["p80"] for row in rows],
                color=COLOURS[side],
                alpha=0.15,
                linewidth=0,
            )
    axes.set_yscale("symlog", linthresh=1)
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _heat_map(axes: Axes, heat: Mapping[str, Any], frames: int, reach: float) -> None:
    x, y, count = np.array(heat["x_y_boxes"], np.float64).T
    cells = int(np.ceil(reach / heat["cell_m"]))
    image: NDArray[np.float64] = np.full((2 * cells, 2 * cells), np.nan)
    column = np.rint(x / heat["cell_m"]).astype(int) + cells
    row = np.rint(y / heat["cell_m"]).astype(int) + cells
    inside = (np.minimum(row, column) >= 0) & (np.maximum(row, column) < 2 * cells)
    image[row[inside], column[inside]] = count[inside] / frames
    half = cells * heat["cell_m"]
    axes.set_facecolor("#f2f5f8")
    axes.imshow(
        image,
        origin="lower",
        extent=(-half, half, -half, half),
        cmap="inferno_r",
        vmin=0,
        vmax=1,
        interpolation="nearest",
    )
    axes.tick_params(labelsize=8)


def _object_figure_reach(heat: Mapping[str, Any]) -> float:
    x, y, _ = np.array(heat["x_y_boxes"], np.float64).T
    return float(min(np.abs([x, y]).max() + 2 * heat["cell_m"], _FARTHEST_M))


def _bar(one: Mapping[str, Any] | None, size: str) -> float:
    if one is None:
        return 0.0
    return float(one["dimensions"][size]["mean"] if size else one["per_frame"])


def _count(side: Mapping[str, Any], name: str) -> int:
    return int(side["classes"].get(name, {"boxes": 0})["boxes"])
