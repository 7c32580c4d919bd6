"""What a sensor that takes its time sees of what moves, against closed forms.

A box stands for a car: where a ray meets a box that moves is known exactly.
"""

import numpy as np
import pytest

from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import PosedActor, Scanner
from urbantwin.lidar.actor_path import ActorPath
from urbantwin.site.rig import Effects

from ..thorough import further

ONLY_TIME = Effects.none().model_dump() | {"rolling_shutter": True}
HALF = np.array([2.0, 0.9, 0.75])
CENTRE = np.array([0.0, 0.0, 0.75])
SPEED = 15.0


@pytest.fixture(scope="module")
def car(box_mesh) -> LabelledMesh:
    return box_mesh((-2, -0.9, 0), (2, 0.9, 1.5), "car", "metal-painted")


@pytest.fixture(scope="module")
def scan(ground_mesh, rig_of, car):
    """Scan one frame of a level plane with cars on it; returns the rig and the frame."""

    def run(sensors, actors, index=0, **rig):
        sensors = [{"effects": ONLY_TIME, **one} for one in sensors]
        placed = rig_of(ground_mesh(300.0), *sensors, frame="site", **rig)
        scanner = Scanner(ground_mesh(300.0), placed, 0, meshes=lambda asset, phase: car)
        return placed, scanner.scan(index, actors)

    return run


def driving(track, place, yaw, speed=SPEED):
    """A car that drives straight on."""
    pose = Pose.from_ypr(place, yaw)
    return PosedActor(track, "car", "box", 0, pose, speed * pose.rotation[:, 0])


def beside_box(points):
    """Distance (N,) of points (N, 3) from the surface of the box, in its own frame."""
    beyond = np.abs(points - CENTRE) - HALF
    return np.abs(np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(axis=1), 0))


def in_box_frame(actor, points, time_s):
    """Points (N, 3) measured at times (N,), seen from the car that drives straight on."""
    there = actor.site_SE3_asset.translation + time_s[:, None] * actor.velocity
    return (points - there) @ actor.site_SE3_asset.rotation


def first_meeting(actor, origin, directions, time_s):
    """Range (N,) at which rays that fire at times (N,) meet the moving box; inf where none."""
    start = in_box_frame(actor, np.broadcast_to(origin, (len(time_s), 3)), time_s) - CENTRE
    along = directions @ actor.site_SE3_asset.rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (-HALF - start) / along, (HALF - start) / along
    enters = np.fmin(one, other).max(axis=1)
    leaves = np.fmax(one, other).min(axis=1)
    return np.where((enters <= leaves) & (enters > 0), enters, np.inf)


def looking(sensor, columns, rate_hz, yaw_deg):
    """Unit vectors (C, K, 3) of the beams in the site: the head turns on while a column fires."""
    sense = -1 if sensor.spin == "cw" else 1
    angle = 360 * (np.arange(columns) / columns + rate_hz * sensor.firing_time_us[:, None] * 1e-6)
    azimuth = np.radians(yaw_deg + sensor.azimuth_offset_deg[:, None] + sense * angle)
    up = np.radians(sensor.elevation_deg)[:, None]
    flat = np.cos(up)
    parts = (flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(up))
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def firing_times(rate_hz, columns, phase_deg, firing_us):
    """True times (C, K) of a locked sensor's rays, from the frame's time."""
    share = np.round(np.arange(columns) - phase_deg / 360 * columns, 6) % columns / columns
    return share / rate_hz + np.asarray(firing_us)[:, None] * 1e-6


CARS = [
    driving(1, (-4.0, 9.0, 0.0), 0.0),
    driving(2, (8.0, -7.0, 0.0), 2.2),
    driving(3, (-14.0, -3.0, 0.0), -1.4),
    driving(4, (20.0, 16.0, 0.0), np.pi),
]


