"""What files of many formats say in words, field by field: texts, metadata, dates."""

from __future__ import annotations

import re
import struct
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from urbantwin.artefact.arrays import may_unpack
from urbantwin.extras import check_extra
from urbantwin.strict_json import NotJsonError, parse_json

__all__ = ["Told", "told_in"]

#: Of a larger file, only so many bytes are searched at its beginning and at its end.
_MOST_BYTES = 64_000_000
#: Letters that follow each other in bytes by chance less often than anybody minds.
_RUN = re.compile(rb"[\x20-\x7e]{8,}")
_CDR_TEXT = re.compile(rb"[\x20-\x7e]{8,}(?=\0)")
#: Coordinates are less; letters that are read as float32 are more: a small one is 10^20 or more.
_LARGEST = 1e9
#: Types of messages whose bytes are mostly numbers.
_OF_POINTS = re.compile(r"PointCloud|CustomMsg|Scan|Packet|Image|LaserScan|UdpFrame")
#: Objects of a map that are looked at.
_MOST_OBJECTS = 200_000
#: Files inside files are opened so deep.
_DEEPEST = 3


@dataclass(frozen=True)
class Told:
    """Something that a file says.

    Attributes:
        place: where: a field, a tag, a member; empty for the whole file.
        value: a text or a number.
        field: the name of the field that it stands in, if it has one.
        lines: the value is a text of many lines, of which the line is worth telling.
        what: what it is, where the format itself says so: ``time stamp``.
    """

    place: str
    value: object
    field: str = ""
    lines: bool = False
    what: str = ""


