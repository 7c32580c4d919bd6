"""Files of artefacts with a byte that is wrong, or cut: each is refused in a line."""

import random
import re
import struct
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from urbantwin.artefact.arrays import ArrayOf, array_of_bytes, read_array, read_arrays
from urbantwin.artefact.document import read_json_value
from urbantwin.artefact.tables import PARQUET, read_parquet
from urbantwin.errors import InputError

POINTS = ArrayOf("f4", ("N", 4))


def turned(data: bytes, byte: int, bit: int) -> bytes:
    return data[:byte] + bytes([data[byte] ^ 1 << bit]) + data[byte + 1 :]


def named(place: str | None) -> tuple[int, int]:
    """The first and the last byte that a place names."""
    found = re.findall(r"bytes? (\d+)(?: to (\d+))?", place or "")
    assert found, place
    spans = [(int(first), int(last or first)) for first, last in found]
    return min(first for first, _ in spans), max(last for _, last in spans)


def refused(read, path: Path) -> InputError | None:
    try:
        read(path)
    except InputError as error:
        return error if error.file == str(path) else None
    return None


@pytest.fixture(scope="module")
def cloud(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("cloud") / "a.npy"
    np.save(path, np.random.default_rng(1).uniform(-50, 50, (60, 4)).astype(np.float32))
    return path.read_bytes()


def read_points(path: Path) -> None:
    read_array(path, "points", POINTS)


def test_every_byte_of_a_header_that_is_turned_is_refused_or_means_the_same(cloud, tmp_path):
    path, draw, told = tmp_path / "a.npy", random.Random(5), 0
    for byte in range(128):
        path.write_bytes(turned(cloud, byte, draw.randrange(8)))
        if refused(read_points, path) is None:  # as `<f4` and `=f4`
            assert np.array_equal(np.load(path), np.load(_written(tmp_path / "b.npy", cloud)))
            continue
        told += 1
    assert told > 110


def _written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def test_an_array_that_is_cut_or_goes_on_is_refused(cloud, tmp_path):
    for size in (*range(0, 128, 9), *range(128, len(cloud), 31)):
        assert refused(read_points, _written(tmp_path / "a.npy", cloud[:size])) is not None
    error = refused(read_points, _written(tmp_path / "a.npy", cloud + b"more"))
    assert error is not None
    assert f"{len(cloud) + 4} bytes of the {len(cloud)}" in error.problem


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_value_that_is_not_finite_is_told_by_its_byte(tmp_path, order):
    path = tmp_path / "a.npy"
    values = np.array(np.arange(200).reshape(50, 4), np.float32, order=order)
    values[17, 2] = np.nan
    np.save(path, values)
    error = refused(read_points, path)
    assert error is not None
    assert "[17, 2]" in error.place


def test_a_packed_array_that_is_turned_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    draw = np.random.default_rng(2)
    np.savez_compressed(path, one=draw.normal(size=(30, 4)), other=np.arange(500))
    data, unseen = path.read_bytes(), 0
    form = {"one": ArrayOf("f8", (30, 4)), "other": ArrayOf("i8", ("M",))}
    for byte in range(0, len(data), 13):
        error = refused(
            lambda file: read_arrays(file, "arrays", form),
            _written(tmp_path / "b.npz", turned(data, byte, byte % 8)),
        )
        if error is None:  # times and attributes of members, which nothing depends on
            unseen += 1
    assert unseen < len(data) // 13 // 10


def test_a_header_that_no_parser_ends_is_told(cloud):
    """NumPy's parser of headers that Python 2 wrote raises an error of its own."""
    begin = cloud.index(b"{")
    bad = cloud[:begin] + b"(".ljust(cloud.index(b"\n") - begin) + cloud[cloud.index(b"\n") :]
    with pytest.raises(InputError, match="byte 7: is damaged"):
        array_of_bytes(bad, file=Path("a.tar"), place="byte 7", expected="an array")


def test_a_table_that_is_turned_is_refused(tmp_path):
    path = tmp_path / "a.parquet"
    draw = np.random.default_rng(3)
    names = pa.array([f"frame {k % 9}" for k in range(900)])
    table = pa.table({"x": draw.normal(size=900), "frame": names})
    pq.write_table(table, path, row_group_size=300, **PARQUET)
    data = path.read_bytes()
    footer = len(data) - 8 - struct.unpack("<I", data[-8:-4])[0]
    unseen, tried = 0, [*range(4, footer, 37), 0, 3, len(data) - 8, len(data) - 2]
    for byte in tried:
        error = refused(
            lambda file: read_parquet(file, "a table"),
            _written(tmp_path / "b.parquet", turned(data, byte, byte % 8)),
        )
        unseen += error is None  # statistics in the header of a page, which no checksum covers
    assert unseen < len(tried) // 20


def test_a_footer_that_contradicts_itself_does_not_end_the_process(tmp_path):
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"abcd": [1, 2, 3], "efgh": ["a", "b", "c"]}), path, compression=None)
    data = path.read_bytes()
    # Said to hold no nulls, beside numbers of values with and without: an element of the schema in
    # Thrift's compact protocol, its repetition and its name.
    nullable, required = (b"\x25" + kind + b"\x18\x04abcd" for kind in (b"\x02", b"\x00"))
    assert data.count(nullable) == 1
    path.write_bytes(data.replace(nullable, required))
    with pytest.raises(InputError, match="is not readable"):
        read_parquet(path, "a table")
    # Its own name no text, and its page damaged.
    bad = bytearray(data)
    bad[data.rindex(b"abcd")] = 0xFF
    bad[4:24] = bytes(20)
    path.write_bytes(bad)
    with pytest.raises(InputError, match="is not readable"):
        read_parquet(path, "a table")


@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_json_is_told_with_line_column_and_byte(tmp_path, coding):
    text = '{"ä": "NaN",\n "b": [1, NaN]}'
    data = text.encode(coding)
    path = _written(tmp_path / "a.json", data)
    error = refused(lambda file: read_json_value(file, "a document"), path)
    assert error is not None
    assert "line 2, column 11" in error.place
    byte, _ = named(error.place)
    unit = len("N".encode(coding.replace("utf-16", "utf-16-le").replace("utf-32", "utf-32-le")))
    unit = 1 if coding == "utf-8-sig" else unit
    assert data[byte : byte + 3 * unit].replace(b"\0", b"") == b"NaN"


def test_bytes_that_are_no_text_are_told(tmp_path):
    for mark in (b"", b"\xef\xbb\xbf"):
        data = mark + b'{"a": "\xc3\x28"}'
        error = refused(
            lambda file: read_json_value(file, "a document"), _written(tmp_path / "a.json", data)
        )
        assert error is not None
        assert error.place == f"byte {data.index(bytes([0xC3]))}"
