"""Points kept in other ways: nothing lost in columns, whole millimetres in LAZ; every reader."""

import dataclasses
import json
import shutil
from contextlib import suppress

import laspy
import numpy as np
import pyarrow.parquet as pq
import pytest

import urbantwin as ut
from urbantwin.dataset import record
from urbantwin.dataset.frame_columns import COLUMNS, columns_of_frame, parquet_bytes, read_columns
from urbantwin.dataset.frame_las import SCALE_M, laz_bytes, read_laz
from urbantwin.dataset.reading.frame_files import RAY_TYPE, FrameFiles
from urbantwin.drawing.labelled_frame import read_labelled_points
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.tuning.frames import open_unlabelled
from urbantwin.taxonomy import semantic_id

ENDING = {"zstd": ".parquet", "laz": ".laz"}


@pytest.fixture(scope="module")
def packed(twin, motion, rig, tmp_path_factory):
    """The small dataset in columns, and as LAZ."""
    place = tmp_path_factory.mktemp("packed")
    for storage in ENDING:
        record(twin, motion, rig, place / storage, workers=1, seed=5, storage=storage)
    return place


def random_columns(count, seed=0):
    """Every value that a column can hold."""
    draw = np.random.default_rng(seed)
    points = draw.uniform(-200, 200, (count, 4)).astype("f4")
    points[:, 3] = draw.random(count)
    labels = draw.integers(0, 1 << 32, count, dtype=np.uint64).astype("u4")
    rays = np.empty(count, RAY_TYPE)
    for name in RAY_TYPE.names:
        kind = RAY_TYPE[name]
        high = 2 ** (8 * kind.itemsize)
        rays[name] = draw.random(count) if kind.kind == "f" else draw.integers(0, high, count)
    rays["echo"] %= 2
    return points, labels, rays


def placed(tmp_path, content, ending):
    (tmp_path / "points").mkdir(exist_ok=True)
    (tmp_path / f"points/000000{ending}").write_bytes(content)
    return FrameFiles(tmp_path, "000000")


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_nothing_is_lost_in_columns(tmp_path, count):
    points, labels, rays = random_columns(count)
    content = parquet_bytes(columns_of_frame(points, labels, rays))
    kept = placed(tmp_path, content, ".parquet")
    assert kept.points.tobytes() == points.tobytes()
    assert kept.labels.tobytes() == labels.tobytes()
    assert kept.rays.tobytes() == rays.tobytes()
    # Whoever reads Parquet reads it, with the names of the fields.
    table = pq.read_table(kept.file)
    assert table.column_names == list(COLUMNS)
    assert np.array_equal(table["x"].to_numpy(), points[:, 0])
    assert parquet_bytes(columns_of_frame(points, labels, rays)) == content


@pytest.mark.parametrize("count", [0, 1, 1000])
def test_a_laz_loses_less_than_a_millimetre_and_nothing_else(tmp_path, count):
    points, labels, rays = random_columns(count)
    content = laz_bytes(columns_of_frame(points, labels, rays))
    kept = placed(tmp_path, content, ".laz")
    off = np.abs(kept.points[:, :3].astype(float) - points[:, :3])
    assert off.max(initial=0) <= SCALE_M / 2 + 2e-5  # and what float32 has at 200 m
    assert np.abs(kept.points[:, 3] - points[:, 3]).max(initial=0) <= 0.5 / 65535 + 1e-7
    assert kept.labels.tobytes() == labels.tobytes()
    assert kept.rays.tobytes() == rays.tobytes()
    assert laz_bytes(columns_of_frame(points, labels, rays)) == content
    again = columns_of_frame(kept.points, kept.labels, kept.rays)
    assert laz_bytes(again) == content  # rounded once


def test_intensities_of_eight_bits_come_back_from_laz(tmp_path):
    points, labels, rays = random_columns(256)
    points[:, 3] = np.arange(256, dtype="f4") / np.float32(255)
    kept = placed(tmp_path, laz_bytes(columns_of_frame(points, labels, rays)), ".laz")
    assert np.array_equal(kept.points[:, 3], points[:, 3])