def told_in(path: Path) -> Iterator[Told]:
    """Yield what a file says in words, by its format; of one that is not known, its letters."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        data = stream.read(_MOST_BYTES)
        if size > 2 * _MOST_BYTES:
            stream.seek(-_MOST_BYTES, 2)
        data += stream.read(_MOST_BYTES)
    yield from _told(path.name, data, 0)


def _told(name: str, data: bytes, depth: int) -> Iterator[Told]:
    ending = _ending(name)
    if ending in ("label",):  # numbers of classes and tracks
        return
    reader = _READERS.get(ending) or _by_first_bytes(data)
    if reader is _mcap:
        check_extra("bags", "searching MCAP", file=name)
    if reader is not None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = list(reader(data, depth))
        except Exception:  # a damaged or hostile file: its letters are searched all the same
            found = list(_letters(data))
        yield from found
    else:
        yield from _letters(data)


def _ending(name: str) -> str:
    return name.lower().rpartition(".")[2]


def _by_first_bytes(data: bytes) -> Callable[[bytes, int], Iterator[Told]] | None:
    for first, ending in (
        (b"PK\x03\x04", "zip"),
        (b"\x89PNG", "png"),
        (b"\xff\xd8\xff", "jpg"),
        (b"PAR1", "parquet"),
        (b"glTF", "glb"),
        (b"LASF", "las"),
        (b"\x1f\x8b", "gz"),
        (b"II*\0", "tif"),
        (b"MM\0*", "tif"),
    ):
        if data.startswith(first):
            return _READERS[ending]
    return None


def _letters(data: bytes) -> Iterator[Told]:
    """Yield a text as it is; of other bytes, letters that follow each other."""
    if b"\0" not in data[:4096]:
        with suppress(UnicodeDecodeError):
            yield Told("", data.decode(), lines=True)
            return
    for found in _RUN.finditer(data):
        yield Told(f"byte {found.start()}", found[0].decode())


def _json(data: bytes, _: int) -> Iterator[Told]:
    try:
        value = parse_json(data)
    except NotJsonError:
        yield from _letters(data)
        return
    yield from _walked(value, "", "")


def _json_lines(data: bytes, depth: int) -> Iterator[Told]:
    for number, line in enumerate(data.splitlines(), 1):
        for one in _json(line, depth):
            yield Told(f"line {number}: {one.place}", one.value, one.field)


def _walked(value: object, place: str, field: str) -> Iterator[Told]:
    """Yield every text and number of a document, with the name of its field."""
    waiting = [(value, place, field)]
    while waiting:
        value, place, field = waiting.pop()
        if isinstance(value, dict):
            for key, item in reversed(list(value.items())):
                waiting.append((item, f"{place}.{key}" if place else str(key), str(key)))
            yield from (Told(place, str(key)) for key in value)
        elif isinstance(value, list):
            # Of long rows of numbers, the first and the last say what they are.
            some = range(len(value))
            if len(value) > 16 and all(isinstance(one, int | float) for one in value):
                some = range(0, len(value), len(value) - 1)
            waiting.extend((value[k], f"{place}[{k}]", field) for k in reversed(some))
        elif isinstance(value, str | int | float):
            yield Told(place, value, field)


def _glb(data: bytes, depth: int) -> Iterator[Told]:
    length = int.from_bytes(data[12:16], "little")
    yield from _json(data[20 : 20 + length], depth)


def _parquet(data: bytes, _: int) -> Iterator[Told]:
    import pyarrow.parquet as pq

    file = pq.ParquetFile(BytesIO(data))
    for key, value in (file.metadata.metadata or {}).items():
        if key != b"ARROW:schema":
            yield Told(f"metadata {key.decode(errors='replace')}", value.decode(errors="replace"))
    for key, value in (file.schema_arrow.metadata or {}).items():
        yield Told(f"metadata {key.decode(errors='replace')}", value.decode(errors="replace"))
    for group in range(file.num_row_groups):
        yield from _table(file.read_row_group(group))


def _feather(data: bytes, _: int) -> Iterator[Told]:
    from pyarrow import feather

    table = feather.read_table(BytesIO(data))
    for key, value in (table.schema.metadata or {}).items():
        yield Told(f"metadata {key.decode(errors='replace')}", value.decode(errors="replace"))
    yield from _table(table)


def _table(table: object) -> Iterator[Told]:
    import pyarrow as pa
    import pyarrow.compute as pc

    assert isinstance(table, pa.Table)
    for name in table.column_names:
        column, kind = table[name], table[name].type
        place = f"column {name}"
        yield Told(place, name)
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            for value in pc.unique(column).to_pylist():
                yield Told(place, value, name)
        elif pa.types.is_dictionary(kind):
            for value in pc.unique(column).dictionary.to_pylist():
                yield Told(place, value, name)
        elif pa.types.is_timestamp(kind) and len(column) > column.null_count:
            yield Told(place, str(pc.min(column).as_py()), name, what="time stamp")
        elif (pa.types.is_floating(kind) or pa.types.is_integer(kind)) and len(column):
            for value in pc.min_max(column).as_py().values():
                yield Told(place, value, name)


def _npy(data: bytes, _: int) -> Iterator[Told]:
    import numpy as np

    array = np.load(BytesIO(data), allow_pickle=False)
    fields = {name: array[name] for name in array.dtype.names} if array.dtype.names else {"": array}
    for name, values in fields.items():
        place = f"field {name}" if name else "values"
        if values.dtype.kind == "M" and values.size:
            yield Told(place, str(values.ravel()[0]), name, what="time stamp")
        elif values.dtype.kind in "US":
            codes = np.ascontiguousarray(values.astype(values.dtype.newbyteorder("="))).reshape(-1)
            known = values.dtype.kind == "S" or not codes.nbytes
            if not known and codes.view(np.uint32).max() > sys.maxunicode:
                raise ValueError("letters that there are not")
            for value in np.unique(values).tolist():
                text = value.decode(errors="replace") if isinstance(value, bytes) else value
                yield from _document_or_text(place, text, name)
        elif values.size and name and values.dtype.kind in "iuf":
            yield Told(place, float(np.nanmax(values)), name)


def _document_or_text(place: str, text: str, name: str) -> Iterator[Told]:
    """Yield a text, field by field where it is JSON."""
    if text[:1] in "{[":
        with suppress(NotJsonError):
            yield from _walked(parse_json(text), place, name)
            return
    yield Told(place, text, name)


def _zip(data: bytes, depth: int) -> Iterator[Told]:
    import zipfile

    with zipfile.ZipFile(BytesIO(data)) as packed:
        if not may_unpack(sum(one.file_size for one in packed.infolist()), len(data)):
            raise ValueError("unpacks to far more than its size")
        if packed.comment:
            yield Told("comment", packed.comment.decode(errors="replace"))
        for one in packed.infolist():
            yield Told(f"member {one.filename}", one.filename)
            if one.date_time > (1980, 1, 1, 0, 0, 0):
                date = "{}-{:02}-{:02} {:02}:{:02}:{:02}".format(*one.date_time)
                yield Told(f"member {one.filename}", date, what="time stamp")
            if depth < _DEEPEST and one.file_size <= _MOST_BYTES and not one.is_dir():
                for inner in _told(one.filename, packed.read(one), depth + 1):
                    yield _within(f"member {one.filename}", inner)


def _tar(data: bytes, depth: int) -> Iterator[Told]:
    import tarfile

    with tarfile.open(fileobj=BytesIO(data)) as packed:
        for one in packed:
            place = f"member {one.name}"
            yield Told(place, one.name)
            for field, value in (("user", one.uname), ("user", one.gname)):
                if value and value not in ("root", "nobody", "users"):
                    yield Told(place, value, field)
            yield Told(place, float(one.mtime), "mtime")
            yield from (Told(place, text, key) for key, text in one.pax_headers.items())
            stream = packed.extractfile(one)
            if stream is not None and depth < _DEEPEST and one.size <= _MOST_BYTES:
                for inner in _told(one.name, stream.read(), depth + 1):
                    yield _within(place, inner)


def _gzip(data: bytes, depth: int) -> Iterator[Told]:
    import zlib

    moment, flags = int.from_bytes(data[4:8], "little"), data[3]
    yield Told("header", float(moment), "mtime")
    if flags & 8:  # FNAME; RFC 1952, 2.3
        begin = 10 + (2 + int.from_bytes(data[10:12], "little") if flags & 4 else 0)
        yield Told("header", data[begin : data.index(b"\0", begin)].decode("latin-1"), "file")
    if depth < _DEEPEST:
        inner = zlib.decompressobj(31).decompress(data, _MOST_BYTES)
        yield from _told("", inner, depth + 1)


def _bzip(data: bytes, depth: int) -> Iterator[Told]:
    import bz2

    if depth < _DEEPEST:
        yield from _told("", bz2.BZ2Decompressor().decompress(data, _MOST_BYTES), depth + 1)


def _picture(data: bytes, _: int) -> Iterator[Told]:
    from PIL import ExifTags, Image

    with Image.open(BytesIO(data)) as image:
        for key, value in image.info.items():
            if isinstance(value, str):
                yield Told(f"text {key}", value, str(key))
        tags = dict(image.getexif())
        tags |= dict(image.getexif().get_ifd(ExifTags.IFD.Exif))
        places = image.getexif().get_ifd(ExifTags.IFD.GPSInfo)
        for tag, value in tags.items():
            name = ExifTags.TAGS.get(tag, str(tag))
            text = value.decode(errors="replace") if isinstance(value, bytes) else value
            if isinstance(text, str):
                yield Told(f"tag {name}", text.strip("\0 "), name)
        if places:
            yield Told("tag GPSInfo", "where it was taken", what="place of a camera")
        begin = data.find(b"<x:xmpmeta")
        if begin >= 0:
            yield Told("XMP", data[begin : begin + 100_000].decode(errors="replace"))
        if b"tIME" in data and data.startswith(b"\x89PNG"):
            at = data.index(b"tIME") + 4
            year = int.from_bytes(data[at : at + 2], "big")
            if 1990 <= year <= 2100:
                yield Told("chunk tIME", str(year), what="time stamp")


#: Times below this many seconds count from the start of a drive or a turn: by GPS they would be in
#: the first hour of a week.
_FROM_A_START_S = 3600.0


def _floats(data: bytes, _: int) -> Iterator[Told]:
    """Yield nothing of rows of float32, which letters come in by chance, and else the letters."""
    import numpy as np

    if len(data) % 4 == 0:
        values = np.abs(np.frombuffer(data, "<f4"))
        if np.isfinite(values).all() and values.max(initial=0) < _LARGEST:
            return
    yield from _letters(data)


def _mcap(data: bytes, depth: int) -> Iterator[Told]:
    """Yield the metadata, the moments and the texts of a recording, but no points' bytes."""
    from mcap.reader import make_reader

    reader = make_reader(BytesIO(data))
    header = reader.get_header()
    yield Told("header", f"{header.profile} {header.library}")
    for record in reader.iter_metadata():
        yield Told("metadata", record.name)
        for key, value in record.metadata.items():
            yield from _document_or_text(f"metadata {record.name}: {key}", value, key)
    for attached in reader.iter_attachments():
        yield Told(f"attachment {attached.name}", attached.name)
        yield Told(f"attachment {attached.name}", attached.create_time, "create_time")
        if depth < _DEEPEST:
            for inner in _told(attached.name, attached.data, depth + 1):
                yield _within(f"attachment {attached.name}", inner)
    begun = set[str]()
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        place = f"topic {channel.topic}"
        if channel.topic not in begun:
            begun.add(channel.topic)
            yield Told(place, channel.topic)
            yield Told(place, message.log_time, "log_time")
            yield Told(place, message.publish_time, "publish_time")
            yield from (Told(place, text, key) for key, text in channel.metadata.items())
        if channel.message_encoding == "json":
            for inner in _json(message.data, depth):
                yield _within(place, inner)
        elif schema is None or not _OF_POINTS.search(schema.name):
            # Texts of CDR end with a zero; letters that numbers make by chance hardly ever do.
            runs = _CDR_TEXT if channel.message_encoding == "cdr" else _RUN
            yield from (Told(place, run[0].decode()) for run in runs.finditer(message.data))


