"""Rigs that ride: who carries them, where their sensors are, and when the carrier is gone."""

import numpy as np
import pyarrow as pa
import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar.actor_path import ActorPath
from urbantwin.lidar.placement import place_rig
from urbantwin.lidar.riding import boarded
from urbantwin.lidar.sensor_path import poses_along
from urbantwin.site.rig import RigSpec
from urbantwin.traffic import Motion
from urbantwin.traffic.assets import asset_mesh, asset_names
from urbantwin.traffic.motion import ACTOR_SCHEMA
from urbantwin.traffic.signals import SIGNAL_SCHEMA

CAR, BUS = asset_names("car")[0], asset_names("bus")[0]
#: (track, class, asset) -> first and last step.
LIVES = {
    (3, "car", CAR): [(5, 40)],
    (8, "car", CAR): [(0, 99)],
    (11, "bus", BUS): [(0, 20), (30, 99)],
}


@pytest.fixture(scope="module")
def motion() -> Motion:
    rows = [
        {
            "time_s": round(step * 0.1, 9),
            "track": track,
            "class": kind,
            "asset": asset,
            "x": step * 1.0,
            "y": float(track),
        }
        for (track, kind, asset), lives in LIVES.items()
        for first, last in lives
        for step in range(first, last + 1)
    ]
    rows.sort(key=lambda row: (row["time_s"], row["track"]))
    filled = [
        {f.name: row.get(f.name, "" if pa.types.is_string(f.type) else 0) for f in ACTOR_SCHEMA}
        for row in rows
    ]
    manifest = {"seed": 1, "steps": 100, "step_s": 0.1}
    actors = pa.Table.from_pylist(filled, schema=ACTOR_SCHEMA)
    return Motion(manifest, actors, SIGNAL_SCHEMA.empty_table())


def riding(ride, *sensors, **more):
    standard = {"model": "VLP-16", "forward_m": 0.5, "left_m": 0.0, "height_m": 4.0}
    named = [{"name": f"s{k}", **standard, **one} for k, one in enumerate(sensors or ({},))]
    spec = RigSpec.model_validate({"ride": ride, "sensors": named, **more})
    return place_rig(spec, LabelledMesh.empty(), file="rig.yaml")


def curve(times, speed=15.0, turn=0.4) -> ActorPath:
    """A vehicle that drives a circle, with knots at some times."""
    yaw = turn * times
    radius = speed / turn
    places = np.column_stack([radius * np.sin(yaw), radius * (1 - np.cos(yaw)), 0 * yaw])
    rotation = np.stack([Pose.from_ypr((0, 0, 0), angle).rotation for angle in yaw])
    return ActorPath(times, rotation, places)


def test_poses_along_a_path_are_those_of_the_path():
    path = curve(np.array([-0.2, 0.0, 0.1, 0.3]))
    times = np.linspace(-0.4, 0.5, 91)
    rotation, translation = poses_along(path, times)
    for k, time_s in enumerate(times):
        pose = path.at(float(time_s))
        np.testing.assert_allclose(rotation[k], pose.rotation, atol=1e-12)
        np.testing.assert_allclose(translation[k], pose.translation, atol=1e-12)


def test_a_sensor_goes_with_its_carrier():
    """On a circle driven at constant speed, a mast ahead of the middle has a speed of its own."""
    rig = riding({"track": 8}, {"forward_m": 3.0, "left_m": 1.0, "yaw_deg": 90.0})
    fine = curve(np.linspace(-0.2, 0.2, 401))
    path = rig.sensors[0].path(0, 0, fine)
    times = np.array([-0.1, 0.0, 0.1])
    rotation, place = path.true_poses(times)
    for k, yaw in enumerate(0.4 * times):
        c, s = np.cos(yaw), np.sin(yaw)
        centre = np.array([37.5 * s, 37.5 * (1 - c)])
        np.testing.assert_allclose(place[k, :2], centre + [3 * c - s, 3 * s + c], atol=1e-4)
        np.testing.assert_allclose(rotation[k, :2, 0], [-s, c], atol=1e-9)
    np.testing.assert_allclose(place[:, 2], 4.0)
    reported = path.reported_poses(times)
    np.testing.assert_array_equal(reported[1], place)
    assert not path.is_fixed


def test_without_deskew_the_sensor_is_believed_to_stand():
    rig = riding({"track": 8}, deskew=False)
    path = rig.sensors[0].path(0, 0, curve(np.linspace(-0.2, 0.2, 41)))
    times = np.array([-0.1, 0.0, 0.1])
    at_frame = path.true_poses(np.zeros(1))
    rotation, place = path.reported_poses(times)
    np.testing.assert_allclose(place, np.tile(at_frame[1], (3, 1)))
    np.testing.assert_allclose(rotation, np.tile(at_frame[0], (3, 1, 1)))
    assert np.ptp(path.true_poses(times)[1][:, 0]) > 2.9


