"""A small sound recording of every layout that is read: the content of its files by name."""

import io
import json
import struct
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import yaml
from pyarrow import feather

from ..fidelity.bag_files import (
    CLOUD,
    ROS1,
    ROS2,
    foxglove_json,
    foxglove_protobuf,
    foxglove_schema,
    ros_cloud,
    write_mcap,
    write_ros1,
    write_ros2,
)
from ..fidelity.lidar_packets import (
    VELODYNE,
    hesai_turns,
    velodyne_packet,
    write_pcap,
    write_pcapng,
)

__all__ = ["RECORDINGS", "pcd", "ply"]

rng = np.random.default_rng(5)
#: Four hundred points around a sensor 5 m above a street, and their intensity.
POINTS = np.column_stack([rng.uniform(-30, 30, (400, 2)), rng.normal(-5, 0.3, 400)])
LIGHT = rng.integers(1, 255, len(POINTS)).astype(np.float32)
ROWS = np.column_stack([POINTS, LIGHT]).astype("<f4")
TURN = {"qw": 0.8, "qx": 0.0, "qy": 0.0, "qz": 0.6}
PLACE = {"tx_m": 3.0, "ty_m": 4.0, "tz_m": 1.0}
TIME_NS = 315966265259836000
POSE = {"rotation": [0.8, 0.0, 0.0, 0.6], "translation": [3.0, 4.0, 1.0]}
TWELVE = "0 -1 0 0.1 0 0 -1 0.2 1 0 0 0.3"


def text(value: object) -> bytes:
    return json.dumps(value).encode()


def pcd(kind: str = "binary") -> bytes:
    head = (
        "VERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(ROWS)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(ROWS)}\nDATA {kind}\n"
    ).encode()
    if kind == "ascii":
        lines = io.BytesIO()
        np.savetxt(lines, ROWS, "%.6g")
        return head + lines.getvalue()
    if kind == "binary":
        return head + ROWS.tobytes()
    raw = ROWS.T.tobytes()
    runs = [raw[at : at + 32] for at in range(0, len(raw), 32)]
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    return head + struct.pack("<II", len(packed), len(raw)) + packed


def ply(kind: str = "binary_little_endian") -> bytes:
    head = (
        f"ply\nformat {kind} 1.0\nelement vertex {len(ROWS)}\n"
        + "".join(f"property float {name}\n" for name in ("x", "y", "z", "intensity"))
        + "end_header\n"
    ).encode()
    if kind == "ascii":
        lines = io.BytesIO()
        np.savetxt(lines, ROWS, "%.6g")
        return head + lines.getvalue()
    return head + ROWS.tobytes()


def table(columns: dict[str, object]) -> bytes:
    stream = pa.BufferOutputStream()
    feather.write_feather(pa.table(columns), stream)
    return stream.getvalue().to_pybytes()


def repeated(values: dict[str, float], times: int) -> dict[str, list[float]]:
    return {name: [value] * times for name, value in values.items()}


def argoverse() -> dict[str, bytes]:
    sizes = {"length_m": 4.6, "width_m": 1.9, "height_m": 1.5}
    return {
        f"sensors/lidar/{TIME_NS}.feather": table(
            {
                **dict(zip("xyz", POINTS.T.astype(np.float32), strict=True)),
                "intensity": LIGHT.astype(np.uint8),
                "laser_number": (np.arange(len(POINTS)) % 64).astype(np.uint8),
                "offset_ns": np.arange(len(POINTS), dtype=np.int32) * 1000,
            }
        ),
        "city_SE3_egovehicle.feather": table(
            {"timestamp_ns": [TIME_NS], **repeated({**TURN, **PLACE}, 1)}
        ),
        "calibration/egovehicle_SE3_sensor.feather": table(
            {"sensor_name": ["up_lidar", "down_lidar"], **repeated({**TURN, **PLACE}, 2)}
        ),
        "annotations.feather": table(
            {
                "timestamp_ns": [TIME_NS],
                "track_uuid": ["u0"],
                "category": ["REGULAR_VEHICLE"],
                **repeated({**sizes, **TURN, **PLACE}, 1),
            }
        ),
    }


