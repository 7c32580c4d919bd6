"""Write the inputs of this example: ``two-avenues.osm`` and ``two-avenues-dem.tif``.

The place is invented: two multi-lane streets that cross at signals on a slope, drawn here in
metres east and north of the junction. Run it after a change: ``python make_inputs.py [FOLDER]``.

SPDX-License-Identifier: CC0-1.0
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import rasterio
from pyproj import Transformer

from urbantwin.geometry import SiteFrame

LATITUDE, LONGITUDE = 48.7, 9.18
HALF_STREET_M = 150.0  # how far each street is drawn from the junction
CARRIAGEWAY_M = 6.5  # from the middle of the median to the middle of a carriageway of the avenue

DEM_CRS = "EPSG:25832"
DEM_PIXEL_M = 3.0
DEM_HALF_M = 210.0

Point = tuple[float, float]


class Drawing:
    """Nodes, ways and relations in the order drawn, with ids 1, 2, 3, ..."""

    def __init__(self) -> None:
        self._frame = SiteFrame(LATITUDE, LONGITUDE)
        self._lines: dict[str, list[str]] = {"node": [], "way": [], "relation": []}
        self._ids = {"node": 0, "way": 0, "relation": 0}
        self._shared: dict[Point, int] = {}

    def node(self, at: Point, **tags: str) -> int:
        """Draw a point with tags of its own."""
        (longitude, latitude) = self._frame.lonlat_from_site([at])[0]
        place = f'lat="{latitude:.7f}" lon="{longitude:.7f}"'
        return self._write("node", place, [], tags)

    def corner(self, at: Point) -> int:
        """Return the untagged node there, the same for every way that passes."""
        if at not in self._shared:
            self._shared[at] = self.node(at)
        return self._shared[at]

    def way(self, points: Iterable[Point | int], **tags: str) -> int:
        """Draw a line through points and nodes."""
        ids = [point if isinstance(point, int) else self.corner(point) for point in points]
        return self._write("way", "", [f'<nd ref="{node}"/>' for node in ids], tags)

    def area(self, points: Sequence[Point], **tags: str) -> int:
        """Draw a closed line."""
        return self.way([*points, points[0]], **tags)

    def multipolygon(self, outer: int, inner: int, **tags: str) -> int:
        """Draw an area with a hole, of two closed ways."""
        members = [
            f'<member type="way" ref="{outer}" role="outer"/>',
            f'<member type="way" ref="{inner}" role="inner"/>',
        ]
        return self._write("relation", "", members, {"type": "multipolygon", **tags})

    def _write(self, kind: str, place: str, children: list[str], tags: dict[str, str]) -> int:
        self._ids[kind] += 1
        number = self._ids[kind]
        pairs = {key.replace("__", ":"): value for key, value in tags.items()}
        children = children + [
            f"<tag k={quoteattr(key)} v={quoteattr(value)}/>" for key, value in pairs.items()
        ]
        head = f'  <{kind} id="{number}" version="1" {place}'.rstrip()
        if children:
            body = "".join(f"    {child}\n" for child in children)
            self._lines[kind].append(f"{head}>\n{body}  </{kind}>\n")
        else:
            self._lines[kind].append(f"{head}/>\n")
        return number

    def xml(self) -> str:
        """Return the drawing as OSM XML."""
        body = "".join("".join(self._lines[kind]) for kind in ("node", "way", "relation"))
        return (
            "<?xml version='1.0' encoding='UTF-8'?>\n"
            "<!-- An invented place. CC0 1.0. Written by make_inputs.py. -->\n"
            f'<osm version="0.6" generator="make_inputs.py">\n{body}</osm>\n'
        )


def rectangle(west: float, south: float, east: float, north: float) -> list[Point]:
    """Return the corners, counter-clockwise."""
    return [(west, south), (east, south), (east, north), (west, north)]


def draw_streets(drawing: Drawing) -> None:
    """Draw the avenue (two carriageways and a median), the street that crosses it, and signals."""
    end, side = HALF_STREET_M, CARRIAGEWAY_M
    widening, stop = 62.0, 16.0
    signals = {
        sign: drawing.node((0.0, sign * side), highway="traffic_signals") for sign in (-1, 1)
    }

    def crossing(at: Point) -> int:
        return drawing.node(at, highway="crossing", crossing="traffic_signals")

    avenue = {
        "highway": "secondary",
        "name": "Long Avenue",
        "oneway": "yes",
        "maxspeed": "50",
        "surface": "asphalt",
        "sidewalk": "right",
        "lit": "yes",
    }
    turns = "left|through|through;right"
    for sign in (-1, 1):  # -1: the southern carriageway, driven eastwards; +1: the northern one
        along, y = -sign, sign * side
        before = [(-along * end, y), (-along * widening, y)]
        drawing.way(before, **avenue, lanes="2")
        near = [(-along * widening, y), crossing((-along * stop, y)), signals[sign]]
        drawing.way(near, **avenue, lanes="3", turn__lanes=turns)
        after = [signals[sign], crossing((along * stop, y)), (along * end, y)]
        drawing.way(after, **avenue, lanes="2")

    street = {
        "highway": "tertiary",
        "name": "Cross Street",
        "maxspeed": "30",
        "surface": "asphalt",
        "sidewalk": "both",
        "cycleway": "lane",
        "lit": "yes",
    }
    for sign in (-1, 1):
        far, wide = (0.0, sign * end), (0.0, sign * 58.0)
        inner = signals[sign]
        drawing.way([far, wide], **street, lanes="2")
        # A way's direction is its nodes' order: the approach to the junction is forward here.
        drawing.way(
            [wide, crossing((0.0, sign * (side + 13.0))), inner],
            **street,
            lanes="3",
            lanes__forward="2",
            lanes__backward="1",
            turn__lanes__forward="left|through;right",
        )
    drawing.way([signals[-1], signals[1]], **(street | {"sidewalk": "no"}), lanes="2")

    for west, east in ((-130.0, -24.0), (24.0, 130.0)):
        drawing.area(
            rectangle(west, -1.2, east, 1.2),
            area__highway="traffic_island",
            kerb="raised",
            surface="grass",
        )


def draw_buildings(drawing: Drawing) -> None:
    """Draw a block with a courtyard, a tower of parts, a terrace of houses and a shop."""
    outer = drawing.area(rectangle(22.0, -74.0, 72.0, -26.0))
    inner = drawing.area(rectangle(36.0, -60.0, 58.0, -40.0))
    drawing.multipolygon(
        outer, inner, building="apartments", building__levels="5", roof__shape="flat"
    )

    drawing.area(rectangle(24.0, 28.0, 64.0, 62.0), building="office", height="34")
    drawing.area(rectangle(24.0, 28.0, 64.0, 62.0), building__part="yes", height="8")
    drawing.area(
        rectangle(30.0, 36.0, 52.0, 58.0), building__part="yes", min_height="8", height="34"
    )
    canopy = rectangle(34.0, 25.0, 46.0, 28.0)
    drawing.area(canopy, building="roof", min_height="4", height="4.6")

    for house, levels in enumerate(("3", "4", "3")):
        west = -64.0 + 14.0 * house
        drawing.area(
            rectangle(west, 26.0, west + 14.0, 40.0),
            building="house",
            building__levels=levels,
            roof__shape="gabled",
        )
    drawing.area(rectangle(-68.0, -66.0, -36.0, -40.0), building="supermarket", height="6.5")
    drawing.area(
        rectangle(-34.0, -66.0, -20.0, -28.0), amenity="parking", parking="surface", access="yes"
    )


def draw_furniture(drawing: Drawing) -> None:
    """Draw street lamps, lawns, trees, a wall and a fence."""
    for x in np.arange(-126.0, 127.0, 28.0):
        for sign in (-1, 1):
            if abs(x) > 20.0:
                drawing.node((float(x), sign * 15.0), highway="street_lamp")
    for y in (-110.0, -80.0, -50.0, 50.0, 80.0, 110.0):
        drawing.node((9.0, y), highway="street_lamp")
    for x in np.arange(-112.0, 113.0, 14.0):
        if abs(x) > 30.0:
            drawing.node((float(x), 0.0), natural="tree", height="7", leaf_type="broadleaved")
    for lawn in (rectangle(-74.0, 18.0, -12.0, 74.0), rectangle(14.0, -80.0, 80.0, -18.0)):
        drawing.area(lawn, landuse="grass")
    for y in (46.0, 56.0, 66.0):
        drawing.node((-12.0, y), natural="tree", height="9", leaf_type="broadleaved")
    drawing.way([(-70.0, 46.0), (-22.0, 46.0)], natural="tree_row")
    wall = [(-70.0, 42.5), (-70.0, 70.0), (-20.0, 70.0)]
    drawing.way(wall, barrier="wall", height="2", material="brick")
    drawing.way([(-19.0, -28.0), (-19.0, -68.0), (-70.0, -68.0)], barrier="fence", height="1.6")


def ground_m(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the height of the ground: 3.5 % up towards the north-east, gently undulating."""
    slope = 0.030 * x + 0.018 * y
    undulation = 0.25 * np.sin(2 * np.pi * x / 170.0) * np.cos(2 * np.pi * y / 190.0)
    return 312.0 + slope + undulation


