"""Grade separation: roads that cross over others, and their height above the ground.

Only a road that crosses over another road of the network is lifted; a bridge over water or rails is
level with its approaches. Lifted roads descend to the ground along the network at a grade of at
most ``RAMP_GRADE``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from urbantwin.number_text import finite_number

__all__ = [
    "CLEARANCE_M",
    "Crossing",
    "Lift",
    "LiftedRoad",
    "LiftedTurn",
    "find_crossings",
    "levels_of_ways",
    "lift_of_network",
    "way_layer",
]

#: Height of a road above the one that it crosses, metres: 4.7 m clearance (AASHTO Green Book,
#: minimum 4.3 to 4.9 m on local to arterial roads) plus the deck.
CLEARANCE_M = 5.5
#: Steepest ramp that is assumed where only different layers are mapped.
RAMP_GRADE = 0.06
#: Spacing of the samples along roads, metres.
STEP_M = 4.0
#: Parameters of the local regression of the lift: number of nearest samples; standard deviation of
#: the Gaussian weights, metres; regularisation across a line of samples, square metres.
NEIGHBOURS, SMOOTHING_M, STIFFNESS = 12, 4.0, 0.5
#: Number of samples that roads of different levels share where they meet, unless a sample of
#: another height is within the second distance, metres: a street under the end of a bridge.
SHARED, UNDER_M = 4, 15.0
#: Samples belong to one surface if their heights differ by no more than this step, metres, and this
#: grade. Between a ramp and a street beside it is a wall.
STEP_UP_M, STEEPEST = 0.5, 2.0 * RAMP_GRADE
#: Minimum total weight; below it no nearby sample is on the same surface.
LEAST_WEIGHT = 1e-6


@dataclass(frozen=True)
class Crossing:
    """Way ``upper`` passes over way ``lower`` at ``point`` (2,), site frame."""

    upper: int
    lower: int
    point: NDArray[np.float64]


@dataclass(frozen=True)
class Lift:
    """Samples of the network with their height above the ground.

    Attributes:
        xy: (N, 2) positions of samples, site frame.
        level: (N,) level of the sample's road.
        height: (N,) height above the ground, metres.
        wide: samples over the full width of roads and connections: the nearest one determines the
            surface of a place.
    """

    xy: NDArray[np.float64]
    level: NDArray[np.int64]
    height: NDArray[np.float64]
    wide: Lift | None = None

    def at(self, xy: NDArray[np.float64], level: int) -> NDArray[np.float64]:
        """Return the lift (M,) at points (M, 2) of a level by local linear regression, metres."""
        lift = np.zeros(len(xy))
        samples = self._of_level(level)
        if samples is None or not len(xy):
            return lift
        tree, height = samples
        rows = np.arange(len(xy))
        count = min(NEIGHBOURS, len(height))
        distance, index = tree.query(xy[rows], k=np.arange(1, count + 1))
        risen = height[index].any(axis=1)
        rows, distance, index = rows[risen], distance[risen], index[risen]
        gap = tree.data[index] - xy[rows, None]
        # Weights decrease from the nearest sample: far from all samples its height dominates.
        weight = np.exp(-0.5 * (distance**2 - distance[:, :1] ** 2) / SMOOTHING_M**2)
        wide_samples = self.wide._of_level(level) if self.wide else None
        if wide_samples is not None:
            wide_index = wide_samples[0].query(xy[rows])[1]
            nearest = wide_samples[1][wide_index]
            distance_m = np.linalg.norm(
                tree.data[index] - wide_samples[0].data[wide_index][:, None], axis=2
            )
            rise = np.abs(height[index] - nearest[:, None])
            weight *= rise <= STEP_UP_M + STEEPEST * distance_m
            alone = weight.sum(axis=1) < LEAST_WEIGHT
            lift[rows[alone]] = nearest[alone]
            rows, gap, index, weight = rows[~alone], gap[~alone], index[~alone], weight[~alone]
        design = np.concatenate([np.ones((*gap.shape[:2], 1)), gap], axis=2)
        weighted = design * weight[..., None]
        normal = np.einsum("mki,mkj->mij", weighted, design)
        # Samples lie along roads: the slope across them is unknown, and assumed zero.
        normal[:, [1, 2], [1, 2]] += STIFFNESS * weight.sum(axis=1)[:, None]
        right = np.einsum("mki,mk->mi", weighted, height[index])
        lift[rows] = np.maximum(np.linalg.solve(normal, right[..., None])[:, 0, 0], 0.0)
        return lift

    def is_above_another(self, xy: NDArray[np.float64], level: int) -> bool:
        """Return whether a street on the ground is far below a point (2,) and near in plan.

        Near means that it would be mixed with it if both were on one level.
        """
        height = float(self.at(xy[None], level)[0])
        wide = self.wide or self
        is_near = np.linalg.norm(wide.xy - xy, axis=1) < UNDER_M
        below = wide.height < height - CLEARANCE_M / 2
        return bool((is_near & below & (wide.level == 0)).any())

    def _of_level(self, level: int) -> tuple[cKDTree, NDArray[np.float64]] | None:
        if level not in self._trees:
            on_level = self.level == level
            lifted = bool(self.height[on_level].any())
            tree = cKDTree(self.xy[on_level]) if lifted else None
            self._trees[level] = None if tree is None else (tree, self.height[on_level])
        return self._trees[level]

    @cached_property
    def _trees(self) -> dict[int, tuple[cKDTree, NDArray[np.float64]] | None]:
        return {}


#: Layers range from -5 to 5; larger values are errors or rare interchanges.
HIGHEST_LAYER = 20


def way_layer(tags: Mapping[str, str]) -> int:
    """Return a way's layer (OSM wiki, "Key:layer"): bridges count as 1, tunnels as -1."""
    layer = finite_number(tags.get("layer"))
    if layer is not None and abs(layer) <= HIGHEST_LAYER:
        return int(layer)
    if tags.get("bridge") not in (None, "no"):
        return 1
    return -1 if tags.get("tunnel") not in (None, "no", "building_passage") else 0


