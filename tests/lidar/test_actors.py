"""Actors cast inside their rectangles against everything cast at everything."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from urbantwin.geometry import Pose
from urbantwin.lidar import beam_directions, sensor
from urbantwin.lidar.actors import ActorHits, ActorShape, cast_actors, nearest
from urbantwin.lidar.casting import EmbreeCaster
from urbantwin.lidar.rectangle import RayGrid, angular_bounds
from urbantwin.lidar.static import cast_static
from urbantwin.taxonomy import materials
from urbantwin.traffic.assets import asset_mesh

CORNERS = (np.arange(8)[:, None] >> np.arange(3)) & 1
COLUMNS = 360


def slab_hits(directions, pose, half):
    """Which rays from the origin touch a posed box, by the slab method in float64."""
    origin = pose.inverse().apply(np.zeros((1, 3)))[0]
    local = directions @ pose.rotation
    with np.errstate(divide="ignore"):
        one, other = (-half - origin) / local, (half - origin) / local
    enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    return (enter <= leave) & (leave > 0)


def rectangle_rays(model, pose, half, columns=COLUMNS):
    corners = pose.apply((CORNERS * 2 - 1) * half)
    bounds = angular_bounds(corners[None])
    return RayGrid(sensor(model), columns).rays_within(
        bounds.azimuth[0], bounds.width[0], bounds.lowest[0], bounds.highest[0]
    )


# Rings at even and at uneven steps, shuffled rings, offsets in azimuth up to 6 degrees.
@pytest.mark.parametrize("model", ["OS1-64", "VLS-128", "HDL-64E", "PandarQT"])
@settings(max_examples=150, deadline=None)
@given(
    centre=st.tuples(st.floats(-40, 40), st.floats(-40, 40), st.floats(-15, 10)),
    closeness=st.floats(0.01, 1),
    half=st.tuples(st.floats(0.05, 9), st.floats(0.05, 3), st.floats(0.05, 3)),
    angles=st.tuples(st.floats(-np.pi, np.pi), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
)
def test_no_ray_outside_the_rectangle_touches_the_box(model, centre, closeness, half, angles):
    directions = beam_directions(sensor(model), COLUMNS).reshape(-1, 3)
    pose = Pose.from_ypr(np.array(centre) * closeness, *angles)
    touching = np.flatnonzero(slab_hits(directions, pose, np.array(half)))
    rays = rectangle_rays(model, pose, np.array(half))
    assert len(np.unique(rays)) == len(rays)
    assert np.isin(touching, rays).all()


@pytest.mark.parametrize(
    "centre",
    [(0, 0, -3), (0, 0, 3), (0, 0, 0), (2, 1, -5), (-4, 0, -1.5), (-4, 2e-7, -1.5), (-20, 0, 0)],
)
def test_boxes_over_around_and_behind_the_sensor(centre):
    directions = beam_directions(sensor("OS1-64"), COLUMNS).reshape(-1, 3)
    half = np.array([2.0, 1.0, 1.0])
    touching = np.flatnonzero(slab_hits(directions, Pose.from_ypr(centre), half))
    rays = rectangle_rays("OS1-64", Pose.from_ypr(centre), half)
    assert np.isin(touching, rays).all()


def test_rectangle_is_not_the_whole_turn():
    """A conservative rectangle is worth something only while it is small."""
    directions = beam_directions(sensor("VLS-128"), 1800).reshape(-1, 3)
    pose, half = Pose.from_ypr((12, -9, -4), 0.6), np.array([2.2, 0.9, 0.75])
    touching = slab_hits(directions, pose, half).sum()
    assert touching > 200
    assert len(rectangle_rays("VLS-128", pose, half, 1800)) < 2.5 * touching


def open3d_hits(meshes, origin, directions):
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
def test_full_frame_of_moving_actors_hits_what_open3d_hits(street, rig_of, crowd, model, columns):
    """Every hit of a full frame, for three moments of a crowd, has Open3D's mesh and range."""
    mounted = rig_of(street, {"model": model, "columns": columns, "yaw_deg": 20, "pitch_deg": 4})
    mounted = mounted.sensors[0]
    pose = mounted.site_SE3_sensor
    directions = beam_directions(mounted.sensor, columns).reshape(-1, 3) @ pose.rotation.T
    static = cast_static(street, pose.translation, directions)
    aimed = directions.astype(np.float32)
    differing = foreground = 0
    for moment in range(3):
        actors = crowd(24, seed=moment)
        meshes = [asset_mesh(actor.asset, actor.phase) for actor in actors]
        poses = [actor.site_SE3_asset for actor in actors]
        hits = cast_actors(
            RayGrid(mounted.sensor, columns),
            aimed,
            pose,
            np.inf,
            [(ActorShape(mesh), place) for mesh, place in zip(meshes, poses, strict=True)],
        )
        front = nearest(hits, static.range_m)
        ours_range, ours = static.range_m.copy(), np.where(static.face >= 0, 0, -1)
        ours_range[hits.ray[front]] = hits.range_m[front]
        ours[hits.ray[front]] = hits.actor[front] + 1
        posed = [mesh.transformed(place) for mesh, place in zip(meshes, poses, strict=True)]
        world = [street, *posed]
        theirs_range, theirs = open3d_hits(world, pose.translation, aimed)

        foreground += (theirs > 0).sum()
        # A ray that only just touches a silhouette is a matter of float32's last bit: it counts
        # as the same when Open3D sees what we see within 1 mm beside it at that range.
        unlike = np.flatnonzero(
            (ours != theirs) | ~np.isclose(ours_range, theirs_range, rtol=0, atol=1e-3)
        )
        differing += len(unlike)
        explained = np.zeros(len(unlike), bool)
        across = np.cross(directions[unlike], [0, 0, 1.0])
        upright = np.cross(directions[unlike], across)
        reach = np.where(np.isfinite(ours_range[unlike]), ours_range[unlike], 200)[:, None]
        for angle in np.arange(8) * np.pi / 4:
            aside = (np.cos(angle) * across + np.sin(angle) * upright) * 1e-3 / reach
            range_m, mesh = open3d_hits(
                world, pose.translation, (directions[unlike] + aside).astype(np.float32)
            )
            near = np.isclose(range_m, ours_range[unlike], atol=0.02)
            explained |= (mesh == ours[unlike]) & near
        assert explained.all()
    print(f"{foreground} foreground rays, {differing} on a silhouette")
    assert foreground > 5000
    assert differing <= 3


