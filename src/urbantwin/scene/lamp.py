"""Street lamps: on masts with arms, on walls, and at assumed positions along lit streets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, Polygon

from urbantwin.scene.catalogue import Catalogue
from urbantwin.scene.piece import add_pieces
from urbantwin.scene.placement import on_ground, toward_carriageway
from urbantwin.scene.solids import Assembly, GroundHeight
from urbantwin.scene.tag_values import count_of, yaw_of_direction
from urbantwin.site.extract import OsmFeature

__all__ = ["add_lamps", "add_wall_lamps", "seeded_lamps"]

#: Lamps farther than this from any carriageway belong to a path: no arm, and a lower mast.
ARM_REACH_M = 15.0
#: Height of masts beside streets and beside paths; length of arms beyond the curb, and its limits,
#: m.
STREET_M, PATH_M = 8.0, 4.5
BEYOND_CURB_M, SHORTEST_ARM_M, LONGEST_ARM_M = 0.6, 1.3, 3.5
#: A lamp with carriageways within this distance on both sides is on a median: two arms.
MEDIAN_M = 4.0
#: Maximum distance of a lamp from its wall, metres.
NEAREST_WALL_M = 2.5
#: Street objects that lamps are.
ON_TOP, WITH_ARMS, BENT = "lamp with its light on top", "lamp with arms", "lamp with bent arms"
#: Assumed lamps: 3.5 times the height of the mast apart, the rule of thumb for EN 13201's even
#: light on one side after the other; none within reach of a mapped one.
SPACING_M, MAPPED_M = 28.0, 32.0
CURB_M = 0.6
STREETS = (
    "motorway", "trunk", "primary", "secondary", "tertiary", "unclassified", "residential",
    "living_street", "motorway_link", "trunk_link", "primary_link", "secondary_link",
    "tertiary_link",
)  # fmt: skip
PATHS = ("footway", "path", "cycleway", "pedestrian", "service")
LIT = ("yes", "24/7", "automatic", "sunset-sunrise", "dusk-dawn")


def add_lamps(
    assembly: Assembly,
    feet: NDArray[np.float64],
    tags: Sequence[dict[str, str]],
    carriageway: Geometry,
    objects: Catalogue,
) -> None:
    """Add lamps at (N, 3) points on the ground.

    Beside a carriageway a lamp has an arm over it, on medians one arm to each side, unless
    ``lamp_mount=straight_mast`` or ``light:count`` is mapped differently. Elsewhere the light is on
    top of the mast. If the catalogue has a lamp for the tags, it is used instead of these three
    types.
    """
    road = toward_carriageway(feet[:, :2], carriageway, farthest_m=ARM_REACH_M)
    away = shapely.distance(carriageway, shapely.points(feet[:, :2]))
    shapely.prepare(carriageway)
    for foot, own, yaw, gap in zip(feet, tags, road.tolist(), away.tolist(), strict=True):
        said = yaw_of_direction(own.get("light:direction") or own.get("direction"))
        mount = own.get("lamp_mount") or own.get("light:mount") or ""
        straight = "straight" in mount or own.get("lamp_type") == "post_top"
        near = bool(np.isfinite(yaw))
        usual = STREET_M if near else PATH_M
        kind = objects.of(own, "lamp")
        has_arms = near or (said is not None and "bent" in mount)
        if kind is None and (straight or not has_arms):
            pieces = objects[ON_TOP].pieces(own, usual_height=usual)
            add_pieces(assembly, pieces, foot, 0.0)
            continue
        turn = float(np.nan_to_num(yaw)) if said is None else said
        yaws = [turn]
        arms = count_of(own.get("lamp_arms") or own.get("light:count"))
        if (arms or 0) >= 2 or (arms is None and _on_median(foot, yaw, carriageway)):
            yaws = [turn + 2 * np.pi * k / max(int(arms or 2), 2) for k in range(int(arms or 2))]
        reach = float(np.clip(gap + BEYOND_CURB_M, SHORTEST_ARM_M, LONGEST_ARM_M))
        kind = kind or objects[BENT if "bent" in mount else WITH_ARMS]
        pieces = kind.pieces(own, yaws[:6], reach=reach, usual_height=usual)
        add_pieces(assembly, pieces, foot, 0.0)


def _on_median(foot: NDArray[np.float64], yaw: float, carriageway: Geometry) -> bool:
    if not np.isfinite(yaw):
        return False
    back = foot[:2] - np.linspace(0.4, MEDIAN_M, 10)[:, None] * [np.cos(yaw), np.sin(yaw)]
    ahead = foot[:2] + np.linspace(0.4, MEDIAN_M, 10)[:, None] * [np.cos(yaw), np.sin(yaw)]
    both = [shapely.contains_xy(carriageway, *side.T).any() for side in (back, ahead)]
    return bool(all(both))


def add_wall_lamps(
    assembly: Assembly,
    lamps: Sequence[OsmFeature],
    buildings: Sequence[Geometry],
    ground_height: GroundHeight,
    objects: Catalogue,
) -> int:
    """Add lamps on brackets at the walls next to which they are mapped; return their number."""
    walls = shapely.STRtree([b.boundary for b in buildings])
    if not lamps or not len(walls.geometries):
        return 0
    xy = np.array([[lamp.geometry.x, lamp.geometry.y] for lamp in lamps])
    number, nearest = walls.query_nearest(
        shapely.points(xy), max_distance=NEAREST_WALL_M, all_matches=False
    )
    feet = on_ground(xy, ground_height(xy))
    for k, wall in zip(number.tolist(), nearest.tolist(), strict=True):
        boundary, spot = buildings[wall].boundary, shapely.Point(xy[k])
        at = boundary.interpolate(boundary.project(spot))
        out = xy[k] - [at.x, at.y]
        inside = buildings[wall].contains(spot)
        if np.hypot(*out) < 1e-3:
            continue
        out = (-out if inside else out) / np.hypot(*out)
        pieces = objects["lamp on a wall"].pieces(lamps[k].tags)
        yaw = float(np.arctan2(out[1], out[0]))
        add_pieces(assembly, pieces, np.array([at.x, at.y, feet[k, 2]]), yaw)
    return len(number)


def seeded_lamps(
    features: Sequence[OsmFeature], region: Polygon, carriageway: Geometry, taken: Geometry
) -> NDArray[np.float64]:
    """Return positions (N, 2) of lamps along streets with ``lit=yes`` but no mapped lamps.

    They are 28 m apart, alternating between the two sides, 0.6 m behind the curb; along lit paths
    away from streets they are 1 m beside the path.

    Args:
        features: the map's features, site frame.
        region: region of the lamps.
        carriageway: area without lamps.
        taken: other areas without lamps, such as buildings.
    """
    mapped = shapely.STRtree(
        [f.geometry for f in features
         if f.tags.get("highway") == "street_lamp" and f.geometry.geom_type == "Point"]
    )  # fmt: skip
    blocked = shapely.union_all([carriageway.buffer(CURB_M - 0.05), taken])
    shapely.prepare(blocked)
    placed: list[NDArray[np.float64]] = []
    for kinds in (STREETS, PATHS):
        lines = [f.geometry for f in features if _is_lit(f, kinds)]
        joined = (
            shapely.line_merge(shapely.union_all(lines)) if lines else shapely.MultiLineString()
        )
        for line in shapely.get_parts(shapely.intersection(joined, region)):
            if line.geom_type == "LineString" and line.length > SPACING_M / 2:
                _seed_along(line, kinds is PATHS, mapped, placed, region, carriageway, blocked)
    return np.array(placed).reshape(-1, 2)


def _is_lit(feature: OsmFeature, kinds: Sequence[str]) -> bool:
    tags = feature.tags
    return (
        tags.get("highway") in kinds
        and feature.geometry.geom_type == "LineString"
        and tags.get("lit") in LIT
        and tags.get("tunnel", "no") == "no"
        and tags.get("bridge", "no") == "no"
        and tags.get("indoor", "no") == "no"
        and not tags.get("layer", "0").startswith("-")
    )


def _seed_along(
    line: shapely.LineString,
    is_path: bool,
    mapped: shapely.STRtree,
    placed: list[NDArray[np.float64]],
    region: Polygon,
    carriageway: Geometry,
    blocked: Geometry,
) -> None:
    count = max(int(line.length / SPACING_M), 1)
    stations = (np.arange(count) + 0.5) / count * line.length
    at = shapely.get_coordinates(shapely.line_interpolate_point(line, stations))
    ends = [shapely.line_interpolate_point(line, stations + step) for step in (-0.5, 0.5)]
    way = shapely.get_coordinates(ends[1]) - shapely.get_coordinates(ends[0])
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    left = np.column_stack([-way[:, 1], way[:, 0]])
    reach = np.array([2.0]) if is_path else np.arange(1.0, 16.0, 0.25)
    for k in range(count):
        spot = shapely.Point(at[k])
        if len(mapped.query(spot, predicate="dwithin", distance=MAPPED_M)):
            continue
        if is_path and carriageway.distance(spot) < ARM_REACH_M:
            continue  # The street's lamps light the path.
        for side in (1.0, -1.0) if k % 2 else (-1.0, 1.0):
            tries = at[k] + side * reach[:, None] * left[k]
            free = ~shapely.contains_xy(blocked, tries[:, 0], tries[:, 1])
            if not free.any():
                continue
            found = tries[int(np.argmax(free))]
            near = placed and np.linalg.norm(np.array(placed) - found, axis=1).min() < 12.0
            if not near and region.covers(shapely.Point(found)):
                placed.append(found)
                break
