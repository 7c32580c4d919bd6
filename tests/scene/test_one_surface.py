"""One surface: mesh, OpenDRIVE and SUMO's positions agree on every lane, to 2 cm."""

import runpy
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.geometry import DownwardProbe, LabelledMesh, SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, driving_side
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.scene.deck import deck_mesh
from urbantwin.scene.scene import ON_A_HILL, ON_A_PLAIN
from urbantwin.scene.surface import surface_mesh
from urbantwin.scene.zones import ground_zones
from urbantwin.site import read_extract
from urbantwin.traffic.placement import Ground

RULER = runpy.run_path(str(Path(__file__).parent.parent / "roads" / "conftest.py"))["Road"]
REGION = shapely.Point(0, 0).buffer(110)
PLACES = {
    "taipei": (25.052396, 121.522635),
    "neukolln": (52.47328, 13.439643),
    "quad_intersection": (47.644172, -122.303614),
    "perth_stretched_lights": (-31.974855, 115.897588),
    "West-Oakland": (37.8070776, -122.3025247),
    "munich": (48.1860, 11.5510),
}
AXIS = np.arange(-160.0, 161.0)
X, Y = np.meshgrid(AXIS, AXIS)
GROUNDS = {
    "plain": Elevation.flat(),
    # 3 to 9 % steep, hilltops of 160 m radius of curvature and more, as a 1 m raster
    "hills": Elevation(-160.0, -160.0, 1.0, 0.03 * X + 1.6 * np.sin(Y / 35) * np.cos(X / 40)),
    # the same as seen in a coarse DEM: cross-falls are the usual ones
    "coarse": Elevation(
        -160.0, -160.0, 1.0, 0.03 * X + 1.6 * np.sin(Y / 35) * np.cos(X / 40), 10.0
    ),
}
CASES = [
    ("taipei", "hills"),
    ("taipei", "plain"),
    ("neukolln", "coarse"),
    ("quad_intersection", "hills"),
    ("perth_stretched_lights", "coarse"),
    ("West-Oakland", "plain"),
    ("munich", "hills"),
]


@pytest.fixture(scope="module", params=CASES, ids="-".join)
def built(request, shared_data, tmp_path_factory):
    name, kind = request.param
    folder = tmp_path_factory.mktemp(name)
    frame, elevation = SiteFrame(*PLACES[name]), GROUNDS[kind]
    extract = read_extract(next((shared_data / "osm").glob(f"{name}.osm*")))
    roads = build_roads(
        extract, frame, REGION, elevation,
        driving_side=driving_side(*PLACES[name]), out=folder / "n.net.xml",
    )  # fmt: skip
    zones = ground_zones(roads.network, REGION, extract.features(frame, REGION))
    spacing = ON_A_PLAIN if elevation.is_flat else ON_A_HILL
    mesh = surface_mesh(
        zones, road_height=roads.surface.height, terrain_height=elevation.raw_at,
        spacing=spacing, lines=roads.surface.ridges(0),
    )  # fmt: skip
    mesh = LabelledMesh.concatenate([mesh, deck_mesh(roads.network, roads.surface, spacing)])
    write_opendrive(roads.model, frame, folder / "map.xodr", name=name)
    return roads, mesh, folder


def paved(roads, places):
    """Which places lie in the region and on asphalt, a hand's breadth off the curbs."""
    asphalt = shapely.union_all([roads.network.carriageway(k) for k in roads.network.levels])
    area = shapely.intersection(shapely.buffer(asphalt, -0.15), REGION)
    shapely.prepare(area)
    return shapely.contains_xy(area, places[:, 0], places[:, 1])


def lanes_of(model):
    """Carriageway lanes: road, section, its end, lane."""
    for road in model.roads:
        for section, end in zip(road.sections, road.section_ends, strict=True):
            for lane in section.lanes:
                if lane.height == 0.0 and lane.kind != "none":
                    yield road, section, end, lane


def test_the_mesh_is_where_the_lane_model_is(built):
    """Every half metre along and seven times across every lane, ways through junctions too."""
    roads, mesh, _ = built
    places = []
    for road, section, end, lane in lanes_of(roads.model):
        s = np.arange(section.s + 0.02, end - 0.02, 0.5)
        inner, outer = (road.border(section, lane, s, outer=side) for side in (False, True))
        for share in (0.03, 0.15, 0.3, 0.5, 0.7, 0.85, 0.97):
            wide = np.abs(outer - inner) > 0.5
            places.append(road.place(s, inner + share * (outer - inner))[wide])
    places = np.concatenate(places)
    places = places[paved(roads, places)]
    assert len(places) > 5000
    height = DownwardProbe(mesh).height_below(places + [0, 0, 1.5])
    off = np.abs(height - places[:, 2])
    assert not np.isnan(off).any()
    assert np.quantile(off, 0.999) < 0.01
    assert off.max() < 0.02


def test_opendrive_is_where_the_mesh_is(built):
    """By a reader of its own, from the standard's formulas."""
    roads, mesh, folder = built
    root = ElementTree.parse(folder / "map.xodr").getroot()
    known = {road.get("id"): RULER(road) for road in root.findall("road")}
    places = []
    for road, section, end, lane in lanes_of(roads.model):
        item = known[str(road.id)]
        number = road.sections.index(section)
        for s in np.arange(section.s + 0.05, end - 0.05, 3.0):
            inner, outer = item.borders(s, lane.id, number)
            if np.linalg.norm(outer - inner) > 0.5:
                places += [inner + share * (outer - inner) for share in (0.05, 0.5, 0.95)]
    places = np.array(places)
    places = places[paved(roads, places)]
    assert len(places) > 500
    height = DownwardProbe(mesh).height_below(places + [0, 0, 1.5])
    assert np.abs(height - places[:, 2]).max() < 0.02


def test_what_sumo_drives_stands_on_the_surface(built):
    """SUMO's own lane shapes, placed as traffic is placed, against the surface and the strips."""
    roads, mesh, folder = built
    ground = Ground(mesh, roads.network)
    points, lane_of, names = [], [], []
    for edge in ElementTree.parse(folder / "n.net.xml").getroot().iter("edge"):
        for lane in edge.iter("lane"):
            strip = roads.network.lane_by_id.get(lane.get("id"))
            if strip is None or strip.kind not in ("driving", "bus", "bicycle", "connection"):
                continue
            xy = [[float(v) for v in point.split(",")[:2]] for point in lane.get("shape").split()]
            line = shapely.LineString(xy)
            if line.length < 0.6:
                continue
            at = line.interpolate(np.arange(0.2, line.length - 0.2, 0.5))
            xy = shapely.get_coordinates(at)
            points.append(xy)
            lane_of.append(np.full(len(xy), len(names), np.int32))
            names.append(strip.id)
    xy, lane = np.concatenate(points), np.concatenate(lane_of)
    inside = paved(roads, xy)
    xy, lane = xy[inside], lane[inside]
    z = ground.height(xy, ground.ceiling(xy, lane, tuple(names)))
    assert not np.isnan(z).any()
    level = np.array([roads.network.lane_by_id[name].level for name in names])[lane]
    surface, strip = np.zeros(len(xy)), np.zeros(len(xy))
    for number in np.unique(level):
        surface[level == number] = roads.surface.height(xy[level == number], int(number))
    for k, name in enumerate(names):
        strip[lane == k] = roads.network.height(name, xy[lane == k])
    assert np.abs(z - surface).max() < 0.02
    assert np.abs(z - strip).max() < 0.02
