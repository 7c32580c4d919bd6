"""The Waymo Open Dataset v2: its range images as points, boxes, poses, and what is damaged."""

import shutil

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.spatial.transform import Rotation

import urbantwin as ut
from urbantwin.errors import InputError
from urbantwin.fidelity.labelled_view import view_of
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.readers.waymo import RangeImageSensor, returns_of
from urbantwin.geometry import Pose
from urbantwin.taxonomy import semantic_id

from .waymo_segment import (
    LASERS,
    OBJECTS,
    SEGMENT,
    TIMES,
    keys,
    look,
    pixel_poses,
    vehicle_at,
    write,
    write_classes,
    write_images,
    write_segment,
)

NAME = f"{SEGMENT}.parquet"


def frame_of_top(frame):
    return frame.only(frame.sensor == 0)


@pytest.fixture
def segment(tmp_path):
    return tmp_path / "training", write_segment(tmp_path / "training")


def test_points_lie_where_their_pixels_look(segment):
    root, images = segment
    recording = open_recording(root)
    assert (recording.layout, recording.names) == ("waymo2", tuple(map(str, TIMES)))
    frame = recording.read(1)
    # The front laser is upright and not corrected for motion: a straight line from where it is.
    first, second = images[TIMES[1]][2]
    expected = [LASERS[2][1] + one[..., :1] * look(2) for one in (first, second)]
    seen = [one[..., 0] > 0 for one in (first, second)]
    mine = frame.sensor == 1
    np.testing.assert_allclose(
        frame.points[mine],
        np.concatenate([e[s] for e, s in zip(expected, seen, strict=True)]),
        atol=2e-5,
    )
    np.testing.assert_array_equal(
        frame.intensity[mine], np.concatenate([first[..., 1][seen[0]], second[..., 1][seen[1]]])
    )
    rows, columns = zip(*map(np.nonzero, seen), strict=True)
    assert frame.ring[mine].tolist() == np.concatenate(rows).tolist()
    assert frame.column[mine].tolist() == np.concatenate(columns).tolist()
    assert frame.unlabelled[mine].tolist() == (np.concatenate(columns) < 2).tolist()
    assert frame.sensor_places.tolist() == [list(one[1]) for one in LASERS.values()]
    assert frame.time_s is None
    np.testing.assert_allclose(frame.world_SE3_frame.translation, vehicle_at(1)[1])


def test_what_moved_within_a_turn_is_put_right(segment):
    """The vehicle drives past a wall: its points are one plane, with the poses of the pixels."""
    root, images = segment
    turn, place = vehicle_at(0)
    for k, time in enumerate(TIMES):
        told = pixel_poses(k, *LASERS[1][2:4]).astype(np.float64)
        rotation = Rotation.from_euler("ZYX", told.reshape(-1, 6)[:, 2::-1])
        here = rotation.apply(np.tile(LASERS[1][1], (len(rotation), 1)))
        here = here + told.reshape(-1, 6)[:, 3:]
        ahead = rotation.apply(look(1).reshape(-1, 3))
        # The wall is 9 m to the left of where the vehicle is at first.
        normal = turn.apply([0.0, 1.0, 0.0])
        away = (normal @ place + 9.0 - here @ normal) / (ahead @ normal)
        wall = np.where((away > 0) & (away < 75), away, -1).reshape(LASERS[1][2:4])
        images[time][1] = (np.dstack([wall, wall, wall, wall]).astype(np.float32), None)
    rows = [(time, laser, both) for time, mine in images.items() for laser, both in mine.items()]
    write_images(root / "lidar" / NAME, "LiDARComponent", rows, 2, 4)
    for frame in open_recording(root):
        points = frame.world_SE3_frame.apply(frame.points[frame.sensor == 0])
        assert len(points) > 200
        off = points @ normal - normal @ place - 9.0
        assert np.abs(off).max() < 2e-3  # poses are written in 32 bits
        assert frame.notes == ()
    shutil.rmtree(root / "lidar_pose")
    bent = open_recording(root)
    assert any("motion within a turn" in note for note in bent.notes)
    frame = bent.read(0)
    off = frame.world_SE3_frame.apply(frame.points[frame.sensor == 0]) @ normal
    assert np.abs(off - normal @ place - 9.0).max() > 0.1


