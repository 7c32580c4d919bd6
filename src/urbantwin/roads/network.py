"""The lane network: the lane model as polylines, for the mesh, the traffic and the images."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from urbantwin.artefact import write_json
from urbantwin.artefact.typed_document import Numbers, Pairs, Triples, read_typed
from urbantwin.errors import InputError
from urbantwin.geometry import (
    area_difference,
    area_intersection,
    area_union,
    closed,
    opened,
    stations_of_points,
)

__all__ = [
    "BusStop",
    "Junction",
    "Lane",
    "Road",
    "RoadNetwork",
    "SignalHead",
    "SignalProgram",
    "Track",
]

#: Kinds of lanes for moving or parked vehicles, at the height of the carriageway.
CARRIAGEWAY_KINDS = ("driving", "bus", "bicycle", "parking", "shoulder")
#: Kinds of lanes for pedestrians, raised behind a curb.
FOOTWAY_KINDS = ("sidewalk", "walkingarea", "curb")
#: Half-width of necks; areas behind narrower ones are not driven on, metres.
NECK_M = 0.5
#: Slits between lanes below the first width are closed, metres. Protrusions below the second width
#: are cut off, metres. Footways below the third area are dropped, square metres.
SEAM_M, FIN_M, SPECK_M2 = 0.6, 0.4, 0.5
#: Tolerance for parts at the end of a crossing, metres.
END_M = 0.05
#: Maximum width of a lane, metres, and maximum level of a road.
_WIDEST_M, _MAX_LEVEL = 1000.0, 100


@dataclass(frozen=True)
class Lane:
    """A lane with its centre line and width.

    Attributes:
        id: as in the SUMO network.
        road: id of its road; empty inside junctions.
        kind: driving, bus, bicycle, sidewalk, parking, shoulder, median, island, curb; inside
            junctions also connection (a turn), crossing, walkingarea.
        width: metres.
        speed_limit: m/s.
        centre: (N, 3) points from start to end, site frame, metres.
        outline: (M, 2) outline of a walking area, else empty.
        level: 0 on the ground, 1, 2, ... on bridges that cross over other roads.
        allowed: classes of actors that may use it.
        successors: ids of the following lanes, through a junction's connection.
        junction: id of its junction; empty outside junctions.
        arrows: signed turns at its end (OSM wiki, "Key:turn"); ``None`` if no lane beside it has
            any.
        widths: (N,) width at each point of the centre if it varies, else empty, metres.
        marking: marking of a crossing: ``zebra``, ``lines``, ``dashes``, ``dots`` or ``none``;
            empty if unknown.
        parking: orientation of vehicles on a parking lane: ``parallel``, ``diagonal`` or
            ``perpendicular``; empty if unknown.
        opposite: on a street with one lane for both directions, id of the opposite direction's lane
            in the same place; else empty.
    """

    id: str
    road: str
    kind: str
    width: float
    speed_limit: float
    centre: Triples
    outline: Pairs
    level: int
    allowed: tuple[str, ...]
    successors: tuple[str, ...]
    junction: str
    widths: Numbers = field(default_factory=lambda: np.zeros(0))
    arrows: tuple[str, ...] | None = None
    marking: str = ""
    parking: str = ""
    opposite: str = ""

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """The lane's area in plan."""
        if len(self.outline) >= 3:
            # netconvert's walking areas may self-intersect; collapsed parts have no area.
            area = shapely.Polygon(self.outline)
            return shapely.make_valid(area, method="structure", keep_collapsed=False)
        if len(self.widths):
            return _tapered(self.centre[:, :2], self.widths)
        line = shapely.LineString(self.centre[:, :2])
        return line.buffer(self.width / 2, cap_style="flat", join_style="mitre", mitre_limit=2)

    @property
    def length(self) -> float:
        """Length along the centre in plan, metres."""
        return float(np.linalg.norm(np.diff(self.centre[:, :2], axis=0), axis=1).sum())


@dataclass(frozen=True)
class Road:
    """One direction of a street between two junctions; ``lanes`` from the kerb inwards."""

    id: str
    name: str
    ways: tuple[int, ...]
    kind: str
    lanes: tuple[str, ...]
    from_junction: str
    to_junction: str


