"""Cropping and decimation of cleaning against closed forms and Open3D."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import open3d as o3d
import pytest
import shapely

from urbantwin.reconstruct import TriangleMesh
from urbantwin.reconstruct.cleaning import cleaned, unseen_error
from urbantwin.reconstruct.cleaning.decimate import decimated
from urbantwin.reconstruct.cleaning.deviation import distances_to_triangles
from urbantwin.reconstruct.cleaning.weld import areas_of_faces, cleared
from urbantwin.site.geometry import CleanSpec, Spot


def grid_mesh(height, half: float, count: int) -> TriangleMesh:
    axis = np.linspace(-half, half, count)
    x, y = np.meshgrid(axis, axis)
    k = np.arange(count * count).reshape(count, count)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    points = np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()])
    return TriangleMesh.build(points, faces.astype(np.int32), name="ground")


def edges_of_one(mesh: TriangleMesh) -> np.ndarray:
    sides = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    assert count.max() <= 2
    return edges[count == 1]


def distances(mesh: TriangleMesh, points: np.ndarray) -> np.ndarray:
    """Open3D's distance of points to a mesh."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor(mesh.faces.astype(np.uint32)),
    )
    return scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def samples(mesh: TriangleMesh, count: int) -> np.ndarray:
    generator = np.random.default_rng(0)
    area = areas_of_faces(mesh)
    face = generator.choice(len(area), count, p=area / area.sum())
    u, v = generator.random((2, count))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u)[:, None], np.where(flip, 1 - v, v)[:, None]
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces[face]], 1, 0)
    return a + u * (b - a) + v * (c - a)


LEAVE = {"shards": False, "traffic": False}
REGIONS = {
    "circle": shapely.Point(1.0, -2.0).buffer(20.0),
    "dented": shapely.Polygon([(-17, -15), (13, -20), (3, 0), (15, 18), (-12, 10)]),
    "holed": shapely.box(-15, -15, 15, 15).difference(shapely.box(-4, -3, 2.5, 2)),
}


@pytest.mark.parametrize("name", REGIONS)
def test_a_crop_is_exact_and_leaves_no_crack(name: str) -> None:
    region = REGIONS[name]
    mesh = grid_mesh(lambda x, y: 0.3 * x - 0.1 * y, 25.0, 83)
    result = cleaned(mesh, CleanSpec(chordal_error_m=0.0, **LEAVE), region=region)
    slope = np.sqrt(1 + 0.3**2 + 0.1**2)
    assert areas_of_faces(result.mesh).sum() == pytest.approx(region.area * slope, rel=1e-5)
    ends = result.mesh.vertices[edges_of_one(result.mesh)]
    # The free edges are the region's outline, all of it and nothing else.
    assert shapely.distance(region.boundary, shapely.points(ends[..., :2])).max() < 2e-4
    length = np.linalg.norm(ends[:, 1, :2] - ends[:, 0, :2], axis=1).sum()
    assert length == pytest.approx(region.length, rel=1e-4)
    np.testing.assert_allclose(
        result.mesh.vertices[:, 2],
        result.mesh.vertices[:, :2] @ [0.3, -0.1],
        atol=1e-4,
    )


