"""A segment of the Waymo Open Dataset v2, written by its development kit's definitions.

Columns, types and order are those of ``waymo_open_dataset/v2``; pyarrow writes them with Brotli, as
the real ones are. Where a pixel looks is written down for the vehicle's frame: the middle of an
image is ahead, whatever way the sensor is turned.
"""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.spatial.transform import Rotation

SEGMENT = "10023947602400723454_1120_000_1140_000"
TIMES = (1552440195362591, 1552440195462592, 1552440195562594)
#: Laser -> turn (yaw, pitch, roll) and place in the vehicle, rows, columns, beams.
TOP = np.linspace(-0.30, 0.04, 8) + 0.004 * np.sin(np.arange(8))
LASERS = {
    1: ((0.3, 0.0, 0.0), (1.43, 0.0, 2.18), 8, 90, TOP),
    2: ((0.0, 0.0, 0.0), (4.07, 0.0, 0.69), 5, 20, (-1.57, 0.52)),
    4: ((-1.55, 0.02, -0.01), (3.24, -1.02, 0.98), 5, 20, (-1.57, 0.52)),
}
random = np.random.default_rng(3)


def matrix(turn, place):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = turn.as_matrix(), place
    return found


def vehicle_at(share):
    """Where the vehicle is, a share of a tenth of a second after the first frame."""
    turn = Rotation.from_euler("ZYX", [1.1 + 0.02 * share, 0.01, 0.0])
    return turn, np.array([-1565.9 + 1.2 * share, 14561.8 + 0.7 * share, -7.9])


def look(laser):
    """Return unit vectors (H, W, 3) in the vehicle's frame of an upright laser's pixels."""
    turn, _, height, width, beams = LASERS[laser]
    assert turn[1:] == (0.0, 0.0)
    if len(beams) == height:
        up = np.array(sorted(beams, reverse=True))
    else:
        step = (beams[1] - beams[0]) / height
        up = np.array([beams[1] - step / 2 - step * row for row in range(height)])
    around = np.array([np.pi - 2 * np.pi * (column + 0.5) / width for column in range(width)])
    return np.stack(
        [
            np.outer(np.cos(up), np.cos(around)),
            np.outer(np.cos(up), np.sin(around)),
            np.outer(np.sin(up), np.ones(width)),
        ],
        axis=-1,
    )


