"""Size and speed of a dataset's frames in each storage, beside other ways to write columns.

Every figure is the median of the frames; times are of one process that writes a whole frame to a
file (without waiting for the disk) and reads all of it again. Ratios compare with ``npy`` in the
same run. Lossless ways are checked to the bit.

    python benchmarks/storage.py dataset/ other/dataset/ --frames 20

Without a dataset, the small world of ``benchmarks/record.py`` is recorded by two sensors.
"""

from __future__ import annotations

import argparse
import io
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather as pf
import pyarrow.parquet as pq

import urbantwin as ut
from record import RATE_HZ, circling_motion, static_world, twin_of
from urbantwin.dataset import record
from urbantwin.dataset.frame_columns import columns_of_frame, parquet_bytes
from urbantwin.dataset.frame_las import laz_bytes
from urbantwin.dataset.reading.frame_files import STORED, FrameFiles
from urbantwin.lidar import place_rig
from urbantwin.site.rig import RigSpec, SensorSpec

Columns = dict[str, np.ndarray]
_REPEATED = 3


def as_npy(frame: FrameFiles) -> dict[str, bytes]:
    """The three files of the default."""
    files = {"points/f.npy": frame.points, "semantic/f.label": frame.labels,
             "rays/f.npy": frame.rays}  # fmt: skip
    found = {}
    for name, array in files.items():
        stream = io.BytesIO()
        np.save(stream, array)
        found[name] = array.tobytes() if name.endswith("label") else stream.getvalue()
    return found


def in_columns(frame: FrameFiles) -> Columns:
    """The columns of a frame."""
    return columns_of_frame(frame.points, frame.labels, frame.rays)


def arrow(frame: FrameFiles) -> pa.Table:
    """The same as a table."""
    return pa.table({name: np.ascontiguousarray(one) for name, one in in_columns(frame).items()})


def feather(frame: FrameFiles) -> bytes:
    """Arrow's own file, whose buffers are packed one by one."""
    stream = io.BytesIO()
    pf.write_feather(arrow(frame), stream, compression="zstd")
    return stream.getvalue()


def plain_parquet(frame: FrameFiles) -> bytes:
    """Parquet as pyarrow writes it when nobody says how."""
    stream = io.BytesIO()
    pq.write_table(arrow(frame), stream, compression="zstd")
    return stream.getvalue()


def deflated(frame: FrameFiles) -> bytes:
    """NumPy's own packed file."""
    stream = io.BytesIO()
    np.savez_compressed(stream, points=frame.points, labels=frame.labels, rays=frame.rays)
    return stream.getvalue()


def seconds(work: Callable[..., Any], *given: object) -> float:
    """The least of a few."""
    times = []
    for _ in range(_REPEATED):
        began = time.perf_counter()
        work(*given)
        times.append(time.perf_counter() - began)
    return min(times)


def write(frame: FrameFiles, storage: str, points: Path) -> None:
    """Write a whole frame."""
    if storage == "npy":
        for name, content in as_npy(frame).items():
            (points.parent.parent / name).write_bytes(content)
    else:
        packed = parquet_bytes if storage == "zstd" else laz_bytes
        points.write_bytes(packed(in_columns(frame)))


def read_all(dataset: Path) -> FrameFiles:
    """Read all of the frame that was written."""
    frame = FrameFiles(dataset, "f")
    assert len(frame.points) == len(frame.labels) == len(frame.rays)
    return frame


def measured(dataset: Path, names: list[str], scratch: Path) -> dict[str, dict[str, float]]:
    """Bytes and milliseconds of each way."""
    rows: dict[str, list[tuple[float, float, float]]] = {}
    others: dict[str, tuple[Callable[[FrameFiles], bytes], Callable[[bytes], Any]]] = {
        "(feather, zstd)": (feather, lambda data: pf.read_table(pa.BufferReader(data))),
        "(parquet as it comes, zstd)": (
            plain_parquet,
            lambda data: pq.read_table(pa.BufferReader(data)),
        ),
        "(npz, deflate)": (deflated, lambda data: dict(np.load(io.BytesIO(data)))),
    }
    for name in names:
        frame = FrameFiles(dataset, name)
        given = (frame.points, frame.labels, frame.rays)
        for storage, ending in STORED.items():
            place = scratch / storage
            for folder in ("points", "semantic", "rays"):
                (place / folder).mkdir(parents=True, exist_ok=True)

            wrote = seconds(write, frame, storage, place / "points" / f"f{ending}")
            read = seconds(read_all, place)
            size = sum(one.stat().st_size for one in place.rglob("f.*"))
            again = read_all(place)
            if storage != "laz":
                assert again.points.tobytes() == given[0].tobytes()
            assert again.labels.tobytes() == given[1].tobytes()
            assert again.rays.tobytes() == given[2].tobytes()
            rows.setdefault(storage, []).append((size, wrote, read))
        for other, (make, back) in others.items():
            content = make(frame)
            wrote, read = seconds(make, frame), seconds(back, content)
            rows.setdefault(other, []).append((len(content), wrote, read))
    medians = {way: np.median(np.array(one), axis=0) for way, one in rows.items()}
    base = medians["npy"]
    return {
        way: {
            "bytes": float(one[0]), "of_npy": round(float(one[0] / base[0]), 3),
            "write_ms": round(1e3 * float(one[1]), 1), "read_ms": round(1e3 * float(one[2]), 1),
        }
        for way, one in medians.items()
    }  # fmt: skip


def small_datasets(folder: Path) -> list[Path]:
    """A few frames of two sensors."""
    twin = twin_of(static_world(), folder / "twin")
    motion = circling_motion(twin, 30, 5)
    made = []
    for model in ("OS1-128", "VLP-32C"):
        one = SensorSpec(name="a", model=model, east_m=0.0, north_m=0.0, height_m=5.0)
        rig = place_rig(RigSpec(sensors=[one], rate_hz=RATE_HZ), twin.mesh)
        made.append(folder / model)
        record(twin, motion, rig, made[-1])
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("datasets", nargs="*", type=Path, help="in the default storage")
    parser.add_argument("--frames", type=int, default=10, help="of each, evenly spread")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        report = {}
        for dataset in given.datasets or small_datasets(scratch):
            opened = ut.open(dataset)
            chosen = np.unique(np.linspace(0, len(opened) - 1, given.frames).astype(int))
            names = [opened.names[k] for k in chosen]
            model = opened.manifest["rig"]["sensors"][0]["model"]
            points = round(float(np.median([len(opened[one].points) for one in names])))
            report[f"{model}, {points:,} points a frame"] = measured(
                dataset, names, scratch / "files"
            )
    if given.json:
        print(json.dumps(report, indent=2))
        return
    for title, rows in report.items():
        print(f"\n{title}\n{'':30}{'kB':>8}{'of npy':>8}{'write ms':>10}{'read ms':>10}")
        for way, row in rows.items():
            print(f"{way:30}{row['bytes'] / 1e3:8.0f}{row['of_npy']:8.1%}"
                  f"{row['write_ms']:10.1f}{row['read_ms']:10.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