def _las(data: bytes, _: int) -> Iterator[Told]:
    import laspy
    import numpy as np

    if not _records_fit(data):
        yield from _letters(data)
        return
    with laspy.open(BytesIO(data)) as file:
        told = file.header
        yield from _device(str(told.system_identifier))
        yield Told("generating software", str(told.generating_software))
        for one in [*told.vlrs, *(file.evlrs or [])]:
            yield Told(f"record {one.record_id}", f"{one.user_id} {one.description}")
            yield from (
                Told(f"record {one.record_id}", run[0].decode())
                for run in _RUN.finditer(one.record_data_bytes())
            )
        if "gps_time" in told.point_format.dimension_names:
            for points in file.chunk_iterator(1_000_000):
                times = np.asarray(points.gps_time)
                if np.abs(times).max(initial=0) >= _FROM_A_START_S:
                    text = f"{times.min():.3f} to {times.max():.3f} of GPS"
                    yield Told("gps_time of the points", text, what="time stamp")
                    break


def _records_fit(data: bytes) -> bool:
    """Return whether a LAS file has room for the records that its header counts.

    laspy believes the counts, and reads four billion records from nothing (LAS 1.4 R15, table 3).
    """
    extended = struct.unpack_from("<I", data, 243)[0] if data[25] >= 4 else 0
    return bool(54 * struct.unpack_from("<I", data, 100)[0] + 60 * extended <= len(data))


