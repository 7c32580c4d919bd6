"""Where a rig stands, and where it cannot."""

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar.placement import place_rig
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id


def hill():
    """Ground that rises 1 in 10 to the east."""
    vertices = [(-50, -50, -5), (50, -50, 5), (50, 50, 5), (-50, 50, -5)]
    return LabelledMesh.build(
        vertices, [[0, 1, 2], [0, 2, 3]], semantic_id("terrain"), material_id("grass")
    )


def test_height_is_above_the_ground_under_the_sensor(rig_of):
    rig = rig_of(hill(), {"east_m": 20.0, "north_m": -7.0, "height_m": 4.5})
    np.testing.assert_allclose(rig.sensors[0].site_SE3_sensor.translation, [20, -7, 2 + 4.5])


def test_buildings_and_poles_are_not_the_ground(box_mesh, rig_of):
    mesh = LabelledMesh.concatenate(
        [hill(), box_mesh((-1, -1, -1), (1, 1, 20)), box_mesh((9, 9, 0), (11, 11, 5), "pole")]
    )
    on_roof = rig_of(mesh, {"height_m": 21.0}).sensors[0].site_SE3_sensor
    np.testing.assert_allclose(on_roof.translation, [0, 0, 21])
    beside = rig_of(mesh, {"east_m": 10.0, "north_m": 10.0}).sensors[0].site_SE3_sensor
    np.testing.assert_allclose(beside.translation, [10, 10, 6])


def test_attitude_follows_rep_103(ground_mesh, rig_of):
    """Yaw 90 looks north, pitch 30 looks down, roll 10 lowers the right side."""
    angles = {"yaw_deg": 90.0, "pitch_deg": 30.0, "roll_deg": 10.0}
    rotation = rig_of(ground_mesh(), angles).sensors[0].site_SE3_sensor.rotation
    np.testing.assert_allclose(rotation[:, 0], [0, np.sqrt(3) / 2, -0.5], atol=1e-12)
    assert rotation[2, 1] > 0  # Left side up.