def nuscenes() -> dict[str, bytes]:
    name = "samples/LIDAR_TOP/n008__LIDAR_TOP__1531883530449377.pcd.bin"
    rows = {
        "sample_data": {
            "token": "b", "sample_token": "s", "ego_pose_token": "e", "is_key_frame": True,
            "calibrated_sensor_token": "c", "timestamp": 1531883530449377, "filename": name,
        },
        "ego_pose": {"token": "e", **POSE},
        "calibrated_sensor": {"token": "c", **POSE},
        "category": {"token": "k", "name": "vehicle.car"},
        "instance": {"token": "i", "category_token": "k"},
        "sample_annotation": {
            "token": "n", "sample_token": "s", "instance_token": "i", "size": [1.9, 4.6, 1.5],
            **POSE,
        },
    }  # fmt: skip
    ring = (np.arange(len(ROWS)) % 32).astype("<f4")
    return {
        name: np.column_stack([ROWS, ring]).astype("<f4").tobytes(),
        **{f"v1.0-mini/{table}.json": text([row]) for table, row in rows.items()},
    }


def kitti() -> dict[str, bytes]:
    label = b"Car 0.00 0 -0.2 1 2 3 4 1.5 1.9 4.6 3.0 5.0 12.0 -1.2\n"
    calibration = f"P2: {TWELVE}\nR0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: {TWELVE}\n"
    return {
        "velodyne/000007.bin": ROWS.tobytes(),
        "label_2/000007.txt": label * 2,
        "calib/000007.txt": calibration.encode(),
    }


def semantic_kitti() -> dict[str, bytes]:
    return {
        "velodyne/000000.bin": ROWS.tobytes(),
        "labels/000000.label": np.full(len(ROWS), 10 | 1 << 16, "<u4").tobytes(),
        "calib.txt": f"P0: {TWELVE}\nTr: {TWELVE}\n".encode(),
        "poses.txt": b"1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 2\n",
    }


def tumtraf() -> dict[str, bytes]:
    cuboid = {"name": "shape3D", "val": [12.0, 3.0, -4.1, 0.0, 0.0, 0.6, 0.8, 4.6, 1.9, 1.5]}
    one = {"object_data": {"name": "VAN_1", "type": "VAN", "cuboid": cuboid}}
    labels = {"openlabel": {"frames": {"17": {"objects": {"uuid": one}}}}}
    return {
        "point_clouds/south/1.pcd": pcd(),
        "labels_point_clouds/south/1.json": text(labels),
    }


def dair() -> dict[str, bytes]:
    box = {
        "type": "Car", "rotation": 0.4, "track_id": "7",
        "3d_location": {"x": "12.5", "y": "3", "z": "-4.1"},
        "3d_dimensions": {"l": "4.6", "w": "1.9", "h": "1.5"},
    }  # fmt: skip
    pose = {"rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "translation": [[1], [2], [3]]}
    return {
        "velodyne/000001.pcd": pcd("binary_compressed"),
        "label/virtuallidar/000001.json": text([box]),
        "calib/virtuallidar_to_world/000001.json": text(pose),
    }


def opencood() -> dict[str, bytes]:
    vehicle = {
        "location": [12.0, 3.0, -4.0], "center": [0.0, 0.0, 0.7], "extent": [2.3, 0.9, 0.7],
        "angle": [0.0, 30.0, 0.0], "obj_type": "Car",
    }  # fmt: skip
    told = {"lidar_pose": [1.0, 2.0, 5.0, 0.0, 90.0, 0.0], "vehicles": {17: vehicle}}
    return {"0/000001.pcd": pcd("ascii"), "0/000001.yaml": yaml.safe_dump(told).encode()}


def lumpi() -> dict[str, bytes]:
    line = b"0.1,17,0,0,0,0,0.9,1,50,12.0,3.0,-4.1,4.6,1.9,1.5,0.4\n"
    return {"lidar/000001.ply": ply(), "Label.csv": line * 2}


OUSTER = {
    "beam_altitude_angles": [10.0, 0.0, -10.0, -20.0],
    "beam_azimuth_angles": [1.0, 0.0, -1.0, 0.0],
    "columns_per_frame": 64,
    "columns_per_packet": 16,
    "udp_profile_lidar": "RNG15_RFL8_NIR8",
    "lidar_origin_to_beam_origin_mm": 15.8,
}


def ouster_packets():
    """Two turns of a sensor of four channels that sends 64 columns a turn, 16 in a packet."""
    for turn in (1, 2):
        for first in range(0, 64, 16):
            payload = struct.pack("<HH28x", 1, turn)
            for column in range(first, first + 16):
                payload += struct.pack("<QHH", 10**9 + 10**6 * column, column, 1)
                payload += b"".join(struct.pack("<HBB", 900 + row, 40, 7) for row in range(4))
            yield payload + bytes(32)


def ouster() -> dict[str, bytes]:
    files = files_of(lambda path: write_pcap(path, list(ouster_packets())), "a.pcap")
    return files | {"a.json": text(OUSTER)}


def rosbag_of_ouster() -> dict[str, bytes]:
    kind = "ouster_ros/msg/PacketMsg"

    def message(payload):
        return lambda types: types.types[kind](np.frombuffer(payload, np.uint8))

    rows = [(k, message(payload)) for k, payload in enumerate(ouster_packets())]
    topics = {
        "/os/lidar_packets": (kind, "uint8[] buf\n", rows),
        "/os/metadata": ("std_msgs/msg/String", None, [(0, ROS1.types["std_msgs/msg/String"](
            text(OUSTER).decode()))]),
    }  # fmt: skip
    return files_of(lambda path: write_ros1(path, topics), "a.bag")


def files_of(write, name) -> dict[str, bytes]:
    """Return what a library writes: the files by their names."""
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / name)
        files = [path for path in Path(folder).rglob("*") if path.is_file()]
        return {path.name: path.read_bytes() for path in files}


