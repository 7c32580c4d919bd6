"""Seconds to build a 300 x 300 m twin, beside netconvert alone on the same streets.

The place is central Helsinki, the demo's map. The twin is built whole: map, ground, roads, the
scene with its buildings and trees, and every file. netconvert only turns the same cut streets
into a network.

    python benchmarks/build.py
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

import shapely
import yaml

from urbantwin.interface.whole_line import helsinki_extract
from urbantwin.roads import driving_side
from urbantwin.roads.build import NETWORK_CLASSES
from urbantwin.roads.netconvert import sumo_network
from urbantwin.site import init_site, load_site, read_extract
from urbantwin.twin import build_twin

SIDE_M = 300.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = init_site(folder / "site", helsinki_extract())
        frame = load_site(path).frame
        square = frame.lonlat_from_site(
            shapely.get_coordinates(shapely.box(*[-SIDE_M / 2] * 2, *[SIDE_M / 2] * 2))
        )
        value = yaml.safe_load(path.read_text())
        value["region"] = {"polygon": {"type": "Polygon", "coordinates": [square.tolist()]}}
        path.write_text(yaml.safe_dump(value, allow_unicode=True))
        site = load_site(path)

        began = time.perf_counter()
        twin = build_twin(site, folder / "twin")
        whole_s = time.perf_counter() - began

        extract = read_extract(site.osm.path)
        side = driving_side(site.latitude, site.longitude)
        streets = [w for w in extract.highways() if w.tags["highway"] in NETWORK_CLASSES]
        osm = folder / "streets.osm"
        pieces = extract.clipped(site.frame, site.region, streets)
        extract.write_pieces(osm, site.frame, pieces)
        began = time.perf_counter()
        sumo_network(
            osm, site.frame, driving_side=side, keep_apart=(), out=folder / "streets.net.xml"
        )
        netconvert_s = time.perf_counter() - began
        result = {
            "region_m": [SIDE_M, SIDE_M],
            "triangles": len(twin.mesh.faces),
            "lanes": len(twin.roads.lanes),
            "build_s": round(whole_s, 2),
            "netconvert_s": round(netconvert_s, 2),
            "ratio": round(whole_s / netconvert_s, 1),
        }
    if given.json:
        print(json.dumps(result))
    else:
        for key, number in result.items():
            print(f"{key}: {number}")


if __name__ == "__main__":
    main()
