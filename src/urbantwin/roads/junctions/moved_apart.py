"""Overlapping streets that part or run in parallel, moved apart until their lanes do not overlap.

Where a carriageway splits, the map draws both branches from one point, and their lanes overlap
until the lines are as far apart as the lanes are wide. In reality they lie side by side there,
between the walls of buildings.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import stations_of_points
from urbantwin.roads.cross_section.between_walls import room_beside, walls_of
from urbantwin.roads.junctions.cluster import Chain, chains_of, meeting_nodes
from urbantwin.roads.junctions.plain import PlainEdge, PlainNetwork
from urbantwin.roads.junctions.strip import Strip

__all__ = ["moved_apart"]

#: Minimum cosine of the angle between parallel streets.
PARALLEL = np.cos(np.radians(35.0))
#: Maximum displacement, metres; its rate of decay (metres per metre); clearance between borders,
#: metres.
FURTHEST_M, TAPER, ROOM_M = 3.5, 0.12, 0.1
STEP_M = 2.0
#: Clearance between a carriageway and a wall, and minimum distance of the walls along a street,
#: metres; below it they belong to a building passage.
WALL_M, PASSAGE_M, FAR_M = 0.05, 2.0, 1e3
#: Number of iterations: a displaced street may in turn displace the next.
ROUNDS = 8
#: Lines closer than this all along are one street mapped twice, metres.
ONE_M = 1.0
#: Smaller displacements are ignored, metres.
NOTHING_M = 0.05


@dataclass(frozen=True, eq=False)
class _Street:
    """A street between two junctions, with both directions or one.

    Attributes:
        ahead, back: its chains; ``back`` is ``None`` for one direction.
        places: (N, 2) centre line of all lanes.
        half: (N,) half their width, metres.
        room: (N, 2) distance to a wall on the left and on the right, `FAR_M` if there is none.
        free: whether its start and its end may move.
    """

    ahead: Chain
    back: Chain | None
    places: NDArray[np.float64]
    half: NDArray[np.float64]
    room: NDArray[np.float64]
    free: tuple[bool, bool]

    @cached_property
    def stations(self) -> NDArray[np.float64]:
        return stations_of_points(self.places)

    @cached_property
    def steps(self) -> NDArray[np.float64]:
        """Unit vectors (N, 2) along the street."""
        return _directions(self.places)

    @cached_property
    def line(self) -> shapely.LineString:
        return shapely.LineString(self.places)

    def moved(self, by: NDArray[np.float64]) -> _Street:
        """Return the street moved to the left by ``by`` metres (N,), with unchanged headings."""
        normal = np.column_stack([-self.steps[:, 1], self.steps[:, 0]])
        room = self.room + by[:, None] * [-1.0, 1.0]
        return replace(self, places=self.places + by[:, None] * normal, room=room)


def moved_apart(
    edges: Mapping[str, PlainEdge],
    plain: PlainNetwork,
    *,
    still: Collection[str],
    buildings: Sequence[shapely.Polygon],
    driving_side: str,
) -> dict[str, PlainEdge]:
    """Return edges by id, with overlapping ones moved side by side.

    Args:
        edges: the edges between junctions.
        plain: a network of them.
        still: edges that are not moved and displace no others: bridges, outer roads.
        buildings: footprints of buildings on the ground.
        driving_side: ``right`` or ``left``.
    """
    outward = -1 if driving_side == "right" else 1
    streets = _streets(plain, still, outward, walls_of(buildings))
    shifts = [np.zeros(len(street.places)) for street in streets]
    bands = [
        shapely.LineString(s.places).buffer(float(s.half.max()) + FURTHEST_M / 2) for s in streets
    ]
    hits = shapely.STRtree(bands).query(np.array(bands, object), predicate="intersects")
    pairs = [(a, b) for a, b in hits.T.tolist() if a != b]
    for _ in range(ROUNDS):
        # A displaced street may come close to the next one.
        current = [street.moved(push) for street, push in zip(streets, shifts, strict=True)]
        pushes = [
            push + _before_walls(street) for street, push in zip(current, shifts, strict=True)
        ]
        for a, b in pairs:
            pushes[a] += _displacement(current[a], current[b])
        shifts = [_tapered(street, push) for street, push in zip(streets, pushes, strict=True)]
    result = dict(edges)
    for street, push in zip(streets, shifts, strict=True):
        if np.abs(push).max() < NOTHING_M:
            continue
        result |= _shifted(street.ahead, edges, street.stations, push)
        if street.back is not None:
            length = float(street.stations[-1])
            result |= _shifted(street.back, edges, length - street.stations[::-1], -push[::-1])
    return result


def _streets(
    plain: PlainNetwork, still: Collection[str], outward: int, walls: shapely.STRtree
) -> list[_Street]:
    meeting = meeting_nodes(plain)
    chains = {
        part.nodes: part for chain in chains_of(plain, meeting) for part in _parts(chain, still)
    }
    streets, seen = [], set[tuple[str, ...]]()
    for nodes, chain in sorted(chains.items()):
        back = chains.get(nodes[::-1])
        if nodes in seen:
            continue
        if back is not None and len(back.edges) == len(chain.edges):
            seen.add(nodes[::-1])
        else:
            back = None
        places, half = _middle(chain, back, outward)
        if len(places) > 1:
            free = (
                bool(len(plain.nodes[nodes[0]].outline)),
                bool(len(plain.nodes[nodes[-1]].outline)),
            )
            reach = half + FURTHEST_M + WALL_M
            room = np.minimum(room_beside(places, _directions(places), reach, walls), FAR_M)
            room[room.sum(axis=1) < PASSAGE_M] = FAR_M
            streets.append(_Street(chain, back, places, half, room, free))
    return streets


def _parts(chain: Chain, still: Collection[str]) -> list[Chain]:
    """Return the parts of a chain between fixed edges."""
    runs = groupby(chain.edges, key=lambda edge: edge.id in still)
    return [Chain(tuple(edges)) for fixed, edges in runs if not fixed]


def _middle(
    chain: Chain, back: Chain | None, outward: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centre line (N, 2) of all lanes along a chain, and half their width (N,)."""
    lines, halves = [], []
    for k, edge in enumerate(chain.edges):
        strip = Strip(edge, outward)
        low, high = strip.driven()
        if back is not None:
            against = Strip(back.edges[-1 - k], outward).driven()
            against_m = against[1] - against[0]
            low, high = (low, high + against_m) if outward < 0 else (low - against_m, high)
        line = strip.middle
        points = shapely.get_coordinates(line.segmentize(STEP_M))
        leg = np.gradient(points, axis=0)
        leg /= np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-9)
        lines.append(points + (low + high) / 2 * np.column_stack([-leg[:, 1], leg[:, 0]]))
        halves.append(np.full(len(points), (high - low) / 2))
    places, half = np.vstack(lines), np.concatenate(halves)
    distinct = np.concatenate([[True], np.linalg.norm(np.diff(places, axis=0), axis=1) > 1e-3])
    return places[distinct], half[distinct]


