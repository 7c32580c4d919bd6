"""Poses that map two posts of a frame onto two posts of the scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.fidelity.alignment.search_span import SearchSpan
from urbantwin.geometry import wrapped

__all__ = ["poses_by_posts"]

#: Tolerance of the distance between two posts, and its minimum and maximum, metres: near posts do
#: not determine a heading, and distant ones are seldom seen by one sensor.
_ALIKE_M, _LEAST_M, _MOST_M = 0.6, 3.0, 80.0
#: Excess over the span up to which a pose is moved to its edge, metres and radians; maximum
#: distance of matching posts, metres.
_BEYOND_M, _BEYOND_RAD, _NEAR_M = 0.5, np.radians(3.0), 0.8
_MOST_POSES = 50_000


def poses_by_posts(
    seen: NDArray[np.float64], posts: NDArray[np.float64], span: SearchSpan, most: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return positions (P, 2) and headings (P,), radians, sorted by the number of matched posts.

    A position grid is too coarse for objects as thin as posts.

    Args:
        seen: (K, 2) posts of the frame, level.
        posts: (M, 2) posts of the scene.
        span: possible poses.
        most: maximum number of poses.
    """
    none = np.zeros((0, 2)), np.zeros(0)
    if len(seen) < 2 or len(posts) < 2:
        return none
    tree = cKDTree(posts)
    pairs = tree.query_pairs(_MOST_M, output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    along = posts[pairs[:, 1]] - posts[pairs[:, 0]]
    apart, course = np.hypot(*along.T), np.arctan2(along[:, 1], along[:, 0])
    middle = posts[pairs].mean(axis=1)
    order = np.argsort(apart, kind="stable")
    apart, course, middle = apart[order], course[order], middle[order]
    places, yaws = [], []
    for i, j in np.argwhere(np.triu(np.ones((len(seen),) * 2, bool), 1)):
        away = seen[j] - seen[i]
        long = float(np.hypot(*away))
        low, high = np.searchsorted(apart, [long - _ALIKE_M, long + _ALIKE_M])
        if not _LEAST_M < long < _MOST_M or low == high:
            continue
        turned = wrapped(course[low:high] - np.arctan2(away[1], away[0]) - span.yaw)
        yaw = span.yaw + turned
        place = middle[low:high] - _turned((seen[i] + seen[j]) / 2, yaw)
        held = (np.abs(place - span.middle) < span.reach_m + _BEYOND_M).all(axis=1)
        held &= np.abs(turned) < span.reach_rad + _BEYOND_RAD
        places.append(place[held])
        yaws.append(yaw[held])
    if not places:
        return none
    place, yaw = np.concatenate(places), np.concatenate(yaws)
    some = np.random.default_rng(len(yaw)).permutation(len(yaw))[:_MOST_POSES]
    place, yaw = place[some], yaw[some]
    if not len(yaw):
        return none
    gain = np.zeros(len(yaw))
    for one in seen:
        off = tree.query(place + _turned(one, yaw), distance_upper_bound=_NEAR_M)[0]
        gain += np.maximum(0.0, 1.0 - off / _NEAR_M)
    best = np.argsort(-gain, kind="stable")[:most]
    return span.clipped(place[best], yaw[best])


def _turned(place: NDArray[np.float64], yaw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a position (2,) rotated by angles (P,), as (P, 2)."""
    x, y = place
    return np.column_stack([x * np.cos(yaw) - y * np.sin(yaw), x * np.sin(yaw) + y * np.cos(yaw)])