def find_crossings(
    lines: Mapping[int, NDArray[np.float64]],
    nodes: Mapping[int, frozenset[int]],
    layers: Mapping[int, int],
) -> list[Crossing]:
    """Return the places where ways of different layers cross without a shared node.

    Args:
        lines: way -> (N, 2) site-frame points.
        nodes: way -> ids of its nodes.
        layers: way -> layer.
    """
    ids = sorted(lines)
    shapes = [shapely.LineString(lines[i]) for i in ids]
    tree = shapely.STRtree(shapes)
    crossings = []
    for first, second in sorted(map(tuple, tree.query(shapes, predicate="crosses").T.tolist())):
        lower, upper = ids[first], ids[second]
        if layers[upper] <= layers[lower] or nodes[upper] & nodes[lower]:
            continue
        meet = shapely.get_parts(shapely.intersection(shapes[first], shapes[second]))
        crossings += [Crossing(upper, lower, shapely.get_coordinates(part)[0]) for part in meet]
    return crossings


def levels_of_ways(crossings: list[Crossing]) -> dict[int, int]:
    """Return the level (1, 2, ...) of each way that crosses over another."""
    level: dict[int, int] = {}
    for _ in range(len(crossings)):
        before = dict(level)
        for crossing in crossings:
            beneath = level.get(crossing.lower, 0)
            level[crossing.upper] = max(level.get(crossing.upper, 0), beneath + 1)
        if level == before:
            break
    return level


@dataclass(frozen=True, eq=False)
class LiftedRoad:
    """The properties of a road that determine its lift.

    Attributes:
        lines: (N, 2) points of lines from the road's start to its end, over its full width: the
            first is the centre line of the innermost lane.
        level: 0 on the ground, 1, 2, ... above other roads.
        ways: ids of its OSM ways.
        junctions: ids of the junctions at its start and its end.
    """

    lines: tuple[NDArray[np.float64], ...]
    level: int
    ways: frozenset[int]
    junctions: tuple[str, str]


