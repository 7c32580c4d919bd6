"""Airborne LiDAR from COPC: LAZ files with an octree, of which only the nearby nodes are read.

Format: https://copc.io. laspy reads it through range requests.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import CRSError

from urbantwin.acquire.area import Area
from urbantwin.acquire.file_index import located_files
from urbantwin.acquire.remote_file import RemoteFile
from urbantwin.acquire.source import MARGIN_M, AcquiredInput
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import NotAcquiredError, NothingThereError, Web
from urbantwin.download import DownloadError
from urbantwin.errors import InputError
from urbantwin.io.las import unpacked_chunks
from urbantwin.progress import Progress

__all__ = ["MOST_POINTS", "fetch_copc", "inside_box", "write_cloud"]

#: Most points of a site's reconstruction.
MOST_POINTS = 40_000_000
#: Resolution of coordinates: in units of length, and in degrees.
_STEP, _STEP_DEG = 0.001, 1e-8
#: Point fields that are kept, if present.
_FIELDS = (
    "intensity", "return_number", "number_of_returns", "classification", "withheld", "synthetic",
    "scan_angle", "gps_time", "point_source_id",
)  # fmt: skip
_COLOURS = ("red", "green", "blue")


def inside_box(
    points: Any,  # noqa: ANN401 - laspy's records
    box: tuple[float, float, float, float],
) -> NDArray[np.bool_]:
    """Return which points lie within west, south, east, north of their own CRS."""
    x, y = np.asarray(points.x), np.asarray(points.y)
    west, south, east, north = box
    return np.asarray((x >= west) & (x <= east) & (y >= south) & (y <= north))


def write_cloud(parts: Sequence[Any], crs: CRS, path: Path) -> int:
    """Write points as LAZ (format 6, or 7 with colours), and return their number.

    Args:
        parts: records of laspy, in one CRS.
        crs: their CRS.
        path: the file.

    Raises:
        NotAcquiredError: no points, too many, or too far apart.
    """
    import laspy

    parts = [one for one in parts if len(one)]
    total = sum(len(one) for one in parts)
    if not total:
        raise NothingThereError("has no points there")
    if total > MOST_POINTS:
        raise NotAcquiredError(f"has {total:,} points there, more than {MOST_POINTS:,}")
    names = [set(one.point_format.dimension_names) for one in parts]
    has_colours = all({*_COLOURS} <= one for one in names)
    header = laspy.LasHeader(point_format=7 if has_colours else 6, version="1.4")
    # The creation date would change the bytes from day to day.
    header.creation_date = None
    header.generating_software = "urbantwin"
    step = _STEP_DEG if crs.is_geographic else _STEP
    x, y, z = (np.concatenate([np.asarray(getattr(one, axis)) for one in parts]) for axis in "xyz")
    header.offsets = np.floor([x.min(), y.min(), z.min()])
    header.scales = np.array([step, step, _STEP])
    header.add_crs(crs)
    cloud = laspy.LasData(header)
    try:
        cloud.x, cloud.y, cloud.z = x, y, z
    except OverflowError:  # LAS stores 32-bit steps from the offset
        raise NotAcquiredError("has points too far apart to be of one place") from None
    for name in (*_FIELDS, *(_COLOURS if has_colours else ())):
        values = [_field(one, name, has) for one, has in zip(parts, names, strict=True)]
        cloud[name] = np.concatenate(values)
    packed = io.BytesIO()
    cloud.write(packed, do_compress=True, laz_backend=laspy.LazBackend.Lazrs)
    path.write_bytes(packed.getvalue())
    return total


def _field(part: Any, name: str, names: set[str]) -> NDArray[Any]:  # noqa: ANN401
    """Return a field of a record; zeros if its format lacks it."""
    if name in names:
        return np.asarray(part[name])
    if name == "scan_angle" and "scan_angle_rank" in names:
        # Formats 0 to 5 have whole degrees, 6 to 10 steps of 0.006 degrees (LAS 1.4 R15).
        return np.asarray(np.asarray(part["scan_angle_rank"], np.float64) / 0.006).astype(np.int16)
    return np.zeros(len(part), np.float64 if name == "gps_time" else np.uint8)


NAME = "airborne.laz"
#: Most bytes of all nodes of a place, compressed.
_MOST_BYTES = 1 << 30
#: Bytes of an LAS 1.4 header; most bytes before the points; most records; most bytes of a point;
#: most hierarchy pages.
_HEADER, _MOST_BEFORE, _MOST_RECORDS, _LONGEST, _MOST_PAGES = 375, 1 << 24, 1000, 400, 10_000
_DEEPEST = 30
#: Most points per compressed byte that are plausible.
_DENSEST = 1000


def fetch_copc(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Write the points of COPC files around an area."""
    server = web.server(spec)
    addresses = located_files(server, spec, area)
    parts, times, read = [], [], []
    crs: CRS | None = None
    for number, address in enumerate(addresses):
        progress(number / len(addresses), f"{spec.name}: {address.rpartition('/')[2]:.60}")
        file = RemoteFile(server, address)
        points, own = _points(file, area, spec.crs)
        if crs is not None and own != crs:
            raise NotAcquiredError("has files of several reference systems there")
        crs = own
        if len(points):
            parts.append(points)
            times.append(file.at)
            read.append(server.shown(address))
    if crs is None:
        raise NothingThereError()
    total = write_cloud(parts, crs, folder / NAME)
    return AcquiredInput(
        "airborne",
        spec,
        folder / NAME,
        read[0],
        min(times),
        told=f"{total:,} points",
        crs=crs.to_wkt(),
    )


