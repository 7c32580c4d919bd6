"""Why an object is not seen: outside, too far, hidden, and by whom."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.web.shown_boxes import ShownBoxes

__all__ = ["explain_unseen"]

#: Fewer points than this, and an object is explained.
_FEW = 5
#: Rays from a sensor to so many places of an object: its middle, and half way to its faces.
_TOWARDS = np.array(
    [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float
)
#: This share of the rays must meet another box before it is said to hide the object.
_SHARE = 0.15
#: Share of hidden rays above which an object that would have points is called hidden.
_HIDDEN = 0.5


def explain_unseen(boxes: ShownBoxes, sensors: NDArray[np.float64], range_m: float) -> None:
    """Say of objects with few points why, into ``hidden_by`` and ``why``.

    What labels say comes first (why they do not count them, how many points they would have
    alone); who hides an object is found by rays from the nearest sensor to its middle and towards
    its faces, against the boxes of all others.

    Args:
        boxes: labels of one frame.
        sensors: (S, 3) where the sensors are, in the same frame.
        range_m: how far they see; infinity where that is not known.
    """
    count = len(boxes)
    boxes.hidden_by = [None] * count
    boxes.why = [""] * count
    if boxes.points is None or not len(sensors):
        return
    for row in np.flatnonzero((boxes.points >= 0) & (boxes.points < _FEW)):
        away = np.linalg.norm(sensors - boxes.box[row, :3], axis=1)
        nearest = int(away.argmin())
        alone = -1 if boxes.alone is None else int(boxes.alone[row])
        outside = bool(boxes.ignored) and (boxes.ignored or [""])[row] == "outside"
        hiding: list[int] = []
        if not outside and alone != 0 and away[nearest] < range_m:
            rows = _between(boxes.box, int(row), sensors[nearest])
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
    if alone > points and hiding:
        return f"{seen} and would have {alone} alone: {_listed(hiding)} stands before it."
    if alone > points:
        return f"{seen} and would have {alone} alone: others stand before it."
    if hiding:
        return f"{seen}: {_listed(hiding)} stands before it."
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


def _between(
    box: NDArray[np.float64], row: int, sensor: NDArray[np.float64], most: int = 3
) -> list[int]:
    """Return rows of boxes between a sensor and a box, those that hide most of it first."""
    mine = box[row]
    along = np.array([np.cos(mine[6]), np.sin(mine[6]), 0.0])
    across = np.array([-along[1], along[0], 0.0])
    half = 0.25 * _TOWARDS * mine[3:6]
    targets = mine[:3] + half[:, :1] * along + half[:, 1:2] * across
    targets[:, 2] += half[:, 2]
    distance = float(np.linalg.norm(mine[:3] - sensor))
    far = np.linalg.norm(box[:, :3] - sensor, axis=1)
    reach = np.linalg.norm(box[:, 3:6], axis=1) / 2
    near = np.flatnonzero(far - reach < distance)
    near = near[near != row]
    cos, sin = np.cos(box[near, 6]), np.sin(box[near, 6])

    def own(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = (vectors[..., axis] + 0.0 * cos for axis in range(3))
        return np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=-1)

    start = own(sensor - box[near, :3])  # (K, 3)
    ray = own((targets - sensor)[:, None, :])  # (T, K, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (-box[near, 3:6] / 2 - start) / ray
        last = (box[near, 3:6] / 2 - start) / ray
    enter = np.nanmax(np.fmin(first, last), axis=-1)
    leave = np.nanmin(np.fmax(first, last), axis=-1)
    hit = (enter <= leave) & (leave > 0) & (enter < 1.0)
    share = hit.mean(axis=0)
    order = np.argsort(-share, kind="stable")[:most]
    return [int(near[one]) for one in order if share[one] >= _SHARE]
