"""Roofs of known shape, sampled with noise, are found again: volume, ridge, eaves, planes."""

import numpy as np
import open3d as o3d
import pytest
import shapely
import trimesh

from urbantwin.reconstruct.airborne.building import build_roof

from ..thorough import further

DENSITY, NOISE_M = 10.0, 0.03


def sampled(outline, height, seed=1):
    """Points of a roof z = height(x, y) over an outline, as a survey has them."""
    random = np.random.default_rng(seed)
    west, south, east, north = outline.bounds
    count = int((east - west) * (north - south) * DENSITY)
    xy = random.uniform([west, south], [east, north], (count, 2))
    xy = xy[shapely.contains_xy(outline, xy)]
    z = height(xy[:, 0], xy[:, 1]) + random.normal(0, NOISE_M, len(xy))
    return np.column_stack([xy, z])


def turned(outline, points, degrees, at=(310.0, -120.0)):
    """Turn and move a house: nothing may depend on its place."""
    a = np.radians(degrees)
    matrix = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    moved = shapely.transform(outline, lambda xy: xy @ matrix.T + at)
    return moved, np.column_stack([points[:, :2] @ matrix.T + at, points[:, 2]])


def built(outline, height, degrees=33.0, base=-1.0):
    roof = build_roof(*turned(outline, sampled(outline, height), degrees), base)
    mesh = trimesh.Trimesh(roof.vertices, roof.faces, process=False)
    assert roof.shape == "planes"
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.area_faces.min() > 1e-6
    return roof, mesh


