"""Water: level sheets in the watertight ground, walls of canals, the sea right of its coast."""

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon, box

from urbantwin.geometry import DownwardProbe
from urbantwin.scene.surface import PARTS, Spacing, surface_mesh
from urbantwin.scene.water import pier_mesh, water_bodies, with_water
from urbantwin.scene.zones import Zone
from urbantwin.site.extract import OsmFeature
from urbantwin.taxonomy import material_id, semantic_id

REGION = box(-60, -60, 60, 60)


def flat(xy):
    return np.zeros(len(xy))


def feature(geometry, number=1, **tags):
    return OsmFeature("way", number, tags, geometry)


def ground(bodies, terrain=flat, road=None):
    """The ground with these waters in it, a street across it where wanted."""
    taken = road if road is not None else Polygon()
    water = shapely.union_all([body.area for body in bodies])
    walls = shapely.union_all([body.wall for body in bodies])
    rest = shapely.difference(shapely.difference(REGION, taken), shapely.union(water, walls))
    soil, concrete, wet = (material_id(n) for n in ("soil", "concrete", "water"))
    zones = [
        Zone("carriageway", taken, semantic_id("road"), material_id("asphalt")),
        Zone("paved", shapely.difference(walls, taken), semantic_id("other-ground"), concrete),
        Zone("water", shapely.difference(water, taken), semantic_id("other-ground"), wet),
        Zone("terrain", rest, semantic_id("terrain"), soil),
    ]
    return surface_mesh(
        [zone for zone in zones if not zone.area.is_empty],
        road_height=flat,
        terrain_height=with_water(terrain, bodies, REGION),
        spacing=Spacing(25.0, 10.0),
    )


def test_a_pond_lies_level_below_its_shore_and_the_ground_has_no_gap():
    def tilted(xy):
        return 0.03 * xy[:, 0]

    bodies = water_bodies([feature(Point(0, 0).buffer(20), natural="water")], REGION)
    mesh = ground(bodies, tilted)
    water = mesh.select(mesh.part == PARTS["water"])
    assert np.ptp(water.vertices[:, 2]) < 1e-9
    assert set(water.material) == {material_id("water")}
    assert water.areas().sum() == pytest.approx(np.pi * 20**2, rel=0.01)
    assert water.vertices[0, 2] < tilted(np.array([[-18.0, 0.0]]))[0]
    x, y = np.meshgrid(np.arange(-59.95, 60, 0.5), np.arange(-59.95, 60, 0.5))
    above = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 50.0)])
    assert np.isfinite(DownwardProbe(mesh).height_below(above)).all()


def test_a_canal_has_upright_walls_of_its_usual_depth():
    bodies = water_bodies([feature(LineString([(-100, 0), (100, 0)]), waterway="canal")], REGION)
    mesh = ground(bodies)
    probe = DownwardProbe(mesh)
    depth = probe.height_below([[5, y, 9.0] for y in (0, 5.4, 6.1, -5.4, -6.1)])
    assert depth == pytest.approx([-1.2, -1.2, 0, -1.2, 0], abs=1e-6)


def test_water_that_the_elevation_model_shows_stays_at_its_height():
    def dug(xy):
        return np.where(np.hypot(xy[:, 0], xy[:, 1]) < 19, -3.5, 0.2)

    bodies = water_bodies([feature(Point(0, 0).buffer(20), natural="water")], REGION)
    water = ground(bodies, dug)
    water = water.select(water.part == PARTS["water"])
    assert water.vertices[:, 2] == pytest.approx(-3.5)


def test_the_sea_is_to_the_right_of_the_coast():
    coast = LineString([(10, -500), (10, 500)])
    (east,) = water_bodies([feature(coast, natural="coastline")], REGION)
    assert east.kind == "sea"
    assert east.area.bounds[0] == pytest.approx(10)
    (west,) = water_bodies([feature(shapely.reverse(coast), natural="coastline")], REGION)
    assert west.area.bounds[2] == pytest.approx(10)


@pytest.mark.parametrize(
    "tags",
    [
        {"natural": "water", "tunnel": "yes"},
        {"waterway": "stream", "tunnel": "culvert"},
        {"natural": "water", "intermittent": "yes"},
        {"landuse": "basin"},
    ],
)
def test_no_water_where_none_is_seen(tags):
    line = "waterway" in tags
    shape = LineString([(0, 0), (30, 0)]) if line else box(0, 0, 20, 20)
    assert water_bodies([feature(shape, **tags)], REGION) == []


def test_a_line_within_an_area_is_the_same_water():
    area = feature(box(-200, -8, 200, 8), 1, natural="water", water="river")
    line = feature(LineString([(-200, 0), (200, 0)]), 2, waterway="river", width="10")
    bodies = water_bodies([area, line], REGION)
    assert [body.kind for body in bodies] == ["river"]


def test_a_pier_stands_on_posts_over_the_water():
    mesh, notes = pier_mesh(
        [feature(LineString([(0, 0), (20, 0)]), 1, man_made="pier")],
        region=REGION,
        ground_height=lambda xy: np.full(len(xy), -1.2),
        carriageway=Polygon(),
    )
    assert notes == {"piers": 1}
    assert mesh.vertices[:, 2].max() == pytest.approx(-0.3)
    assert mesh.vertices[:, 2].min() < -2
