"""Junctions, crossings and footways of the map, added to netconvert's network."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import product

import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.roads.cross_section import PreparedWays
from urbantwin.roads.junctions.cluster import meeting_nodes
from urbantwin.roads.junctions.consolidate import consolidated
from urbantwin.roads.junctions.crossings import with_crossings
from urbantwin.roads.junctions.footways import mapped_footways, with_footways
from urbantwin.roads.junctions.mapped_crossings import mapped_crossings, mapped_marks
from urbantwin.roads.junctions.plain import PlainNetwork, points_of_text
from urbantwin.roads.junctions.ring import RINGS, Ring, circulating, is_mini_roundabout
from urbantwin.site.extract import Extract, WayPiece
from urbantwin.site.sketch import FOLLOWED

__all__ = ["with_junctions_of_map"]

#: Maximum number of segment sequences per restriction.
MOST = 64


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
    """Return a network with one node per junction, and with the map's crossings and footways.

    Args:
        plain: the map's network, as read by netconvert.
        extract: the map.
        frame: the site frame.
        region: the region to build, site frame.
        prepared: the segments of its ways.
        apart: segments that lie in no junction: bridges, outer roads.
        rings: small roundabouts, site frame.
        buildings: footprints of buildings on the ground, site frame.
        standing: outlines of posts and islands, site frame.
        country: ISO 3166-1 alpha-2; empty if unknown.
        driving_side: ``right`` or ``left``.
    """
    pieces = prepared.pieces
    small = set[str]().union(*(ring.edges for ring in rings))
    large_rings = [
        piece.id
        for piece in pieces
        if piece.tags.get("junction") in RINGS and str(piece.id) not in small
    ]
    inside = [piece.id for piece in pieces if piece.tags.get("junction") == "yes"]
    within = {f"{sign}{piece}" for piece in inside for sign in ("", "-")}
    lines = {
        number: points_of_text(osm_way.tags[FOLLOWED])
        for number, osm_way in extract.ways.items()
        if FOLLOWED in osm_way.tags
    }
    followed = {str(piece.id): lines[piece.way] for piece in pieces if piece.way in lines}
    minis = {str(node) for node, tags in extract.node_tags.items() if is_mini_roundabout(tags)}
    plain = consolidated(
        circulating(plain, rings, minis),
        mapped_marks(extract, pieces, {int(node) for node in meeting_nodes(plain, within)}),
        prepared.arrows,
        apart={f"{sign}{piece}" for piece in [*apart, *large_rings] for sign in ("", "-")},
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


def via_way_restrictions(
    extract: Extract, pieces: Sequence[WayPiece]
) -> list[tuple[tuple[str, ...], bool]]:
    """Return turn restrictions over three edges, and whether they are ``only_`` restrictions.

    Args:
        extract: the map.
        pieces: the segments of its ways.
    """
    of_way: dict[int, list[WayPiece]] = defaultdict(list)
    for piece in pieces:
        of_way[piece.way].append(piece)
    restrictions = []
    for _, relation in sorted(extract.relations.items()):
        kind = relation.tags.get("restriction", "")
        if relation.tags.get("type") != "restriction" or not kind.startswith(("no_", "only_")):
            continue
        ways = {
            role: [ref for kind, ref, name in relation.members if kind == "w" and name == role]
            for role in ("from", "via", "to")
        }
        if not all(ways.values()) or len(ways["via"]) > 1:
            continue
        options = [[p for ref in ways[role] for p in of_way[ref]] for role in ("from", "via", "to")]
        for before, via, after in list(product(*options))[:MOST]:
            edges = _driven(before, via, after)
            if edges:
                restrictions.append((edges, kind.startswith("only_")))
    return restrictions


def _driven(before: WayPiece, via: WayPiece, after: WayPiece) -> tuple[str, ...]:
    """Return the edges along three segments; empty if the segments are not connected."""
    for first, last in ((via.nodes[0], via.nodes[-1]), (via.nodes[-1], via.nodes[0])):
        if first in (before.nodes[0], before.nodes[-1]) and last in (
            after.nodes[0],
            after.nodes[-1],
        ):
            return (
                str(before.id) if before.nodes[-1] == first else f"-{before.id}",
                str(via.id) if via.nodes[0] == first else f"-{via.id}",
                str(after.id) if after.nodes[0] == last else f"-{after.id}",
            )
    return ()
