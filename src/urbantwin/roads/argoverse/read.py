"""Conversion of an Argoverse 2 vector map to the lane model, through lanelets.

A lane segment corresponds to a lanelet of Lanelet2: two bounds in the direction of travel.
Boundaries through the same points are one line, and consecutive segments share the ends of their
boundaries. So the same planner makes streets and junctions of both kinds of map.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame, area_union, areas_of
from urbantwin.roads.argoverse.file import MapFile, city_of, is_argoverse, lonlat_of, read_file
from urbantwin.roads.lanelet2.document import Document, Node, Relation, Way
from urbantwin.roads.lanelet2.read import Translation, translated
from urbantwin.roads.model import LaneModel

__all__ = ["drivable_area", "is_argoverse", "lanelets_of_map", "read_argoverse", "translate"]

#: Kind of a segment -> subtype of a lanelet.
SUBTYPES = {"VEHICLE": "road", "BIKE": "bicycle_lane", "BUS": "bus_lane"}
#: Maximum distance between the ends of consecutive segments that are merged, metres; the format
#: rounds to centimetres.
SAME_M = 0.05


def read_argoverse(path: Path, frame: SiteFrame) -> tuple[LaneModel, dict[str, object]]:
    """Read an Argoverse 2 vector map as a lane model in the site frame.

    The file name contains the city and thereby the georeference. Otherwise the map's own x and y
    are east and north of the anchor. ``ways`` of roads are ids of lane segments.

    Returns:
        The model, and notes: counts, assumptions and omissions.

    Raises:
        InputError: it is not such a map, lacks required elements, or is far from the anchor.
        StageError: the segments make no roads.
    """
    translation = translate(path, frame)
    return translation.model, translation.notes


def drivable_area(path: Path, frame: SiteFrame) -> shapely.Geometry:
    """Return the mapped drivable area in plan, site frame; empty if there is none.

    It includes areas outside lanes: the width beside them where cars park, and the asphalt between
    carriageways without a median. For a map without a city it is in the map's own x and y.

    Raises:
        InputError: it is not such a map, or lacks required elements.
    """
    read = read_file(path)
    city = city_of(path)
    areas = []
    for outline in read.drivable:
        places = outline[:, :2]
        if city is not None:
            places = frame.site_from_lonlat(lonlat_of(city, places))
        areas.append(shapely.make_valid(shapely.Polygon(places)))
    return areas_of(area_union(areas))


def translate(path: Path, frame: SiteFrame) -> Translation:
    """Return the result of ``read_argoverse`` with the place of each lane segment in the model."""
    read = read_file(path)
    translation = translated(lanelets_of_map(read), frame)
    translation.notes["speeds"] = "none in the map: 50 km/h, bicycle lanes 25 km/h"
    beyond = {i for s in read.segments.values() for i in s.successors} - set(read.segments)
    if beyond:
        translation.notes["successors_beyond_the_map"] = len(beyond)
    return translation


def lanelets_of_map(read: MapFile) -> Document:
    """Return an Argoverse 2 map as a document of lanelets.

    Segments and crossings keep their ids unless these collide. The tag ``intersection`` is that of
    the segment. Elements with boundaries of a single point are dropped.
    """
    drawn = _Drawn(read)
    relations: dict[int, Relation] = {}
    dropped = list(read.dropped)
    for segment in read.segments.values():
        try:
            ways = [
                drawn.way(line, mark)
                for line, mark in zip((segment.left, segment.right), segment.marks, strict=True)
            ]
        except InputError as error:
            dropped.append(_at(error, f"lane segment {segment.id}", segment.left))
            continue
        relations[segment.id] = _lanelet(
            ways,
            {
                "subtype": SUBTYPES[segment.kind],
                "one_way": "yes",
                "intersection": "yes" if segment.within else "no",
            },
        )
    spare = max([*read.segments, *read.crossings]) + 1
    for crossing in read.crossings.values():
        identity = crossing.id
        if identity in relations:
            identity, spare = spare, spare + 1
        try:
            ways = [drawn.way(line, "NONE") for line in crossing.edges]
        except InputError as error:
            dropped.append(_at(error, f"pedestrian crossing {crossing.id}", crossing.edges[0]))
            continue
        relations[identity] = _lanelet(ways, {"subtype": "crosswalk"})
    if not relations:
        raise dropped[0]
    return Document(read.path, drawn.nodes(), drawn.ways, relations, tuple(dropped))


def _at(error: InputError, element: str, line: NDArray[np.float64]) -> InputError:
    """Return an error with an element and its position in the city, metres."""
    place = f"{element} at x = {line[0, 0]:.1f}, y = {line[0, 1]:.1f}"
    return InputError(error.problem, file=error.file, place=place, expected=error.expected)


def _lanelet(ways: list[int], tags: dict[str, str]) -> Relation:
    members = (("way", ways[0], "left"), ("way", ways[1], "right"))
    return Relation(members, {"type": "lanelet", "location": "urban", **tags})


class _Drawn:
    """Unique points and lines of a map."""

    def __init__(self, read: MapFile) -> None:
        self.read = read
        self.ways: dict[int, Way] = {}
        self._numbers: dict[tuple[float, float], int] = {}
        self._places: list[NDArray[np.float64]] = []
        self._ways: dict[tuple[int, ...], int] = {}
        self._join()

    def _number(self, point: NDArray[np.float64]) -> int:
        key = round(float(point[0]), 3), round(float(point[1]), 3)
        if key not in self._numbers:
            self._numbers[key] = len(self._places) + 1
            self._places.append(point)
        return self._numbers[key]

    def _join(self) -> None:
        """Merge the ends of consecutive segments that differ by rounding."""
        segments = self.read.segments
        for first in segments.values():
            for second in (segments[i] for i in first.successors if i in segments):
                for a, b in ((first.left[-1], second.left[0]), (first.right[-1], second.right[0])):
                    if np.linalg.norm(a[:2] - b[:2]) <= SAME_M:
                        key = round(float(b[0]), 3), round(float(b[1]), 3)
                        self._numbers.setdefault(key, self._number(a))

    def way(self, line: NDArray[np.float64], mark: str) -> int:
        """Return the way through points in either direction; the first mapped paint is kept.

        Raises:
            InputError: all points coincide.
        """
        ids = [self._number(point) for point in line]
        ids = [n for k, n in enumerate(ids) if k == 0 or n != ids[k - 1]]
        if len(set(ids)) < 2:
            raise InputError("has a boundary without length", file=self.read.path)
        way_id = self._ways.get(tuple(ids))
        turned = way_id is None and tuple(ids[::-1]) in self._ways
        if turned:
            way_id = self._ways[tuple(ids[::-1])]
        elif way_id is None:
            way_id = self._ways[tuple(ids)] = len(self._ways) + 1
            self.ways[way_id] = Way(tuple(ids), _paint(mark, turned=False))
        if self.ways[way_id].tags["type"] == "virtual":
            self.ways[way_id] = Way(self.ways[way_id].nodes, _paint(mark, turned=turned))
        return way_id

    def nodes(self) -> dict[int, Node]:
        """Return all points, in degrees if the map's city is known, else in its own x and y."""
        places = np.array(self._places)
        city = city_of(self.read.path)
        tags = [{"ele": repr(float(z))} for z in places[:, 2]]
        if city is None:
            for tag, (x, y) in zip(tags, places[:, :2], strict=True):
                tag |= {"local_x": repr(float(x)), "local_y": repr(float(y))}
            degrees = np.full((len(places), 2), np.nan)
        else:
            degrees = lonlat_of(city, places[:, :2])
        return {
            k + 1: Node(float(latitude), float(longitude), tag)
            for k, ((longitude, latitude), tag) in enumerate(zip(degrees, tags, strict=True))
        }


def _paint(mark: str, *, turned: bool) -> dict[str, str]:
    """Return a boundary's paint as Lanelet2's tags (``LaneMarkType`` of av2-api).

    ``DASH_SOLID`` is read from left to right, as the boundary is drawn. Colours are not used.
    """
    words = mark.split("_")
    if mark in ("NONE", "UNKNOWN"):
        return {"type": "virtual"}
    lines = ["dashed" if word.startswith("DASH") else "solid" for word in words[:-1] if word]
    if words[0] == "DOUBLE":
        lines = [lines[-1]] * 2
    if turned:
        lines = lines[::-1]
    return {"type": "line_thin", "subtype": "_".join(lines[:2]) or "solid"}
