"""A picture of the sensors found: points by sensor from above, elevations against the channels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.ticker import NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from urbantwin.artefact import replaced_file
from urbantwin.fidelity.discovery.result import Discovery
from urbantwin.fidelity.report_style import FAINT, INK, blank, from_above, save

__all__ = ["draw_discovery"]

_BINS, _MARGIN_DEG = 640, 1.0


def draw_discovery(found: Discovery, points: NDArray[np.float64], path: Path) -> None:
    """Write a picture of one frame.

    Left, the points from above in the colours of their sensors, grey where no ring passes; right,
    a histogram of the elevations of each sensor's points, with the channels of its unit.

    Args:
        found: the sensors.
        points: (N, 3) of a frame.
        path: the PNG to write.
    """
    rays = found.rays(points)
    count = len(found.sensors)
    shades = np.array([colormaps["tab10"](number % 10)[:3] for number in range(count)])
    middle = np.median(points, axis=0)
    reach = float(np.percentile(np.abs(points[:, :2] - middle[:2]).max(axis=1), 97))
    figure = blank(16.0, 8.4)
    grid = figure.add_gridspec(
        count, 2, left=0.04, right=0.98, top=0.95, bottom=0.07, width_ratios=[1, 1.05], hspace=0.6
    )
    plan = figure.add_subplot(grid[:, 0])
    on = rays.sensor >= 0
    layers = [(points[~on], np.array([0.8, 0.8, 0.8])), (points[on], shades[rays.sensor[on]])]
    share = f"{on.mean():.0%} of {len(points):,} points on rings of {count}"
    from_above(plan, f"From above: {share}", middle, reach, layers)
    for number, one in enumerate(found.sensors):
        plan.plot(*one.place[:2], "o", markersize=9, color=shades[number], markeredgecolor=INK)
        plan.annotate(
            one.name,
            (float(one.place[0]), float(one.place[1])),
            xytext=(7, 7),
            textcoords="offset points",
            fontsize=9,
            color=INK,
            weight="bold",
            bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5},
        )
        axes = figure.add_subplot(grid[number, 1])
        mine = rays.sensor == number
        seen = one.fit.seen_from.elevation_deg(points[mine])
        table = one.fit.unit.elevation_deg
        low, high = table.min() - _MARGIN_DEG, table.max() + _MARGIN_DEG
        axes.hist(seen, _BINS, range=(low, high), color=shades[number], log=True)
        for up in table:
            axes.axvline(up, color=INK, linewidth=0.4, alpha=0.35)
        which = " or ".join(one.models) or "no model of the catalogue"
        axes.set_title(
            f"{one.name}: {which}, {one.rings} rings, off its model by "
            f"{one.off_model_deg:.2f} degrees",
            loc="left",
            fontsize=9,
            color=INK,
        )
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_xlim(low, high)
        axes.tick_params(labelsize=7)
        for spine in axes.spines.values():
            spine.set_color(FAINT)
        if number == count - 1:
            axes.set_xlabel("elevation of points, degrees (lines: channels)", fontsize=8)
    with replaced_file(path, kind="discover picture") as scratch:
        save(figure, scratch)
