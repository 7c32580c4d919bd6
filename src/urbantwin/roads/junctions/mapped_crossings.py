"""Pedestrian crossings in the map, with their markings.

A crossing is mapped as a node of the street (``highway=crossing``), as the footway across it
(``footway=crossing``), or as both (OSM wiki, "Key:crossing", "Tag:footway=crossing",
"Key:crossing:markings").
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import SiteFrame
from urbantwin.roads.cross_section.lane_tags import metres
from urbantwin.roads.sidewalk import WALKED
from urbantwin.site.extract import Extract, Way, WayPiece

__all__ = [
    "WALKED",
    "MappedCrossing",
    "Marks",
    "is_crossing_node",
    "is_crossing_way",
    "mapped_crossings",
    "mapped_marks",
]

#: Two crossings of one carriageway are duplicates within these distances: total, and across the
#: street, metres.
ONE_M = 4.5
BESIDE_M = 1.5
#: Default widths, metres: marked (RiLSA 2015, 4.4; US MUTCD 3B.18: at least 1.8 m; UK TSRGD,
#: schedule 14: 2.4 m and more), and unmarked.
MARKED_M, UNMARKED_M = 4.0, 2.5
#: Distance to both sides over which a way's heading is measured, metres.
AROUND_M = 2.0
#: A footway at a smaller angle to the street does not lead across it, radians.
ACROSS = np.radians(30.0)
#: Default marking of signalised crossings by country. Studs: UK TSRGD; two lines: US MUTCD 3B.18,
#: AS 1742.10; broken lines: RMS (Germany), RVS (Austria). Elsewhere stripes.
AT_SIGNALS = {
    **dict.fromkeys(("GB", "IE"), "dots"),
    **dict.fromkeys(("US", "CA", "AU", "NZ"), "lines"),
    **dict.fromkeys(("DE", "AT"), "dashes"),
}
#: Values of ``crossing_ref`` and ``crossing`` for signalised and for striped crossings.
SIGNALISED = frozenset("traffic_signals pelican puffin toucan pegasus".split())
STRIPED = frozenset("zebra tiger marked uncontrolled ladder".split())


@dataclass(frozen=True, eq=False)
class MappedCrossing:
    """A crossing of one carriageway.

    Attributes:
        name: unique name for a node there.
        xy: (2,) on the middle of the street, site frame.
        ahead: (2,) unit vector along the street.
        across: (2,) unit vector along the crossing.
        pieces: ids of the pieces of streets that it lies on.
        marking: ``zebra``, ``lines``, ``dashes``, ``dots`` or ``none``.
        signalised: whether it has pedestrian signals.
        width: metres.
        on_every_arm: whether it is mapped on a signalised junction of a single node; pedestrians
            then cross each arm, not the centre.
    """

    name: str
    xy: NDArray[np.float64]
    ahead: NDArray[np.float64]
    across: NDArray[np.float64]
    pieces: frozenset[int]
    marking: str
    signalised: bool
    width: float
    on_every_arm: bool = False

    @property
    def has_priority(self) -> bool:
        """Return whether pedestrians have priority without signals."""
        return self.marking == "zebra" and not self.signalised


@dataclass(frozen=True)
class _CrossingPlace:
    """A place where something crosses a street, with the pieces of the street."""

    pieces: tuple[WayPiece, ...]
    xy: NDArray[np.float64]
    name: str


@dataclass(frozen=True)
class Marks:
    """Marks across edges: edge id -> shares of the edge's length from its start, ascending."""

    stop_lines: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    crossings: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