@dataclass(frozen=True)
class Junction:
    """A junction. ``outline`` (M, 2) includes walking areas and crossings."""

    id: str
    kind: str
    outline: Pairs
    level: int

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """The junction's area in plan."""
        if len(self.outline) < 3:
            return shapely.Polygon()
        return shapely.make_valid(shapely.Polygon(self.outline))


@dataclass(frozen=True)
class SignalHead:
    """The signal of one approach lane or crossing: its stop line and its links.

    Attributes:
        program: id of the signal program.
        links: indices into the program's state strings.
        lane: id of the lane that it applies to.
        x, y: centre of the stop line (or of the crossing's start), site frame, metres.
        yaw: heading of the traffic that it applies to, radians.
    """

    program: str
    links: tuple[int, ...]
    lane: str
    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class SignalProgram:
    """A fixed-time program: phases of (seconds, state), one character of state per link."""

    id: str
    offset: float
    phases: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class BusStop:
    """A stop of buses or trams on ``lane``, from ``start_m`` to ``end_m`` along it, with a name."""

    lane: str
    name: str
    start_m: float
    end_m: float


@dataclass(frozen=True)
class Track:
    """A tram track in one direction between two switches.

    Attributes:
        id: id of its edge in the SUMO network.
        line: (N, 3) points from start to end, site frame, at about the ground's height.
        speed: maximum speed, m/s.
        level: 0 on the ground, 1, 2, ... on bridges.
        successors: ids of the following tracks.
        outer: whether it lies beyond the region and leads an exit back to an entry.
    """

    id: str
    line: Triples
    speed: float
    level: int
    successors: tuple[str, ...]
    outer: bool


