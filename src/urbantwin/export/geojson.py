"""The lane network as GeoJSON (RFC 7946), for QGIS and other maps."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.twin import Twin

__all__ = ["write_geojson"]

#: A hundred-millionth of a degree is a millimetre.
DECIMALS = 8


def write_geojson(twin: Twin, path: Path) -> None:
    """Write lanes, junctions, crossings and signals in WGS84 degrees.

    Each feature's ``layer`` is ``lane`` (a line in the lane's direction), ``junction``,
    ``crossing`` (areas) or ``signal`` (a point at the stop line).
    """
    document = {
        "type": "FeatureCollection",
        "name": twin.manifest["name"],
        "features": list(_features(twin.roads, twin.frame)),
    }
    scratch = path.with_name(f".{path.name}.part")
    scratch.write_text(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    scratch.replace(path)


def _features(network: RoadNetwork, frame: SiteFrame) -> Iterator[dict[str, Any]]:
    name_of = {road.id: road.name for road in network.roads}
    for lane in network.lanes:
        if lane.kind == "walkingarea":
            continue
        shape: shapely.Geometry = shapely.LineString(lane.centre[:, :2])
        if lane.kind == "crossing":
            shape = lane.polygon
        yield _feature(frame, shape, _of_lane(lane, name_of.get(lane.road, "")))
    for junction in network.junctions:
        if junction.polygon.is_empty:
            continue
        properties = {"layer": "junction", "id": junction.id, "kind": junction.kind}
        yield _feature(frame, junction.polygon, {**properties, "level": junction.level})
    for head in network.signals:
        properties = {
            "layer": "signal",
            "program": head.program,
            "links": " ".join(map(str, head.links)),
            "lane": head.lane,
        }
        # Map makers turn clockwise from north.
        bearing = round((90.0 - float(np.degrees(head.yaw))) % 360.0, 2)
        yield _feature(frame, shapely.Point(head.x, head.y), {**properties, "bearing_deg": bearing})


def _of_lane(lane: Lane, name: str) -> dict[str, Any]:
    return {
        "layer": "crossing" if lane.kind == "crossing" else "lane",
        "id": lane.id,
        "kind": lane.kind,
        "name": name,
        "road": lane.road,
        "junction": lane.junction,
        "width_m": lane.width,
        "speed_limit_kmh": round(lane.speed_limit * 3.6, 1),
        "allowed": " ".join(lane.allowed),
        "successors": " ".join(lane.successors),
        "level": lane.level,
    }


def _feature(
    frame: SiteFrame, shape: shapely.Geometry, properties: dict[str, Any]
) -> dict[str, Any]:
    def degrees(xy: np.ndarray[Any, np.dtype[np.float64]]) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.round(frame.lonlat_from_site(xy), DECIMALS)

    if shape.geom_type in ("Polygon", "MultiPolygon"):
        shape = shapely.orient_polygons(shape)
    geometry = shapely.geometry.mapping(shapely.transform(shape, degrees))
    return {"type": "Feature", "geometry": geometry, "properties": properties}
