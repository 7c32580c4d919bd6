"""The CARLA package, read as CARLA's import reads it and judged by CARLA's own classes."""

import fnmatch
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from scipy.spatial import cKDTree

from urbantwin.errors import InputError
from urbantwin.exports import export_twin
from urbantwin.exports.carla import live
from urbantwin.exports.carla.frame import carla_transform, pose_of_carla
from urbantwin.exports.carla.live import (
    SEMANTIC_POINT,
    LiveError,
    chosen_blueprints,
    drive,
    site_points,
)
from urbantwin.exports.carla.names import OBJECTS, folder_of, map_name
from urbantwin.exports.carla.rig import carla_rig, carla_sensor
from urbantwin.geometry import Pose
from urbantwin.io.fbx import read_fbx
from urbantwin.lidar.placement import place_rig
from urbantwin.site.rig import RideSpec


@pytest.fixture(scope="module")
def exported(perth_twin, perth_package):
    """A twin and its package."""
    return perth_twin, perth_package


def files(folder):
    package = json.loads((folder / "carla.json").read_text())
    here = folder / package["package"]
    return package, here, here / package["map"] / package["map"]


def test_the_package_is_laid_out_as_make_import_reads_it(exported):
    _, folder = exported
    package, here, base = files(folder)
    assert (folder / "navigation" / base.with_suffix(".obj").name).is_file()
    # CARLA's Import.py takes every .json under carla/Import for a package.
    found = [path for path in here.rglob("*") if fnmatch.fnmatch(path.name, "*.json")]
    assert [path.name for path in found] == [f"{package['package']}.json"]
    content = json.loads(found[0].read_text())
    assert content["props"] == []
    (entry,) = content["maps"]
    assert entry["name"] == package["map"]
    assert (here / entry["xodr"]).is_file()
    assert (here / entry["source"]).is_file()
    assert (here / entry["source"]).name == f"{entry['name']}.fbx"
    assert len((folder / "README.txt").read_text().splitlines()) <= 40


def test_the_same_twin_gives_the_same_package(exported, tmp_path):
    twin, folder = exported
    export_twin(twin, "carla", tmp_path / "again")
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        again = tmp_path / "again" / path.relative_to(folder)
        assert path.read_bytes() == again.read_bytes(), path.name


@pytest.mark.parametrize(
    "name",
    [
        "Lightfoot Road",
        "perth_stretched_lights",
        "Design Signals",
        "Main Road",
        "Old Roads",
        "信義路",
    ]
    + ["Terrain Terrace", "Big_Tile_0_1", "Road_Road_Curb", "Straße / Café", "9th Ave", "***", ""],
)
def test_a_map_s_name_does_not_change_how_its_meshes_are_sorted(name):
    slug = map_name(name, -31.95, 115.86)
    assert slug.isascii()
    assert slug.replace("_", "").isalnum()
    assert slug[0].isalpha()
    for kind in OBJECTS:
        assert folder_of(f"{slug}_{kind}_0") == folder_of(f"M_{kind}_0"), (slug, kind)


def test_meshes_of_the_ground_are_sorted_into_their_tags(exported):
    _, folder = exported
    package, _, _ = files(folder)
    for kind in ("Road_Road", "Road_Marking", "Road_Sidewalk", "Road_Curb", "Terrain"):
        assert package["objects"][kind] > 0
        assert folder_of(f"{package['map']}_{kind}_0") == OBJECTS[kind]
    # CARLA sets up its own.
    for kind in ("TrafficLight", "TrafficSign"):
        assert folder_of(f"{package['map']}_{kind}_0") is None


def objects_of(folder):
    """Triangles (N, 3, 3) of the FBX by kind of object, as ufbx reads them: site frame."""
    mesh = read_fbx(files(folder)[2].with_suffix(".fbx")).mesh
    kinds = [re.sub(r"_\d+ / .*", "", name) for name in mesh.names]
    corners = mesh.vertices[mesh.faces]
    return {
        kind: corners[np.isin(mesh.object, [k for k, one in enumerate(kinds) if one == kind])]
        for kind in dict.fromkeys(kinds)
    }


def test_every_triangle_of_the_twin_is_in_the_fbx(exported):
    twin, folder = exported
    found = objects_of(folder)
    assert set(found) <= set(OBJECTS)
    cross = {k: np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]) for k, t in found.items()}
    areas = {kind: np.linalg.norm(one, axis=1).sum() / 2 for kind, one in cross.items()}
    assert areas.pop("Road_Marking") > 0
    assert sum(areas.values()) == pytest.approx(float(twin.mesh.areas().sum()), rel=1e-4)
    corners = np.concatenate(list(found.values())).reshape(-1, 3)
    assert np.allclose(corners.min(axis=0), twin.mesh.vertices.min(axis=0), atol=1e-3)
    assert np.allclose(corners.max(axis=0), twin.mesh.vertices.max(axis=0), atol=1e-3)


