"""Changes inside of a container, which is packed again so that its checksums are right."""

import bz2
import gzip
import io
import json
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable

import numpy as np
import pyarrow as pa
from pyarrow import feather, parquet

from .document_mutation import changed_value

__all__ = ["container_of"]

Mutator = Callable[[random.Random, bytes, bytes], bytes]
MutatorsOf = Callable[[bytes], dict[str, Mutator]]

_BOMB = 300 << 20  # bytes of a container's content that its few bytes stand for
_UNPACKED = 64 << 20  # bytes of content that are packed again to change something inside


def _inside(rng: random.Random, content: bytes, other: bytes, mutators_of: MutatorsOf) -> bytes:
    mutators = mutators_of(content)
    return mutators[rng.choice(list(mutators))](rng, content, other)


def _zip(rng: random.Random, data: bytes, other: bytes, mutators_of: MutatorsOf) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = rng.choice(list(members) or ["none"])
    kind = rng.random()
    if kind < 0.1:
        members.pop(name, None)
    elif kind < 0.2:
        members[rng.choice(["../x.npy", "/x", "odd.npy", "a\\b", ""]) or "x"] = rng.randbytes(50)
    else:
        content = members.get(name, b"")
        members[name] = _inside(rng, content, rng.choice([*members.values(), b""]), mutators_of)
    packed = io.BytesIO()
    how = rng.choice([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
    with zipfile.ZipFile(packed, "w", how) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return packed.getvalue()


def _zip_bomb(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """A member whose zeros are many; of an array, with a header that says so."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    if not members:
        return data
    name = rng.choice(list(members))
    length = rng.choice([1 << 20] * 5 + [_BOMB])
    head = b""
    if members[name].startswith(b"\x93NUMPY"):
        text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (%d,), }" % (length // 8)
        head = b"\x93NUMPY\x01\x00" + struct.pack("<H", 118) + text.ljust(117) + b"\n"
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for key, content in members.items():
            archive.writestr(key, head + bytes(length) if key == name else content)
    return packed.getvalue()


def _npy(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """Another shape, type or order than the array has."""
    end = 10 + struct.unpack_from("<H", data, 8)[0]
    head = data[10:end]
    found = re.search(rb"'shape': (\([^)]*\))", head)
    kinds = [b"<f8", b"<f4", b"|O", b"|S80000", b"<U9999999", b"|u1", b">i8", b"<c16", b"|b1",
             b"<M8[ns]", b"[('a', '<f8')]", b"|V0", b"<f2"]  # fmt: skip
    shapes = [b"()", b"(0,)", b"(1,)", b"(-1,)", b"(4294967296,)", b"(9223372036854775807, 2)",
              b"(65536, 65536, 65536)", b"(0, 9223372036854775807)", b"(3, 0)", b"(1.5,)",
              b"(" + b"9" * 5000 + b",)", b"(2, 2)", b"(1, 1, 1, 1)"]  # fmt: skip
    kind = rng.randrange(3)
    if kind == 0 and found:
        head = head[: found.start(1)] + rng.choice(shapes) + head[found.end(1) :]
    elif kind == 1:
        head = re.sub(rb"'descr': '[^']*'", b"'descr': '" + rng.choice(kinds) + b"'", head, count=1)
    else:
        try:
            rows = np.lib.format.read_array(io.BytesIO(data)).copy()
        except (ValueError, SyntaxError, EOFError):
            return data
        with np.errstate(all="ignore"):
            flat = rows.reshape(-1)
            if flat.dtype.kind in "iuf" and len(flat):
                values = [np.nan, np.inf, -np.inf, 1e308, 1e30] if flat.dtype.kind == "f" else [-1]
                values += [2**31 - 1, 2**63 - 1, 0, 250]
                value = np.array(rng.choice(values)).astype(flat.dtype)
                flat[rng.randrange(len(flat)) :: rng.choice([1, 7, len(flat)])] = value
            rows = rng.choice([rows, rows[:-1] if rows.ndim else rows, rows.reshape(-1)])
        packed = io.BytesIO()
        np.lib.format.write_array(packed, rows, allow_pickle=False)
        return packed.getvalue()
    version = b"\x93NUMPY\x02\x00" + struct.pack("<I", len(head))
    return version + head + data[end:]


def _table(rng: random.Random, table: pa.Table) -> pa.Table:  # noqa: PLR0911
    """A table with a column lost, of another kind, or with values that are none."""
    if not table.num_columns:
        return table
    at = rng.randrange(table.num_columns)
    name, column, rows = table.column_names[at], table.column(at), table.num_rows
    kind = rng.randrange(7)
    if kind == 0:
        return table.remove_column(at)
    if kind == 1:
        return table.slice(0, 0)
    if kind == 2:
        return table.append_column(rng.choice(["odd", name]), column)
    if kind == 3:
        return table.replace_schema_metadata({b"ARROW:schema": rng.randbytes(30), b"x": b"\xff"})
    odd: list[object] = [None, float("nan"), float("inf"), -1, 2**63 - 1, 1e308, "x", b"\xff", [1]]
    odd += [2**31, True, "", {"a": 1}]
    value = rng.choice(odd)
    if kind < 5:
        return table.set_column(at, name, pa.array([value] * rows))
    values = column.to_pylist()
    if values:
        values[rng.randrange(rows)] = value
    try:
        return table.set_column(at, name, pa.array(values, column.type))
    except (pa.ArrowException, TypeError, OverflowError, ValueError):
        return table.set_column(at, name, pa.nulls(rows, column.type))


def _parquet(rng: random.Random, data: bytes, other: bytes) -> bytes:
    packed = io.BytesIO()
    try:
        table = _table(rng, parquet.read_table(io.BytesIO(data)))
    except UnicodeDecodeError:  # an earlier mutation changed a column's name
        return data
    parquet.write_table(table, packed)
    return packed.getvalue()


def _feather(rng: random.Random, data: bytes, other: bytes) -> bytes:
    packed = io.BytesIO()
    try:
        table = _table(rng, feather.read_table(io.BytesIO(data)))
    except UnicodeDecodeError:  # an earlier mutation changed a column's name
        return data
    feather.write_feather(table, packed, "uncompressed")
    return packed.getvalue()


def _glb(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """The JSON of a GLB changed and its lengths put right."""
    length = struct.unpack_from("<I", data, 12)[0]
    value = changed_value(rng, json.loads(data[20 : 20 + length]))
    text = json.dumps(value).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4s2I", b"glTF", 2, 20 + len(text) + len(rest))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + rest


def _png(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """A picture that says it is huge, its checksum right."""
    sides = struct.pack(
        ">II", rng.choice([0, 1, 65_535, 2**31 - 1]), rng.choice([0, 50_000, 2**30])
    )
    head = b"IHDR" + sides + data[24:29]
    return data[:12] + head + struct.pack(">I", zlib.crc32(head)) + data[33:]


def _las(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """A field of the header of LAS 1.0 to 1.4 with another value."""
    fields = [(24, "<B"), (25, "<B"), (94, "<H"), (96, "<I"), (100, "<I"), (104, "<B"), (105, "<H"),
              (107, "<I"), *((131 + 8 * i, "<d") for i in range(12)), (227, "<Q"), (235, "<Q"),
              (243, "<I"), (247, "<Q")]  # fmt: skip
    changed = bytearray(data)
    for at, form in rng.sample(fields, rng.choice([1, 1, 2])):
        size = struct.calcsize(form)
        if form == "<d":
            value: object = rng.choice([0.0, -1.0, 1e308, float("nan"), float("inf"), 1e-300])
        else:
            top = 256**size - 1
            value = rng.choice([0, 1, 6, 10, 34, 130, top, top // 2, top // 2 + 1]) & top
        if at + size <= len(changed):
            struct.pack_into(form, changed, at, value)
    return bytes(changed)


def container_of(data: bytes, mutators_of: MutatorsOf) -> dict[str, Mutator]:
    """Return what can be done inside of a container, if this is a sound one."""
    try:
        return _container_of(data, mutators_of)
    except Exception:  # damaged by an earlier change: no container any more
        return {}


def _container_of(  # noqa: PLR0911
    data: bytes, mutators_of: MutatorsOf
) -> dict[str, Mutator]:
    if data[:2] == b"PK":
        archive = zipfile.ZipFile(io.BytesIO(data))
        size = sum(member.file_size for member in archive.infolist())
        if size > _UNPACKED or archive.testzip() is not None:
            return {}

        def inside_zip(rng: random.Random, data: bytes, other: bytes) -> bytes:
            return _zip(rng, data, other, mutators_of)

        return {"zip": inside_zip, "zip bomb": _zip_bomb, "zip again": inside_zip}
    for magic, name, unpack, pack in (
        (b"\x1f\x8b", "gzip", gzip.decompress, gzip.compress),
        (b"BZh", "bz2", bz2.decompress, bz2.compress),
    ):
        if data.startswith(magic):
            content = unpack(data)

            def inside(
                rng: random.Random,
                data: bytes,
                other: bytes,
                content: bytes = content,
                pack: Callable[[bytes], bytes] = pack,
            ) -> bytes:
                return pack(_inside(rng, content, content, mutators_of))

            return {name: inside, f"{name} again": inside}
    if data.startswith(b"PAR1"):
        parquet.read_table(io.BytesIO(data))
        return {"parquet": _parquet, "parquet again": _parquet}
    if data.startswith(b"ARROW1"):
        feather.read_table(io.BytesIO(data))
        return {"feather": _feather, "feather again": _feather}
    if data.startswith(b"glTF"):
        json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
        return {"glb": _glb, "glb again": _glb}
    if data.startswith(b"LASF"):
        return {"las": _las, "las again": _las}
    if data.startswith(b"\x93NUMPY"):
        np.lib.format.read_array(io.BytesIO(data))
        return {"npy": _npy, "npy again": _npy}
    if data.startswith(b"\x89PNG"):
        return {"png": _png}
    return {}
