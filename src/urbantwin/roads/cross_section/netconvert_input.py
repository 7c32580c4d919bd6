"""Input of netconvert: the map's ways, split and tagged so that it builds their cross sections."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.cross_section.beside_stops import with_footways_at_stops
from urbantwin.roads.cross_section.between_walls import between_walls
from urbantwin.roads.cross_section.from_tags import cross_section
from urbantwin.roads.cross_section.layout import middles_of
from urbantwin.roads.cross_section.section import CrossSection
from urbantwin.roads.cross_section.segment import segments_of
from urbantwin.roads.cross_section.signed_turns import SignedTurns, signed_turns
from urbantwin.roads.cross_section.spacing import spaced
from urbantwin.roads.cross_section.sumo_edges import (
    SumoEdge,
    sumo_edges,
    sumo_tags,
)
from urbantwin.roads.cross_section.turn_lanes import fitting_turns
from urbantwin.roads.sidewalk import sidewalk_sides
from urbantwin.site.extract import WayPiece

__all__ = ["MappedSegment", "PreparedWays", "prepare_ways"]


@dataclass(frozen=True, eq=False)
class MappedSegment:
    """A part of a way of the map.

    Attributes:
        way: id of the way.
        points: (N, 2) its line, site frame.
        section: its cross section.
    """

    way: int
    points: NDArray[np.float64]
    section: CrossSection


@dataclass(frozen=True, eq=False)
class PreparedWays:
    """Ways as netconvert reads them.

    Attributes:
        pieces: segments between junctions, with normalised tags.
        edges: the attributes of edges that netconvert is given.
        segments: the same segments with their cross sections.
        parts: piece that was given -> the segments that it was cut into.
        arrows: the turns that are signed for lanes.
        one_lane: ids of the segments on which both directions share one lane.
    """

    pieces: tuple[WayPiece, ...]
    edges: tuple[SumoEdge, ...]
    segments: tuple[MappedSegment, ...]
    parts: Mapping[int, tuple[WayPiece, ...]]
    arrows: SignedTurns
    one_lane: frozenset[int] = frozenset()

    def turns(self, forbidden: Iterable[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
        """Return forbidden turns (from piece, over node, to piece) as ones between segments."""
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
    """Cut and tag ways so that netconvert builds their cross sections.

    Args:
        pieces: ways of the network with the map's tags, cut to the region.
        signals: nodes with traffic signals, where netconvert ends edges.
        driving_side: ``right`` or ``left``.
        country: ISO 3166-1 alpha-2; empty if unknown.
        buildings: where buildings stand on the ground: lanes of unmapped width yield to them.
        stops: (N, 2) where people wait for buses: there is a footway.
    """
    one_way = ("yes", "1", "true")
    others = [
        shapely.LineString(piece.points) for piece in pieces if piece.tags.get("oneway") in one_way
    ]
    section_of: dict[int, CrossSection] = {}
    for piece in pieces:
        sides = sidewalk_sides(piece.tags, piece.points, others, side=driving_side)
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
    """Give a street a name that every plot's font can write."""
    latin = old.get("name:en", old.get("int_name"))
    if latin and not _is_alphabetic(old.get("name", "")):
        piece.tags["name"] = latin
    return piece


def _is_alphabetic(name: str) -> bool:
    """Whether a name is in Latin, Greek or Cyrillic letters, which every plot's font has."""
    return all(ord(character) < 0x2000 for character in name)
