"""Bad files of maps of the roads: OpenDRIVE, Lanelet2, Argoverse 2."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from urbantwin.geometry import SiteFrame
from urbantwin.roads.imported import read_map
from urbantwin.roads.opendrive import write_opendrive

from ..roads.lanelet_town import ANCHOR, crossing_town, street_with_pocket
from ..roads.tee import tee
from .harness import NUMBERS
from .reader import SHARED_DATA, Reader
from .test_site_readers import files, inspected, made

ARGOVERSE = SHARED_DATA / "lidar" / "argoverse2-pittsburgh"
PITTSBURGH = (40.462723, -79.951023)


def read_roads(path: Path) -> None:
    """What `inspect` and `build` do with a map."""
    inspected(path)
    read_map(path, SiteFrame(*(PITTSBURGH if path.suffix == ".json" else ANCHOR)))


def _drawn(version: str) -> bytes:
    model = tee(signals=True)
    frame = SiteFrame(*ANCHOR)
    return made(
        "a.xodr", lambda path: write_opendrive(model, frame, path, version=version, name="tee")
    )


#: Every form of a reference line, and what stands beside a road.
PLAIN = b"""<?xml version="1.0"?>
<OpenDRIVE><header revMajor="1" revMinor="4"/>
<road name="" id="12" junction="-1" length="400">
<planView>
<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>
<geometry s="100" x="100" y="0" hdg="0" length="100">
<spiral curvStart="0" curvEnd="0.001"/></geometry>
<geometry s="200" x="199.99" y="1.67" hdg="0.05" length="100">
<poly3 a="0" b="0" c="0" d="0"/></geometry>
<geometry s="300" x="299.86" y="6.66" hdg="0.05" length="100"><paramPoly3 pRange="normalized"
 aU="0" bU="100" cU="0" dU="0" aV="0" bV="0" cV="0" dV="0"/></geometry>
</planView>
<elevationProfile><elevation s="0" a="1" b="0.01" c="0" d="0"/></elevationProfile>
<lateralProfile><superelevation s="0" a="0.01" b="0" c="0" d="0"/></lateralProfile>
<lanes><laneOffset s="0" a="0.5" b="0" c="0" d="0"/><laneSection s="0">
<center><lane id="0" type="none" level="false"/></center>
<right><lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/>
<roadMark sOffset="0" type="solid" color="white" width="0.12"/>
<speed sOffset="0" max="50" unit="km/h"/>
</lane></right></laneSection></lanes>
<objects><object type="pole" id="1" s="30" t="6" zOffset="0" height="4" radius="0.1"/>
<object type="crosswalk" id="2" s="50" t="0" hdg="0" orientation="none"><outline>
<cornerLocal u="-1" v="-3" z="0"/><cornerLocal u="1" v="-3" z="0"/>
<cornerLocal u="1" v="3" z="0"/>
</outline></object></objects>
<signals><signal s="90" t="5" id="7" name="" dynamic="yes" orientation="+" zOffset="4"
 country="OpenDRIVE" type="1000001" subtype="-1" height="0.9" width="0.3"/>
</signals></road></OpenDRIVE>
"""


def _lanelet2() -> list[bytes]:
    return [
        made("a.osm", street_with_pocket().write),
        made("a.osm", lambda path: crossing_town().write(path, local=True)),
    ]


def _argoverse() -> list[bytes]:
    """The first lane segments of a real map, and all kinds of what else it has."""
    data = json.loads(next(ARGOVERSE.glob("*/map/log_map*.json")).read_bytes())
    small = {
        kind: dict(list(rows.items())[: 12 if kind == "lane_segments" else 2])
        for kind, rows in data.items()
    }
    return [json.dumps(small).encode()]


READERS = [
    Reader("opendrive", read_roads, "map.xodr", lambda: [PLAIN, _drawn("1.8"), _drawn("1.4")]),
    Reader("lanelet2", read_roads, "map.osm", _lanelet2),
    Reader("real lanelet2", read_roads, "map.osm",
           files(SHARED_DATA / "tracks/karlsruhe-k733/k733.lanelet2.osm"), real=True),
    Reader("argoverse", read_roads, "log_map_archive_x____PIT_city_1.json", _argoverse, real=True),
]  # fmt: skip


@pytest.mark.parametrize("mutations", NUMBERS)
@pytest.mark.parametrize("reader", READERS, ids=str)
def test_bad_files(reader: Reader, mutations: int, fuzz: Callable[[Reader, int], None]) -> None:
    fuzz(reader, mutations)
