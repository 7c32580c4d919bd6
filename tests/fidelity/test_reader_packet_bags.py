"""Bags with the packets of a LiDAR: the points are those of a capture of the same packets."""

import sqlite3
import struct
from contextlib import closing

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.readers import open_recording
from urbantwin.io.packets.pcap import datagrams_in, mapped

from .bag_files import ROS1, header, write_ros1, write_ros2
from .lidar_packets import hesai_turns, write_pcap
from .test_reader_velodyne import turning

VELODYNE_SCAN = (
    "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets\n"
    + "=" * 80
    + ("\nMSG: velodyne_msgs/VelodynePacket\n{time} stamp\nuint8[1206] data\n")
)
#: Messages of Hesai's packets: fields of one, and whether packets are filled up.
OF_HESAI = {
    "pandar_msgs/PandarScan": ("{time} stamp\nuint8[1500] data\nuint32 size", True),
    "nebula_msgs/NebulaPackets": ("{time} stamp\nuint8[] data", False),
    "hesai_ros_driver/UdpFrame": ("uint8[] data\nuint32 size", False),
}


def test_a_bag_of_velodyne_packets(tmp_path):
    packets, *_ = turning("VLP-16", turns=2.3)
    write_pcap(tmp_path / "a.pcap", packets)
    captured = open_recording(tmp_path / "a.pcap").read(0)
    first = next(k for k, one in enumerate(packets) if captured_from(packets, k))
    some = packets[first : first + 76]

    def scan(types):
        time = types.types["builtin_interfaces/msg/Time"]
        one = types.types["velodyne_msgs/msg/VelodynePacket"]
        return types.types["velodyne_msgs/msg/VelodyneScan"](
            header(types),
            [
                one(time(int(t), round(t % 1 * 1e9)), np.frombuffer(p, np.uint8))
                for p, t, *_ in some
            ],
        )

    kind = "velodyne_msgs/msg/VelodyneScan"
    write_ros1(
        tmp_path / "a.bag",
        {"/velodyne_packets": (kind, VELODYNE_SCAN.format(time="time"), [(5, scan)])},
    )
    definition = VELODYNE_SCAN.format(time="builtin_interfaces/Time")
    for storage in ("SQLITE3", "MCAP"):
        topics = {"/velodyne_packets": (kind, definition, [(5, scan)])}
        write_ros2(tmp_path / storage, topics, storage=storage)
    for name in ("a.bag", "SQLITE3", "MCAP"):
        frame = open_recording(tmp_path / name).read(0)
        count = min(len(frame.points), len(captured.points))
        assert count > 20_000
        np.testing.assert_array_equal(frame.points[:count], captured.points[:count])
        np.testing.assert_array_equal(frame.ring[:count], captured.ring[:count])


def captured_from(packets, index):
    """Return whether a packet is the first of a turn."""
    azimuth = [struct.unpack_from("<H", packets[k][0], 2)[0] for k in (index - 1, index)]
    return index > 0 and azimuth[1] < azimuth[0]


@pytest.mark.parametrize("kind", OF_HESAI)
def test_a_bag_of_hesai_packets(tmp_path, kind):
    packets, *_ = hesai_turns("OT128", 128, 2, columns=180, turns=1.0, start=0.0)
    write_pcap(tmp_path / "a.pcap", packets)
    captured = open_recording(tmp_path / "a.pcap:OT128").read(0)
    fields, filled = OF_HESAI[kind]
    package, name = kind.split("/")
    packet = "PandarPacket" if name == "PandarScan" else "Packet"

    def scan(types):
        time = types.types["builtin_interfaces/msg/Time"]
        one = types.types[f"{package}/msg/{packet}"]
        parts = [np.frombuffer(some.ljust(1500 * filled, b"\0"), np.uint8) for some in packets]
        known = [
            ({"stamp": time(0, 0)} if "stamp" in fields else {})
            | ({"size": len(some)} if "size" in fields else {})
            for some in packets
        ]
        made = [one(data=part, **more) for part, more in zip(parts, known, strict=True)]
        return types.types[f"{package}/msg/{name}"](header(types), made)

    definition = f"std_msgs/Header header\n{package}/{packet}[] packets\n{'=' * 80}\n" + (
        f"MSG: {package}/{packet}\n" + fields.format(time="builtin_interfaces/Time")
    )
    write_ros2(tmp_path / "bag", {"/packets": (f"{package}/msg/{name}", definition, [(5, scan)])})
    with closing(sqlite3.connect(tmp_path / "bag" / "bag.db3")) as database, database:
        database.execute("DELETE FROM message_definitions")  # as before ROS 2 Iron
    with pytest.raises(InputError, match=r"alike.*bag.*:/packets:Pandar128 to say"):
        open_recording(tmp_path / "bag")
    frame = open_recording(tmp_path / "bag:/packets:OT128").read(0)
    np.testing.assert_array_equal(frame.points, captured.points)
    np.testing.assert_allclose(frame.time_s, captured.time_s)


