"""Readable content of files of many formats: texts, metadata and dates as nested values.

Readers return mappings, lists, texts and numbers; `Text` is a whole text file, `Marked` a text
whose kind is known from the format. Files that their reader rejects are searched for printable
characters.
"""

from __future__ import annotations

import re
import struct
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact.arrays import may_unpack
from urbantwin.extras import check_extra
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["Marked", "Text", "content_of_file"]

#: Number of bytes searched at the beginning and at the end of larger files.
_MOST_BYTES = 64_000_000
#: Runs of printable characters that rarely occur by chance in binary data.
_RUN = re.compile(rb"[\x20-\x7e]{8,}")
_CDR_TEXT = re.compile(rb"[\x20-\x7e]{8,}(?=\0)")
#: Coordinates are smaller; characters read as float32 are larger, 10^20 or more for lower-case
#: letters.
_LARGEST = 1e9
#: Message types that consist mostly of numbers.
_OF_POINTS = re.compile(r"PointCloud|CustomMsg|Scan|Packet|Image|LaserScan|UdpFrame")
#: Largest number of objects of a map that are searched, and depth of files inside files.
_MOST_OBJECTS, _DEEPEST = 200_000, 3
#: Times below this are relative to the start of a drive or a turn, seconds: as GPS times they would
#: be in the first hour of a week.
_FROM_A_START_S = 3600.0
#: Words of the LAS standard for a system identifier; others are names of devices.
_SYSTEMS = ("", "OTHER", "EXTRACTION", "MODIFICATION", "MERGE", "TRANSFORMATION")


@dataclass(frozen=True)
class Text:
    """Content of a text file."""

    text: str


@dataclass(frozen=True)
class Marked:
    """A text whose kind is known from the format."""

    what: str
    text: str


