"""COLMAP: sparse models (text and binary), georeferenced by the positions of their images.

The formats are those of COLMAP's documentation ("Output Format"): ``points3D`` and ``images`` as
``.txt`` and ``.bin``, little-endian. Positions of images are GPS tags (EXIF 2.32) or a list beside
the model.
"""

from __future__ import annotations

import math
import re
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.io.model import Geotag, ImportedModel, PointCloud
from urbantwin.io.poses import quaternion_rotation
from urbantwin.io.trust import (
    MOST_POINTS,
    check_coordinates,
    content_of,
    count_within,
)
from urbantwin.number_text import plain_number

__all__ = ["camera_centres", "fitted_places", "image_places", "read_sparse_points", "sparse_folder"]

_IMAGE = struct.Struct("<I7dI")
_MOST_IMAGES = 1_000_000
#: A point without its track: id, x y z, colour, error, length of the track.
_POINT_BYTES = 51


def sparse_folder(folder: Path) -> Path | None:
    """Return the folder of a sparse model in or below a COLMAP folder."""
    for name in (".", "sparse/0", "sparse", "dense/sparse", "dense/0/sparse", "0"):
        here = folder / name
        if any((here / f"images{e}").is_file() for e in (".bin", ".txt")) and any(
            (here / f"points3D{e}").is_file() for e in (".bin", ".txt")
        ):
            return here
    return None


def read_sparse_points(folder: Path) -> ImportedModel:
    """Read the points of a sparse model with their colours.

    Raises:
        InputError: the file is wrong or holds none.
    """
    binary = folder / "points3D.bin"
    if binary.is_file():
        points, colour = _binary_points(binary)
        path = binary
    else:
        path = folder / "points3D.txt"
        points, colour = _text_points(path)
    if not len(points):
        raise InputError("holds no point", file=path, expected="a sparse model")
    check_coordinates(points, path, "point")
    cloud = PointCloud(points, colour)
    return ImportedModel(cloud=cloud, notes={"points": len(points)}, files=content_of(path))


def camera_centres(folder: Path) -> dict[str, NDArray[np.float64]]:
    """Return the camera centre of each image of a sparse model, by its name.

    The centre is ``-R^T t`` of the image's rotation (a quaternion w x y z) and translation.

    Raises:
        InputError: the file is wrong.
    """
    binary = folder / "images.bin"
    path = binary if binary.is_file() else folder / "images.txt"
    try:
        rows = _binary_images(binary) if binary.is_file() else _text_images(path)
    except (struct.error, ValueError, IndexError, UnicodeDecodeError):
        raise InputError("is truncated or damaged", file=path, expected="COLMAP's images") from None
    return {name: -_rotation(values[:4]).T @ values[4:7] for name, values in rows}


