"""Bags of ROS 1 and ROS 2 and MCAP files, written by their own libraries from known points."""

import itertools
import math
import pickle
import struct
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType

from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording

from .bag_files import (
    CLOUD,
    OF_FOXGLOVE,
    ROS1,
    ROS2,
    SECOND,
    foxglove_json,
    foxglove_protobuf,
    foxglove_schema,
    header,
    ros_cloud,
    write_mcap,
    write_ros1,
    write_ros2,
)

#: As PCL lays out points: with bytes that only fill up.
PCL = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "ring", "time"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2", "<f4"],
        "offsets": [0, 4, 8, 16, 20, 24],
        "itemsize": 32,
    }
)
POINT_CLOUD = ("foxglove.PointCloud", "jsonschema", b"{}", "json")
PROTOBUF = ("foxglove.PointCloud", "protobuf", foxglove_schema().SerializeToString(), "protobuf")


def table(seed=0, count=300, kind=PCL):
    rng = np.random.default_rng(seed)
    rows = np.zeros(count, kind)
    for name, (of_field, *_) in kind.fields.items():
        shape = (count, *of_field.shape)
        if name in "xyz":
            rows[name] = rng.normal(0, 20, shape)
        elif name in ("t", "time", "timestamp"):
            rows[name] = np.linspace(0, 0.1, count) * (1 if of_field.kind == "f" else 1e9)
        else:
            rows[name] = rng.integers(0, 100, shape)
    return rows


def same(frame, rows):
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(frame.points[:, axis], rows[name].astype(float))
    np.testing.assert_array_equal(frame.intensity, rows["intensity"])
    np.testing.assert_array_equal(frame.ring, rows["ring"])
    np.testing.assert_allclose(frame.time_s, rows["time"], atol=1e-9)


TABLES = [table(seed) for seed in range(5)]


def ros1_bag(path, packed):
    messages = [(k * SECOND, ros_cloud(ROS1, one)) for k, one in enumerate(TABLES)]
    write_ros1(path / "a.bag", {"/points": (CLOUD, None, messages)}, packed=packed)
    return path / "a.bag"


def ros2_bag(path, storage, packed=None, *, big=False):
    messages = [(k * SECOND, ros_cloud(ROS2, one, big=big)) for k, one in enumerate(TABLES)]
    topics = {"/points": (CLOUD, None, messages)}
    write_ros2(path / "bag", topics, storage=storage, packed=packed)
    return path / "bag"


def mcap_of_foxglove(path, kind, pack, **how):
    messages = [(k * SECOND, pack(one)) for k, one in enumerate(TABLES)]
    # As they come: not in the order of their time.
    write_mcap(path / "a.mcap", {"points": (*kind, messages[::-1])}, **how)
    return path / "a.mcap"


FILES = {
    **{f"ros1 {packed}": lambda path, packed=packed: ros1_bag(path, packed)
       for packed in (None, "BZ2", "LZ4")},
    **{f"ros2 {storage} {packed}":
       lambda path, how=(storage, packed): ros2_bag(path, *how, big=how[1] is None)
       for storage, packed in itertools.product(("SQLITE3", "MCAP"), (None, "MESSAGE", "STORAGE"))
       if (storage, packed) != ("SQLITE3", "STORAGE")},
    "ros2 file": lambda path: ros2_bag(path, "SQLITE3", "FILE"),
    **{f"foxglove json {packed.name}":
       lambda path, packed=packed:
       mcap_of_foxglove(path, POINT_CLOUD, foxglove_json, compression=packed)
       for packed in CompressionType},
    "foxglove protobuf": lambda path: mcap_of_foxglove(path, PROTOBUF, foxglove_protobuf),
    "without chunks":
       lambda path: mcap_of_foxglove(path, PROTOBUF, foxglove_protobuf, use_chunking=False),
    "a chunk for each":
       lambda path: mcap_of_foxglove(path, POINT_CLOUD, foxglove_json, chunk_size=1),
    "without indexes": lambda path: mcap_of_foxglove(
        path, POINT_CLOUD, foxglove_json, index_types=IndexType.NONE, repeat_channels=False,
        repeat_schemas=False, use_summary_offsets=False, use_statistics=False),
}  # fmt: skip