LIVOX = """\
std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
{package}/CustomPoint[] points
{line}
MSG: {package}/CustomPoint
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""


@pytest.mark.parametrize("defined", [False, True])
@pytest.mark.parametrize("package", ["livox_ros_driver", "livox_ros_driver2"])
def test_clouds_of_livox(tmp_path, package, defined):
    rng = np.random.default_rng(0)
    points = rng.normal(0, 20, (200, 3)).astype(np.float32)

    def cloud(types):
        one = types.types[f"{package}/msg/CustomPoint"]
        rows = [
            one(k * 500_000, *map(float, xyz), k % 256, 16, k % 6) for k, xyz in enumerate(points)
        ]
        kind = types.types[f"{package}/msg/CustomMsg"]
        return kind(header(types), 7, 200, 1, np.zeros(3, np.uint8), rows)

    definition = LIVOX.format(package=package, line="=" * 80)
    topics = {"/livox/lidar": (f"{package}/msg/CustomMsg", definition, [(5, cloud)])}
    write_ros2(tmp_path / "bag", topics)
    if not defined:
        with closing(sqlite3.connect(tmp_path / "bag" / "bag.db3")) as database, database:
            database.execute("DELETE FROM message_definitions")
    write_ros1(tmp_path / "a.bag", topics)
    for name in ("bag", "a.bag"):
        frame = open_recording(tmp_path / name).read(0)
        np.testing.assert_array_equal(frame.points, points.astype(float))
        np.testing.assert_array_equal(frame.intensity, np.arange(200))
        np.testing.assert_array_equal(frame.ring, np.arange(200) % 6)
        np.testing.assert_allclose(frame.time_s, np.arange(200) * 5e-4, atol=1e-9)


def test_packets_of_a_real_ouster(tmp_path, shared_data):
    """The same packets, message by message, as ``ouster_ros`` records them: the same frames."""
    folder = shared_data / "lidar/ouster-os1-128"
    capture, metadata = next(folder.glob("*.pcap")), next(folder.glob("*.json"))
    captured = open_recording(capture)
    with mapped(capture) as data:
        payloads = [
            b"".join(bytes(data[begin:end]) for begin, end in one.parts)
            for one in datagrams_in(capture, data)
        ]

    def packets(some, package):
        def message(payload):
            return lambda types: types.types[f"{package}/msg/PacketMsg"](
                np.frombuffer(payload, np.uint8)
            )

        rows = [(1000 + k, message(one)) for k, one in enumerate(some)]
        return (f"{package}/msg/PacketMsg", "uint8[] buf\n", rows)

    told = ROS1.types["std_msgs/msg/String"](metadata.read_text())
    topics = {
        "/os/lidar_packets": packets(payloads, "ouster_ros"),
        "/os/imu_packets": packets([bytes(48)] * 3, "ouster_ros"),
        "/os/metadata": ("std_msgs/msg/String", None, [(0, told)]),
    }
    write_ros1(tmp_path / "a.bag", topics)
    del topics["/os/metadata"]
    write_ros1(tmp_path / "b.bag", topics)
    topics = {"/os/lidar_packets": packets(payloads, "ouster_sensor_msgs")}
    write_ros2(tmp_path / "bag", topics, storage="MCAP", packed="STORAGE")
    for name in ("b.bag", "bag"):
        with pytest.raises(InputError, match=r"no topic of metadata, and no JSON beside it"):
            open_recording(tmp_path / name)
    for place in (tmp_path, tmp_path / "bag"):
        (place / metadata.name).write_bytes(metadata.read_bytes())
    for name in ("a.bag", "b.bag", "bag", "a.bag:/os/lidar_packets"):
        recording = open_recording(tmp_path / name)
        assert recording.names == captured.names
        ours, theirs = recording.read(1), captured.read(1)
        np.testing.assert_array_equal(ours.points, theirs.points)
        np.testing.assert_array_equal(ours.time_s, theirs.time_s)
    with pytest.raises(InputError, match=r"no packet of 8448 bytes"):
        open_recording(tmp_path / "a.bag:/os/imu_packets")
