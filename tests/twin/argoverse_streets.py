"""Streets and ground of the Argoverse log in Pittsburgh as an OSM extract and a GeoTIFF.

The vector map has lane segments; side by side and in one direction they are a street, and segments
of intersections join the ends of streets into junctions.
"""

import json
from collections import defaultdict
from xml.etree import ElementTree

import numpy as np
import rasterio
import shapely
from pyproj import Transformer
from rasterio.fill import fillnodata
from rasterio.transform import Affine

ANCHOR = (40.462723, -79.951023)
#: City coordinates plus this are EPSG:32617.
CITY = np.array([583710.007, 4477260.000])
LOG = "7fab2350-7eaf-3b7e-a39d-6937a4c1bede"


class Log:
    def __init__(self, folder):
        found = folder / "lidar" / "argoverse2-pittsburgh" / LOG / "map"
        sim2 = json.loads((found / f"{LOG}___img_Sim2_city.json").read_text())
        heights = found / f"{LOG}_ground_height_surface____PIT.npy"
        self.heights = np.load(heights).astype(float)
        self.cell = 1 / sim2["s"]
        self.south_west = CITY - np.array(sim2["t"])
        drawn = json.loads((found / f"log_map_archive_{LOG}____PIT_city_47896.json").read_text())
        self.segments = {int(k): v for k, v in drawn["lane_segments"].items()}
        self.areas = drawn["drivable_areas"].values()

    def side(self, segment, name):
        points = self.segments[segment][f"{name}_lane_boundary"]
        return np.array([[p["x"], p["y"]] for p in points]) + CITY

    def area(self, segment):
        ring = np.vstack([self.side(segment, "left"), self.side(segment, "right")[::-1]])
        return shapely.make_valid(shapely.Polygon(ring))

    def drivable(self):
        outlines = ([[p["x"], p["y"]] for p in area["area_boundary"]] for area in self.areas)
        return shapely.union_all([shapely.Polygon(np.array(one) + CITY) for one in outlines])

    def known_heights(self):
        """(N, 2) places in EPSG:32617 and (N,) heights of the raster's cells that have one."""
        row, column = np.nonzero(np.isfinite(self.heights))
        xy = self.south_west + self.cell * (np.column_stack([column, row]) + 0.5)
        return xy, self.heights[row, column]

    def write_dem(self, path):
        """The raster, holes filled: beside its roads nothing is known of that place."""
        known = np.isfinite(self.heights)
        middle = np.nanmean(self.heights)
        filled = fillnodata(
            np.where(known, self.heights - middle, 0.0).astype(np.float32),
            mask=known.astype(np.uint8),
            max_search_distance=300.0,
        )
        rows, columns = self.heights.shape
        west, south = self.south_west
        place = Affine(self.cell, 0, west, 0, -self.cell, south + rows * self.cell)
        kind = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": "EPSG:32617"}
        with rasterio.open(
            path, "w", height=rows, width=columns, transform=place, **kind
        ) as raster:
            raster.write((filled + middle)[::-1].astype(np.float32), 1)

    def write_osm(self, path):
        joined = Joined()
        streets = [
            k for k, v in self.segments.items()
            if not v["is_intersection"] and v["lane_type"] != "BIKE"
        ]  # fmt: skip
        crossings = [k for k, v in self.segments.items() if v["is_intersection"]]
        for k in streets:
            for other in ("left_neighbor_id", "right_neighbor_id"):
                j = self.segments[k][other]
                if j in streets and self.heading(k) @ self.heading(j) > 0:
                    joined.join(("lane", k), ("lane", j))
        groups = defaultdict(list)
        for k in streets:
            groups[joined.root(("lane", k))].append(k)

        def knot(k, end):
            return ("x", k) if k in crossings else (joined.root(("lane", k)), end)

        for k, v in self.segments.items():
            for j in v["successors"]:
                if {j, k} <= {*streets, *crossings}:
                    joined.join(knot(k, 1), knot(j, 0))
        areas = {k: self.area(k) for k in crossings}
        for one in crossings:
            for other in crossings:
                if one < other and areas[one].intersection(areas[other]).area > 1:
                    joined.join(("x", one), ("x", other))
        ways, places = [], defaultdict(list)
        for root, lanes in groups.items():
            sides = [(along(self.side(k, "left")), along(self.side(k, "right"))) for k in lanes]
            middle = np.mean([line for pair in sides for line in pair], axis=0)
            width = sum(np.linalg.norm(a - b, axis=1).mean() for a, b in sides)
            ends = [joined.root((root, end)) for end in (0, 1)]
            places[ends[0]].append(middle[0])
            places[ends[1]].append(middle[-1])
            ways.append((middle, len(lanes), width, ends))
        write_ways(path, ways, {end: np.mean(spots, axis=0) for end, spots in places.items()})

    def heading(self, k):
        line = self.side(k, "left")
        return line[-1] - line[0]


class Joined:
    """Sets of things that belong together."""

    def __init__(self):
        self.parent = {}

    def root(self, one):
        while self.parent.setdefault(one, one) != one:
            one = self.parent[one]
        return one

    def join(self, one, other):
        self.parent[self.root(one)] = self.root(other)


def along(line, count=12):
    shares = np.linspace(0, 1, count)
    return shapely.get_coordinates(
        shapely.line_interpolate_point(shapely.LineString(line), shares, normalized=True)
    )


def write_ways(path, ways, junctions):
    to_lonlat = Transformer.from_crs("EPSG:32617", "EPSG:4326", always_xy=True)
    root = ElementTree.Element("osm", version="0.6", generator="test")
    number = {}

    def node(xy, key):
        if key not in number:
            number[key] = str(len(number) + 1)
            lon, lat = to_lonlat.transform(*xy)
            place = {"lat": f"{lat:.9f}", "lon": f"{lon:.9f}"}
            ElementTree.SubElement(root, "node", id=number[key], version="1", **place)
        return number[key]

    lines = [
        [
            node(junctions[ends[0]], ends[0]),
            *(node(xy, (k, i)) for i, xy in enumerate(middle[1:-1])),
            node(junctions[ends[1]], ends[1]),
        ]
        for k, (middle, _, _, ends) in enumerate(ways)
    ]
    for k, (refs, (_, lanes, width, _)) in enumerate(zip(lines, ways, strict=True)):
        way = ElementTree.SubElement(root, "way", id=str(1000 + k), version="1")
        for ref in refs:
            ElementTree.SubElement(way, "nd", ref=ref)
        tags = {"highway": "secondary", "oneway": "yes", "lanes": str(lanes), "sidewalk": "no"}
        for key, value in {**tags, "width": f"{width:.2f}"}.items():
            ElementTree.SubElement(way, "tag", k=key, v=value)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
