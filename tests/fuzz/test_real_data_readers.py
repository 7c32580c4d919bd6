"""Bad files of real recordings, of every layout, and of what a background is measured by."""

import io
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.io import savemat

from urbantwin.fidelity.beam_assignment import beams_of_model
from urbantwin.fidelity.range_matrix import measure_matrix
from urbantwin.fidelity.readers import open_recording
from urbantwin.io.matlab import read_matlab
from urbantwin.lidar.scan_pattern import load_scan_pattern

from .harness import NUMBERS
from .reader import SHARED_DATA, Reader
from .small_recordings import POINTS, RECORDINGS, ROWS, pcd, ply
from .test_site_readers import made

LIDAR = SHARED_DATA / "lidar"


def read_recording(path: Path) -> None:
    """Open the recording that a file is of, and read all of its frames."""
    folder = next((one for one in path.parents if one.name == "recording"), path)
    for frame in open_recording(folder):
        frame.foreground()


def read_cloud(path: Path) -> None:
    open_recording(path).read(0)


def read_ranges(path: Path) -> None:
    """A matrix of ranges, and the same file as the elevations of another."""
    measure_matrix(path, beams_of_model("VLP-16"), path.with_name("out.npz"))


def _array(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def _las(name: str) -> bytes:
    cloud = laspy.create(point_format=1, file_version="1.2")
    cloud.x, cloud.y, cloud.z = POINTS.T
    return made(name, lambda path: cloud.write(str(path)))


def _structured() -> np.ndarray:
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "u1"), ("t", "<u4")]
    table = np.zeros(len(ROWS), kinds)
    for name, column in zip("xyz", ROWS.T[:3], strict=True):
        table[name] = column
    return table


def _matlab(compressed: bool) -> bytes:
    ranges = np.full((16, 90), 12.0)
    stream = io.BytesIO()
    savemat(stream, {"ranges": ranges, "name": "a"}, do_compression=compressed)
    return stream.getvalue()


def _matlab_4() -> bytes:
    stream = io.BytesIO()
    savemat(stream, {"ranges": np.full((16, 90), 12.0)}, format="4")
    return stream.getvalue()


def _lines() -> bytes:
    return b"\n".join(b",".join([b"12.5"] * 20) for _ in range(16))


def _pattern() -> bytes:
    stream = io.BytesIO()
    count = np.arange(50.0)
    np.savez(stream, time_s=count, azimuth_deg=count, elevation_deg=count / 10, period_s=60.0)
    return stream.getvalue()


def _real(name: str) -> Callable[[], list[bytes]]:
    return lambda: [(LIDAR / name).read_bytes()]


READERS = [
    *(
        Reader(f"{layout} {name}", read_recording, f"recording/{name}",
               lambda content=content: [content],
               {f"recording/{other}": rest for other, rest in files.items() if other != name})
        for layout, files in RECORDINGS.items()
        for name, content in files.items()
    ),
    Reader("npy", read_cloud, "a.npy", lambda: [_array(ROWS), _array(_structured())]),
    Reader("bin", read_cloud, "a.bin", lambda: [ROWS.tobytes()]),
    Reader("pcd", read_cloud, "a.pcd",
           lambda: [pcd(kind) for kind in ("ascii", "binary", "binary_compressed")]),
    Reader("ply", read_cloud, "a.ply", lambda: [ply(), ply("ascii")]),
    Reader("las", read_cloud, "a.las", lambda: [_las("a.las")]),
    Reader("laz", read_cloud, "a.laz", lambda: [_las("a.laz")]),
    Reader("matlab", read_ranges, "a.mat",
           lambda: [_matlab(True), _matlab(False), _matlab_4()]),
    Reader("real matlab", lambda path: read_matlab(path, "a matrix"), "a.mat",
           _real("newbrunswick-roadside/beams_elevation.mat"), real=True),
    Reader("ranges npy", read_ranges, "a.npy", lambda: [_array(np.full((16, 90), 12.0))]),
    Reader("ranges csv", read_ranges, "a.csv", lambda: [_lines()]),
    Reader("pattern", load_scan_pattern, "a.npz", lambda: [_pattern()]),
    Reader("real kitti label", read_recording, "recording/label_2/000008.txt",
           _real("kitti/000008.txt"),
           {f"recording/{name}": content for name, content in (
               ("velodyne/000008.bin", ROWS.tobytes()),
               ("calib/000008.txt", RECORDINGS["kitti"]["calib/000007.txt"]))}, real=True),
]  # fmt: skip


@pytest.mark.parametrize("mutations", NUMBERS)
@pytest.mark.parametrize("reader", READERS, ids=str)
def test_bad_files(reader: Reader, mutations: int, fuzz: Callable[[Reader, int], None]) -> None:
    fuzz(reader, mutations)


@pytest.mark.parametrize("reader", [one for one in READERS if not one.real], ids=str)
def test_the_sound_files_are_read(reader: Reader, tmp_path: Path) -> None:
    """Otherwise all of the above could pass by refusing everything."""
    for number, data in enumerate(reader.seeds()):
        folder = tmp_path / str(number)
        for name, content in {**reader.files_beside(), reader.file: data}.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        reader.read(folder / reader.file)
