"""What a person names goes, whatever it is, and the ground under it is closed; crowns stay."""

import numpy as np
import pytest
import shapely
import trimesh

from urbantwin.reconstruct import TriangleMesh
from urbantwin.reconstruct.cleaning import cleaned
from urbantwin.site.geometry import CleanSpec, Spot

from ..thorough import further

REGION = shapely.box(-35, -35, 35, 35)
ROADS = shapely.box(-40, -5, 40, 5)
SLOPE = 0.02


def hillside(step: float = 0.25) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    side = np.arange(-40, 40.01, step)
    count = len(side)
    x, y = np.meshgrid(side, side, indexing="ij")
    k = np.arange(count - 1)
    corner = (k[:, None] * count + k).ravel()
    faces = np.concatenate(
        [
            np.column_stack([corner, corner + count, corner + count + 1]),
            np.column_stack([corner, corner + count + 1, corner + 1]),
        ]
    )
    return x.ravel(), y.ravel(), faces


@pytest.mark.parametrize(
    ("width", "depth", "height", "radius"),
    [(10, 8, 9, 6), *further((3, 2, 12, 3), (18, 12, 6, 11))],
)
def test_what_is_named_is_cut_out_of_the_surface_it_is_one_with(width, depth, height, radius):
    x, y, faces = hillside()
    on_it = (abs(x - 10) < width / 2) & (abs(y - 15) < depth / 2)
    mesh = TriangleMesh.build(np.column_stack([x, y, SLOPE * x + height * on_it]), faces)
    spec = CleanSpec(remove=[Spot(at_m=[10, 15], radius_m=radius)])
    out = cleaned(mesh, spec, region=REGION, roads=ROADS)
    v = out.mesh.vertices
    assert abs(v[:, 2] - SLOPE * v[:, 0]).max() < 0.01
    assert out.report["notes"] == []
    assert len(out.report["removed"]) == 1
    area = shapely.union_all(shapely.polygons(v[out.mesh.faces][:, :, :2])).area
    assert area == pytest.approx(REGION.area, rel=1e-6)  # no hole is left


def test_a_closed_house_on_the_ground_goes_too():
    x, y, faces = hillside(1.0)
    house = trimesh.creation.box((10, 8, 9))
    house.apply_translation((10, 15, 4.5))
    ground = trimesh.Trimesh(np.column_stack([x, y, 0 * x]), faces, process=False)
    both = trimesh.util.concatenate([ground, house])
    spec = CleanSpec(remove=[Spot(at_m=[10, 15], radius_m=6)])
    mesh = TriangleMesh.build(both.vertices, both.faces)
    out = cleaned(mesh, spec, region=REGION, roads=ROADS)
    assert out.mesh.vertices[:, 2].max() == pytest.approx(0.0, abs=1e-6)
    away = CleanSpec(remove=[Spot(at_m=[-20, 15], radius_m=6)])
    out = cleaned(mesh, away, region=REGION, roads=ROADS)
    assert out.mesh.vertices[:, 2].max() == pytest.approx(9.0)
    assert out.report["notes"] == ["nothing to remove within 6 m of (-20.0, 15.0)"]


def test_a_crown_of_loose_leaves_on_a_trunk_stays_and_stray_triangles_go():
    random = np.random.default_rng(4)
    x, y, faces = hillside(1.0)
    ground = trimesh.Trimesh(np.column_stack([x, y, 0 * x]), faces, process=False)
    trunk = trimesh.creation.cylinder(0.15, 5.0)
    trunk.apply_translation((10, 15, 2.5))
    count = 1500
    way = random.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    middle = [10, 15, 5.0] + way * 2.0 * random.uniform(0, 1, (count, 1)) ** (1 / 3)
    leaves = (middle[:, None] + random.normal(0, 0.15, (count, 3, 3))).reshape(-1, 3)
    stray = np.array([[-20, 15, 8.0], [-19.8, 15, 8.0], [-20, 15.2, 8.1]])
    corners = np.concatenate([leaves, stray])
    loose = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    both = trimesh.util.concatenate([ground, trunk, loose])
    mesh = TriangleMesh.build(both.vertices, both.faces)
    out = cleaned(mesh, CleanSpec(), region=REGION, roads=ROADS)
    high = out.mesh.vertices[out.mesh.faces][:, :, 2].min(axis=1) > 0.5
    middle = out.mesh.vertices[out.mesh.faces[high]].mean(axis=1)
    assert abs(middle[:, 0] - 10).max() < 4.0
    assert (np.linalg.norm(middle - [10, 15, 5.0], axis=1) < 3.0).sum() > 0.97 * count