def test_dataset_frames(ground_mesh, rig_of):
    sensors = (
        {"east_m": 5.0, "north_m": 6.0, "yaw_deg": 40.0, "pitch_deg": 20.0, "roll_deg": 5.0},
        {"east_m": -9.0, "yaw_deg": 11.0},
    )
    first = Pose.from_ypr((5, 6, 5), *np.radians([40, 20, 5]))
    points = np.random.default_rng(1).normal(size=(20, 3)) * 30
    site = rig_of(ground_mesh(), *sensors, frame="site").dataset_SE3_site
    np.testing.assert_allclose(site.apply(points), points)
    sensor = rig_of(ground_mesh(), *sensors, frame="sensor").dataset_SE3_site
    np.testing.assert_allclose(sensor.apply(first.apply(points)), points, atol=1e-9)
    level = rig_of(ground_mesh(), *sensors, frame="level").dataset_SE3_site
    np.testing.assert_allclose(level.apply(first.translation[None]), [[0, 0, 0]], atol=1e-12)
    ahead = first.translation + [np.cos(np.radians(40)), np.sin(np.radians(40)), 0]
    np.testing.assert_allclose(level.apply(ahead[None]), [[1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(level.rotation[2], [0, 0, 1], atol=1e-12)


def test_columns_default_to_the_model(ground_mesh, rig_of):
    rig = rig_of(ground_mesh(), {}, {"columns": 512})
    assert rig.sensors[0].columns == rig.sensors[0].sensor.columns
    assert rig.sensors[1].columns == 512


def room(box_mesh, *, floor):
    return LabelledMesh.concatenate(
        [hill(), box_mesh((-10, -10, -1), (10, 10, 12), floor=floor, part=3)]
    )


@pytest.mark.parametrize("floor", [True, False])
@pytest.mark.parametrize(("place", "inside"), [
    ((0, 0, 5), True), ((0, 0, 0.05), True), ((9.9, 9.9, 6), True), ((0, 0, 11.9), True),
    ((0, 0, 12.1), False), ((10.1, 0, 5), False), ((11, 11, 1.6), False), ((-30, 4, 9), False),
])  # fmt: skip
def test_inside_a_building(box_mesh, rig_of, floor, place, inside):
    mesh = room(box_mesh, floor=floor)
    east, north, z = place
    sensor = {"east_m": float(east), "north_m": float(north), "height_m": z - east / 10.0}
    if not inside:
        rig_of(mesh, sensor)
        return
    with pytest.raises(InputError, match="inside a building") as error:
        rig_of(mesh, {"east_m": -40.0}, sensor)
    assert error.value.place == "sensors[1].height_m"
    assert error.value.file == "rig.yaml"


def test_a_courtyard_and_a_gap_between_buildings_are_outside(box_mesh, rig_of):
    sides = [
        box_mesh((-20, -20, -3), (20, -10, 15), part=1),
        box_mesh((-20, 10, -3), (20, 20, 15), part=2),
        box_mesh((-20, -10, -3), (-10, 10, 15), part=3),
        box_mesh((10, -10, -3), (20, 10, 15), part=4),
    ]
    rig_of(LabelledMesh.concatenate([hill(), *sides]), {"height_m": 0.5})


@pytest.mark.parametrize(("sensor", "place", "problem", "expected"), [
    ({"model": "OS1-129"}, "sensors[0].model", "unknown sensor 'OS1-129'", "OS1-128"),
    ({"columns": 1000}, "sensors[0].columns", "does not offer 1000 columns", "512, 1024, 2048"),
    ({"east_m": 51.0}, "sensors[0].east_m", "no ground at 51 m east", "ground"),
])  # fmt: skip
def test_wrong_rigs_name_file_field_and_what_was_expected(rig_of, sensor, place, problem, expected):
    with pytest.raises(InputError) as error:
        rig_of(hill(), sensor)
    assert (error.value.file, error.value.place) == ("rig.yaml", place)
    assert problem in str(error.value)
    assert expected in str(error.value)


def test_a_spec_that_skipped_validation_cannot_stand_under_the_ground():
    spec = RigSpec.model_validate(
        {"sensors": [{"name": "a", "model": "OS1-64", "east_m": 0.0, "north_m": 0.0,
                      "height_m": 3.0}]}
    )  # fmt: skip
    buried = spec.model_copy(
        update={"sensors": [spec.sensors[0].model_copy(update={"height_m": -0.5})]}
    )
    with pytest.raises(InputError, match="under the ground") as error:
        place_rig(buried, hill(), file="rig.yaml")
    assert error.value.place == "sensors[0].height_m"


SOLIDS = {
    "pole": "a pole", "trunk": "a tree's trunk", "vegetation": "a plant", "fence": "a fence",
    "other-structure": "a structure", "other-object": "something solid", "road": "something solid",
}  # fmt: skip


@pytest.mark.parametrize(("semantic", "words"), SOLIDS.items())
@pytest.mark.parametrize("part", [0, 7])
def test_inside_any_closed_mesh(box_mesh, rig_of, semantic, words, part):
    shape = box_mesh((3, 3, 0.5), (4, 4, 6), semantic, part=part)
    far = box_mesh((-20, -20, -9), (-18, -18, 30), semantic, part=part)
    mesh = LabelledMesh.concatenate([hill(), far, shape])
    for height, inside in [(2.0, True), (7.5, False)]:
        sensor = {"east_m": 3.4, "north_m": 3.6, "height_m": None, "up_m": height}
        if not inside:
            rig_of(mesh, sensor)
            continue
        with pytest.raises(InputError, match=f"is inside {words}") as error:
            rig_of(mesh, sensor)
        assert error.value.place == "sensors[0].up_m"
    rig_of(mesh, {"east_m": 4.1, "north_m": 3.6, "height_m": 2.0})


def test_a_surface_that_is_not_closed_has_no_inside(box_mesh, rig_of):
    shed = box_mesh((-5, -5, -1), (5, 5, 4), "other-structure", floor=False)
    rig_of(LabelledMesh.concatenate([hill(), shed]), {"height_m": 2.0})


def test_of_two_shapes_in_one_part_each_has_its_own_inside(box_mesh, rig_of):
    """A post in a hollow of another: the winding number of each, and not of their sum."""
    outer = box_mesh((-5, -5, -1), (5, 5, 4), "pole")
    mirrored = outer.faces[:, ::-1]
    inverted = LabelledMesh(outer.vertices, mirrored, outer.semantic, outer.material, outer.part)
    with pytest.raises(InputError, match="is inside a pole"):
        rig_of(LabelledMesh.concatenate([hill(), inverted]), {"height_m": 2.0})


def bridge():
    """Ground at 0 and a deck 6 m above it."""
    low = [(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0)]
    deck = [(-50, -5, 6), (50, -5, 6), (50, 5, 6), (-50, 5, 6)]
    faces = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    return LabelledMesh.build(low + deck, faces, semantic_id("road"), material_id("asphalt"))


def test_under_a_bridge_by_its_height_in_the_site(rig_of):
    on = rig_of(bridge(), {"height_m": 2.0}).sensors[0]
    under = rig_of(bridge(), {"height_m": None, "up_m": 4.5}).sensors[0]
    assert on.site_SE3_sensor.translation[2] == pytest.approx(8.0)
    assert under.site_SE3_sensor.translation[2] == pytest.approx(4.5)
    with pytest.raises(InputError, match=r"-0.1 m is under the ground") as error:
        rig_of(bridge(), {"height_m": None, "up_m": -0.1})
    assert error.value.place == "sensors[0].up_m"


def test_under_a_hill_by_its_height_in_the_site(rig_of):
    with pytest.raises(InputError, match=r"1 m is under the ground, which is at 3\.00 m there"):
        rig_of(hill(), {"east_m": 30.0, "height_m": None, "up_m": 1.0})


def test_altitude_is_above_the_zero_of_the_dem():
    one = {"name": "a", "model": "OS1-64", "east_m": 20.0, "north_m": 0.0, "altitude_m": 519.5}
    spec = RigSpec.model_validate({"sensors": [one]})
    rig = place_rig(spec, hill(), file="rig.yaml", anchor_height_m=512.25)
    assert rig.sensors[0].site_SE3_sensor.translation[2] == pytest.approx(7.25)
    with pytest.raises(InputError, match=r"has no DEM.*expected height_m") as error:
        place_rig(spec, hill(), file="rig.yaml")
    assert error.value.place == "sensors[0].altitude_m"
    with pytest.raises(InputError, match=r"519\.5 m is under the ground, which is at 521\.50 m"):
        place_rig(spec, hill(), file="rig.yaml", anchor_height_m=519.5)


@pytest.mark.parametrize(("sensor", "words"), [
    ({"model": "OS1-128", "returns": "last"}, r"returns: OS1-128 does not report 'last'"),
    ({"rate_hz": 2.0}, r"rate_hz: OS1-128 does not turn 2 times a second; expected 5 to 20"),
    ({"rate_hz": 40.0}, "expected 5 to 20"),
])  # fmt: skip
def test_what_a_sensor_does_not_offer(ground_mesh, rig_of, sensor, words):
    with pytest.raises(InputError, match=words):
        rig_of(ground_mesh(), sensor)


def test_sensors_apart(ground_mesh, rig_of):
    rig = rig_of(ground_mesh(), {"yaw_deg": 10.0}, {"east_m": 7.0, "yaw_deg": 70.0})
    first, second = rig.separate()
    assert [one.sensors[0].number for one in (first, second)] == [0, 1]
    np.testing.assert_allclose(first.dataset_SE3_site.rotation, rig.dataset_SE3_site.rotation)
    np.testing.assert_allclose(second.dataset_SE3_site.apply([[7, 0, 5]]), [[0, 0, 0]], atol=1e-12)
    ahead = [7 + np.cos(np.radians(70)), np.sin(np.radians(70)), 5]
    np.testing.assert_allclose(second.dataset_SE3_site.apply([ahead]), [[1, 0, 0]], atol=1e-12)


def test_looking_straight_down_has_a_heading(ground_mesh, rig_of):
    rig = rig_of(ground_mesh(), {"yaw_deg": 35.0, "pitch_deg": 90.0})
    ahead = [np.cos(np.radians(35)), np.sin(np.radians(35)), 5.0]
    np.testing.assert_allclose(rig.dataset_SE3_site.apply([ahead]), [[1, 0, 0]], atol=1e-9)


def test_a_world_without_ground(rig_of):
    with pytest.raises(InputError, match="no ground"):
        rig_of(LabelledMesh.empty(), {})


@pytest.mark.parametrize(
    ("model", "reported"),
    [("OS1-128", "strongest"), ("VLP-16", "strongest"), ("PandarQT", "first")],
)
def test_a_sensor_that_is_not_told_reports_what_its_maker_offers(
    rig_of, ground_mesh, model, reported
):
    assert rig_of(ground_mesh(), {"model": model}).sensors[0].returns == reported
    given = rig_of(ground_mesh(), {"model": model, "returns": "dual"})
    assert given.sensors[0].returns == "dual"