@dataclass(frozen=True, eq=False)
class LiftedTurn:
    """A connection through a junction: (N, 2) centre line, and indices of the roads it links."""

    centre: NDArray[np.float64]
    before: int
    after: int

    def samples(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points (M, 2) along it, and the share of its length at each (M,)."""
        line = shapely.LineString(self.centre)
        share = np.linspace(0.0, 1.0, max(2, int(line.length / STEP_M) + 1))
        return shapely.get_coordinates(line.interpolate(share, normalized=True)), share


def lift_of_network(
    roads: list[LiftedRoad], turns: list[LiftedTurn], crossings: list[Crossing]
) -> Lift:
    """Return the height of all roads above the ground.

    Args:
        roads: the roads.
        turns: the connections through junctions.
        crossings: places where ways cross over others.
    """
    points, levels, links = [], [], []
    ends: dict[str, list[int]] = {}
    seeds: dict[int, float] = {}
    start = 0
    starts: list[int] = []
    beside: list[tuple[int, NDArray[np.float64]]] = []
    for road in roads:
        level, junctions = road.level, road.junctions
        line = shapely.LineString(road.lines[0])
        along = np.linspace(0, line.length, max(2, int(line.length / STEP_M) + 1))
        xy = shapely.get_coordinates(line.interpolate(along))
        index = start + np.arange(len(xy))
        links += [
            (int(a), int(b), float(d))
            for a, b, d in zip(index[:-1], index[1:], np.diff(along), strict=True)
        ]
        ends.setdefault(junctions[0], []).append(start)
        ends.setdefault(junctions[1], []).append(int(index[-1]))
        for crossing in crossings:
            if crossing.upper in road.ways:
                gap = np.linalg.norm(xy - crossing.point, axis=1)
                for sample in np.flatnonzero(gap < max(15.0, float(gap.min()) + STEP_M)):
                    key = int(index[sample])
                    seeds[key] = max(seeds.get(key, 0.0), level * CLEARANCE_M)
        share = along / max(line.length, 1e-9)
        for points_beside in road.lines[1:]:
            other = shapely.LineString(points_beside)
            matching = other.interpolate(share, normalized=True)
            beside.append((start, shapely.get_coordinates(matching)))
        starts.append(start)
        points.append(xy)
        levels.append(np.full(len(xy), level))
        start += len(xy)
    if not seeds:
        return Lift(np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0))
    xy = np.concatenate(points)
    for samples in ends.values():
        links += [
            (a, b, float(np.linalg.norm(xy[a] - xy[b])))
            for k, a in enumerate(samples)
            for b in samples[k + 1 :]
        ]
    highest = max(seeds.values())
    # A virtual source tops every seed, so that one shortest-path run gives the envelope
    # max over seeds of (needed height - grade x distance along the network).
    links += [(start, seed, (highest - height) / RAMP_GRADE) for seed, height in seeds.items()]
    first_end, other_end, costs = (np.array(part) for part in zip(*links, strict=True))
    graph = coo_matrix((costs + 1e-9, (first_end, other_end)), shape=(start + 1, start + 1)).tocsr()
    distance = dijkstra(graph, directed=False, indices=start)[:start]
    height = np.maximum(0.0, highest - RAMP_GRADE * distance)
    level_of = np.concatenate(levels)
    extra = _shared(ends, level_of, starts)
    extra = [(k, other) for k, other in extra if not _crosses(k, level_of == other, xy, height)]
    shared = np.array([k for k, _ in extra], np.int64)
    of_shared = np.array([level for _, level in extra], np.int64)
    # The same height across a road.
    rows = [(xy, level_of, height)]
    for first, places in beside:
        sample_index = first + np.arange(len(places))
        rows.append((places, level_of[sample_index], height[sample_index]))
    last = [*(k - 1 for k in starts[1:]), start - 1]
    for turn in turns:
        joined = [last[turn.before], starts[turn.after]]
        places, share = turn.samples()
        lowest = np.full(len(places), level_of[joined].min())
        rows.append((places, lowest, np.interp(share, [0.0, 1.0], height[joined])))
    places, of_level, heights = (np.concatenate(part) for part in zip(*rows, strict=True))
    return Lift(
        np.concatenate([xy, xy[shared]]),
        np.concatenate([level_of, of_shared]).astype(np.int64),
        np.concatenate([height, height[shared]]),
        Lift(places, of_level.astype(np.int64), heights),
    )


def _crosses(
    sample: int,
    others: NDArray[np.bool_],
    xy: NDArray[np.float64],
    height: NDArray[np.float64],
) -> bool:
    """Return whether one of other samples (N,) is far above or below a sample."""
    is_near = np.linalg.norm(xy - xy[sample], axis=1) < UNDER_M
    return bool((others & is_near & (np.abs(height - height[sample]) > CLEARANCE_M / 2)).any())


def _shared(
    ends: Mapping[str, list[int]], level: NDArray[np.int64], starts: list[int]
) -> list[tuple[int, int]]:
    """Return (sample, level) of samples that also count for the level of an adjoining road."""
    extra = []
    bounds = [*starts, len(level)]
    for samples in ends.values():
        levels = {int(level[k]) for k in samples}
        for k in samples:
            road = int(np.searchsorted(bounds, k, side="right")) - 1
            first, last = bounds[road], bounds[road + 1]
            near_samples = (
                range(k, min(k + SHARED, last))
                if k == first
                else range(max(first, k - SHARED + 1), k + 1)
            )
            extra += [(j, other) for other in levels - {int(level[k])} for j in near_samples]
    return sorted(set(extra))