def test_nearest_sees_one_surface_per_ray():
    hits = ActorHits(
        np.array([0, 1, 1, 2, 3, 3, 4]),
        np.array([0, 0, 1, 1, 1, 2, 2]),
        np.array([5, 5, 4, 9, 7, 7, 3], np.float32),
        np.ones(7, np.float32),
    )
    static = np.array([6, 8, 8, np.inf, 3], np.float32)
    assert nearest(hits, static).tolist() == [0, 2, 4, 6]


def test_backscatter_is_that_of_the_face_hit(box_mesh):
    """A turned painted box: cosine of incidence from its own faces, worked out apart."""
    mesh = box_mesh((-2, -1, 0), (2, 1, 1.5), "car", "metal-painted")
    site_SE3_asset = Pose.from_ypr((8, 3, -1), 0.7, 0.1, -0.05)
    model = sensor("OS1-64")
    directions = beam_directions(model, COLUMNS).reshape(-1, 3)
    hits = cast_actors(
        RayGrid(model, COLUMNS),
        directions.astype(np.float32),
        Pose.from_ypr((0, 0, 0)),
        120.0,
        [(ActorShape(mesh), site_SE3_asset)],
    )
    posed = mesh.transformed(site_SE3_asset)
    found = EmbreeCaster(posed.vertices, posed.faces).cast(
        np.zeros(3), directions.astype(np.float32)
    )
    assert set(hits.ray) == set(np.flatnonzero(found.face >= 0))
    cosine = np.abs((posed.normals()[found.face[hits.ray]] * directions[hits.ray]).sum(axis=1))
    np.testing.assert_allclose(hits.backscatter, 0.45 * cosine, atol=1e-4)
    np.testing.assert_allclose(hits.range_m, found.range_m[hits.ray], atol=1e-4)


def test_one_shape_answers_sensors_of_two_wavelengths(box_mesh):
    """Skin is bright at 905 nm and dark at 1550 nm, in whatever order it is asked for."""
    shape = ActorShape(box_mesh((4, -1, -1), (5, 1, 1), "pedestrian", "skin"))
    model = sensor("OS1-64")
    directions = beam_directions(model, COLUMNS).reshape(-1, 3).astype(np.float32)
    found = [
        cast_actors(
            RayGrid(model, COLUMNS),
            directions,
            Pose.from_ypr((0, 0, 0)),
            50.0,
            [(shape, Pose.from_ypr((0, 0, 0)))],
            wavelength,
        ).backscatter
        for wavelength in (905.0, 1550.0, 905.0)
    ]
    skin = materials()["skin"].reflectivities
    np.testing.assert_allclose(found[1] / found[0], skin[2] / skin[1], rtol=1e-5)
    np.testing.assert_array_equal(found[0], found[2])


def test_an_actor_beyond_reach_is_left_out(box_mesh):
    shape = ActorShape(box_mesh((-2, -1, 0), (2, 1, 1.5), "car"))
    model = sensor("OS1-64")
    directions = beam_directions(model, 2048).reshape(-1, 3).astype(np.float32)

    def count(x):
        return len(
            cast_actors(
                RayGrid(model, 2048),
                directions,
                Pose.from_ypr((0, 0, 0)),
                50.0,
                [(shape, Pose.from_ypr((x, 0, -1)))],
            ).ray
        )

    assert count(51.9) > 0
    assert count(52.1) == 0


def test_no_actors_no_hits():
    hits = cast_actors(
        RayGrid(sensor("OS1-64"), 8),
        np.zeros((512, 3), np.float32),
        Pose.from_ypr((0, 0, 0)),
        50.0,
        [],
    )
    assert len(hits.ray) == 0
