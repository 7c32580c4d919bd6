"""Whole frames: labels that agree with the points, and with the world they came from."""

import pickle

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose, bounding_box, points_in_box
from urbantwin.geometry.rays import RayScene
from urbantwin.lidar import beam_directions
from urbantwin.lidar.actor_path import PosedActor
from urbantwin.lidar.scanner import Scanner
from urbantwin.taxonomy import ACTOR_SEMANTICS, semantic_id
from urbantwin.traffic.assets import asset_mesh

PAIR = (
    {"east_m": 9.0, "north_m": -9.0, "yaw_deg": 120.0, "pitch_deg": 12.0, "columns": 1024},
    {"east_m": -9.0, "north_m": 9.0, "yaw_deg": -60.0, "model": "VLP-32C", "height_m": 4.0},
)


def same(one, other):
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("points", "semantic", "instance", "sensor", "ring", "column")
    ) and [(b.track, b.num_points, b.num_points_alone) for b in one.boxes] == [
        (b.track, b.num_points, b.num_points_alone) for b in other.boxes
    ]


@pytest.fixture(scope="module", params=["level", "sensor", "site"])
def scanned(request, street, rig_of, crowd):
    """A rig of two sensors in each dataset frame, noise and drop-out on, two frames."""
    rig = rig_of(street, *PAIR, frame=request.param)
    scanner = Scanner(street, rig, seed=11)
    frames = []
    for index in range(2):
        actors = crowd(40, seed=index)
        frames.append((actors, scanner.scan(index, actors)))
    return rig, frames


def test_every_labelled_point_lies_in_its_own_box(scanned):
    _, frames = scanned
    checked = 0
    for _, frame in frames:
        inside_some = np.zeros(len(frame.points), bool)
        for box in frame.boxes:
            own = frame.instance == box.track
            assert points_in_box(frame.points[own], box.box, 0.02).all()
            assert own.sum() == box.num_points
            inside_some |= points_in_box(frame.points, box.box, 0.02)
            checked += own.sum()
        things = np.isin(frame.semantic, [semantic_id(name) for name in ACTOR_SEMANTICS.values()])
        np.testing.assert_array_equal(things, frame.instance > 0)
        assert inside_some[things].all()
    assert checked > 1500


def test_classes_and_instances_agree(scanned):
    _, frames = scanned
    for actors, frame in frames:
        assert [box.track for box in frame.boxes] == [actor.track for actor in actors]
        for actor in actors:
            own = frame.semantic[frame.instance == actor.track]
            assert (own == semantic_id(ACTOR_SEMANTICS[actor.actor_class])).all()
        assert np.isin(
            frame.semantic[frame.instance == 0],
            [semantic_id(name) for name in ("road", "building", "pole", "outlier")],
        ).all()
        # Only beams whose edge an actor is in measure what is neither it nor what is behind it.
        assert 0 < (frame.semantic == semantic_id("outlier")).sum() < 0.01 * len(frame.points)


def test_boxes_bound_their_posed_meshes_in_the_dataset_frame(scanned):
    rig, frames = scanned
    for actors, frame in frames:
        for actor, box in zip(actors, frame.boxes, strict=True):
            mesh = asset_mesh(actor.asset, actor.phase)
            in_dataset = rig.dataset_SE3_site.apply(
                actor.site_SE3_asset.apply(mesh.vertices[np.unique(mesh.faces)])
            )
            np.testing.assert_allclose(box.box, bounding_box(in_dataset, box.box[6]), atol=1e-9)
            forward = rig.dataset_SE3_site.rotation @ actor.site_SE3_asset.rotation[:, 0]
            assert np.cos(box.box[6]) * forward[0] + np.sin(box.box[6]) * forward[1] > 0.8