def road_mesh(folder):
    """The carriageway as another program casts rays at it: x, z, y of CARLA's frame."""
    scene = o3d.t.geometry.RaycastingScene()
    corners = objects_of(folder)["Road_Road"].reshape(-1, 3)[:, [0, 2, 1]] * [1, 1, -1]
    faces = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(o3d.core.Tensor(corners.astype(np.float32)), o3d.core.Tensor(faces))
    return scene


def height_over(scene, points):
    """How far points (N, 3) of CARLA's frame are over the mesh; nan where it is not under them."""
    lift = 5.0
    origins = np.asarray(points)[:, [0, 2, 1]] + [0, lift, 0]
    rays = np.column_stack([origins, np.tile([0, -1, 0], (len(origins), 1))]).astype(np.float32)
    found = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy()
    return np.where(np.isfinite(found), found - lift, np.nan)


def crown_at(model, point):
    """How far the surface at a place lies below its roads' reference lines, for each road there."""
    xy = np.array([[point[0], -point[1]]])
    for road in model.roads:
        s, t = (float(value[0]) for value in road.curve.locate(xy))
        if -0.5 < s < road.length + 0.5 and abs(t) < 25.0:
            yield float(road.elevation.at(s)[0] - road.heights(s, t)[0])


def test_lanes_of_carla_s_map_lie_on_the_mesh(exported, carla_says):
    twin, folder = exported
    _, _, base = files(folder)
    points = np.array(carla_says(task="waypoints", xodr=str(base.with_suffix(".xodr"))))
    assert len(points) > 50
    scene = road_mesh(folder)
    places = points[:, [0, 2, 1]].astype(np.float32)
    nearest = scene.compute_closest_points(o3d.core.Tensor(places))["points"].numpy()
    beside = np.hypot(*(nearest - places)[:, [0, 2]].T)
    over = height_over(scene, points)
    assert beside[np.isnan(over)].max(initial=0.0) < 0.05
    # CARLA knows no cross-fall: its lanes are as high as the reference line at their station.
    for point, above in zip(points[::17], over[::17], strict=True):
        if np.isfinite(above) and above < 2.0:  # not under a bridge
            assert min(abs(above - fall) for fall in crown_at(twin.lane_model, point)) < 0.05, point


def test_spawn_points_are_on_driving_lanes_outside_junctions(exported, carla_says):
    _, folder = exported
    _, _, base = files(folder)
    points = json.loads((folder / "spawn_points.json").read_text())["spawn_points"]
    assert len(points) > 10
    placed = [{key: point[key] for key in ("location", "rotation")} for point in points]
    answers = carla_says(task="on_map", xodr=str(base.with_suffix(".xodr")), points=placed)
    for point, answer in zip(points, answers, strict=True):
        assert answer is not None, point
        assert answer["type"] == "Driving"
        assert not answer["junction"]
        assert abs(answer["aside"]) < 0.05, point
        assert abs(answer["turned"]) < 5.0  # CARLA's lanes run as their road, ours as their middle
    xyz = np.array([[p["location"][key] for key in "xyz"] for p in points])
    assert np.nanmax(np.abs(height_over(road_mesh(folder), xyz) - 0.5)) < 0.05
    lanes = [p["lane"] for p in points]
    for lane in set(lanes):
        on_it = xyz[[name == lane for name in lanes], :2]
        if len(on_it) > 1:
            assert np.linalg.norm(np.diff(on_it, axis=0), axis=1).min() > 10.0


def test_transforms_are_carla_s(carla_says):
    random = np.random.default_rng(1)
    poses = [
        Pose.from_ypr(random.uniform(-50, 50, 3), *random.uniform([-3, -1.5, -3], [3, 1.5, 3]))
        for _ in range(20)
    ]
    points = random.uniform(-20, 20, (5, 3))
    mirrored = points * [1, -1, 1]  # what a sensor of CARLA would call them
    job = [{**carla_transform(pose), "points": mirrored.tolist()} for pose in poses]
    answers = np.array(carla_says(task="transformed", transforms=job))
    for pose, answer in zip(poses, answers, strict=True):
        assert np.allclose(answer * [1, -1, 1], pose.apply(points), atol=2e-3)


