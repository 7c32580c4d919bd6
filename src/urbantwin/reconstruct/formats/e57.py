"""E57 (ASTM E2807): scans with their poses, read in pieces by libE57Format."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj import CRS

from urbantwin.errors import InputError
from urbantwin.extras import check_extra
from urbantwin.geometry import SiteFrame
from urbantwin.reconstruct.formats.coordinate_system import crs_of
from urbantwin.reconstruct.formats.las import bounds_in
from urbantwin.reconstruct.formats.validity import FARTHEST, MOST_POINTS, content_of, count_within
from urbantwin.reconstruct.model import ImportedModel, PointCloud

__all__ = ["read_e57"]

#: Points that are read together.
PIECE = 500_000
#: The most scans of a file, and points of one that are looked at.
MOST_SCANS, MOST_LOOKED_AT = 10_000, 4_000_000_000
#: The header (E2807, 8.3): signature, versions, physical length, where the XML lies, page size.
_HEADER = struct.Struct("<8sIIQQQQ")
_PLACES = {
    "cartesian": ("cartesianX", "cartesianY", "cartesianZ"),
    "spherical": ("sphericalRange", "sphericalAzimuth", "sphericalElevation"),
}
_COLOURS = ("colorRed", "colorGreen", "colorBlue")
#: A quaternion whose length differs by more from 1 is none.
UNIT = 1e-3
Numbers = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Pose:
    """Where a scan's own frame lies in the file's."""

    rotation: Numbers
    translation: Numbers

    def of(self, points: Numbers) -> Numbers:
        """Return points (N, 3) in the file's frame."""
        return np.asarray(points @ self.rotation.T + self.translation)


def read_e57(
    path: Path,
    frame: SiteFrame,
    region: shapely.Polygon,
    crs: CRS | None = None,
    *,
    crop: bool = True,
) -> ImportedModel:
    """Read the points of all scans, each at its pose; those around the region where a CRS is known.

    Points that are marked invalid are left out, also those of which only the direction is known.
    Intensities and pictures are not used.

    Args:
        path: the file.
        frame: the site frame.
        region: the region, site frame.
        crs: its system where the file does not say.
        crop: whether its coordinates lie in that system.

    Raises:
        InputError: it is not E57, is damaged, has no point there or too many; or pye57 is not
            installed.
    """
    check_extra("e57", "reading E57", file=path)
    from pye57 import libe57 as library

    _check_header(path)

    def guarded(doing: Callable[[], Any]) -> Any:  # noqa: ANN401 - of the library
        try:
            return doing()
        except (library.E57Exception, RuntimeError, ValueError, TypeError) as error:
            why = " ".join(str(error).split())[:100] or type(error).__name__
            raise InputError(
                f"cannot be read as E57 ({why})", file=path, expected="the whole file"
            ) from None

    file = guarded(lambda: library.ImageFile(str(path), "r"))
    try:
        root = file.root()
        own = guarded(lambda: _system(root))
        known = own if own is not None else crs
        bounds = bounds_in(known, frame, region) if known is not None and crop else None
        scans = guarded(lambda: root["data3D"])
        count = guarded(lambda: len(scans))
        count_within(count, MOST_SCANS, "scans", path)
        clouds: list[PointCloud] = []
        notes: dict[str, object] = {"scans": count, "points_in_file": 0, "points_invalid": 0}
        kept = 0
        for number in range(count):
            scan = guarded(lambda n=number: _Scan(library, file, scans[n], path, n))  # type: ignore[misc]
            notes["points_in_file"] = int(notes["points_in_file"]) + scan.count  # type: ignore[call-overload]
            pieces = scan.pieces(guarded)
            for points, colour, invalid in pieces:
                notes["points_invalid"] = int(notes["points_invalid"]) + invalid  # type: ignore[call-overload]
                keep = (np.abs(points) <= FARTHEST).all(axis=1)
                if bounds is not None:
                    west, south, east, north = bounds
                    x, y = points[:, 0], points[:, 1]
                    keep &= (x >= west) & (x <= east) & (y >= south) & (y <= north)
                kept += int(keep.sum())
                count_within(kept, MOST_POINTS, "points in the region", path)
                clouds.append(PointCloud(points[keep], None if colour is None else colour[keep]))
    finally:
        file.close()
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
        notes={**notes, "points": kept},
        files=content_of(path),
    )


def _check_header(path: Path) -> None:
    """Refuse a file that is shorter than its header says, before the library opens it."""
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
    """Return the CRS that the file names (E2807, 8.4.2: well-known text)."""
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
        """Return what black and white are in each channel."""
        low, high = np.zeros(3), np.full(3, 255.0)
        if node.isDefined("colorLimits"):
            limits = node["colorLimits"]
            for k, name in enumerate(_COLOURS):
                if limits.isDefined(f"{name}Minimum") and limits.isDefined(f"{name}Maximum"):
                    low[k] = float(limits[f"{name}Minimum"].value())
                    high[k] = float(limits[f"{name}Maximum"].value())
        return low, np.where(high > low, high, low + 255.0)

    def _posed(self, node: Any) -> _Pose:  # noqa: ANN401
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
        return _Pose(_matrix(rotation / length), translation)

    def pieces(
        self, guarded: Callable[[Callable[[], Any]], Any]
    ) -> Iterator[tuple[Numbers, NDArray[np.uint8] | None, int]]:
        """Yield points (N, 3), their colours (N, 3), and how many invalid ones were left out."""
        names = [*_PLACES[self._kind], *(_COLOURS if self._coloured else ())]
        names += [self._invalid] if self._invalid else []
        room = max(1, min(PIECE, self.count))
        columns = {name: np.zeros(room, np.float64) for name in names}
        buffers = self._library.VectorSourceDestBuffer()
        for name, column in columns.items():
            buffers.append(
                guarded(
                    lambda n=name, c=column: self._library.SourceDestBuffer(  # type: ignore[misc]
                        self._file, n, c, room, True, True
                    )
                )
            )
        reader = guarded(lambda: self._points.reader(buffers))
        total = 0
        try:
            while total < self.count:
                got = int(guarded(reader.read))
                if not got:
                    break
                total += got
                yield self._piece({name: column[:got] for name, column in columns.items()})
        finally:
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
        return self._pose.of(points[valid]), colour, int((~valid).sum())


def _matrix(q: Numbers) -> Numbers:
    """Return the rotation (3, 3) of a unit quaternion w, x, y, z."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
