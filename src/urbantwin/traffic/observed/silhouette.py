"""Classification of pedestrians and riders by their outline in one frame, and separation of groups.

A rider is as long as a bicycle below the saddle, and no longer than a trunk above its middle. Two
people side by side are equally long above; a person with a stroller or a dog is at its end; a
single pedestrian is short everywhere. In a group arms and wheels touch, but heads and shoulders do
not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import cdist

from urbantwin.traffic.observed.box_fit import fitted_yaw

__all__ = ["apart", "silhouette"]

#: Height of the saddle and of the trunk, metres above the ground; least number of points below and
#: above.
_SADDLE_M, _TRUNK_M = 0.9, 1.25
_MIN_LOW_POINTS, _MIN_HIGH_POINTS = 8, 4
#: Least length of a wheelbase, maximum length above it, and maximum length in all, metres.
_MIN_WHEELBASE_M, _MAX_LENGTH_ABOVE_M, _MAX_LENGTH_M = 1.05, 0.9, 2.5
#: Maximum offset of a rider from the middle, as a share of the length; a person pushing or leading
#: something is at its end.
_MIDDLE_SHARE = 0.25
#: Maximum width and height, and least height, of a rider, metres.
_MAX_RIDER_WIDTH_M, _MAX_RIDER_HEIGHT_M, _MIN_RIDER_HEIGHT_M = 0.95, 2.15, 1.3
#: Maximum length of a pedestrian, metres.
_MAX_PEDESTRIAN_M = 0.95
#: Least and greatest diagonal of a group, metres; least share of its points that belong to persons.
_MIN_GROUP_M, _MAX_GROUP_M, _MIN_PERSON_SHARE = 1.0, 4.0, 0.8
#: Maximum distance between points of one head and shoulders, metres; least distance between two
#: heads; maximum number of points used.
_HEAD_GAP_M, _HEAD_DISTANCE_M, _MAX_POINTS = 0.2, 0.5, 400


def silhouette(plan: NDArray[np.float64], above: NDArray[np.float64], yaw: float) -> str | None:
    """Return ``bicycle`` or ``pedestrian``; ``None`` if it may be either, or neither.

    Args:
        plan: (N, 2) points of an object in plan, metres.
        above: (N,) their heights above the ground, metres, without the ground itself.
        yaw: heading of its fitted sides, radians.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    turned = plan @ np.array([[c, -s], [s, c]])
    spans = np.ptp(turned, axis=0)
    along = turned[:, int(spans.argmax())]
    long, wide, top = float(spans.max()), float(spans.min()), float(above.max())
    if not _MIN_RIDER_HEIGHT_M < top < _MAX_RIDER_HEIGHT_M or wide > _MAX_RIDER_WIDTH_M:
        return None
    if long < _MAX_PEDESTRIAN_M:
        return "pedestrian"
    low = along[above < _SADDLE_M]
    high = along[above > _TRUNK_M]
    if long > _MAX_LENGTH_M or len(low) < _MIN_LOW_POINTS or len(high) < _MIN_HIGH_POINTS:
        return None
    wheels = float(np.ptp(low))
    if wheels < _MIN_WHEELBASE_M or np.ptp(high) > _MAX_LENGTH_ABOVE_M:
        return None
    off = abs(float(high.max() + high.min() - low.max() - low.min())) / 2
    return "bicycle" if off < _MIDDLE_SHARE * wheels else "pedestrian"


def apart(plan: NDArray[np.float64], above: NDArray[np.float64]) -> list[NDArray[np.intp]]:
    """Return the rows (M,) of each member of a group of people and riders; empty if it is none.

    Args:
        plan: (N, 2) points of an object in plan, metres.
        above: (N,) their heights above the ground, metres.
    """
    size = float(np.linalg.norm(np.ptp(plan, axis=0)))
    if (
        not _MIN_RIDER_HEIGHT_M < above.max() < _MAX_RIDER_HEIGHT_M
        or not _MIN_GROUP_M < size < _MAX_GROUP_M
    ):
        return []
    heads = _heads(plan[above > _TRUNK_M])
    if len(heads) < 2:
        return []
    nearest_head = cdist(plan, heads).argmin(axis=1)
    parts = [np.flatnonzero(nearest_head == k) for k in range(len(heads))]
    person_parts = [
        part
        for part in parts
        if len(part) and silhouette(plan[part], above[part], fitted_yaw(plan[part])) is not None
    ]
    return parts if sum(map(len, person_parts)) >= _MIN_PERSON_SHARE * len(plan) else []


def _heads(plan: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the centres (K, 2) of heads and shoulders; empty if a part is longer."""
    nobody = np.zeros((0, 2))
    plan = plan[:: len(plan) // _MAX_POINTS + 1]
    if len(plan) < 2 * _MIN_HIGH_POINTS:
        return nobody
    number = fcluster(linkage(plan, "single"), _HEAD_GAP_M, "distance")
    clusters = [plan[number == k] for k in range(1, number.max() + 1)]
    clusters = [cluster for cluster in clusters if len(cluster) >= _MIN_HIGH_POINTS]
    if any(np.linalg.norm(np.ptp(cluster, axis=0)) > _MAX_LENGTH_ABOVE_M for cluster in clusters):
        return nobody
    middles: list[NDArray[np.float64]] = []
    for cluster in sorted(clusters, key=len, reverse=True):
        middle = cluster.mean(axis=0)
        if all(np.linalg.norm(middle - other) > _HEAD_DISTANCE_M for other in middles):
            middles.append(middle)
    return np.array(middles).reshape(-1, 2)