def test_a_laz_is_what_the_standard_says(packed):
    """laspy, another program's eyes: version, point format, classes, returns, extra bytes."""
    cloud = laspy.read(packed / "laz/points/000005.laz")
    assert (str(cloud.header.version), cloud.header.point_format.id) == ("1.4", 6)
    assert cloud.header.global_encoding.wkt
    assert cloud.header.creation_date is None
    assert cloud.header.scales.tolist() == [0.001] * 3
    semantic = np.asarray(cloud["semantic"])
    assert set(cloud.classification[semantic == semantic_id("road")]) == {11}
    assert set(cloud.classification[semantic == semantic_id("car")]) == {1}
    assert (np.asarray(cloud.return_number) <= np.asarray(cloud.number_of_returns)).all()
    assert cloud.header.point_count == len(cloud.points) > 1000
    assert np.allclose(cloud.header.mins, [cloud.x.min(), cloud.y.min(), cloud.z.min()])
    assert {"ring", "column", "sensor", "echo", "semantic", "instance"} == set(
        cloud.point_format.extra_dimension_names
    )


def test_laszip_reads_what_was_written(packed, judge):
    """The format's own library, where we write and read by another."""
    (told,) = judge("laszip_frames", packed / "laz/points/000005.laz")
    frame = FrameFiles(packed / "laz", "000005")
    found = columns_of_frame(frame.points, frame.labels, frame.rays)
    for name in ("ring", "column", "sensor", "echo", "semantic", "instance"):
        assert told[name] == found[name].tolist()
    assert np.array_equal(np.array(told["gps_time"], "f4"), found["time"])
    for axis in "xyz":
        assert np.array_equal(np.array(told[axis]).astype("f4"), found[axis])
    assert np.array_equal((np.array(told["intensity"]) / 65535).astype("f4"), found["intensity"])


def test_both_echoes_of_a_ray_know_of_each_other(tmp_path):
    points, labels, rays = random_columns(6)
    rays["sensor"], rays["ring"], rays["column"] = 0, [1, 1, 2, 3, 3, 4], 7
    rays["echo"] = [0, 1, 0, 0, 1, 1]
    (tmp_path / "a.laz").write_bytes(laz_bytes(columns_of_frame(points, labels, rays)))
    cloud = laspy.read(tmp_path / "a.laz")
    assert list(cloud.number_of_returns) == [2, 2, 1, 2, 2, 2]
    assert list(cloud.return_number) == [1, 2, 1, 1, 2, 2]


@pytest.mark.parametrize("storage", ["zstd", "laz"])
def test_every_reader_reads_it(dataset, packed, storage):
    """What is read of the default is read of it, by each way to read a dataset."""
    other = packed / storage
    exact = storage == "zstd"
    near = np.array_equal if exact else (lambda a, b: np.allclose(a, b, atol=6e-4, rtol=0))
    one, two = ut.open(dataset), ut.open(other)
    assert two.summary()["storage"] == storage
    for first, second in zip(one, two, strict=True):
        assert near(first.points, second.points)
        assert np.array_equal(first.labels, second.labels)
        assert first.rays.tobytes() == second.rays.tobytes()
        assert first.boxes.equals(second.boxes)
    for opened in (open_recording, open_unlabelled):
        plain, columns = opened(dataset), opened(other)
        assert plain.names == columns.names
        for first, second in zip(plain, columns, strict=True):
            for name in (field.name for field in dataclasses.fields(first)):
                a, b = getattr(first, name), getattr(second, name)
                if isinstance(a, np.ndarray):
                    same = (
                        np.array_equal(a, b) if name not in ("points", "intensity") else near(a, b)
                    )
                    assert same, name
                elif name in ("name", "not_finite", "no_return"):
                    assert a == b
    first, second = (read_labelled_points(one, "000004") for one in (dataset, other))
    assert near(first.points, second.points)
    assert np.array_equal(first.ring, second.ring)
    assert ut.dataset.verify(other, progress=False)
    assert ut.info(other)["frames"] == len(one)
    files = {one.parent.name for one in other.rglob("0*")}
    assert files == {"points", "labels"}
    size = sum(one.stat().st_size for one in (other / "points").iterdir())
    whole = sum(one.stat().st_size for name in ("points", "semantic", "rays")
                for one in (dataset / name).iterdir())  # fmt: skip
    assert size < 0.7 * whole


