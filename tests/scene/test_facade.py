import numpy as np
import open3d as o3d
import pytest
import shapely
import trimesh
from shapely import Point, Polygon, box

from urbantwin.scene.building import building_mesh
from urbantwin.scene.building_surface import SURFACES, building_surfaces
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id

REGION = box(-200, -200, 200, 200)
#: A street along the x axis; buildings stand north of it.
STREET = box(-200, -10, 200, -3)
HOUSE = box(0, 0, 18, 10)


def feature(geometry, number=1, **tags):
    kind = "node" if isinstance(geometry, Point) else "way"
    return OsmFeature(kind, number, {k.replace("__", ":"): v for k, v in tags.items()}, geometry)


def build(*features, road=STREET, slope=0.0):
    return building_mesh(
        features,
        region=REGION,
        ground_height=lambda xy: slope * xy[:, 0],
        carriageway=road,
    )[:2]


def panes(mesh, name="glass"):
    """The corners (N, 4, 3) of every pane of a material: two triangles each, one after another."""
    triangles = mesh.triangles()[mesh.material == material_id(name)]
    return triangles.reshape(-1, 6, 3)[:, [0, 1, 2, 5]]


def judged(mesh) -> trimesh.Trimesh:
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.area_faces.min() > 1e-6
    return solid


@pytest.mark.parametrize("shape", ["flat", "gabled", "hipped", "round"])
def test_a_facade_is_closed_and_lacks_just_its_reveals(shape):
    house = feature(
        HOUSE, building="apartments", building__levels="3", roof__shape=shape, roof__height="3"
    )
    plain = judged(build(house, road=Polygon())[0])
    mesh, notes = build(house)
    solid = judged(mesh)
    assert notes["windows"] > 10
    assert notes["doors"] == 1
    depth = area = 0.0
    for name in ("glass", "wood"):
        for corners in panes(mesh, name):
            size = np.ptp(corners, axis=0)
            set_back = min(*np.abs(corners[0, 0] - [0, 18]), *np.abs(corners[0, 1] - [0, 10]))
            assert 0.1 <= set_back <= 0.15
            depth += set_back * size[:2].max() * size[2]
            area += size[:2].max() * size[2]
    assert area > 20
    assert plain.volume - solid.volume == pytest.approx(depth, rel=1e-6)


def test_rays_from_the_street_go_through_the_wall_as_deep_as_the_reveal():
    mesh, _ = build(feature(HOUSE, building="office", building__levels="4"))
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    street_side = [p for p in panes(mesh) if np.ptp(p[:, 1]) < 1e-9 and p[0, 1] < 1]
    assert len(street_side) > 8
    for corners in street_side:
        x, _, z = corners.mean(axis=0)
        beside = corners[:, 0].min() - 0.1
        rays = np.array([[x, -5, z, 0, 1, 0], [beside, -5, z, 0, 1, 0]], np.float32)
        hit = scene.cast_rays(o3d.core.Tensor(rays))
        into, wall = hit["t_hit"].numpy()
        assert wall == pytest.approx(5, abs=1e-4)
        assert 0.1 <= into - wall <= 0.15 + 1e-4
        assert mesh.material[hit["primitive_ids"].numpy()[0]] == material_id("glass")


def test_only_walls_that_see_the_street_have_windows():
    row = [
        feature(box(18 * k, 0, 18 * k + 18, 10), k + 1, building="yes", building__levels="4")
        for k in range(3)
    ]
    yard = feature(box(0, 14, 54, 20), 9, building="yes", building__levels="2")
    mesh, _ = build(*row, yard)
    middle = panes(mesh.select(mesh.part == 2))
    assert len(middle) > 8
    # Neither to the neighbours nor to the yard, but all over the front.
    assert middle[..., 1].max() < 1
    behind = panes(mesh.select(mesh.part == 4))
    assert not ((behind[..., 1].max(axis=1) < 14.2) | (behind[..., 1].min(axis=1) > 19.8)).any()
    assert len(np.unique(middle[:, 0, 2].round(3))) == 4


def test_storeys_are_those_below_the_roof():
    mesh, _ = build(
        feature(
            HOUSE, building="yes", building__levels="3", height="13", roof__shape="hipped",
            roof__height="4",
        )
    )  # fmt: skip
    sills = np.unique(panes(mesh)[..., 2].min(axis=1).round(3))
    assert len(sills) == 3
    assert np.diff(sills) == pytest.approx([3.0, 3.0])


def test_a_courtyard_has_no_windows():
    hollow = Polygon(HOUSE.exterior, [box(4, 3, 14, 7).exterior.coords])
    mesh, _ = build(feature(hollow, building="apartments", building__levels="3"))
    places = panes(mesh).mean(axis=1)
    assert shapely.distance(HOUSE.exterior, shapely.points(places[:, :2])).max() < 0.16


