"""Building footprints from GeoParquet, reading only the row groups around a place.

Overture's schema: https://docs.overturemaps.org/schema/reference/buildings/building. Its catalogue,
https://stac.overturemaps.org, names the newest release and the box of every file. Relevant row
groups are found by the statistics of the column ``bbox`` (GeoParquet 1.1, "bbox").
"""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import shapely
import shapely.geometry

from urbantwin.acquire.area import Area
from urbantwin.acquire.file_index import MOST_FILES, addresses_of
from urbantwin.acquire.remote_file import RemoteFile
from urbantwin.acquire.source import MARGIN_M, AcquiredInput
from urbantwin.acquire.source_table import SourceSpec
from urbantwin.acquire.web import NotAcquiredError, NothingThereError, Server, Web
from urbantwin.download import DownloadError
from urbantwin.errors import InputError
from urbantwin.progress import Progress
from urbantwin.site.building_file import read_buildings
from urbantwin.site.extract_file import LonLatBox
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["fetch_footprints"]

NAME = "buildings.geojson"
#: Columns of Overture's buildings, and the equivalent tags of OpenStreetMap.
_TAGS = {
    "class": "building",
    "height": "height",
    "min_height": "min_height",
    "num_floors": "building:levels",
    "min_floor": "building:min_level",
    "roof_shape": "roof:shape",
    "roof_height": "roof:height",
    "roof_direction": "roof:direction",
    "roof_orientation": "roof:orientation",
    "roof_material": "roof:material",
    "roof_color": "roof:colour",
    "facade_material": "building:material",
    "facade_color": "building:colour",
}
_EDGES = ("xmin", "ymin", "xmax", "ymax")
#: Limits of the row groups of a place: compressed bytes, and rows.
_MOST_BYTES, _MOST_ROWS = 1 << 29, 2_000_000


def fetch_footprints(
    spec: SourceSpec, area: Area, web: Web, folder: Path, progress: Progress
) -> AcquiredInput:
    """Write the buildings around an area as GeoJSON, with tags of OpenStreetMap."""
    server = web.server(spec)
    box = area.box(MARGIN_M)
    progress(0.0, f"{spec.name}: its catalogue")
    addresses = _files(server, spec, box)
    features: list[dict[str, Any]] = []
    times, read = [], []
    for number, address in enumerate(addresses):
        progress(number / len(addresses), f"{spec.name}: {address.rpartition('/')[2]:.60}")
        file = RemoteFile(server, address)
        found = _buildings(file, box)
        if found:
            features += found
            times.append(file.at)
            read.append(server.shown(address))
    if not features:
        raise NothingThereError("has no buildings there")
    features.sort(key=lambda one: (str(one["id"]), json.dumps(one["geometry"])))
    path = folder / NAME
    document = {"type": "FeatureCollection", "features": features}
    path.write_text(json.dumps(document, ensure_ascii=False, allow_nan=False), encoding="utf-8")
    try:
        read_buildings(path)
    except InputError as error:
        raise NotAcquiredError(f"{error.place}: {error.problem}") from None
    known = sum("height" in one["properties"] for one in features)
    return AcquiredInput(
        "buildings", spec, path, read[0], min(times),
        told=f"{len(features)} buildings, {known} with heights",
    )  # fmt: skip


def _files(server: Server, spec: SourceSpec, box: LonLatBox) -> list[str]:
    """Return the addresses of files that may have buildings in a box."""
    if spec.index is None:
        return [spec.address]
    told = server.get(spec.index.url)
    try:
        catalogue = parse_json(told.data)
    except NotJsonError:
        raise NotAcquiredError("its catalogue is not JSON") from None
    latest = catalogue.get("latest") if isinstance(catalogue, dict) else None
    if not isinstance(latest, str) or not re.fullmatch(r"[A-Za-z0-9.-]{1,60}", latest):
        raise NotAcquiredError("its catalogue does not name the latest release")
    listed = server.get(f"{spec.index.url.rpartition('/')[0]}/{latest}/collections.parquet")
    pattern = re.compile(spec.index.address)
    found = []
    for row in _rows(io.BytesIO(listed.data), ["collection", "type", "assets"], box, None):
        if row.get("collection") == "building" and row.get("type") == "Feature":
            addresses = [
                re.sub(
                    r"^s3://([a-z0-9.-]+?)-((?:us|eu|ap|sa|ca)-[a-z]+-[0-9])/",
                    r"https://\1-\2.s3.\2.amazonaws.com/",
                    one,
                )
                for one in addresses_of(row.get("assets"), re.compile(r"(https?|s3)://.*\.parquet"))
            ]
            found += [one for one in addresses if pattern.fullmatch(one)][:1]
    if len(found) > MOST_FILES:
        raise NotAcquiredError(f"has {len(found)} files there")
    if not found:
        raise NothingThereError()
    return sorted(set(found))