def clouds_of_ros(types):
    rows = np.zeros(len(ROWS), [(name, "<f4") for name in ("x", "y", "z", "intensity")])
    for name, column in zip(rows.dtype.names, ROWS.T, strict=True):
        rows[name] = column
    return {"/points": (CLOUD, None, [(k, ros_cloud(types, rows)) for k in range(2)])}, rows


def rosbag(packed) -> dict[str, bytes]:
    topics, _ = clouds_of_ros(ROS1)
    return files_of(lambda path: write_ros1(path, topics, packed=packed), "a.bag")


def rosbag_of_ros2(storage, packed) -> dict[str, bytes]:
    topics, _ = clouds_of_ros(ROS2)
    return files_of(lambda path: write_ros2(path, topics, storage=storage, packed=packed), "bag")


def mcap() -> dict[str, bytes]:
    """Clouds in JSON; those in protobuf stand in a file of their own."""
    _, rows = clouds_of_ros(ROS2)
    topics = {"a": ("foxglove.PointCloud", "jsonschema", b"{}", "json", [(0, foxglove_json(rows))])}
    return files_of(lambda path: write_mcap(path, topics), "a.mcap")


def mcap_of_protobuf() -> dict[str, bytes]:
    _, rows = clouds_of_ros(ROS2)
    schema = foxglove_schema().SerializeToString()
    message = foxglove_protobuf(rows, position=(1, 2, 3), orientation=(0, 0, 0, 1))
    topics = {"a": ("foxglove.PointCloud", "protobuf", schema, "protobuf", [(0, message)])}
    return files_of(lambda path: write_mcap(path, topics, use_chunking=False), "a.mcap")


def velodyne(write, name, model) -> dict[str, bytes]:
    block = [(900 + k, k) for k in range(32)]
    packets = [
        velodyne_packet((20 * k + np.arange(12)) % 360, [block] * 12, VELODYNE[model])
        for k in range(20)
    ]
    return files_of(lambda path: write(path, packets), name)


def hesai(model, channels, blocks) -> dict[str, bytes]:
    packets, *_ = hesai_turns(model, channels, blocks, columns=24, turns=1.5)
    return files_of(lambda path: write_pcap(path, packets), "a.pcap")


def angles(channels) -> bytes:
    lines = [f"{k + 1},{10 - k / 4},0.5" for k in range(channels)]
    return "\n".join(["Channel,Elevation,Azimuth", *lines]).encode()


RECORDINGS = {
    "argoverse2": argoverse(),
    "nuscenes": nuscenes(),
    "kitti": kitti(),
    "semantic-kitti": semantic_kitti(),
    "tumtraf": tumtraf(),
    "dair-v2x": dair(),
    "opencood": opencood(),
    "lumpi": lumpi(),
    "ouster": ouster(),
    "rosbag": rosbag(None),
    "rosbag of bz2": rosbag("BZ2"),
    "rosbag of lz4": rosbag("LZ4"),
    "rosbag of ROS 2": rosbag_of_ros2("SQLITE3", None),
    "rosbag of ROS 2 packed": rosbag_of_ros2("SQLITE3", "FILE"),
    "rosbag of ROS 2 in MCAP": rosbag_of_ros2("MCAP", "STORAGE"),
    "rosbag of ROS 2 in MCAP packed": rosbag_of_ros2("MCAP", "MESSAGE"),
    "rosbag of an Ouster": rosbag_of_ouster(),
    "mcap": mcap(),
    "mcap of protobuf": mcap_of_protobuf(),
    "velodyne": velodyne(write_pcap, "a.pcap", "VLP-16"),
    "velodyne of 128": velodyne(write_pcapng, "a.pcapng", "VLS-128"),
    "hesai": {**hesai("Pandar40P", 40, 10), "a.csv": angles(40)},
    "hesai of 128": {**hesai("OT128", 128, 2), "a.csv": angles(128)},
    "hesai of 32": hesai("PandarXT-32", 32, 8),
}
