"""A small sound recording of every layout that is read: the content of its files by name."""

import io
import json
import struct
import tarfile
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
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


def parquet(columns: dict[str, object]) -> bytes:
    stream = pa.BufferOutputStream()
    pq.write_table(pa.table(columns), stream, compression="brotli", row_group_size=1)
    return stream.getvalue().to_pybytes()


def waymo() -> dict[str, bytes]:
    """Two frames of one laser of three beams, with the vehicle's pose at every pixel."""
    times = [1552440195362591, 1552440195462592]
    keys = {"key.segment_context_name": ["s"] * 2, "key.frame_timestamp_micros": times}
    top = {"key.laser_name": pa.array([1, 1], pa.int8())}

    def images(name: str, image: np.ndarray, kind: pa.DataType) -> dict[str, object]:
        lists = pa.list_(pa.int32(), 3)
        return {
            f"{name}.values": pa.array([image.ravel()] * 2, pa.list_(kind)),
            f"{name}.shape": pa.array([list(image.shape)] * 2, lists),
        }

    matrix = np.eye(4)
    matrix[:3, 3] = 3.0, 4.0, 1.0
    one = pa.array([matrix.ravel()], pa.list_(pa.float64(), 16))
    seen = np.dstack([rng.uniform(2, 60, (3, 12)), *([np.ones((3, 12))] * 2), -np.ones((3, 12))])
    sides = {"center.x": 12.0, "center.y": 3.0, "center.z": 1.0, "size.x": 4.6, "size.y": 1.9,
             "size.z": 1.5, "heading": 0.4}  # fmt: skip
    box, beams = "[LiDARBoxComponent].", "[LiDARCalibrationComponent].beam_inclination."
    return {
        "lidar/s.parquet": parquet(
            {**keys, **top, **images("[LiDARComponent].range_image_return1", seen, pa.float32())}
        ),
        "lidar_pose/s.parquet": parquet(
            {
                **keys, **top,
                **images(
                    "[LiDARPoseComponent].range_image_return1",
                    np.full((3, 12, 6), 0.1),
                    pa.float32(),
                ),
            }
        ),
        "lidar_segmentation/s.parquet": parquet(
            {
                **keys, **top,
                **images(
                    "[LiDARSegmentationLabelComponent].range_image_return1",
                    np.full((3, 12, 2), 7),
                    pa.int32(),
                ),
            }
        ),
        "lidar_calibration/s.parquet": parquet(
            {
                "key.segment_context_name": ["s"],
                "key.laser_name": pa.array([1], pa.int8()),
                "[LiDARCalibrationComponent].extrinsic.transform": one,
                f"{beams}min": [-0.3],
                f"{beams}max": [0.1],
                f"{beams}values": [[-0.3, -0.1, 0.1]],
            }
        ),
        "vehicle_pose/s.parquet": parquet(
            {
                **keys,
                "[VehiclePoseComponent].world_from_vehicle.transform": pa.concat_arrays([one] * 2),
            }
        ),
        "lidar_box/s.parquet": parquet(
            {
                **keys,
                "key.laser_object_id": ["a", "b"],
                **{f"{box}box.{name}": [value] * 2 for name, value in sides.items()},
                **{f"{box}speed.{axis}": [1.0, None] for axis in "xyz"},
                f"{box}type": pa.array([1, 2], pa.int8()),
                f"{box}num_lidar_points_in_box": [7, 0],
            }
        ),
    }  # fmt: skip


def once() -> dict[str, bytes]:
    box = [12.0, 3.0, -4.1, 4.6, 1.9, 1.5, 0.4]
    annos = {"names": ["Car", "Bus"], "boxes_3d": [box, box]}
    pose = [0.0, 0.0, 0.6, 0.8, 3.0, 4.0, 1.0]
    frame = {"frame_id": "1616003433400", "pose": pose, "annos": annos}
    later = {"frame_id": "1616003433900", "pose": pose}
    return {
        "lidar_roof/1616003433400.bin": ROWS.tobytes(),
        "recording.json": text({"frames": [frame, later]}),
    }


