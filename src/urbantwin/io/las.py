"""LAS and LAZ (ASPRS LAS 1.4 R15), read by laspy in a child process."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.io.child import read_in_child
from urbantwin.io.model import ImportedModel, PointCloud
from urbantwin.io.systems import compound
from urbantwin.io.trust import FARTHEST, MOST_POINTS, content_of, count_within

if TYPE_CHECKING:
    import laspy

__all__ = ["bounds_in", "check_las", "read_las", "read_las_fields", "unpacked_chunks"]

#: Maximum number of points, and of bytes, per batch.
PIECE, _PIECE_BYTES = 1_000_000, 1 << 28
_GEO_KEYS, _VERTICAL = 34735, 4096
_WITHHELD = "withheld"
#: Margin around the region within which points are kept, metres.
MARGIN_M = 25.0
_EXPECTED = "LAS or LAZ"


def read_las_fields(path: Path) -> dict[str, NDArray[np.generic]]:
    """Return all dimensions with one value per point (N,) by name in lower case.

    x, y and z are float64 with scale and offset applied; other dimensions are as stored.

    Raises:
        InputError: not LAS or LAZ, or damaged.
    """
    size = path.stat().st_size
    name = "urbantwin.io.las:_fields"
    fields: dict[str, NDArray[np.generic]] = read_in_child(
        name, path, file=path, size=size, expected=_EXPECTED
    )
    return fields


def check_las(path: Path) -> int:
    """Return the number of points of a file, after reading all of them.

    Raises:
        InputError: not LAS or LAZ, or damaged.
    """
    size = path.stat().st_size
    return int(
        read_in_child("urbantwin.io.las:_count", path, file=path, size=size, expected=_EXPECTED)
    )


def unpacked_chunks(
    packed: bytes, record: bytes, table: list[tuple[int, int]], size: int, *, file: str
) -> NDArray[np.uint8]:
    """Return the bytes of the points in chunks of LAZ.

    Args:
        packed: the chunks.
        record: LASzip's record, which describes the compression.
        table: points and compressed bytes of each chunk.
        size: size of all points in bytes.
        file: name of the file, for errors.

    Raises:
        InputError: a chunk is damaged.
    """
    points: NDArray[np.uint8] = read_in_child(
        "urbantwin.io.las:_unpacked", packed, record, table, size,
        file=file, size=len(packed) + size // 10, expected=_EXPECTED,
    )  # fmt: skip
    return points


def _unpacked(
    packed: bytes, record: bytes, table: list[tuple[int, int]], size: int
) -> NDArray[np.uint8]:
    import lazrs

    points = np.zeros(size, np.uint8)
    lazrs.decompress_points_with_chunk_table(packed, record, points, table)
    return points


def _count(path: Path) -> int:
    return len(_fields(path)["x"])


def _fields(path: Path) -> dict[str, NDArray[np.generic]]:
    import laspy

    cloud = laspy.read(path)
    if len(cloud.points) != cloud.header.point_count:
        raise ValueError(f"it holds {len(cloud.points)} of {cloud.header.point_count} points")
    fields: dict[str, NDArray[np.generic]] = {
        axis: np.asarray(getattr(cloud, axis), np.float64) for axis in "xyz"
    }
    for name in cloud.point_format.dimension_names:
        values = np.asarray(cloud[name])
        if name.lower() not in fields and values.ndim == 1 and name not in ("X", "Y", "Z"):
            fields[name.lower()] = values
    return fields


def read_las(
    path: Path,
    frame: SiteFrame,
    region: shapely.Polygon,
    crs: CRS | None = None,
    *,
    crop: bool = True,
) -> ImportedModel:
    """Read the points of a LAS or LAZ; only those around the region if its CRS is known.

    Withheld points are left out. Heights are as in the file; a vertical CRS is taken from its keys.

    Args:
        path: the file.
        frame: the site frame.
        region: the region, site frame.
        crs: CRS of the file if it states none.
        crop: whether its coordinates are in that CRS.

    Raises:
        InputError: it is not LAS, is truncated, has no point there or too many.
    """
    model: ImportedModel = read_in_child(
        "urbantwin.io.las:_survey", path, frame, region, crs, crop,
        file=path, size=path.stat().st_size, expected=_EXPECTED,
    )  # fmt: skip
    return model


def _survey(
    path: Path, frame: SiteFrame, region: shapely.Polygon, crs: CRS | None, crop: bool
) -> ImportedModel:
    import laspy

    with laspy.open(path) as reader:
        header = reader.header
        own = _system(header)
        known = own if own is not None else crs
        bounds = bounds_in(known, frame, region) if known is not None and crop else None
        if not header.point_count:
            raise InputError("holds no point", file=path, expected="a survey")
        if not all(np.isfinite([*header.scales, *header.offsets])) or not all(header.scales):
            raise InputError("has a scale or an offset that is not a number", file=path)
        cloud = _points(reader, path, bounds)
    notes: dict[str, object] = {
        "points_in_file": int(header.point_count),
        "points": len(cloud.points),
    }
    if not len(cloud.points):
        low, high = header.mins, header.maxs
        raise InputError(
            f"has no point in the region (it covers {low[0]:.0f} {low[1]:.0f} to "
            f"{high[0]:.0f} {high[1]:.0f} in {known.name if known is not None else 'its frame'})",
            file=path,
            expected="a survey of the site, or its right crs",
        )
    if cloud.classification is not None:
        kinds, counts = np.unique(cloud.classification, return_counts=True)
        notes["classes"] = {str(k): int(n) for k, n in zip(kinds, counts, strict=True)}
    return ImportedModel(cloud=cloud, crs=own, up="z", notes=notes, files=content_of(path))


def _points(
    reader: laspy.LasReader, path: Path, bounds: tuple[float, float, float, float] | None
) -> PointCloud:
    pieces: list[PointCloud] = []
    total = kept = 0
    record = reader.header.point_format.size
    for piece in reader.chunk_iterator(max(1, min(PIECE, _PIECE_BYTES // record))):
        total += len(piece)
        cloud = _piece(piece, bounds)
        kept += len(cloud.points)
        count_within(kept, MOST_POINTS, "points in the region", path)
        pieces.append(cloud)
    if total != reader.header.point_count:
        raise InputError(
            f"is truncated: it holds {total:,} of its {reader.header.point_count:,} points",
            file=path,
            expected="the whole file",
        )
    return _joined(pieces)


def _piece(
    piece: laspy.ScaleAwarePointRecord, bounds: tuple[float, float, float, float] | None
) -> PointCloud:
    points = np.column_stack([piece.x, piece.y, piece.z]).astype(np.float64)
    keep = (np.abs(points) <= FARTHEST).all(axis=1)
    names = set(piece.point_format.dimension_names)
    if _WITHHELD in names:
        keep &= np.asarray(piece[_WITHHELD]) == 0
    if bounds is not None:
        west, south, east, north = bounds
        x, y = points[:, 0], points[:, 1]
        keep &= (x >= west) & (x <= east) & (y >= south) & (y <= north)
    colour = None
    if {"red", "green", "blue"} <= names:
        colour = np.column_stack([piece.red, piece.green, piece.blue])[keep]
    last = np.asarray(piece.return_number) >= np.asarray(piece.number_of_returns)
    label = np.asarray(piece.classification, np.uint8)
    return PointCloud(points[keep], colour, label[keep], last[keep])


def _joined(pieces: list[PointCloud]) -> PointCloud:
    cloud = PointCloud.concatenate(pieces)
    colour, label = cloud.colour, cloud.classification
    if colour is not None:
        # LAS requires 16 bits per channel; many programs write 8 (the specification's note on RGB).
        bytes_ = (colour // 257 if colour.max(initial=0) > 255 else colour).astype(np.uint8)
        colour = bytes_ if colour.any() else None
    if label is not None and not label.any():
        label = None
    return PointCloud(cloud.points, colour, label, cloud.last)


def _system(header: laspy.LasHeader) -> CRS | None:
    """Return the CRS of the header, with the vertical one of its GeoTIFF keys."""
    try:
        plan: CRS | None = header.parse_crs()
    except (CRSError, ValueError, RuntimeError, IndexError, KeyError):
        return None
    if plan is None or len(plan.axis_info) == 3 or plan.is_compound:
        return plan
    vertical = _vertical_code(header)
    if vertical is None:
        return plan
    try:
        return compound(plan, CRS.from_epsg(vertical))
    except CRSError:
        return plan


def _vertical_code(header: laspy.LasHeader) -> int | None:
    """Return VerticalCSTypeGeoKey of the header, which laspy omits."""
    for record in (*header.vlrs, *(header.evlrs or ())):
        if record.record_id == _GEO_KEYS and hasattr(record, "geo_keys"):
            for key in record.geo_keys:
                if key.id == _VERTICAL and key.tiff_tag_location == 0 and key.value_offset < 32767:
                    return int(key.value_offset)
    return None


def bounds_in(
    crs: CRS, frame: SiteFrame, region: shapely.Polygon
) -> tuple[float, float, float, float] | None:
    """Return west, south, east, north of the region in a CRS, ``None`` for geocentric ones.

    Args:
        crs: the CRS, x east and y north (longitude first if geographic).
        frame: the site frame.
        region: the region, site frame.
    """
    if crs.is_geocentric:
        return None
    around = region.buffer(MARGIN_M).envelope.segmentize(50.0)
    lonlat = frame.lonlat_from_site(shapely.get_coordinates(around))
    try:
        transform = Transformer.from_crs("EPSG:4326", crs.to_2d(), always_xy=True)
        x, y = transform.transform(lonlat[:, 0], lonlat[:, 1])
    except ProjError:
        return None
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return None
    return float(min(x)), float(min(y)), float(max(x)), float(max(y))
