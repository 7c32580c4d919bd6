"""Passages through buildings: the mapped ways that lead through or under them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import LineString, Polygon

from urbantwin.roads.cross_section.lane_tags import metres
from urbantwin.site.extract import OsmFeature

__all__ = ["ROAD_CLEARANCE_M", "Passage", "passages_of"]

#: Clear height of a passage for vehicles and over any carriageway; for walkers and cyclists.
ROAD_CLEARANCE_M = 4.5
PATH_CLEARANCE_M = 3.0
#: A passage's line is drawn longer by this at both ends, so that it cuts through the walls.
REACH_M = 1.0

WIDTH_M = {
    **dict.fromkeys(("footway", "path", "cycleway", "steps", "corridor"), 2.5),
    **dict.fromkeys(("pedestrian", "service", "track"), 4.0),
    **dict.fromkeys(("residential", "living_street", "unclassified", "tertiary"), 6.0),
}
WIDER_M = 7.0
#: Values of ``covered`` under buildings; those with columns along their open side.
ARCADES = ("arcade", "colonnade")
COVERED = ("yes", *ARCADES)
PATHS = ("footway", "path", "cycleway", "steps", "corridor", "pedestrian")


@dataclass(frozen=True)
class Passage:
    """A mapped way through buildings.

    Attributes:
        line: its middle.
        corridor: the ground that it takes.
        clearance_m: its clear height.
        has_columns: whether columns stand along its open side: an arcade or a colonnade.
    """

    line: LineString
    corridor: Polygon
    clearance_m: float
    has_columns: bool = False


def passages_of(features: Iterable[OsmFeature]) -> list[Passage]:
    """Return the ways that are mapped as passing through or under buildings."""
    found = []
    for feature in features:
        tags = feature.tags
        covered = tags.get("tunnel") == "building_passage" or tags.get("covered") in COVERED
        if not covered or "highway" not in tags or not isinstance(feature.geometry, LineString):
            continue
        kind = tags["highway"]
        width = metres(tags.get("width")) or WIDTH_M.get(kind, WIDER_M)
        corridor = _longer(feature.geometry).buffer(width / 2, cap_style="flat")
        if corridor.is_empty:
            continue
        clearance = PATH_CLEARANCE_M if kind in PATHS else ROAD_CLEARANCE_M
        has_columns = tags.get("covered") in ARCADES or tags.get("arcade:type") is not None
        found.append(Passage(feature.geometry, corridor, clearance, has_columns))
    return found


def _longer(line: LineString) -> LineString:
    """Draw a line longer at both ends."""
    xy = shapely.get_coordinates(shapely.remove_repeated_points(line, 0.001))
    if len(xy) < 2:
        return line
    first, last = xy[0] - xy[1], xy[-1] - xy[-2]
    start = xy[0] + first / np.hypot(*first) * REACH_M
    end = xy[-1] + last / np.hypot(*last) * REACH_M
    return LineString([start, *xy[1:-1], end])
