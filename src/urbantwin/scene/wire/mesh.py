"""Wires: power lines, contact lines, and span wires with lamps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Point, Polygon

from urbantwin.geometry import LabelledMesh
from urbantwin.scene.placement import along_nearest, on_ground
from urbantwin.scene.solids import Assembly, GroundHeight, box, rods
from urbantwin.scene.tag_values import length_m_of
from urbantwin.scene.wire.catenary import catenaries, wire_solid
from urbantwin.scene.wire.contact_line import add_contact_lines
from urbantwin.scene.wire.power import add_power_lines
from urbantwin.site.extract import OsmFeature

__all__ = ["wire_mesh"]

#: Height of mapped wires, their sag over span, and height of lamps on wires, metres.
WIRE_HIGH_M, SAG, LAMP_M = 7.5, 0.02, 6.5
#: Maximum distance of a wall from a lamp on a wire, metres.
FARTHEST_M = 30.0
ON_WIRE_M, SHORTEST_M = 1.5, 0.3
SUSPENDED = ("suspended", "catenary")


def add_span_wires(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    region: Polygon,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    """Add mapped wires, and lamps between the walls to both sides of their street."""
    for feature in features:
        line = feature.geometry
        if feature.tags.get("man_made") != "wire" or not isinstance(line, LineString):
            continue
        if feature.tags.get("location", "overhead") != "overhead" or not region.covers(line):
            continue
        xy = shapely.get_coordinates(shapely.remove_repeated_points(line, 0.3))
        high = min(length_m_of(feature.tags.get("height")) or WIRE_HIGH_M, 30.0)
        if len(xy) > 1:
            points = on_ground(xy, ground_height(xy)) + [0, 0, high]
            span = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
            far = span > SHORTEST_M
            if not far.any():
                continue
            curves = catenaries(points[:-1][far], points[1:][far], SAG * span[far], 6)
            assembly.add(wire_solid(curves), "other-object", "metal-bare", assembly.new_part())
            notes["wires across streets"] += 1
    _add_lamps(assembly, features, region, ground_height, notes)


def _add_lamps(
    assembly: Assembly,
    features: Sequence[OsmFeature],
    region: Polygon,
    ground_height: GroundHeight,
    notes: Counter[str],
) -> None:
    lamps = [f for f in features if _is_hung_lamp(f) and region.covers(f.geometry)]
    if not lamps:
        return
    houses = [
        f.geometry.boundary for f in features
        if "building" in f.tags and f.geometry.geom_type.endswith("Polygon")
    ]  # fmt: skip
    walls = shapely.STRtree(houses)
    wires = shapely.union_all([f.geometry for f in features if f.tags.get("man_made") == "wire"])
    ways = [f.geometry for f in features if "highway" in f.tags]
    xy = np.array([[f.geometry.x, f.geometry.y] for f in lamps])
    across = np.nan_to_num(along_nearest(xy, ways, farthest_m=15.0)) + np.pi / 2
    feet = on_ground(xy, ground_height(xy))
    for lamp, foot, yaw in zip(lamps, feet, across.tolist(), strict=True):
        high = min(max(length_m_of(lamp.tags.get("height")) or LAMP_M, 4.0), 20.0)
        top = foot + [0, 0, high]
        ends = [_wall(foot[:2], yaw + turn, walls) for turn in (0.0, np.pi)]
        hooks = [[*end, top[2] + 0.8] for end in ends if end is not None]
        if wires.distance(lamp.geometry) < ON_WIRE_M:
            hooks = [[*foot[:2], foot[2] + max(WIRE_HIGH_M - 0.1, high + 0.3)]]
        if not hooks:
            notes["lamps on wires without a wall or a wire, left out"] += 1
            continue
        part = assembly.new_part()
        for hook in hooks:
            wire = rods([top + [0, 0, 0.2]], [hook], 0.012, 0.012, 3)
            assembly.add(wire, "other-object", "metal-bare", part)
        head = box(top, [0.55, 0.3, 0.25], yaw)
        assembly.add(head, "pole", "metal-painted", part)
        stem = rods([top + [0, 0, 0.1]], [top + [0, 0, 0.25]], 0.02, 0.02, 6)
        assembly.add(stem, "pole", "metal-painted", part)
        notes["lamps on wires"] += 1


def _is_hung_lamp(feature: OsmFeature) -> bool:
    tags = feature.tags
    mounts = {tags.get(k) for k in ("lamp_mount", "support", "light:mount")}
    return (
        tags.get("highway") == "street_lamp"
        and isinstance(feature.geometry, Point)
        and bool(mounts & set(SUSPENDED))
    )


def _wall(
    at: NDArray[np.float64], yaw: float, walls: shapely.STRtree
) -> NDArray[np.float64] | None:
    """Return the nearest wall in a direction (2,)."""
    beam = LineString([at, at + FARTHEST_M * np.array([np.cos(yaw), np.sin(yaw)])])
    hit = [walls.geometries[k].intersection(beam) for k in walls.query(beam)]
    spots = np.concatenate([shapely.get_coordinates(h) for h in hit] or [np.zeros((0, 2))])
    if not len(spots):
        return None
    return np.asarray(spots[np.linalg.norm(spots - at, axis=1).argmin()])


def wire_mesh(
    features: Sequence[OsmFeature],
    *,
    region: Polygon,
    ground_height: GroundHeight,
    carriageway: Geometry,
    ride_height: GroundHeight | None = None,
    without: Geometry | None = None,
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build power lines with towers, contact wires with their supports, and lamps on wires.

    Args:
        features: the map's features, site frame.
        region: wires end at its border.
        ground_height: heights of the ground.
        carriageway: area without masts.
        ride_height: heights of rails and roads, including decks; default: heights of the ground.
        without: area in which imported geometry contains the wires.

    Returns:
        The mesh, ``part`` 1, 2, ... per wire or support, and counts of objects built.
    """
    notes: Counter[str] = Counter()
    assembly = Assembly()
    place = region
    if without is not None and not without.is_empty:
        place = region.difference(without)
    mine = [f for f in features if _is_mine(f.tags)]
    add_power_lines(assembly, mine, place, ground_height, notes)
    add_contact_lines(assembly, mine, place, ride_height or ground_height, carriageway, notes)
    add_span_wires(assembly, mine, place, ground_height, notes)
    return assembly.mesh(), dict(sorted((k, n) for k, n in notes.items() if n))


def _is_mine(tags: dict[str, str]) -> bool:
    return any(key in tags for key in ("power", "railway", "highway", "building")) or (
        tags.get("man_made") == "wire"
    )
