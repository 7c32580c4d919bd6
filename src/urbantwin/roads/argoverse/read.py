"""Converting an Argoverse 2 vector map to the lane model, by way of lanelets.

A lane segment is what Lanelet2 calls a lanelet: two bounds in the direction of travel. Boundaries
that are drawn through the same points are one line, and segments that follow each other share the
ends of their boundaries; so the same planner makes streets and junctions of both kinds of map.
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
#: Ends of segments that follow each other are one place if they are nearer than this, metres; the
#: format rounds to centimetres.
SAME_M = 0.05


def read_argoverse(path: Path, frame: SiteFrame) -> tuple[LaneModel, dict[str, object]]:
    """Read an Argoverse 2 vector map as a lane model in the site frame.

    The name of the file says the city and so where on earth it lies; without one, the map's own x
    and y are taken as east and north of the anchor. ``ways`` of roads are ids of lane segments.

    Returns:
        The model, and notes: counts, what was assumed and what was left out.

    Raises:
        InputError: not such a map, or one that lacks what it must have, or far from the anchor.
        StageError: the segments make no roads.
    """
    translation = translate(path, frame)
    return translation.model, translation.notes


def drivable_area(path: Path, frame: SiteFrame) -> shapely.Geometry:
    """Return where the map says that vehicles can drive, in plan, site frame; empty if nowhere.

    It holds what lanes do not: the width beside them where cars park, and the asphalt between
    carriageways that no median parts. A map that says no city is in its own x and y.

    Raises:
        InputError: not such a map, or one that lacks what it must have.
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
    """Do what ``read_argoverse`` does, and say where each lane segment is in the model."""
    read = read_file(path)
    found = translated(lanelets_of_map(read), frame)
    found.notes["speeds"] = "none in the map: 50 km/h, bicycle lanes 25 km/h"
    beyond = {i for s in read.segments.values() for i in s.successors} - set(read.segments)
    if beyond:
        found.notes["successors_beyond_the_map"] = len(beyond)
    return found


def lanelets_of_map(read: MapFile) -> Document:
    """Return an Argoverse 2 map as the lanelets that it holds.

    Segments and crossings keep their ids unless they share one. ``intersection`` says whether the
    map has a segment within an intersection. Those whose boundaries are a single place are dropped.
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
    """Return an error that names an element and where it lies in the city, metres."""
    place = f"{element} at x = {line[0, 0]:.1f}, y = {line[0, 1]:.1f}"
    return InputError(error.problem, file=error.file, place=place, expected=error.expected)


def _lanelet(ways: list[int], tags: dict[str, str]) -> Relation:
    members = (("way", ways[0], "left"), ("way", ways[1], "right"))
    return Relation(members, {"type": "lanelet", "location": "urban", **tags})


class _Drawn:
    """Points and lines of a map, each once."""

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
        """Merge the ends of successive segments that rounding has moved apart."""
        segments = self.read.segments
        for one in segments.values():
            for two in (segments[i] for i in one.successors if i in segments):
                for a, b in ((one.left[-1], two.left[0]), (one.right[-1], two.right[0])):
                    if np.linalg.norm(a[:2] - b[:2]) <= SAME_M:
                        key = round(float(b[0]), 3), round(float(b[1]), 3)
                        self._numbers.setdefault(key, self._number(a))

    def way(self, line: NDArray[np.float64], mark: str) -> int:
        """Return the way through points, drawn either way round; the first mapped paint is kept.

        Raises:
            InputError: all points are one.
        """
        ids = [self._number(point) for point in line]
        ids = [n for k, n in enumerate(ids) if k == 0 or n != ids[k - 1]]
        if len(set(ids)) < 2:
            raise InputError("has a boundary without length", file=self.read.path)
        way = self._ways.get(tuple(ids))
        turned = way is None and tuple(ids[::-1]) in self._ways
        if turned:
            way = self._ways[tuple(ids[::-1])]
        elif way is None:
            way = self._ways[tuple(ids)] = len(self._ways) + 1
            self.ways[way] = Way(tuple(ids), _paint(mark, turned=False))
        if self.ways[way].tags["type"] == "virtual":
            self.ways[way] = Way(self.ways[way].nodes, _paint(mark, turned=turned))
        return way

    def nodes(self) -> dict[int, Node]:
        """Return all places: in degrees if the map's city is known, else the map's own."""
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