@pytest.mark.parametrize(
    "tags",
    [
        {"building": "yes", "window": "no"},
        {"building": "parking"},
        {"building": "shed"},
        {"building": "roof"},
        {"building": "greenhouse"},
    ],
)
def test_some_buildings_have_no_windows(tags):
    _, notes = build(feature(HOUSE, **tags, height="6"))
    assert "windows" not in notes


def test_garages_have_doors_and_no_windows():
    mesh, notes = build(feature(HOUSE, building="garages"))
    assert "windows" not in notes
    assert notes["doors"] >= 5
    assert np.ptp(panes(mesh, "wood")[..., 2], axis=1) == pytest.approx(2.05)


def test_a_shop_has_more_glass_at_the_ground():
    def ground_floor(**tags):
        mesh, _ = build(feature(HOUSE, building__levels="3", **tags))
        front = panes(mesh)
        front = front[front[..., 2].min(axis=1) < 3]
        return (np.ptp(front[..., 0], axis=1) * np.ptp(front[..., 2], axis=1)).sum()

    assert ground_floor(building="retail") > 2 * ground_floor(building="apartments")
    assert ground_floor(building="apartments", shop="bakery") > 2 * ground_floor(building="yes")


def test_a_shop_that_is_mapped_as_a_node_makes_a_shop_front():
    house = feature(HOUSE, building="apartments", building__levels="3")
    without, _ = build(house)
    with_shop, _ = build(house, feature(Point(9, 2), shop="books"))
    assert np.ptp(panes(with_shop)[..., 0], axis=1).max() > 2
    assert np.ptp(panes(without)[..., 0], axis=1).max() < 2


def test_doors_are_where_the_map_has_them_and_start_at_the_ground():
    house = feature(HOUSE, building="apartments", building__levels="3")
    door = feature(Point(5, 0), 2, entrance="main")
    mesh, notes = build(house, door, slope=0.05)
    assert notes["doors of the map"] == notes["doors"] == 1
    (corners,) = panes(mesh, "wood")
    assert corners[:, 0].mean() == pytest.approx(5)
    assert corners[:, 2].min() == pytest.approx(0.05 * 5, abs=0.1)
    assert np.ptp(corners[:, 2]) == pytest.approx(2.3)


def test_no_window_is_below_the_ground():
    mesh, _ = build(feature(HOUSE, building="yes", building__levels="3"), slope=0.2)
    corners = panes(mesh).reshape(-1, 3)
    assert (corners[:, 2] > 0.2 * corners[:, 0] + 0.25).all()
    judged(mesh)


def test_facades_differ_from_house_to_house_and_stay_the_same_from_run_to_run():
    first, _ = build(feature(HOUSE, 1, building="yes", building__levels="3"))
    again, _ = build(feature(HOUSE, 1, building="yes", building__levels="3"))
    other, _ = build(feature(HOUSE, 2, building="yes", building__levels="3"))
    assert first.vertices.tobytes() == again.vertices.tobytes()
    assert first.faces.tobytes() == again.faces.tobytes()
    assert first.vertices.tobytes() != other.vertices.tobytes()


def test_buildings_under_imported_geometry_are_left_out():
    both = [feature(HOUSE, building="yes"), feature(box(30, 0, 40, 10), 2, building="yes")]
    mesh, notes, _ = building_mesh(
        both,
        region=REGION,
        ground_height=lambda xy: np.zeros(len(xy)),
        carriageway=STREET,
        without=box(-5, -5, 12, 20).union(box(30, 0, 34, 10)),
    )
    assert notes["buildings"] == 1
    assert notes["buildings left to imported geometry"] == 1
    assert mesh.vertices[:, 0].min() == pytest.approx(30)


def test_surfaces_have_the_areas_of_their_closed_forms():
    mesh, _ = build(
        feature(
            HOUSE, building="yes", height="12", roof__shape="gabled", roof__height="4",
            min_height="2",
        )
    )  # fmt: skip
    kind = building_surfaces(mesh)
    area = {name: mesh.areas()[kind == k].sum() for k, name in enumerate(SURFACES)}
    normals = mesh.normals()
    assert area["RoofSurface"] == pytest.approx(18 * 2 * np.hypot(5, 4))
    assert area["OuterCeilingSurface"] + area["GroundSurface"] == pytest.approx(180)
    assert area["Window"] == pytest.approx(
        sum(np.ptp(p[:, :2], axis=0).max() * np.ptp(p[:, 2]) for p in panes(mesh))
    )
    # Seen from the street, walls, windows and doors together are the front.
    front = (normals[:, 1] < -0.9) & np.isin(kind, [2, 4, 5])
    front &= mesh.triangles()[:, :, 1].max(axis=1) < 0.2
    assert mesh.areas()[front].sum() == pytest.approx(18 * 6)
    assert set(np.unique(kind[mesh.material == material_id("glass")])) == {4}
