"""Kerbs of real places: no slivers, islands where rings leave them, crossings from kerb to kerb."""

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import RoadNetwork, build_roads, driving_side
from urbantwin.scene.zones import ground_zones
from urbantwin.site import read_extract

from ..thorough import further

#: Extract, latitude, longitude: junctions, of which the first two have oblique crossings.
PLACES = {
    "montlake_roundabout": (47.6395233, -122.3038176),
    "tempe_split": (33.4219352, -111.9400089),
    "perth_stretched_lights": (-31.9750675, 115.8977146),
    "london-borough": (51.5007942, -0.0928155),
}
RADIUS_M = 100.0
#: A corner sharper than this is a spike, degrees; smaller holes and parts are specks, m2; notches
#: and fins are narrower than the last, metres.
SPIKE, SPECK_M2, NARROW_M = 15.0, 0.5, 0.3


@pytest.fixture(scope="module")
def place(shared_data, tmp_path_factory):
    """Return a function: name -> the roads and the zones of the ground there."""
    made = {}

    def build(name):
        if name not in made:
            frame = SiteFrame(*PLACES[name])
            region = shapely.Point(0, 0).buffer(RADIUS_M)
            extract = read_extract(shared_data / "osm" / f"{name}.osm")
            built = build_roads(
                extract,
                frame,
                region,
                Elevation.flat(),
                driving_side=driving_side(frame.latitude, frame.longitude),
                out=tmp_path_factory.mktemp(name) / "n.net.xml",
            )
            zones = ground_zones(built.network, region, extract.features(frame, region))
            made[name] = built, zones
        return made[name]

    return build


def spikes(shape):
    """Corners of an area that are sharper than `SPIKE`."""
    found = []
    for part in shapely.get_parts(shape):
        for ring in (part.exterior, *part.interiors):
            xy = shapely.get_coordinates(ring)[:-1]
            before, after = np.roll(xy, 1, axis=0) - xy, np.roll(xy, -1, axis=0) - xy
            cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            angle = np.degrees(np.abs(np.arctan2(cross, (before * after).sum(axis=1))))
            found += xy[angle < SPIKE].round(1).tolist()
    return found


def specks(shape):
    """Holes and parts of an area that are smaller than `SPECK_M2`."""
    parts = list(shapely.get_parts(shape))
    holes = [shapely.Polygon(ring) for part in parts for ring in part.interiors]
    return [one.centroid.wkt for one in (*parts, *holes) if one.area < SPECK_M2]


def narrow(shape):
    """Notches in an area and fins of it that are narrower than `NARROW_M`."""
    half, mitred = NARROW_M / 2, {"join_style": "mitre", "mitre_limit": 3}
    notches = shape.buffer(half, **mitred).buffer(-half, **mitred) - shape.buffer(0.005)
    fins = shape - shape.buffer(-half, **mitred).buffer(half, **mitred).buffer(0.005)
    parts = [*shapely.get_parts(notches), *shapely.get_parts(fins)]
    return [one.centroid.wkt for one in parts if one.area > 0.01]


@pytest.mark.parametrize("name", [*list(PLACES)[:3], *further("london-borough")])
def test_carriageways_and_footways_have_no_slivers(place, name):
    built, zones = place(name)
    inside = shapely.Point(0, 0).buffer(RADIUS_M - 10)
    areas = {
        "carriageway": built.network.carriageway(0),
        "footway": built.network.footway(0),
        "in the scene": shapely.union_all(
            [zone.area for zone in zones if zone.kind == "carriageway"]
        ),
    }
    for what, area in areas.items():
        cut = [one for one in spikes(area) if inside.contains(shapely.Point(one))]
        assert not cut, (what, cut)
        assert not [one for one in specks(area) if inside.contains(shapely.from_wkt(one))], what
    kerb = areas["carriageway"]
    assert not [one for one in narrow(kerb) if inside.contains(shapely.from_wkt(one))]


def test_the_ring_of_montlake_leaves_an_island_and_whole_crossings(place):
    built, zones = place("montlake_roundabout")
    (island,) = [lane for lane in built.network.lanes if lane.kind == "island"]
    # The ring is mapped at 6.3 m; its lane is 2.75 to 3.25 m wide.
    assert 6.3 - 3.25 / 2 - 0.2 < np.sqrt(island.polygon.area / np.pi) < 6.3 - 2.75 / 2 + 0.1
    at_middle = [zone.kind for zone in zones if zone.area.contains(shapely.Point(0.2, 0.0))]
    assert at_middle == ["island"]
    crossings = [lane for lane in built.network.lanes if lane.kind == "crossing"]
    assert len(crossings) == 7
    # Each leads over two lanes of 3 m, also the one at 90 m, before the region ends.
    assert max(lane.centre[:, 1].mean() for lane in crossings) > 85
    assert min(shapely.LineString(lane.centre[:, :2]).length for lane in crossings) > 5.5


def test_a_place_without_roads_has_no_kerbs():
    network = RoadNetwork("right", (), (), (), (), ())
    assert network.carriageway(0).is_empty
    assert network.footway(0).is_empty
