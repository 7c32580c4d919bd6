"""Measures against values known in closed form, and against another program."""

import numpy as np
import open3d as o3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import jensenshannon

from urbantwin.fidelity import (
    Cloud,
    P95Hausdorff,
    RealSurface,
    divergences,
    histograms_of,
    jensen_shannon,
    nearest_distances,
    rebuild_surface,
)
from urbantwin.fidelity.histograms import full_scale
from urbantwin.fidelity.nearest_triangle import NearestTriangle
from urbantwin.fidelity.point_to_mesh import MAX_POINTS


def grid_plane(height, size=20.0, step=0.1):
    x, y = np.meshgrid(np.arange(-size, size, step), np.arange(-size, size, step))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])


def test_hausdorff_of_shifted_planes_is_the_shift():
    a, b = grid_plane(0.0), grid_plane(0.07)
    found = P95Hausdorff.of(nearest_distances(a, b))
    assert found.real_to_synthetic == pytest.approx(0.07)
    assert found.both == pytest.approx(0.07)
    assert P95Hausdorff.of(nearest_distances(a, a)).both == 0


def test_hausdorff_directions_and_quantile():
    # 100 real points; the synthetic cloud lacks the last 10, which lie 1, 2, ... 10 m away.
    real = np.zeros((100, 3))
    real[90:, 0] = np.arange(1, 11)
    found = P95Hausdorff.of(nearest_distances(real, real[:90]))
    # Of the sorted distances 0 (90 times), 1, ..., 10, the 95th percentile is at 0.95 * 99 = 94.05.
    assert found.real_to_synthetic == pytest.approx(5.05)
    assert found.synthetic_to_real == 0
    assert found.both == found.real_to_synthetic


def test_jensen_shannon_of_known_distributions():
    assert jensen_shannon([3, 1], [3, 1]) == 0
    assert jensen_shannon([3, 1], [6, 2]) == 0  # counts are no weights
    assert jensen_shannon([1, 0], [0, 1]) == pytest.approx(1)
    # H(3/4, 1/4) - H(1/2, 1/2) / 2 for (1, 0) and (1/2, 1/2)
    expected = -(0.75 * np.log2(0.75) + 0.25 * np.log2(0.25)) - 0.5
    assert jensen_shannon([1, 0], [1, 1]) == pytest.approx(expected)
    assert jensen_shannon([0, 0], [1, 1]) is None
    with pytest.raises(ValueError, match="negative"):
        jensen_shannon([-1, 2], [1, 1])
    with pytest.raises(ValueError, match="shape"):
        jensen_shannon([1], [1, 1])


@given(
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=30).filter(
        lambda bins: any(a for a, _ in bins) and any(b for _, b in bins)
    )
)
def test_jensen_shannon_agrees_with_scipy(bins):
    p, q = np.array(bins, float).T
    found = jensen_shannon(p, q)
    assert found == pytest.approx(jensenshannon(p, q, base=2) ** 2, abs=1e-12)
    assert found == pytest.approx(jensen_shannon(q, p), abs=1e-15)


def test_histograms_lose_no_point():
    # Points beyond the ends of every histogram.
    points = np.array([[0.5, 0.5, -100.0], [900.0, 0, 100.0], [10.2, 0, 0.1], [10.4, 0, 0.3]])
    found = histograms_of(Cloud(points, np.array([0.0, 255, 300, -1])), intensity_scale=255.0)
    for name in ("range", "height", "intensity"):
        assert found.binned[name].sum() == 4
    assert found.binned["range"][10] == 2
    assert found.binned["height"][[0, 80, 81, -1]].tolist() == [1, 1, 1, 1]
    assert found.binned["intensity"][[0, -1]].tolist() == [2, 2]
    assert found.voxel_points.tolist() == [1, 2, 1]
    assert found.binned["density"][[2, 19, -1]].tolist() == [2, 1, 1]