def ips300() -> dict[str, bytes]:
    box = {
        "label": "Minibus",
        "center": {"x": 12.0, "y": 3.0, "z": -4.1},
        "dimensions": {"length": 4.6, "width": 1.9, "height": 1.5},
        "rotation": {"x": 0, "y": 0, "z": 0.4},
    }
    line = b"cyclist 0 0 0 1 2 3 4 5 6 7 8 1.5 0.8 1.8 12.0 3.0 -4.1 0.4\n"
    return {
        "data/PCD_COM_ROI/000000_COM_ROI.pcd": pcd(),
        "data/PCD_COM_ROI/000001_COM_ROI.pcd": pcd("ascii"),
        "label/json/000000_LABEL.json": text({"objects": [box, box]}),
        "label/txt/000001_LABEL.txt": line * 2,
    }


def a9() -> dict[str, bytes]:
    box = {
        "dimension": {"length": 4.6, "width": 1.9, "height": 1.5},
        "location": {"x": 12.0, "y": 3.0, "z": -4.1},
        "orientation": {"rotationYaw": 0.4},
    }
    labels = {"labels": [{"id": 1, "category": "CAR", "box3d": box}]}
    return {"_points/1.pcd": pcd(), "_labels/1.json": text(labels)}


def v2v4real() -> dict[str, bytes]:
    vehicle = {
        "location": [12.0, 3.0, -4.0], "center": [0.0, 0.0, 0.0], "extent": [2.3, 0.9, 0.7],
        "angle": [0.0, 30.0, 0.0], "obj_type": "Car", "ass_id": 4,
    }  # fmt: skip
    pose = [[0.8, -0.6, 0.0, 1.0], [0.6, 0.8, 0.0, 2.0], [0.0, 0.0, 1.0, 5.0], [0.0, 0.0, 0.0, 1.0]]
    told = {"lidar_pose": pose, "vehicles": {17: vehicle}}
    return {"0/000001.pcd": pcd(), "0/000001.yaml": yaml.safe_dump(told).encode()}


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


def kitti_tracking() -> dict[str, bytes]:
    label = b"0 3 Car 0 0 -0.2 1 2 3 4 1.5 1.9 4.6 3.0 5.0 12.0 -1.2\n"
    calibration = f"P2: {TWELVE}\nR_rect 1 0 0 0 1 0 0 0 1\nTr_velo_cam {TWELVE}\n"
    return {
        "velodyne/0004/000000.bin": ROWS.tobytes(),
        "label_02/0004.txt": label,
        "calib/0004.txt": calibration.encode(),
    }


