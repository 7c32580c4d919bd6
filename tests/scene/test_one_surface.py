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
from urbantwin.traffic.paths.placement import Ground

from ..real_files import osm_extract
from ..thorough import further

RULER = runpy.run_path(str(Path(__file__).parent.parent / "roads" / "conftest.py"))["Road"]
REGION = shapely.Point(0, 0).buffer(110)
PLACES = {
    "taipei": (25.052396, 121.522635),
    "neukolln": (52.47328, 13.439643),
    "quad_intersection": (47.644172, -122.303614),
    "perth_stretched_lights": (-31.974855, 115.897588),
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
    ("quad_intersection", "plain"),
    ("perth_stretched_lights", "hills"),
    *further((("taipei", "hills"),), (("neukolln", "coarse"),)),
]


def build(extract, place, region, elevation, out):
    """Roads and the mesh of the ground and of all decks."""
    frame = SiteFrame(*place)
    roads = build_roads(
        extract, frame, region, elevation, driving_side=driving_side(*place), out=out
    )
    zones = ground_zones(roads.network, region, extract.features(frame, region))
    spacing = ON_A_PLAIN if elevation.is_flat else ON_A_HILL
    mesh = surface_mesh(
        zones, road_height=roads.surface.height, terrain_height=elevation.raw_at,
        spacing=spacing, lines=roads.surface.ridges(0),
    )  # fmt: skip
    decks = deck_mesh(roads.network, roads.surface, spacing)
    return roads, LabelledMesh.concatenate([mesh, decks])


@pytest.fixture(scope="module", params=CASES)
def built(request, shared_data, tmp_path_factory):
    name, kind = request.param
    folder = tmp_path_factory.mktemp(name)
    extract = read_extract(osm_extract(shared_data, name))
    net = folder / "n.net.xml"
    roads, mesh = build(extract, PLACES[name], REGION, GROUNDS[kind], net)
    write_opendrive(roads.model, SiteFrame(*PLACES[name]), folder / "map.xodr", name=name)
    return roads, mesh, folder


def paved(roads, places):
    """Which places lie in the region and on asphalt, a hand's breadth off the curbs."""
    asphalt = [roads.network.carriageway(level) for level in roads.network.levels]
    area = shapely.intersection(shapely.union_all(shapely.buffer(asphalt, -0.15)), REGION)
    shapely.prepare(area)
    return shapely.contains_xy(area, places[:, 0], places[:, 1])


def lanes_of(model):
    """Carriageway lanes: road, section, its end, lane."""
    for road in model.roads:
        for section, end in zip(road.sections, road.section_ends, strict=True):
            for lane in section.lanes:
                if lane.height == 0.0 and lane.kind != "none":
                    yield road, section, end, lane


def off_the_mesh(roads, mesh):
    """Distances every half metre along and seven times across every lane, ways too."""
    places = []
    for road, section, end, lane in lanes_of(roads.model):
        # Terrain that rises to a curb beside an abutment may reach over the deck's first foot.
        margin = 0.3 if road.level else 0.02
        s = np.arange(section.s + margin, end - margin, 0.5)
        inner, outer = (road.border(section, lane, s, outer=side) for side in (False, True))
        for share in (0.03, 0.15, 0.3, 0.5, 0.7, 0.85, 0.97):
            wide = np.abs(outer - inner) > 0.5
            places.append(road.place(s, inner + share * (outer - inner))[wide])
    places = np.concatenate(places)
    places = places[paved(roads, places)]
    return np.abs(DownwardProbe(mesh).height_below(places + [0, 0, 1.5]) - places[:, 2])


def test_the_mesh_is_where_the_lane_model_is(built):
    roads, mesh, _ = built
    off = off_the_mesh(roads, mesh)
    assert len(off) > 5000
    assert not np.isnan(off).any()
    assert np.quantile(off, 0.999) < 0.01
    assert off.max() < 0.025


@pytest.mark.parametrize("kind", ["plain", "hills"])
def test_ramps_and_decks_are_where_the_lane_model_is(kind, write_osm, tmp_path):
    """A bridge over a street, with junctions at both ends of the deck."""
    nodes = {1: (-120, 0, {}), 2: (-40, 0, {}), 3: (40, 0, {}), 4: (120, 0, {})}
    nodes |= {5: (0, -110, {}), 6: (0, 110, {}), 7: (-40, 80, {}), 8: (40, -80, {})}
    over, under = {"highway": "primary", "lanes": "2"}, {"highway": "residential"}
    path = write_osm(
        nodes,
        {
            1: ([1, 2], over),
            2: ([2, 3], {**over, "bridge": "yes", "layer": "1"}),
            3: ([3, 4], over),
            4: ([5, 6], under),
            5: ([2, 7], under),
            6: ([3, 8], under),
        },
    )
    region = shapely.Point(0, 0).buffer(100)
    net = tmp_path / "n.net.xml"
    roads, mesh = build(read_extract(path), (48.7, 9.18), region, GROUNDS[kind], net)
    assert roads.network.levels == (0, 1)
    off = off_the_mesh(roads, mesh)
    assert not np.isnan(off).any()
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