def test_a_frame_without_poses_of_its_pixels_says_so(segment):
    root, _ = segment
    file = root / "lidar_pose" / NAME
    pq.write_table(pq.read_table(file).slice(1), file)
    recording = open_recording(root)
    assert not any("motion" in note for note in recording.notes)
    assert [bool(frame.notes) for frame in recording] == [True, False, False]
    file = root / "vehicle_pose" / NAME
    pq.write_table(pq.read_table(file).slice(0, 2), file)
    recording = open_recording(root)
    assert [bool(frame.notes) for frame in recording] == [True, False, True]
    assert recording.read(2).world_SE3_frame is None


def test_another_program_reads_the_same(segment):
    """tri3d, of CEA List: points of every laser, boxes and poses."""
    tri3d = pytest.importorskip("tri3d.datasets")
    root, _ = segment
    camera = {"key.camera_name": np.array([1], np.int8)}
    write_classes(root)
    write(root / "camera_box" / NAME, keys(TIMES[:1], **camera))
    stamp = {"[CameraImageComponent].pose_timestamp": [0.0]}
    write(root / "camera_image" / NAME, keys(TIMES[:1], **camera, **stamp))
    write(root / "camera_segmentation" / NAME, keys(TIMES[:1], **camera))
    theirs = tri3d.Waymo(root.parent, "training")
    recording = open_recording(root)
    named = {1: "LIDAR_TOP", 2: "LIDAR_FRONT", 4: "LIDAR_SIDE_RIGHT"}
    for index, frame in enumerate(recording):
        for number, laser in enumerate(LASERS):
            points = theirs.points(0, index, named[laser], coords="LIDAR_TOP")[:, :3]
            atol = 3e-3 if laser == 1 else 2e-4  # they count in 32 bits, 15 km from the origin
            np.testing.assert_allclose(frame.points[frame.sensor == number], points, atol=atol)
    top = frame_of_top(recording.read(1))
    numbers, instances = (
        getattr(theirs, name)(0, 1, "LIDAR_TOP") for name in ("semantic", "instances")
    )
    assert top.instance.tolist() == instances.tolist()
    named = {1: "car", 7: "pedestrian", 14: "building", 18: "road", 19: "road", 22: "sidewalk"}
    for number, name in named.items():
        assert set(top.semantic[numbers == number]) == {semantic_id(name)}
    assert set(top.semantic[numbers == 23]) == {0}  # none of the set's
    boxes = theirs.boxes(0, 0, coords="LIDAR_TOP")
    mine = recording.read(0).boxes
    assert [one.label for one in boxes] == [name.upper() for name in mine.source_names]
    np.testing.assert_allclose(mine.box[:, :3], [one.center for one in boxes], atol=1e-9)
    np.testing.assert_allclose(mine.box[:, 3:6], [one.size for one in boxes], atol=1e-9)
    np.testing.assert_allclose(mine.box[:, 6], [one.heading for one in boxes], atol=1e-6)
    assert mine.num_points.tolist() == [one.num_lidar_points_in_box for one in boxes]


def test_classes_of_points(segment):
    """Part of the frames, one laser of theirs: the other points are unlabelled, never shifted."""
    root, images = segment
    both = write_classes(root)
    bare, labelled, _ = open_recording(root)
    assert bare.semantic is None
    first, second = images[TIMES[1]][1]
    told = np.concatenate([b[i[..., 0] > 0] for b, i in zip(both, (first, second), strict=True)])
    top = frame_of_top(labelled)
    assert top.instance.tolist() == told[:, 0].tolist()
    poles = told[:, 1] == 10
    assert (top.semantic == semantic_id("pole")).tolist() == poles.tolist()
    rest = labelled.only(labelled.sensor != 0)
    assert set(rest.semantic) == {0}
    file = root / "lidar_segmentation" / NAME
    table = pq.read_table(file)
    rows = table.to_pydict()
    rows["[LiDARSegmentationLabelComponent].range_image_return2.shape"][0] = [90, 8, 2]
    write(file, rows, table.schema)
    with pytest.raises(InputError, match=r"lidar_segmentation.*row 0: .*labels of \(90, 8\)"):
        open_recording(root).read(1)