@dataclass(frozen=True)
class RoadNetwork:
    """All lanes of a site.

    Attributes:
        driving_side: ``right`` or ``left``.
        roads: its roads, one for each direction of a street.
        lanes: lanes of the roads and inside junctions.
        junctions: the junctions.
        signals: signals of approach lanes and crossings.
        programs: the signals' programs.
        bus_roads: ids of the roads of mapped bus lines.
        stops: bus stops.
        tracks: tram tracks.
        tram_stops: tram stops, on the lanes of tracks.
    """

    driving_side: str
    roads: tuple[Road, ...]
    lanes: tuple[Lane, ...]
    junctions: tuple[Junction, ...]
    signals: tuple[SignalHead, ...]
    programs: tuple[SignalProgram, ...]
    bus_roads: tuple[str, ...] = ()
    stops: tuple[BusStop, ...] = ()
    tracks: tuple[Track, ...] = ()
    tram_stops: tuple[BusStop, ...] = ()

    @cached_property
    def lane_by_id(self) -> dict[str, Lane]:
        """Lanes by id."""
        return {lane.id: lane for lane in self.lanes}

    @cached_property
    def lanes_into(self) -> dict[str, tuple[str, ...]]:
        """Lane id -> ids of the lanes that lead to it."""
        feeders: dict[str, list[str]] = {}
        for lane in self.lanes:
            for name in lane.successors:
                feeders.setdefault(name, []).append(lane.id)
        return {name: tuple(before) for name, before in feeders.items()}

    def lanes_beyond(self, lane: Lane) -> Iterator[Lane]:
        """Yield the first lanes of roads beyond the junction that a lane leads to."""
        waiting, seen = list(lane.successors), set[str]()
        while waiting:
            name = waiting.pop()
            after = self.lane_by_id.get(name)
            if after is None or name in seen:
                continue
            seen.add(name)
            if after.road:
                yield after
            else:
                waiting += after.successors

    @cached_property
    def stopped_lanes(self) -> frozenset[str]:
        """Ids of the lanes with signals."""
        return frozenset(head.lane for head in self.signals)

    def height(self, lane_id: str, xy: ArrayLike) -> NDArray[np.float64]:
        """Return the height (N,) of a lane's centre line nearest to points (N, 2), metres.

        Raises:
            KeyError: there is no such lane.
        """
        lane = self.lane_by_id[lane_id]
        points = shapely.points(np.asarray(xy, np.float64).reshape(-1, 2))
        line = shapely.LineString(lane.centre[:, :2])
        along = stations_of_points(lane.centre[:, :2])
        return np.asarray(
            np.interp(shapely.line_locate_point(line, points), along, lane.centre[:, 2])
        )

    @cached_property
    def _areas(self) -> dict[tuple[object, int], shapely.Geometry]:
        """Cache of `area_of`, `footway` and `carriageway`, which are slow for a district."""
        return {}

    def area_of(self, kinds: Iterable[str], level: int) -> shapely.Geometry:
        """Return the union in plan of all lanes of some kinds on a level."""
        wanted = frozenset(kinds)
        if (wanted, level) not in self._areas:
            lanes = [
                lane.polygon for lane in self.lanes if lane.kind in wanted and lane.level == level
            ]
            self._areas[wanted, level] = area_union(lanes)
        return self._areas[wanted, level]

    def footway(self, level: int) -> shapely.Geometry:
        """Return sidewalks, walking areas and crossing ends in plan, without the carriageway."""
        if ("footway", level) not in self._areas:
            driven = self.carriageway(level)
            walked = closed(self.area_of((*FOOTWAY_KINDS, "crossing"), level), SEAM_M)
            # A slit between both is closed; one between carriageways is not.
            slits = area_difference(closed(area_union([walked, driven]), 2 * SEAM_M), driven)
            slits = area_difference(slits, closed(driven, 2 * SEAM_M))
            beside = opened(area_difference(area_union([walked, slits]), driven), FIN_M)
            parts = [part for part in shapely.get_parts(beside) if part.area > SPECK_M2]
            self._areas["footway", level] = area_union(parts)
        return self._areas["footway", level]

    def carriageway(self, level: int) -> shapely.Geometry:
        """Return the carriageway in plan: lanes, junctions and crossings between kerbs.

        A junction's outline includes the walking areas at its corners, and islands. They are
        excluded unless a lane or a turn runs there, as is the area behind them. Slits are closed;
        protrusions and parts without lanes are removed.
        """
        if ("carriageway", level) in self._areas:
            return self._areas["carriageway", level]
        junctions = area_union([j.polygon for j in self.junctions if j.level == level])
        core = area_difference(junctions, self.area_of((*FOOTWAY_KINDS, "island"), level))
        driven = self.area_of((*CARRIAGEWAY_KINDS, "connection"), level)
        crossings = [lane for lane in self.lanes if lane.kind == "crossing" and lane.level == level]
        core = _reached(core, area_union([driven, *(lane.polygon for lane in crossings)]))
        area = closed(area_union([core, driven]), SEAM_M)
        within = [part for lane in crossings for part in _between_kerbs(lane, area)]
        area = opened(area_union([area, *within]), FIN_M)
        lines = shapely.MultiLineString(
            [
                x.centre[:, :2]
                for x in self.lanes
                if x.level == level and x.kind in (*CARRIAGEWAY_KINDS, "connection", "crossing")
            ]
        )
        shapely.prepare(lines)
        parts = shapely.get_parts(area)
        area = area_union(parts[shapely.intersects(parts, lines)])
        self._areas["carriageway", level] = area
        return area

    @property
    def levels(self) -> tuple[int, ...]:
        """Levels in use, from the ground up."""
        return tuple(sorted({0, *(lane.level for lane in self.lanes)}))

    def save(self, path: Path) -> None:
        """Write the network as JSON (metres to 0.1 mm)."""
        value = asdict(self)
        for lane in value["lanes"]:
            lane["centre"] = np.round(lane["centre"], 4).tolist()
            lane["outline"] = np.round(lane["outline"], 4).tolist()
            lane["widths"] = np.round(lane["widths"], 4).tolist()
        for junction in value["junctions"]:
            junction["outline"] = np.round(junction["outline"], 4).tolist()
        for track in value["tracks"]:
            track["line"] = track["line"].tolist()
        write_json(path, {"kind": "roads", **value})

    @classmethod
    def load(cls, path: Path) -> RoadNetwork:
        """Read a file that ``save`` wrote.

        Raises:
            InputError: the file is missing or is not a lane network; the message names the field.
        """
        network = read_typed(path, cls, "a twin's roads.json")
        network._check(path)
        return network

    def _check(self, file: Path) -> None:
        """Check references and lanes.

        Raises:
            InputError: an id is repeated or refers to nothing, or a lane is not valid.
        """
        if self.driving_side not in ("right", "left"):
            raise InputError(
                "is not a side of the road",
                file=file,
                place="driving_side",
                expected="right or left",
            )
        lane_of = self.lane_by_id
        if len(lane_of) < len(self.lanes):
            raise InputError("has a lane twice", file=file, place="lanes")
        for number, lane in enumerate(self.lanes):
            place = f"lanes[{number}]"
            if len(lane.centre) < 2 or len(lane.widths) not in (0, len(lane.centre)):
                raise InputError(
                    "is not a lane", file=file, place=place, expected="a line with its widths"
                )
            if not 0 <= lane.width <= _WIDEST_M or not 0 <= lane.level <= _MAX_LEVEL:
                raise InputError(
                    "is not a lane", file=file, place=place, expected="a width, a level"
                )
        tracks = {track.id for track in self.tracks}
        rails = {f"{name}_0" for name in tracks}
        for number, track in enumerate(self.tracks):
            if len(track.line) < 2 or not set(track.successors) <= tracks:
                raise InputError("is not a track", file=file, place=f"tracks[{number}]")
        if not {stop.lane for stop in self.tram_stops} <= rails:
            raise InputError("names a track that is not there", file=file, place="tram_stops")
        references = [(f"roads[{k}].lanes", road.lanes) for k, road in enumerate(self.roads)]
        references += [(f"stops[{k}].lane", (stop.lane,)) for k, stop in enumerate(self.stops)]
        for place, names in references:
            if not set(names) <= lane_of.keys():
                raise InputError("names a lane that is not there", file=file, place=place)