def write_dem(path: Path) -> None:
    """Write the heights as a GeoTIFF in a map projection that is not the site's own."""
    frame = SiteFrame(LATITUDE, LONGITUDE)
    to_map = Transformer.from_crs("EPSG:4326", DEM_CRS, always_xy=True)
    middle_e, middle_n = to_map.transform(LONGITUDE, LATITUDE)
    size = int(2 * DEM_HALF_M / DEM_PIXEL_M)
    west = np.floor(middle_e - DEM_HALF_M)
    north = np.ceil(middle_n + DEM_HALF_M)
    centre = (np.arange(size) + 0.5) * DEM_PIXEL_M
    easting, northing = np.meshgrid(west + centre, north - centre)
    lonlat = to_map.transform(easting.ravel(), northing.ravel(), direction="INVERSE")
    x, y = frame.site_from_lonlat(np.column_stack(lonlat)).T
    heights = np.round(ground_m(x, y) * 64) / 64
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=size,
        height=size,
        count=1,
        dtype="float32",
        crs=DEM_CRS,
        transform=rasterio.transform.from_origin(west, north, DEM_PIXEL_M, DEM_PIXEL_M),
        compress="deflate",
        predictor=3,
        nodata=-9999.0,
    ) as raster:
        raster.write(heights.reshape(size, size).astype(np.float32), 1)


def main(folder: Path) -> None:
    """Write both inputs into ``folder``."""
    drawing = Drawing()
    draw_streets(drawing)
    draw_buildings(drawing)
    draw_furniture(drawing)
    (folder / "two-avenues.osm").write_text(drawing.xml())
    write_dem(folder / "two-avenues-dem.tif")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
