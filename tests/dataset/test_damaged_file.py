"""A damaged dataset: what opens, draws, compares and verifies it names the file."""

import hashlib
import re
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording

FRAME = "000003"


@pytest.fixture
def copy(dataset: Path, tmp_path: Path) -> Path:
    return shutil.copytree(dataset, tmp_path / "copy")


def changed(path: Path, change: Callable[[bytes], bytes]) -> None:
    data = path.read_bytes()
    path.unlink()
    path.write_bytes(change(data))


@pytest.mark.parametrize(
    "name",
    [
        f"points/{FRAME}.npy",
        f"rays/{FRAME}.npy",
        f"semantic/{FRAME}.label",
        f"labels/{FRAME}.txt",
        "ImageSets/train.txt",
        "boxes.parquet",
        "dataset.json",
    ],
)
def test_a_bit_that_turned_and_a_file_that_is_cut_are_named(copy: Path, name: str) -> None:
    data = (copy / name).read_bytes()
    middle = len(data) // 2
    turned = data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]
    for other in (turned, data[:-7]):
        changed(copy / name, lambda _, other=other: other)
        (damage,) = ut.dataset.verify(copy, progress=False).damages
        assert (damage.name, damage.problem) == (name, "damaged")


def test_a_dataset_with_the_checksums_of_blocks_is_read_and_verified(
    dataset: Path, copy: Path
) -> None:
    # As data sets were written before.
    table = copy / "blocks.parquet"
    pq.write_table(pa.table({"file": ["points/000000.npy"], "bytes": [4], "crc32": [[1]]}), table)
    with (copy / "SHA256SUMS").open("a") as sums:
        sums.write(f"{hashlib.sha256(table.read_bytes()).hexdigest()}  blocks.parquet\n")
    assert ut.dataset.verify(copy, progress=False)
    assert (ut.open(copy)[FRAME].points == ut.open(dataset)[FRAME].points).all()
    changed(table, lambda old: old + b"!")
    (damage,) = ut.dataset.verify(copy, progress=False).damages
    assert damage.name == "blocks.parquet"


def test_verify_says_it_in_its_line(copy: Path, capfd: pytest.CaptureFixture[str]) -> None:
    changed(copy / "points" / f"{FRAME}.npy", lambda old: old[:1000])
    assert main(["dataset", "verify", str(copy), "-q"]) == 2
    assert f"points/{FRAME}.npy is damaged" in capfd.readouterr().err


def _cut(data: bytes) -> bytes:
    return data[:-7]


READERS = {
    "open": lambda folder: [getattr(ut.open(folder)[FRAME], name) for name in ("labels", "rays")],
    "compare": lambda folder: open_recording(folder).read(3),
    "plot": lambda folder: ut.open(folder).plot(FRAME),
}


@pytest.mark.parametrize("folder", ["points", "rays", "semantic"])
@pytest.mark.parametrize("reader", READERS)
def test_what_reads_a_frame_that_is_cut_names_the_file(
    copy: Path, reader: str, folder: str
) -> None:
    ending = "label" if folder == "semantic" else "npy"
    path = copy / folder / f"{FRAME}.{ending}"
    changed(path, _cut)
    with pytest.raises(InputError) as caught:
        READERS[reader](copy)
    assert caught.value.file == str(path)


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
    with pytest.raises(InputError, match="is not readable"):
        _ = ut.open(copy).boxes
