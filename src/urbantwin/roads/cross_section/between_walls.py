"""Lanes of unmapped width, narrowed between buildings that are closer than the default width.

Default widths assume new construction. Old streets can be narrower: in Japan 4 m wide and less
(Building Standards Act, articles 42 and 43).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.cross_section.defaults import MAIN, MOTORWAYS
from urbantwin.roads.cross_section.from_tags import ONE_LANE_LEAST_M
from urbantwin.roads.cross_section.section import CarriagewayLane, CrossSection
from urbantwin.roads.cross_section.segment import Segment

__all__ = ["THIN_M", "between_walls", "room_beside", "walls_of"]

#: Minimum width of a lane of motor traffic, metres: a car of 1.8 m fits between walls. On main
#: streets as in RASt 06 for streets without buses.
LOCAL_M, MAIN_M = 2.0, 2.75
#: Clearance between a carriageway and a wall, and spacing of the sampled places, metres.
FREE_M, STEP_M = 0.1, 1.0
#: Walls closer than the first are those of a building passage; buildings thinner than the second
#: are roofs or slivers and do not count, metres.
PASSAGE_M, THIN_M = 2.0, 2.0
#: Walls farther than this are not beside the street, metres.
FAR_M = 30.0


def between_walls(
    segments: Sequence[Segment],
    sections: Sequence[CrossSection],
    buildings: Sequence[shapely.Polygon],
) -> list[CrossSection]:
    """Return the cross sections with assumed lanes narrowed to the room between walls.

    Args:
        segments: parts of ways.
        sections: their cross sections.
        buildings: footprints of buildings on the ground, site frame.
    """
    if not len(buildings):
        return list(sections)
    walls = walls_of(buildings)
    return [
        _fitted(section, segment, walls) if segment.piece.way else section
        for segment, section in zip(segments, sections, strict=True)
    ]


def _fitted(section: CrossSection, segment: Segment, walls: shapely.STRtree) -> CrossSection:
    lanes = (*section.forward, *section.backward)
    assumed = sum(lane.width for lane in lanes if lane.assumed)
    if not assumed:
        return section
    lacking = section.width + 2 * FREE_M - _room(segment, walls)
    if lacking <= 0.0:
        return section
    least = MAIN_M if section.kind in MAIN | MOTORWAYS else LOCAL_M
    least = ONE_LANE_LEAST_M / 2 if section.one_lane else least
    share = max(0.0, 1.0 - lacking / assumed)

    def fitted(lane: CarriagewayLane) -> CarriagewayLane:
        return replace(lane, width=max(share * lane.width, min(least, lane.width)))

    forward, backward = (
        tuple(fitted(lane) if lane.assumed else lane for lane in side)
        for side in (section.forward, section.backward)
    )
    return replace(section, forward=forward, backward=backward)


def _room(segment: Segment, walls: shapely.STRtree) -> float:
    """Return the minimum distance between the walls on both sides of a segment, metres."""
    line = shapely.LineString(segment.piece.points).segmentize(STEP_M)
    points = shapely.get_coordinates(line)
    legs = np.gradient(points, axis=0)
    legs /= np.maximum(np.linalg.norm(legs, axis=1, keepdims=True), 1e-9)
    across = room_beside(points, legs, np.full(len(points), FAR_M), walls)
    across = np.minimum(across, FAR_M).sum(axis=1)
    return float(across[across >= PASSAGE_M].min(initial=2 * FAR_M))


def walls_of(buildings: Sequence[shapely.Polygon]) -> shapely.STRtree:
    """Return the outlines of buildings, without roofs and slivers thinner than `THIN_M`."""
    solid = shapely.buffer(np.array(buildings, object), -THIN_M / 2)
    return shapely.STRtree(shapely.buffer(solid, THIN_M / 2, join_style="mitre"))


def room_beside(
    places: NDArray[np.float64],
    ahead: NDArray[np.float64],
    reach: NDArray[np.float64],
    walls: shapely.STRtree,
) -> NDArray[np.float64]:
    """Return the distance (N, 2) to walls on the left and on the right, infinite beyond the reach.

    Args:
        places: (N, 2) points of a street, site frame, metres.
        ahead: (N, 2) unit vectors along the street.
        reach: (N,) length of the rays to either side, metres.
        walls: outlines of buildings.
    """
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    room = np.full((len(places), 2), np.inf)
    for column, side in enumerate((left, -left)):
        rays = shapely.linestrings(np.stack([places, places + reach[:, None] * side], axis=1))
        ray, wall = walls.query(rays, predicate="intersects")
        meet = shapely.intersection(rays[ray], walls.geometries[wall])
        np.minimum.at(room[:, column], ray, shapely.distance(shapely.points(places[ray]), meet))
    return room
