"""LAS and LAZ (ASPRS LAS 1.4 R15), read in pieces and cropped to the region."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import shapely
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.reconstruct.formats.coordinate_system import compound
from urbantwin.reconstruct.formats.las_sizes import checked_sizes
from urbantwin.reconstruct.formats.validity import FARTHEST, MOST_POINTS, content_of, count_within
from urbantwin.reconstruct.model import ImportedModel, PointCloud

__all__ = ["bounds_in", "read_las"]

#: Points that are read together, and bytes that they may take.
PIECE, _PIECE_BYTES = 1_000_000, 1 << 28
_GEO_KEYS, _VERTICAL = 34735, 4096
_WITHHELD = "withheld"
#: Kept around the region, metres.
MARGIN_M = 25.0


def read_las(
    path: Path,
    frame: SiteFrame,
    region: shapely.Polygon,
    crs: CRS | None = None,
    *,
    crop: bool = True,
) -> ImportedModel:
    """Read the points of a LAS or LAZ, those around the region where its CRS is known.

    Withheld points are left out. Heights are as the file has them; a vertical CRS is taken from
    its keys.

    Args:
        path: the file.
        frame: the site frame.
        region: the region, site frame.
        crs: its system where the file does not say.
        crop: whether its coordinates lie in that system.

    Raises:
        InputError: it is not LAS, is truncated, has nothing there or too much.
    """
    sizes = checked_sizes(path)
    record = sizes.record if sizes else 0
    piece = max(1, min(PIECE, _PIECE_BYTES // max(record, 1)))
    # Side by side, whole chunks are unpacked at once; one that is huge goes piece by piece.
    slow = sizes is not None and sizes.chunk * record > _PIECE_BYTES
    try:
        reader = laspy.open(path, laz_backend=laspy.LazBackend.Lazrs if slow else None)
    except Exception as error:  # laspy, its decompressor and struct each raise their own
        why = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(
            f"cannot be read as LAS ({why})", file=path, expected="LAS or LAZ"
        ) from None
    with reader:
        header = reader.header
        own = _system(header)
        known = own if own is not None else crs
        bounds = bounds_in(known, frame, region) if known is not None and crop else None
        if not header.point_count:
            raise InputError("holds no point", file=path, expected="a survey")
        if not all(np.isfinite([*header.scales, *header.offsets])) or not all(header.scales):
            raise InputError("has a scale or an offset that is not a number", file=path)
        found = _points(reader, path, bounds, piece)
    cloud, read = found
    notes: dict[str, object] = {"points_in_file": int(header.point_count), "points": read}
    if not read:
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
    return ImportedModel(
        cloud=cloud,
        crs=own,
        up="z",
        unit_m=None,
        notes=notes,
        files=content_of(path),
    )


def _points(
    reader: laspy.LasReader,
    path: Path,
    bounds: tuple[float, float, float, float] | None,
    together: int,
) -> tuple[PointCloud, int]:
    pieces: list[PointCloud] = []
    total = kept = 0
    try:
        for piece in reader.chunk_iterator(together):
            total += len(piece)
            cloud = _piece(piece, bounds)
            kept += len(cloud.points)
            count_within(kept, MOST_POINTS, "points in the region", path)
            pieces.append(cloud)
    except (InputError, KeyboardInterrupt, SystemExit):
        raise
    except BaseException:  # laspy, its decompressor (whose panics are no Exception) and struct
        total = -1
    if total != reader.header.point_count:
        raise InputError(
            f"is truncated: its {reader.header.point_count:,} points cannot all be read",
            file=path,
            expected="the whole file",
        )
    return _joined(pieces), kept


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
    colour = None
    if all(piece.colour is not None for piece in pieces):
        wide = np.concatenate([piece.colour for piece in pieces if piece.colour is not None])
        # LAS wants 16 bits a channel; many programs write 8 (the specification's note on RGB).
        colour = (wide // 257 if wide.max(initial=0) > 255 else wide).astype(np.uint8)
        colour = colour if wide.any() else None
    labels = np.concatenate([p.classification for p in pieces if p.classification is not None])
    return PointCloud(
        np.concatenate([piece.points for piece in pieces]),
        colour,
        labels if labels.any() else None,
        np.concatenate([piece.last for piece in pieces if piece.last is not None]),
    )


def _system(header: laspy.LasHeader) -> CRS | None:
    """Return the CRS of the header, with the vertical one of its GeoTIFF keys."""
    try:
        found: CRS | None = header.parse_crs()
    except (CRSError, ValueError, RuntimeError, IndexError, KeyError):
        return None
    if found is None or len(found.axis_info) == 3 or found.is_compound:
        return found
    vertical = _vertical_code(header)
    if vertical is None:
        return found
    try:
        return compound(found, CRS.from_epsg(vertical))
    except CRSError:
        return found


def _vertical_code(header: laspy.LasHeader) -> int | None:
    """Return VerticalCSTypeGeoKey of the header, which laspy leaves out."""
    for record in (*header.vlrs, *(header.evlrs or ())):
        if record.record_id == _GEO_KEYS and hasattr(record, "geo_keys"):
            for key in record.geo_keys:
                if key.id == _VERTICAL and key.tiff_tag_location == 0 and key.value_offset < 32767:
                    return int(key.value_offset)
    return None


def bounds_in(
    crs: CRS, frame: SiteFrame, region: shapely.Polygon
) -> tuple[float, float, float, float] | None:
    """Return west, south, east, north of the region in a system, ``None`` for geocentric ones.

    Args:
        crs: the system, x east and y north (longitude first where it is geographic).
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