def content_of_file(path: Path) -> object:
    """Return the readable content of a file by its format; for unknown formats, its characters."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        data = stream.read(_MOST_BYTES)
        if size > 2 * _MOST_BYTES:
            stream.seek(-_MOST_BYTES, 2)
        data += stream.read(_MOST_BYTES)
    return _content(path.name, data, 0)


def _content(name: str, data: bytes, depth: int) -> object:
    ending = name.lower().rpartition(".")[2]
    if ending == "label" or depth > _DEEPEST:  # numbers of classes and tracks
        return None
    begins = (one for first, one in _FIRST_BYTES.items() if data.startswith(first))
    reader = _READERS.get(ending) or _READERS.get(next(begins, ""))
    if reader is None:
        return _letters(data)
    if reader is _mcap:
        check_extra("bags", "searching MCAP", file=name)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return reader(data, depth)
    except Exception:  # a damaged or hostile file
        return _letters(data)


def _letters(data: bytes, _: int = 0) -> object:
    """Return a text as it is; for binary data, runs of printable characters by position."""
    if b"\0" not in data[:4096]:
        with suppress(UnicodeDecodeError):
            return Text(data.decode())
    return {f"byte {found.start()}": found[0].decode() for found in _RUN.finditer(data)}


def _json(data: bytes, _: int) -> object:
    return parse_json(data)


def _json_lines(data: bytes, _: int) -> object:
    return {f"line {k}": parse_json(line) for k, line in enumerate(data.splitlines(), 1)}


def _glb(data: bytes, _: int) -> object:
    return parse_json(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def _document_or_text(text: bytes | str) -> object:
    """Return a text, or the document that it is."""
    plain = text.decode(errors="replace") if isinstance(text, bytes) else text
    if plain[:1] in ("{", "["):
        with suppress(NotJsonError):
            return parse_json(plain)
    return plain


def _parquet(data: bytes, _: int) -> object:
    import pyarrow.parquet as pq

    file = pq.ParquetFile(BytesIO(data))
    groups = [_table(file.read_row_group(k)) for k in range(file.num_row_groups)]
    return {"metadata": _metadata(file.metadata.metadata), "groups": groups}


def _feather(data: bytes, _: int) -> object:
    from pyarrow import feather

    table = feather.read_table(BytesIO(data))
    return {"metadata": _metadata(table.schema.metadata), "columns": _table(table)}


def _metadata(told: dict[bytes, bytes] | None) -> dict[str, str]:
    pairs = ((k.decode(errors="replace"), v) for k, v in (told or {}).items())
    return {k: v.decode(errors="replace") for k, v in pairs if k != "ARROW:schema"}


def _table(table: Any) -> dict[str, object]:  # noqa: ANN401 - pyarrow has no types
    """Return the texts of each column, or its minimum and maximum."""
    import pyarrow as pa
    import pyarrow.compute as pc

    found: dict[str, object] = {}
    for name in table.column_names:
        column, kind = table[name], table[name].type
        values = pc.unique(column)
        if pa.types.is_dictionary(kind):
            values, kind = values.dictionary, kind.value_type
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            found[name] = values.to_pylist()
        elif pa.types.is_timestamp(kind) and len(column) > column.null_count:
            found[name] = Marked("time stamp", str(pc.min(column).as_py()))
        elif pa.types.is_floating(kind) or pa.types.is_integer(kind):
            found[name] = list(pc.min_max(column).as_py().values())
        else:
            found[name] = None
    return found


def _npy(data: bytes, _: int) -> object:
    array = np.load(BytesIO(data), allow_pickle=False)
    return {name: _values(array[name]) for name in array.dtype.names or ()} or _values(array)


def _values(values: Any) -> object:  # noqa: ANN401
    if values.dtype.kind == "M" and values.size:
        return Marked("time stamp", str(values.ravel()[0]))
    if values.dtype.kind == "U":
        codes = np.ascontiguousarray(values.astype(values.dtype.newbyteorder("="))).reshape(-1)
        if codes.nbytes and codes.view(np.uint32).max() > sys.maxunicode:
            raise ValueError("letters that there are not")
    if values.dtype.kind in "US":
        return [_document_or_text(text) for text in np.unique(values).tolist()]
    return float(np.nanmax(values)) if values.size and values.dtype.kind in "iuf" else None


def _zip(data: bytes, depth: int) -> object:
    import zipfile

    found: dict[str, object] = {}
    with zipfile.ZipFile(BytesIO(data)) as packed:
        if not may_unpack(sum(one.file_size for one in packed.infolist()), len(data)):
            raise ValueError("unpacks to far more than its size")
        found["comment"] = packed.comment.decode(errors="replace")
        for one in packed.infolist():
            date = "{}-{:02}-{:02} {:02}:{:02}:{:02}".format(*one.date_time)
            told = [Marked("time stamp", date)] if one.date_time > (1980, 1, 1, 0, 0, 0) else []
            small = one.file_size <= _MOST_BYTES and not one.is_dir()
            inner = _content(one.filename, packed.read(one), depth + 1) if small else None
            found[f"member {one.filename}"] = [*told, inner]
    return found


def _tar(data: bytes, depth: int) -> object:
    import tarfile

    found: dict[str, object] = {}
    with tarfile.open(fileobj=BytesIO(data)) as packed:
        for one in packed:
            owners = {one.uname, one.gname} - {"", "root", "nobody", "users"}
            stream = packed.extractfile(one) if one.size <= _MOST_BYTES else None
            found[f"member {one.name}"] = [
                {"user": sorted(owners), "mtime": float(one.mtime), **one.pax_headers},
                stream and _content(one.name, stream.read(), depth + 1),
            ]
    return found


def _gzip(data: bytes, depth: int) -> object:
    import zlib

    name, flags = "", data[3]
    if flags & 8:  # FNAME; RFC 1952, 2.3
        begin = 10 + (2 + int.from_bytes(data[10:12], "little") if flags & 4 else 0)
        name = data[begin : data.index(b"\0", begin)].decode("latin-1")
    inner = zlib.decompressobj(31).decompress(data, _MOST_BYTES)
    header = {"mtime": float(int.from_bytes(data[4:8], "little")), "file": name}
    return {"header": header, "content": _content("", inner, depth + 1)}


def _bzip(data: bytes, depth: int) -> object:
    import bz2

    return _content("", bz2.BZ2Decompressor().decompress(data, _MOST_BYTES), depth + 1)


def _picture(data: bytes, _: int) -> object:
    from PIL import ExifTags, Image

    with Image.open(BytesIO(data)) as image:
        found: dict[str, object] = {
            str(key): value for key, value in image.info.items() if isinstance(value, str)
        }
        exif = image.getexif()
    for tag, value in {**exif, **exif.get_ifd(ExifTags.IFD.Exif)}.items():
        text = value.decode(errors="replace") if isinstance(value, bytes) else value
        if isinstance(text, str):
            found[ExifTags.TAGS.get(tag, str(tag))] = text.strip("\0 ")
    if exif.get_ifd(ExifTags.IFD.GPSInfo):
        found["GPSInfo"] = Marked("place of a camera", "where it was taken")
    if (begin := data.find(b"<x:xmpmeta")) >= 0:
        found["XMP"] = data[begin : begin + 100_000].decode(errors="replace")
    if data.startswith(b"\x89PNG") and (at := data.find(b"tIME") + 4) > 4:
        found["tIME"] = datetime(*struct.unpack_from(">H5B", data, at), tzinfo=UTC)  # type: ignore[misc]
    return found


def _floats(data: bytes, _: int) -> object:
    """Return None for plausible rows of float32, and otherwise the printable characters."""
    if len(data) % 4 == 0:
        values = np.abs(np.frombuffer(data, "<f4"))
        if np.isfinite(values).all() and values.max(initial=0) < _LARGEST:
            return None
    return _letters(data)


def _mcap(data: bytes, depth: int) -> object:
    """Return the metadata, the moments and the texts of a recording, but no points' bytes."""
    from mcap.reader import make_reader

    reader = make_reader(BytesIO(data))
    header = reader.get_header()
    found: dict[str, Any] = {"header": f"{header.profile} {header.library}"}
    for record in reader.iter_metadata():
        pairs = record.metadata.items()
        found[f"metadata {record.name}"] = {k: _document_or_text(value) for k, value in pairs}
    for part in reader.iter_attachments():
        inner = _content(part.name, part.data, depth + 1)
        found[f"attachment {part.name}"] = [{"create_time": part.create_time}, inner]
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        times = {"log_time": message.log_time, "publish_time": message.publish_time}
        texts = found.setdefault(f"topic {channel.topic}", [{**times, **channel.metadata}])
        if channel.message_encoding == "json":
            texts.append(_document_or_text(message.data))
        elif schema is None or not _OF_POINTS.search(schema.name):
            # Texts of CDR end with a zero; letters that numbers make by chance hardly ever do.
            runs = _CDR_TEXT if channel.message_encoding == "cdr" else _RUN
            texts += [run[0].decode() for run in runs.finditer(message.data)]
    return found


