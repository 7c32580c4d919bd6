"""The order of edges around a node in netconvert, and the gaps between them for walking areas.

netconvert sorts the edges of a node by their position ten metres out, seen from the centre of the
junction (``NBEdge::computeAngle``). Sidewalks and footways between two consecutive carriageways
form one walking area; a crossing joins the walking areas on both sides of its edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.junctions.plain import INTO_M, PlainCrossing, PlainEdge, PlainNetwork
from urbantwin.roads.junctions.strip import Strip

__all__ = ["RoundNode", "is_driven"]

#: Distance along an edge at which netconvert takes its angle, at most half its length, metres.
LOOK_M = 10.0


def is_driven(edge: PlainEdge) -> bool:
    """Return whether vehicles use an edge."""
    return any(edge.admits(name) for name in ("passenger", "bus", "bicycle"))


@dataclass(frozen=True, eq=False)
class RoundNode:
    """The edges at a node, counter-clockwise.

    Attributes:
        plain: the network.
        node: the node's id.
        outward: 1 in left-hand traffic, -1 in right-hand traffic.
    """

    plain: PlainNetwork
    node: str
    outward: int

    @cached_property
    def centre(self) -> NDArray[np.float64]:
        """The point from which edges are seen (2,)."""
        node = self.plain.nodes[self.node]
        if len(node.outline) < 3:
            return node.xy
        middle = shapely.Polygon(node.outline).centroid
        return np.array([middle.x, middle.y])

    @cached_property
    def outline(self) -> shapely.Geometry:
        """The junction's outline; empty if netconvert determines it."""
        outline = self.plain.nodes[self.node].outline
        return shapely.Polygon(outline) if len(outline) > 2 else shapely.Polygon()

    @cached_property
    def driven(self) -> list[tuple[float, PlainEdge]]:
        """Angle (radians, 0 to 2 pi) and edge of all edges for vehicles, in order."""
        edges = {
            edge.id: edge
            for edge in (*self.plain.arriving[self.node], *self.plain.leaving[self.node])
            if is_driven(edge)
        }
        rows = [
            (self.angle(self._outwards(edge), len(self.outline.bounds) > 0), edge)
            for edge in edges.values()
        ]
        return sorted(rows, key=lambda row: (row[0], row[1].id))

    def angle(self, points: NDArray[np.float64], reaches_in: bool = False) -> float:
        """Return the angle of an edge, given its points away from the node."""
        line = shapely.LineString(points)
        station = min(line.length / 2, LOOK_M) + (INTO_M / 2 if reaches_in else 0.0)
        place = line.interpolate(station)
        gap = np.array([place.x, place.y]) - self.centre
        return float(np.arctan2(gap[1], gap[0]) % (2 * np.pi))

    def gap_at(self, angle: float) -> int:
        """Return the gap of an angle: the index of the preceding edge."""
        before = [k for k, (other, _) in enumerate(self.driven) if other <= angle]
        return (before[-1] if before else len(self.driven) - 1) if self.driven else 0

    def bounds(self, gap: int) -> tuple[float, float]:
        """Return the angles that bound a gap, the second greater than the first."""
        first = self.driven[gap][0]
        last = self.driven[(gap + 1) % len(self.driven)][0]
        return first, last if last > first else last + 2 * np.pi

    def gaps_of(self, crossing: PlainCrossing) -> tuple[int, int]:
        """Return the gaps at the start and the end of a crossing's line."""
        numbers = [k for k, (_, edge) in enumerate(self.driven) if edge.id in crossing.edges]
        count = len(self.driven)
        # The edges are adjacent: the first is the one without a predecessor among them.
        first = next((k for k in numbers if (k - 1) % count not in numbers), numbers[0])
        last = next((k for k in numbers if (k + 1) % count not in numbers), numbers[-1])
        before, after = (first - 1) % count, last
        return (after, before) if self.outward > 0 else (before, after)

    def sidewalk_gaps(self) -> list[int]:
        """Return the gaps that sidewalks of streets lead to."""
        gaps = []
        for k, (_, edge) in enumerate(self.driven):
            arrives = edge.end == self.node
            after = arrives == (self.outward < 0)
            if edge.lanes[0].is_sidewalk:
                gaps.append(k if after else (k - 1) % len(self.driven))
        return gaps

    def ordered(self, crossings: Sequence[PlainCrossing]) -> list[PlainCrossing]:
        """Return crossings in the order in which netconvert joins them.

        netconvert assumes that listed crossings follow each other around the node,
        counter-clockwise in right-hand traffic.
        """
        number = {edge.id: k for k, (_, edge) in enumerate(self.driven)}
        return sorted(
            crossings,
            key=lambda c: self.outward * min(number.get(name, 0) for name in c.edges),
        )

    def _outwards(self, edge: PlainEdge) -> NDArray[np.float64]:
        points = shapely.get_coordinates(Strip(edge, self.outward).middle)
        return np.asarray(points[::-1] if edge.end == self.node else points)
