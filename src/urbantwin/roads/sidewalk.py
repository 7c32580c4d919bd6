"""Sides of a street with sidewalks, from its tags and its neighbours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.site.access import is_walked

__all__ = ["WALKED", "sidewalk_sides"]

#: Classes of ways for pedestrians without motor traffic.
WALKED = frozenset("footway path cycleway pedestrian steps bridleway".split())
#: Classes of urban streets that have sidewalks by default.
WITH_SIDEWALKS = frozenset(
    "primary primary_link secondary secondary_link tertiary tertiary_link unclassified residential "
    "living_street road busway".split()
)
#: Maximum distance of two opposite one-way carriageways of one street, metres.
DUAL_DISTANCE_M = 30.0


def sidewalk_sides(
    tags: Mapping[str, str],
    line: NDArray[np.float64],
    others: Sequence[shapely.LineString],
    *,
    side: str,
) -> str:
    """Return ``both``, ``left``, ``right`` or ``no`` for one way.

    Mapped sidewalks take precedence (``sidewalk``, ``sidewalk:left|right|both``); one that is
    mapped as a way of its own, ``separate``, is still a sidewalk of this street. By default urban
    streets have both. A carriageway of a dual street and a roundabout have only the outer one, and
    roads closed to pedestrians none.

    Args:
        tags: the way's tags.
        line: (N, 2) the way's points, site frame.
        others: the network's one-way ways.
        side: driving side, ``right`` or ``left``.
    """
    explicit = _explicit(tags)
    if explicit is not None:
        return explicit
    if (
        tags.get("highway") not in WITH_SIDEWALKS
        or not _is_walked_beside(tags)
        or tags.get("tunnel") not in (None, "no", "building_passage")
    ):
        return "no"
    if tags.get("junction") in ("roundabout", "circular"):
        # There is no sidewalk round the central island.
        return side
    if tags.get("oneway") in ("yes", "1", "true") and _has_twin(line, others, side):
        return side
    return "both"


def _is_walked_beside(tags: Mapping[str, str]) -> bool:
    """Return whether pedestrians may walk beside a street's lanes.

    This includes streets without access for through traffic: pedestrians cross their mouths too.
    """
    return tags.get("foot") == "use_sidepath" or is_walked({**tags, "access": "yes"})


def _explicit(tags: Mapping[str, str]) -> str | None:
    present = ("yes", "separate")
    both_sides = tags.get("sidewalk:both", tags.get("sidewalk"))
    if both_sides in ("both", "left", "right"):
        return both_sides
    if both_sides in present:
        return "both"
    if both_sides in ("no", "none"):
        return "no"
    sides = [s for s in ("left", "right") if tags.get(f"sidewalk:{s}") in present]
    if sides:
        return "both" if len(sides) == 2 else sides[0]
    if any(f"sidewalk:{s}" in tags for s in ("left", "right")):
        return "no"
    return None


def _has_twin(
    line: NDArray[np.float64],
    others: Sequence[shapely.LineString],
    side: str,
) -> bool:
    """Return whether an opposite carriageway runs on the inner side of this one."""
    polyline = shapely.LineString(line)
    middle = shapely.get_coordinates(polyline.interpolate(0.5, normalized=True))[0]
    ahead = shapely.get_coordinates(polyline.interpolate(0.51, normalized=True))[0]
    direction = ahead - middle
    direction /= max(float(np.linalg.norm(direction)), 1e-9)
    inner = np.array([-direction[1], direction[0]]) * (1.0 if side == "right" else -1.0)
    ends = np.array([middle + inner * 0.5, middle + inner * DUAL_DISTANCE_M])
    probe = shapely.LineString(ends)
    for k in np.flatnonzero(shapely.intersects(probe, others)).tolist():
        other = others[k]
        meet = shapely.intersection(probe, other)
        along = other.project(shapely.Point(shapely.get_coordinates(meet)[0]))
        step = min(1.0, other.length / 2)
        a, b = (
            shapely.get_coordinates(other.interpolate(np.clip(along + d, 0, other.length)))[0]
            for d in (-step, step)
        )
        if np.dot(b - a, direction) / max(float(np.linalg.norm(b - a)), 1e-9) < -0.7:
            return True
    return False
