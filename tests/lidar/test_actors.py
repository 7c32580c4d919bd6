"""Actors that move while a sensor turns, against everything cast at everything."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import Scanner, beam_directions
from urbantwin.lidar.actor_path import ActorPath, Paths, PosedActor
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.casting.backend import tracer_on
from urbantwin.lidar.casting.cast import cast_actors
from urbantwin.lidar.casting.tracer import Firing, SensorPoses
from urbantwin.lidar.compiled.bounds import bounds_of_box
from urbantwin.lidar.shapes import ActorShape, PresentActors, Shapes
from urbantwin.lidar.timing import Sweep
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic.assets import asset_mesh

from ..thorough import further

COLUMNS = 256
EXACT = {"effects": False}


def box(half, semantic="car", material="metal-painted"):
    corners = (np.arange(8)[:, None] >> np.arange(3) & 1) * 2.0 - 1.0
    faces = [
        [0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
        [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5],
    ]  # fmt: skip
    return LabelledMesh.build(
        corners * half, faces, semantic_id(semantic), material_id(material), 1
    )


def slab_ranges(origins, directions, half):
    """Ranges at which rays enter a box about the origin, by the slab method; inf for misses."""
    with np.errstate(divide="ignore"):
        one, other = (-half - origins) / directions, (half - origins) / directions
    enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    outside = np.where(enter > 0, enter, leave)
    return np.where((enter <= leave) & (leave > 0), outside, np.inf)


# Rings at even and at uneven steps, shuffled rings, offsets in azimuth, both senses of turning.
@pytest.mark.parametrize("model", ["OS1-64", "HDL-64E", *further("VLS-128", "PandarXT-32")])
@settings(max_examples=40, deadline=None)
@given(
    start=st.tuples(st.floats(-30, 30), st.floats(-30, 30), st.floats(-12, 8)),
    closeness=st.floats(0.02, 1),
    step=st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-0.2, 0.2)),
    half=st.tuples(st.floats(0.05, 6), st.floats(0.05, 2), st.floats(0.05, 2)),
    yaw=st.tuples(st.floats(-np.pi, np.pi), st.floats(-0.05, 0.05)),
    first=st.integers(0, COLUMNS - 1),
)
def test_every_beam_finds_a_moving_box_where_it_is_when_the_beam_fires(  # noqa: PLR0917
    rig_of, street, model, start, closeness, step, half, yaw, first
):
    mounted = rig_of(street, {"model": model, **EXACT}).sensors[0]
    object.__setattr__(mounted, "columns", COLUMNS)
    beams = Beams.of(mounted)
    sensor_pose = Pose.from_ypr((1.0, 2.0, 3.0), 0.3, 0.1, -0.05)
    turn = (np.arange(COLUMNS) - first) % COLUMNS / COLUMNS * 0.1
    sweep = Sweep(turn, np.linspace(0.0, 3e-4, mounted.sensor.channels))
    # Two legs of a path, with a turn on the second (1 rad/s at most).
    places = sensor_pose.translation + np.array(start) * closeness
    places = np.array([places, places + np.array(step) / 2, places + np.array(step)])
    turned = [yaw[0], yaw[0], yaw[0] + yaw[1]]
    way = ActorPath(
        np.array([0.0, 0.05, 0.1]),
        np.array([Pose.from_ypr((0, 0, 0), a).rotation for a in turned]),
        places,
    )
    half = np.array(half)
    shape = ActorShape(box(half))
    poses = SensorPoses(sensor_pose.rotation[None], sensor_pose.translation[None])
    actors = PresentActors(Shapes.of([shape]), np.zeros(1, np.int64), Paths.of([way]))
    firing = Firing.of(beams, sweep, poses)
    met = cast_actors(tracer_on(), beams, firing, actors, 1e6, glass=False)
    ours = np.full(len(beams.directions), np.inf)
    ours[met.ray] = met.range_m
    assert len(np.unique(met.ray)) == len(met.ray)

    ray = np.arange(len(beams.directions))
    times = turn[ray % COLUMNS] + sweep.ring_time_s[ray // COLUMNS]
    # Straight on all the time; turning about z on the second leg only.
    angle = yaw[0] + yaw[1] * np.clip(times - 0.05, 0, None) / 0.05
    c, z = np.cos(angle), np.sin(angle)

    def in_box(vectors):
        x, y, up = vectors.T
        return np.column_stack([c * x + z * y, c * y - z * x, up])

    aims = in_box(beams.directions @ sensor_pose.rotation.T)
    moved = places[0] + np.array(step) * (times / 0.1)[:, None]
    origins = in_box(sensor_pose.translation - moved)
    truth = slab_ranges(origins, aims, half)
    # Beams that only just touch: in the box widened by 2 mm, and not in the narrowed one.
    wide = slab_ranges(origins, aims, half + 2e-3)
    narrow = slab_ranges(origins, aims, np.maximum(half - 2e-3, 0))
    sure = np.isfinite(wide) == np.isfinite(narrow)
    inside = (np.abs(origins) < half + 1e-2).all(axis=1)
    sure &= ~inside
    assert (np.isfinite(ours) == np.isfinite(truth))[sure].all()
    hit = np.isfinite(truth) & sure
    # At a grazing angle a millimetre beside is more along the beam.
    slack = 2e-3 + np.abs(narrow[hit] - wide[hit])
    assert (np.abs(ours[hit] - truth[hit]) <= slack).all()


@pytest.mark.parametrize(
    "centre",
    [(0, 0, -3), (0, 0, 3), (2, 1, -5), (-4, 0, -1.5), (-4, 2e-7, -1.5), (-20, 0, 0)],
)
def test_bounds_hold_a_box_over_around_and_behind_the_sensor(centre):
    rng = np.random.default_rng(0)
    half = np.array([2.0, 1.0, 1.0])
    inside = np.array(centre) + rng.uniform(-1, 1, (20_000, 3)) * half
    azimuth = np.arctan2(inside[:, 1], inside[:, 0])
    elevation = np.arctan2(inside[:, 2], np.hypot(inside[:, 0], inside[:, 1]))
    start, width, low, high = bounds_of_box(-half, half, np.eye(3), -np.array(centre, float))
    assert ((azimuth - start + 1e-9) % (2 * np.pi) <= width + 2e-9).all()
    assert (elevation >= low - 1e-9).all()
    assert (elevation <= high + 1e-9).all()


def open3d_ranges(meshes, origin, directions):
    """Cast at all meshes with Open3D: range and number of the mesh (-1 where none is)."""
    open3d = pytest.importorskip("open3d")
    scene = open3d.t.geometry.RaycastingScene()
    for mesh in meshes:
        scene.add_triangles(
            (mesh.vertices - origin).astype(np.float32), mesh.faces.astype(np.uint32)
        )
    rays = np.concatenate([np.zeros_like(directions), directions], axis=1, dtype=np.float32)
    found = scene.cast_rays(open3d.core.Tensor(rays))
    number = found["geometry_ids"].numpy().astype(np.int64)
    return found["t_hit"].numpy(), np.where(number == scene.INVALID_ID, -1, number)


@pytest.mark.parametrize(("model", "columns"), [("OS1-128", 2048), ("VLS-128", 1800)])
@pytest.mark.filterwarnings("default")  # Open3D's imports warn.
def test_with_all_effects_off_a_frame_is_what_open3d_sees(street, rig_of, crowd, model, columns):
    """Every point of full frames, for three moments of a crowd, has Open3D's mesh and range."""
    place = {"model": model, "columns": columns, "yaw_deg": 20, "pitch_deg": 4}
    rig = rig_of(street, {**place, **EXACT}, frame="site")
    mounted = rig.sensors[0]
    pose = mounted.site_SE3_sensor
    aims = beam_directions(mounted.sensor, columns).reshape(-1, 3) @ pose.rotation.T
    scanner = Scanner(street, rig, seed=0)
    differing = foreground = 0
    for moment in range(3):
        actors = crowd(24, seed=moment)
        frame = scanner.scan(0, actors)
        beam = frame.ring.astype(np.int64) * columns + frame.column
        assert (np.diff(beam) > 0).all()
        ours_range, ours = np.full(len(aims), np.inf), np.full(len(aims), -1)
        ours_range[beam] = np.linalg.norm(frame.points[:, :3] - pose.translation, axis=1)
        ours[beam] = frame.instance
        posed = [asset_mesh(a.asset, a.phase).transformed(a.site_SE3_asset) for a in actors]
        theirs_range, theirs = open3d_ranges(
            [street, *posed], pose.translation, aims.astype(np.float32)
        )
        span = (mounted.sensor.assumed_range_min_m, mounted.sensor.assumed_range_max_m)
        out = (theirs_range < span[0]) | (theirs_range > span[1])
        theirs_range, theirs = np.where(out, np.inf, theirs_range), np.where(out, -1, theirs)
        foreground += (theirs > 0).sum()
        # Points carry float32 coordinates: a tenth of a millimetre, besides a hit's own error.
        unlike = (ours != theirs) | ~np.isclose(ours_range, theirs_range, rtol=0, atol=1e-3)
        differing += unlike.sum()
    assert foreground > 5000
    # A beam that only just touches a silhouette is a matter of float32's last bit.
    assert differing <= 3