def test_walls_are_cut_at_the_border_too() -> None:
    wall = TriangleMesh.build(
        np.array([[-5.0, 0, 0], [5, 0, 0], [5, 0, 3], [-5, 0, 3]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    spec = CleanSpec(chordal_error_m=0.0, **LEAVE)
    result = cleaned(wall, spec, region=shapely.box(-2, -1, 3.5, 1))
    assert areas_of_faces(result.mesh).sum() == pytest.approx(5.5 * 3.0, rel=1e-6)


@pytest.mark.parametrize("error", [0.01, 0.05])
def test_decimation_stays_within_its_bound_by_open3d(error: float) -> None:
    def height(x, y):
        bumps = 0.8 * np.sin(x / 3) * np.cos(y / 4) + np.where(np.abs(x - 5) < 3, 2.0, 0.0)
        return bumps + 0.002 * np.sin(40 * x + 31 * y)

    mesh = grid_mesh(height, 14.0, 127)
    region = shapely.box(-30, -30, 30, 30)
    result = cleaned(mesh, CleanSpec(chordal_error_m=error, **LEAVE), region=region)
    assert len(result.mesh.faces) < 0.5 * len(mesh.faces)
    both = np.concatenate(
        [
            distances(result.mesh, np.concatenate([mesh.vertices, samples(mesh, 30_000)])),
            distances(mesh, np.concatenate([result.mesh.vertices, samples(result.mesh, 30_000)])),
        ]
    )
    # Samples between those that cleaning measured may lie a little farther.
    assert both.max() < 1.1 * error
    assert np.quantile(both, 0.999) <= error
    said = result.report["decimation"]["zones"][0]
    assert said["measured_m"] <= said["bound_m"] == error
    # Borders stay where they were, to the vertex.
    before, after = (
        {tuple(p) for p in np.round(m.vertices[np.unique(edges_of_one(m))], 3)}
        for m in (mesh, result.mesh)
    )
    assert after == before


def test_the_unseen_error_grows_with_range_and_zones_join() -> None:
    np.testing.assert_allclose(
        unseen_error(np.array([0.0, 20, 60, 1000])), [0.01, 0.01, 0.03, 0.05]
    )
    mesh = grid_mesh(lambda x, y: np.sin(x / 6) + 0.5 * np.cos(y / 9), 60.0, 151)
    result = cleaned(
        mesh, CleanSpec(**LEAVE), region=shapely.box(-70, -70, 70, 70), sensors=[[-55, -55, 5]]
    )
    zones = result.report["decimation"]["zones"]
    assert [zone["bound_m"] for zone in zones] == [0.01, 0.02, 0.04]
    points = samples(result.mesh, 40_000)
    off = distances(mesh, points)
    allowed = unseen_error(np.linalg.norm(points - [-55, -55, 5], axis=1))
    assert (off <= allowed).mean() > 0.9999
    # One surface without a gap where the zones meet.
    ends = result.mesh.vertices[edges_of_one(result.mesh)]
    assert (np.abs(ends[..., :2]).max(axis=2) > 59.99).all()


def test_triangles_that_are_none_are_left_out() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [np.nan, 1, 1], [1, 0, 1e-6]])
    faces = np.array([[0, 1, 2], [2, 0, 1], [0, 2, 1], [0, 1, 3], [0, 1, 4], [0, 5, 2]])
    mesh, counts = cleared(TriangleMesh.build(points, faces))
    assert counts == {"not_finite": 1, "degenerate": 1, "duplicate": 3}
    assert len(mesh.faces) == 1
    assert len(mesh.vertices) == 3


def test_an_empty_mesh_stays_empty() -> None:
    empty = TriangleMesh.build(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    spec = CleanSpec(remove=[Spot(at_m=[0.0, 0.0])])
    result = cleaned(empty, spec, region=shapely.box(0, 0, 1, 1))
    assert len(result.mesh.faces) == 0
    far = grid_mesh(lambda x, y: 0 * x, 5.0, 5)
    assert len(cleaned(far, spec, region=shapely.box(90, 90, 95, 95)).mesh.faces) == 0


def test_distances_to_triangles_are_open3ds() -> None:
    generator = np.random.default_rng(4)
    corners, points = generator.normal(0, 1, (300, 3, 3)), generator.normal(0, 2, (300, 3))
    ours = distances_to_triangles(points, corners)
    for k in range(0, 300, 10):
        one = TriangleMesh.build(corners[k], np.array([[0, 1, 2]]))
        assert ours[k] == pytest.approx(float(distances(one, points[k : k + 1])[0]), abs=1e-5)


def test_houses_on_a_hill_without_ground_do_not_float() -> None:
    def house(x: float, z: float) -> TriangleMesh:
        points = np.array(
            [[i * 8.0 + x, j * 6.0, k * 5.0 + z] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
        )
        quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        faces = [[q[i] for i in t] for q in quads for t in ((0, 1, 2), (0, 2, 3))]
        return TriangleMesh.build(points, np.array(faces), name="house")

    hill = TriangleMesh.concatenate([house(15.0 * n, 6.0 * n) for n in range(5)])
    result = cleaned(hill, CleanSpec(), region=shapely.box(-10, -10, 90, 20))
    assert result.report["removed"] == []
    assert areas_of_faces(result.mesh).sum() == pytest.approx(areas_of_faces(hill).sum())
    # One that hangs over another does.
    above = TriangleMesh.concatenate([hill, house(15.0, 30.0)])
    result = cleaned(above, CleanSpec(), region=shapely.box(-10, -10, 90, 20))
    assert [one["why"][:6] for one in result.report["removed"]] == ["floats"]


def test_decimation_in_threads_makes_what_one_thread_makes() -> None:
    mesh = grid_mesh(lambda x, y: np.sin(x / 6) + 0.5 * np.cos(y / 9), 40.0, 81)
    sensors = np.array([[-35.0, -35, 5]])
    zones = [decimated(mesh, sensors, None).mesh]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            zones += pool.map(lambda _: decimated(mesh, sensors, None).mesh, range(8))
    finally:
        sys.setswitchinterval(interval)
    for other in zones[1:]:
        np.testing.assert_array_equal(other.vertices, zones[0].vertices)
        np.testing.assert_array_equal(other.faces, zones[0].faces)
