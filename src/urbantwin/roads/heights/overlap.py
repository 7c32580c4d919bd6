"""Overlaps: carriageways that touch outside junctions and must share one surface."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.roads.heights.stations import Stations
from urbantwin.roads.model import ModelRoad

__all__ = ["NO_OVERLAPS", "Overlaps", "find_overlaps"]

#: Carriageways within this distance are one area of asphalt, metres.
SEAM_M = 0.6
#: Smaller overlaps are ignored, square metres.
LEAST_M2 = 0.1
#: Smaller height differences are ignored, metres.
STEP_UP_M = 0.005
#: Range in which an overlap affects the profile of a road, metres.
AROUND_M = 2.0


@dataclass(frozen=True)
class Overlaps:
    """Streets that must match the heights of their neighbours.

    Attributes:
        calm: id of a street -> ranges of stations without its own cross-fall, metres.
        yielding: ids of streets that follow the surface of others.
    """

    calm: dict[int, list[tuple[float, float]]]
    yielding: frozenset[int]


#: No overlaps.
NO_OVERLAPS = Overlaps({}, frozenset())


def find_overlaps(
    streets: Sequence[ModelRoad], ways: Sequence[ModelRoad], stations: Stations
) -> Overlaps:
    """Return where streets differ in height from roads that share their asphalt.

    Args:
        streets: streets with heights.
        ways: connecting roads, which occasionally overlap streets.
        stations: stations of the streets and of the connecting roads.
    """
    roads = [*streets, *ways]
    areas = stations.areas(grown=np.repeat([SEAM_M / 2, -0.05], [len(streets), len(ways)]))
    level = np.array([road.level for road in roads])
    tree = shapely.STRtree(areas[: len(streets)])
    first, second = tree.query(areas, predicate="intersects")
    keep = (second < first) & (level[first] == level[second])
    first, second = first[keep], second[keep]
    shared = shapely.intersection(areas[first], areas[second])
    big = shapely.area(shared) > LEAST_M2
    calm: dict[int, list[tuple[float, float]]] = defaultdict(list)
    yielding = set()
    for a, b, area in zip(first[big], second[big], shared[big], strict=True):
        road, other = roads[a], roads[b]
        points = shapely.get_coordinates(area)
        t, u = road.curve.locate(points), other.curve.locate(points)
        if a >= len(streets):
            # The connecting road is fitted to the street, whose crown would be a kink in it.
            if not (other.crown.is_zero and _is_nearly_level(other)):
                calm[other.id].append(_interval(u[0]))
            continue
        gap = road.heights(np.clip(t[0], 0.0, road.length), t[1])
        gap = gap - other.heights(np.clip(u[0], 0.0, other.length), u[1])
        if np.abs(gap).max() > STEP_UP_M:
            calm[road.id].append(_interval(t[0]))
            calm[other.id].append(_interval(u[0]))
            narrow = min((a, b), key=lambda k: (_width(stations, k), roads[k].length, k))
            yielding.add(roads[narrow].id)
    return Overlaps(dict(calm), frozenset(yielding))


def _is_nearly_level(road: ModelRoad) -> bool:
    return bool(np.abs(road.bank.at(np.linspace(0.0, road.length, 9))).max() < 1e-3)


def _interval(s: NDArray[np.float64]) -> tuple[float, float]:
    return float(s.min()) - AROUND_M, float(s.max()) + AROUND_M


def _width(stations: Stations, k: int) -> float:
    part = stations.of(k)
    return round(float((stations.left[part] - stations.right[part]).mean()), 2)
