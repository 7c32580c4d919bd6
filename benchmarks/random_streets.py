"""Streets at random places of the extracts at hand: what of them a vehicle could not drive on.

A seed draws signals and junctions of every extract in turn, and a radius for each. The roads of
each place are built with the closed loop, on flat ground, and looked at: how much of them lies in
buildings, how tight turns are. Buildings that do not touch the region are not in the twin.

    python benchmarks/random_streets.py --seed 8102 --each 2
    python benchmarks/random_streets.py --seed 8102 --only taipei --json rows.json
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from places import DATA, anchors, extracts
from urbantwin.errors import UrbanTwinError
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads, driving_side
from urbantwin.roads.build import BuiltRoads
from urbantwin.roads.building_ground import building_grounds
from urbantwin.site import init_site, load_site, read_extract
from urbantwin.site.extract import Extract

#: Kinds of lanes that vehicles drive or stand on.
DRIVEN = ("driving", "bus", "bicycle", "parking", "shoulder")
#: Turns are measured over this length, metres, and tight below this radius.
OVER_M, TIGHT_M = 1.5, 3.0
#: Buildings are read this far beyond the region, metres; less in one is not told, square metres.
BESIDE_M, NOTHING_M2 = 400.0, 0.5
COLUMNS = ("outer, standing", "outer, all", "within", "outlines", "tight", "outer on roads")


def tightest(line: np.ndarray) -> float:
    """The least radius of a line (N, 2) over `OVER_M`, metres."""
    road = shapely.LineString(line)
    if road.length < 2 * OVER_M:
        return float("inf")
    at = np.linspace(0.0, road.length, int(road.length / 0.5) + 2)
    legs = np.diff(shapely.get_coordinates(road.interpolate(at)), axis=0)
    heading, middle = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0])), (at[1:] + at[:-1]) / 2
    first = np.linspace(middle[0], middle[-1] - OVER_M, 50)
    turned = np.interp(first + OVER_M, middle, heading) - np.interp(first, middle, heading)
    return OVER_M / max(float(np.abs(turned).max()), 1e-9)


def judged(built: BuiltRoads, region: shapely.Polygon, extract: Extract, frame: Any) -> dict:
    """Square metres in buildings, and turns."""
    features = extract.features(frame, region.buffer(BESIDE_M))
    ground = building_grounds(features, region)
    walls, standing = shapely.union_all(ground.everywhere), shapely.union_all(ground.within)
    network = built.network
    row: dict[str, Any] = dict.fromkeys(COLUMNS, 0.0)
    row["where"] = []
    streets, outer = [], []
    for road in network.roads:
        lanes = [network.lane_by_id[lane] for lane in road.lanes]
        parts = [x.polygon for x in lanes if x.kind in DRIVEN and x.level == 0]
        area = shapely.union_all(parts)
        (streets if road.ways else outer).append(area)
        within, beyond = area & region, area - region
        found = {
            "within": within & walls,
            "outer, standing": beyond & standing,
            "outer, all": beyond & walls,
        }
        for column, hit in found.items():
            row[column] += hit.area
            if hit.area > NOTHING_M2:
                middle = np.round(shapely.get_coordinates(hit.centroid)[0], 1).tolist()
                row["where"].append([column, road.id, round(hit.area, 1), middle])
    for k, area in enumerate(outer):
        row["outer on roads"] += sum((area & other).area for other in (*streets, *outer[:k]))
    for junction in network.junctions:
        if len(junction.outline) > 2:
            ground = shapely.make_valid(shapely.Polygon(np.asarray(junction.outline)[:, :2]))
            row["outlines"] += (ground & region & walls).area
    for lane in network.lanes:
        if lane.kind == "connection" and {"car", "bus"} & set(lane.allowed):
            radius = tightest(lane.centre[:, :2])
            if radius < TIGHT_M:
                row["tight"] += 1
                middle = np.round(lane.centre[0, :2], 1).tolist()
                row["where"].append(["tight", lane.id, round(radius, 1), middle])
    return row


def place(path: Path, lat: float, lon: float, radius: float) -> dict[str, Any]:
    """Build one place and judge it."""
    row: dict[str, Any] = {"extract": path.name, "anchor": [lat, lon], "radius": radius}
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        try:
            made = init_site(folder / "s", path, latitude=lat, longitude=lon, radius_m=radius)
            site = load_site(made)
            extract = read_extract(site.osm.path)
            built = build_roads(
                extract,
                site.frame,
                site.region,
                Elevation.flat(),
                driving_side=driving_side(site.latitude, site.longitude),
                out=folder / "n.net.xml",
                closed_loop=True,
            )
        except UrbanTwinError as problem:
            return {**row, "failed": str(problem)}
        row["seconds"] = round(time.perf_counter() - began, 1)
        return row | judged(built, site.region, extract, site.frame)


def main() -> None:
    """Print a line per place, and sums."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of extracts")
    parser.add_argument("--only", action="append", default=[], metavar="NAME")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--each", type=int, default=2, help="places of each extract")
    parser.add_argument("--json", type=Path, help="write what was found, and where")
    given = parser.parse_args()
    rows = []
    print("square metres in buildings, turns below 3 m:", ", ".join(COLUMNS))
    for name, path in extracts(given.data, given.only).items():
        for lat, lon, radius in anchors(path, given.seed, given.each):
            rows.append(place(path, lat, lon, radius))
            told = [f"{rows[-1].get(column, 0):7.1f}" for column in COLUMNS]
            what = rows[-1].get("failed") or " ".join(told)
            print(f"{name:24}{lat:11.6f}{lon:12.6f}{radius:5.0f}  {what}", flush=True)
    print(len(rows), "places", {c: round(sum(r.get(c, 0) for r in rows), 1) for c in COLUMNS})
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
