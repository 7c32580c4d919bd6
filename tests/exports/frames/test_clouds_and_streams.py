"""Datasets as PCD, LAS, LAZ, MCAP and WebDataset: by those formats' own readers, and back again."""

import hashlib
import json
import tarfile

import laspy
import numpy as np
import open3d as o3d
import pyarrow.parquet as pq
import pytest
from pyproj import CRS, Transformer

import urbantwin as ut
from urbantwin.exports.frames import DATASET_FORMATS, FrameSource, export_dataset
from urbantwin.fidelity.readers import open_recording

from ...thorough import further

FOLDERS = ("pcd", "las", "laz", "webdataset")


def digests(path):
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    return [hashlib.sha256(one.read_bytes()).hexdigest() for one in files]


@pytest.fixture(scope="session")
def written(two_sensors, riding, tmp_path_factory):
    """Return what exports a dataset once, by its name and the format's."""
    base, known = tmp_path_factory.mktemp("written"), {}

    def write(name, to):
        if (name, to) not in known:
            dataset = {"two_sensors": two_sensors, "riding": riding}[name]
            out = base / f"{name}-{to}{DATASET_FORMATS[to].ending}"
            known[name, to] = dataset, *export_dataset(dataset, to, out)
        return known[name, to]

    return write


@pytest.mark.parametrize(
    ("to", "name"),
    [
        *((to, "riding") for to in (*FOLDERS, "mcap")),
        ("laz", "two_sensors"),
        ("mcap", "two_sensors"),
        *further(*((to, "two_sensors") for to in ("pcd", "las", "webdataset"))),
    ],
)
def test_nothing_is_lost_on_the_way_and_back(written, same_frames, name, to):
    dataset, out, _ = written(name, to)
    holds = DATASET_FORMATS[to].holds
    las = to in ("las", "laz")
    same_frames(dataset, out, holds, within_m=5.1e-5 if las else 0.0, in_site=las)


@pytest.mark.parametrize("to", [*FOLDERS, "mcap"])
def test_the_same_dataset_gives_the_same_bytes(written, tmp_path, to):
    dataset, out, _ = written("two_sensors", to)
    again, _ = export_dataset(dataset, to, tmp_path / out.name)
    assert digests(out) == digests(again)


def test_open3d_reads_every_field_of_a_pcd(written):
    dataset, out, _ = written("two_sensors", "pcd")
    for source in FrameSource(dataset):
        cloud = o3d.t.io.read_point_cloud(str(out / f"{source.name}.pcd"))
        assert (cloud.point.positions.numpy() == source.xyz).all()
        assert (cloud.point.intensity.numpy().ravel() == source.intensity).all()
        for name in ("ring", "column", "sensor", "echo", "time"):
            assert (cloud.point[name].numpy().ravel() == source.rays[name]).all(), name
        for name in ("semantic", "instance"):
            assert (cloud.point[name].numpy().ravel() == getattr(source, name)).all(), name


def test_the_viewpoint_of_a_pcd_is_where_the_sensor_stands(written):
    _, out, _ = written("riding", "pcd")
    header = (out / "000007.pcd").read_bytes()[:1000].split(b"\n")
    line = next(one for one in header if one.startswith(b"VIEWPOINT")).split()
    # The frame of a riding sensor is level with its origin in the sensor.
    assert np.array(line[1:4], float) == pytest.approx(np.zeros(3), abs=1e-6)
    assert np.linalg.norm(np.array(line[4:], float)) == pytest.approx(1)


def test_laspy_finds_the_points_where_they_are_on_the_earth(written):
    dataset, out, _ = written("two_sensors", "las")
    source = FrameSource(dataset)
    frame, cloud = source[5], laspy.read(out / "000005.las")
    # Far from the anchor's meridian by as much as the sensor's place says.
    crs = cloud.header.parse_crs()
    to_degrees = Transformer.from_crs(crs, CRS("EPSG:4326"), always_xy=True)
    lon, lat = to_degrees.transform(cloud.x, cloud.y)
    geod = crs.get_geod()
    anchor = source.manifest["anchor"]
    azimuth, _, away = geod.inv(
        np.full(len(lon), anchor["longitude"]), np.full(len(lat), anchor["latitude"]), lon, lat
    )
    site = frame.site_SE3_dataset.apply(frame.xyz)
    assert away == pytest.approx(np.hypot(site[:, 0], site[:, 1]), abs=2e-4)
    assert np.sin(np.radians(azimuth)) * away == pytest.approx(site[:, 0], abs=2e-3)
    assert cloud.z == pytest.approx(site[:, 2], abs=5.1e-5)
    assert cloud.gps_time == pytest.approx(frame.time_s + frame.rays["time"].astype(float))
    assert (np.asarray(cloud.return_number) == frame.rays["echo"] + 1).all()
    assert set(np.asarray(cloud.classification)) <= {1, 2, 6, 7, 11, 64, 65}
    on_road = frame.semantic == 40
    assert (np.asarray(cloud.classification)[on_road] == 11).all()


# Its reader leaves its files open.
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_webdataset_reads_its_samples(written):
    wds = pytest.importorskip("webdataset")
    dataset, out, _ = written("two_sensors", "webdataset")
    source = FrameSource(dataset)
    shards = sorted(map(str, out.glob("*.tar")))
    found = {}
    for shard in shards:
        for sample in wds.WebDataset(shard, shardshuffle=False, empty_check=False).decode():
            found[sample["__key__"]] = shard, sample
    assert sorted(found) == sorted(source.names)
    for frame in source:
        shard, sample = found[frame.name]
        assert f"/{source.part_of(frame.name) or 'rest'}-" in shard
        assert (sample["points.npy"][:, :3] == frame.xyz).all()
        assert (sample["rays.npy"] == frame.rays).all()
        assert (sample["semantic.npy"] == frame.semantic).all()
        assert [row["track"] for row in sample["boxes.json"]] == frame.objects.track.tolist()
        assert sample["json"]["time_s"] == frame.time_s


