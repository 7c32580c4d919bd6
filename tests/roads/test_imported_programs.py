"""A plan in ``site.yaml`` for signals of a map that somebody made."""

import shapely
import yaml

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.model import LaneModel
from urbantwin.roads.network import RoadNetwork
from urbantwin.roads.opendrive import write_opendrive
from urbantwin.site import load_site, read_extract
from urbantwin.twin import build_twin

HERE = SiteFrame(48.7, 9.18)
STREET = {"highway": "primary", "lanes": "2", "maxspeed": "50"}


def test_offsets_of_a_map_with_programs_reach_every_artefact(write_osm, tmp_path):
    nodes = {1: (-150, 0, {}), 2: (0, 0, {"highway": "traffic_signals"}), 3: (150, 0, {})}
    nodes |= {4: (0, -150, {}), 5: (0, 150, {})}
    ways = {10: ([1, 2, 3], {**STREET, "name": "A"}), 11: ([4, 2, 5], {**STREET, "name": "B"})}
    built = build_roads(
        read_extract(write_osm(nodes, ways)),
        HERE,
        shapely.box(-140, -140, 140, 140),
        Elevation.flat(),
        driving_side="right",
        out=tmp_path / "n.net.xml",
    )
    write_opendrive(built.model, HERE, tmp_path / "map.xodr", name="map")
    site = {
        "anchor": {"latitude": 48.7, "longitude": 9.18},
        "region": {"radius_m": 120},
        "closed_loop": False,
        "roads": {"file": "map.xodr"},
        "signals": [{"junction": "A / B", "offset": 7}],
        "rig": {"sensors": [{"name": "a", "model": "OS1-128", "east_m": 9.0, "north_m": 9.0,
                             "height_m": 6.0}]},
    }  # fmt: skip
    (tmp_path / "site.yaml").write_text(yaml.safe_dump(site))
    build_twin(load_site(tmp_path / "site.yaml"), tmp_path / "twin")
    (before,) = built.network.programs
    (program,) = RoadNetwork.load(tmp_path / "twin" / "roads.json").programs
    (controller,) = LaneModel.load(tmp_path / "twin" / "lane_model.json").controllers
    assert program.offset == controller.offset == 7.0
    assert program.phases == controller.phases
    assert sum(s for s, _ in program.phases) == sum(s for s, _ in before.phases)
