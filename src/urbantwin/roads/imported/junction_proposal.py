"""Proposal of a junction of an imported map for a twin, and of its traffic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import area_union
from urbantwin.roads.imported.crop import cropped, middle_of_junction
from urbantwin.roads.model import LaneModel, ModelJunction, ModelRoad
from urbantwin.site.junction_proposal import STREETS
from urbantwin.site.usual_traffic import usual_per_hour

__all__ = ["MapJunction", "busiest_junction", "paved_area", "volumes"]

#: Weight of a street of unknown class, and of other roads.
UNKNOWN_WEIGHT, OTHER_WEIGHT = 3.0, 0.3
#: Assumed class of such a street for its traffic, and pedestrians per hour if there are sidewalks.
UNKNOWN_KIND, WALKERS = "secondary", 300.0
#: Signals belong to a junction if they are on its connecting roads or within this distance of it on
#: a street, metres.
SIGNAL_M = 40.0
#: Weights of junctions with fewer than three arms, where streets only fork or merge.
FEW_ARMS = {0: 0.02, 1: 0.05, 2: 0.2}
#: Junctions within this distance of the map's border get a lower score, metres.
RIM_M = 100.0
MOTOR = ("driving", "bus")


@dataclass(frozen=True)
class MapJunction:
    """A candidate junction for a twin.

    Attributes:
        place: its centre, in the coordinates of the model, metres.
        names: names of its streets, the most important first; empty if unnamed.
        arms: number of streets that meet there.
        signals: number of its traffic lights.
    """

    place: tuple[float, float]
    names: tuple[str, ...]
    arms: int
    signals: int


def busiest_junction(
    model: LaneModel, within: Callable[[NDArray[np.float64]], bool] | None = None
) -> MapJunction | None:
    """Return the junction with the most lanes of important streets; signals increase its score.

    Without junctions, it is the middle of the longest street.

    Args:
        model: the lane model, in any plane coordinates.
        within: whether a junction with its centre at x, y is considered.

    Returns:
        The junction; ``None`` if none is considered.
    """
    border = _covered(model)
    signals = _signals_at(model)
    candidates = []
    for junction in model.junctions:
        place = middle_of_junction(model, junction)
        if not np.isfinite(place).all():
            continue
        if within is not None and not within(place):
            continue
        arms = [model.road_by_id[k] for k in sorted(_arms(junction, model))]
        busy = sum(_weight(road) * _lanes(road) ** 0.5 for road in arms)
        lights = signals.get(junction.id, 0)
        score = busy * FEW_ARMS.get(len(arms), 1.0) * (1.0 + 0.1 * min(lights, 8))
        score *= 2.0 if lights else 1.0
        # At the map's border the surroundings are missing.
        score *= 0.5 + 0.5 * min(1.0, _depth(place, border) / RIM_M)
        ranked = sorted(arms, key=lambda road: (-_weight(road) * _lanes(road), road.name))
        names = tuple(dict.fromkeys(road.name for road in ranked if road.name))
        x, y = (float(v) for v in place)
        candidates.append((score, x, y, MapJunction((x, y), names, len(arms), lights)))
    if candidates:
        return max(candidates, key=lambda item: item[:3])[3]
    return None if within is not None else _longest_street(model)


def paved_area(model: LaneModel) -> shapely.Geometry:
    """Return the paved area of the roads in plan."""
    areas = []
    for road in model.roads:
        for section, end in zip(road.sections, road.section_ends, strict=True):
            lanes = [
                lane for lane in section.lanes if lane.kind not in ("sidewalk", "curb", "none")
            ]
            if not lanes or end - section.s < 1e-3:
                continue
            s = np.linspace(section.s, end, max(2, int((end - section.s) / 2) + 2))
            borders = np.array(
                [
                    road.border(section, lane, s, outer=outer)
                    for lane in lanes
                    for outer in (False, True)
                ]
            )
            sides = [road.place(s, t)[:, :2] for t in (borders.max(axis=0), borders.min(axis=0))]
            areas.append(shapely.make_valid(shapely.Polygon(np.vstack([sides[0], sides[1][::-1]]))))
    return area_union(areas)


def volumes(model: LaneModel, region: shapely.Polygon, country: str = "") -> dict[str, int]:
    """Return plausible traffic volumes per hour, by the lanes that lead into a region.

    There are no pedestrians without sidewalks.

    Args:
        model: the lane model, in the site frame.
        region: the region, site frame.
        country: ISO 3166-1 alpha-2; empty if unknown.
    """
    inside = cropped(model, region)
    lanes: Counter[str] = Counter()
    walks = False
    for road in inside.roads:
        for link, section, leads_in in (
            (road.predecessor, road.sections[0], True),
            (road.successor, road.sections[-1], False),
        ):
            if link is None and road.junction < 0:
                motor = sum(
                    lane.kind in MOTOR and lane.forward == leads_in for lane in section.lanes
                )
                lanes[road.kind or UNKNOWN_KIND] += motor
        walks |= any(lane.kind == "sidewalk" for section in road.sections for lane in section.lanes)
    per_hour = usual_per_hour(lanes, country=country, walkers=WALKERS if walks else 0.0)
    return {name: count for name, count in per_hour.items() if count}


def _arms(junction: ModelJunction, model: LaneModel) -> set[int]:
    """Return the ids of the streets that meet at a junction."""
    arms = {c.incoming for c in junction.connections}
    for connection in junction.connections:
        road = model.road_by_id.get(connection.connecting)
        for link in (road.predecessor, road.successor) if road else ():
            if link and link.element == "road":
                arms.add(link.id)
    return {k for k in arms if k in model.road_by_id and model.road_by_id[k].junction < 0}


def _weight(road: ModelRoad) -> float:
    if not road.kind:
        return UNKNOWN_WEIGHT
    return STREETS.get(road.kind, (OTHER_WEIGHT, 1))[0]


def _lanes(road: ModelRoad) -> float:
    counts = [sum(lane.kind in MOTOR for lane in section.lanes) for section in road.sections]
    return float(max(counts, default=0))


def _signals_at(model: LaneModel) -> dict[int, int]:
    signals_of: dict[int, int] = {}
    for signal in model.signals:
        road = model.road_by_id.get(signal.road)
        if not signal.dynamic or road is None:
            continue
        if road.junction >= 0:
            signals_of[road.junction] = signals_of.get(road.junction, 0) + 1
            continue
        ends = ((signal.s, road.predecessor), (road.length - signal.s, road.successor))
        junctions = [
            link.id
            for distance_m, link in sorted(ends, key=lambda item: item[0])
            if distance_m <= SIGNAL_M and link and link.element == "junction"
        ]
        for junction in junctions[:1]:
            signals_of[junction] = signals_of.get(junction, 0) + 1
    for controller in model.controllers:
        for junction in controller.junctions:
            signals_of.setdefault(junction, len(controller.signals))
    return signals_of


def _covered(model: LaneModel) -> shapely.Geometry:
    """Return the convex hull of the map's roads."""
    return shapely.convex_hull(shapely.union_all([road.curve.line for road in model.roads]))


def _depth(place: NDArray[np.float64], area: shapely.Geometry) -> float:
    return float(shapely.distance(shapely.boundary(area), shapely.Point(place)))


def _longest_street(model: LaneModel) -> MapJunction | None:
    streets = [road for road in model.roads if road.junction < 0 and _lanes(road) > 0]
    if not streets:
        return None
    road = max(streets, key=lambda item: (item.length, -item.id))
    x, y = (float(v) for v in road.curve.at([road.length / 2])[0, :2])
    return MapJunction((x, y), (road.name,) if road.name else (), 2, 0)