@pytest.mark.parametrize("kind", FILES)
def test_points_of_every_container(tmp_path, kind):
    path = FILES[kind](tmp_path)
    recording = open_recording(path)
    assert recording.layout == ("mcap" if path.suffix == ".mcap" else "rosbag")
    assert recording.names == tuple(str(k * SECOND) for k in range(5))
    for index in (4, 0, 2, 1, 3, 2):
        same(recording.read(index), TABLES[index])
    # By several threads at once, and in another process.
    with ThreadPoolExecutor(4) as pool:
        for index, frame in enumerate(pool.map(recording.read, [0, 1, 2, 3, 4] * 3)):
            same(frame, TABLES[index % 5])
    same(pickle.loads(pickle.dumps(recording)).read(1), TABLES[1])
    for inside in path.iterdir() if path.is_dir() and not kind.endswith("file") else ():
        if inside.suffix in (".db3", ".mcap"):
            same(open_recording(inside).read(3), TABLES[3])


def test_ros1_messages_in_an_mcap(tmp_path):
    messages = [
        (k * SECOND, bytes(ROS1.serialize_ros1(ros_cloud(ROS1, one), CLOUD)))
        for k, one in enumerate(TABLES)
    ]
    topics = {"/points": ("sensor_msgs/PointCloud2", "ros1msg", b"", "ros1", messages)}
    write_mcap(tmp_path / "a.mcap", topics)
    for frame, rows in zip(open_recording(tmp_path / "a.mcap"), TABLES, strict=True):
        same(frame, rows)


KINDS = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_every_type_of_field_in_either_order(tmp_path, kind, big):
    whole = kind[0] in "iu"
    of = np.dtype([("t", "<u4"), ("z", "<" + kind), ("gap", "u1", 3), ("y", "<" + kind),
                   ("X", "<" + kind), ("Reflectivity", "<" + kind), ("channel", "u1")])  # fmt: skip
    rows = table(3, 50, of)
    for name in ("X", "y", "z"):
        rows[name] = np.arange(1, 51) if whole else np.linspace(-3, 3, 50)
    messages = [(0, ros_cloud(ROS2, rows, big=big, row_step=of.itemsize * 50 + 7))]
    write_ros2(tmp_path / "bag", {"/a": (CLOUD, None, messages)})
    frame = open_recording(tmp_path / "bag").read(0)
    expected = np.column_stack([rows[name].astype(float) for name in ("X", "y", "z")])
    np.testing.assert_array_equal(frame.points, expected)
    np.testing.assert_array_equal(frame.intensity, rows["Reflectivity"])
    np.testing.assert_array_equal(frame.ring, rows["channel"])
    np.testing.assert_allclose(frame.time_s, np.linspace(0, 0.1, 50), atol=1e-9)


def test_an_image_of_points_with_rows_that_are_filled_up(tmp_path):
    of = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("signal", "<u2")])
    rows = table(1, 16 * 64, of)
    message = ros_cloud(ROS1, rows, height=16, row_step=64 * of.itemsize + 24)
    write_ros1(tmp_path / "a.bag", {"/a": (CLOUD, None, [(0, message)])})
    frame = open_recording(tmp_path / "a.bag").read(0)
    np.testing.assert_array_equal(frame.points[:, 2], rows["z"].astype(float))
    np.testing.assert_array_equal(frame.ring, np.repeat(np.arange(16), 64))
    np.testing.assert_array_equal(frame.column, np.tile(np.arange(64), 16))


def test_points_that_are_none_are_left_out(tmp_path):
    rows = table(1)
    rows["x"][:7] = np.nan
    for axis in "xyz":
        rows[axis][7:10] = 0
    write_ros2(tmp_path / "bag", {"/a": (CLOUD, None, [(0, ros_cloud(ROS2, rows))])})
    frame = open_recording(tmp_path / "bag").read(0)
    assert (frame.not_finite, frame.no_return, len(frame.points)) == (7, 3, 290)