def test_the_other_files_are_the_same(dataset, packed):
    told = {key: json.loads((place / "dataset.json").read_text())
            for key, place in (("npy", dataset), ("zstd", packed / "zstd"))}  # fmt: skip
    assert told["zstd"]["storage"] == "zstd"
    assert "parquet" in told["zstd"]["layout"]["points"]
    for name in ("boxes.parquet", "sweeps.parquet", "labels/000007.txt", "ImageSets/train.txt"):
        assert (dataset / name).read_bytes() == (packed / "zstd" / name).read_bytes()


def test_what_a_killed_run_left_is_gone_on_from(twin, motion, rig, packed, tmp_path, digests):
    """Another storage is another dataset: it is not mixed with what is there."""
    out = tmp_path / "dataset"

    class StoppedError(Exception):
        """In the middle."""

    def stop(share, doing):
        if share > 0.4 and "frame" in doing:
            raise StoppedError

    with pytest.raises(StoppedError):
        record(twin, motion, rig, out, workers=1, seed=5, storage="zstd", progress=stop)
    left = [one for one in tmp_path.iterdir() if one.name.endswith("partial")]
    assert len(list(left[0].rglob("*.parquet"))) > 2
    record(twin, motion, rig, out, workers=1, seed=5, storage="zstd")
    assert digests(out) == digests(packed / "zstd")
    assert [one.name for one in tmp_path.iterdir()] == ["dataset"]


@pytest.mark.parametrize("storage", ["zstd", "laz"])
@pytest.mark.parametrize("hurt", ["cut", "empty", "noise", "gone"])
def test_a_damaged_frame_is_one_line(packed, tmp_path, storage, hurt):
    here = shutil.copytree(packed / storage, tmp_path / "dataset")
    file = here / f"points/000003{ENDING[storage]}"
    content = file.read_bytes()
    if hurt == "gone":
        file.unlink()
    else:
        middle, noise = len(content) // 2, np.random.default_rng(1).bytes(400)
        content = {"cut": b"", "noise": noise + content[middle + 400 :]}.get(hurt)
        file.write_bytes(b"" if content is None else file.read_bytes()[:middle] + content)
    frame = ut.open(here)[3]
    may_pass = (storage, hurt) == ("zstd", "noise")  # in columns that are not read
    with suppress(InputError) if may_pass else pytest.raises(InputError, match="000003"):
        assert len(frame.points) == len(frame.labels) == len(frame.rays)
    assert not ut.dataset.verify(here, progress=False)


def test_columns_of_other_types_are_refused(tmp_path):
    import pyarrow as pa

    columns = columns_of_frame(*random_columns(10))
    table = pa.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
    file = tmp_path / "a.parquet"
    wrong = {
        "ring": table.set_column(7, "ring", pa.array([1.5] * 10)),
        "x": table.set_column(0, "x", pa.array([None] * 10, pa.float32())),
        "echo": table.drop_columns("echo"),
    }
    for name, one in wrong.items():
        pq.write_table(one, file)
        with pytest.raises(InputError, match=name):
            read_columns(file, list(COLUMNS), "columns")
    plain = laspy.create(point_format=6, file_version="1.4")
    plain.x = plain.y = plain.z = np.arange(5.0)
    plain.write(tmp_path / "b.laz")
    with pytest.raises(InputError, match="column: is missing"):
        read_laz(tmp_path / "b.laz")


def test_an_unknown_storage_is_refused_before_any_work(twin, motion, rig, tmp_path):
    with pytest.raises(InputError, match="unknown storage 'zip'"):
        record(twin, motion, rig, tmp_path / "d", storage="zip")
    assert not list(tmp_path.iterdir())