def test_histograms_of_moved_clouds_are_disjoint():
    cloud = Cloud(grid_plane(0.5, 5), None)
    far = Cloud(cloud.points + np.array([0, 0, 100]), None)
    found = divergences(histograms_of(cloud), histograms_of(far))
    for name in ("occupancy", "height", "range"):
        assert found[name] == pytest.approx(1)
    assert found["intensity"] is None
    given = [value for name, value in found.items() if name != "mean" and value is not None]
    assert found["mean"] == pytest.approx(np.mean(given))
    same = divergences(histograms_of(cloud), histograms_of(cloud))
    assert [same[name] for name in ("occupancy", "range", "height", "density", "mean")] == [0] * 5


@pytest.mark.parametrize(
    ("largest", "scale"), [(0.0, 1), (1.0, 1), (1.5, 255), (255, 255), (256, 65535), (1e6, 1e6)]
)
def test_full_scale(largest, scale):
    assert full_scale(largest) == scale


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((0.25, 0.25, 2.0), 2.0),  # over the face
        ((0.5, -3.0, 4.0), 5.0),  # beyond the edge along x
        ((-3.0, 0.5, -4.0), 5.0),  # beyond the edge along y
        ((1.0, 1.0, 0.0), np.sqrt(0.5)),  # beyond the third edge
        ((-2.0, -1.0, 2.0), 3.0),  # beyond a corner
        ((3.0, -1.0, 2.0), 3.0),  # beyond the second corner
        ((0.0, 4.0, 4.0), 5.0),  # beyond the third corner
        ((0.3, 0.3, 0.0), 0.0),  # in it
    ],
)
def test_point_and_triangle(point, distance):
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    found = NearestTriangle(corners, np.array([[0, 1, 2]])).distances(np.array([point]))
    assert found[0] == pytest.approx(distance)


def test_triangles_without_area():
    point = np.array([[0.5, 3.0, 4.0]])
    for corners, distance in (([0, 1, 2], 5.0), ([0, 0, 0], np.sqrt(25.25))):
        vertices = np.array(corners)[:, None] * [1.0, 0, 0]
        found = NearestTriangle(vertices, np.array([[0, 1, 2]])).distances(point)
        assert found[0] == pytest.approx(distance)


def distance_to_triangle(point, corners):
    """Return it from the signs of the point's turn about each edge, and from the edges."""
    edges = np.roll(corners, -1, axis=0) - corners
    normal = np.cross(edges[0], edges[1])
    to_point = point - corners
    length = np.maximum((edges**2).sum(axis=1), 1e-300)
    along = np.clip((to_point * edges).sum(axis=1) / length, 0, 1)[:, None]
    found = np.linalg.norm(to_point - along * edges, axis=1).min()
    area = np.linalg.norm(normal)
    if area > 1e-9 and (np.cross(edges, to_point) @ normal >= 0).all():
        found = min(found, abs(to_point[0] @ normal) / area)
    return found


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.02, 0.3, 3.0]), st.integers(1, 300))
def test_nearest_triangle_is_exact(seed, size, count):
    # Against every triangle; corners on a coarse grid give ties, triangles without area included.
    rng = np.random.default_rng(seed)
    first = rng.integers(0, 8, (count, 1, 3)).astype(float)
    corners = first + rng.integers(-3, 4, (count, 3, 3)) * size * rng.choice(
        [1, 0.2], (count, 1, 1)
    )
    points = rng.uniform(-6, 14, (4, 3))
    vertices, faces = corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)
    found = NearestTriangle(vertices, faces).distances(points)
    each = [min(distance_to_triangle(p, triangle) for triangle in corners) for p in points]
    np.testing.assert_allclose(found, each, atol=1e-9)


def test_nearest_triangle_agrees_with_open3d():
    rng = np.random.default_rng(5)
    corners = rng.uniform(-10, 10, (2000, 1, 3)) + rng.normal(0, 0.4, (2000, 3, 3))
    points = rng.uniform(-15, 15, (3000, 3))
    scene = o3d.t.geometry.RaycastingScene()
    faces = np.arange(6000).reshape(-1, 3)
    scene.add_triangles(
        o3d.core.Tensor(corners.reshape(-1, 3).astype(np.float32)),
        o3d.core.Tensor(faces.astype(np.uint32)),
    )
    expected = scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()
    found = NearestTriangle(corners.reshape(-1, 3), faces).distances(points)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def scan_of_room(rng, half=10.0, height=3.0):
    """Return what a sensor in the middle of a room of 2 half x 2 half sees of walls and floor."""
    azimuth = np.radians(np.arange(0, 360, 0.5))
    elevation = np.radians(np.arange(-60, 60, 1.0))
    a, e = (grid.ravel() for grid in np.meshgrid(azimuth, elevation))
    d = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    with np.errstate(divide="ignore"):
        wall = (half / np.abs(d[:, :2])).min(axis=1)
        floor = np.where(d[:, 2] < 0, -height / d[:, 2], np.inf)
    return d * np.minimum(wall, floor)[:, None]