def _buildings(file: RemoteFile, box: LonLatBox) -> list[dict[str, Any]]:
    """Return the buildings of a file in a box, as GeoJSON features."""
    features: list[dict[str, Any]] = []
    place = shapely.box(*box)
    for row in _rows(file, ["id", "geometry", "is_underground", *_TAGS], box, file):
        data = row.get("geometry")
        if row.get("is_underground") or not isinstance(data, bytes):
            continue
        try:
            shape = shapely.force_2d(shapely.from_wkb(data))
        except shapely.errors.GEOSException:
            continue
        if shape.geom_type not in ("Polygon", "MultiPolygon") or not shape.intersects(place):
            continue
        tags = {
            tag: value
            for name, tag in _TAGS.items()
            if (value := _value(row.get(name))) is not None
        }
        features.append(
            {
                "type": "Feature",
                "id": str(row.get("id") or len(features)),
                "properties": {"building": "yes"} | tags,
                "geometry": shapely.geometry.mapping(shape),
            }
        )
    return features


def _rows(
    file: Any,  # noqa: ANN401 - anything that is open for reading
    columns: Sequence[str],
    box: LonLatBox,
    remote: RemoteFile | None,
) -> list[dict[str, Any]]:
    """Return the rows of a GeoParquet file whose ``bbox`` intersects a box.

    Raises:
        NotAcquiredError: not GeoParquet, or too much data there.
        DownloadError: the download failed.
    """
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(file, pre_buffer=True) as table:
            names = set(table.schema_arrow.names)
            if "bbox" not in names:
                raise NotAcquiredError("is no GeoParquet with a column bbox")
            groups = _groups(table.metadata, box)
            rows = sum(table.metadata.row_group(k).num_rows for k in groups)
            size = sum(table.metadata.row_group(k).total_byte_size for k in groups)
            if rows > _MOST_ROWS or size > _MOST_BYTES:
                raise NotAcquiredError(f"has {rows:,} rows there, {size >> 20} MiB")
            wanted = [one for one in columns if one in names]
            found = table.read_row_groups(groups, columns=[*wanted, "bbox"])
        edges = {name: pc.struct_field(found["bbox"], name) for name in _EDGES}
        west, south, east, north = box
        near = pc.and_(
            pc.and_(pc.less_equal(edges["xmin"], east), pc.greater_equal(edges["xmax"], west)),
            pc.and_(pc.less_equal(edges["ymin"], north), pc.greater_equal(edges["ymax"], south)),
        )
        return list(found.filter(near).select(wanted).to_pylist())
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        if remote is not None and remote.failure is not None:
            raise remote.failure from None
        if isinstance(error, DownloadError):
            raise
        raise NotAcquiredError("cannot be read as GeoParquet") from None


def _groups(metadata: Any, box: LonLatBox) -> list[int]:  # noqa: ANN401 - pyarrow has no types
    """Return the row groups whose ``bbox`` statistics intersect a box, or that have none."""
    west, south, east, north = box
    places = {metadata.schema.column(k).path: k for k in range(metadata.num_columns)}
    found = []
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        told = {}
        for name in _EDGES:
            column = places.get(f"bbox.{name}")
            statistics = None if column is None else group.column(column).statistics
            if statistics is not None and statistics.has_min_max:
                told[name] = statistics
        apart = len(told) == len(_EDGES) and (
            told["xmin"].min > east
            or told["xmax"].max < west
            or told["ymin"].min > north
            or told["ymax"].max < south
        )
        if not apart:
            found.append(number)
    return found


def _value(value: object) -> str | float | None:
    """Return a value in GeoJSON form, or ``None`` if missing."""
    if isinstance(value, str):
        return value or None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return value