def _reached(area: shapely.Geometry, driven: shapely.Geometry) -> shapely.Geometry:
    """Return the parts of an area that traffic reaches through more than a narrow neck."""
    parts = shapely.get_parts(area.buffer(-NECK_M))
    wide_parts = [part for part in parts if part.intersection(driven).area > NECK_M]
    return area_intersection(area, area_union(wide_parts).buffer(2 * NECK_M))


def _between_kerbs(lane: Lane, driven: shapely.Geometry) -> list[shapely.Geometry]:
    """Return the parts of a crossing between parts of the carriageway, not beyond its kerbs.

    A crossing has square ends: if it crosses the street at an angle, their corners lie on the
    footway.
    """
    line, half = lane.centre[:, :2], lane.width / 2
    ends = []
    for end, inner in ((line[0], line[1]), (line[-1], line[-2])):
        ahead = (inner - end) / max(float(np.linalg.norm(inner - end)), 1e-9)
        across = half * np.array([-ahead[1], ahead[0]])
        ends.append(shapely.LineString([end - across, end + across]))
    parts = shapely.get_parts(area_difference(lane.polygon, driven))
    beyond = [shapely.dwithin(parts, end, END_M) for end in ends]
    # Parts that reach from end to end have no kerb.
    return list(parts[beyond[0] == beyond[1]])


def _tapered(centre: NDArray[np.float64], widths: NDArray[np.float64]) -> shapely.Geometry:
    """Return the area of a strip with a varying width."""
    leg = np.diff(centre, axis=0)
    normal = np.column_stack([-leg[:, 1], leg[:, 0]])
    normal /= np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-9)
    corner = np.vstack([normal[:1], normal[:-1] + normal[1:], normal[-1:]])
    corner *= 2.0 / np.maximum((corner * corner).sum(axis=1, keepdims=True), 0.5)
    corner[[0, -1]] = normal[[0, -1]]
    side = corner * widths[:, None] / 2
    outline = shapely.Polygon(np.vstack([centre + side, (centre - side)[::-1]]))
    return shapely.make_valid(outline, method="structure", keep_collapsed=False)
