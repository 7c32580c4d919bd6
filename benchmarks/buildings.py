"""Seconds to build 400 buildings of every roof shape on 300 x 300 m, streets between them.

The map is made up: two rows of lots in every block between streets, footprints of
rectangles, L, T, U shapes, courtyards and circles, roofs of all shapes, storeys from one to six.
It is written as an OpenStreetMap extract. Printed are the seconds for the buildings alone and for
the whole twin.

    python benchmarks/buildings.py [--json] [--buildings-only]
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import shapely
import yaml

from urbantwin.geometry import SiteFrame
from urbantwin.scene.building import building_mesh
from urbantwin.scene.roof import SHAPES
from urbantwin.site import init_site, load_site, read_extract
from urbantwin.twin import build_twin

SIDE_M, MOST = 300.0, 400
LATITUDE, LONGITUDE = 52.48, 13.43
NORTH_M = 111_194.9
ROOFS = [*SHAPES[:8], "gabled", "gabled", "flat", "flat", "gambrel", "mansard"]
TYPES = ["apartments", "house", "office", "retail", "yes", "industrial", "school"]


def footprint(rng: np.random.Generator, x: float, y: float) -> shapely.Polygon:
    w, d = rng.uniform(8.0, 10.8, 2)
    a, b = rng.uniform(0.35, 0.5, 2) * (w, d)
    shapes = [
        shapely.box(0, 0, w, d),
        shapely.box(0, 0, w, d),
        shapely.box(0, 0, w, d),
        shapely.Polygon([(0, 0), (w, 0), (w, b), (a, b), (a, d), (0, d)]),
        shapely.Polygon(
            [(0, 0), (w, 0), (w, b), (0.7 * w, b), (0.7 * w, d), (0.3 * w, d), (0.3 * w, b), (0, b)]
        ),
        shapely.Polygon(
            [(0, 0), (w, 0), (w, d), (0.7 * w, d), (0.7 * w, b), (0.3 * w, b), (0.3 * w, d), (0, d)]
        ),
        shapely.Polygon(
            shapely.box(0, 0, w, d).exterior,
            [shapely.box(0.35 * w, 0.35 * d, 0.65 * w, 0.65 * d).exterior],
        ),
        shapely.Point(w / 2, d / 2).buffer(min(w, d) / 2, quad_segs=6),
    ]
    turned = shapely.affinity.rotate(shapes[rng.integers(len(shapes))], rng.normal(0, 2))
    return shapely.affinity.translate(turned, x - w / 2, y - d / 2)


class OsmWriter:
    """Writes nodes, ways and multipolygons given in metres about the site's middle."""

    def __init__(self) -> None:
        self.root = ElementTree.Element("osm", version="0.6")
        self._nodes: dict[tuple[float, float], int] = {}
        self._ways: list[ElementTree.Element] = []
        self._relations: list[ElementTree.Element] = []

    def node(self, x: float, y: float) -> int:
        place = (round(x, 3), round(y, 3))
        if place not in self._nodes:
            self._nodes[place] = len(self._nodes) + 1
            lon = LONGITUDE + x / (NORTH_M * math.cos(math.radians(LATITUDE)))
            ElementTree.SubElement(
                self.root, "node", id=str(self._nodes[place]), version="1",
                lat=f"{LATITUDE + y / NORTH_M:.9f}", lon=f"{lon:.9f}",
            )  # fmt: skip
        return self._nodes[place]

    def way(self, points: Iterable[tuple[float, float]], tags: dict[str, str]) -> int:
        way = ElementTree.Element("way", id=str(len(self._ways) + 1), version="1")
        for x, y in points:
            ElementTree.SubElement(way, "nd", ref=str(self.node(x, y)))
        self._tag(way, tags)
        self._ways.append(way)
        return len(self._ways)

    def area(self, polygon: shapely.Polygon, tags: dict[str, str]) -> None:
        rings = [shapely.get_coordinates(ring).tolist() for ring in shapely.get_rings(polygon)]
        if len(rings) == 1:
            self.way(rings[0], tags)
            return
        relation = ElementTree.Element("relation", id=str(len(self._relations) + 1), version="1")
        for number, ring in enumerate(rings):
            role = "inner" if number else "outer"
            ref = str(self.way(ring, {}))
            ElementTree.SubElement(relation, "member", type="way", ref=ref, role=role)
        self._tag(relation, tags | {"type": "multipolygon"})
        self._relations.append(relation)

    def save(self, path: Path) -> None:
        self.root.extend([*self._ways, *self._relations])
        ElementTree.ElementTree(self.root).write(path, encoding="utf-8", xml_declaration=True)

    @staticmethod
    def _tag(element: ElementTree.Element, tags: dict[str, str]) -> None:
        for key, value in tags.items():
            ElementTree.SubElement(element, "tag", k=key, v=value)


