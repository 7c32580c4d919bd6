"""A damaged dataset: what opens, draws, compares and verifies it names the file and the byte."""

import random
import re
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording

FRAME = "000003"


@pytest.fixture
def copy(dataset: Path, tmp_path: Path) -> Path:
    return shutil.copytree(dataset, tmp_path / "copy")


def where(folder: Path, name: str) -> str:
    found = ut.dataset.verify(folder, progress=False)
    (damage,) = found.damages
    assert (damage.name, damage.problem) == (name, "damaged")
    return damage.where


def changed(path: Path, change: Callable[[bytes], bytes]) -> None:
    data = path.read_bytes()
    path.unlink()
    path.write_bytes(change(data))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_label_that_is_another_is_told_to_the_byte_by_the_boxes(copy: Path, share: float) -> None:
    path = copy / "labels" / f"{FRAME}.txt"
    data = path.read_bytes()
    byte = int(share * len(data))
    changed(path, lambda old: old[:byte] + bytes([old[byte] ^ 1]) + old[byte + 1 :])
    line = data.count(b"\n", 0, byte) + 1
    assert where(copy, f"labels/{FRAME}.txt").startswith(f"line {line} (byte {byte}):")
    changed(path, lambda _: data[:byte])
    assert f"(byte {byte})" in where(copy, f"labels/{FRAME}.txt")


@pytest.mark.parametrize(
    "name",
    [
        f"points/{FRAME}.npy",
        f"rays/{FRAME}.npy",
        f"semantic/{FRAME}.label",
        "boxes.parquet",
        "sweeps.parquet",
        "dataset.json",
        "ignore_regions.geojson",
    ],
)
def test_a_file_that_is_cut_is_told_with_its_end(copy: Path, name: str) -> None:
    draw = random.Random(name)
    data = (copy / name).read_bytes()
    for size in draw.sample(range(10, len(data) - 1), 4):
        changed(copy / name, lambda _, size=size: data[:size])
        told = where(copy, name)
        byte = max(int(one) for one in re.findall(r"byte (\d+)|to (\d+)", told)[0] if one)
        blank = data[:size].rstrip()  # JSON ends with its last letter
        assert byte in (size, size - 1, len(blank)) or name.endswith("json"), (size, told)


@pytest.mark.parametrize(
    "name", [f"points/{FRAME}.npy", f"rays/{FRAME}.npy", f"semantic/{FRAME}.label"]
)
def test_a_bit_that_turned_in_the_middle_of_numbers_is_told_by_its_block(
    copy: Path, name: str
) -> None:
    size = (copy / name).stat().st_size
    data = (copy / name).read_bytes()
    for byte in random.Random(name).sample(range(200, size), 8):
        changed(copy / name, lambda _, k=byte: data[:k] + bytes([data[k] ^ 1]) + data[k + 1 :])
        told = where(copy, name)
        first, last = map(int, re.findall(r"^bytes (\d+) to (\d+)", told)[0])
        assert first <= byte <= last
        assert last - first < 4096
    two = bytearray(data)
    two[200] ^= 1
    two[-1] ^= 1
    changed(copy / name, lambda _: bytes(two))
    assert where(copy, name) == "bytes 0 to 4095: not what was written, and 1 more block"


def test_a_list_of_frames_is_told_by_its_line(copy: Path) -> None:
    path = copy / "ImageSets" / "train.txt"
    changed(path, lambda old: old.replace(b"000002\n", b"000902\n"))
    assert where(copy, "ImageSets/train.txt").startswith("line 3 (byte 14):")


def test_verify_says_it_in_its_line(copy: Path, capfd: pytest.CaptureFixture[str]) -> None:
    changed(copy / "points" / f"{FRAME}.npy", lambda old: old[:1000])
    assert main(["dataset", "verify", str(copy), "-q"]) == 2
    assert f"points/{FRAME}.npy is damaged at byte 1000: is truncated" in capfd.readouterr().err


def _cut(data: bytes) -> bytes:
    return data[:-7]


READERS = {
    "open": lambda folder: [getattr(ut.open(folder)[FRAME], name) for name in ("labels", "rays")],
    "compare": lambda folder: open_recording(folder).read(3),
    "plot": lambda folder: ut.open(folder).plot(FRAME),
}


@pytest.mark.parametrize("folder", ["points", "rays", "semantic"])
@pytest.mark.parametrize("reader", READERS)
def test_who_reads_a_frame_that_is_cut_is_told_the_byte(
    copy: Path, reader: str, folder: str
) -> None:
    ending = "label" if folder == "semantic" else "npy"
    path = copy / folder / f"{FRAME}.{ending}"
    size = path.stat().st_size - 7
    changed(path, _cut)
    with pytest.raises(InputError) as caught:
        READERS[reader](copy)
    assert caught.value.file == str(path)
    known = (f"byte {size}", f"byte {size - size % 4}")
    assert caught.value.place in known


@pytest.mark.parametrize(("field", "value"), [("ring", 60_000), ("time", np.nan)])
def test_a_ray_that_cannot_be_is_told_by_its_byte(copy: Path, field: str, value: float) -> None:
    path = copy / "rays" / f"{FRAME}.npy"
    table = np.load(path)
    table[field][41] = value
    path.unlink()
    np.save(path, table)
    with pytest.raises(InputError) as caught:
        open_recording(copy).read(3)
    assert caught.value.file == str(path)
    byte = int(re.search(r"byte (\d+)", caught.value.place)[1])
    kind = {"ring": "<H", "time": "<f"}[field]
    (found,) = struct.unpack_from(kind, path.read_bytes(), byte)
    assert np.array_equal(found, value, equal_nan=True)
    assert "ray 41" in caught.value.place


def test_a_table_whose_bits_turned_is_refused(copy: Path) -> None:
    path = copy / "boxes.parquet"
    half = path.stat().st_size // 3
    changed(path, lambda old: old[:half] + bytes([old[half] ^ 16]) + old[half + 1 :])
    with pytest.raises(InputError, match=r"group 1 of rows, column \w+ \(bytes") as caught:
        _ = ut.open(copy).boxes
    first, last = map(int, re.findall(r"bytes (\d+) to (\d+)", caught.value.place)[0])
    assert first <= half <= last
