"""A measured background beside what frames were made from, and as a recording sees it."""

from dataclasses import replace

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.background_estimation import LEAST_FRAMES, measured_backgrounds
from urbantwin.fidelity.beam_assignment import BeamsOf, beams_of_rig
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import Scanner, place_rig, sensor
from urbantwin.lidar.actor_path import PosedActor
from urbantwin.lidar.background import MeasuredBackground
from urbantwin.lidar.background_file import (
    load_backgrounds,
    rig_with_backgrounds,
    save_backgrounds,
    with_background,
)
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic.assets import asset_names


def quad(corners, name="road"):
    return LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id(name), material_id("asphalt")
    )


def ground():
    return quad([[-60, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0]])


def wall():
    return quad([[12, -40, 0], [12, 40, 0], [12, 40, 30], [12, -40, 30]], "building")


def rig(effects=True, **off):
    one = {"name": "a", "model": "VLP-16", "east_m": 0, "north_m": 0, "height_m": 3}
    one["effects"] = off or effects
    return place_rig(RigSpec.model_validate({"frame": "sensor", "sensors": [one]}), ground())


def beams(columns=90):
    """Return the beams of a sensor that is itself the frame of the points."""
    return BeamsOf("", sensor("VLP-16"), columns, 10.0, Pose.from_ypr(np.zeros(3)))


def test_range_spread_and_drop_out_are_those_that_frames_were_made_with():
    """Every beam: a surface with 3 cm of noise, lost in 3 looks of 10, hidden in a fifth."""
    one, generator = beams(), np.random.default_rng(1)
    aim = one.directions.reshape(-1, 3)
    true = generator.uniform(8.0, 90.0, len(aim))
    frames = []
    for _ in range(100):
        range_m = true + generator.normal(0, 0.03, len(aim))
        hidden = generator.random(len(aim)) < 0.2
        range_m[hidden] = generator.uniform(2.0, 7.0, hidden.sum())
        kept = hidden | (generator.random(len(aim)) < 0.7)
        frames.append(Frame(aim[kept] * range_m[kept, None], np.full(kept.sum(), 51.0)))
    (found,) = measured_backgrounds(frames, [one])
    assert np.abs(found.range_m[0].ravel() - true).max() < 0.03
    assert np.median(found.sigma_m[0]) == pytest.approx(0.03, rel=0.05)
    assert found.share[0].mean() == pytest.approx(0.7, abs=0.02)
    assert found.intensity[0] == pytest.approx(0.2, abs=1e-6)


def looks_at(one: BeamsOf, range_m: np.ndarray, returned: np.ndarray) -> list[Frame]:
    """A frame for each row (F, N) of ranges, in which the beams that returned have a point."""
    aim = one.directions.reshape(-1, 3)
    return [Frame(aim[kept] * far[kept, None]) for far, kept in zip(range_m, returned, strict=True)]


def test_as_many_frames_are_needed_as_show_a_half_lost_surface_twice():
    """At most 1 - (n + 1) / 2^n: of n looks that return with probability 1/2, two or more do."""
    one, generator = beams(), np.random.default_rng(2)
    true = np.broadcast_to(generator.uniform(8, 90, (1, one.count)), (LEAST_FRAMES, one.count))
    frames = looks_at(one, true, generator.random(true.shape) < 0.5)
    with pytest.raises(InputError, match=f"10 frames.*{LEAST_FRAMES} frames or more"):
        measured_backgrounds(frames[:-1], [one])
    with pytest.raises(InputError, match="1 frame does not show"):
        measured_backgrounds(frames[:1], [one])
    (found,) = measured_backgrounds(frames, [one])
    assert 0.9 < found.known.mean() <= 1 - (LEAST_FRAMES + 1) / 2**LEAST_FRAMES


def test_traffic_that_waited_all_the_time_is_no_background():
    one = beams()
    rng = np.random.default_rng(4)
    # Half of the looks of each beam pass through what stands at 5 m, and meet 20 m.
    met = np.where(rng.random((LEAST_FRAMES, one.count)) < 0.5, 5.0, 20.0)
    empty = np.arange(one.count) < 40  # Nothing ever came back from there.
    frames = looks_at(one, met, np.broadcast_to(~empty, met.shape))
    (both,) = measured_backgrounds(frames, [one])
    (far,) = measured_backgrounds(
        frames, [one], waits=[lambda places: np.linalg.norm(places, axis=1) < 10]
    )
    kept = (both.share > 0).sum(axis=0) == 2
    assert kept.mean() > 0.5
    np.testing.assert_allclose(far.range_m[0][kept], 20.0, rtol=1e-6)
    assert ((far.share > 0).sum(axis=0)[kept] == 1).all()
    (none,) = measured_backgrounds(frames, [one], waits=[lambda places: np.ones(len(places), bool)])
    assert not none.known.any()
    assert not none.looks.ravel()[~empty].any()  # such a beam sees the twin
    assert (none.looks.ravel()[empty] == LEAST_FRAMES).all()  # a look that met nothing is one


