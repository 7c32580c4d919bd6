"""Turn restrictions over a way between (OSM wiki, "Relation:restriction", via a way).

netconvert reads restrictions over a node alone.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from itertools import product

from urbantwin.site.extract import Extract, WayPiece

__all__ = ["via_way_restrictions"]

#: The most sequences of segments that one restriction is read as.
MOST = 64


def via_way_restrictions(
    extract: Extract, pieces: Sequence[WayPiece]
) -> list[tuple[tuple[str, ...], bool]]:
    """Return sequences of edges that may not be driven, with whether only the last is allowed.

    Args:
        extract: the map.
        pieces: the segments that its ways were cut into.
    """
    of_way: dict[int, list[WayPiece]] = defaultdict(list)
    for piece in pieces:
        of_way[piece.way].append(piece)
    found = []
    for _, relation in sorted(extract.relations.items()):
        kind = relation.tags.get("restriction", "")
        if relation.tags.get("type") != "restriction" or not kind.startswith(("no_", "only_")):
            continue
        ways = {
            role: [ref for kind, ref, own in relation.members if kind == "w" and own == role]
            for role in ("from", "via", "to")
        }
        if not all(ways.values()) or len(ways["via"]) > 1:
            continue
        options = [[p for ref in ways[role] for p in of_way[ref]] for role in ("from", "via", "to")]
        for before, via, after in list(product(*options))[:MOST]:
            edges = _driven(before, via, after)
            if edges:
                found.append((edges, kind.startswith("only_")))
    return found


def _driven(before: WayPiece, via: WayPiece, after: WayPiece) -> tuple[str, ...]:
    """Return the edges from one segment over another to a third; nothing where they do not meet."""
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