def _points(file: RemoteFile, area: Area, stated: str | None) -> tuple[Any, CRS]:
    """Return the points of a file around an area, and their CRS.

    Raises:
        NotAcquiredError: not COPC, damaged, without CRS, or too many points.
        DownloadError: the download failed.
    """
    from laspy.copc import Bounds, CopcReader, load_octree_for_query

    _check_header(file)
    try:
        file.seek(0)
        reader = CopcReader(file, close_fd=False)
        info = reader.copc_info
        if info.hierarchy_root_offset + info.hierarchy_root_size > file.size:
            raise NotAcquiredError("ends early")
        crs = CRS.from_user_input(stated) if stated else reader.header.parse_crs()
        if crs is None:
            raise NotAcquiredError("has no coordinate reference system")
        box = area.box_in(crs.to_wkt(), MARGIN_M)
        bounds = Bounds(np.array(box[:2]), np.array(box[2:])).ensure_3d(
            reader.header.mins, reader.header.maxs
        )
        _read_pages(file, reader, bounds)
        nodes = load_octree_for_query(file, reader.copc_info, reader.root_page, query_bounds=bounds)
        counts = np.array([node.point_count for node in nodes], np.int64)
        sizes = np.array([node.byte_size for node in nodes], np.int64)
        if (counts < 0).any() or (sizes < 0).any() or (counts > _DENSEST * sizes).any():
            raise NotAcquiredError("is damaged: its nodes are none")
        if sizes.sum() > min(file.size, _MOST_BYTES):
            raise NotAcquiredError("is damaged: its nodes are larger than the file")
        if counts.sum() * max(reader.header.point_format.size, 100) > MOST_POINTS * 100:
            raise NotAcquiredError(f"has {counts.sum():,} points there")
        points = _unpacked(file, reader, nodes)
        return points[inside_box(points, box)], crs
    except (NotAcquiredError, DownloadError, MemoryError, KeyboardInterrupt, SystemExit):
        raise
    except CRSError:
        raise NotAcquiredError("has a reference system that is unknown") from None
    except BaseException:  # panics of laspy's decompressor are no Exception
        raise file.failure or NotAcquiredError("cannot be read as COPC") from None


def _unpacked(file: RemoteFile, reader: Any, nodes: list[Any]) -> Any:  # noqa: ANN401 - laspy's
    """Return the points of nodes; each node is a LAZ chunk.

    Raises:
        NotAcquiredError: a chunk is damaged.
    """
    from laspy import PackedPointRecord, ScaleAwarePointRecord

    header, how = reader.header, bytes(reader.laszip_vlr.record_data)
    packed, table = bytearray(), []
    for node in sorted(nodes, key=lambda one: int(one.offset)):
        if not node.point_count:
            continue
        file.seek(node.offset)
        chunk = file.read(node.byte_size)
        if len(chunk) != node.byte_size:
            raise NotAcquiredError("ends early")
        packed += chunk
        table.append((node.point_count, node.byte_size))
    total = sum(count for count, _ in table)
    size = total * header.point_format.size
    unpacked = np.zeros(0, np.uint8)
    if table:
        try:
            unpacked = unpacked_chunks(bytes(packed), how, table, size, file=NAME)
        except InputError as error:
            raise NotAcquiredError(f"is damaged: its points {error.problem}") from None
    record = PackedPointRecord.from_buffer(unpacked, header.point_format)
    return ScaleAwarePointRecord(record.array, record.point_format, header.scales, header.offsets)


def _check_header(file: RemoteFile) -> None:
    """Check the header, since readers allocate memory by its values.

    Raises:
        NotAcquiredError: not a COPC file (LAS 1.4 R15, table 3; COPC 1.0).
    """
    file.seek(0)
    head = file.read(_HEADER + 54)
    if len(head) < _HEADER + 54 or not head.startswith(b"LASF") or head[377:381] != b"copc":
        raise NotAcquiredError("is no COPC")
    size, first_point, records = struct.unpack_from("<HII", head, 94)
    kind, record = struct.unpack_from("<BH", head, 104)
    if (
        size != _HEADER
        or not _HEADER < first_point < min(file.size, _MOST_BEFORE)
        or records > _MOST_RECORDS
        or kind & 0x3F not in (6, 7, 8)
        or record > _LONGEST
    ):
        raise NotAcquiredError("is no COPC: its header is damaged")


def _read_pages(file: RemoteFile, reader: Any, bounds: Any) -> None:  # noqa: ANN401 - laspy's
    """Read the hierarchy pages of a place, and the pages they refer to.

    Raises:
        NotAcquiredError: page references are circular or outside of the file.
    """
    from laspy.copc import Bounds, HierarchyPage

    info, entries = reader.copc_info, reader.root_page.entries
    cube = Bounds(info.center - info.halfsize, info.center + info.halfsize)
    seen: set[int] = set()
    while True:
        waiting = [
            (key, entry)
            for key, entry in entries.items()
            if entry.point_count == -1
            and 0 <= key.level <= _DEEPEST
            and key.bounds(cube).overlaps(bounds)
        ]
        if not waiting:
            return
        for key, entry in waiting:
            if entries[key].point_count != -1:  # already read with an earlier page
                continue
            there = entry.byte_size > 0 and entry.offset + entry.byte_size <= file.size
            if entry.offset in seen or not there or len(seen) > _MOST_PAGES:
                raise NotAcquiredError("has a hierarchy that leads in circles")
            seen.add(entry.offset)
            file.seek(entry.offset)
            entries.update(HierarchyPage.from_bytes(file.read(entry.byte_size)).entries)