def write_city(path: Path, seed: int = 1) -> None:
    rng = np.random.default_rng(seed)
    city = OsmWriter()
    streets, crossings = (-120.0, -60.0, 0.0, 60.0, 120.0), (-100.0, 0.0, 100.0)
    tags = {"highway": "residential", "width": "5"}
    for y in crossings:
        city.way([(-170, y), *((x, y) for x in streets), (170, y)], tags)
    for x in streets:
        city.way([(x, -170), *((x, y) for y in crossings), (x, 170)], tags)
    rows = [y for y in np.linspace(-146, 146, 26) if min(abs(y - c) for c in crossings) > 9]
    columns = [x + beside for x in streets for beside in (-20.0, -8.6, 8.6, 20.0)]
    for x, y in list(itertools.product(columns, rows))[:MOST]:
        tags = {
            "building": str(rng.choice(TYPES)),
            "building:levels": str(rng.integers(1, 7)),
            "roof:shape": str(rng.choice(ROOFS)),
        }
        if rng.random() < 0.5:
            tags["roof:height"] = f"{rng.uniform(1.5, 5):.1f}"
        city.area(footprint(rng, x, float(y)), tags)
    city.save(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--buildings-only", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        osm = folder / "city.osm"
        write_city(osm)
        region = shapely.box(*[-SIDE_M / 2] * 2, *[SIDE_M / 2] * 2)
        features = read_extract(osm).features(SiteFrame(LATITUDE, LONGITUDE), region)
        lines = [f.geometry for f in features if "highway" in f.tags]
        carriageway = shapely.union_all([line.buffer(2.5) for line in lines])
        began = time.perf_counter()
        mesh, notes, _ = building_mesh(
            features,
            region=region,
            ground_height=lambda xy: np.zeros(len(xy)),
            carriageway=carriageway,
        )
        result: dict[str, object] = {
            "buildings": notes["buildings"],
            "windows": notes.get("windows", 0),
            "triangles of buildings": len(mesh.faces),
            "buildings_s": round(time.perf_counter() - began, 2),
        }
        if not given.buildings_only:
            path = init_site(
                folder / "site", osm, latitude=LATITUDE, longitude=LONGITUDE, radius_m=150
            )
            value = yaml.safe_load(path.read_text())
            square = load_site(path).frame.lonlat_from_site(shapely.get_coordinates(region))
            value["region"] = {"polygon": {"type": "Polygon", "coordinates": [square.tolist()]}}
            path.write_text(yaml.safe_dump(value, allow_unicode=True))
            site = load_site(path)
            began = time.perf_counter()
            twin = build_twin(site, folder / "twin")
            result["triangles"] = len(twin.mesh.faces)
            result["build_s"] = round(time.perf_counter() - began, 2)
    if given.json:
        print(json.dumps(result))
    else:
        for key, value in result.items():
            print(f"{key}: {value}")


if __name__ == "__main__":
    main()