def image(laser, share=0.6):
    """Return a range image (H, W, 4) with pixels that saw nothing, some in a zone."""
    _, _, height, width, _ = LASERS[laser]
    found = np.empty((height, width, 4), np.float32)
    found[..., 0] = random.uniform(2, 75, (height, width))
    found[..., 1] = random.uniform(0, 3, (height, width))
    found[..., 2] = random.uniform(0, 1, (height, width))
    found[..., 3] = np.where(np.arange(width) < width // 10, 1, -1)
    found[random.random((height, width)) > share] = -1
    return found


def pixel_poses(frame, height, width):
    """Return roll, pitch, yaw, x, y, z (H, W, 6) of the vehicle while it turns once."""
    found = np.empty((height, width, 6), np.float32)
    for column in range(width):
        turn, place = vehicle_at(frame + column / width - 0.5)
        found[:, column] = [*turn.as_euler("ZYX")[::-1], *place]
    return found


def write(path, columns, schema=None, group=None):
    path.parent.mkdir(parents=True, exist_ok=True)
    table = pa.table(columns, schema=schema)
    pq.write_table(table, path, compression="brotli", row_group_size=group)


def keys(times, **more):
    return {
        "key.segment_context_name": [SEGMENT] * len(times),
        "key.frame_timestamp_micros": np.array(times, np.int64),
        **more,
    }


def write_images(path, component, rows, returns, group, kind=None):
    columns = keys(
        [time for time, _, _ in rows],
        **{"key.laser_name": np.array([laser for _, laser, _ in rows], np.int8)},
    )
    for k in range(returns):
        found = [images[k] for _, _, images in rows]
        values = [None if one is None else one.ravel() for one in found]
        shapes = [None if one is None else list(one.shape) for one in found]
        name = f"[{component}].range_image_return{k + 1}"
        columns[f"{name}.values"] = pa.array(values, pa.list_(kind or pa.float32()))
        columns[f"{name}.shape"] = pa.array(shapes, pa.list_(pa.int32(), 3))
    write(path, columns, group=group)


def write_segment(root, boxes=True, group=4, segment=SEGMENT):
    """Write a segment; return its images by time and laser: both returns."""
    name = f"{segment}.parquet"
    images = {
        time: {laser: (image(laser), image(laser, 0.05)) for laser in LASERS} for time in TIMES
    }
    rows = [(time, laser, both) for time, mine in images.items() for laser, both in mine.items()]
    write_images(root / "lidar" / name, "LiDARComponent", rows, 2, group)
    poses = [(time, 1, [pixel_poses(k, *LASERS[1][2:4])]) for k, time in enumerate(TIMES)]
    write_images(root / "lidar_pose" / name, "LiDARPoseComponent", poses, 1, 1)
    write(
        root / "vehicle_pose" / name,
        keys(
            TIMES,
            **{
                "[VehiclePoseComponent].world_from_vehicle.transform": pa.array(
                    [matrix(*vehicle_at(k)).ravel() for k in range(len(TIMES))],
                    pa.list_(pa.float64(), 16),
                )
            },
        ),
    )
    calibration, beam = "[LiDARCalibrationComponent].", "beam_inclination."
    write(
        root / "lidar_calibration" / name,
        {
            "key.segment_context_name": [segment] * len(LASERS),
            "key.laser_name": np.array(list(LASERS), np.int8),
            f"{calibration}extrinsic.transform": pa.array(
                [
                    matrix(Rotation.from_euler("ZYX", turn), place).ravel()
                    for turn, place, *_ in LASERS.values()
                ],
                pa.list_(pa.float64(), 16),
            ),
            f"{calibration}{beam}min": [min(one[4]) for one in LASERS.values()],
            f"{calibration}{beam}max": [max(one[4]) for one in LASERS.values()],
            f"{calibration}{beam}values": pa.array(
                [one[4] if len(one[4]) > 2 else None for one in LASERS.values()],
                pa.list_(pa.float64()),
            ),
        },
    )
    if boxes:
        write_boxes(root / "lidar_box" / name)
    return images


def write_classes(root):
    """Label every pixel of the top laser in the second frame; return both returns (H, W, 2)."""
    sides = LASERS[1][2:4]
    both = [
        np.dstack([random.integers(0, 4, sides), random.integers(0, 24, sides)]).astype(np.int32)
        for _ in range(2)
    ]
    file = root / "lidar_segmentation" / f"{SEGMENT}.parquet"
    component = "LiDARSegmentationLabelComponent"
    write_images(file, component, [(TIMES[1], 1, both)], 2, 1, pa.int32())
    return both


#: In the first frame: type, centre, size, heading, speed in the world, points.
OBJECTS = (
    ("AE5mG59C1GJKWSHeZyrOug", 1, (12.0, 3.0, 0.9), (4.6, 1.9, 1.5), 0.4, (3.0, 4.0, 0.1), 250),
    ("b", 2, (-8.0, 15.0, 0.9), (0.7, 0.6, 1.8), -2.9, (0.0, 0.0, 0.0), 3),
    ("c", 4, (20.0, -9.0, 1.0), (1.8, 0.8, 1.7), 1.9, (np.nan, np.nan, np.nan), 40),
    ("d", 3, (6.0, -6.0, 3.0), (0.2, 0.9, 0.9), 0.1, (0.0, 0.0, 0.0), 12),
    ("e", 1, (60.0, 2.0, 0.9), (4.6, 1.9, 1.5), 0.0, (0.0, 0.0, 0.0), 0),
)


def write_boxes(path, time=TIMES[0]):
    names, types, centres, sizes, headings, speeds, points = zip(*OBJECTS, strict=True)
    kind = "[LiDARBoxComponent]."
    write(
        path,
        keys(
            [time] * len(OBJECTS),
            **{
                "key.laser_object_id": names,
                **{
                    f"{kind}{part}.{axis}": np.array(values)[:, k].astype(np.float64)
                    for part, values in (
                        ("box.center", centres),
                        ("box.size", sizes),
                        ("speed", speeds),
                        ("acceleration", speeds),
                    )
                    for k, axis in enumerate("xyz")
                },
                f"{kind}box.heading": headings,
                f"{kind}type": np.array(types, np.int8),
                f"{kind}num_lidar_points_in_box": np.array(points, np.int64),
                f"{kind}num_top_lidar_points_in_box": np.array(points, np.int64),
                f"{kind}difficulty_level.detection": np.ones(len(OBJECTS), np.int8),
                f"{kind}difficulty_level.tracking": np.ones(len(OBJECTS), np.int8),
            },
        ),
    )
