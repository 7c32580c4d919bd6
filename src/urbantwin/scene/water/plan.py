"""Water as areas, and its level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry, LineString, Polygon

from urbantwin.geometry import area_difference, area_union
from urbantwin.scene.solids import GroundHeight
from urbantwin.scene.tag_values import length_m_of
from urbantwin.site.extract import OsmFeature

__all__ = ["WaterBody", "water_bodies", "with_water"]

#: Widths of waterways that are mapped as a line only, metres.
WIDTHS_M = {"river": 15.0, "canal": 12.0, "stream": 2.0, "drain": 1.5, "ditch": 1.2}
#: Depth of the water level below the surrounding land if no elevation model gives it, metres.
BELOW_M = {"canal": 1.2, "dock": 1.5, "harbour": 1.5, "sea": 1.2, "river": 1.2, "pool": 0.15,
           "stream": 0.4, "drain": 0.4, "ditch": 0.4, "pond": 0.4}  # fmt: skip
#: The wall of a quay is this thick, metres.
QUAY_M = 0.4
WALLED = ("canal", "dock", "harbour", "pool")
#: Distance around the region within which the sea is included, metres.
SEA_M = 150.0


@dataclass(frozen=True)
class WaterBody:
    """A body of water.

    Attributes:
        kind: river, canal, stream, drain, ditch, dock, harbour, pond, pool or sea.
        area: its surface in plan, site frame.
        wall: the wall around it; empty for natural banks.
        below: assumed depth of its level below the surrounding land, metres.
        follows: whether it follows the slope of the ground: streams and ditches; others are level.
    """

    kind: str
    area: Geometry
    wall: Geometry
    below: float
    follows: bool


def water_bodies(features: Sequence[OsmFeature], region: Polygon) -> list[WaterBody]:
    """Return the waters of the map that touch a region and its surroundings.

    Areas are used first, then lines outside these areas; water in tunnels is left out.
    """
    near = region.buffer(SEA_M, join_style="mitre")
    areas: dict[str, list[Geometry]] = {}
    lines: dict[str, list[Geometry]] = {}
    for feature in features:
        tags, shape = feature.tags, feature.geometry
        if _is_hidden(tags):
            continue
        if shape.geom_type.endswith("Polygon"):
            kind = _area_kind(tags)
            if kind:
                areas.setdefault(kind, []).append(shape)
        elif isinstance(shape, LineString) and tags.get("waterway") in WIDTHS_M:
            kind = tags["waterway"]
            width = min(length_m_of(tags.get("width")) or WIDTHS_M[kind], 200.0)
            lines.setdefault(kind, []).append(shape.buffer(width / 2, cap_style="flat"))
    sea = _sea(features, near)
    if not sea.is_empty:
        areas.setdefault("sea", []).append(sea)
    islands = shapely.union_all(
        [f.geometry for f in features
         if f.tags.get("place") in ("island", "islet") and f.geometry.geom_type.endswith("Polygon")]
    )  # fmt: skip
    bodies: list[WaterBody] = []
    taken: Geometry = islands
    for kind, shapes in [*sorted(areas.items()), *sorted(lines.items())]:
        whole = shapely.intersection(area_union(shapes), near)
        whole = area_difference(whole, taken)
        taken = area_union([taken, whole])
        for area in shapely.get_parts(whole):
            if area.area < 1.0:
                continue
            wall: Geometry = Polygon()
            surface = area
            if kind in WALLED:
                surface = area.buffer(-QUAY_M, join_style="mitre")
                wall = area_difference(area, surface)
            if not surface.is_empty:
                follows = kind in ("stream", "drain", "ditch")
                bodies.append(WaterBody(kind, surface, wall, BELOW_M[kind], follows))
    return bodies


def _is_hidden(tags: Mapping[str, str]) -> bool:
    return (
        tags.get("tunnel", "no") != "no"
        or tags.get("covered", "no") == "yes"
        or tags.get("layer", "0").startswith("-2")
        or tags.get("location") in ("underground", "indoor")
        or tags.get("intermittent") == "yes"
    )


def _area_kind(tags: Mapping[str, str]) -> str | None:
    if "building" in tags:
        return None
    if tags.get("leisure") == "swimming_pool":
        return "pool"
    if tags.get("waterway") in ("riverbank", "dock", "canal", "river"):
        return {"riverbank": "river"}.get(tags["waterway"], tags["waterway"])
    if tags.get("harbour") == "yes" and tags.get("natural") == "water":
        return "harbour"
    if tags.get("natural") == "water" or tags.get("landuse") in ("pond", "reservoir"):
        said = tags.get("water", "pond")
        known = {"river": "river", "canal": "canal", "stream": "stream", "harbour": "harbour",
                 "dock": "dock", "basin": "pond", "ditch": "ditch", "moat": "pond",
                 "reflecting_pool": "pool", "fountain": "pool"}  # fmt: skip
        return known.get(said, "pond")
    return None


def _sea(features: Sequence[OsmFeature], near: Polygon) -> Geometry:
    """Return the sea, which is to the right of coastlines."""
    coast = [
        line
        for f in features
        if f.tags.get("natural") == "coastline"
        for line in shapely.get_parts(
            shapely.intersection(
                f.geometry.boundary if f.geometry.geom_type.endswith("Polygon") else f.geometry,
                near,
            )
        )
        if isinstance(line, LineString)
    ]
    if not coast:
        return Polygon()
    faces = shapely.get_parts(
        shapely.polygonize(shapely.get_parts(shapely.union_all([near.boundary, *coast])))
    )
    votes = np.zeros(len(faces))
    for line in coast:
        xy = shapely.get_coordinates(line)
        way = np.diff(xy, axis=0)
        length = np.linalg.norm(way, axis=1)
        keep = length > 0.01
        middle = (xy[:-1] + xy[1:])[keep] / 2
        right = np.column_stack([way[:, 1], -way[:, 0]])[keep] / length[keep, None]
        for sign in (1.0, -1.0):
            spots = middle + sign * 0.2 * right
            for k, face in enumerate(faces):
                votes[k] += sign * (shapely.contains_xy(face, *spots.T) * length[keep]).sum()
    return shapely.union_all([face for face, vote in zip(faces, votes, strict=True) if vote > 0])


#: Distance from a body's border within which points are on it: the ground's vertices are snapped,
#: m.
SNAP_M = 0.03
#: Minimum depth of water below its shore in the elevation model for its use, metres.
SHOWN_M = 0.3


def water_level(body: WaterBody, region: Polygon, terrain_height: GroundHeight) -> float:
    """Return the height of a body's surface, metres.

    If the elevation model has the water below its shore, the height is the model's median on the
    water. Otherwise it is the usual depth below the lower parts of the shore.
    """
    near = shapely.intersection(body.area, region.buffer(25.0))
    near = body.area if near.is_empty else near
    shore = _sampled(body.area.boundary, region)
    land = np.percentile(terrain_height(shore), 20) if len(shore) else 0.0
    west, south, east, north = near.bounds
    x, y = np.meshgrid(np.linspace(west, east, 24)[1:-1], np.linspace(south, north, 24)[1:-1])
    spots = np.column_stack([x.ravel(), y.ravel()])
    spots = spots[shapely.contains_xy(near.buffer(-1.0), spots[:, 0], spots[:, 1])]
    if len(spots):
        seen = float(np.median(terrain_height(spots)))
        if land - seen > SHOWN_M:
            return seen
    return float(land) - body.below


def _sampled(line: Geometry, region: Polygon) -> NDArray[np.float64]:
    """Return points (N, 2) every 5 m of a shore in and about a region."""
    part = shapely.intersection(line, region.buffer(25.0))
    part = line if part.is_empty else part
    return np.asarray(shapely.get_coordinates(shapely.segmentize(part, 5.0)), np.float64)


def with_water(
    terrain_height: GroundHeight, bodies: Sequence[WaterBody], region: Polygon
) -> GroundHeight:
    """Return heights of the bare earth with level water surfaces.

    Args:
        terrain_height: heights of the bare earth at (N, 2) points.
        bodies: the waters.
        region: region whose shores are used.
    """
    if not bodies:
        return terrain_height
    areas = [body.area.buffer(SNAP_M) for body in bodies]
    for area in areas:
        shapely.prepare(area)
    levels = [water_level(body, region, terrain_height) for body in bodies]

    def height(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        z = np.array(terrain_height(xy), np.float64)
        for body, area, level in zip(bodies, areas, levels, strict=True):
            within = shapely.contains_xy(area, xy[:, 0], xy[:, 1])
            z[within] = z[within] - body.below if body.follows else level
        return z

    return height
