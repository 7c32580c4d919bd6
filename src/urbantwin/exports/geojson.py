"""The lane network as GeoJSON (RFC 7946), for QGIS and other maps."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.artefact import replaced_file, replaced_folder, write_json
from urbantwin.drawing.road_furniture import heads, islands, signs
from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads import Lane
from urbantwin.roads.marking import stop_lines, turns
from urbantwin.twin import Twin

__all__ = ["LAYERS", "write_geojson"]

#: Layers in drawing order: areas below lines below points.
LAYERS = (
    "lane",
    "junction",
    "crossing",
    "island",
    "centre_line",
    "stop_line",
    "signal",
    "sign",
)
AREAS = frozenset({"lane", "junction", "crossing", "island"})
#: A hundred-millionth of a degree is a millimetre.
DECIMALS = 8
ENDINGS = (".geojson", ".json")

Feature = tuple[str, shapely.Geometry, dict[str, Any]]


def write_geojson(twin: Twin, path: Path) -> None:
    """Write lanes and their furniture in WGS84 degrees.

    A ``path`` that ends in ``.geojson`` gives one file with the property ``layer``; otherwise a
    folder with one file per layer, which QGIS opens as layers. The layers are ``LAYERS``: ``lane``,
    ``junction``, ``crossing`` and ``island`` are areas, ``centre_line`` runs in the lane's
    direction, ``stop_line`` across it; ``signal`` and ``sign`` are at their heads and plates.
    Headings are degrees clockwise from north.

    Raises:
        InputError: the folder holds other files.
    """
    layers: dict[str, list[dict[str, Any]]] = {name: [] for name in LAYERS}
    for layer, shape, properties in _features(twin):
        kept = _polygons(shape) if layer in AREAS else shape
        if not kept.is_empty:
            layers[layer].append(_feature(twin.frame, kept, {"layer": layer, **properties}))
    name = str(twin.manifest["name"])
    if path.suffix.lower() in ENDINGS:
        everything = [feature for features in layers.values() for feature in features]
        with replaced_file(path, kind="geojson", inputs=[twin.folder]) as scratch:
            _write(scratch, name, everything)
        return
    if path.is_file():
        raise InputError("is a file", file=path, expected="a folder, or a name that ends .geojson")
    with replaced_folder(path, kind="geojson", inputs=[twin.folder]) as scratch:
        for layer, features in layers.items():
            _write(scratch / f"{layer}.geojson", layer, features)
        counts = {layer: len(features) for layer, features in layers.items()}
        write_json(
            scratch / "geojson.json",
            {"kind": "geojson", "twin": name, "twin_sha256": twin.sha256, "features": counts},
        )


def _write(path: Path, name: str, features: list[dict[str, Any]]) -> None:
    document = {"type": "FeatureCollection", "name": name, "features": features}
    path.write_text(
        json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )


def _features(twin: Twin) -> Iterator[Feature]:
    network = twin.roads
    model = twin.lane_model
    street = {road.id: (road.name, road.kind) for road in network.roads}
    for lane in network.lanes:
        properties = _of_lane(lane, *street.get(lane.road, ("", "")))
        if lane.kind in ("driving", "bus", "bicycle"):
            properties["turns"] = " ".join(turns(network, lane))
        if lane.kind == "crossing":
            yield "crossing", lane.polygon, properties
            continue
        yield "lane", lane.polygon, properties
        if lane.kind != "walkingarea":
            yield "centre_line", shapely.LineString(lane.centre[:, :2]), properties
    for junction in network.junctions:
        properties = {"id": junction.id, "kind": junction.kind, "level": junction.level}
        yield "junction", junction.polygon, properties
    for kind, area in islands(network, model):
        yield "island", area, {"kind": kind}
    for line in stop_lines(network, model):
        properties = {"lane": line.lane, "program": line.signal, "level": line.level}
        yield "stop_line", shapely.LineString(line.points), properties
    for head in heads(network, model):
        properties = {
            "type": head.type,
            "program": head.program,
            "links": " ".join(map(str, head.links)),
            "lane": head.lane,
            "height_m": round(head.z, 2),
            "bearing_deg": _bearing(head.yaw),
        }
        yield "signal", shapely.Point(head.x, head.y), properties
    for sign in signs(model):
        properties = {
            "name": sign.name,
            "country": sign.country,
            "type": sign.type,
            "subtype": sign.subtype,
            "value": sign.value if np.isfinite(sign.value) else None,
            "unit": sign.unit,
            "bearing_deg": _bearing(sign.yaw),
        }
        yield "sign", shapely.Point(sign.x, sign.y), properties


def _of_lane(lane: Lane, name: str, kind_of_road: str) -> dict[str, Any]:
    return {
        "id": lane.id,
        "kind": lane.kind,
        "name": name,
        "highway": kind_of_road,
        "road": lane.road,
        "junction": lane.junction,
        "width_m": round(lane.width, 3),
        "length_m": round(lane.length, 2),
        "speed_limit_kmh": round(lane.speed_limit * 3.6, 1),
        "allowed": " ".join(lane.allowed),
        "successors": " ".join(lane.successors),
        "level": lane.level,
    }


def _polygons(shape: shapely.Geometry) -> shapely.Geometry:
    """Return the areas of a shape, without lines left by a repair."""
    parts = [p for p in shapely.get_parts(shape) if p.geom_type in ("Polygon", "MultiPolygon")]
    areas = [piece for part in parts for piece in shapely.get_parts(part)]
    return areas[0] if len(areas) == 1 else shapely.MultiPolygon(areas)


def _bearing(yaw: float) -> float:
    return round((90.0 - float(np.degrees(yaw))) % 360.0, 2)


def _rounded(lonlat: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.round(lonlat, DECIMALS)


def _feature(
    frame: SiteFrame, shape: shapely.Geometry, properties: dict[str, Any]
) -> dict[str, Any]:
    def degrees(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.round(frame.lonlat_from_site(xy), DECIMALS)

    placed = shapely.transform(shape, degrees)
    if placed.geom_type in ("Polygon", "MultiPolygon"):
        # Rounded corners may cross; this is repaired on the grid of the decimals.
        if not placed.is_valid:
            placed = _polygons(shapely.make_valid(placed))
            placed = _polygons(shapely.set_precision(placed, 10.0**-DECIMALS))
        placed = shapely.orient_polygons(shapely.transform(placed, _rounded))
    return {
        "type": "Feature",
        "geometry": shapely.geometry.mapping(placed),
        "properties": properties,
    }