def mapped_crossings(
    extract: Extract, frame: SiteFrame, pieces: Sequence[WayPiece], *, country: str = ""
) -> tuple[MappedCrossing, ...]:
    """Return the mapped crossings of streets.

    Args:
        extract: the map.
        frame: the site frame.
        pieces: the streets, cut to the region.
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    at_node: dict[int, list[WayPiece]] = defaultdict(list)
    position: dict[int, NDArray[np.float64]] = {}
    for piece in pieces:
        if not piece.way:
            continue
        for node, xy in zip(piece.nodes, piece.points, strict=True):
            at_node[node].append(piece)
            position[node] = xy
    footways: dict[int, list[Way]] = defaultdict(list)
    crossing_ways = []
    for osm_way in extract.highways():
        if osm_way.tags["highway"] not in WALKED:
            continue
        for node in at_node.keys() & osm_way.nodes:
            footways[node].append(osm_way)
        if is_crossing_way(osm_way):
            crossing_ways.append(osm_way)
    crossings: list[MappedCrossing] = []
    for node in sorted(at_node):
        tags = extract.node_tags.get(node, {})
        own_ways = [osm_way for osm_way in footways[node] if is_crossing_way(osm_way)]
        if not is_crossing_node(tags) and not (own_ways and tags.get("crossing") != "no"):
            continue
        merged_tags = {
            **tags,
            **{k: v for osm_way in own_ways for k, v in osm_way.tags.items()},
            **_crossing_tags(tags),
        }
        place = _CrossingPlace(tuple(at_node[node]), position[node], str(node))
        lines = [extract.way_line(osm_way, frame) for osm_way in (own_ways or footways[node])]
        on_every_arm = (
            not lines
            and tags.get("highway") == "traffic_signals"
            and _streets_meet(place.pieces, node)
        )
        crossings.append(
            replace(_crossing(place, merged_tags, lines, country), on_every_arm=on_every_arm)
        )
    street_nodes = at_node.keys()
    for osm_way in crossing_ways:
        for number, place in enumerate(_overlaid(extract, frame, osm_way, street_nodes, pieces)):
            named_place = _CrossingPlace(place.pieces, place.xy, f"{osm_way.id}_{number}")
            line = extract.way_line(osm_way, frame)
            crossings.append(_crossing(named_place, osm_way.tags, [line], country))
    return tuple(_without_duplicates(crossings))


def is_crossing_node(tags: Mapping[str, str]) -> bool:
    """Return whether a node of a street is a crossing."""
    if tags.get("crossing") == "no" or "railway" in tags:
        return False
    return tags.get("highway") == "crossing" or (
        tags.get("highway") == "traffic_signals" and "crossing" in tags
    )


def is_crossing_way(way: Way) -> bool:
    """Return whether a pedestrian way is a crossing."""
    tags = way.tags
    if tags.get("crossing") == "no" or tags.get("tunnel", "no") != "no" or "bridge" in tags:
        return False
    kinds = {tags.get(key) for key in ("footway", "path", "cycleway")}
    return tags.get("highway") in WALKED and ("crossing" in kinds or "crossing" in tags)


def _streets_meet(pieces: Sequence[WayPiece], node: int) -> bool:
    """Return whether streets meet at a node."""
    seen = {piece.id: piece for piece in pieces}.values()
    return sum(2 - (node in (piece.nodes[0], piece.nodes[-1])) for piece in seen) > 2


def _crossing_tags(tags: Mapping[str, str]) -> dict[str, str]:
    """Return a node's tags on its crossing, which take precedence over the way's."""
    return {k: v for k, v in tags.items() if k.startswith("crossing") or k == "highway"}


def _crossing(
    place: _CrossingPlace,
    tags: Mapping[str, str],
    lines: Sequence[NDArray[np.float64]],
    country: str,
) -> MappedCrossing:
    signalised = (
        tags.get("highway") == "traffic_signals"
        or tags.get("crossing") in SIGNALISED
        or tags.get("crossing_ref") in SIGNALISED
        or tags.get("crossing:signals") == "yes"
    )
    marking = _marking(tags, country, signalised=signalised)
    headings = [_heading(piece.points, place.xy) for piece in place.pieces]
    walks = [_heading(line, place.xy) for line in lines if len(line) > 1]
    # Where streets meet, the crossed street is the one most perpendicular to the footway.
    square = [max([abs(_cross(walk, ahead)) for walk in walks], default=0.0) for ahead in headings]
    ahead = headings[int(np.argmax(np.round(square, 6)))]
    across = max(walks, key=lambda walk: abs(_cross(walk, ahead)), default=ahead)
    if abs(_cross(across, ahead)) < np.sin(ACROSS):
        across = np.array([-ahead[1], ahead[0]])
    width = UNMARKED_M if marking == "none" else MARKED_M
    is_way = "crossing" in {tags.get(key) for key in ("footway", "path", "cycleway")}
    mapped = metres(tags.get("crossing:width", tags.get("width") if is_way else None))
    if mapped is not None:
        width = min(max(mapped, 1.5), 12.0)
    pieces = frozenset(
        piece.id
        for piece, heading in zip(place.pieces, headings, strict=True)
        if abs(float(heading @ ahead)) > np.cos(ACROSS)
    )
    return MappedCrossing(place.name, place.xy, ahead, across, pieces, marking, signalised, width)


def _marking(tags: Mapping[str, str], country: str, *, signalised: bool) -> str:
    marking = tags.get("crossing:markings", "").split(":")[0].split(";")[0]
    if marking == "no" or tags.get("crossing") == "unmarked":
        return "none"
    if marking in ("lines", "dashes", "dots"):
        return marking
    if marking in ("zebra", "ladder"):
        return "zebra"
    if signalised:
        return AT_SIGNALS.get(country, "zebra")
    if marking or {tags.get("crossing"), tags.get("crossing_ref")} & STRIPED:
        return "zebra"
    return "none"


def _heading(line: NDArray[np.float64], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit vector (2,) along a line near a point on it."""
    street_line = shapely.LineString(line)
    station_m = street_line.project(shapely.Point(xy))
    ends = [np.clip(station_m + d, 0.0, street_line.length) for d in (-AROUND_M, AROUND_M)]
    a, b = (shapely.get_coordinates(street_line.interpolate(float(d)))[0] for d in ends)
    return np.asarray((b - a) / max(float(np.linalg.norm(b - a)), 1e-9))


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _overlaid(
    extract: Extract,
    frame: SiteFrame,
    way: Way,
    known: Collection[int],
    pieces: Sequence[WayPiece],
) -> Iterator[_CrossingPlace]:
    """Yield the places where a crossing way intersects streets without a common node."""
    points = extract.way_line(way, frame)
    if len(points) < 2:
        return
    line = shapely.LineString(points)
    for piece in pieces:
        if set(piece.nodes) & set(way.nodes) or not piece.way:
            continue
        if way.tags.get("layer", "0") != piece.tags.get("layer", "0"):
            continue
        street = shapely.LineString(piece.points)
        for point in shapely.get_parts(shapely.intersection(line, street)):
            if point.geom_type == "Point":
                yield _CrossingPlace((piece,), shapely.get_coordinates(point)[0], "")