@pytest.mark.parametrize("frame", ["sensor", "level", "site"])
def test_the_frame_of_the_points_goes_along(frame):
    rig = riding({"track": 8}, {"pitch_deg": 20.0, "yaw_deg": 30.0}, frame=frame)
    carrier = curve(np.linspace(-0.2, 0.2, 41))
    to_dataset = rig.dataset_pose(carrier)
    rotation, place = rig.sensors[0].path(0, 0, carrier).true_poses(np.zeros(1))
    origin = to_dataset.apply(place)[0]
    ahead = to_dataset.rotation @ rotation[0][:, 0]
    if frame == "site":
        np.testing.assert_allclose(origin, place[0])
    else:
        np.testing.assert_allclose(origin, 0.0, atol=1e-12)
        down = 0.0 if frame == "sensor" else -np.sin(np.radians(20))
        np.testing.assert_allclose(ahead, [np.sqrt(1 - down**2), 0, down], atol=1e-9)


def test_of_several_the_one_nearest_to_the_anchor_carries_the_rig(motion):
    rows = motion.actors.to_pylist()
    for track, offset in [(21, 400.0), (22, -80.0), (23, 90.0)]:
        rows += [row | {"track": track, "y": offset} for row in rows if row["track"] == 8]
    rows.sort(key=lambda row: (row["time_s"], row["track"]))
    rows = [row for row in rows if row["track"] > 20]
    more = Motion(motion.manifest, pa.Table.from_pylist(rows, ACTOR_SCHEMA), motion.signals)
    assert boarded(riding({"class": "car"}), more, [0.0, 9.9]).carrier == 22


def test_boarding_by_track_and_by_class(motion):
    frames = np.arange(0.0, 9.95, 0.1).tolist()
    assert boarded(riding({"track": 8}), motion, frames).carrier == 8
    assert boarded(riding({"class": "car"}), motion, frames).carrier == 8
    assert boarded(riding({"class": "bus"}), motion, frames[35:]).carrier == 11
    assert boarded(riding({"class": "bus"}), motion, frames[:15]).carrier == 11


@pytest.mark.parametrize(("ride", "first", "last", "words"), [
    ({"track": 3}, 0.0, 9.9, "car 3, which carries the rig, is there from 0.5 to 4 s"),
    ({"track": 3}, 3.0, 4.1, "expected --start 0.5 --stop 4$"),
    ({"track": 11}, 0.0, 9.9, "from 3 to 9.9 s, and frames from 0 to 9.9 s are requested"),
    ({"track": 11}, 0.0, 2.5, "from 0 to 2 s"),
    ({"track": 4}, 0.0, 9.9, "rig.yaml: ride.track: the motion has no track 4; expected.* 3 to 11"),
    ({"class": "truck"}, 0.0, 9.9, "ride.class: the motion has no truck; expected one of bus, car"),
])  # fmt: skip
def test_a_carrier_that_leaves_says_when_it_is_there(motion, ride, first, last, words):
    with pytest.raises(InputError, match=words) as error:
        boarded(riding(ride), motion, [first, last], file="rig.yaml")
    assert "\n" not in str(error.value)


def test_a_carrier_that_was_put_elsewhere_left(motion):
    rows = motion.actors.to_pylist()
    for row in rows:
        row["x"] += 300.0 * (row["time_s"] > 5.05)
    jumped = Motion(motion.manifest, pa.Table.from_pylist(rows, ACTOR_SCHEMA), motion.signals)
    with pytest.raises(InputError, match=r"car 8.* from 0 to 5 s"):
        boarded(riding({"track": 8}), jumped, [0.0, 9.9])


def test_above_the_roof_is_above_the_carriers_mesh(motion):
    rig = boarded(riding({"class": "bus"}, {"height_m": None, "above_roof_m": 0.3}), motion, [5.0])
    mesh = asset_mesh(BUS, 0)
    roof = mesh.vertices[:, 2].max()
    assert rig.sensors[0].carrier_SE3_sensor.translation[2] == pytest.approx(roof + 0.3)


def test_a_sensor_inside_its_carrier_is_refused(motion):
    with pytest.raises(
        InputError, match=r"sensors\[1\].height_m: the sensor is inside bus 11"
    ) as error:
        boarded(riding({"class": "bus"}, {}, {"height_m": 1.5}), motion, [5.0], file="rig.yaml")
    assert error.value.file == "rig.yaml"


def test_a_rig_that_stands_boards_nothing(motion, rig_of, ground_mesh):
    rig = rig_of(ground_mesh(), {})
    assert boarded(rig, motion, [0.0]) is rig