def test_boxes(segment):
    root, _ = segment
    labelled, bare, _ = open_recording(root)
    boxes = labelled.boxes
    assert boxes.class_names == ("car", "pedestrian", "bicycle", "other", "car")
    assert boxes.source_names == ("Vehicle", "Pedestrian", "Cyclist", "Sign", "Vehicle")
    assert boxes.num_points.tolist() == [250, 3, 40, 12, 0]
    assert boxes.ignored == ("", "", "", "", "no points")
    assert len(set(boxes.track)) == 5
    turn, _ = vehicle_at(0)
    np.testing.assert_allclose(boxes.velocity[0], turn.inv().apply([3, 4, 0.1]), atol=1e-12)
    assert np.isnan(boxes.velocity[2]).all()
    assert len(bare.boxes) == 0  # a street without anybody, in a labelled segment
    shutil.rmtree(root / "lidar_box")
    assert open_recording(root).read(0).boxes is None


def test_speeds_are_in_the_world(segment):
    """A real object, pose and speed, from issue 137 of the kit: it drives away straight ahead."""
    root, _ = segment
    real = np.array([
        -0.16717355790707938, -0.9859083232235732, -0.006146522201263641, -1565.8830925928753,
        0.9858751067922654, -0.16709716892163046, -0.011349446934339912, 14561.819790719877,
        0.010162447738004884, -0.00795703065586302, 0.9999167016902528, -7.871,
        0.0, 0.0, 0.0, 1.0,
    ])  # fmt: skip
    file = root / "vehicle_pose" / NAME
    table = pq.read_table(file)
    column = "[VehiclePoseComponent].world_from_vehicle.transform"
    write(file, {**table.to_pydict(), column: [real] * 3}, table.schema)
    file = root / "lidar_box" / NAME
    boxes = pq.read_table(file).to_pydict()
    for axis, speed in zip("xyz", (-1.3777278030209672, 7.685341385276843, 0), strict=True):
        boxes[f"[LiDARBoxComponent].speed.{axis}"] = [float(speed)] * len(OBJECTS)
    write(file, boxes)
    x, y, _ = open_recording(root).read(0).boxes.velocity[0]
    assert x == pytest.approx(7.807, abs=1e-3)
    assert abs(y) < 0.1


def test_nothing_is_judged_in_zones_without_labels(segment):
    root, _ = segment
    recording = open_recording(root)
    frame = recording.read(0)
    inside = frame.points[frame.unlabelled][0]
    outside = frame.points[~frame.unlabelled][0]
    small = [0.01, 0.01, 0.01, 0.0]
    view = view_of(recording)
    assert "no-label zones" in view.said
    nobody = [500.0, 0.0, 0.0, *small]
    boxes = np.array([[*inside, *small], [*outside, *small], nobody])
    assert view.covers(frame, boxes).tolist() == [False, True, True]


def test_several_segments(segment, tmp_path):
    root, _ = segment
    assert len(open_recording(tmp_path)) == 3  # the folder above is enough
    file = root / "lidar" / NAME
    shutil.copy(file, root / "lidar" / "other.parquet")
    with pytest.raises(InputError, match=r"holds 2 segments.*10023.*other\.parquet"):
        open_recording(root)
    assert open_recording(file).names == tuple(map(str, TIMES))
    told = ut.info(file, progress=False)
    assert (told["layout"], told["frames"]) == ("Waymo Open Dataset v2", 3)
    with pytest.raises(InputError, match=r"lidar_calibration.other\.parquet: not found"):
        open_recording(root / "lidar" / "other.parquet")


