"""Objects in points without labels, against bodies whose place and size are known."""

from dataclasses import replace

import numpy as np
import pytest

from urbantwin.reconstruct.recording import RecordedFrame
from urbantwin.traffic.observed.association import tracks_of
from urbantwin.traffic.observed.box_fit import (
    DetectedActor,
    SeenObject,
    beneath_gap,
    extents,
    fitted_yaw,
    with_points,
)
from urbantwin.traffic.observed.clusters import clusters
from urbantwin.traffic.observed.frame_times import evenly_spaced
from urbantwin.traffic.observed.looked_through import looked_through, parts_in_sight, seen_length
from urbantwin.traffic.observed.observed_track import observed_track

SENSOR = np.array([0.0, 0.0])
SECONDS = evenly_spaced(24, 1.0)


def sides_seen(x, y, yaw, length, width, spacing=0.08):
    """Points (N, 2) on the sides of a body that face the sensor."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s], [s, c]])
    towards = (SENSOR - [x, y]) @ turn
    along = np.arange(-length / 2, length / 2 + 1e-9, spacing)
    across = np.arange(-width / 2, width / 2 + 1e-9, spacing)
    flank = np.column_stack([along, np.full(len(along), np.sign(towards[1]) * width / 2)])
    end = np.column_stack([np.full(len(across), np.sign(towards[0]) * length / 2), across])
    return np.vstack([flank, end]) @ turn.T + [x, y]


def seen(frame, x, y, yaw, length, width, top, moves=1.0):
    plan = sides_seen(x, y, yaw, length, width)
    return SeenObject(frame, plan, top, top, 0.3, SENSOR, moves, fitted_yaw(plan))


@pytest.mark.parametrize("yaw_deg", [3, 20, 44, 71, 130, 259])
def test_two_sides_tell_the_heading_up_to_quarters(yaw_deg):
    points = sides_seen(12.0, 7.0, np.radians(yaw_deg), 4.5, 1.8)
    off = (np.degrees(fitted_yaw(points)) - yaw_deg + 45) % 90 - 45
    assert abs(off) <= 1.01  # half a step
    low, high = extents(points, np.radians(yaw_deg))
    np.testing.assert_allclose(high - low, [4.5, 1.8], atol=0.15)


def test_a_car_is_where_it_drives_from_the_sides_that_one_sees():
    # Away from the sensor at 8 m/s, a frame a second: 4.6 m long, two sides of it in sight.
    yaw = np.radians(30.0)
    step = 8.0 * np.array([np.cos(yaw), np.sin(yaw)])
    places = [np.array([6.0, -9.0]) + k * step for k in range(4)]
    (track,) = tracks_of(
        [[seen(k, *xy, yaw, 4.6, 1.85, 1.5)] for k, xy in enumerate(places)], SECONDS
    )
    found = observed_track(track.seen, None, SECONDS.time_s)
    assert found.actor_class == "car"
    np.testing.assert_allclose(found.boxes[:, :2], places, atol=0.15)
    np.testing.assert_allclose(found.boxes[:, 2], yaw, atol=np.radians(2.5))
    assert found.speed == pytest.approx(8.0, rel=0.03)
    np.testing.assert_allclose(found.size, [4.6, 1.85, 1.5], atol=0.15)


def test_what_is_hidden_of_a_car_is_away_from_the_sensor():
    # Only its rear is in sight: the usual length is completed forwards.
    rear = np.column_stack([np.full(20, 10.0), np.linspace(-0.9, 0.9, 20)])
    far = [rear + [2.0 * k, 0.0] for k in range(3)]
    moments = [SeenObject(k, at, 1.5, 1.5, 0.3, SENSOR, 1.0, 0.0) for k, at in enumerate(far)]
    found = observed_track(moments, None, SECONDS.time_s)
    assert found.actor_class == "car"
    assert found.size[0] == pytest.approx(4.3)
    np.testing.assert_allclose(found.boxes[:, 0], 10.0 + 4.3 / 2 + 2.0 * np.arange(3), atol=0.1)


def test_a_narrow_car_of_which_both_flanks_are_seen_is_as_narrow():
    places = [np.array([6.0 + 3.0 * k, 8.0]) for k in range(3)]
    round_it = [
        np.vstack([sides_seen(*at, 0.0, 3.6, 1.62), 2 * at - sides_seen(*at, 0.0, 3.6, 1.62)])
        for at in places
    ]
    moments = [SeenObject(k, at, 1.5, 1.5, 0.3, SENSOR, 1.0, 0.0) for k, at in enumerate(round_it)]
    found = observed_track(moments, None, SECONDS.time_s)
    np.testing.assert_allclose(found.size, [4.3, 1.62, 1.5], atol=0.1)


def test_no_car_is_as_wide_as_one_that_two_sensors_saw_at_different_moments():
    places = [np.array([6.0 + 3.0 * k, 8.0]) for k in range(3)]
    twice = [
        np.vstack([sides_seen(*at, 0.0, 4.4, 2.9), 2 * at - sides_seen(*at, 0.0, 4.4, 2.9)])
        for at in places
    ]
    moments = [SeenObject(k, at, 1.5, 1.5, 0.3, SENSOR, 1.0, 0.0) for k, at in enumerate(twice)]
    found = observed_track(moments, None, SECONDS.time_s)
    assert found.size[1] == 2.05
    np.testing.assert_allclose(found.boxes[:, :2], places, atol=0.1)  # its middle stays


def test_a_car_is_as_wide_as_in_the_middle_one_of_the_frames_that_show_both_flanks():
    # In two of seven frames one sensor saw it 0.3 m further aside than another; in two
    # others only one flank and a part of the rear were in sight.
    moments = []
    for k, wide in enumerate((1.7, 2.0, 0.5, 0.5, 1.7, 2.0, 1.7)):
        at = np.array([6.0 + 3.0 * k, 8.0])
        one = sides_seen(*at, 0.0, 4.4, wide)
        plan = one if wide < 1.0 else np.vstack([one, 2 * at - one])
        moments.append(SeenObject(k, plan, 1.5, 1.5, 0.3, SENSOR, 1.0, 0.0))
    assert observed_track(moments, None, SECONDS.time_s).size[1] == pytest.approx(1.7, abs=0.05)


@pytest.mark.parametrize(("long", "name"), [(0.8, "pedestrian"), (1.7, "bicycle")])
def test_who_is_shorter_than_a_bicycle_rides_none_however_fast(long, name):
    random = np.random.default_rng(5)
    body = random.uniform(-0.5, 0.5, (90, 2)) * [long, 0.5]
    plan = [body + [4.0 * k, 6.0] for k in range(4)]
    moments = [SeenObject(k, at, 1.7, 1.7, 0.3, SENSOR, 1.0, 0.0) for k, at in enumerate(plan)]
    assert observed_track(moments, None, SECONDS.time_s).actor_class == name


def cast_from(eye, azimuths, elevations, box):
    """Return points (N, 3) of beams from a sensor to level ground at 0, or to a box before it.

    The box is x, y, length and width, as tall as 1.5 m and open up to 0.2 m above the ground;
    beams meet the nearer of its sides (slabs of Kay and Kajiya 1986).
    """
    a, e = (np.radians(one).ravel() for one in np.meshgrid(azimuths, elevations))
    way = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    reach = -eye[2] / way[:, 2]
    if box is not None:
        x, y, length, width = box
        low = np.array([x - length / 2, y - width / 2, 0.2])
        high = np.array([x + length / 2, y + width / 2, 1.5])
        with np.errstate(divide="ignore"):
            one, other = (low - eye) / way, (high - eye) / way
        begin, end = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
        met = (begin < end) & (begin > 0)
        reach = np.where(met, np.minimum(begin, reach), reach)
    return eye + reach[:, None] * way


@pytest.mark.parametrize("yaw_deg", [0, 35, 90, 217])
@pytest.mark.parametrize("there", [True, False])
def test_beams_go_through_where_nobody_is(yaw_deg, there):
    eye = np.array([0.0, 0.0, 1.6])
    box = (12.0, 5.0, 4.4, 1.8) if there else None
    points = cast_from(eye, np.arange(-60, 120, 0.2), np.arange(-24.0, -1.0, 0.5), box)
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    moved = points @ turn.T + [30.0, -7.0, -2.0]
    none = np.zeros(len(points), np.int64)
    frame = RecordedFrame("1", moved, none, none, none)
    stands = (turn @ eye + [30.0, -7.0, -2.0])[None]
    place = (turn @ [12.0, 5.0, 0.0] + [30.0, -7.0, -2.0])[:2]
    assert looked_through(frame, stands, place, -2.0) != there


def test_what_another_hides_is_not_looked_through():
    # A van stands right before the sensor: no beam says who is behind it.
    eye = np.array([0.0, 0.0, 1.6])
    points = cast_from(eye, np.arange(-60, 60, 0.2), np.arange(-24.0, -4.0, 0.5), (4, 0, 2.0, 6.0))
    none = np.zeros(len(points), np.int64)
    frame = RecordedFrame("1", points, none, none, none)
    assert not looked_through(frame, eye[None], np.array([12.0, 0.0]), 0.0)


@pytest.mark.parametrize("long", [3.4, 4.4, 5.1])
@pytest.mark.parametrize("hidden", [False, True])
def test_a_length_is_told_where_nothing_hides_an_end(long, hidden):
    eye = np.array([0.0, 0.0, 1.6])
    aims = np.arange(-60, 60, 0.2), np.arange(-24.0, -0.4, 0.25)
    points = cast_from(eye, *aims, (12.0, 3.0, 1.8, long))  # abeam
    if hidden:  # a van before its rear
        before = cast_from(eye, *aims, (7.0, 3.0 * 7 / 12 - long / 4, 2.0, 1.6))
        nearer = np.linalg.norm(before - eye, axis=1) < np.linalg.norm(points - eye, axis=1)
        points[nearer] = before[nearer]
    none = np.zeros(len(points), np.int64)
    frame = RecordedFrame("1", points, none, none, none)
    seen = points[(points[:, 0] > 10.9) & (points[:, 0] < 13.1) & (points[:, 2] > 0.3), :2]
    seen = seen[np.abs(seen[:, 1] - 3.0) < long / 2 + 0.1]
    told = seen_length(seen, np.pi / 2, frame, eye[None], 0.0)
    if hidden:
        assert told is None
    else:
        # Nearly as long as it is: bumpers of real cars are round.
        assert told == pytest.approx(long + 0.2, abs=0.1)


def test_a_track_ends_before_a_frame_in_which_it_was_not_there():
    moments = [seen(k, 9.0 + 4.0 * k, 8.0, 0.0, 4.4, 1.8, 1.5) for k in (0, 2, 3, 5)]
    (track,) = tracks_of([[one for one in moments if one.frame == k] for k in range(6)], SECONDS)
    asked = []

    def nobody(frame, place):
        asked.append((frame, *np.round(place)))
        return frame == 1

    parts = list(parts_in_sight(track, nobody))
    assert [[one.frame for one in part.seen] for part in parts] == [[0], [2, 3, 5]]
    assert asked == [(1, 13.0, 8.0), (4, 25.0, 8.0)]
    assert [len(part.seen) for part in parts_in_sight(track, lambda *_: False)] == [4]


@pytest.mark.parametrize("step", [0.0, 1.2])
def test_people_face_the_way_they_walk_or_else_across_their_shoulders(step):
    random = np.random.default_rng(8)
    body = random.uniform(-0.5, 0.5, (80, 2)) * [0.5, 0.3] + [5.0, 5.0]
    plan = [body + [step * k, 0.0] for k in range(3)]
    moments = [SeenObject(k, at, 1.7, 1.7, 0.3, SENSOR, 1.0, 0.0) for k, at in enumerate(plan)]
    found = observed_track(moments, None, SECONDS.time_s)
    assert found.actor_class == "pedestrian"
    along = abs(np.cos(found.boxes[:, 2]))
    np.testing.assert_allclose(along, 1.0 if step else 0.0, atol=0.1)


def test_each_is_followed_where_two_pass_each_other():
    frames = []
    for k in range(5):
        one = seen(k, -10.0 + 5 * k, 8.0, 0.0, 4.4, 1.8, 1.5)
        other = seen(k, 10.0 - 5 * k, 12.0, np.pi, 4.4, 1.8, 1.5)
        frames.append([one, other] if k % 2 else [other, one])
    tracks = tracks_of(frames, SECONDS)
    assert sorted(len(one.seen) for one in tracks) == [5, 5]
    for one in tracks:
        assert np.ptp([moment.middle[1] for moment in one.seen]) < 0.2


@pytest.mark.parametrize(("points", "tracks"), [(5, 2), (1, 1)])
def test_a_van_that_stands_where_a_car_stood_is_another(points, tracks):
    # Well seen; of a vehicle that hardly anything is seen of, the roof may be hidden.
    frames = []
    for k, top in enumerate((1.45, 1.45, 1.9, 1.9)):
        one = seen(k, 9.0, 8.0, 0.0, 4.4, 1.8, top)
        frames.append([replace(one, points=np.repeat(one.points, points, axis=0))])
    assert len(tracks_of(frames, SECONDS)) == tracks


def test_leaves_above_a_car_are_no_part_of_it_and_rings_of_a_truck_are():
    car, leaves = np.linspace(0.2, 1.45, 200), np.linspace(2.6, 4.0, 100)
    np.testing.assert_array_equal(beneath_gap(np.concatenate([leaves, car])), car)
    rings = np.repeat([0.5, 1.9, 3.3], 40)
    np.testing.assert_array_equal(beneath_gap(rings), rings)


def test_people_who_walk_together_are_counted_one_by_one():
    rng = np.random.default_rng(1)

    def body(x, y, wide, long, tall, number):
        scale = np.array([long, wide, tall - 0.3])
        return (rng.random((number, 3)) - [0.5, 0.5, 0]) * scale + [x, y, 0.3]

    people = [body(5.0 + 0.9 * k, 5.0, 0.5, 0.5, 1.75, 120) for k in range(3)]
    car = body(-8.0, 0.0, 1.8, 4.4, 1.5, 900)
    points = np.vstack([*people, car])
    found = list(clusters(points, points[:, 2]))
    assert sorted(len(one) for one in found)[-1] == 900
    assert len(found) == 4


def test_posts_are_nobody():
    post = np.column_stack([np.full(12, 9.0), np.linspace(-0.1, 0.1, 12)])
    still = [SeenObject(k, post, 2.0, 2.0, 0.3, SENSOR, 0.1, 0.0) for k in range(4)]
    assert observed_track(still, None, SECONDS.time_s) is None


def detected(name, x, y, score=0.8, yaw=0.0):
    length = {"pedestrian": 0.7, "bicycle": 1.75}[name]
    return DetectedActor(name, np.array([x, y]), yaw, (length, 0.6, 1.7), score)


def test_points_are_of_the_likelier_of_two_boxes_at_one_place():
    rng = np.random.default_rng(2)
    body = rng.uniform(-0.3, 0.3, (60, 3)) + [5.0, 5.0, 1.0]
    beside = rng.uniform(-0.3, 0.3, (40, 3)) + [6.5, 5.0, 1.0]
    points = np.vstack([body, beside])
    boxes = [
        detected("bicycle", 5.1, 5.0, 0.5),
        detected("pedestrian", 5.0, 5.0, 0.7),
        detected("pedestrian", 6.5, 5.0, 0.6),
        detected("pedestrian", 20.0, 5.0, 0.9),  # nobody is there
    ]
    found = [(actor.score, set(rows.tolist())) for actor, rows in with_points(boxes, points)]
    assert found == [(0.7, set(range(60))), (0.6, set(range(60, 100)))]


def test_who_is_detected_is_of_the_class_that_it_was_detected_as():
    # A cyclist passes a person as near as one frame a second lets them be taken for each other;
    # seen from the front the cyclist is no longer than the person.
    rng = np.random.default_rng(3)
    frames = []
    for k in range(4):
        moment = []
        for name, x in (("pedestrian", 4.0 + 1.0 * k), ("bicycle", 2.0 + 2.5 * k)):
            at = np.array([x, 6.0 if name == "pedestrian" else 7.0])
            plan = rng.uniform(-0.25, 0.25, (50, 2)) + at
            tall = 1.6 if name == "pedestrian" else 1.75
            actor = detected(name, *at, yaw=3.0)
            moment.append(SeenObject(k, plan, tall, tall, 0.3, SENSOR, 1.0, 0.0, actor))
        frames.append(moment)
    tracks = [
        observed_track(one.seen, None, SECONDS.time_s, small=False)
        for one in tracks_of(frames, SECONDS)
    ]
    person, cyclist = sorted(tracks, key=lambda one: one.actor_class, reverse=True)
    assert (person.actor_class, cyclist.actor_class) == ("pedestrian", "bicycle")
    assert (person.size, cyclist.size) == ((0.7, 0.6, 1.6), (1.75, 0.6, 1.75))
    assert cyclist.speed == pytest.approx(2.5)
    np.testing.assert_allclose(cyclist.boxes[:, 0], 2.0 + 2.5 * np.arange(4))
    np.testing.assert_allclose(cyclist.boxes[:, 2], 0.0, atol=1e-9)  # as it rides


def test_beside_detections_nobody_is_a_person_for_its_size_alone():
    random = np.random.default_rng(5)
    body = random.uniform(-0.5, 0.5, (90, 2)) * [0.7, 0.5]
    plan = [body + [1.2 * k, 6.0] for k in range(4)]
    moments = [SeenObject(k, at, 1.7, 1.7, 0.3, SENSOR, 1.0, 0.0) for k, at in enumerate(plan)]
    assert observed_track(moments, None, SECONDS.time_s).actor_class == "pedestrian"
    assert observed_track(moments, None, SECONDS.time_s, small=False) is None
