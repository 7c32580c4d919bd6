"""Who rides and who walks, by what one frame shows of somebody, and who stands beside whom.

Who rides is as long as a bicycle below the saddle, and no longer than a trunk above its middle. Two
people side by side are as long above, who pushes a stroller or leads a dog is at its end, and who
walks is as long nowhere. In a group arms and wheels touch; heads and shoulders do not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import cdist

from urbantwin.traffic.observed.box_fit import fitted_yaw

__all__ = ["apart", "silhouette"]

#: Below the saddle and above it, metres above the ground; so many points of either tell.
_SADDLE_M, _TRUNK_M = 0.9, 1.25
_FEWEST_LOW, _FEWEST_HIGH = 8, 4
#: Lengths, metres: of a wheelbase at least, of what is above it at most; and of all at most.
_WHEELS_M, _ABOVE_M, _LONGEST_M = 1.05, 0.9, 2.5
#: Who rides sits above the middle, within this share of the length; who pushes or leads something
#: is at its end.
_MIDDLE = 0.25
#: How wide and how tall somebody is at most who rides; how tall at least.
_WIDE_M, _TALL_M, _SHORT_M = 0.95, 2.15, 1.3
#: Nobody on foot is longer or wider than this.
_STRIDE_M = 0.95
#: A group: from corner to corner, metres; which share of its points must be somebody's.
_ALONE_M, _GROUP_M, _MOSTLY = 1.0, 4.0, 0.8
#: Points of one head and its shoulders lie as near as this to each other, metres; so far apart are
#: those of two; so many tell where they are.
_GAP_M, _ABREAST_M, _MOST = 0.2, 0.5, 400


def silhouette(plan: NDArray[np.float64], above: NDArray[np.float64], yaw: float) -> str | None:
    """Return ``bicycle`` or ``pedestrian``, or ``None`` where it may be either, or neither.

    Args:
        plan: (N, 2) points of an object from above, metres.
        above: (N,) their metres above the ground, without the ground itself.
        yaw: of its fitted sides, radians.
    """
    c, s = np.cos(yaw), np.sin(yaw)
    turned = plan @ np.array([[c, -s], [s, c]])
    spans = np.ptp(turned, axis=0)
    along = turned[:, int(spans.argmax())]
    long, wide, top = float(spans.max()), float(spans.min()), float(above.max())
    if not _SHORT_M < top < _TALL_M or wide > _WIDE_M:
        return None
    if long < _STRIDE_M:
        return "pedestrian"
    low = along[above < _SADDLE_M]
    high = along[above > _TRUNK_M]
    if long > _LONGEST_M or len(low) < _FEWEST_LOW or len(high) < _FEWEST_HIGH:
        return None
    wheels = float(np.ptp(low))
    if wheels < _WHEELS_M or np.ptp(high) > _ABOVE_M:
        return None
    off = abs(float(high.max() + high.min() - low.max() - low.min())) / 2
    return "bicycle" if off < _MIDDLE * wheels else "pedestrian"


def apart(plan: NDArray[np.float64], above: NDArray[np.float64]) -> list[NDArray[np.intp]]:
    """Return the rows (M,) of each of a group of people and riders; nothing where it is none.

    Args:
        plan: (N, 2) points of an object from above, metres.
        above: (N,) their metres above the ground.
    """
    size = float(np.linalg.norm(np.ptp(plan, axis=0)))
    if not _SHORT_M < above.max() < _TALL_M or not _ALONE_M < size < _GROUP_M:
        return []
    heads = _heads(plan[above > _TRUNK_M])
    if len(heads) < 2:
        return []
    whose = cdist(plan, heads).argmin(axis=1)
    parts = [np.flatnonzero(whose == k) for k in range(len(heads))]
    theirs = [
        part
        for part in parts
        if len(part) and silhouette(plan[part], above[part], fitted_yaw(plan[part])) is not None
    ]
    return parts if sum(map(len, theirs)) >= _MOSTLY * len(plan) else []


def _heads(plan: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the middles (K, 2) of heads and shoulders; none where something is longer."""
    nobody = np.zeros((0, 2))
    plan = plan[:: len(plan) // _MOST + 1]
    if len(plan) < 2 * _FEWEST_HIGH:
        return nobody
    number = fcluster(linkage(plan, "single"), _GAP_M, "distance")
    found = [plan[number == k] for k in range(1, number.max() + 1)]
    found = [one for one in found if len(one) >= _FEWEST_HIGH]
    if any(np.linalg.norm(np.ptp(one, axis=0)) > _ABOVE_M for one in found):
        return nobody
    middles: list[NDArray[np.float64]] = []
    for one in sorted(found, key=len, reverse=True):
        middle = one.mean(axis=0)
        if all(np.linalg.norm(middle - other) > _ABREAST_M for other in middles):
            middles.append(middle)
    return np.array(middles).reshape(-1, 2)