def test_any_order_of_rows_and_frames(segment):
    """Rows sorted by laser, in one group; frames from the last to the first."""
    root, _ = segment
    before = list(open_recording(root))
    file = root / "lidar" / NAME
    table = pq.read_table(file)
    order = [("key.laser_name", "descending"), ("key.frame_timestamp_micros", "descending")]
    pq.write_table(table.sort_by(order), file)
    recording = open_recording(root)
    for index in (2, 0, 1, 1):
        np.testing.assert_array_equal(recording.read(index).points, before[index].points)


@pytest.mark.parametrize(
    ("component", "column", "value", "said"),
    [
        ("lidar", "[LiDARComponent].range_image_return1.shape", [8, 90, 3], "row 3: .*8 x 90 x 3"),
        ("lidar", "[LiDARComponent].range_image_return1.shape", [9, 80, 4], "row 3: .*9 rows for"),
        ("lidar", "[LiDARComponent].range_image_return1.values", [1.0], "row 3: .*1 values of"),
        ("lidar", "key.laser_name", 2, "row 4: has laser 2 of .* again"),
        ("lidar", "key.laser_name", 5, "lidar_calibration.*lacks laser 5"),
        ("lidar_pose", "[LiDARPoseComponent].range_image_return1.shape", [1, 720, 6], "row 1: "),
        ("lidar_calibration", "[LiDARCalibrationComponent].extrinsic.transform", [0.0] * 16,
         "row 1: .*not a rotation"),
        ("vehicle_pose", "[VehiclePoseComponent].world_from_vehicle.transform", [np.nan] * 16,
         "row 1: .*not finite"),
        ("lidar_box", "[LiDARBoxComponent].type", None, "row 1: "),
        ("lidar_box", "key.segment_context_name", "x", "is of 2 segments"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_row(segment, component, column, value, said):
    root, _ = segment
    file = root / component / NAME
    table = pq.read_table(file)
    rows = table.to_pydict()
    rows[column][3 if component == "lidar" else 1] = value
    write(file, rows, table.schema, 4)
    with pytest.raises(InputError, match=said) as caught:
        for frame in open_recording(root):
            frame.foreground()
    assert component in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_damaged_file_is_named_with_its_row(segment):
    root, _ = segment
    file = root / "lidar" / NAME
    sound = file.read_bytes()
    where = pq.ParquetFile(file).metadata.row_group(1).column(3)
    begin = where.dictionary_page_offset or where.data_page_offset
    data = bytearray(sound)
    data[begin + 100 : begin + 400] = bytes(300)
    file.write_bytes(data)
    recording = open_recording(root)
    assert len(recording.read(0).points) > 300  # of the group before
    with pytest.raises(InputError, match=r"lidar.*row \d: "):
        recording.read(1)
    file.write_bytes(sound[: len(sound) // 2])
    with pytest.raises(InputError, match="lidar"):
        open_recording(root)


def test_files_of_two_segments_are_not_mixed(segment, tmp_path):
    root, _ = segment
    other = tmp_path / "other"
    write_segment(other)
    file = root / "lidar_box" / NAME
    table = pq.read_table(other / "lidar_box" / NAME).to_pydict()
    table["key.segment_context_name"] = ["another"] * len(OBJECTS)
    write(file, table)
    with pytest.raises(
        InputError, match=f"lidar_box.*is of segment another; expected segment {SEGMENT}"
    ):
        open_recording(root)


def test_beams_that_are_listed_and_beams_between_bounds():
    """One pixel straight ahead of each row: its elevation is the beam's, the highest first."""
    ahead = np.full((4, 4), -1.0)
    ahead[:, 2] = 10.0
    still = Pose(np.eye(3), np.zeros(3))
    for listed, expected in (
        (np.array([-0.4, -0.1, 0.05, 0.2]), [0.2, 0.05, -0.1, -0.4]),
        (None, [0.35, 0.05, -0.25, -0.55]),  # middles of four parts of -0.7 to 0.5
    ):
        points = returns_of(ahead, RangeImageSensor(still, listed, -0.7, 0.5)).points
        np.testing.assert_allclose(np.arcsin(points[:, 2] / 10), expected)
    with pytest.raises(ValueError, match="4 rows for 3 beams"):
        returns_of(ahead, RangeImageSensor(still, np.zeros(3), 0.0, 0.0))