def distance_to_room(points, half=10.0, height=3.0):
    return np.minimum(half - np.abs(points[:, :2]).max(axis=1), points[:, 2] + height)


def test_rebuilt_room_is_a_room():
    rng = np.random.default_rng(2)
    scan = scan_of_room(rng)
    surface = rebuild_surface(scan)
    assert surface.covered > 0.99
    # The middles of all triangles lie on the walls or the floor, corners of the room bevelled.
    middle = surface.vertices[surface.faces[: surface.triangles]].mean(axis=1)
    off = np.abs(distance_to_room(middle))
    assert np.percentile(off, 97) < 1e-9
    assert off.max() < 0.5
    # The seam at 180 degrees is closed: the wall there has no gap.
    probe = np.column_stack([np.full(50, -9.9), np.zeros(50), np.linspace(-2.5, 8, 50)])
    nearest = NearestTriangle(surface.vertices, surface.faces).distances(probe)
    np.testing.assert_allclose(nearest, 0.1, atol=1e-9)


def test_point_to_mesh_of_a_shifted_floor():
    scan = scan_of_room(np.random.default_rng(2))
    floor = scan[(scan[:, 2] < -2.999) & (np.abs(scan[:, :2]).max(axis=1) < 8)]
    real = RealSurface(scan)
    assert real.rebuild_error is not None
    assert real.rebuild_error.median < 1e-9
    assert real.distances_of(floor).p95 < 1e-9
    raised = real.distances_of(floor + np.array([0, 0, 0.25]))
    assert raised.median == pytest.approx(0.25)
    assert raised.mean == pytest.approx(0.25, abs=1e-6)


def test_an_identical_copy_is_nearer_than_the_points_kept_out_and_the_next_frame():
    """More points than are measured: the draw of those must not be that of the points kept out."""
    rng = np.random.default_rng(5)
    room = scan_of_room(rng)
    scan, following = (room + rng.normal(0, 0.02, room.shape) for _ in range(2))
    assert len(scan) > MAX_POINTS
    real = RealSurface(scan)
    copied = real.distances_of(scan).mean
    assert copied < 0.2 * real.rebuild_error.mean  # nine of ten points are the surface's own
    assert copied < 0.2 * real.distances_of(following).mean


def test_surface_does_not_bridge_an_object_and_what_is_behind():
    # A wall at 20 m, a post of 0.5 m at 5 m before it: nothing stands between the two.
    azimuth, elevation = (
        g.ravel()
        for g in np.meshgrid(np.radians(np.arange(-20, 20, 0.2)), np.radians(np.arange(-5, 5, 0.4)))
    )
    direction = np.column_stack(
        [np.ones_like(azimuth), np.tan(azimuth), np.tan(elevation) / np.cos(azimuth)]
    )
    post = np.abs(direction[:, 1] * 5) < 0.25
    surface = rebuild_surface(direction * np.where(post, 5.0, 20.0)[:, None])
    x = surface.vertices[surface.faces][..., 0]
    assert (np.ptp(x, axis=1) < 1e-9).all()
    assert surface.triangles > 5000


@pytest.mark.parametrize("count", [1, 2, 3])
def test_surface_of_few_points(count):
    points = np.array([[5.0, 0, 0], [5.0, 0.1, 0], [5.0, 0, 0.1]])[:count]
    surface = rebuild_surface(points)
    assert surface.triangles == (count == 3)
    found = NearestTriangle(surface.vertices, surface.faces).distances(np.array([[4.0, 0, 0]]))
    assert found[0] == pytest.approx(1)
