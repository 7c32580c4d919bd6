"""Whole frames in rain, snow and fog, with signs that bloom, and each effect off alone."""

import numpy as np
import pytest

from urbantwin.geometry import LabelledMesh
from urbantwin.lidar import Scanner, place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id

OUTLIER = semantic_id("outlier")


def scan(world, effects=None, conditions=None, model="OS1-128", frame=3, actors=(), **more):
    """One frame of one sensor, 3 m above the ground."""
    one = {"name": "a", "model": model, "east_m": 0.0, "north_m": 0.0, "height_m": 3.0, **more}
    if effects is not None:
        one["effects"] = effects
    spec = {"sensors": [one], "frame": "sensor"}
    if conditions is not None:
        spec["conditions"] = conditions
    rig = place_rig(RigSpec.model_validate(spec), world)
    return Scanner(world, rig, 7).scan(frame, list(actors))


def sign(distance_m, material="retroreflector", size=0.5):
    """A board that faces the sensor."""
    y, z = np.array([-1, 1, 1, -1]) * size, 3 + np.array([-1, -1, 1, 1]) * size
    corners = np.column_stack([np.full(4, distance_m), y, z])
    return LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id("traffic-sign"), material_id(material)
    )


@pytest.fixture(scope="module")
def plain(ground_mesh):
    return ground_mesh(half=300.0)


@pytest.mark.parametrize(
    ("weather", "visibility_m"), [("rain", 30.0), ("fog", 60.0), ("snow", 400.0)]
)
def test_weather_takes_far_points_and_gives_near_ones(plain, weather, visibility_m):
    conditions = {"weather": weather, "visibility_m": visibility_m}
    dry = {"weather": weather, "visibility_m": visibility_m, "wet_ground": 0.0}
    clear, bad = scan(plain), scan(plain, conditions=dry)
    distance = [np.linalg.norm(one.points[:, :3], axis=1) for one in (clear, bad)]
    ground = [one.semantic == semantic_id("road") for one in (clear, bad)]
    assert distance[1][ground[1]].max() < distance[0][ground[0]].max()
    assert ground[1].sum() < ground[0].sum()
    clutter = bad.semantic == OUTLIER
    assert clutter.sum() > 20
    assert not (clear.semantic == OUTLIER).any()
    assert distance[1][clutter].max() < 60
    assert (bad.instance[clutter] == 0).all()
    again = scan(plain, conditions=dry)
    np.testing.assert_array_equal(bad.points, again.points)
    off = scan(plain, {"weather": False}, conditions)
    np.testing.assert_array_equal(off.points, clear.points)
    np.testing.assert_array_equal(off.semantic, clear.semantic)


def test_one_point_of_a_beam_unless_it_reports_two(plain):
    fog = {"weather": "fog", "visibility_m": 80.0}
    for returns, most in (("strongest", 1), ("dual", 2)):
        frame = scan(plain, conditions=fog, returns=returns)
        beam = frame.ring.astype(int) * 1024 + frame.column
        assert (np.diff(beam) >= 0).all()
        _, count = np.unique(beam, return_counts=True)
        assert count.max() == most
        assert (frame.semantic == OUTLIER).any()
        second = np.flatnonzero(np.diff(beam) == 0) + 1
        np.testing.assert_array_equal(np.flatnonzero(frame.echo), second)


def test_points_of_the_air_lie_on_their_beams(plain):
    from urbantwin.lidar import beam_directions, sensor

    frame = scan(plain, conditions={"weather": "snow", "visibility_m": 300.0})
    air = frame.semantic == OUTLIER
    way = beam_directions(sensor("OS1-128"), 1024)[frame.ring[air], frame.column[air]]
    points = frame.points[air, :3]
    distance = np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(points / distance, way, atol=1e-5)


def test_a_sign_has_a_halo_at_its_distance_and_a_painted_board_none(plain):
    world = LabelledMesh.concatenate([plain, sign(20.0)])
    halo = scan(world)
    stray = halo.semantic == OUTLIER
    board = halo.semantic == semantic_id("traffic-sign")
    assert stray.sum() > 10
    distance = np.linalg.norm(halo.points[:, :3], axis=1)
    assert np.abs(distance[stray] - 20).max() < 0.6
    # Around the board, within two degrees of it.
    aside = np.degrees(np.abs(np.arctan2(halo.points[stray, 1], halo.points[stray, 0])))
    assert aside.max() < np.degrees(0.5 / 20) + 2
    # Code 208 of class RA1 on the sensor's own scale; the halo is dim.
    assert np.median(halo.points[board, 3]) * 255 == pytest.approx(208, abs=4)
    assert halo.points[stray, 3].max() < 0.3
    off = scan(world, {"blooming": False})
    assert not (off.semantic == OUTLIER).any()
    same = halo.semantic != OUTLIER
    assert same.sum() <= len(off.points)
    white = LabelledMesh.concatenate([plain, sign(20.0, "plaster")])
    assert not (scan(white).semantic == OUTLIER).any()
    dull = scan(world, {"retroreflection": False})
    assert not (dull.semantic == OUTLIER).any()
    foil = dull.points[dull.semantic == semantic_id("traffic-sign"), 3] * 255
    assert np.median(foil) == pytest.approx(60, abs=8)


def test_crosstalk_is_off_by_default_and_stands_above_and_below(plain):
    world = LabelledMesh.concatenate([plain, sign(8.0, size=0.3)])
    effects = {"blooming": False, "crosstalk": True}
    frame = scan(world, effects)
    stray = frame.semantic == OUTLIER
    # All channels of an Ouster fire at once, so whole columns light up at the sign's distance.
    assert stray.sum() > 100
    assert len(np.unique(frame.ring[stray])) > 40
    distance = np.linalg.norm(frame.points[stray, :3], axis=1)
    assert np.abs(distance - 8).max() < 0.6
    columns = np.unique(frame.column[frame.semantic == semantic_id("traffic-sign")])
    assert np.isin(frame.column[stray], columns).all()
    assert not (scan(world, {"blooming": False}).semantic == OUTLIER).any()


def test_night_sees_farther_and_wet_ground_less(plain):
    def reach(**options):
        frame = scan(plain, **options)
        return np.percentile(np.linalg.norm(frame.points[:, :3], axis=1), 99.9)

    day = reach()
    assert reach(conditions={"sun_elevation_deg": -30.0}) > day
    assert reach(conditions={"wet_ground": 1.0}) < 0.8 * day
    assert reach(conditions={"wet_ground": 1.0}, effects={"weather": False}) == day


def test_with_all_effects_off_a_storm_and_a_sign_are_plain_geometry(plain):
    world = LabelledMesh.concatenate([plain, sign(20.0)])
    storm = {"weather": "snow", "visibility_m": 50.0, "sun_elevation_deg": 40.0}
    frame = scan(world, False, storm)
    x, _, z = frame.points[:, :3].T.astype(float)
    board = frame.semantic == semantic_id("traffic-sign")
    assert board.sum() > 50
    np.testing.assert_allclose(x[board], 20, atol=1e-4)
    np.testing.assert_allclose(z[~board], -3, atol=1e-4)
    assert set(np.unique(frame.semantic)) == {semantic_id("road"), semantic_id("traffic-sign")}
    down = frame.points[~board]
    far = np.linalg.norm(down[:, :3], axis=1)
    assert far.max() > 100
