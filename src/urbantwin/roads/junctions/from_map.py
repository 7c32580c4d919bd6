"""Junctions, crossings and footways as the map has them, in the network that netconvert makes."""

from __future__ import annotations

from collections.abc import Sequence

import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.roads.cross_section import PreparedWays
from urbantwin.roads.junctions.cluster import meeting_nodes
from urbantwin.roads.junctions.consolidate import consolidated
from urbantwin.roads.junctions.crossings import with_crossings
from urbantwin.roads.junctions.footways import with_footways
from urbantwin.roads.junctions.mapped_crossings import mapped_crossings
from urbantwin.roads.junctions.mapped_footways import mapped_footways
from urbantwin.roads.junctions.mapped_marks import mapped_marks
from urbantwin.roads.junctions.plain import PlainNetwork, points_of_text
from urbantwin.roads.junctions.restriction import via_way_restrictions
from urbantwin.roads.junctions.ring import RINGS, Ring, circulating, is_mini_roundabout
from urbantwin.site.extract import Extract
from urbantwin.site.sketch import FOLLOWED

__all__ = ["with_junctions_of_map"]


def with_junctions_of_map(  # noqa: PLR0913 - all that junctions are made of
    plain: PlainNetwork,
    *,
    extract: Extract,
    frame: SiteFrame,
    region: shapely.Polygon,
    prepared: PreparedWays,
    apart: Sequence[int],
    rings: Sequence[Ring],
    buildings: Sequence[shapely.Polygon],
    standing: Sequence[shapely.Geometry],
    country: str,
    driving_side: str,
) -> PlainNetwork:
    """Return a network whose junctions are one node each, with the map's crossings and footways.

    Args:
        plain: what netconvert read of the map.
        extract: the map.
        frame: the site frame.
        region: what is built, site frame.
        prepared: the segments that its ways were cut into.
        apart: segments that lie in no junction: bridges, outer roads.
        rings: small roundabouts, site frame.
        buildings: where buildings stand on the ground, site frame.
        standing: outlines of posts and islands, site frame.
        country: ISO 3166-1 alpha-2; empty if unknown.
        driving_side: ``right`` or ``left``.
    """
    pieces = prepared.pieces
    small = set[str]().union(*(ring.edges for ring in rings))
    wide = [
        piece.id
        for piece in pieces
        if piece.tags.get("junction") in RINGS and str(piece.id) not in small
    ]
    inside = [piece.id for piece in pieces if piece.tags.get("junction") == "yes"]
    within = {f"{sign}{piece}" for piece in inside for sign in ("", "-")}
    lines = {
        number: points_of_text(way.tags[FOLLOWED])
        for number, way in extract.ways.items()
        if FOLLOWED in way.tags
    }
    followed = {str(piece.id): lines[piece.way] for piece in pieces if piece.way in lines}
    minis = {str(node) for node, tags in extract.node_tags.items() if is_mini_roundabout(tags)}
    plain = consolidated(
        circulating(plain, rings, minis),
        mapped_marks(extract, pieces, {int(node) for node in meeting_nodes(plain, within)}),
        prepared.arrows,
        apart={f"{sign}{piece}" for piece in [*apart, *wide] for sign in ("", "-")},
        within=within,
        followed=followed,
        rings=rings,
        forbidden=via_way_restrictions(extract, pieces),
        buildings=buildings,
        standing=standing,
        driving_side=driving_side,
    )
    crossed = mapped_crossings(extract, frame, pieces, country=country)
    plain = with_crossings(plain, crossed, driving_side=driving_side)
    streets = {node for piece in pieces for node in piece.nodes}
    footways = mapped_footways(extract, frame, region, streets)
    return with_footways(plain, footways, driving_side=driving_side)