def _directions(points: NDArray[np.float64]) -> NDArray[np.float64]:
    leg = np.gradient(points, axis=0)
    return np.asarray(leg / np.maximum(np.linalg.norm(leg, axis=1, keepdims=True), 1e-9))


def _displacement(street: _Street, other: _Street) -> NDArray[np.float64]:
    """Return the displacement (N,) to the left of a street's places to clear another street.

    The narrower one moves more, as where lanes split off a wide carriageway.
    """
    line = other.line
    along = shapely.line_locate_point(line, shapely.points(street.places))
    nearest = shapely.get_coordinates(shapely.line_interpolate_point(line, along))
    number = np.abs(other.stations[:, None] - along[None]).argmin(axis=0)
    ahead = street.steps
    cosine = (ahead * other.steps[number]).sum(axis=1)
    gap = nearest - street.places
    left = ahead[:, 0] * gap[:, 1] - ahead[:, 1] * gap[:, 0]
    beside = (along > 0.0) & (along < line.length) & (np.abs(cosine) > PARALLEL)
    needed_m = street.half + other.half[number] + ROOM_M
    overlap_m = np.where(beside, needed_m - np.abs(left), 0.0)
    if not (overlap_m > 0.0).any() or np.abs(left[beside]).max() < ONE_M:
        return np.zeros(len(street.places))
    # The side is determined where the two are farthest apart.
    side = np.sign(left[beside][np.abs(left[beside]).argmax()])
    lacking_m = np.where(beside, np.maximum(needed_m - side * left, 0.0), 0.0)
    return np.asarray(-side * lacking_m * other.half[number] / (needed_m - ROOM_M))


def _before_walls(street: _Street) -> NDArray[np.float64]:
    """Return the displacement (N,) to the left that clears walls, if there is room.

    Between walls closer than the street is wide, it is centred.
    """
    needed_m = (street.half + WALL_M)[:, None]
    left, right = street.room.T
    lacking_m = np.maximum(needed_m - street.room, 0.0)
    return np.where(
        left + right < 2 * needed_m[:, 0],
        (left - right) / 2,
        lacking_m[:, 1] - lacking_m[:, 0],
    )


def _tapered(street: _Street, push: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a displacement with gradual ends, zero at fixed ends of the street."""
    s = street.stations
    push = np.clip(push, -FURTHEST_M, FURTHEST_M)
    reach = np.maximum(np.abs(push)[None] - TAPER * np.abs(s[:, None] - s[None]), 0.0)
    strongest = reach.argmax(axis=1)
    shift = reach[np.arange(len(s)), strongest] * np.sign(push)[strongest]
    limit = np.full(len(s), np.inf)
    if not street.free[0]:
        limit = np.minimum(limit, TAPER * s)
    if not street.free[1]:
        limit = np.minimum(limit, TAPER * (s[-1] - s))
    return np.asarray(np.clip(shift, -limit, limit))


def _shifted(
    chain: Chain,
    edges: Mapping[str, PlainEdge],
    stations: NDArray[np.float64],
    by: NDArray[np.float64],
) -> dict[str, PlainEdge]:
    """Return a chain's edges, moved to the left by ``by`` metres at stations along it."""
    shifted, before = {}, 0.0
    scale = float(stations[-1]) / max(chain.length, 1e-9)
    for edge in chain.edges:
        length = float(edge.line.length)
        points = shapely.get_coordinates(edge.line.segmentize(STEP_M))
        along = (before + stations_of_points(points)) * scale
        ahead = _directions(points)
        normal = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        offset = np.interp(along, stations, by)
        if np.abs(offset).max() >= NOTHING_M:
            shifted[edge.id] = replace(edges[edge.id], shape=points + offset[:, None] * normal)
        before += length
    return shifted
