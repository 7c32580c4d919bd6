"""Picture of an object in both recordings: points, occluding object, labels and detections."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from urbantwin.evaluation import JUDGED
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.report_style import COLOURS, FAINT, INK, LOST, blank, legend, save
from urbantwin.geometry import box_corners
from urbantwin.studies.causes.changes import LOST as FOUND_TO_MISSED
from urbantwin.studies.causes.changes import Change, Comparison
from urbantwin.studies.causes.side import Side

__all__ = ["draw_change"]

_FOUND, _HIDER = COLOURS["synthetic"], COLOURS["arbitrary"]
#: Half the edge of a picture: at least this, metres, or this factor times the length.
_LEAST_M, _TIMES = 7.0, 1.8
#: Height above the lowest points up to which points count as ground, metres.
_GROUND_M = 0.2


def draw_change(
    change: Change, compared: Comparison, least: Mapping[str, float], path: Path
) -> None:
    """Draw one object in both recordings, from above.

    Args:
        change: the change of the object.
        compared: both recordings.
        least: by class, the minimum score of a detection that counts.
        path: the PNG to write.
    """
    figure = blank(9.6, 5.4)
    legend(
        figure,
        [("the object", INK), ("labelled", "#9aa7b4"), ("detected", _FOUND)]
        + [("too low a score", "#8fb8ee"), ("hides it", _HIDER)],
        0.03,
        0.995,
    )
    figure.text(
        0.03,
        0.018,
        f"{change.actor} {change.track}, {change.way}: {change.reason.reason}. "
        f"{'; '.join(dict.fromkeys((change.reason.told, change.said.told)))}."[:150],
        fontsize=8.5,
        color=INK,
    )
    for number, side in enumerate((compared.base, compared.variant)):
        axes = figure.add_axes((0.05 + 0.485 * number, 0.1, 0.44, 0.76))
        missed = (number == 1) == (change.way == FOUND_TO_MISSED)
        row = side.rows[change.frame, change.track]
        hit = int(compared.found[number][row])
        _draw(axes, change, side, row, change.said.detection if missed else hit, least)
        word = "missed" if missed else "found"
        axes.set_title(
            f"{side.name}: {word}, {change.points[number]} points",
            loc="left",
            fontsize=9,
            color=LOST if missed else INK,
        )
    save(figure, path)


def _draw(
    axes: Axes, change: Change, side: Side, row: int, named: int, least: Mapping[str, float]
) -> None:
    truth, found = side.seen.truth, side.seen.detections
    frame: Frame = side.recording.read(side.seen.number[int(truth.frame[row])])
    own = truth.box[row]
    reach = max(_LEAST_M, _TIMES * float(own[3]))
    near = frame.points[(np.abs(frame.points[:, :2] - own[:2]) <= reach).all(axis=1)]
    floor = np.percentile(near[:, 2], 2) if len(near) else 0.0
    high = near[:, 2] > floor + _GROUND_M
    axes.plot(*near[~high, :2].T, ".", color=FAINT, markersize=1.5)
    axes.plot(*near[high, :2].T, ".", color="#5a6675", markersize=2.0)
    at = frame.sensor_places
    away = at[np.argmin(np.hypot(*(at[:, :2] - own[:2]).T)), :2] if len(at) else own[:2]
    axes.plot(*np.array([own[:2], away]).T, ":", color=FAINT, linewidth=1.0)
    for other in np.flatnonzero(truth.frame == truth.frame[row]):
        hides = change.reason.by_track is not None and truth.track[other] == change.reason.by_track
        colour = INK if other == row else _HIDER if hides else "#9aa7b4"
        _box(axes, truth.box[other], colour, 2.4 if other == row else 1.0, filled=hides)
    for number in np.flatnonzero(found.frame == truth.frame[row]):
        name = next((one for one in least if found.class_names[number] in JUDGED[one]), None)
        enough = found.score[number] >= (least[name] if name else 0.0)
        special = number == named
        if enough or special:
            _box(axes, found.box[number], _FOUND if enough else "#8fb8ee", 1.2)
            if special:
                x, y = found.box[number, :2].tolist()
                axes.annotate(f"{found.score[number]:.2f}", (x, y), fontsize=8, color=_FOUND)
    axes.set(xlim=(own[0] - reach, own[0] + reach), ylim=(own[1] - reach, own[1] + reach))
    axes.set_aspect("equal")
    axes.tick_params(labelsize=6, length=2)
    for spine in axes.spines.values():
        spine.set_color(FAINT)


def _box(
    axes: Axes, box: NDArray[np.float64], colour: str, width: float, *, filled: bool = False
) -> None:
    corners = box_corners(box)[:4, :2]
    if filled:
        axes.add_patch(Polygon(corners, facecolor=colour, alpha=0.3))
    axes.add_patch(Polygon(corners, fill=False, edgecolor=colour, linewidth=width))
    nose = box[:2] + np.array([np.cos(box[6]), np.sin(box[6])]) * box[3] / 2
    axes.plot(*np.array([box[:2], nose]).T, color=colour, linewidth=width / 2)
