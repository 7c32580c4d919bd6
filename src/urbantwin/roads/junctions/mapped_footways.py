"""Ways of their own for people on foot, as the map has them, from one meeting point to the next."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.roads.cross_section.lane_tags import metres
from urbantwin.roads.junctions.mapped_crossings import WALKED
from urbantwin.site.access import is_walked
from urbantwin.site.extract import Extract, Way

__all__ = ["MappedFootway", "mapped_footways"]

#: Width where none is mapped, metres (as the scene draws footways), and bounds of mapped ones.
WIDTH_M, NARROWEST_M, WIDEST_M = 2.0, 1.0, 6.0


@dataclass(frozen=True, eq=False)
class MappedFootway:
    """A part of a way between places where others meet it.

    Attributes:
        way: id of the way.
        nodes: ids of its nodes, at the points.
        points: (N, 2) site frame.
        width: metres.
        kind: value of ``highway``.
        is_sidewalk: whether it is mapped as the sidewalk of a street.
    """

    way: int
    nodes: tuple[int, ...]
    points: NDArray[np.float64]
    width: float
    kind: str
    is_sidewalk: bool


def mapped_footways(
    extract: Extract, frame: SiteFrame, region: shapely.Polygon, streets: Collection[int]
) -> tuple[MappedFootway, ...]:
    """Return the footways on the ground within the region, cut where they meet.

    Args:
        extract: the map.
        frame: the site frame.
        region: where, site frame.
        streets: nodes of streets.
    """
    ways = [way for way in extract.highways() if _is_walked(way)]
    use = Counter(node for way in ways for node in way.nodes)
    use.update({node: 2 for node in streets if node in use})
    found = []
    for piece in extract.clipped(frame, region, ways):
        inner = range(1, len(piece.nodes) - 1)
        ends = [0, *(k for k in inner if use[piece.nodes[k]] > 1), len(piece.nodes) - 1]
        width = min(max(metres(piece.tags.get("width")) or WIDTH_M, NARROWEST_M), WIDEST_M)
        beside = "sidewalk" in {piece.tags.get(key) for key in ("footway", "path", "cycleway")}
        for a, b in pairwise(ends):
            nodes, points = piece.nodes[a : b + 1], piece.points[a : b + 1]
            kind = piece.tags["highway"]
            found.append(MappedFootway(piece.way, nodes, points, width, kind, beside))
    return tuple(found)


def _is_walked(way: Way) -> bool:
    tags = way.tags
    if tags["highway"] not in WALKED or tags.get("area") == "yes":
        return False
    flat = tags.get("layer", "0") == "0" and tags.get("bridge", "no") == "no"
    inside = tags.get("indoor", "no") != "no" or tags.get("tunnel", "no") != "no"
    return is_walked(tags) and flat and not inside