def test_frames_of_a_sensor_that_moved_are_refused():
    one, generator = beams(), np.random.default_rng(3)
    passing = generator.uniform(3, 90, (LEAST_FRAMES, one.count))
    with pytest.raises(InputError, match="are static"):
        measured_backgrounds(looks_at(one, passing, passing > 0), [one])


@pytest.mark.parametrize("elsewhere", [2, LEAST_FRAMES // 2])
def test_frames_of_two_places_are_refused(elsewhere):
    """A third of both is alike, as the road is."""
    one, generator = beams(), np.random.default_rng(5)
    here, there = generator.uniform(8, 90, (2, one.count))
    there[: one.count // 3] = here[: one.count // 3]
    seen = np.array([here] * LEAST_FRAMES)
    assert measured_backgrounds(looks_at(one, seen, seen > 0), [one])[0].known.all()
    seen[-elsewhere:] = there
    with pytest.raises(InputError, match=r"another place in frame .*: 3[3-5]% of the beams"):
        measured_backgrounds(looks_at(one, seen, seen > 0), [one])


def test_frames_in_another_unit_are_refused():
    one, generator = beams(), np.random.default_rng(6)
    cm = 100 * np.broadcast_to(generator.uniform(8, 90, one.count), (LEAST_FRAMES, one.count))
    with pytest.raises(InputError, match=r"lie farther off than .* sees; expected metres"):
        measured_backgrounds(looks_at(one, cm, cm > 0), [one])


@pytest.mark.parametrize("rings", [None, "numbered", "from the lowest"])
def test_points_find_their_beams_with_and_without_rings_in_a_tilted_frame(rings):
    """A level frame of a sensor that looks 8 degrees down: its pose is given."""
    tilt = Pose.from_ypr(np.array([1.0, -2.0, 3.0]), 0.5, np.radians(8), np.radians(-2))
    one = BeamsOf("", sensor("VLP-16"), 1800, 10.0, tilt)
    aim = one.directions.reshape(-1, 3)
    range_m = np.random.default_rng(0).uniform(5, 50, len(aim))
    channel = np.repeat(np.arange(16), 1800)
    if rings == "from the lowest":
        channel = np.argsort(np.argsort(one.sensor.elevation_deg))[channel]
    frame = Frame(tilt.apply(aim * range_m[:, None]), ring=None if rings is None else channel)
    rows, beam, found = one.of(frame)
    np.testing.assert_array_equal(rows[np.argsort(beam)], np.arange(len(aim)))
    np.testing.assert_allclose(found, range_m)
    with pytest.raises(InputError, match="points lie on beams of VLP-16"):
        measured_backgrounds([frame] * LEAST_FRAMES, [beams(1800)])


def test_a_twin_without_a_wall_that_was_measured_records_the_wall(tmp_path):
    with_wall = LabelledMesh.concatenate([ground(), wall()])
    real = Scanner(with_wall, rig(effects=False), 0).scan(0, [])
    frame = Frame(real.points[:, :3].astype(float), real.points[:, 3].astype(float))
    bare = rig(effects=False)
    save_backgrounds(
        tmp_path / "measured.npz",
        measured_backgrounds([frame] * LEAST_FRAMES, beams_of_rig(bare), intensity_scale=1.0),
    )
    one = rig_with_backgrounds(bare, [str(tmp_path / "measured.npz")])
    twin = Scanner(ground(), one, 0).scan(0, [])
    assert len(twin.points) == len(real.points)
    assert np.abs(twin.points - real.points).max() < 2e-3
    for points, seen in (
        (Scanner(ground(), bare, 0).scan(0, []).points, True),
        (twin.points, False),
    ):
        behind = (points[:, 0] > 12.5) & (np.abs(points[:, 1]) < 30)
        assert behind.any() == seen


def image(value, modes=1):
    return np.full((modes, 16, 1800), value, np.float32)


def test_drop_out_and_several_ranges_are_met_over_frames():
    """Half of the looks end at a fence, three tenths behind it, the others nowhere."""
    measured = MeasuredBackground(
        np.concatenate([image(10), image(20)]),
        image(0.02, 2),
        np.concatenate([image(0.5), image(0.3)]),
        image(0.2, 2),
    )
    scanner = Scanner(ground(), with_background(rig(), measured), 0)
    seen = [scanner.scan(number, []).points for number in range(3)]
    beams_m = [np.linalg.norm(points[:, :3], axis=1) for points in seen]
    for range_m, share in ((10.0, 0.5), (20.0, 0.3)):
        near = [np.abs(away - range_m) < 0.15 for away in beams_m]
        for one in near:
            sigma = np.sqrt(share * (1 - share) / (16 * 1800))
            assert one.sum() / (16 * 1800) == pytest.approx(share, abs=4 * sigma)
    assert all(
        (np.abs(away - 10) < 0.15).sum() + (np.abs(away - 20) < 0.15).sum() == len(away)
        for away in beams_m
    )
    assert len(seen[0]) != len(seen[1])
    # The same numbers whenever they are asked for.
    again = Scanner(ground(), with_background(rig(), measured), 0).scan(2, []).points
    np.testing.assert_array_equal(again, seen[2])
    certain = Scanner(ground(), with_background(rig(effects=False), measured), 0).scan(0, [])
    np.testing.assert_allclose(np.linalg.norm(certain.points[:, :3], axis=1), 10.0, rtol=1e-5)


def car(distance_m):
    """Return a car that stands straight ahead, across the beams."""
    pose = Pose.from_ypr(np.array([distance_m, 0.0, 0.0]), np.pi / 2)
    return PosedActor(1, "car", asset_names("car")[0], 0, pose, np.zeros(3))


def test_measured_surfaces_hide_what_is_behind_and_stand_behind_what_is_before_them():
    """A fence at 10 m in half of the looks: a car at 14 m shows in the others only."""
    solid = MeasuredBackground(image(10), image(0.0), image(0.5), image(0.2))
    fence = MeasuredBackground(
        np.concatenate([image(30), image(10)]), image(0.0, 2), image(0.5, 2), image(0.2, 2)
    )
    counts = {}
    for name, measured in (("solid", solid), ("fence", fence)):
        scanner = Scanner(ground(), with_background(rig(footprint=False), measured), 0)
        for distance_m in (6.0, 14.0):
            frames = [scanner.scan(n, [car(distance_m)]) for n in range(3)]
            counts[name, distance_m] = np.mean([(one.instance == 1).sum() for one in frames])
            if name == "solid" and distance_m == 14:
                away = [np.linalg.norm(one.points[:, :3], axis=1) for one in frames]
                # Beams that the car stands behind lose as many looks as all others.
                assert np.mean([len(one) for one in away]) == pytest.approx(14400, abs=300)
    bare = Scanner(ground(), rig(footprint=False), 0).scan(0, [car(14.0)])
    alone = (bare.instance == 1).sum()
    assert alone > 100
    assert counts["solid", 14.0] == 0
    assert counts["fence", 14.0] == pytest.approx(alone / 2, rel=0.2)
    assert counts["solid", 6.0] == pytest.approx(counts["fence", 6.0], rel=0.02)


def test_fused_beams_see_the_twin_where_looks_do_not_refute_it():
    """The upper half of the beams looked often and saw nothing; the lower never looked."""
    (mounted,) = rig().sensors
    upper = mounted.sensor.elevation_deg > -8
    looks = np.where(upper[:, None], 10**6, 0) * np.ones((1, 1800), int)
    nothing = MeasuredBackground(image(0), image(0), image(0), image(np.nan), looks)
    plain = Scanner(ground(), rig(), 0).scan(0, [])
    fused = with_background(rig(), replace(nothing, fused=True))
    found = Scanner(ground(), fused, 0).scan(0, [])
    assert upper[plain.ring].any()
    assert not upper[found.ring].any()
    lower = ~upper[plain.ring]
    np.testing.assert_array_equal(found.points, plain.points[lower])
    assert not len(Scanner(ground(), with_background(rig(), nothing), 0).scan(0, []).points)


def two_sensors():
    one = {"model": "VLP-16", "east_m": 0, "north_m": 0, "height_m": 3}
    other = {"name": "b", "model": "OS1-32", "east_m": 4, "north_m": 0, "height_m": 5}
    spec = {"frame": "site", "sensors": [{"name": "a", **one}, other]}
    return place_rig(RigSpec.model_validate(spec), ground())


def test_each_sensor_of_a_rig_has_its_own_background(tmp_path):
    """Both record a wall together; a rig without the wall sees it with what they measured."""
    with_wall = LabelledMesh.concatenate([ground(), wall()])
    pair = two_sensors()
    scanner = Scanner(with_wall, pair, 0)
    frames = []
    for number in range(LEAST_FRAMES):
        one = scanner.scan(number, [])
        frames.append(
            Frame(
                one.points[:, :3].astype(float),
                one.points[:, 3].astype(float),
                ring=one.ring.astype(int),
                sensor=one.sensor.astype(int),
            )
        )
    both = tmp_path / "both.npz"
    save_backgrounds(both, measured_backgrounds(frames, beams_of_rig(pair)))
    found = Scanner(ground(), rig_with_backgrounds(pair, [str(both)]), 0).scan(0, [])
    bare = Scanner(ground(), pair, 0).scan(0, [])
    for number in range(2):
        assert (found.points[found.sensor == number, 2] > 5).sum() > 500
    assert not (bare.points[:, 2] > 5).any()
    only = rig_with_backgrounds(pair, [f"b={both}"])
    assert [one.measured is not None for one in only.sensors] == [False, True]


def test_a_background_of_another_sensor_is_one_line(tmp_path):
    given = {"a": ("VLP-16", 10.0), "b": ("OS1-32", 10.0)}
    for name, (model, rate) in given.items():
        one = MeasuredBackground(
            image(5), image(0), image(1), image(0), model=model, turns_per_second=rate, name=name
        )
        save_backgrounds(tmp_path / f"{name}.npz", [one])
    pair, a, b = two_sensors(), str(tmp_path / "a.npz"), str(tmp_path / "b.npz")
    slow = MeasuredBackground(image(5), image(0), image(1), image(0), turns_per_second=5.0)
    save_backgrounds(tmp_path / "slow.npz", [slow])
    for one, files, words in (
        (rig(), [b], "OS1-32 with 16 channels by 1800 columns at 10 Hz"),
        (rig(), [str(tmp_path / "slow.npz")], "at 5 Hz"),
        (pair, [f"b={a}"], "VLP-16 with 16"),
        (pair, [f"c={a}"], "not in the rig"),
        (pair, [str(tmp_path / "slow.npz")], "without a name"),
        (pair, [a, f"a={a}"], "twice"),
        (pair, [f"a={tmp_path / 'none.npz'}"], "not found"),
    ):
        with pytest.raises(InputError, match=words) as error:
            rig_with_backgrounds(one, files)
        assert len(str(error.value).splitlines()) == 1


def test_a_background_of_hardly_any_beam_is_refused_unless_the_twin_is_seen_beside_it(tmp_path):
    shape = rig().sensors[0].sensor.channels, rig().sensors[0].columns
    far = np.zeros((1, *shape), np.float32)
    few = far.copy()
    far[0, :, : shape[1] // 5] = few[0, :, : shape[1] // 20] = 5.0
    for name, range_m in (("few", few), ("some", far)):
        one = MeasuredBackground(range_m, 0 * range_m, (range_m > 0) * np.float32(1), 0 * range_m)
        save_backgrounds(tmp_path / f"{name}.npz", [one])
    with pytest.raises(InputError, match=r"ranges on 5% of the beams of .*--fuse"):
        rig_with_backgrounds(rig(), [str(tmp_path / "few.npz")])
    for name, fused in (("few", True), ("some", False)):
        found = rig_with_backgrounds(rig(), [str(tmp_path / f"{name}.npz")], fused=fused)
        assert found.sensors[0].measured.known.any()


def test_what_is_no_background_is_said(tmp_path):
    file = tmp_path / "measured.npz"
    with pytest.raises(InputError, match="not found"):
        load_backgrounds(file)
    file.write_bytes(b"nothing")
    with pytest.raises(InputError):
        load_backgrounds(file)
    np.savez(file, range_m=image(1))
    with pytest.raises(InputError, match="about: is missing"):
        load_backgrounds(file)
    file = tmp_path / "other.npz"
    save_backgrounds(file, [MeasuredBackground(image(1), image(1), image(2), image(1))])
    with pytest.raises(InputError, match="out of bounds"):
        load_backgrounds(file)
    save_backgrounds(file, [MeasuredBackground(image(1), image(1)[:, 1:], image(1), image(1))])
    with pytest.raises(InputError, match="different sizes"):
        load_backgrounds(file)
    with pytest.raises(InputError, match=r"0 frames do not show.*11 frames or more"):
        measured_backgrounds([], [beams()])