def _rotation(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    return quaternion_rotation(*(quaternion / np.linalg.norm(quaternion)))


def _binary_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    data = path.read_bytes()
    count = struct.unpack_from("<Q", data)[0] if len(data) >= 8 else -1
    count_within(count, MOST_POINTS, "points", path)
    starts, at = np.zeros(min(count, len(data) // _POINT_BYTES), np.int64), 8
    for row in range(count):
        if at + _POINT_BYTES > len(data):
            raise InputError("is truncated", file=path, expected=f"{count:,} points")
        starts[row] = at
        (length,) = struct.unpack_from("<Q", data, at + _POINT_BYTES - 8)
        at += _POINT_BYTES + 8 * length
    if at > len(data):
        raise InputError("is truncated", file=path, expected=f"{count:,} points")
    kind = np.dtype([("xyz", "<f8", 3), ("rgb", "u1", 3)])
    taken = np.frombuffer(data, np.uint8)[starts[:, None] + 8 + np.arange(kind.itemsize)]
    rows = np.frombuffer(taken.tobytes(), kind)
    return rows["xyz"].astype(np.float64), rows["rgb"].copy()


def _text_points(path: Path) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    found = []
    with path.open(encoding="utf-8", errors="replace") as stream:
        for number, line in enumerate(stream, 1):
            if line.startswith("#") or not line.strip():
                continue
            try:
                found.append([plain_number(word) for word in line.split(None, 7)[1:7]])
            except ValueError:
                found.append([])
            if len(found[-1]) != 6:
                raise InputError(
                    f"has {line[:40]!r}",
                    file=path,
                    place=f"line {number}",
                    expected="POINT3D_ID X Y Z R G B ERROR",
                )
    table = np.array(found).reshape(-1, 6)
    return table[:, :3], np.clip(table[:, 3:], 0, 255).astype(np.uint8)


def _binary_images(path: Path) -> list[tuple[str, NDArray[np.float64]]]:
    data = path.read_bytes()
    (count,) = struct.unpack_from("<Q", data)
    if count > _MOST_IMAGES:
        raise ValueError(count)
    at, found = 8, []
    for _ in range(count):
        values = _IMAGE.unpack_from(data, at)
        at += _IMAGE.size
        end = data.index(b"\0", at)
        name = data[at:end].decode()
        (points,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + 24 * points
        if at > len(data):
            raise ValueError(points)
        found.append((name, np.array(values[1:8])))
    return found


def _text_images(path: Path) -> list[tuple[str, NDArray[np.float64]]]:
    lines = [
        line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")
    ]
    found = []
    for line in lines[::2]:
        words = line.split(None, 9)
        if words:
            found.append((words[9].strip(), np.array([plain_number(word) for word in words[1:8]])))
    return found


_GPS = 0x8825
#: Maximum number of images of a fit.
_MOST = 2000
_NUMBER = r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?"
_ROW = re.compile(rf"^(\S.*?)[\s,;]+({_NUMBER})[\s,;]+({_NUMBER})[\s,;]+({_NUMBER})\s*$")
#: Residual, in medians, above which images are excluded from the fit.
_OUTLIER = 5.0
#: Minimum spread of image positions about a line, metres.
_LEAST_SPREAD_M = 1.0


@dataclass(frozen=True, eq=False)
class ImagePlaces:
    """Positions of images.

    Attributes:
        lonlat: degrees, by the image's name.
        height: metres of an unknown datum, by the image's name.
        source: the list, or the tags of the images.
    """

    lonlat: dict[str, tuple[float, float]]
    height: dict[str, float]
    source: str


def image_places(folder: Path, names: list[str]) -> ImagePlaces | None:
    """Return the positions of images, from a list in the folder or from their own tags.

    Args:
        folder: folder of the reconstruction; images are searched in it, in ``images`` and beside
            it.
        names: names of the images in the reconstruction.
    """
    wanted = {name.lower(): name for name in names}
    for file in sorted(folder.glob("*.txt")) + sorted(folder.glob("*.csv")):
        listed = _listed(file, wanted)
        if listed is not None:
            return listed
    places, heights = {}, {}
    for name in sorted(names)[:_MOST]:
        for below in ("", "images", "../images", ".."):
            file = folder / below / name
            if ".." not in Path(name).parts and _is_there(file):
                tag = _tag(file)
                if tag is not None:
                    places[name], heights[name] = (tag[0], tag[1]), tag[2]
                break
    return ImagePlaces(places, heights, "GPS tags of the images") if len(places) >= 3 else None


def _is_there(file: Path) -> bool:
    try:
        return file.is_file()
    except (OSError, ValueError):  # a name too long, or with a NUL
        return False


def _listed(file: Path, wanted: dict[str, str]) -> ImagePlaces | None:
    """Read lines of ``name latitude longitude height``, as for COLMAP's model_aligner."""
    if file.stat().st_size > 1 << 24:
        return None
    places, heights = {}, {}
    for line in file.read_bytes().decode("utf-8", "replace").splitlines():
        match = _ROW.match(line.strip())
        name = wanted.get(match[1].lower()) if match else None
        if match and name:
            latitude, longitude, height = (float(match[k]) for k in (2, 3, 4))
            if abs(latitude) > 90 or abs(longitude) > 180:
                return None
            places[name], heights[name] = (longitude, latitude), height
    return ImagePlaces(places, heights, file.name) if len(places) >= 3 else None


def _tag(file: Path) -> tuple[float, float, float] | None:
    """Return longitude, latitude and height of an image's GPS tag."""
    try:
        with Image.open(file) as image:
            gps = image.getexif().get_ifd(_GPS)
        latitude = _degrees(gps[2]) * (-1 if str(gps.get(1, "N")).upper().startswith("S") else 1)
        longitude = _degrees(gps[4]) * (-1 if str(gps.get(3, "E")).upper().startswith("W") else 1)
        below = gps.get(5, 0) in (1, b"\x01")
        height = float(gps.get(6, 0.0)) * (-1 if below else 1)
    except (OSError, KeyError, TypeError, ValueError, ZeroDivisionError, IndexError, SyntaxError):
        return None
    sound = all(math.isfinite(v) for v in (latitude, longitude, height))
    return (longitude, latitude, height) if sound and abs(latitude) <= 90 else None


def _degrees(value: tuple[float, float, float]) -> float:
    degrees, minutes, seconds = (float(part) for part in value)
    return degrees + minutes / 60 + seconds / 3600


def fitted_places(
    centres: dict[str, NDArray[np.float64]], places: ImagePlaces
) -> tuple[NDArray[np.float64], Geotag, dict[str, object]] | None:
    """Return the transform of a reconstruction to east, north, up metres about the images' centre.

    A similarity by least squares (Umeyama 1991), repeated without outliers.

    Args:
        centres: positions of the images in the reconstruction.
        places: positions where they were taken.

    Returns:
        matrix (4, 4), location of its origin, and statistics; ``None`` if the images are collinear,
        so that the rotation about their line is undetermined.
    """
    names = sorted(set(centres) & set(places.lonlat))
    if len(names) < 3:
        return None
    lonlat = np.array([places.lonlat[name] for name in names])
    height = np.array([places.height[name] for name in names])
    longitude, latitude = np.median(lonlat, axis=0)
    frame = SiteFrame(round(float(latitude), 9), round(float(longitude), 9))
    base = round(float(np.median(height)), 3)
    target = np.column_stack([frame.site_from_lonlat(lonlat), height - base])
    source = np.array([centres[name] for name in names])
    used = np.ones(len(names), np.bool_)
    for _ in range(3):
        if used.sum() < 3 or _spread(target[used]) < _LEAST_SPREAD_M:
            return None
        matrix = _similarity(source[used], target[used])
        off = np.linalg.norm(source @ matrix[:3, :3].T + matrix[:3, 3] - target, axis=1)
        now = off <= max(_OUTLIER * float(np.median(off)), 1e-6)
        if (now == used).all():
            break
        used = now
    tag = Geotag(frame.latitude, frame.longitude, base)
    notes: dict[str, object] = {
        "placed_by": places.source,
        "images": len(names),
        "images_used": int(used.sum()),
        "residual_rms_m": round(float(np.sqrt((off[used] ** 2).mean())), 3),
        "scale": float(f"{np.cbrt(np.linalg.det(matrix[:3, :3])):.9g}"),
    }
    return matrix, tag, notes


def _spread(points: NDArray[np.float64]) -> float:
    """Return the standard deviation of points across their best-fitting line, metres."""
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(singular[1] / math.sqrt(len(points)))


def _similarity(source: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, singular, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ sign @ vt
    scale = float((singular * np.diag(sign)).sum() / (a**2).sum())
    matrix = np.eye(4)
    matrix[:3, :3] = scale * rotation
    matrix[:3, 3] = target.mean(axis=0) - scale * rotation @ source.mean(axis=0)
    return matrix