def _las(data: bytes, _: int) -> object:
    import laspy

    # laspy trusts record counts, and reads four billion records without any data (LAS 1.4 R15,
    # table 3).
    extended = struct.unpack_from("<I", data, 243)[0] if data[25] >= 4 else 0
    if 54 * struct.unpack_from("<I", data, 100)[0] + 60 * extended > len(data):
        return _letters(data)
    with laspy.open(BytesIO(data)) as file:
        header = file.header
        found: dict[str, object] = {"generating software": str(header.generating_software)}
        system = str(header.system_identifier).strip("\0 ")
        if system.upper() not in _SYSTEMS and not system.lower().startswith("urbantwin"):
            found["system identifier"] = Marked("name of a device", system)
        for one in [*header.vlrs, *(file.evlrs or [])]:
            runs = [run[0].decode() for run in _RUN.finditer(one.record_data_bytes())]
            found[f"record {one.record_id}"] = [f"{one.user_id} {one.description}", *runs]
        if "gps_time" in header.point_format.dimension_names:
            for points in file.chunk_iterator(1_000_000):
                times = np.asarray(points.gps_time)
                if np.abs(times).max(initial=0) >= _FROM_A_START_S:
                    text = f"{times.min():.3f} to {times.max():.3f} of GPS"
                    found["gps_time of the points"] = Marked("time stamp", text)
                    break
    return found


def _header_lines(data: bytes, _: int) -> object:
    """Return the header of a PLY or PCD file, or the whole file if it is text."""
    end = re.search(rb"end_header\r?\n|^DATA .*\n", data, re.MULTILINE)
    if end is None or b"ascii" in data[: end.end()]:
        return _letters(data)
    return Text(data[: end.end()].decode("latin-1"))


def _pcap(data: bytes, _: int) -> object:
    little = data[:4] in (b"\xd4\xc3\xb2\xa1", b"\x4d\x3c\xb2\xa1")
    moment = float(int.from_bytes(data[24:28], "little" if little else "big"))
    return {"first packet": {"time": moment if len(data) >= 40 else None}, "": _letters(data)}


def _map_pbf(data: bytes, _: int) -> object:
    """Return the mappers of the objects of an OpenStreetMap extract, and the moments."""
    import osmium

    found: dict[str, object] = {}
    for number, one in enumerate(osmium.FileProcessor(osmium.io.FileBuffer(data, "pbf"))):
        if number >= _MOST_OBJECTS:
            break
        told: dict[str, object] = {"user": one.user}
        if not isinstance(one, osmium.osm.Changeset):
            told["changeset"] = one.changeset
            if one.timestamp.timestamp() > 0:
                told["timestamp"] = one.timestamp.isoformat(" ", "minutes")
        found[f"object {one.id}"] = told
    return found


_FIRST_BYTES = {
    b"PK\x03\x04": "zip", b"\x89PNG": "png", b"\xff\xd8\xff": "jpg", b"PAR1": "parquet",
    b"glTF": "glb", b"LASF": "las", b"\x1f\x8b": "gz", b"II*\0": "tif", b"MM\0*": "tif",
}  # fmt: skip
_READERS: dict[str, Callable[[bytes, int], object]] = {
    ending: reader
    for endings, reader in (
        ("json geojson gltf ipynb cityjson topojson", _json),
        ("jsonl ndjson", _json_lines),
        ("zip npz usdz kmz 3tz laszip", _zip),
        ("png jpg jpeg tif tiff webp", _picture),
        ("las laz", _las),
        ("ply pcd", _header_lines),
        ("pcap pcapng", _pcap),
        ("feather arrow", _feather),
        ("gz tgz", _gzip),
        ("bin", _floats),
        ("mcap", _mcap),
        ("pbf", _map_pbf),
        ("parquet", _parquet),
        ("npy", _npy),
        ("glb", _glb),
        ("tar", _tar),
        ("bz2", _bzip),
    )
    for ending in endings.split()
}
