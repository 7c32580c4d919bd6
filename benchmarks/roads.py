"""Seconds to build the roads of a site, beside netconvert alone on the same streets.

The roads are built whole: streets cut to the region, outer roads that close them in a loop,
netconvert's topology, the lane model with its profiles, side lanes, signals and signs, strips, and
SUMO's network redrawn. netconvert only turns streets into a network: once all streets of the
extract, as its users do, and once those within the region, without the loop. Each is run several
times in turn and the fastest counts. Without a file, the place is central Helsinki, the
demo's map.

    python benchmarks/roads.py
    python benchmarks/roads.py one.osm another.osm.pbf --json
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

import shapely

from urbantwin.ground import Elevation
from urbantwin.interface.whole_line import helsinki_extract
from urbantwin.roads import build_roads, driving_side
from urbantwin.roads.build import NETWORK_CLASSES
from urbantwin.roads.netconvert import sumo_network
from urbantwin.site import init_site, load_site, read_extract

TARGET = 3.0
#: No extract reaches farther from its site, metres.
EXTRACT_M = 100_000.0


def measure(path: Path, folder: Path, times: int) -> dict[str, object]:
    site = load_site(init_site(folder / path.name, path))
    extract = read_extract(site.osm.path)
    side = driving_side(site.latitude, site.longitude)
    streets = [w for w in extract.highways() if w.tags["highway"] in NETWORK_CLASSES]
    everywhere = shapely.box(*[-EXTRACT_M] * 2, *[EXTRACT_M] * 2)
    cuts = {"extract": everywhere, "region": site.region}
    for name, area in cuts.items():
        pieces = extract.clipped(site.frame, area, streets)
        extract.write_pieces(folder / f"{name}.osm", site.frame, pieces)
    ours: list[float] = []
    theirs: dict[str, list[float]] = {name: [] for name in cuts}
    for _ in range(times):
        began = time.perf_counter()
        roads = build_roads(
            extract,
            site.frame,
            site.region,
            Elevation.flat(),
            driving_side=side,
            closed_loop=True,
            out=folder / "ours.net.xml",
        )
        ours.append(time.perf_counter() - began)
        for name, taken in theirs.items():
            began = time.perf_counter()
            sumo_network(
                folder / f"{name}.osm",
                site.frame,
                driving_side=side,
                keep_apart=(),
                out=folder / "theirs.net.xml",
            )
            taken.append(time.perf_counter() - began)
    whole, cut = min(theirs["extract"]), min(theirs["region"])
    return {
        "extract": path.name,
        "lanes": len(roads.network.lanes),
        "roads_s": round(min(ours), 2),
        "netconvert_extract_s": round(whole, 2),
        "netconvert_region_s": round(cut, 2),
        "ratio": round(min(ours) / whole, 1),
        "ratio_to_region": round(min(ours) / cut, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("extracts", nargs="*", type=Path, help="OpenStreetMap files")
    parser.add_argument("--times", type=int, default=3, help="runs of each")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        rows = [measure(p, Path(name), given.times) for p in given.extracts or [helsinki_extract()]]
    if given.json:
        print(json.dumps({"target_ratio": TARGET, "extracts": rows}))
        return
    for row in rows:
        print("  ".join(f"{key}: {value}" for key, value in row.items()))
    for key in ("ratio", "ratio_to_region"):
        print(f"worst {key}: {max(float(str(row[key])) for row in rows)} (target: {TARGET})")


if __name__ == "__main__":
    main()
