"""A real survey: half of the points of Delft make the model, and the other half judges it."""

import laspy
import numpy as np
import open3d as o3d
import pytest
import shapely
from pyproj import Transformer

from urbantwin.geometry import SiteFrame
from urbantwin.reconstruct import PointCloud
from urbantwin.reconstruct.airborne import from_airborne, read_footprints
from urbantwin.reconstruct.airborne.ground_filter import ground_by_filter
from urbantwin.reconstruct.airborne.noise import is_noise

from ..real_files import AHN3

TO_WGS84 = Transformer.from_crs(28992, 4326, always_xy=True)
#: A quarter of the tile: three streets of houses.
REGION = shapely.box(-60.0, -20.0, 40.0, 80.0)


def placed(frame, points):
    lonlat = np.column_stack(TO_WGS84.transform(points[:, 0], points[:, 1]))
    return np.column_stack([frame.site_from_lonlat(lonlat), points[:, 2]])


pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def delft(shared_data):
    """Survey, outlines and reference triangles (vertices, faces) in one site frame."""
    folder = shared_data / "airborne/delft-ahn3"
    longitude, latitude = TO_WGS84.transform(84940.0, 447527.0)
    frame = SiteFrame(latitude, longitude)
    tiles = [laspy.read(path) for path in (folder / name for name in AHN3)]
    cloud = PointCloud(
        placed(frame, np.concatenate([tile.xyz for tile in tiles])),
        None,
        np.concatenate([np.asarray(tile.classification, np.uint8) for tile in tiles]),
        np.concatenate([np.asarray(t.return_number == t.number_of_returns) for t in tiles]),
    )
    near = shapely.contains_xy(REGION.buffer(20), cloud.points[:, 0], cloud.points[:, 1])
    outlines = read_footprints(folder / "bgt/bgt_pand.sqlite", frame, REGION)
    vertices, faces, wanted = [], [], False
    for line in (folder / "reference/testarea.obj").read_text().splitlines():
        key, *rest = line.split() or [""]
        if key == "v":
            vertices.append([float(x) for x in rest[:3]])
        elif key == "usemtl":
            wanted = rest[0] in ("Building", "BuildingWall")
        elif key == "f" and wanted:
            faces.append([int(x.split("/")[0]) - 1 for x in rest])
    return cloud.select(near), outlines, (placed(frame, np.array(vertices)), np.array(faces))


@pytest.fixture(scope="module")
def halves(delft):
    cloud, outlines, _ = delft
    half = np.random.default_rng(0).random(len(cloud.points)) < 0.5
    model = from_airborne(cloud.select(half), footprints=outlines, region=REGION, name="half")
    return model, cloud.select(~half)


def distances(vertices, faces, points):
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), faces.astype(np.uint32))
    return scene.compute_distance(o3d.core.Tensor(points.astype(np.float32))).numpy()


def test_building_points_lie_nearer_to_ours_than_to_the_reference(delft, halves):
    _, outlines, reference = delft
    model, held = halves
    wide = shapely.union_all(outlines).buffer(1.0)
    at = held.points
    points = at[(held.classification == 6) & shapely.contains_xy(wide, at[:, 0], at[:, 1])]
    ours = distances(model.buildings.vertices, model.buildings.faces, points)
    theirs = distances(*reference, points)
    assert len(points) > 15_000
    assert np.median(ours) < 0.1 * np.median(theirs)
    assert np.percentile(ours, 95) < 0.4 * np.percentile(theirs, 95)
    assert np.median(ours) < 0.05


def test_every_building_is_closed(halves):
    model, _ = halves
    assert len(model.outlines) > 70
    o3d.utility.set_verbosity_level(o3d.utility.VerbosityLevel.Error)
    mesh = model.buildings
    whole = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices), o3d.utility.Vector3iVector(mesh.faces)
    )
    assert whole.is_edge_manifold(allow_boundary_edges=False)
    assert whole.is_orientable()
    assert mesh.areas().min() > 1e-6
    # Outward: the signed volume of each building is at least what stands in its lowest metre.
    a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
    volume = np.bincount(mesh.part, weights=(a * np.cross(b, c)).sum(axis=1) / 6)
    assert (volume[1:] > [outline.area for outline in model.outlines]).all()


def test_the_ground_meets_the_points_that_it_was_not_made_of(halves):
    model, held = halves
    patch = model.ground
    earth = held.points[held.classification == 2]
    earth = earth[shapely.contains_xy(REGION, earth[:, 0], earth[:, 1])]
    column = np.rint((earth[:, 0] - patch.west) / patch.step).astype(int)
    row = np.rint((earth[:, 1] - patch.south) / patch.step).astype(int)
    off = earth[:, 2] - patch.heights[row, column]
    assert np.isfinite(off).all()
    assert np.sqrt(np.mean(off**2)) < 0.06
    assert np.median(np.abs(off)) < 0.02


def test_the_filter_finds_the_ground_that_the_survey_names(delft):
    cloud, _, _ = delft
    clean = cloud.select(~is_noise(cloud))
    clean = clean.select(clean.classification != 26)
    truth = np.isin(clean.classification, (2, 9))
    found = ground_by_filter(clean.points)
    assert (truth & ~found).sum() / truth.sum() < 0.02
    assert (found & ~truth).sum() / found.sum() < 0.08


def test_trees_stand_in_the_street_and_not_on_roofs(delft, halves):
    cloud, outlines, _ = delft
    model, _ = halves
    roofs = shapely.union_all(outlines).buffer(-0.5)
    at = shapely.points([(tree.x, tree.y) for tree in model.trees])
    assert len(at) > 5
    assert shapely.contains(roofs, at).sum() == 0
    # Each has points of its own at its height, and the survey calls none of them a building.
    other = cloud.points[cloud.classification == 1]
    for tree in model.trees:
        near = np.hypot(other[:, 0] - tree.x, other[:, 1] - tree.y) < tree.crown_m / 2 + 0.5
        ground = model.ground.heights[
            round((tree.y - model.ground.south) / model.ground.step),
            round((tree.x - model.ground.west) / model.ground.step),
        ]
        assert other[near, 2].max() - ground > 0.8 * tree.height_m