def test_points_of_a_sensor_come_back_to_the_site():
    pose = Pose.from_ypr([5.0, -3.0, 6.0], 1.0, 0.2, -0.1)
    entry = carla_transform(pose)
    place = [entry["location"][key] for key in "xyz"]
    turn = [entry["rotation"][key] for key in ("pitch", "yaw", "roll")]
    again = pose_of_carla(place, turn)
    assert np.allclose(again.rotation, pose.rotation, atol=1e-5)
    assert np.allclose(again.translation, pose.translation, atol=1e-4)
    points = np.zeros(1, SEMANTIC_POINT)
    points["x"], points["y"], points["z"], points["tag"] = 10.0, -2.0, 1.0, 7  # 2 m to the left
    moved = site_points(points, place, turn)
    expected = pose.apply(np.array([[10.0, 2.0, 1.0]]))[0]
    assert np.allclose([moved["x"][0], moved["y"][0], moved["z"][0]], expected, atol=1e-3)
    assert moved["tag"][0] == 7


def test_the_rig_becomes_ray_cast_sensors(small_twin):
    twin = small_twin
    rig = place_rig(twin.rig_spec(), twin.mesh)
    sensor = rig.sensors[0]
    entry = carla_sensor(sensor)
    attributes = {name: float(value) for name, value in entry["attributes"].items()}
    assert entry["blueprint"] == "sensor.lidar.ray_cast_semantic"
    assert attributes["channels"] == sensor.sensor.channels
    # One turn of the sensor is one step of the server.
    assert attributes["points_per_second"] == sensor.sensor.channels * sensor.columns * rig.rate_hz
    assert attributes["rotation_frequency"] == rig.rate_hz
    assert attributes["upper_fov"] == pytest.approx(sensor.sensor.elevation_deg.max(), abs=1e-3)
    assert attributes["lower_fov"] == pytest.approx(sensor.sensor.elevation_deg.min(), abs=1e-3)
    assert attributes["range"] == sensor.sensor.range_max_m


def test_a_sensor_turns_at_its_own_speed_and_a_rig_that_rides_is_refused(small_twin):
    twin = small_twin
    own = twin.rig_spec().sensors[0].model_copy(update={"rate_hz": 20.0})
    spec = twin.rig_spec().model_copy(update={"sensors": [own]})
    rig = place_rig(spec, twin.mesh)
    written = carla_rig(rig)
    assert written["fixed_delta_seconds"] == pytest.approx(1 / rig.rate_hz)
    attributes = written["sensors"][0]["attributes"]
    assert float(attributes["rotation_frequency"]) == 20.0
    columns, channels = rig.sensors[0].columns, rig.sensors[0].sensor.channels
    assert float(attributes["points_per_second"]) == channels * columns * 20.0
    with pytest.raises(InputError, match="the rig is mounted on a vehicle"):
        carla_rig(replace(rig, ride=RideSpec(track=3)))


def test_traffic_reproduces_the_site_s_mix(exported):
    twin, folder = exported
    traffic = json.loads((folder / "traffic.json").read_text())
    asked = twin.site["traffic"]
    assert traffic["seed"] == asked["seed"]
    for name, flow in asked["per_hour"].items():
        if not flow or any(one["class"] == name for one in traffic["left_out"]):
            continue
        entry = traffic["classes"][name]
        assert entry["per_hour"] == flow
        # Little's law: what is there at a time leaves within the mean time that it takes.
        expected = flow * entry["mean_travel_s"] / 3600
        assert abs(entry["population"] - max(1.0, expected)) <= 0.51


class Blueprint:
    """As carla.ActorBlueprint answers; CARLA gives none without a server."""

    def __init__(self, name, base_type=None):
        self.id, self.base_type = name, base_type

    def has_attribute(self, name):
        return name == "base_type" and self.base_type is not None

    def get_attribute(self, _name):
        return self

    def as_str(self):
        return self.base_type


class Library(list):
    def filter(self, pattern):
        return Library(one for one in self if fnmatch.fnmatch(one.id, pattern))