def _without_duplicates(found: Sequence[MappedCrossing]) -> list[MappedCrossing]:
    """Return crossings without duplicates on one carriageway.

    Adjacent crossings for pedestrians and bicycles become one with their total width.
    """
    distinct: list[MappedCrossing] = []
    order = {crossing.name: k for k, crossing in enumerate(found)}
    # Crossings with signals or markings take precedence.
    for crossing in sorted(found, key=lambda c: (not c.signalised, c.marking == "none")):
        for k, other in enumerate(distinct):
            if _is_same(crossing, other):
                gap = float((crossing.xy - other.xy) @ other.ahead)
                middle = other.xy + gap / 2 * other.ahead
                distinct[k] = replace(other, xy=middle, width=other.width + abs(gap))
                break
        else:
            distinct.append(crossing)
    return sorted(distinct, key=lambda c: order[c.name])


def _is_same(crossing: MappedCrossing, other: MappedCrossing) -> bool:
    gap = crossing.xy - other.xy
    return bool(
        np.linalg.norm(gap) < ONE_M
        and abs(_cross(gap, crossing.ahead)) < BESIDE_M
        and abs(float(crossing.ahead @ other.ahead)) > np.cos(ACROSS)
    )


def mapped_marks(extract: Extract, pieces: Sequence[WayPiece], meeting: Collection[int]) -> Marks:
    """Return stop lines and crossings of the map along the edges of pieces.

    Args:
        extract: the map.
        pieces: segments of ways; each becomes the edge of its id, and the one of minus its id.
        meeting: nodes where streets meet, where signals do not imply stop lines.
    """
    # A footway that only touches a street does not cross it.
    crossed = {
        node for osm_way in extract.highways() if is_crossing_way(osm_way) for node in osm_way.nodes
    }
    lines: dict[str, list[float]] = defaultdict(list)
    crossings: dict[str, list[float]] = defaultdict(list)
    for piece in pieces:
        if len(piece.nodes) < 2:
            continue
        steps = np.linalg.norm(np.diff(piece.points, axis=0), axis=1)
        share = np.concatenate([[0.0], np.cumsum(steps)]) / max(float(steps.sum()), 1e-9)
        for node, position in zip(piece.nodes, share.tolist(), strict=True):
            if node in meeting:
                continue
            tags = extract.node_tags.get(node, {})
            if is_crossing_node(tags) or (node in crossed and tags.get("crossing") != "no"):
                crossings[str(piece.id)].append(position)
                crossings[f"-{piece.id}"].append(1.0 - position)
            if tags.get("highway") == "traffic_signals":
                direction = tags.get("traffic_signals:direction", "")
                if direction != "backward":
                    lines[str(piece.id)].append(position)
                if direction != "forward":
                    lines[f"-{piece.id}"].append(1.0 - position)
    return Marks(_sorted(lines), _sorted(crossings))


def _sorted(found: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    return {edge: tuple(sorted(set(shares))) for edge, shares in found.items()}
