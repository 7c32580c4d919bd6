"""E57 (ASTM E2807): scans with their poses, read by libE57Format in a child process."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.geometry import Pose, SiteFrame
from urbantwin.io.child import read_in_child
from urbantwin.io.las import bounds_in
from urbantwin.io.model import ImportedModel, PointCloud
from urbantwin.io.poses import quaternion_rotation
from urbantwin.io.systems import crs_of
from urbantwin.io.trust import FARTHEST, MOST_POINTS, content_of, count_within

__all__ = ["read_e57"]

#: Points per batch.
PIECE = 500_000
#: Maximum number of scans of a file, and of points of a scan.
MOST_SCANS, MOST_LOOKED_AT = 10_000, 4_000_000_000
#: Header (E2807, 8.3): signature, versions, physical length, offset of the XML, page size.
_HEADER = struct.Struct("<8sIIQQQQ")
_PLACES = {
    "cartesian": ("cartesianX", "cartesianY", "cartesianZ"),
    "spherical": ("sphericalRange", "sphericalAzimuth", "sphericalElevation"),
}
_COLOURS = ("colorRed", "colorGreen", "colorBlue")
#: Maximum deviation of a quaternion's length from 1.
UNIT = 1e-3
Numbers = NDArray[np.float64]


def read_e57(
    path: Path,
    frame: SiteFrame,
    region: shapely.Polygon,
    crs: CRS | None = None,
    *,
    crop: bool = True,
) -> ImportedModel:
    """Read the points of all scans at their poses; around the region only, if the CRS is known.

    Points that are marked invalid or have only a direction are left out. Intensities and images are
    not used.

    Args:
        path: the file.
        frame: the site frame.
        region: the region, site frame.
        crs: CRS of the file if it states none.
        crop: whether its coordinates are in that CRS.

    Raises:
        InputError: it is not E57, is damaged, has no point there or too many; or pye57 is not
            installed.
    """
    check_extra("e57", "reading E57", file=path)
    _check_header(path)
    model: ImportedModel = read_in_child(
        "urbantwin.io.e57:_scans", path, frame, region, crs, crop,
        file=path, size=path.stat().st_size, expected="E57",
    )  # fmt: skip
    return model


def _scans(
    path: Path, frame: SiteFrame, region: shapely.Polygon, crs: CRS | None, crop: bool
) -> ImportedModel:
    from pye57 import libe57 as library

    file = library.ImageFile(str(path), "r")
    root = file.root()
    own = _system(root)
    known = own if own is not None else crs
    bounds = bounds_in(known, frame, region) if known is not None and crop else None
    nodes = root["data3D"]
    count_within(len(nodes), MOST_SCANS, "scans", path)
    clouds: list[PointCloud] = []
    total = invalid = kept = 0
    for number in range(len(nodes)):
        scan = _Scan(library, file, nodes[number], path, number)
        total += scan.count
        for points, colour, left_out in scan.pieces():
            invalid += left_out
            keep = (np.abs(points) <= FARTHEST).all(axis=1)
            if bounds is not None:
                west, south, east, north = bounds
                x, y = points[:, 0], points[:, 1]
                keep &= (x >= west) & (x <= east) & (y >= south) & (y <= north)
            kept += int(keep.sum())
            count_within(kept, MOST_POINTS, "points in the region", path)
            clouds.append(PointCloud(points[keep], None if colour is None else colour[keep]))
    if not kept:
        where = " in the region" if bounds is not None else ""
        raise InputError(
            f"has no point{where}", file=path, expected="a survey of the site, or its right crs"
        )
    return ImportedModel(
        cloud=PointCloud.concatenate([cloud for cloud in clouds if len(cloud.points)]),
        crs=own,
        up="z",
        unit_m=1.0,  # E2807, 8.4: metres
        notes={
            "scans": len(nodes),
            "points_in_file": total,
            "points_invalid": invalid,
            "points": kept,
        },
        files=content_of(path),
    )


def _check_header(path: Path) -> None:
    """Raise an error for a file shorter than its header states, before the library opens it."""
    with path.open("rb") as stream:
        start = stream.read(_HEADER.size)
    size = path.stat().st_size
    if len(start) < _HEADER.size:
        raise InputError("is truncated within its header", file=path, expected="E57")
    signature, major, _, length, xml_at, xml_length, page = _HEADER.unpack(start)
    if signature != b"ASTM-E57" or major != 1:
        raise InputError("is not E57 of version 1", file=path, expected="E57")
    if page != 1024 or xml_at + xml_length > length:
        raise InputError("has a header that is wrong", file=path, expected="E57")
    if size < length:
        raise InputError(
            f"is truncated: {size:,} of its {length:,} bytes are there",
            file=path,
            expected="the whole file",
        )


def _system(root: Any) -> CRS | None:  # noqa: ANN401
    """Return the CRS of the file (E2807, 8.4.2: well-known text)."""
    if not root.isDefined("coordinateMetadata"):
        return None
    found = crs_of(str(root["coordinateMetadata"].value()))
    return None if found is not None and found.is_engineering else found


class _Scan:
    """One scan: its points in pieces, in the file's frame."""

    def __init__(
        self,
        library: Any,  # noqa: ANN401
        file: Any,  # noqa: ANN401
        node: Any,  # noqa: ANN401
        path: Path,
        number: int,
    ) -> None:
        self._library, self._file, self._path = library, file, path
        self._name = f"data3D[{number}]"
        self._points = node["points"]
        self.count = int(self._points.childCount())
        count_within(self.count, MOST_LOOKED_AT, "points", path)
        prototype = library.StructureNode(self._points.prototype())
        fields = {prototype.get(k).elementName() for k in range(prototype.childCount())}
        kinds = [kind for kind, names in _PLACES.items() if fields >= set(names)]
        if not kinds:
            raise InputError(
                "has neither x, y, z nor range and angles",
                file=path,
                place=self._name,
                expected="points",
            )
        self._kind = kinds[0]
        self._invalid = f"{self._kind}InvalidState" if f"{self._kind}InvalidState" in fields else ""
        self._coloured = fields >= set(_COLOURS)
        self._dark, self._bright = self._colour_limits(node)
        self._pose = self._posed(node)

    def _colour_limits(self, node: Any) -> tuple[Numbers, Numbers]:  # noqa: ANN401
        """Return the values of black and white in each channel."""
        low, high = np.zeros(3), np.full(3, 255.0)
        if node.isDefined("colorLimits"):
            limits = node["colorLimits"]
            for k, name in enumerate(_COLOURS):
                if limits.isDefined(f"{name}Minimum") and limits.isDefined(f"{name}Maximum"):
                    low[k] = float(limits[f"{name}Minimum"].value())
                    high[k] = float(limits[f"{name}Maximum"].value())
        return low, np.where(high > low, high, low + 255.0)

    def _posed(self, node: Any) -> Pose:  # noqa: ANN401
        rotation, translation = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
        if node.isDefined("pose"):
            pose = node["pose"]
            if pose.isDefined("rotation"):
                rotation = np.array([float(pose["rotation"][k].value()) for k in "wxyz"])
            if pose.isDefined("translation"):
                translation = np.array([float(pose["translation"][k].value()) for k in "xyz"])
        length = float(np.linalg.norm(rotation))
        if not abs(length - 1.0) < UNIT or not np.isfinite(translation).all():
            raise InputError(
                "has a pose that is no rotation and translation",
                file=self._path,
                place=self._name,
                expected="a unit quaternion, metres",
            )
        return Pose(quaternion_rotation(*(rotation / length).tolist()), translation)

    def pieces(self) -> Iterator[tuple[Numbers, NDArray[np.uint8] | None, int]]:
        """Yield points (N, 3), their colours (N, 3), and the number of omitted invalid ones."""
        names = [*_PLACES[self._kind], *(_COLOURS if self._coloured else ())]
        names += [self._invalid] if self._invalid else []
        room = max(1, min(PIECE, self.count))
        columns = {name: np.zeros(room, np.float64) for name in names}
        buffers = self._library.VectorSourceDestBuffer()
        for name, column in columns.items():
            buffers.append(
                self._library.SourceDestBuffer(self._file, name, column, room, True, True)
            )
        reader = self._points.reader(buffers)
        total = 0
        while total < self.count and (got := int(reader.read())):
            total += got
            yield self._piece({name: column[:got] for name, column in columns.items()})
        reader.close()
        if total != self.count:
            raise InputError(
                f"holds {total:,} of the {self.count:,} points that it names",
                file=self._path,
                place=self._name,
                expected="the whole file",
            )

    def _piece(self, columns: dict[str, Numbers]) -> tuple[Numbers, NDArray[np.uint8] | None, int]:
        a, b, c = (columns[name] for name in _PLACES[self._kind])
        points = np.column_stack([a, b, c])
        if self._kind == "spherical":  # E2807, 8.5: azimuth from x, elevation from the plane
            level = a * np.cos(c)
            points = np.column_stack([level * np.cos(b), level * np.sin(b), a * np.sin(c)])
        valid = np.isfinite(points).all(axis=1)
        if self._invalid:
            valid &= columns[self._invalid] == 0
        colour = None
        if self._coloured:
            raw = np.column_stack([columns[name] for name in _COLOURS])[valid]
            share = (raw - self._dark) / (self._bright - self._dark)
            colour = np.round(255 * np.clip(share, 0.0, 1.0)).astype(np.uint8)
        return self._pose.apply(points[valid]), colour, int((~valid).sum())