def test_each_class_of_traffic_has_blueprints_of_its_own(exported):
    _, folder = exported
    classes = json.loads((folder / "traffic.json").read_text())["classes"]
    library = Library(
        [
            Blueprint("vehicle.audi.a2", "car"),
            Blueprint("vehicle.dodge.charger_police_2020", "car"),
            Blueprint("vehicle.mercedes.sprinter", "van"),
            Blueprint("vehicle.carlamotors.carlacola", "truck"),
            Blueprint("vehicle.carlamotors.firetruck", "truck"),
            Blueprint("vehicle.mitsubishi.fusorosa", "bus"),
            Blueprint("vehicle.yamaha.yzf", "motorcycle"),
            Blueprint("vehicle.bh.crossbike", "bicycle"),
            Blueprint("walker.pedestrian.0001"),
            Blueprint("sensor.lidar.ray_cast"),
        ]
    )
    expected = {
        "car": ["vehicle.audi.a2"],
        "van": ["vehicle.mercedes.sprinter"],
        "truck": ["vehicle.carlamotors.carlacola"],
        "bus": ["vehicle.mitsubishi.fusorosa"],
        "motorcycle": ["vehicle.yamaha.yzf"],
        "bicycle": ["vehicle.bh.crossbike"],
        "pedestrian": ["walker.pedestrian.0001"],
    }
    for name, entry in classes.items():
        assert chosen_blueprints(library, entry) == expected[name]


def test_the_fbx_of_the_package_is_the_same_mesh_in_centimetres(small_twin, small_package):
    path = files(small_package)[2].with_suffix(".fbx")
    content = path.read_bytes()
    for name in ("Road_Road_0", "Road_Sidewalk_0", "Road_Marking_0", "Terrain_0", "Building_0"):
        assert f"{name}\x00\x01Model".encode() in content  # how FBX writes a node's name
    # Open3D's Assimp turns y up, as the file's axes tell it to: x, z, -y of x east, y north, z up.
    read = o3d.io.read_triangle_model(str(path)).meshes
    corners = np.concatenate([np.asarray(one.mesh.vertices) for one in read])
    paint = "Road_Marking"
    unpainted = [np.asarray(o.mesh.vertices) for o in read if not o.mesh_name.startswith(paint)]
    expected = small_twin.mesh.vertices[:, [0, 2, 1]] * [100, 100, -100]
    assert cKDTree(corners).query(expected)[0].max() < 0.5
    assert cKDTree(expected).query(np.concatenate(unpainted))[0].max() < 0.5


def test_what_is_called_is_there(carla_says):
    """Names alone: what they do on a server was not tried."""
    called = {
        "Client": "set_timeout get_server_version get_available_maps load_world get_world "
        "generate_opendrive_world get_trafficmanager",
        "World": "get_settings apply_settings tick get_actors get_blueprint_library "
        "set_pedestrians_seed try_spawn_actor spawn_actor get_random_location_from_navigation",
        "WorldSettings": "synchronous_mode fixed_delta_seconds",
        "TrafficManager": "set_synchronous_mode set_random_device_seed get_port "
        "vehicle_percentage_speed_difference set_desired_speed",
        "BlueprintLibrary": "find filter",
        "ActorBlueprint": "id has_attribute get_attribute set_attribute",
        "ActorAttribute": "as_str",
        "Vehicle": "set_autopilot destroy get_transform get_velocity bounding_box type_id id",
        "WalkerAIController": "start stop go_to_location set_max_speed",
        "Sensor": "listen stop destroy",
        "SemanticLidarMeasurement": "raw_data frame transform",
        "LidarMeasurement": "raw_data frame transform",
        "BoundingBox": "location extent",
        "Transform": "location rotation transform",
    }
    wanted = {name: members.split() for name, members in called.items()}
    assert carla_says(task="missing", members=wanted) == []
    source = Path(live.__file__).read_text(encoding="utf-8")
    for members in wanted.values():
        assert all(re.search(rf"\b{member}\b", source) for member in members)


def test_no_server_is_told_in_one_line(exported, tmp_path):
    _, folder = exported
    pytest.importorskip("carla", reason="no CARLA (pip install 'urbantwin[carla]')")
    with pytest.raises(LiveError, match=r"no CARLA server at localhost:1") as caught:
        drive(folder, tmp_path / "out", port=1)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_what_is_no_package_is_told_in_one_line(tmp_path):
    with pytest.raises(LiveError, match=r"traffic\.json cannot be read"):
        drive(tmp_path, tmp_path / "out")


def test_without_carla_s_package_one_is_told_how_to_get_it(exported, tmp_path, monkeypatch):
    _, folder = exported
    monkeypatch.setitem(sys.modules, "carla", None)
    with pytest.raises(LiveError, match="pip install carla"):
        drive(folder, tmp_path / "out")


def test_the_package_has_the_program_and_it_needs_nothing_of_ours(exported, tmp_path):
    _, folder = exported
    program = "import sys; sys.modules['urbantwin'] = sys.modules['carla'] = None; import runpy; "
    program += "sys.argv = sys.argv[1:]; runpy.run_path(sys.argv[0], run_name='__main__')"
    command = [sys.executable, "-c", program, folder / "run_in_carla.py", tmp_path / "frames"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "pip install carla" in done.stderr
