"""Reading of building outlines: GeoPackage, GeoJSON, SpatiaLite, Shapefile, FlatGeobuf."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.geometry import SiteFrame
from urbantwin.reconstruct.airborne.vector_file import check_vector_file

__all__ = ["read_footprints"]

_EXPECTED = "polygons in a GeoPackage, GeoJSON, SpatiaLite, Shapefile or FlatGeobuf, with a CRS"
#: Maximum number of outlines of a site.
MOST_OUTLINES = 500_000
#: Minimum area of an outline, square metres: smaller ones are slivers of a topology.
SMALLEST_M2 = 2.0
#: Words in names of layers with buildings.
_BUILDINGS = (
    "building",
    "pand",
    "footprint",
    "gebaeude",
    "gebäude",
    "batiment",
    "bâtiment",
    "edifici",
)


def read_footprints(
    path: Path,
    frame: SiteFrame,
    area: shapely.Polygon,
    *,
    crs: str | None = None,
    notes: list[str] | None = None,
) -> list[shapely.Polygon]:
    """Return the outlines of buildings that intersect an area.

    Curves are linearised, multipolygons and polyhedral surfaces split, invalid rings repaired. Of
    several layers, the one named after buildings is read, otherwise the one with most polygons.

    Args:
        path: the vector file; its CRS is the file's own.
        frame: the site frame.
        area: the area, site frame, metres.
        crs: the CRS if the file has none (``"EPSG:28992"``).
        notes: list to which lines about omissions are appended, if given.

    Returns:
        Simple valid polygons in the site frame, metres, in the order of the file.

    Raises:
        InputError: the file is missing or unreadable, has no polygons, no CRS or one without a
            known transformation, or none of its outlines intersects the area.
    """
    told: list[str] = [] if notes is None else notes
    layer, shapes, system = _polygons(path, told)
    if crs is not None:
        system = crs
    if not system:
        raise InputError(
            f"layer {layer!r} has no coordinate reference system",
            file=path,
            expected="a CRS in the file (EPSG:28992), or crs in site.yaml",
        )
    placed = shapely.transform(shapes, _to_site(path, system, frame), include_z=False)
    finite = np.isfinite(shapely.bounds(placed)).all(axis=1)
    near = np.zeros(len(placed), bool)
    near[finite] = shapely.intersects(shapely.envelope(placed[finite]), area)
    if not near.any():
        raise InputError(
            f"none of its {len(placed)} outlines lies in the area of the site"
            + _where(placed[finite], frame),
            file=path,
            place=f"layer {layer}",
            expected=f"outlines around {frame.latitude:.4f}, {frame.longitude:.4f}",
        )
    outlines: list[shapely.Polygon] = []
    for shape in placed[near]:
        outlines.extend(part for part in _simple(shape) if part.intersects(area))
    small = sum(outline.area < SMALLEST_M2 for outline in outlines)
    if small:
        told.append(f"{path.name}: {small} outlines below {SMALLEST_M2:g} m2 left out")
    return [outline for outline in outlines if outline.area >= SMALLEST_M2]


def _polygons(path: Path, told: list[str]) -> tuple[str, NDArray[Any], str | None]:
    """Return the layer's name, its polygons (as shapely geometries) and its CRS."""
    check_extra("airborne", "reading outlines of buildings", file=path)
    import pyogrio
    from pyogrio.errors import DataLayerError, DataSourceError

    if not path.is_file():
        raise InputError("no such file", file=path, expected=_EXPECTED)
    check_vector_file(path, _EXPECTED)
    try:
        layers = [str(name) for name, kind in pyogrio.list_layers(path) if kind is not None]
    except (DataSourceError, DataLayerError) as error:
        raise InputError(f"cannot be read: {error}", file=path, expected=_EXPECTED) from None
    found: list[tuple[bool, int, str, NDArray[Any], str | None]] = []
    for name in layers:
        try:
            info, _, raw, _ = pyogrio.raw.read(
                path, layer=name, columns=[], max_features=MOST_OUTLINES + 1
            )
        except (DataSourceError, DataLayerError, ValueError, RuntimeError) as error:
            told.append(f"{path.name}: layer {name} cannot be read: {' '.join(str(error).split())}")
            continue
        if len(raw) > MOST_OUTLINES:
            raise InputError(
                f"layer {name!r} holds more than {MOST_OUTLINES} outlines",
                file=path,
                expected="the outlines of one site",
            )
        shapes = np.array([_geometry(item) for item in raw], dtype=object)
        polygonal = np.isin(shapely.get_type_id(shapes), (3, 6))
        if (~polygonal).any():
            told.append(f"{path.name}: layer {name}: {(~polygonal).sum()} features are no polygons")
        named = any(word in name.lower() for word in _BUILDINGS)
        found.append((named, int(polygonal.sum()), name, shapes[polygonal], info["crs"]))
    found = [item for item in found if item[1]]
    if not found:
        raise InputError("holds no polygons", file=path, expected=_EXPECTED)
    _, _, name, shapes, system = max(found, key=lambda item: item[:2])
    if len(found) > 1:
        others = ", ".join(sorted(item[2] for item in found if item[2] != name))
        told.append(f"{path.name}: layer {name} read; not {others}")
    return name, shapes, system