@pytest.mark.parametrize(
    ("model", "rate_hz", "phase_deg"),
    [
        ("OS1-128", 10.0, 0.0),
        ("VLP-16", 5.0, 0.0),
        ("VLP-32C", 10.0, 77.4),
        *further(("OS1-128", 20.0, 180.0), ("Pandar64", 20.0, 270.0)),
    ],
)
def test_a_car_at_15_m_s_is_skewed_as_the_closed_form_says(scan, model, rate_hz, phase_deg):
    rig, frame = scan(
        [{"model": model, "phase_deg": phase_deg, "yaw_deg": 33.0, "height_m": 2.0}],
        CARS,
        7,
        rate_hz=rate_hz,
    )
    one = rig.sensors[0]
    time_s = firing_times(rate_hz, one.columns, phase_deg, one.sensor.firing_time_us)
    assert frame.time_s == pytest.approx(time_s[frame.ring, frame.column], abs=1e-7)

    directions = looking(one.sensor, one.columns, rate_hz, 33.0)
    origin = one.site_SE3_sensor.translation
    expected = np.array(
        [first_meeting(actor, origin, directions.reshape(-1, 3), time_s.ravel()) for actor in CARS]
    )
    nearest = expected.min(axis=0).reshape(time_s.shape)
    seen = np.full(time_s.shape, np.inf)
    hit = frame.instance > 0
    range_m = np.linalg.norm(frame.points[:, :3] - origin, axis=1)
    seen[frame.ring[hit], frame.column[hit]] = range_m[hit]
    both = np.isfinite(nearest) & np.isfinite(seen)
    assert both.sum() > 150
    assert np.abs(nearest[both] - seen[both]).max() < 0.002
    # One or the other only: rays along an edge.
    assert (np.isfinite(nearest) != np.isfinite(seen)).sum() <= 0.005 * both.sum()

    for actor in CARS:
        mine = frame.instance == actor.track
        points = frame.points[mine, :3].astype(float)
        assert mine.any()
        back = in_box_frame(actor, points, time_s[frame.ring[mine], frame.column[mine]])
        assert beside_box(back).max() < 0.002
        # As if all had been measured at once they are as far off as the car drove.
        frozen = in_box_frame(actor, points, np.zeros(len(points)))
        drove = time_s[frame.ring[mine], frame.column[mine]] * SPEED
        assert np.abs(frozen - back)[:, 0] == pytest.approx(np.abs(drove), abs=1e-6)


def test_a_box_stands_where_the_rays_met_the_car(scan):
    """Labelled points lie within 2 cm of their box, moved with the car to the box's time."""
    _, frame = scan([{}], CARS, 3)
    for actor, label in zip(CARS, frame.boxes, strict=True):
        mine = frame.instance == label.track
        assert 0 < label.observed_s < 0.1
        assert label.observed_s == pytest.approx(float(frame.time_s[mine].mean()), abs=2e-3)
        there = actor.site_SE3_asset.translation + label.observed_s * actor.velocity
        assert label.box[:2] == pytest.approx(there[:2], abs=1e-6)
        points = frame.points[mine, :3].astype(float)
        moved = points + (label.observed_s - frame.time_s[mine, None]) * actor.velocity
        local = (moved - label.box[:3]) @ actor.site_SE3_asset.rotation
        assert (np.abs(local) <= label.box[3:6] / 2 + 0.02).all()


def test_a_car_that_turns_is_seen_along_its_arc(scan):
    """On a circle of 12 m at 8 m/s, against rays cast at the true arc."""
    radius, speed = 12.0, 8.0
    times = np.linspace(-0.1, 0.3, 9)  # Steps of 0.05 s.

    def pose(time_s):
        angle = speed / radius * time_s - 1.0
        return Pose.from_ypr((radius * np.sin(angle), 14 - radius * np.cos(angle), 0.0), angle)

    poses = [pose(time_s) for time_s in times]
    path = ActorPath(
        times,
        np.stack([one.rotation for one in poses]),
        np.stack([one.translation for one in poses]),
    )
    start = pose(0.0)
    actor = PosedActor(1, "car", "box", 0, start, speed * start.rotation[:, 0], path)
    _, frame = scan([{}], [actor])
    mine = frame.instance == 1
    assert mine.sum() > 100
    for point, time_s in zip(frame.points[mine, :3], frame.time_s[mine], strict=True):
        back = pose(float(time_s)).inverse().apply(point[None].astype(float))
        # A chord of 0.4 m on this circle leaves it by 1.7 mm.
        assert beside_box(back)[0] < 0.004


