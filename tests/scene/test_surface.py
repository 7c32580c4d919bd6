"""The ground surface: whole, without overlaps, on the right heights."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from urbantwin.geometry import DownwardProbe, LabelledMesh, SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, driving_side
from urbantwin.roads.model import CURB_HEIGHT_M
from urbantwin.scene import PARTS
from urbantwin.scene.surface import Spacing, surface_mesh
from urbantwin.scene.zones import Zone, ground_zones
from urbantwin.site import read_extract

from ..real_files import osm_extract
from ..thorough import further

REGION = shapely.Point(0, 0).buffer(100)
PLACES = {
    "taipei": (25.052396, 121.522635),
    "neukolln": (52.47328, 13.439643),
    "quad_intersection": (47.644172, -122.303614),
    "perth_stretched_lights": (-31.974855, 115.897588),
    # Two lanes here coincide so nearly that exact set operations fail.
    "West-Oakland": (37.8070776, -122.3025247),
}


def level(height=0.0):
    return lambda xy: np.full(len(xy), height)


def plan_areas(mesh):
    corners = mesh.triangles()[:, :, :2]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2


def hits_per_column(mesh, points):
    """How many faces a vertical line meets, by walking down from hit to hit."""
    probe = DownwardProbe(mesh)
    z = np.full(len(points), 1000.0)
    count = np.zeros(len(points), int)
    for _ in range(6):
        found = probe.height_below(np.column_stack([points, z]))
        hit = ~np.isnan(found)
        count += hit
        z = np.where(hit, found - 0.02, -1e4)
    return count


def edge_uses(mesh):
    """Number of triangles at each edge, vertices at one place counted as one."""
    _, same = np.unique(np.round(mesh.vertices * 1e4).astype(int), axis=0, return_inverse=True)
    edges = np.sort(same.ravel()[mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)], axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    return np.unique(edges, axis=0, return_counts=True)


def strips():
    """A 7 m street between 2 m sidewalks, terrain beyond: 40 m long."""
    return [
        Zone("carriageway", shapely.box(0, 0, 40, 7), 40, 1),
        Zone(
            "footway",
            shapely.MultiPolygon([shapely.box(0, -2, 40, 0), shapely.box(0, 7, 40, 9)]),
            48,
            3,
        ),
        Zone(
            "terrain",
            shapely.MultiPolygon([shapely.box(0, -20, 40, -2), shapely.box(0, 9, 40, 30)]),
            72,
            5,
        ),
    ]


def test_areas_heights_and_curbs_of_a_straight_street():
    mesh = surface_mesh(
        strips(), road_height=level(2.0), terrain_height=level(2.0), spacing=Spacing(5.0, 5.0)
    )
    area = plan_areas(mesh)
    for kind, expected in (("carriageway", 280.0), ("footway", 160.0), ("terrain", 1560.0)):
        assert area[mesh.part == PARTS[kind]].sum() == pytest.approx(expected, abs=1e-6)
    curb = mesh.select(mesh.part == PARTS["curb"])
    assert curb.areas().sum() == pytest.approx(2 * 40 * CURB_HEIGHT_M, abs=1e-6)
    # Curbs face the carriageway, up faces up.
    middle = curb.triangles().mean(axis=1)
    assert (curb.normals()[:, 1] * (3.5 - middle[:, 1]) > 0).all()
    assert (mesh.normals()[mesh.part != PARTS["curb"], 2] > 0.5).all()
    probe = DownwardProbe(mesh)
    z = probe.height_below([[20, 3.5, 10], [20, -1, 10], [20, -2.01, 10], [20, 29.9, 10]])
    assert z[:3] == pytest.approx([2.0, 2.0 + CURB_HEIGHT_M, 2.0 + CURB_HEIGHT_M], abs=0.005)
    assert 2.0 <= z[3] < 2.0 + 0.4 * CURB_HEIGHT_M  # terrain is back at its own height


def test_the_only_open_edges_are_the_outer_border():
    mesh = surface_mesh(
        strips(), road_height=level(), terrain_height=level(), spacing=Spacing(5.0, 5.0)
    )
    edges, uses = edge_uses(mesh)
    assert uses.max() == 2
    _, first = np.unique(np.round(mesh.vertices * 1e4).astype(int), axis=0, return_index=True)
    ends = mesh.vertices[first][edges[uses == 1]]
    on_border = (
        np.isclose(ends[:, :, 0], 0) | np.isclose(ends[:, :, 0], 40)
        | np.isclose(ends[:, :, 1], -20) | np.isclose(ends[:, :, 1], 30)
    )  # fmt: skip
    assert on_border.all()


@settings(max_examples=15, deadline=None)
@given(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08), st.floats(0.0, 0.5))
def test_the_road_is_on_its_height_and_terrain_on_its_own(east, north, bump):
    def road(xy):
        return xy @ [east, north]

    def terrain(xy):
        return xy @ [east, north] + bump * np.sin(xy[:, 0] / 3)

    mesh = surface_mesh(strips(), road_height=road, terrain_height=terrain, spacing=Spacing(3, 3))
    on_road = mesh.vertices[np.unique(mesh.faces[mesh.part == PARTS["carriageway"]])]
    np.testing.assert_allclose(on_road[:, 2], road(on_road[:, :2]), atol=1e-9)
    points = np.random.default_rng(3).uniform([0.1, -19.9], [39.9, 29.9], (400, 2))
    assert (hits_per_column(mesh, points) == 1).all()


@pytest.mark.parametrize(
    ("name", "hilly"),
    [
        ("perth_stretched_lights", True),
        ("West-Oakland", True),
        *further(
            ("taipei", False), ("taipei", True), ("neukolln", True), ("quad_intersection", True)
        ),
    ],
)
def test_real_places_have_no_hole_and_no_overlap(name, hilly, shared_data, tmp_path):
    frame = SiteFrame(*PLACES[name])
    axis = np.arange(-140.0, 141.0)
    x, y = np.meshgrid(axis, axis)
    wavy = Elevation(-140.0, -140.0, 1.0, 0.04 * x + 1.5 * np.sin(y / 20) * np.cos(x / 25))
    elevation = wavy if hilly else Elevation.flat()
    extract = read_extract(osm_extract(shared_data, name))
    built = build_roads(
        extract, frame, REGION, elevation,
        driving_side=driving_side(*PLACES[name]), out=tmp_path / "n.net.xml",
    )  # fmt: skip
    zones = ground_zones(built.network, REGION, extract.features(frame, REGION))
    # Borders are snapped to a millimetre: neighbours may share slivers of that width.
    together = shapely.union_all([zone.area for zone in zones]).area
    assert sum(zone.area.area for zone in zones) == pytest.approx(together, abs=0.2)
    mesh = surface_mesh(
        zones,
        road_height=built.surface.height,
        terrain_height=elevation.raw_at,
        spacing=Spacing(25.0, 5.0) if hilly else Spacing(25.0, 10.0),
        lines=built.surface.ridges(0),
    )
    grid = np.stack(np.meshgrid(np.arange(-99, 99, 0.9), np.arange(-99, 99, 0.9)), -1)
    points = grid.reshape(-1, 2) + 0.0123
    points = points[np.hypot(*points.T) < 99]
    assert (hits_per_column(mesh, points) == 1).all()
    # Four curbs may meet where two raised corners touch at a point; nothing else is shared so.
    _edges, uses = edge_uses(mesh)
    assert set(uses.tolist()) <= {1, 2, 4}
    assert (uses == 4).sum() <= 8
    # Paved area against the lane model: what joins lanes may add 1 %, rounding takes away less.
    area = plan_areas(mesh)
    carriageway = area[mesh.part == PARTS["carriageway"]].sum()
    assert carriageway == pytest.approx(built.network.carriageway(0).area, rel=0.01)
    footway = area[mesh.part == PARTS["footway"]].sum()
    assert footway == pytest.approx(built.network.footway(0).area, rel=0.01, abs=2.0)
    if hilly:
        normals = mesh.normals()[mesh.part == PARTS["carriageway"]]
        grade = np.hypot(normals[:, 0], normals[:, 1]) / normals[:, 2]
        steepest = np.hypot(*np.gradient(elevation.raw)).max()
        # Streets keep to the ground's grades; seams between streets side by side may be steeper.
        area = mesh.areas()[mesh.part == PARTS["carriageway"]]
        assert area[grade > steepest + 0.02].sum() < 0.005 * area.sum()


def test_an_empty_mesh_is_not_an_error():
    assert len(LabelledMesh.concatenate([]).faces) == 0
