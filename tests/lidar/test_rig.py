"""Where a rig stands, and where it cannot."""

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar.rig import place_rig
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


def test_a_world_without_ground(rig_of):
    with pytest.raises(InputError, match="no ground"):
        rig_of(LabelledMesh.empty(), {})
