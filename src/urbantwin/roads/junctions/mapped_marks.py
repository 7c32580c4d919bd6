"""What the map says across streets: stop lines of signals, and crossings, along every edge.

Mappers put ``highway=traffic_signals`` at each stop line, or on the junction's own node (OSM wiki,
"Tag:highway=traffic_signals"); only the former are stop lines.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from urbantwin.roads.junctions.mapped_crossings import is_crossing_node, is_crossing_way
from urbantwin.site.extract import Extract, WayPiece

__all__ = ["Marks", "mapped_marks"]


@dataclass(frozen=True)
class Marks:
    """What lies across edges: edge id -> shares of the edge's length from its start, ascending."""

    stop_lines: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    crossings: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


def mapped_marks(extract: Extract, pieces: Sequence[WayPiece], meeting: Collection[int]) -> Marks:
    """Return stop lines and crossings of the map along the edges that pieces become.

    Args:
        extract: the map.
        pieces: segments of ways; each becomes the edge of its id, and the one of minus its id.
        meeting: nodes where streets meet, whose signals are no stop lines.
    """
    # A footway that only meets a street is no crossing of it.
    crossed = {node for way in extract.highways() if is_crossing_way(way) for node in way.nodes}
    lines: dict[str, list[float]] = defaultdict(list)
    crossings: dict[str, list[float]] = defaultdict(list)
    for piece in pieces:
        if len(piece.nodes) < 2:
            continue
        steps = np.linalg.norm(np.diff(piece.points, axis=0), axis=1)
        share = np.concatenate([[0.0], np.cumsum(steps)]) / max(float(steps.sum()), 1e-9)
        for node, at in zip(piece.nodes, share.tolist(), strict=True):
            if node in meeting:
                continue
            tags = extract.node_tags.get(node, {})
            if is_crossing_node(tags) or (node in crossed and tags.get("crossing") != "no"):
                crossings[str(piece.id)].append(at)
                crossings[f"-{piece.id}"].append(1.0 - at)
            if tags.get("highway") == "traffic_signals":
                told = tags.get("traffic_signals:direction", "")
                if told != "backward":
                    lines[str(piece.id)].append(at)
                if told != "forward":
                    lines[f"-{piece.id}"].append(1.0 - at)
    return Marks(_sorted(lines), _sorted(crossings))


def _sorted(found: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    return {edge: tuple(sorted(set(shares))) for edge, shares in found.items()}