@pytest.mark.parametrize("packed", [False, True])
def test_foxglove_poses_are_applied(tmp_path, packed):
    """The pose is where the points' own frame is ("PointCloud schema": pose)."""
    rows = table(2)
    half = math.radians(90) / 2
    place, turn = (1.0, 2.0, 3.0), (0.0, 0.0, math.sin(half), math.cos(half))
    if packed:
        kind, data = PROTOBUF, foxglove_protobuf(rows, position=place, orientation=turn)
    else:
        pose = {
            "position": dict(zip("xyz", place, strict=True)),
            "orientation": dict(zip("xyzw", turn, strict=True)),
        }
        kind, data = POINT_CLOUD, foxglove_json(rows, pose=pose)
    write_mcap(tmp_path / "a.mcap", {"points": (*kind, [(0, data)])})
    frame = open_recording(tmp_path / "a.mcap").read(0)
    turned = np.column_stack([-rows["y"], rows["x"], rows["z"]]).astype(float)
    np.testing.assert_allclose(frame.points, turned + place, atol=1e-9)
    np.testing.assert_array_equal(frame.sensor_places, [place])


def static_transforms(*links):
    """Return messages of parent, child, place and heading (degrees)."""
    kinds = ROS2.types
    found = []
    for parent, child, place, heading in links:
        half = math.radians(heading) / 2
        turn = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(half), math.cos(half))
        moved = kinds["geometry_msgs/msg/Vector3"](*map(float, place))
        there = kinds["geometry_msgs/msg/Transform"](moved, turn)
        stamped = kinds["geometry_msgs/msg/TransformStamped"]
        found.append(stamped(header(ROS2, frame_id=parent), child, there))
    return [(k, kinds["tf2_msgs/msg/TFMessage"]([one])) for k, one in enumerate(found)]


def test_where_the_frame_of_the_points_is(tmp_path):
    links = [("mast", "/os_lidar", (0, 0, 1), 90), ("map", "mast", (10, 5, 2), 90)]
    topics = {
        "/points": (CLOUD, None, [(SECOND, ros_cloud(ROS2, TABLES[0]))]),
        "/tf_static": ("tf2_msgs/msg/TFMessage", None, static_transforms(*links)),
    }
    write_ros2(tmp_path / "bag", topics)
    recording = open_recording(tmp_path / "bag")
    note, checked = recording.notes
    assert "not on real files" in checked
    assert "in map at x 10.000, y 5.000, z 3.000 m, yaw 180.00, pitch 0.00, roll 0.00" in note
    same(recording.read(0), TABLES[0])  # and they stay as they are
    # Transforms of other frames, and some that go round in circles, say nothing.
    for links in ([("map", "camera", (0, 0, 1), 0)], [("b", "a", (0, 0, 1), 0)]):
        topics["/tf_static"] = ("tf2_msgs/msg/TFMessage", None, static_transforms(*links))
        write_ros2(tmp_path / f"bag {links[0][0]}", topics)
        assert open_recording(tmp_path / f"bag {links[0][0]}").notes == (checked,)


def test_of_several_topics_one_is_chosen(tmp_path):
    text = ROS1.types["std_msgs/msg/String"]("hello")
    topics = {
        "/front/points": (CLOUD, None, [(k, ros_cloud(ROS1, TABLES[k])) for k in range(3)]),
        "/rear/points": (CLOUD, None, [(9, ros_cloud(ROS1, TABLES[3]))] * 2),
        "/empty": (CLOUD, None, []),
        "/said": ("std_msgs/msg/String", None, [(0, text)]),
    }
    path = tmp_path / "a.bag"
    write_ros1(path, topics)
    with pytest.raises(InputError) as raised:
        open_recording(path)
    line = str(raised.value)
    assert "a.bag: has 2 topics of clouds" in line
    assert "/front/points (sensor_msgs/msg/PointCloud2, 3)" in line
    assert "as a.bag:/front/points" in line
    for choice in ("/rear/points", "rear/points"):
        recording = open_recording(Path(f"{path}:{choice}"))
        assert recording.names == ("9", "9-1")  # two messages of one time
        same(recording.read(1), TABLES[3])
    with pytest.raises(InputError, match=r"has std_msgs/msg/String on /said, which is not read"):
        open_recording(Path(f"{path}:/said"))
    with pytest.raises(InputError, match=r"no messages on /empty; expected /front/points"):
        open_recording(Path(f"{path}:/empty"))
    write_ros1(path.with_name("b.bag"), {"/said": topics["/said"]})
    with pytest.raises(InputError, match=r"holds no clouds.*/said \(std_msgs/msg/String, 1\)"):
        open_recording(path.with_name("b.bag"))