def kitti_raw() -> dict[str, bytes]:
    pose = "".join(f"<{name}>2</{name}>" for name in ("tx", "ty", "tz", "rz", "occlusion"))
    tracklet = (
        "<item><objectType>Car</objectType><h>1.5</h><w>1.9</w><l>4.6</l>"
        f"<first_frame>0</first_frame><poses><item>{pose}</item></poses></item>"
    )
    return {
        "velodyne_points/data/0000000000.bin": ROWS.tobytes(),
        "tracklet_labels.xml": (
            f"<boost_serialization><tracklets>{tracklet}</tracklets></boost_serialization>"
        ).encode(),
        "oxts/data/0000000000.txt": b"49.0 8.4 115.1 0.01 0.02 0.3 0 0 0\n",
        "calib_imu_to_velo.txt": b"calib_time: 1\nR: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n",
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
    known = {
        "num": [{"name": "num_points", "val": 7}, {"name": "occlusion", "val": 0.2}],
        "text": [{"name": "ignored", "val": "far"}],
        "vec": [{"name": "velocity", "val": [1.0, 0.5, 0.0]}],
    }
    other = {"object_data": {"cuboid": [{**cuboid, "attributes": known}]}}
    labels = {"openlabel": {"frames": {"17": {"objects": {"uuid": one, "40001": other}}}}}
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
    person = {**vehicle, "obj_type": "", "class": "pedestrian"}
    told = {"lidar_pose": [1.0, 2.0, 5.0, 0.0, 90.0, 0.0], "vehicles": {17: vehicle}}
    told["pedestrians"] = {18: person}
    return {"0/000001.pcd": pcd("ascii"), "0/000001.yaml": yaml.safe_dump(told).encode()}


def lumpi() -> dict[str, bytes]:
    line = b"0.1,17,0,0,0,0,0.9,1,50,12.0,3.0,-4.1,4.6,1.9,1.5,0.4\n"
    identity = ply().replace(b"property float intensity", b"property float id")
    sessions = {"7": {"type": "lidar", "experimentId": 0}, "9": {"type": "camera"}}
    return {
        "lidar/000001.ply": ply(),
        "lidar/000002.ply": identity,
        "Label.csv": line * 2,
        "meta.json": text({"session": sessions}),
    }


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


def webdataset() -> dict[str, bytes]:
    """A shard of two frames, as `urbantwin export` writes them."""
    box = {"track": 1, "class": "car", "num_points": 9, "occlusion": None, "ignored": None}
    box |= dict.fromkeys(("x", "y", "z", "length", "width", "height", "yaw", "vx", "vy", "vz"), 1.5)
    rays = np.zeros(len(ROWS), [("sensor", "u1"), ("ring", "<u2"), ("time", "<f4")])
    stream = io.BytesIO()
    with tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as shard:
        for name in ("000000", "000001"):
            files = {
                "points.npy": npy(ROWS),
                "semantic.npy": npy(np.full(len(ROWS), 40, np.uint16)),
                "rays.npy": npy(rays),
                "boxes.json": text([box]),
                "json": text(
                    {
                        "site_SE3_frame": np.eye(4).tolist(),
                        "site_SE3_sensors": {"pole": np.eye(4).tolist()},
                    }
                ),
            }
            for kind, content in files.items():
                told = tarfile.TarInfo(f"{name}.{kind}")
                told.size = len(content)
                shard.addfile(told, io.BytesIO(content))
    return {"train-000000.tar": stream.getvalue()}


def npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def listed_clouds() -> dict[str, bytes]:
    """Two clouds, with the lists of boxes and of frames that `urbantwin export` writes beside."""
    boxes = "frame,track,class,x,y,z,length,width,height,yaw,vx,vy,vz,num_points,occlusion,ignore\n"
    boxes += "000000,3,car,1,2,0.5,4.2,1.8,1.5,0.3,1,0,0,7,,0\n"
    frames = "frame,time_s,part,of,x,y,z,qw,qx,qy,qz\n"
    for name in ("000000", "000001"):
        frames += f"{name},0.5,train,frame,1,2,3,0.8,0,0,0.6\n{name},0.5,train,pole,1,2,6,1,0,0,0\n"
    return {
        "000000.pcd": pcd(),
        "000001.pcd": pcd(),
        "boxes.csv": boxes.encode(),
        "frames.csv": frames.encode(),
    }


RECORDINGS = {
    "argoverse2": argoverse(),
    "waymo2": waymo(),
    "nuscenes": nuscenes(),
    "kitti": kitti(),
    "kitti-tracking": kitti_tracking(),
    "kitti-raw": kitti_raw(),
    "semantic-kitti": semantic_kitti(),
    "tumtraf": tumtraf(),
    "dair-v2x": dair(),
    "opencood": opencood(),
    "lumpi": lumpi(),
    "ouster": ouster(),
    "webdataset": webdataset(),
    "plain": listed_clouds(),
    "once": once(),
    "ips300": ips300(),
    "tumtraf, first release": a9(),
    "opencood, V2V4Real": v2v4real(),
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
