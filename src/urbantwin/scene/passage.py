"""Passages through buildings: mapped ones, and carriageways that run into footprints."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Geometry, LineString, Polygon

from urbantwin.scene.extrusion import Body, clean_polygons
from urbantwin.scene.tag_values import length_m_of
from urbantwin.site.extract import OsmFeature

__all__ = ["ROAD_CLEARANCE_M", "Opening", "Passage", "open_bodies", "passages_of"]

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
#: A body whose underside is lower than this above its building's ground stands on the ground.
RAISED_M = 2.0
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


@dataclass(frozen=True)
class Opening:
    """What is taken out of a building: a footprint, from the ground up to a ceiling, metres.

    Attributes:
        footprint: where.
        ceiling: for bodies that stand on the ground; infinite where nothing may stay above.
        raised_ceiling: for bodies that are raised; 0 leaves them as they are.
    """

    footprint: Geometry
    ceiling: float
    raised_ceiling: float


def passages_of(features: Iterable[OsmFeature]) -> list[Passage]:
    """Return the ways that are mapped as passing through or under buildings."""
    found = []
    for feature in features:
        tags = feature.tags
        covered = tags.get("tunnel") == "building_passage" or tags.get("covered") in COVERED
        if not covered or "highway" not in tags or not isinstance(feature.geometry, LineString):
            continue
        kind = tags["highway"]
        width = length_m_of(tags.get("width")) or WIDTH_M.get(kind, WIDER_M)
        corridor = _longer(feature.geometry).buffer(width / 2, cap_style="flat")
        if corridor.is_empty:
            continue
        clearance = PATH_CLEARANCE_M if kind in PATHS else ROAD_CLEARANCE_M
        has_columns = tags.get("covered") in ARCADES or tags.get("arcade:type") is not None
        found.append(Passage(feature.geometry, corridor, clearance, has_columns))
    return found


def open_bodies(bodies: Sequence[Body], openings: Sequence[Opening]) -> list[Body]:
    """Return bodies with openings taken out: nothing solid remains below an opening's ceiling."""
    for opening in openings:
        opened: list[Body] = []
        for body in bodies:
            raised = body.low >= RAISED_M
            ceiling = opening.raised_ceiling if raised else opening.ceiling
            if body.low >= ceiling or not body.footprint.intersects(opening.footprint):
                opened.append(body)
                continue
            beside = body.footprint.difference(opening.footprint)
            opened += [replace(body, footprint=piece) for piece in clean_polygons(beside)]
            if max(body.eaves, body.low) - ceiling > 0.3 or (
                not body.roof and body.high - ceiling > 0.3
            ):
                above = body.footprint.intersection(opening.footprint)
                opened += [
                    replace(body, footprint=piece, low=ceiling)
                    for piece in clean_polygons(above, smallest_m2=0.0, thinnest_m=0.0)
                ]
        bodies = opened
    return list(bodies)


def _longer(line: LineString) -> LineString:
    """Draw a line longer at both ends."""
    xy = shapely.get_coordinates(shapely.remove_repeated_points(line, 0.001))
    if len(xy) < 2:
        return line
    first, last = xy[0] - xy[1], xy[-1] - xy[-2]
    start = xy[0] + first / np.hypot(*first) * REACH_M
    end = xy[-1] + last / np.hypot(*last) * REACH_M
    return LineString([start, *xy[1:-1], end])