def test_two_locked_sensors_agree_and_two_in_opposition_do_not(scan):
    """Both look to the left at the same time, or half a turn apart: 0.75 m of the car's way."""
    far = driving(1, (0.0, 30.0, 0.0), 0.0)

    def offset(phase_deg):
        sensors = [{}, {"phase_deg": phase_deg, "height_m": 5.5}]
        _, frame = scan(sensors, [far])
        middle = [
            np.mean([frame.points[on, 0].min(), frame.points[on, 0].max()])
            for on in ((frame.instance == 1) & (frame.sensor == k) for k in range(2))
        ]
        return middle[1] - middle[0]

    # A column at 30 m is 0.18 m wide.
    assert abs(offset(0.0)) < 0.2
    # Clockwise, from the rear on, the second comes to the left half a turn before the first.
    assert offset(180.0) == pytest.approx(-0.05 * SPEED, abs=0.2)


def test_a_clock_that_drifts_tells_other_times_of_the_same_world(scan):
    true = scan([{}], CARS, 600)[1]
    clock = {"clock_offset_s": 0.004, "clock_drift_ppm": 50.0}
    told = scan([clock], CARS, 600)[1]
    assert np.array_equal(told.points, true.points)
    # After a minute 50 ppm are 3 ms.
    expected = 0.004 + 50e-6 * (60.0 + true.time_s.astype(float))
    assert told.time_s - true.time_s.astype(float) == pytest.approx(expected, abs=1e-7)


def test_every_turn_of_a_swift_sensor_is_in_the_frame(scan):
    _, frame = scan([{"rate_hz": 20.0, "columns": 1024}], CARS, 5)
    first = frame.time_s < 0.05
    assert 0.45 < first.mean() < 0.55
    for actor in CARS:
        mine = frame.instance == actor.track
        assert {*np.unique(first[mine])} == {False, True}
        back = in_box_frame(actor, frame.points[mine, :3].astype(float), frame.time_s[mine])
        assert beside_box(back).max() < 0.002


def test_without_rolling_shutter_the_frame_is_one_moment(scan):
    _, frame = scan([{"effects": Effects.none().model_dump(), "phase_deg": 90.0}], CARS, 7)
    assert (frame.time_s == 0).all()
    for actor, label in zip(CARS, frame.boxes, strict=True):
        mine = frame.instance == actor.track
        still = in_box_frame(actor, frame.points[mine, :3].astype(float), np.zeros(mine.sum()))
        assert beside_box(still).max() < 0.002
        assert label.box[:2] == pytest.approx(actor.site_SE3_asset.translation[:2], abs=1e-9)
        assert label.observed_s == 0


def test_a_pattern_that_does_not_repeat_goes_on_through_the_frames(scan, tmp_path):
    """A rosette of 0.07 s at 20,000 points a second: each frame sees the part of its own time."""
    step_s, points = 5e-5, 1400

    def azimuth_elevation(time_s):
        turn = 2 * np.pi * (time_s % 0.07) / 0.07
        return 70.0 + 20 * np.cos(7 * turn) * np.cos(turn), -8 + 7 * np.cos(7 * turn) * np.sin(turn)

    times = np.arange(points) * step_s
    rows = np.column_stack([times, *azimuth_elevation(times)])
    np.savetxt(
        tmp_path / "rosette.csv", rows, "%.9f", ",", header="time_s,azimuth_deg,elevation_deg",
        comments="",
    )  # fmt: skip
    (tmp_path / "rosette.yaml").write_text(
        "{name: Rosette, maker: me, pattern: rosette.csv, points_per_second: 20000, "
        "range_min_m: 0.5, range_max_m: 100, reference_reflectivity: 0.1, reference_range_m: 90, "
        "range_sigma_m: 0.02, range_resolution_m: 0.001, wavelength_nm: 905}"
    )
    one = {"model": str(tmp_path / "rosette.yaml"), "height_m": 3.0}
    actor = driving(1, (3.0, 12.0, 0.0), 0.0)
    for index in (0, 5):
        rig, frame = scan([one], [actor], index)
        assert frame.time_s == pytest.approx(frame.column * step_s, abs=1e-8)
        mine = frame.instance == 1
        assert mine.sum() > 100
        time_s = frame.time_s[mine].astype(float)
        azimuth, up = np.radians(azimuth_elevation(index / 10 + np.round(time_s / step_s) * step_s))
        directions = np.stack(
            [np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)], axis=-1
        )
        origin = rig.sensors[0].site_SE3_sensor.translation
        range_m = np.linalg.norm(frame.points[mine, :3] - origin, axis=1)
        expected = first_meeting(actor, origin, directions, time_s)
        assert np.abs(range_m - expected).max() < 0.005
