"""Signals written as OpenDRIVE: their places by the standard's words, and read back."""

import math
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.opendrive import placed, read_opendrive, write_opendrive
from urbantwin.roads.signals import pose_of
from urbantwin.site import read_extract

#: In Oregon, where heads stand beyond the junction, and in England.
PLACES = {"right": (45.5, -122.6), "left": (52.0, -1.0)}
MAIN = {"highway": "primary", "name": "A", "lanes": "4", "maxspeed": "35 mph", "sidewalk": "both"}
SIDE = {"highway": "secondary", "name": "B", "lanes": "2", "maxspeed": "25 mph"}


@pytest.fixture(params=PLACES)
def built(request, tmp_path):
    frame = SiteFrame(*PLACES[request.param])
    xy = {1: (-150, 0), 2: (0, 0), 3: (150, 20), 4: (0, -150), 5: (10, 150)}
    root = ElementTree.Element("osm", version="0.6")
    for identity, point in xy.items():
        lon, lat = frame.lonlat_from_site([point])[0]
        item = ElementTree.SubElement(root, "node", id=str(identity), lat=f"{lat:.9f}",
                                      lon=f"{lon:.9f}", version="1")  # fmt: skip
        if identity == 2:
            ElementTree.SubElement(item, "tag", k="highway", v="traffic_signals")
    for identity, (nodes, tags) in {10: ((1, 2, 3), MAIN), 11: ((4, 2, 5), SIDE)}.items():
        way = ElementTree.SubElement(root, "way", id=str(identity), version="1")
        for node in nodes:
            ElementTree.SubElement(way, "nd", ref=str(node))
        for key, value in tags.items():
            ElementTree.SubElement(way, "tag", k=key, v=value)
    path = tmp_path / "map.osm"
    ElementTree.ElementTree(root).write(path)
    roads = build_roads(
        read_extract(path),
        frame,
        shapely.box(-140, -140, 140, 140),
        Elevation.flat(),
        driving_side=request.param,
        out=tmp_path / "n.net.xml",
    )
    return roads.model, frame, tmp_path


def test_places_are_written_in_the_files_own_coordinates(built):
    model, frame, folder = built
    write_opendrive(model, frame, folder / "map.xodr", name="map")
    root = ElementTree.parse(folder / "map.xodr").getroot()
    items = {int(item.get("id")): item for item in root.iter("signal")}
    assert set(items) == {signal.id for signal in model.signals}
    posed = [signal for signal in model.signals if signal.pose]
    assert any(signal.lanes for signal in posed)
    for signal in posed:
        place = items[signal.id].find("positionInertial")
        x, y, z, heading = (float(place.get(key)) for key in ("x", "y", "z", "hdg"))
        assert (x, y) == pytest.approx(signal.pose[:2], abs=1e-3)
        assert z + float(items[signal.id].get("height")) / 2 == pytest.approx(signal.pose[2])
        assert math.cos(heading - signal.pose[3]) == pytest.approx(1.0)
    units = {i.get("unit") for i in root.iter("signal") if i.get("dynamic") == "no"}
    assert units == {"mph"}


@pytest.mark.parametrize("version", ["1.8", "1.4"])
def test_what_is_read_stands_where_it_stood_and_runs_as_it_ran(built, version):
    model, frame, folder = built
    write_opendrive(model, frame, folder / "map.xodr", version=version, name="map")
    found = read_opendrive(folder / "map.xodr")
    again = placed(found.model, found.projection, frame)
    known = {signal.id: signal for signal in again.signals}
    assert set(known) == {signal.id for signal in model.signals}
    for signal in model.signals:
        other = known[signal.id]
        there, here = np.array(pose_of(again, other)), np.array(pose_of(model, signal))
        np.testing.assert_allclose(there[:3], here[:3], atol=0.02)
        assert math.cos(there[3] - here[3]) > 0.9999
        assert other.links == signal.links
        if version == "1.8" or model.driving_side == "right":
            assert (other.road, set(other.lanes)) == (signal.road, set(signal.lanes))
        assert bool(other.lanes) == bool(signal.lanes)
    programs = [(c.offset, c.phases, set(c.signals)) for c in model.controllers]
    assert [(c.offset, c.phases, set(c.signals)) for c in again.controllers] == programs
    assert programs
