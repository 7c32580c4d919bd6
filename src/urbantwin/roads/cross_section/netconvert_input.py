"""Input of netconvert: OSM ways, split and tagged for the intended cross sections."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.cross_section.between_walls import between_walls
from urbantwin.roads.cross_section.defaults import standard_of
from urbantwin.roads.cross_section.from_tags import cross_section
from urbantwin.roads.cross_section.layout import middles_of
from urbantwin.roads.cross_section.section import CrossSection
from urbantwin.roads.cross_section.segment import Segment, segments_of
from urbantwin.roads.cross_section.spacing import spaced
from urbantwin.roads.cross_section.sumo_edges import (
    SumoEdge,
    sumo_edges,
    sumo_tags,
)
from urbantwin.roads.cross_section.turn_lanes import SignedTurns, fitting_turns, signed_turns
from urbantwin.roads.sidewalk import sidewalk_sides
from urbantwin.site.extract import WayPiece

__all__ = ["MappedSegment", "PreparedWays", "prepare_ways"]

#: Maximum distance of a stop's pole or platform from the outermost lane, metres.
BESIDE_M = 10.0


@dataclass(frozen=True, eq=False)
class MappedSegment:
    """A part of an OSM way.

    Attributes:
        way: id of the way.
        points: (N, 2) its line, site frame, metres.
        section: its cross section.
    """

    way: int
    points: NDArray[np.float64]
    section: CrossSection


@dataclass(frozen=True, eq=False)
class PreparedWays:
    """Ways prepared for netconvert.

    Attributes:
        pieces: segments between junctions, with normalised tags.
        edges: attributes of SUMO edges, as input of netconvert.
        segments: the same segments with their cross sections.
        parts: id of an original piece -> the segments that it was cut into.
        arrows: signed turns of lanes.
        one_lane: ids of the segments on which both directions share one lane.
    """

    pieces: tuple[WayPiece, ...]
    edges: tuple[SumoEdge, ...]
    segments: tuple[MappedSegment, ...]
    parts: Mapping[int, tuple[WayPiece, ...]]
    arrows: SignedTurns
    one_lane: frozenset[int] = frozenset()

    def turns(self, forbidden: Iterable[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
        """Return forbidden turns (from piece, over node, to piece) as turns between segments."""
        return [
            (start.id, via, end.id)
            for before, via, after in forbidden
            for start in self.parts.get(before, ())
            for end in self.parts.get(after, ())
            if via in start.nodes and via in end.nodes
        ]


def prepare_ways(
    pieces: Sequence[WayPiece],
    *,
    signals: Collection[int],
    driving_side: str,
    country: str = "",
    buildings: Sequence[shapely.Polygon] = (),
    stops: NDArray[np.float64] | None = None,
) -> PreparedWays:
    """Cut and tag ways for netconvert.

    Args:
        pieces: ways of the network with the map's tags, cut to the region.
        signals: nodes with traffic signals, where netconvert ends edges.
        driving_side: ``right`` or ``left``.
        country: ISO 3166-1 alpha-2; empty if unknown.
        buildings: footprints of buildings on the ground, which narrow lanes of unmapped width.
        stops: (N, 2) bus stops, which imply a sidewalk, site frame.
    """
    one_way = ("yes", "1", "true")
    oneway_lines = [
        shapely.LineString(piece.points) for piece in pieces if piece.tags.get("oneway") in one_way
    ]
    section_of: dict[int, CrossSection] = {}
    for piece in pieces:
        sides = sidewalk_sides(piece.tags, piece.points, oneway_lines, side=driving_side)
        section_of[piece.id] = cross_section(
            piece.tags, driving_side=driving_side, sidewalks=sides, country=country
        )
    segments = segments_of(pieces, signals)
    sections = between_walls(
        segments, [section_of[segment.origin] for segment in segments], buildings
    )
    if stops is not None:
        sections = with_footways_at_stops(segments, sections, stops, country)
    middles = spaced(segments, sections, middles_of(segments, sections))
    prepared: list[WayPiece] = []
    edges: list[SumoEdge] = []
    signed = fitting_turns(segments, sections)
    for segment, section, middle in zip(segments, signed, middles, strict=True):
        prepared.append(_named(sumo_tags(segment, section), segment.piece.tags))
        edges += sumo_edges(segment, section, middle)
    mapped = tuple(
        MappedSegment(piece.way, piece.points, section)
        for piece, section in zip(prepared, signed, strict=True)
    )
    parts: dict[int, tuple[WayPiece, ...]] = defaultdict(tuple)
    for segment, piece in zip(segments, prepared, strict=True):
        parts[segment.origin] += (piece,)
    arrows = signed_turns(segments, sections)
    one_lane = frozenset(
        piece.id for piece, section in zip(prepared, sections, strict=True) if section.one_lane
    )
    return PreparedWays(tuple(prepared), tuple(edges), mapped, parts, arrows, one_lane)


def _named(piece: WayPiece, old: Mapping[str, str]) -> WayPiece:
    """Replace a name that plot fonts cannot write by its English or international name."""
    latin = old.get("name:en", old.get("int_name"))
    if latin and not _is_alphabetic(old.get("name", "")):
        piece.tags["name"] = latin
    return piece


def _is_alphabetic(name: str) -> bool:
    """Return whether a name is in Latin, Greek or Cyrillic letters, which all plot fonts have."""
    return all(ord(character) < 0x2000 for character in name)


def with_footways_at_stops(
    segments: Sequence[Segment],
    sections: Sequence[CrossSection],
    stops: NDArray[np.float64],
    country: str,
) -> list[CrossSection]:
    """Return the cross sections with a sidewalk on the side of each bus stop.

    Args:
        segments: parts of ways.
        sections: their cross sections.
        stops: (N, 2) poles and platforms of bus stops, site frame.
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    result = list(sections)
    lines = shapely.STRtree([shapely.LineString(segment.piece.points) for segment in segments])
    width = standard_of(country).sidewalk
    for stop in stops:
        candidates = []
        for k in lines.query(shapely.Point(stop).buffer(4 * BESIDE_M)).tolist():
            side, distance_m = _side_of(segments[k], sections[k], lines.geometries[k], stop)
            if segments[k].piece.way and side and distance_m < BESIDE_M:
                candidates.append((distance_m, k, side))
        if not candidates:
            continue
        _, k, side = min(candidates)
        beside = getattr(result[k], side)
        if not beside.sidewalk:
            new = replace(beside, sidewalk=width, shoulder=0.0)
            result[k] = replace(result[k], **{side: new})
    return result


def _side_of(
    segment: Segment, section: CrossSection, line: shapely.LineString, stop: NDArray[np.float64]
) -> tuple[str, float]:
    """Return the side of a street (empty if no bus runs there) and the distance of a stop."""
    along = float(np.clip(line.project(shapely.Point(stop)), 0.5, max(line.length - 0.5, 0.5)))
    a, b = (shapely.get_coordinates(line.interpolate(along + d))[0] for d in (-0.5, 0.5))
    to_stop, ahead = stop - (a + b) / 2, (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
    left = float(ahead[0] * to_stop[1] - ahead[1] * to_stop[0])
    side = "left" if left > 0 else "right"
    forward = (side == "left") == (section.driving_side == "left")
    lanes = section.lanes(forward=forward)
    buses = any("bus" in lane.allowed for lane in lanes)
    both = bool(section.forward and section.backward)
    reach = sum(lane.width for lane in lanes) / (1 if both else 2)
    return side if buses else "", float(np.linalg.norm(to_stop)) - reach
