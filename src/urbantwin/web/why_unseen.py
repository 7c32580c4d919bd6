"""Reasons for objects with few points: outside, out of range, or occluded by other objects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.sight import LineOfSight
from urbantwin.web.shown_boxes import ShownBoxes

__all__ = ["explain_unseen"]

#: An object with fewer points than this is explained.
_FEW = 5
#: Targets of lines of sight: the box centre, and half way to each face (along, across, up).
_TOWARDS = np.array(
    [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float
)
#: Fraction of these lines that an occluding box must block to be listed, and most boxes listed.
_SHARE, _MOST = 0.15, 3
#: Fraction of blocked rays above which an object with potential points counts as occluded.
_HIDDEN = 0.5


def explain_unseen(boxes: ShownBoxes, sensors: NDArray[np.float64], range_m: float) -> None:
    """Set ``hidden_by`` and ``why`` of objects with few points.

    Labels take precedence (why they do not count, and the points without occlusion); an occluding
    object is a box that blocks lines of sight from the nearest sensor.

    Args:
        boxes: labels of one frame.
        sensors: (S, 3) positions of the sensors, in the same frame.
        range_m: range of the sensors, metres; infinity if unknown.
    """
    count = len(boxes)
    boxes.hidden_by = [None] * count
    boxes.why = [""] * count
    if boxes.points is None or not len(sensors):
        return
    few = np.flatnonzero((boxes.points >= 0) & (boxes.points < _FEW))
    sight = LineOfSight.past_boxes(boxes.box, sensors[0, :2]) if len(few) else None
    for row in few:
        away = np.linalg.norm(sensors - boxes.box[row, :3], axis=1)
        nearest = int(away.argmin())
        alone = -1 if boxes.alone is None else int(boxes.alone[row])
        outside = bool(boxes.ignored) and (boxes.ignored or [""])[row] == "outside"
        hiding: list[int] = []
        if not outside and alone != 0 and away[nearest] < range_m:
            assert sight is not None
            rows = _before(sight, boxes.box, int(row), sensors[nearest])
            hiding = [int(boxes.track[one]) for one in rows]
            boxes.hidden_by[row] = [one for one in hiding if one >= 0]
            names = [_named(boxes, one) for one in rows]
        else:
            names = []
        boxes.why[row] = _sentence(
            int(boxes.points[row]), alone, float(away[nearest]), range_m, outside, names,
            None if boxes.occlusion is None else float(boxes.occlusion[row]),
            None if boxes.truncation is None else float(boxes.truncation[row]),
        )  # fmt: skip


def _before(
    sight: LineOfSight, box: NDArray[np.float64], row: int, sensor: NDArray[np.float64]
) -> list[int]:
    """Return rows of boxes that occlude a box, in descending order of blocked lines of sight."""
    x, y, z = np.moveaxis(_TOWARDS * box[row, 3:6] / 4, -1, 0)
    cos, sin = np.cos(box[row, 6]), np.sin(box[row, 6])
    targets = box[row, :3] + np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1)
    hits, away = sight.towards(sensor, targets)
    ended = sight.mesh.part[hits.face[(hits.face >= 0) & (hits.range_m < away)]]
    share = np.bincount(ended[ended != row], minlength=len(box)) / len(targets)
    order = np.argsort(-share, kind="stable")[:_MOST]
    return [int(one) for one in order if share[one] >= _SHARE]


def _sentence(  # noqa: PLR0911 - a reason each
    points: int,
    alone: int,
    away_m: float,
    range_m: float,
    outside: bool,
    hiding: list[str],
    occlusion: float | None,
    truncation: float | None,
) -> str:
    seen = "It has no point" if not points else f"It has {points} point{'s'[: points > 1]}"
    if outside:
        return f"{seen}: it stands outside of the region that is labelled."
    if away_m > range_m:
        return f"{seen}: it is {away_m:.0f} m away, and the sensor sees {range_m:.0f} m far."
    before = (
        f"{_listed(hiding)} {'stands' if len(hiding) == 1 else 'stand'} before it" if hiding else ""
    )
    if alone > points and hiding:
        return f"{seen} and would have {alone} alone: {before}."
    if alone > points:
        return f"{seen} and would have {alone} alone: others stand before it."
    if hiding:
        return f"{seen}: {before}."
    if truncation is not None and truncation > _HIDDEN:
        return f"{seen}: {truncation:.0%} of it lies where no beam goes."
    if alone == 0:
        return (
            f"{seen}, and would have none alone: what always stands there hides it, or it lies "
            f"between or beyond the beams ({away_m:.0f} m away)."
        )
    if occlusion is not None and occlusion > _HIDDEN:
        return f"{seen}: {occlusion:.0%} of it is hidden."
    if alone == points:
        return f"{seen}, as many as alone: few beams reach it {away_m:.0f} m away."
    return f"{seen}: few beams reach it {away_m:.0f} m away, or something else hides it."


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _named(boxes: ShownBoxes, row: int) -> str:
    track = int(boxes.track[row])
    return f"{boxes.class_names[row]} {track}" if track >= 0 else f"a {boxes.class_names[row]}"
