"""Airborne LiDAR as COPC: a LAZ file whose points are an octree, of which the nodes there are read.

The format is told at https://copc.io; laspy reads it, here from range requests.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError

from urbantwin.acquire.area import Area
from urbantwin.acquire.cloud_file import MOST_POINTS, inside_box, write_cloud
from urbantwin.acquire.file_index import located_files
from urbantwin.acquire.remote_file import RemoteFile
from urbantwin.acquire.source import MARGIN_M, AcquiredInput
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import NotAcquiredError, Web
from urbantwin.download import DownloadError
from urbantwin.progress import Progress

__all__ = ["fetch_copc"]

NAME = "airborne.laz"
#: Bytes that all nodes of a place may have, packed.
_MOST_BYTES = 1 << 30


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
        raise NotAcquiredError("has nothing there")
    total = write_cloud(parts, crs, folder / NAME)
    return AcquiredInput(
        "airborne", spec, folder / NAME, read[0], min(times), told=f"{total:,} points"
    )


def _points(file: RemoteFile, area: Area, stated: str | None) -> tuple[Any, CRS]:
    """Return the points of a file around an area, and their CRS.

    Raises:
        NotAcquiredError: it is no COPC, is damaged, has no CRS, or too many points there.
        DownloadError: it cannot be had.
    """
    from laspy.copc import Bounds, CopcReader, load_octree_for_query

    try:
        # Pages of the hierarchy and nodes are of any length: the reader asks for what it was told.
        reader = CopcReader(file, close_fd=False)
        crs = CRS.from_user_input(stated) if stated else reader.header.parse_crs()
        if crs is None:
            raise NotAcquiredError("has no coordinate reference system")
        box = area.box_in(crs.to_wkt(), MARGIN_M)
        bounds = Bounds(np.array(box[:2]), np.array(box[2:])).ensure_3d(
            reader.header.mins, reader.header.maxs
        )
        nodes = load_octree_for_query(file, reader.copc_info, reader.root_page, query_bounds=bounds)
        counts = [node.point_count for node in nodes]
        sizes = [node.byte_size for node in nodes]
        if min([0, *counts, *sizes]) < 0 or sum(sizes) > min(file.size, _MOST_BYTES):
            raise NotAcquiredError("is damaged: its nodes are larger than the file")
        # Nodes reach beyond the box: about four times as many points as there are in it.
        if sum(counts) > 4 * MOST_POINTS:
            raise NotAcquiredError(f"has {sum(counts):,} points there")
        points = reader.query(bounds=bounds)
        return points[inside_box(points, box)], crs
    except (NotAcquiredError, DownloadError, MemoryError):
        raise
    except CRSError:
        raise NotAcquiredError("has a reference system that is unknown") from None
    except Exception:
        raise file.failure or NotAcquiredError("cannot be read as COPC") from None