def _device(name: str) -> Iterator[Told]:
    """Yield a LAS file's system identifier: words of the standard, or the name of a device."""
    words = ("", "OTHER", "EXTRACTION", "MODIFICATION", "MERGE", "TRANSFORMATION")
    text = name.strip("\0 ")
    if text.upper() not in words and not text.lower().startswith("urbantwin"):
        yield Told("system identifier", text, what="name of a device")


def _header_lines(data: bytes, _: int) -> Iterator[Told]:
    """Yield the header of a PLY or a PCD, and all of one that is text."""
    end = re.search(rb"end_header\r?\n|^DATA .*\n", data, re.MULTILINE)
    if end is None or b"ascii" in data[: end.end()]:
        yield from _letters(data)
    else:
        yield Told("header", data[: end.end()].decode("latin-1"), lines=True)


def _pcap(data: bytes, _: int) -> Iterator[Told]:
    order = "little" if data[:4] in (b"\xd4\xc3\xb2\xa1", b"\x4d\x3c\xb2\xa1") else "big"
    if len(data) >= 40:
        moment = int.from_bytes(data[24:28], "little" if order == "little" else "big")
        yield Told("first packet", float(moment), "time")
    yield from _letters(data)


def _map_pbf(data: bytes, _: int) -> Iterator[Told]:
    """Yield who mapped the objects of an OpenStreetMap extract, and when."""
    import osmium

    for number, one in enumerate(osmium.FileProcessor(osmium.io.FileBuffer(data, "pbf"))):
        if number >= _MOST_OBJECTS:
            break
        place = f"object {one.id}"
        yield Told(place, one.user, "user")
        if isinstance(one, osmium.osm.Changeset):
            continue
        yield Told(place, one.changeset, "changeset")
        if one.timestamp.timestamp() > 0:
            yield Told(place, one.timestamp.isoformat(" ", "minutes"))


def _within(place: str, inner: Told) -> Told:
    both = f"{place}: {inner.place}" if inner.place else place
    return Told(both, inner.value, inner.field, inner.lines, inner.what)


_READERS: dict[str, Callable[[bytes, int], Iterator[Told]]] = {
    **dict.fromkeys(("json", "geojson", "gltf", "ipynb", "cityjson", "topojson"), _json),
    **dict.fromkeys(("jsonl", "ndjson"), _json_lines),
    **dict.fromkeys(("zip", "npz", "usdz", "kmz", "3tz", "laszip"), _zip),
    **dict.fromkeys(("png", "jpg", "jpeg", "tif", "tiff", "webp"), _picture),
    **dict.fromkeys(("las", "laz"), _las),
    **dict.fromkeys(("ply", "pcd"), _header_lines),
    **dict.fromkeys(("pcap", "pcapng"), _pcap),
    **dict.fromkeys(("feather", "arrow"), _feather),
    "bin": _floats,
    "mcap": _mcap,
    "pbf": _map_pbf,
    "parquet": _parquet,
    "npy": _npy,
    "glb": _glb,
    "tar": _tar,
    "tgz": _gzip,
    "gz": _gzip,
    "bz2": _bzip,
}
