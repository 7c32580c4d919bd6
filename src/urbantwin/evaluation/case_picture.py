"""Misses and false alarms as pictures: the points about them, what is labelled, what was found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from urbantwin.evaluation.evaluate import Figures
from urbantwin.evaluation.worst import Case
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.report_style import COLOURS, FAINT, INK, LOST, blank, legend, save
from urbantwin.geometry import box_corners

__all__ = ["draw_cases"]

_COLUMNS = 4
_FOUND = COLOURS["synthetic"]
#: Half the edge of a picture: at least this, or so many times the length, metres.
_LEAST_M, _TIMES = 5.0, 1.2
#: Above the lowest point about it, so that what is on the ground stands out, metres.
_GROUND_M = 0.2


def draw_cases(
    cases: Sequence[Case],
    figures: Figures,
    recording: Recording,
    path: Path,
) -> None:
    """Draw cases, each from above and from the side.

    Args:
        cases: at least one.
        figures: whose labels and detections are drawn.
        recording: whose points.
        path: the PNG to write.
    """
    rows = -(-len(cases) // _COLUMNS)
    figure = blank(15, 0.6 + 5.6 * rows)
    grid = figure.add_gridspec(
        2 * rows,
        _COLUMNS,
        left=0.03,
        right=0.99,
        top=1 - 0.75 / (0.6 + 5.6 * rows),
        bottom=0.03,
        hspace=0.28,
        wspace=0.12,
        height_ratios=[3.0, 1.5] * rows,
    )
    legend(
        figure,
        [("labelled", INK), ("labelled, does not count", "#9aa7b4"), ("detected", _FOUND)]
        + [("false alarm", LOST)] * any(one.score is not None for one in cases),
        0.025,
        0.998,
    )
    clouds: dict[int, NDArray[np.float64]] = {}
    for place, one in enumerate(cases):
        if one.frame not in clouds:
            clouds[one.frame] = recording.read(figures.seen.number[one.frame]).points
        row, column = divmod(place, _COLUMNS)
        above = figure.add_subplot(grid[2 * row, column])
        aside = figure.add_subplot(grid[2 * row + 1, column])
        _draw(above, aside, one, figures, clouds[one.frame])
    save(figure, path)


def _draw(
    above: Axes, aside: Axes, one: Case, figures: Figures, points: NDArray[np.float64]
) -> None:
    reach = max(_LEAST_M, _TIMES * float(one.box[3]))
    near = points[(np.abs(points[:, :2] - one.box[:2]) <= reach).all(axis=1)]
    named = figures.seen.truth.frames[one.frame].rsplit(".", 1)[0]
    score = "" if one.score is None else f" {one.score:.2f}"
    above.set_title(
        f"{one.class_name}{score} in {named[-12:]}, {one.range_m:.0f} m, "
        f"{one.num_points} points\n{one.told}",
        loc="left",
        fontsize=7.5,
        color=INK,
    )
    floor = np.percentile(near[:, 2], 2) if len(near) else 0.0
    high = near[:, 2] > floor + _GROUND_M
    above.plot(*near[~high, :2].T, ".", color=FAINT, markersize=1.2)
    above.plot(*near[high, :2].T, ".", color="#5a6675", markersize=1.6)
    ahead = np.array([np.cos(one.box[6]), np.sin(one.box[6])])
    left = np.array([-ahead[1], ahead[0]])
    strip = near[np.abs((near[:, :2] - one.box[:2]) @ left) <= one.box[4] / 2 + 0.5]
    aside.plot((strip[:, :2] - one.box[:2]) @ ahead, strip[:, 2], ".", color="#5a6675", ms=1.6)
    for box, colour, width in _boxes(one, figures):
        away = np.hypot(*(box[:2] - one.box[:2]))
        if away > 1.5 * reach + box[3:5].sum() / 2:
            continue  # out of both pictures: of a poor detector hundreds are
        corners = box_corners(box)
        above.add_patch(Polygon(corners[:4, :2], fill=False, edgecolor=colour, linewidth=width))
        nose = box[:2] + np.array([np.cos(box[6]), np.sin(box[6])]) * box[3] / 2
        above.plot(*np.array([box[:2], nose]).T, color=colour, linewidth=width / 2)
        if np.abs((box[:2] - one.box[:2]) @ left) <= box[4] / 2 + 0.5:
            u = (corners[:, :2] - one.box[:2]) @ ahead
            low, top = box[2] - box[5] / 2, box[2] + box[5] / 2
            outline = [(u.min(), low), (u.max(), low), (u.max(), top), (u.min(), top)]
            aside.add_patch(Polygon(outline, fill=False, edgecolor=colour, linewidth=width))
    x, y, z = one.box[:3]
    above.set(xlim=(x - reach, x + reach), ylim=(y - reach, y + reach), aspect="equal")
    aside.set(xlim=(-reach, reach), ylim=(z - 0.3 * reach - 1, z + 0.2 * reach + 2))
    aside.set_aspect("equal")
    for axes in (above, aside):
        axes.tick_params(labelsize=6, length=2)
        for spine in axes.spines.values():
            spine.set_color(FAINT)


def _boxes(one: Case, figures: Figures) -> list[tuple[NDArray[np.float64], str, float]]:
    """Return the boxes of the frame with their colours and widths, the case's own last."""
    truth, found = figures.seen.truth, figures.seen.detections
    own = figures.classes[one.class_name]
    drawn: list[tuple[NDArray[np.float64], str, float]] = []
    for row in np.flatnonzero(truth.frame == one.frame):
        counts = any(judged.roles[row] > 0 for judged in figures.classes.values())
        drawn.append((truth.box[row], INK if counts else "#9aa7b4", 1.2))
    mine = found.frame == one.frame
    threshold = own.threshold
    shown = np.flatnonzero(mine & (found.score >= threshold))
    drawn += [(found.box[row], _FOUND, 1.2) for row in shown]
    drawn.append((one.box, INK if one.score is None else LOST, 2.4))
    return drawn