def _geometry(raw: bytes | None) -> shapely.Geometry | None:
    """Return the geometry of a WKB, with polyhedral surfaces and TINs as multipolygons."""
    if raw is None:
        return None
    order = "<" if raw[:1] == b"\x01" else ">"
    kind = struct.unpack_from(f"{order}I", raw, 1)[0]
    if kind & 0x1FFFFFFF in (15, 16, 1015, 1016, 2015, 2016, 3015, 3016):
        return _surface(raw, order)
    shape = shapely.from_wkb(raw, on_invalid="ignore")
    if shape is not None and shape.geom_type == "GeometryCollection":
        parts = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
        return shapely.MultiPolygon(parts) if parts else shape
    return shape


def _surface(raw: bytes, order: str) -> shapely.Geometry | None:
    """Return the plan view of the faces of a polyhedral surface or TIN.

    Their WKB is that of a multipolygon with another type number, a TIN's of triangles (OGC
    06-103r4, table 7: Polygon 3, MultiPolygon 6, PolyhedralSurface 15, TIN 16, Triangle 17).
    """
    faces, offset = [], 9
    kind = struct.unpack_from(f"{order}I", raw, 1)[0]
    wide = 3 if kind & 0x80000000 or kind % 0x20000000 // 1000 in (1, 2) else 2
    wide = 4 if kind % 0x20000000 // 1000 == 3 else wide
    try:
        for _ in range(struct.unpack_from(f"{order}I", raw, 5)[0]):
            inner = "<" if raw[offset : offset + 1] == b"\x01" else ">"
            rings = []
            rings_count = struct.unpack_from(f"{inner}I", raw, offset + 5)[0]
            offset += 9
            for _ in range(rings_count):
                count = struct.unpack_from(f"{inner}I", raw, offset)[0]
                values = np.frombuffer(raw, f"{inner}f8", count * wide, offset + 4)
                rings.append(values.reshape(-1, wide)[:, :2])
                offset += 4 + 8 * wide * count
            faces.append(shapely.Polygon(rings[0], rings[1:]))
    except (struct.error, ValueError, IndexError):
        return None
    # walls are lines in plan
    flat = [shapely.make_valid(face) for face in faces if face.area > 1e-9]
    return shapely.union_all(flat) if flat else None


def _to_site(path: Path, system: str, frame: SiteFrame) -> Any:  # noqa: ANN401
    try:
        transformer = Transformer.from_crs(CRS.from_user_input(system), 4326, always_xy=True)
    except (CRSError, ProjError) as error:
        raise InputError(
            f"has a CRS without a known transform: {system[:60]!r} ({error})",
            file=path,
            expected="a CRS that PROJ knows, as EPSG:28992",
        ) from None
    # Via WGS84: the frame's own string has no datum, which shifts EPSG:28992 by 100 m.
    return lambda xy: frame.site_from_lonlat(
        np.column_stack(transformer.transform(xy[:, 0], xy[:, 1]))
    )


def _where(placed: NDArray[Any], frame: SiteFrame) -> str:
    """Return the location of the outlines, for the error message."""
    if not len(placed):
        return "; they are not on Earth in their CRS"
    middle = np.median(shapely.bounds(placed)[:, :2], axis=0)
    longitude, latitude = frame.lonlat_from_site(middle)[0]
    if not (np.isfinite(longitude) and np.isfinite(latitude)):
        return ""
    return f": they lie around {latitude:.4f}, {longitude:.4f}"


def _simple(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """Return the valid polygons of a shape, without repeated corners."""
    valid = shape if shape.is_valid else shapely.make_valid(shape, method="structure")
    parts = shapely.get_parts(shapely.get_parts(valid))
    return [
        shapely.orient_polygons(shapely.remove_repeated_points(part, 0.01))
        for part in parts
        if part.geom_type == "Polygon" and not part.is_empty
    ]