def test_points_lie_on_the_beams_that_they_name(scanned):
    """Back in its sensor's frame, a point stands in the direction of its ring and column."""
    rig, frames = scanned
    for _, frame in frames:
        for number, mounted in enumerate(rig.sensors):
            own = frame.sensor == number
            assert own.sum() > 5000
            sensor_SE3_dataset = (rig.dataset_SE3_site @ mounted.site_SE3_sensor).inverse()
            xyz = sensor_SE3_dataset.apply(frame.points[own, :3])
            # The head turns on at 10 Hz while a column's channels fire one after another.
            aim = beam_directions(mounted.sensor, mounted.columns, turns_per_second=10.0)[
                frame.ring[own], frame.column[own]
            ]
            off = np.linalg.norm(xyz - aim * (xyz * aim).sum(axis=1, keepdims=True), axis=1)
            assert off.max() < 1e-4
            ray = frame.ring[own].astype(int) * mounted.columns + frame.column[own]
            assert (np.diff(ray) > 0).all()


def test_frames_do_not_depend_on_order_or_history(street, rig_of, crowd):
    rig = rig_of(street, *PAIR)
    worlds = [crowd(15, seed=index) for index in range(3)]
    forward = Scanner(street, rig, seed=4)
    frames = [forward.scan(index, world) for index, world in enumerate(worlds)]
    backward = Scanner(street, rig, seed=4)
    for index in (2, 0, 1, 0):
        assert same(backward.scan(index, worlds[index][::-1]), frames[index])
    assert not same(Scanner(street, rig, seed=5).scan(0, worlds[0]), frames[0])
    assert not same(forward.scan(1, worlds[0]), frames[0])


def test_rays_away_from_an_actor_are_as_without_it(street, rig_of, crowd):
    # Halos of an actor's plates fall beside it too.
    off = dict.fromkeys(("footprint", "glass", "blooming"), False)
    thin = [{**one, "effects": off} for one in PAIR]
    scanner = Scanner(street, rig_of(street, *thin), seed=4)
    empty, busy = scanner.scan(0, []), scanner.scan(0, crowd(15, seed=1))

    def static(frame):
        return {
            (int(s), int(r), int(c)): tuple(p)
            for s, r, c, p, i in zip(
                frame.sensor, frame.ring, frame.column, frame.points, frame.instance, strict=True
            )
            if i == 0
        }

    before, after = static(empty), static(busy)
    assert len(after) > 10_000
    assert all(before[beam] == point for beam, point in after.items())


def test_a_frame_without_actors(street, rig_of):
    frame = Scanner(street, rig_of(street, {"columns": 512}), seed=0).scan(0, [])
    assert frame.boxes == ()
    assert len(frame.points) > 1000
    assert (frame.instance == 0).all()
    assert frame.points.dtype == np.float32
    assert frame.semantic.dtype == frame.instance.dtype == np.uint16


def behind_a_wall(box_mesh, ground_mesh):
    """A car 20 m ahead whose rear half a wall hides from a sensor at car height."""
    wall = box_mesh((9.9, -20, 0), (10.1, 0, 9))
    car = PosedActor(
        1, "car", "box", 0, Pose.from_ypr((20, 0, 0), np.pi / 2), np.array([1.0, 2.0, 0])
    )
    return LabelledMesh.concatenate([ground_mesh(), wall]), car


def test_occlusion_is_the_hidden_share_of_rays(box_mesh, ground_mesh, rig_of):
    """The wall's edge points at the car's middle, so half of its rays are hidden."""
    static, car = behind_a_wall(box_mesh, ground_mesh)
    mesh = box_mesh((-2, -1, 0.2), (2, 1, 1.6), "car", "metal-painted")
    rig = rig_of(
        static,
        {"height_m": 1.0, "columns": 2048, "effects": False},
        frame="sensor",
    )
    frame = Scanner(static, rig, seed=1, meshes=lambda *_: mesh).scan(0, [car])
    (label,) = frame.boxes
    mounted = rig.sensors[0]
    aims = beam_directions(mounted.sensor, 2048).reshape(-1, 3).astype(np.float32)
    posed = mesh.transformed(car.site_SE3_asset)
    alone = RayScene(posed.vertices, posed.faces).cast(np.array([0, 0, 1.0]), aims)
    hit = alone.face >= 0
    assert label.num_points_alone == hit.sum() > 300
    assert label.num_points == (hit & (aims[:, 1] > 0)).sum()
    assert label.visibility == pytest.approx(0.5, abs=0.03)
    assert label.occlusion == 1 - label.visibility
    np.testing.assert_allclose(label.velocity, [1, 2, 0])