def test_pyarrow_reads_a_row_for_each_frame(written):
    dataset, out, _ = written("two_sensors", "parquet")
    source = FrameSource(dataset)
    rows = {}
    for part in ("train", "val", "test", "rest"):
        for file in out.glob(f"{part}-*.parquet"):
            rows |= {row["frame"]: (part, row) for row in pq.read_table(file).to_pylist()}
    assert sorted(rows) == sorted(source.names)
    for frame in source:
        part, row = rows[frame.name]
        assert row["part"] == source.part_of(frame.name) == (None if part == "rest" else part)
        assert (np.column_stack([row[axis] for axis in "xyz"]) == frame.xyz).all()
        assert (np.array(row["intensity"], np.float32) == frame.intensity).all()
        for name in ("semantic", "instance"):
            assert row[name] == getattr(frame, name).tolist()
        for name in frame.rays.dtype.names:
            assert (np.array(row[name], frame.rays.dtype[name]) == frame.rays[name]).all()
        boxes = [[one[key] for key in ("x", "y", "z", "length")] for one in row["boxes"]]
        assert boxes == frame.objects.box[:, :4].tolist()
        pose = np.reshape(row["site_SE3_frame"], (4, 4))
        assert (pose[:3, 3] == frame.site_SE3_dataset.translation).all()
        sensors = {one["sensor"] for one in row["site_SE3_sensors"]}
        assert sensors == set(frame.site_SE3_sensors)


def test_ros_decodes_the_messages_of_an_mcap(written):
    decoder = pytest.importorskip("mcap_ros2.decoder")
    from mcap.reader import make_reader

    dataset, out, _ = written("two_sensors", "mcap")
    source = FrameSource(dataset)
    with out.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        messages = list(reader.iter_decoded_messages(topics=["/points", "/tf", "/markers"]))
        labels = [json.loads(m.data) for *_, m in reader.iter_messages(topics=["/labels"])]
        (told,) = reader.iter_metadata()
    assert [one["name"] for one in labels] == list(source.names)
    assert json.loads(told.metadata["inputs"]) == source.manifest["inputs"]
    digest = hashlib.sha256((dataset / "dataset.json").read_bytes()).hexdigest()
    assert told.metadata["dataset_sha256"] == digest
    by_topic = {}
    for _, channel, message, decoded in messages:
        by_topic.setdefault(channel.topic, []).append((message.log_time, decoded))
    kinds = {2: "u1", 4: "u2", 7: "f4"}
    for frame, (stamp, cloud), (_, tf), (_, markers) in zip(
        source, by_topic["/points"], by_topic["/tf"], by_topic["/markers"], strict=True
    ):
        assert stamp == round(frame.time_s * 1e9)
        record = np.dtype(
            {
                "names": [one.name for one in cloud.fields],
                "formats": [kinds[one.datatype] for one in cloud.fields],
                "offsets": [one.offset for one in cloud.fields],
                "itemsize": cloud.point_step,
            }
        )
        points = np.frombuffer(bytes(cloud.data), record)
        assert (points["x"] == frame.xyz[:, 0]).all()
        assert (points["instance"] == frame.instance).all()
        assert (points["time"] == frame.rays["time"]).all()
        place = tf.transforms[0].transform.translation
        assert [place.x, place.y, place.z] == frame.site_SE3_dataset.translation.tolist()
        assert [one.child_frame_id for one in tf.transforms[1:]] == ["sensor/pole", "sensor/mast"]
        assert [one.id for one in markers.markers] == frame.objects.track.tolist()
        assert [one.scale.x for one in markers.markers] == frame.objects.box[:, 3].tolist()


def test_the_lists_beside_clouds_have_what_the_tables_have(written):
    dataset, out, _ = written("two_sensors", "pcd")
    table = pq.read_table(dataset / "boxes.parquet").to_pylist()
    lines = (out / "boxes.csv").read_text().splitlines()
    assert len(lines) == len(table) + 1
    names = lines[0].split(",")
    for line, row in zip(lines[1:], table, strict=True):
        listed = dict(zip(names, line.split(","), strict=True))
        for name in ("x", "vx", "observed_s", "truncation"):
            assert float(listed[name]) == row[name]
        assert listed["ignored"] == (row["ignored"] or "")
        assert listed["towed_by"] == ("" if row["towed_by"] is None else str(row["towed_by"]))


def test_what_a_format_cannot_hold_is_told_before_it_writes(two_sensors, tmp_path):
    told = []

    def tell(text):
        assert not (tmp_path / "out").exists()
        told.append(text)

    _, notes = export_dataset(two_sensors, "kitti", tmp_path / "out", tell=tell)
    assert "kitti cannot hold of points: ring" in told[0]
    assert notes[: len(told)] == told


def test_a_damaged_shard_names_the_byte(written, tmp_path):
    _, out, _ = written("two_sensors", "webdataset")
    shard = sorted(out.glob("train*.tar"))[0]
    content = bytearray(shard.read_bytes())
    with tarfile.open(shard) as tar:
        member = tar.getmembers()[6]
    header = member.offset
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "train-000000.tar").write_bytes(content[: member.offset_data + 100])
    with pytest.raises(ut.InputError, match=f"byte {member.offset_data + 100}"):
        open_recording(broken)
    content[header + 150] ^= 1  # in the header's checksum
    (broken / "train-000000.tar").write_bytes(content)
    with pytest.raises(ut.InputError, match=f"byte {header}"):
        open_recording(broken)
