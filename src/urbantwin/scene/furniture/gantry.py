"""Gantries: beams across a road with sign boards, on a post at each side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Point, Polygon

from urbantwin.scene.placement import along_nearest, on_ground
from urbantwin.scene.solids import Assembly, GroundHeight, box, columns
from urbantwin.scene.tag_values import length_m_of
from urbantwin.site.extract import OsmFeature

__all__ = ["add_gantries"]

#: Clear height below the boards (MUTCD 2A.18: at least 17 ft), boards and beam, metres.
CLEAR_M, BOARD_M, BEAM_M, POST_M = 5.5, (1.6, 2.5), 0.4, 0.35
#: A board over every lane.
LANE_M = 3.5
BURIED_M = 0.5
NEAREST_M, FARTHEST_M = 2.0, 30.0


def add_gantries(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    ways: Sequence[Geometry],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    notes: Counter[str],
) -> None:
    """Add the mapped gantries: lines as they are, points across their road.

    Their posts are at the ends, moved outwards until they are off the carriageway. Boards face
    along the road, in both directions.
    """
    blocked = carriageway.buffer(0.5)
    shapely.prepare(blocked)
    for feature in features:
        if feature.tags.get("man_made") != "gantry":
            continue
        shape = feature.geometry
        if isinstance(shape, Point):
            xy = np.array([[shape.x, shape.y]])
            yaw = float(np.nan_to_num(along_nearest(xy, ways, farthest_m=10.0)[0])) + np.pi / 2
            middle, reach = xy[0], NEAREST_M
        elif isinstance(shape, LineString):
            ends = shapely.get_coordinates(shape)[[0, -1]]
            yaw = float(np.arctan2(*(ends[1] - ends[0])[::-1]))
            middle, reach = ends.mean(axis=0), float(np.hypot(*(ends[1] - ends[0]))) / 2
            reach = max(reach, NEAREST_M)
        else:
            continue
        if not region.covers(Point(middle)):
            continue
        posts = [_post(middle, yaw + turn, reach, blocked) for turn in (0.0, np.pi)]
        if posts[0] is None or posts[1] is None:
            notes["gantries without a place beside the carriageway, left out"] += 1
            continue
        clear = length_m_of(feature.tags.get("maxheight")) or CLEAR_M
        _add(assembly, np.array(posts), clear, ground_height)
        notes["gantries"] += 1


def _post(
    middle: NDArray[np.float64], yaw: float, reach: float, blocked: Geometry
) -> NDArray[np.float64] | None:
    steps = np.arange(reach, FARTHEST_M, 0.25)[:, None]
    tries = middle + steps * np.array([np.cos(yaw), np.sin(yaw)])
    free = ~shapely.contains_xy(blocked, tries[:, 0], tries[:, 1])
    return tries[int(np.argmax(free))] if free.any() else None


def _add(
    assembly: Assembly, ends: NDArray[np.float64], clear: float, ground_height: GroundHeight
) -> None:
    middle = ends.mean(axis=0)[None]
    feet = on_ground(np.concatenate([ends, middle]), ground_height(np.concatenate([ends, middle])))
    top = float(feet[:, 2].max()) + clear + BOARD_M[0]
    part = assembly.new_part()
    tall = top + BEAM_M / 2 - feet[:2, 2] + BURIED_M
    posts = columns(feet[:2] - [0, 0, BURIED_M], tall, POST_M / 2, POST_M / 2, 8)
    assembly.add(posts, "other-structure", "metal-painted", part)
    across = ends[0] - ends[1]
    span, yaw = float(np.hypot(*across)), float(np.arctan2(across[1], across[0]))
    beam = box([*middle[0], top], [span, BEAM_M, BEAM_M], yaw)
    assembly.add(beam, "other-structure", "metal-painted", part)
    count = max(int((span - 2.0) / LANE_M), 1)
    share = (np.arange(count) - (count - 1) / 2) * LANE_M / span
    spots = middle + share[:, None] * across
    centre = np.column_stack([spots, np.full(count, top - BOARD_M[0] / 2)])
    size = np.full((count, 3), [BOARD_M[1], 0.08, BOARD_M[0]])
    off = (BEAM_M / 2 + 0.06) * np.array([-across[1], across[0], 0.0]) / span
    boards = box(centre + off, size, yaw)
    assembly.add(boards, "traffic-sign", "retroreflector", part)
