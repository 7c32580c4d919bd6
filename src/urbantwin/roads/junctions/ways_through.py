"""The middle of every lane's way through a junction, and which of them anybody can drive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import wrapped
from urbantwin.roads.junctions.drawn_turns import drawn_turns
from urbantwin.roads.junctions.opposed_turns import passing_in_front
from urbantwin.roads.junctions.passage import Passage
from urbantwin.roads.junctions.plain import INTO_M
from urbantwin.roads.junctions.ring import Ring, ring_of, round_ring
from urbantwin.roads.junctions.strip import Strip
from urbantwin.roads.model.curve import Curve
from urbantwin.roads.round_standing import round_standing
from urbantwin.roads.streets.manoeuvre import gentle_curves

__all__ = ["Way", "WaysThrough", "ways_through"]

#: Points of the map's way this near its ends, or twice as near sharper bends, are not kept to:
#: metres, radians.
NEAR_M, SHARP = 3.0, np.radians(25.0)
#: Nobody drives a tighter curve, metres (turning circles of cars are 10 to 12 m).
TIGHTEST_M = 2.5
#: A lane of an edge that leads in, and one of an edge that leads out.
Way = tuple[str, int, str, int]


@dataclass(frozen=True)
class WaysThrough:
    """Ways through a junction.

    Attributes:
        curves: the middle of each.
        led: those of them that somebody drew, or that lead round a ring or what stands.
        drivable: those that are driven, in the order of the junction's ways.
    """

    curves: Mapping[Way, Curve]
    led: frozenset[Way]
    drivable: tuple[Way, ...]


def ways_through(
    ways: Mapping[Way, Passage],
    strips: Mapping[str, Strip],
    *,
    followed: Mapping[str, NDArray[np.float64]],
    rings: Sequence[Ring],
    standing: Sequence[shapely.Geometry],
    driving_side: str,
) -> WaysThrough:
    """Return the ways through a junction in plan.

    Args:
        ways: the passages by lanes.
        strips: where the edges lie that lead in and out.
        followed: edge within the junction -> the line (N, 2) that traffic keeps to, site frame.
        rings: small roundabouts, site frame.
        standing: outlines of posts and islands, site frame.
        driving_side: ``right`` or ``left``.
    """
    curves = _curves(ways, strips, driving_side)
    drawn = drawn_turns(ways, curves, strips, followed)
    drawn |= _round_rings(ways, curves, rings, 1 if driving_side == "right" else -1)
    others = [way for way in ways if way not in drawn]
    passages = [ways[way] for way in others]
    moved = round_standing([curves[way] for way in others], passages, standing)
    led = drawn | {others[k]: curve for k, curve in moved.items()}
    curves |= led
    return WaysThrough(curves, frozenset(led), tuple(_drivable(ways, curves)))


def _round_rings(
    ways: Mapping[Way, Passage], curves: Mapping[Way, Curve], rings: Sequence[Ring], side: int
) -> dict[Way, Curve]:
    """Return the ways that lead over small rings, round their middle."""
    found = {}
    for way, passage in ways.items():
        inner = {edge.id: edge for edge in passage.path[1:-1]}
        ring = ring_of(inner, rings)
        if ring is None:
            continue
        along = sum(edge.line.length for name, edge in inner.items() if name in ring.edges)
        ends = curves[way].at([0.0, curves[way].length])
        curve = round_ring(ends, ring, float(along), side)
        if curve is not None:
            found[way] = curve
    return found


def _drivable(ways: Iterable[Way], curves: Mapping[Way, Curve]) -> list[Way]:
    """Return ways without those that nobody can drive, where every lane has another way on.

    Nor does the last way to a street go.
    """
    radius: dict[tuple[str, str], float] = {}
    for way in ways:
        curve = curves[way]
        s = np.linspace(0.0, curve.length, max(12, int(curve.length * 2)))
        bend = np.abs(np.gradient(np.unwrap(curve.at(s)[:, 2]), s)).max()
        pair = way[0], way[2]
        radius[pair] = min(radius.get(pair, np.inf), 1.0 / max(float(bend), 1e-6))
    left = list(curves)
    for pair in sorted(radius, key=lambda pair: (radius[pair], pair)):
        if radius[pair] >= TIGHTEST_M:
            break
        others = [way for way in left if (way[0], way[2]) != pair]
        led, met = {way[:2] for way in others}, {way[2] for way in others}
        if pair[1] in met and all(way[:2] in led for way in left if (way[0], way[2]) == pair):
            left = others
    return [way for way in ways if way in left]


def _curves(
    ways: Mapping[Way, Passage],
    strips: Mapping[str, Strip],
    driving_side: str,
) -> dict[Way, Curve]:
    """Return the middle of every lane's way through."""
    outward = -1 if driving_side == "right" else 1
    poses, guides = [], []
    streets = [(start, end) for start, _, end, _ in ways]
    for (start, k, end, j), passage in ways.items():
        first, last = strips[start], strips[end]
        t = first.across(k), last.across(j)
        a = _posed(first.at(first.middle.length - INTO_M), t[0])
        b = _posed(last.at(INTO_M), t[1])
        b[2] = a[2] + wrapped(b[2] - a[2])
        poses.append(np.array([a, b]))
        guides.append(_guide(passage, poses[-1], t, outward))
    curves = gentle_curves(poses, guides)
    moved = passing_in_front(curves, [streets.index(pair) for pair in streets], -outward)
    return dict(zip(ways, moved, strict=True))


def _posed(pose: NDArray[np.float64], t: float) -> NDArray[np.float64]:
    x, y, heading = pose
    return np.array([x - t * np.sin(heading), y + t * np.cos(heading), heading])


def _guide(
    passage: Passage, poses: NDArray[np.float64], t: tuple[float, float], outward: int
) -> shapely.LineString | None:
    """Return the map's own way through; ``None`` where it has no edge there."""
    if len(passage.path) < 3:
        return None
    middles = [Strip(edge, outward) for edge in passage.path[1:-1]]
    total = sum(strip.middle.length for strip in middles)
    points, before = [poses[0, :2]], 0.0
    for strip in middles:
        line = strip.middle
        for station in np.linspace(0.0, line.length, max(2, int(line.length / 2.0) + 1)):
            share = (before + station) / max(total, 1e-9)
            low, high = strip.driven()
            aside = float(
                np.clip(t[0] + share * (t[1] - t[0]), low + 1.0, max(high - 1.0, low + 1))
            )
            place = _posed(strip.at(float(station)), aside)[:2]
            if np.linalg.norm(place - points[-1]) > 1.0:
                points.append(place)
        before += line.length
    return shapely.LineString(_passable(np.array([*points, poses[1, :2]]), poses))


def _passable(points: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leave out what a smooth way cannot pass: sharp bends, and what is not between its ends."""
    inner = points[1:-1]
    start, end = poses[:, :2]
    ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    keep = ((inner - start) @ ahead[0] > NEAR_M) & ((end - inner) @ ahead[1] > NEAR_M)
    leg = np.diff(points, axis=0)
    turn = np.abs(wrapped(np.diff(np.arctan2(leg[:, 1], leg[:, 0]))))
    for bend in inner[turn > SHARP]:
        keep &= np.linalg.norm(inner - bend, axis=1) > 2 * NEAR_M
    return np.vstack([start, inner[keep], end])
