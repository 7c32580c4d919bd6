"""Airborne LiDAR from Entwine Point Tiles (EPT): octrees of LAZ files, read around a place.

Format: https://entwine.io/en/latest/entwine-point-tile.html.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError

from urbantwin.acquire.area import Area
from urbantwin.acquire.copc import MOST_POINTS, NAME, inside_box, write_cloud
from urbantwin.acquire.file_index import located_files
from urbantwin.acquire.source import MARGIN_M, AcquiredInput
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import NotAcquiredError, NothingThereError, Server, Web
from urbantwin.errors import InputError
from urbantwin.io.las import check_las
from urbantwin.progress import Progress
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["fetch_ept"]

Key = tuple[int, int, int, int]
#: Most point files of a place, and largest depth of an octree.
_MOST_TILES, _DEEPEST = 4000, 24


def fetch_ept(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Write the points of a source's first octree that has points around an area."""
    server = web.server(spec)
    problem: NotAcquiredError | None = None
    for root in located_files(server, spec, area)[:3]:
        try:
            return _octree(spec, server, root, area, folder, progress)
        except NotAcquiredError as error:
            problem = problem or error
    raise problem or NothingThereError()


def _octree(
    spec: SourceSpec, server: Server, root: str, area: Area, folder: Path, progress: Progress
) -> AcquiredInput:
    """Write the points of one octree around an area."""
    told = server.get(root)
    about = _object(told.data, "ept.json")
    if about.get("dataType") != "laszip":
        raise NotAcquiredError(f"keeps its points as {about.get('dataType')!s:.20}, not as LAZ")
    crs = _crs(about.get("srs"), spec.crs)
    try:
        box = area.box_in(crs.to_wkt(), MARGIN_M)
        cube = [float(one) for one in about["bounds"]]
        if len(cube) != 6 or not np.isfinite(cube).all():
            raise ValueError
        low, side = np.array(cube[:3]), cube[3] - cube[0]
        if side <= 0:
            raise ValueError
    except (KeyError, TypeError, ValueError):
        raise NotAcquiredError("has bounds that are none, or is elsewhere") from None
    folder_url = root.rpartition("/")[0]
    keys, times = _nodes(server, folder_url, box, low, side)
    parts = []
    for number, key in enumerate(keys):
        progress(number / len(keys), f"{spec.name}: tile {number + 1} of {len(keys)}")
        name = "-".join(map(str, key))
        tile = server.get(f"{folder_url}/ept-data/{name}.laz")
        times.append(tile.at)
        points = _points(tile.data, folder / ".tile.laz")
        parts.append(points[inside_box(points, box)])
    total = write_cloud(parts, crs, folder / NAME)
    return AcquiredInput(
        "airborne", spec, folder / NAME, server.shown(root), min([told.at, *times]),
        told=f"{total:,} points", crs=crs.to_wkt(),
    )  # fmt: skip


def _nodes(
    server: Server,
    folder_url: str,
    box: tuple[float, float, float, float],
    low: np.ndarray,
    side: float,
) -> tuple[list[Key], list[str]]:
    """Return the nodes whose cubes intersect a box, and the response times of their lists."""
    found: list[Key] = []
    times: list[str] = []
    total = 0
    pages: dict[Key, int] = {}
    waiting: list[Key] = [(0, 0, 0, 0)]
    while waiting:
        key = waiting.pop()
        depth, x, y, _ = key
        edge = side / 2**depth
        west, south = low[0] + x * edge, low[1] + y * edge
        if west > box[2] or south > box[3] or west + edge < box[0] or south + edge < box[1]:
            continue
        if key not in pages or pages[key] == -1:
            if key not in pages and depth:
                continue
            name = "-".join(map(str, key))
            page = server.get(f"{folder_url}/ept-hierarchy/{name}.json")
            times.append(page.at)
            own = _page(page.data)
            if own.get(key, -1) == -1:
                raise NotAcquiredError("has a hierarchy that leads in circles")
            pages |= own
        if pages[key] <= 0 or depth > _DEEPEST:
            continue
        found.append(key)
        total += pages[key]
        if total > 4 * MOST_POINTS or len(found) > _MOST_TILES:
            raise NotAcquiredError(f"has more than {MOST_POINTS:,} points there")
        _, x, y, z = key
        waiting += [
            (depth + 1, 2 * x + (k & 1), 2 * y + (k >> 1 & 1), 2 * z + (k >> 2)) for k in range(8)
        ]
    return sorted(found), times


def _page(data: bytes) -> dict[Key, int]:
    pages: dict[Key, int] = {}
    for name, count in _object(data, "its hierarchy").items():
        told = re.fullmatch(r"([0-9]{1,2})-([0-9]{1,9})-([0-9]{1,9})-([0-9]{1,9})", name)
        if told is None or isinstance(count, bool) or not isinstance(count, int):
            raise NotAcquiredError("has a hierarchy that is none")
        pages[int(told[1]), int(told[2]), int(told[3]), int(told[4])] = count
    return pages


def _object(data: bytes, named: str) -> Mapping[str, Any]:
    try:
        value = parse_json(data)
    except NotJsonError:
        raise NotAcquiredError(f"{named} is not JSON") from None
    if not isinstance(value, dict):
        raise NotAcquiredError(f"{named} is no object of JSON")
    return value


def _crs(srs: object, stated: str | None) -> CRS:
    """Return the CRS of an octree, with the vertical CRS if both are stated."""
    try:
        if stated is not None:
            return CRS.from_user_input(stated)
        if isinstance(srs, Mapping):
            authority, plan = srs.get("authority"), srs.get("horizontal")
            if authority and plan and srs.get("vertical"):
                return CRS.from_user_input(f"{authority}:{plan}+{srs['vertical']}")
            if srs.get("wkt"):
                return CRS.from_wkt(str(srs["wkt"]))
            if authority and plan:
                return CRS.from_user_input(f"{authority}:{plan}")
    except CRSError:
        pass
    raise NotAcquiredError("has no reference system that is known")


def _points(data: bytes, scratch: Path) -> Any:  # noqa: ANN401 - laspy's records
    """Return the points of a LAZ file, through a scratch file."""
    import laspy

    try:
        scratch.write_bytes(data)
        check_las(scratch)  # in a child process, which a damaged file may crash
        return laspy.read(scratch).points
    except InputError as error:
        raise NotAcquiredError(f"has a tile that {error.problem}") from None
    except (NotAcquiredError, MemoryError, KeyboardInterrupt, SystemExit):
        raise
    except BaseException:  # panics of laspy's decompressor are no Exception
        raise NotAcquiredError("has a tile that cannot be read as LAZ") from None
    finally:
        scratch.unlink(missing_ok=True)