FOXGLOVE_MSGS = """\
builtin_interfaces/Time timestamp
string frame_id
geometry_msgs/Pose pose
uint32 point_stride
foxglove_msgs/PackedElementField[] fields
uint8[] data
{}
MSG: foxglove_msgs/PackedElementField
string name
uint32 offset
uint8 type
""".format("=" * 80)


def test_foxglove_clouds_in_ros2(tmp_path):
    """`foxglove_msgs` are ROS's form of the same schema; the file defines them."""
    rows, kind = TABLES[0], "foxglove_msgs/msg/PointCloud"

    def cloud(types):
        known = types.types
        field = known["foxglove_msgs/msg/PackedElementField"]
        fields = [field(n, o, OF_FOXGLOVE[k.str[1:]]) for n, (k, o) in rows.dtype.fields.items()]
        pose = known["geometry_msgs/msg/Pose"](
            known["geometry_msgs/msg/Point"](0.0, 0.0, 0.0),
            known["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        )
        time, data = known["builtin_interfaces/msg/Time"](1, 0), np.frombuffer(rows.tobytes(), "u1")
        return known[kind](time, "lidar", pose, 32, fields, data)

    for storage in ("SQLITE3", "MCAP"):
        topics = {"/a": (kind, FOXGLOVE_MSGS, [(5, cloud)])}
        write_ros2(tmp_path / storage, topics, storage=storage)
        same(open_recording(tmp_path / storage).read(0), rows)


def test_an_mcap_that_was_cut(tmp_path):
    """As a recorder leaves it that was killed: without summary, the last chunk in pieces."""
    messages = [(k * SECOND, foxglove_json(one)) for k, one in enumerate(TABLES)]
    path = tmp_path / "a.mcap"
    write_mcap(path, {"points": (*POINT_CLOUD, messages)}, chunk_size=1)
    data = path.read_bytes()
    fourth = [at for at, _ in chunks(data)][3]
    path.write_bytes(data[: fourth + 500])
    recording = open_recording(path)
    assert f"cut at byte {fourth}" in recording.notes[0]
    for frame, rows in zip(recording, TABLES[:3], strict=True):
        same(frame, rows)
    path.write_bytes(data[:60])
    with pytest.raises(InputError, match=r"a\.mcap: was cut"):
        open_recording(path)


def chunks(data):
    """Return byte and length of the chunks of an MCAP."""
    at = 8
    while at + 9 <= len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        if kind == 6:
            yield at, length
        at += 9 + length


def test_a_damaged_chunk_is_named(tmp_path):
    messages = [(k * SECOND, foxglove_json(one)) for k, one in enumerate(TABLES)]
    for packed in CompressionType:
        path = tmp_path / f"{packed.name}.mcap"
        write_mcap(path, {"points": (*POINT_CLOUD, messages)}, chunk_size=1, compression=packed)
        data = bytearray(path.read_bytes())
        at, length = list(chunks(data))[2]
        data[at + length // 2] ^= 0xFF
        path.write_bytes(data)
        recording = open_recording(path)
        with pytest.raises(InputError, match=rf"{packed.name}\.mcap: the chunk at byte {at}: "):
            recording.read(2)
        same(recording.read(3), TABLES[3])
    path = ros1_bag(tmp_path, "LZ4")
    data = bytearray(path.read_bytes())
    at = data.index(b"compression=lz4") + 3000
    data[at : at + 4] = b"\xff\0\xff\0"
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"a\.bag: the chunk at byte \d+: "):
        open_recording(path).read(0)


def bag_of(tmp_path, message):
    write_ros2(tmp_path / "bag", {"/a": (CLOUD, None, [(7, message)])})
    return open_recording(tmp_path / "bag")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"point_step": 12}, r"field intensity at bytes 16 to 20 of points of 12"),
        ({"point_step": 0}, r"points of 0 bytes"),
        ({"width": 2**31, "height": 2**31}, r"says 2147483648 times 2147483648 points"),
        ({"width": 301}, r"says 1 times 301 points of 32 bytes.*has 9600 bytes"),
        ({"height": 2, "row_step": 100}, r"in rows of 100"),
    ],
)
def test_a_cloud_that_cannot_be(tmp_path, changed, said):
    message = ros_cloud(ROS2, TABLES[0])
    for name, value in changed.items():
        setattr(message, name, value)
    recording = bag_of(tmp_path, message)
    with pytest.raises(InputError, match=rf"/a at 7 ns: .*{said}"):
        recording.read(0)