def test_occlusion_does_not_feel_drop_out(box_mesh, ground_mesh, rig_of):
    """An actor in the open is wholly visible however many of its returns are lost."""
    _, car = behind_a_wall(box_mesh, ground_mesh)
    static = ground_mesh()
    mesh = box_mesh((-2, -1, 0.2), (2, 1, 1.6), "car", "rubber")
    rig = rig_of(static, {"model": "PandarQT", "height_m": 1.0})
    (label,) = Scanner(static, rig, seed=1, meshes=lambda *_: mesh).scan(0, [car]).boxes
    assert 0 < label.num_points == label.num_points_alone
    assert label.visibility == 1.0


def test_boxes_without_points_are_kept(box_mesh, ground_mesh, rig_of):
    """One wholly hidden, one too far away to return anything."""
    static, _ = behind_a_wall(box_mesh, ground_mesh)
    mesh = box_mesh((-2, -1, 0.2), (2, 1, 1.6), "car", "metal-painted")
    hidden = PosedActor(7, "car", "box", 0, Pose.from_ypr((15, -6, 0)), np.zeros(3))
    far = PosedActor(8, "truck", "box", 0, Pose.from_ypr((0, 900, 0)), np.zeros(3))
    rig = rig_of(static, {"height_m": 1.0})
    frame = Scanner(static, rig, seed=1, meshes=lambda *_: mesh).scan(0, [far, hidden])
    first, second = frame.boxes
    assert (first.track, first.num_points, first.occlusion) == (7, 0, 1.0)
    assert first.num_points_alone > 100
    assert (second.track, second.num_points, second.num_points_alone) == (8, 0, 0)
    assert np.isnan(second.occlusion)
    assert np.isnan(second.visibility)


def test_effects_off_gives_the_plain_geometry(ground_mesh, rig_of):
    """On a flat ground every point lies at z = 0, and every beam that reaches it returns."""
    static = ground_mesh(half=90.0)
    rig = rig_of(static, {"effects": False}, frame="site")
    frame = Scanner(static, rig, seed=1).scan(0, [])
    assert np.abs(frame.points[:, 2]).max() < 1e-4
    mounted = rig.sensors[0]
    down = -beam_directions(mounted.sensor, mounted.columns)[..., 2]
    low, high = mounted.sensor.range_min_m, mounted.sensor.range_max_m
    reach = (down > 0) & (5 / np.maximum(down, 1e-9) < min(high, 89))
    assert len(frame.points) >= (reach & (5 / np.maximum(down, 1e-9) > low)).sum() > 50_000


def test_glass_mostly_drops_out(box_mesh, ground_mesh, rig_of):
    static = ground_mesh()
    rig = rig_of(static, {"height_m": 1.0})
    car = PosedActor(1, "car", "box", 0, Pose.from_ypr((60, 0, 0)), np.zeros(3))
    share = {}
    for material in ("glass", "metal-painted"):
        mesh = box_mesh((-2, -1, 0.2), (2, 1, 1.6), "car", material)
        (label,) = Scanner(static, rig, seed=1, meshes=lambda *_, m=mesh: m).scan(0, [car]).boxes
        share[material] = label.num_points
    assert share["glass"] < 0.2 * share["metal-painted"]


@pytest.mark.parametrize("track", [0, 65536])
def test_a_track_that_no_label_can_hold(street, rig_of, crowd, track):
    scanner = Scanner(street, rig_of(street, {"columns": 512}), seed=0)
    (actor,) = crowd(1, seed=0)
    odd = PosedActor(track, actor.actor_class, actor.asset, 0, actor.site_SE3_asset, np.zeros(3))
    with pytest.raises(InputError, match=f"track {track}"):
        scanner.scan(0, [odd])


def test_what_another_scanner_saw_is_not_looked_at_again(street, rig_of, crowd, monkeypatch):
    rig = rig_of(street, *PAIR)
    first = Scanner(street, rig, seed=11)
    monkeypatch.setattr("urbantwin.lidar.scanner.World.layers", None)
    second = Scanner(street, rig, seed=11, standing=pickle.loads(pickle.dumps(first.standing)))
    actors = crowd(40, seed=3)
    assert same(first.scan(3, actors), second.scan(3, actors))