def test_a_car_at_15_m_s_is_skewed_as_geometry_says(rig_of, street):
    """A wall of a car that crosses the view: each point lies where the wall is when it is hit."""
    rig = rig_of(street, {"effects": {**dict.fromkeys(("noise", "dropout", "quantisation",
        "footprint", "glass", "retroreflection", "blooming", "sun", "weather"), False)}},
        frame="site")  # fmt: skip
    speed = np.array([0.0, 15.0, 0.0])
    shape = box(np.array([2.0, 4.0, 1.0]))
    actor = PosedActor(1, "car", "wall", 0, Pose.from_ypr((12.0, -6.0, 1.2)), speed)
    scanner = Scanner(LabelledMesh.empty(), rig, seed=0, meshes=lambda asset, phase: shape)
    frame = scanner.scan(0, [actor])
    assert len(frame.points) > 500
    mounted = rig.sensors[0]
    fired = frame.column / mounted.columns / 10.0
    np.testing.assert_allclose(frame.time_s, fired, atol=2e-6)
    centre = actor.site_SE3_asset.translation + speed * fired[:, None]
    local = frame.points[:, :3] - centre
    on_faces = np.abs(np.abs(local) - [2.0, 4.0, 1.0]).min(axis=1)
    assert on_faces.max() < 1e-3
    assert (np.abs(local) <= np.array([2.0, 4.0, 1.0]) + 1e-3).all()
    # The box stands where the wall was in the middle of being seen.
    label = frame.boxes[0]
    assert fired.min() < label.observed_s < fired.max()
    np.testing.assert_allclose(
        label.box[:3], actor.site_SE3_asset.translation + speed * label.observed_s, atol=1e-9
    )