def test_fields_that_are_none(tmp_path):
    message = ros_cloud(ROS2, TABLES[0])
    message.fields[1].datatype = 9
    with pytest.raises(InputError, match=r"field of type 9, which is unknown"):
        bag_of(tmp_path, message).read(0)
    message = ros_cloud(ROS2, TABLES[0])
    message.fields[0].name = "u"
    (tmp_path / "b").mkdir()
    with pytest.raises(InputError, match=r"has no field x; expected x, y, z among u, y, z"):
        bag_of(tmp_path / "b", message).read(0)


def test_bad_files(tmp_path):
    path = ros1_bag(tmp_path, "BZ2")
    data = path.read_bytes()
    for kept, said in ((len(data) // 2, "index looks damaged"), (40, "not readable"), (0, "empty")):
        path.write_bytes(data[:kept])
        with pytest.raises(InputError, match=rf"a\.bag: .*{said}"):
            open_recording(path)
    path = ros2_bag(tmp_path, "SQLITE3") / "bag.db3"
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"bag\.db3: .*malformed"):
        list(open_recording(path))
    path.write_bytes(b"SQLite format 3\0" + bytes(100))
    with pytest.raises(InputError, match=r"bag\.db3: "):
        open_recording(path)
    path.unlink()
    with pytest.raises(InputError, match=r"bag: bag\.db3 is missing"):
        open_recording(path.parent)
    (tmp_path / "b.mcap").write_bytes(b"no MCAP at all")
    with pytest.raises(InputError, match=r"b\.mcap: is not an MCAP file"):
        open_recording(tmp_path / "b.mcap")
    messages = [(0, b"1234")]
    write_mcap(tmp_path / "b.mcap", {"/a": ("foxglove.PointCloud", "x", b"", "cbor", messages)})
    with pytest.raises(InputError, match=r"is encoded as cbor, which is unknown; expected ros1"):
        open_recording(tmp_path / "b.mcap").read(0)
    write_mcap(tmp_path / "b.mcap", {"/a": ("nobody.Knows", "x", b"", "protobuf", messages)})
    with pytest.raises(InputError, match=r"holds no clouds.*/a \(nobody\.Knows, 1\)"):
        open_recording(tmp_path / "b.mcap")
    write_mcap(tmp_path / "b.mcap", {"/a": ("foxglove.PointCloud", "x", b"", "protobuf", messages)})
    with pytest.raises(InputError, match=r"b\.mcap: /a at 0 ns: is not readable"):
        open_recording(tmp_path / "b.mcap").read(0)
    (tmp_path / "c").mkdir()
    for name in ("1.mcap", "2.mcap"):
        (tmp_path / "c" / name).write_bytes((tmp_path / "b.mcap").read_bytes())
    with pytest.raises(InputError, match=r"2 files of messages.*1\.mcap, 2\.mcap"):
        open_recording(tmp_path / "c")
