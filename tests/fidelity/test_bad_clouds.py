"""Files that are not what their names say, and rows whose width no name tells."""

import warnings

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording

from ..real_files import argoverse_log

POINTS = np.random.default_rng(0).uniform(1, 20, (40, 4)).astype(np.float32)


def pcd(data, body=b"", points=40, fields="x y z intensity", count="1 1 1 1"):
    head = (
        f"VERSION 0.7\nFIELDS {fields}\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT {count}\n"
        f"WIDTH {points}\nHEIGHT 1\nPOINTS {points}\nDATA {data}\n"
    )
    return head.encode() + body


def ply(body=b"", vertices=40, names="xyzi"):
    told = "".join(f"property float {name}\n" for name in names)
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\n{told}end_header\n"
    return head.encode() + body


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.pcd", pcd("ascii"), "truncated: 0 points"),
        ("a.pcd", pcd("binary", POINTS.tobytes(), points=-40), "header is not valid"),
        ("a.pcd", pcd("binary", POINTS.tobytes(), count="1 1 1 -1"), "header is not valid"),
        ("a.pcd", pcd("binary", POINTS.tobytes(), fields="x y z x"), "two fields x"),
        ("a.pcd", pcd("ascii", b"1 2 3 4\n1 2 here 4\n", points=2), "could not convert"),
        ("a.ply", ply(POINTS.tobytes(), vertices=-40), "line 3: has 'element vertex -40'"),
        ("a.ply", ply(POINTS.tobytes(), names="xxyz"), "line 5: has 'property float x'"),
        ("a.npy", b"hello", "not readable"),
        ("a.xyz", b"1 2 3", "holds no clouds, by its name"),
    ],
)
def test_one_line_says_what_is_wrong(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError, match=words) as found:
            open_recording(tmp_path / name).read(0)
    assert "\n" not in str(found.value)
    assert name in str(found.value)


def test_arrays_that_are_no_table_of_points(tmp_path):
    text = np.zeros(3, [("x", "U4"), ("y", "f4"), ("z", "f4")])
    for array, words in ((POINTS.T.repeat(3, 1), "shape"), (text, "values of <U4")):
        np.save(tmp_path / "a.npy", array)
        with pytest.raises(InputError, match=words):
            open_recording(tmp_path / "a.npy").read(0)


def test_intensity_that_nobody_filled_is_none(tmp_path):
    empty = POINTS.copy()
    empty[:, 3] = np.nan
    np.save(tmp_path / "a.npy", empty)
    frame = open_recording(tmp_path / "a.npy").read(0)
    assert frame.intensity is None
    assert len(frame.points) == len(POINTS)


def test_a_link_to_nowhere_is_a_frame_that_cannot_be_read(tmp_path):
    np.save(tmp_path / "0.npy", POINTS)
    (tmp_path / "1.npy").symlink_to("gone.npy")
    recording = open_recording(tmp_path)
    assert recording.names == ("0.npy", "1.npy")
    with pytest.raises(InputError, match="not found"):
        recording.read(1)


def test_rows_of_bin_files_are_as_wide_as_their_values_say(shared_data, tmp_path):
    log = argoverse_log(shared_data)
    sweep = open_recording(log).read(0)
    rng = np.random.default_rng(1)
    more = rng.uniform(0, 0.1, len(sweep.points))
    columns = np.column_stack([sweep.points, sweep.intensity, sweep.ring, more])
    for width in (3, 4, 5):
        # 4,020 rows: a multiple of 3, 4 and 5, so the size says nothing.
        rows = rng.permutation(columns[:, :width])[:4020].astype(np.float32)
        rows.tofile(tmp_path / "a.bin")
        frame = open_recording(tmp_path / "a.bin").read(0)
        assert np.array_equal(frame.points, rows[:, :3].astype(float))
        assert (frame.intensity is None) == (width == 3)
    # A whole row of three less is not taken for other columns.
    rows = columns[:4020, :4].astype(np.float32)
    (tmp_path / "a.bin").write_bytes(rows.tobytes()[:-4])
    with pytest.raises(InputError, match="truncated"):
        open_recording(tmp_path / "a.bin").read(0)


def test_boxes_without_size_are_no_objects(tmp_path):
    import pyarrow as pa
    from pyarrow import parquet

    (tmp_path / "points").mkdir()
    np.save(tmp_path / "points" / "000000.npy", POINTS)
    sizes = [4.0, -4.0, 0.0]
    table = {name: np.ones(3) for name in ("x", "y", "z", "width", "height", "yaw")}
    table |= {"length": np.array(sizes), "track": np.arange(3), "frame": ["000000"] * 3}
    parquet.write_table(pa.table(table | {"class": ["car"] * 3}), tmp_path / "boxes.parquet")
    boxes = open_recording(tmp_path).read(0).boxes
    assert boxes is not None
    assert boxes.box[:, 3].tolist() == [4.0]
    assert boxes.track.tolist() == [0]
    table |= {"x": np.array([1.0, np.nan, 1.0]), "class": ["car"] * 3}
    parquet.write_table(pa.table(table), tmp_path / "boxes.parquet")
    with pytest.raises(InputError, match="not finite"):
        open_recording(tmp_path).read(0)