def distances(roof, points):
    """Distance of points to a surface, by Open3D."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(roof.vertices.astype(np.float32)),
        o3d.core.Tensor(roof.faces.astype(np.uint32)),
    )
    return scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def slopes(roof):
    """Slopes of the patches in degrees, and the area of each in plan."""
    slope = [np.degrees(np.arctan(np.hypot(*patch.plane[:2]))) for patch in roof.patches]
    return np.array(slope), np.array([patch.polygon.area for patch in roof.patches])


@pytest.mark.parametrize("degrees", [33.0, *further(0.0, 78.0)])
def test_a_gabled_roof(degrees):
    # 12 x 8 m, eaves 5 m, ridge 8 m along x: 12 x 8 x 6 + 12 x 8 x 3 / 2 = 720 m3 with 1 m below.
    outline = shapely.box(-6, -4, 6, 4)
    roof, mesh = built(outline, lambda x, y: 8 - 0.75 * np.abs(y), degrees)
    assert mesh.volume == pytest.approx(12 * 8 * 6 + 12 * 8 * 3 / 2, rel=0.01)
    assert mesh.bounds[1, 2] == pytest.approx(8.0, abs=0.05)
    slope, area = slopes(roof)
    assert len(slope) == 2
    assert slope == pytest.approx([np.degrees(np.arctan(0.75))] * 2, abs=0.5)
    assert area == pytest.approx([48, 48], abs=1.0)
    assert len(mesh.faces) <= 30


def test_a_hipped_roof():
    # 14 x 8 m, all four sides rise by 0.8: a ridge of 6 m at 5 + 3.2 m.
    outline = shapely.box(-7, -4, 7, 4)
    roof, mesh = built(outline, lambda x, y: 5 + 0.8 * np.minimum(4 - np.abs(y), 7 - np.abs(x)))
    # A wedge 6 m long over 8 m, and a pyramid of 8 x 8 m.
    attic = 6 * 8 * 3.2 / 2 + 8 * 8 * 3.2 / 3
    assert mesh.volume == pytest.approx(14 * 8 * 6 + attic, rel=0.01)
    assert mesh.bounds[1, 2] == pytest.approx(8.2, abs=0.08)
    slope, area = slopes(roof)
    assert slope == pytest.approx([np.degrees(np.arctan(0.8))] * 4, abs=1.0)
    assert sorted(area) == pytest.approx([16, 16, 40, 40], abs=1.0)


def test_a_flat_roof_on_two_levels():
    # An L of 16 x 12 m: a tower of 6 x 6 m at 12 m in its corner, the rest at 4 m.
    outline = shapely.Polygon([(0, 0), (16, 0), (16, 6), (8, 6), (8, 12), (0, 12)])
    roof, mesh = built(outline, lambda x, y: np.where((x < 6) & (y < 6), 12.0, 4.0))
    assert mesh.volume == pytest.approx(36 * 13 + (outline.area - 36) * 5, rel=0.01)
    slope, area = slopes(roof)
    assert slope == pytest.approx([0, 0], abs=0.3)
    assert sorted(area) == pytest.approx([36, outline.area - 36], abs=2.5)


def test_a_shed_roof_with_a_dormer_and_a_chimney():
    # 10 x 10 m rising by 0.5 from 4 m; a dormer of 3 x 3 m at 7.5 m; a chimney of 0.8 x 0.8 m.
    def height(x, y):
        z = 4 + 0.5 * y
        z = np.where((np.abs(x - 5) < 1.5) & (y > 2) & (y < 5), 7.5, z)
        return np.where((np.abs(x - 1.5) < 0.5) & (np.abs(y - 8) < 0.5), 10.0, z)

    outline = shapely.box(0, 0, 10, 10)
    mesh = with_boxes(outline, height)
    plain = 10 * 10 * (1 + 4 + 2.5)
    dormer = 3 * 3 * (7.5 - 4 - 0.5 * 3.5)
    assert mesh.volume == pytest.approx(plain + dormer, abs=8.0)
    # The chimney stands at 10 m where it was put, and nothing else is as high.
    assert mesh.bounds[1, 2] == pytest.approx(10.0, abs=0.15)
    top = mesh.vertices[mesh.vertices[:, 2] > 9.6]
    assert np.median(top[:, :2], axis=0) == pytest.approx([1.5, 8.0], abs=0.3)


def with_boxes(outline, height):
    roof = build_roof(outline, sampled(outline, height), -1.0)
    mesh = trimesh.Trimesh(roof.vertices, roof.faces, process=False)
    assert mesh.is_watertight
    return mesh


def test_a_dome_becomes_facets_within_a_decimetre():
    outline = shapely.Point(0, 0).buffer(9, quad_segs=8)
    points = sampled(outline, lambda x, y: 5 + np.sqrt(np.maximum(15**2 - x**2 - y**2, 0)) - 12)
    roof = build_roof(outline, points, -1.0)
    mesh = trimesh.Trimesh(roof.vertices, roof.faces, process=False)
    assert mesh.is_watertight
    truth = sampled(outline, lambda x, y: 5 + np.sqrt(15**2 - x**2 - y**2) - 12, seed=7)
    far = distances(roof, truth)
    assert np.median(far) < 0.1
    assert np.percentile(far, 95) < 0.35


def along(y):
    return 5 - np.abs(y)


def across(x):
    return 9 - np.abs(x)


SHAPES = {
    "skillion": lambda x, y: 4 + 0.3 * (y + 5),
    "pyramidal": lambda x, y: 4 + np.minimum(along(y), across(x) * 5 / 9),
    "half-hipped": lambda x, y: 4 + 0.9 * np.minimum(along(y), across(x) + 2),
    "mansard": lambda x, y: (
        4
        + np.minimum(2 * np.minimum(along(y), across(x)), 3 + 0.3 * np.minimum(along(y), across(x)))
    ),
    "crossed": lambda x, y: 4 + 0.8 * np.maximum(along(y), np.minimum(5, 4 - np.abs(x))),
    "barrel": lambda x, y: 4 + np.sqrt(26 - y**2),
    "on four levels": lambda x, y: 4 + np.where(x > 3, 4.0, 0) + np.where(y > 2, 2.5, 0),
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("yard", [False, True], ids=["", "with a yard"])
def test_the_volume_under_a_roof(shape, yard):
    outline = shapely.box(-9, -5, 9, 5)
    if yard:
        outline = outline.difference(shapely.box(-4, -2, -1, 1))
    height = SHAPES[shape]
    roof, mesh = built(outline, height, 51.0)
    # The midpoint rule on 5 cm: the house is 1 m deeper than its roof's heights say.
    x, y = np.meshgrid(np.arange(-8.975, 9, 0.05), np.arange(-4.975, 5, 0.05))
    inside = shapely.contains_xy(outline, x, y)
    volume = (height(x, y)[inside] + 1).mean() * outline.area
    assert mesh.volume == pytest.approx(volume, rel=0.01)
    truth = sampled(outline, height, seed=9)
    moved = turned(outline, truth, 51.0)[1]
    assert np.percentile(distances(roof, moved), 95) < 0.15
    assert len(mesh.faces) < 200


def test_few_points_give_a_flat_roof():
    outline = shapely.box(0, 0, 6, 5)
    points = np.array([[1.0, 1, 3.1], [4, 2, 2.9], [2, 4, 3.0], [5, 4, 3.0], [3, 3, 3.0]])
    roof = build_roof(outline, points, -1.0)
    assert roof.shape == "flat"
    mesh = trimesh.Trimesh(roof.vertices, roof.faces, process=False)
    assert mesh.volume == pytest.approx(6 * 5 * 4.0)


def test_the_same_points_give_the_same_bytes():
    outline = shapely.box(-6, -4, 6, 4)
    points = sampled(outline, lambda x, y: 8 - 0.75 * np.abs(y))
    first, second = (build_roof(outline, points.copy(), -1.0) for _ in range(2))
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()
