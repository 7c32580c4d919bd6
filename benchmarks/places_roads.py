"""The streets of a twin beside what the map says of them: see `measure` for each value.

The twin is read from its files: ``roads.json`` for lanes, crossings and signals, and the raster of
paint on the ground for arrows, which are recognised by their shape.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product
from typing import Any

import numpy as np
import shapely
import shapely.affinity
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from places_map import APPROACH_M, Arrows, Crossing, MappedStreets, Section, Signal
from urbantwin.roads.marking import arrow
from urbantwin.roads.network import Lane
from urbantwin.taxonomy import material_id
from urbantwin.twin import Twin

#: What is mapped nearer to the region's border is not judged, metres.
BORDER_M = 10.0
#: A crossing lies over its street within this of where it is mapped; without one mapped within it,
#: nobody mapped it; metres.
NEAR_CROSSING_M = 8.0
#: A stop line lies within this of a signal that is mapped before a junction, and in its middle.
NEAR_SIGNAL_M, NEAR_JUNCTION_M = 15.0, 30.0
PARALLEL = np.radians(35.0)
#: Lanes are looked for this far beyond the mapped ones, each this wide, metres.
LANE_M, BESIDE_M = 3.3, 1.2
#: Ways through a junction nearer to each other are one lane, metres.
APART_M = 1.8
#: Arrows are looked for over this length before a lane's end, in cells of this side, metres; the
#: arrow of a lane that is too short for one stands where it leads straight on.
ARROW_REACH_M, CELL_M, SHORT_M, STRAIGHT = 22.0, 0.05, 11.0, np.radians(45.0)
#: Lengths of arrows; the shorter ones are read on short lanes alone.
ARROWS_M = (6.0, 5.0, 4.0, 3.0)
WAYS = ("left", "through", "right", "around")
#: `turn:lanes` as the arrow that shows it; merges have arrows of their own and are not judged.
TURN = {
    "left": "left", "slight_left": "left", "sharp_left": "left", "reverse": "around",
    "right": "right", "slight_right": "right", "sharp_right": "right", "through": "through",
}  # fmt: skip


def measure(twin: Twin, streets: MappedStreets) -> dict[str, Any]:
    """Measure a twin's streets.

    Returns:
        ``crossings``, ``signals``, ``lanes``, ``arrows``: found and mapped.
        ``missing_crossings``, ``missing_signals``: where those stand that were not found, site
        frame. ``missing_lanes``: where there are fewer than mapped, how many, of how many.
        ``unmapped_zebras`` of ``zebras``: painted with no mapped crossing near. ``heads``:
        lanes that signals stop and whose signal stands, of all that signals stop.
        ``longest_cycle_s``: of all programs.
        ``wrong_arrows``: what is painted beside what is tagged. ``arrows_without_a_lane``: tagged
        lanes for which the twin has none. ``arrows_within_junctions``: tagged lanes, not judged,
        of a way that a junction of the twin has swallowed, behind others that are tagged.
    """
    inside = twin.region.buffer(-BORDER_M)
    shapely.prepare(inside)
    crossings = streets.crossings()
    here = [one for one in crossings if inside.contains(shapely.Point(one.x, one.y))]
    lanes = [lane for lane in twin.roads.lanes if lane.kind == "crossing"]
    missing = [one for one in here if not _has_crossing(one, lanes)]
    places = shapely.multipoints(np.array([[one.x, one.y] for one in crossings]).reshape(-1, 2))
    zebras = [lane for lane in lanes if inside.intersects(lane.polygon)]
    unmapped = [
        lane for lane in zebras if not crossings or lane.polygon.distance(places) > NEAR_CROSSING_M
    ]
    signals = [one for one in streets.signals() if inside.contains(shapely.Point(one.x, one.y))]
    unsignalled = [one for one in signals if not _has_stop_line(one, twin)]
    stopped = {head.lane for head in twin.roads.signals}
    stopped = {name for name in stopped if twin.roads.lane_by_id[name].kind != "crossing"}
    shown = {strip for one in twin.lane_model.signals if one.dynamic for strip in one.strip.split()}
    found, mapped, lacking = 0, 0, []
    driven, through = _DrivenLanes(twin), _DrivenLanes(twin, within_junctions=True)
    for section in streets.sections():
        if inside.contains(shapely.Point(section.x, section.y)):
            there = _side_by_side([*driven.across(section), *through.across(section)])
            mapped += section.lanes
            found += min(section.lanes, there)
            if there < section.lanes:
                lacking.append([round(section.x, 1), round(section.y, 1), there, section.lanes])
    return {
        "crossings": [len(here) - len(missing), len(here)],
        "missing_crossings": [[round(one.x, 1), round(one.y, 1)] for one in missing],
        "zebras": len(zebras),
        "unmapped_zebras": len(unmapped),
        "unmapped_zebra_ids": [lane.id for lane in unmapped],
        "signals": [len(signals) - len(unsignalled), len(signals)],
        "missing_signals": [[round(one.x, 1), round(one.y, 1)] for one in unsignalled],
        "heads": [len(stopped & shown), len(stopped)],
        "lanes": [found, mapped],
        "missing_lanes": lacking,
        "longest_cycle_s": max(
            (sum(seconds for seconds, _ in one.phases) for one in twin.roads.programs), default=0.0
        ),
        **_arrows(twin, streets, driven, inside),
    }


def _has_crossing(one: Crossing, lanes: list[Lane]) -> bool:
    """Whether a crossing lies over the mapped one's street, near it."""
    near = shapely.intersection(one.street, shapely.Point(one.x, one.y).buffer(NEAR_CROSSING_M))
    return any(lane.polygon.buffer(0.5).intersects(near) for lane in lanes)


def _has_stop_line(one: Signal, twin: Twin) -> bool:
    """Whether vehicles are stopped near a mapped signal, going a way that it is for.

    The signal of a crossing is there, too, if a signalised crossing is.
    """
    here = shapely.Point(one.x, one.y)
    for head in twin.roads.signals:
        lane = twin.roads.lane_by_id[head.lane]
        if lane.kind == "crossing":
            # Traffic that leaves a junction is held by the signals of its entries.
            if one.is_crossing and lane.polygon.distance(here) <= NEAR_CROSSING_M:
                return True
            continue
        away = float(np.hypot(head.x - one.x, head.y - one.y))
        if one.is_junction and away <= NEAR_JUNCTION_M:
            return True
        if away <= NEAR_SIGNAL_M and any(_turn(head.yaw, x) < PARALLEL for x in one.headings):
            return True
    return False


def _turn(a: float, b: float) -> float:
    return float(abs((a - b + np.pi) % (2 * np.pi) - np.pi))


def _side_by_side(found: list[tuple[float, Lane]]) -> int:
    """How many lanes lie side by side: ways through a junction may begin or end in one lane."""
    count, last = 0, -np.inf
    for aside, _ in sorted(found, key=lambda one: one[0]):
        if aside - last > APART_M:
            count, last = count + 1, aside
    return count


class _DrivenLanes:
    """The lanes that cars or buses use outside junctions, or their ways through junctions."""

    def __init__(self, twin: Twin, *, within_junctions: bool = False) -> None:
        kinds = ("connection",) if within_junctions else ("driving", "bus")
        self.lanes = [
            lane
            for lane in twin.roads.lanes
            if lane.kind in kinds and bool(lane.junction) == within_junctions
        ]
        self._tree = shapely.STRtree([shapely.LineString(x.centre[:, :2]) for x in self.lanes])

    def across(self, section: Section, *, one_way: bool = False) -> list[tuple[float, Lane]]:
        """Lanes parallel to a section within its width: how far to the left each is, and it.

        Args:
            section: where.
            one_way: only lanes that run as the section does.
        """
        left = np.array([-np.sin(section.heading), np.cos(section.heading)])
        here = np.array([section.x, section.y])
        reach = section.lanes * LANE_M / 2 + BESIDE_M
        line = shapely.LineString([here - reach * left, here + reach * left])
        found = []
        for number in self._tree.query(line, predicate="intersects"):
            lane = self.lanes[number]
            centre = shapely.LineString(lane.centre[:, :2])
            point = np.array(shapely.get_coordinates(centre.intersection(line))[0])
            at = centre.project(shapely.Point(point))
            a, b = (np.array(centre.interpolate(s).coords[0]) for s in (max(at - 0.5, 0), at + 0.5))
            turn = _turn(float(np.arctan2(*(b - a)[::-1])), section.heading)
            if turn < PARALLEL or (not one_way and turn > np.pi - PARALLEL):
                found.append((float((point - here) @ left), lane))
        return sorted(found, key=lambda one: -one[0])


def _arrows(
    twin: Twin, streets: MappedStreets, driven: _DrivenLanes, inside: shapely.Polygon
) -> dict[str, Any]:
    right, tagged, lost, extra, within, wrong = 0, 0, 0, 0, 0, []
    for one in streets.arrows():
        if not inside.contains(shapely.Point(one.line[-1])):
            continue
        lanes = _lanes_before(one, driven, twin.roads.driving_side)
        judged = [turns for turns in one.lanes if turns and turns <= TURN.keys()]
        if lanes is None and one.tagged_before:
            within += len(judged)
            continue
        tagged += len(judged)
        if lanes is None:
            lost += len(judged)
            continue
        for turns, lane in zip(one.lanes, lanes, strict=True):
            seen = painted_arrow(twin, lane)
            if not turns:
                extra += bool(seen)
                continue
            if not turns <= TURN.keys():
                continue
            expected = tuple(way for way in WAYS if way in {TURN[turn] for turn in turns})
            right += seen == expected
            if seen != expected:
                wrong.append(
                    f"{lane.id}: {'+'.join(seen) or 'nothing'}, tagged {';'.join(sorted(turns))}"
                )
    return {
        "arrows": [right, tagged],
        "wrong_arrows": wrong,
        "arrows_without_a_lane": lost,
        "arrows_within_junctions": within,
        "arrows_where_none_is_tagged": extra,
    }


def _lanes_before(one: Arrows, driven: _DrivenLanes, side: str) -> list[Lane] | None:
    """The lanes of tagged turns, left to right, as near to their end as there are any.

    Where their way lies within a junction of the twin, those of the street that leads there, unless
    that has turns of its own.
    """
    line = shapely.LineString(one.line)
    count = len(one.lanes)
    reach = line.length
    if not one.tagged_before and len(one.before):
        line = shapely.LineString(np.concatenate([one.before[:-1], one.line]))
        reach = min(line.length, reach + APPROACH_M)
    for back in np.arange(3.0, max(reach, 3.5), 3.0):
        here, ahead = (line.interpolate(max(line.length - b, 0.0)) for b in (back, back - 0.5))
        heading = float(np.arctan2(ahead.y - here.y, ahead.x - here.x))
        # Of a street of two directions, the way runs in the middle, or nearly.
        lanes = count if one.is_one_way else 2 * count + 2
        section = Section(here.x, here.y, heading, lanes)
        found = driven.across(section, one_way=True)
        if not one.is_one_way:
            found = found[-count:] if side == "right" else found[:count]
        if len(found) == count:
            return [lane for _, lane in found]
    return None


def painted_arrow(twin: Twin, lane: Lane) -> tuple[str, ...]:
    """Which arrow is painted before a lane's end, by the paint's shape; empty where none is.

    The arrow's own shapes, one for each combination of turns, are moved along the lane over the
    raster of paint; the one whose cells agree best is read, if two thirds of them do.
    """
    read = _read(_paint_before(twin, _driven_line(twin, lane), lane.width), lane)
    if not read and lane.length < SHORT_M and lane.id not in {h.lane for h in twin.roads.signals}:
        ahead = _driven_line(twin, lane, beyond=True)
        read = _read(_paint_before(twin, ahead, lane.width), lane)
    return read


def _read(image: NDArray[np.float64], lane: Lane) -> tuple[str, ...]:
    """The arrow in an image of a lane's paint."""
    if not image.any():
        return ()
    best, read = 0.66, ()
    for ways, length in product(_combinations(), ARROWS_M):
        shape = _template(ways, lane.width, length)
        if shape.shape[0] > image.shape[0] or (length < ARROWS_M[0] and lane.length > SHORT_M):
            continue
        hit = fftconvolve(image, shape[::-1, ::-1], mode="same")
        ones = fftconvolve(image, np.ones_like(shape), mode="same")
        agree = float((hit / np.maximum(shape.sum() + ones - hit, 1.0)).max())
        if agree > best:
            best, read = agree, ways
    return read


def _paint_before(twin: Twin, line: shapely.LineString, width: float) -> NDArray[np.float64]:
    """An image of the paint before a line's end, along by across, lane marks left out."""
    length = min(ARROW_REACH_M, line.length)
    along = np.arange(line.length - length, line.length, CELL_M)
    half = width / 2 - 0.2
    across = np.arange(-half, half, CELL_M)
    middle = shapely.get_coordinates(shapely.line_interpolate_point(line, along))
    step = shapely.get_coordinates(shapely.line_interpolate_point(line, along + 0.01))
    back = shapely.get_coordinates(shapely.line_interpolate_point(line, along - 0.01))
    ahead = (step - back) / np.maximum(np.linalg.norm(step - back, axis=1, keepdims=True), 1e-9)
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    cells = middle[:, None] + across[None, :, None] * left[:, None]
    image = np.zeros(cells.shape[:2])
    for layer in twin.surface_materials.layers:
        if layer.material == material_id("road-paint"):
            image += layer.covers(cells.reshape(-1, 2)).reshape(image.shape)
    return np.minimum(image, 1.0)


def _driven_line(twin: Twin, lane: Lane, *, beyond: bool = False) -> shapely.LineString:
    """What one drives before a lane's end, from the lane that leads straight into a short one.

    ``beyond``: to the end of the lane that it leads straight on to.
    """
    points = lane.centre[:, :2]
    if lane.length < ARROW_REACH_M:
        points = np.vstack([*_straight(twin, lane, ahead=False), points])
    if beyond:
        points = np.vstack([points, *_straight(twin, lane, ahead=True)])
    return shapely.LineString(points)


def _straight(twin: Twin, lane: Lane, *, ahead: bool) -> list[NDArray[np.float64]]:
    """The way that leads most nearly straight on through a junction, and the lane beyond it."""
    known, found = twin.roads.lane_by_id, []
    for way in twin.roads.lanes:
        after = [known[name] for name in way.successors if name in known]
        before = [x for x in twin.roads.lanes if way.id in x.successors]
        near, far = (before, after) if ahead else (after, before)
        if way.kind != "connection" or lane.id not in {x.id for x in near} or not far:
            continue
        beyond = far[0]
        legs = np.diff(way.centre[:, :2], axis=0)[[0, -1]]
        turn = _turn(*(float(np.arctan2(leg[1], leg[0])) for leg in legs))
        if turn < STRAIGHT and not beyond.junction:
            found.append((turn, way.id, way, beyond))
    if not found:
        return []
    _, _, way, beyond = min(found, key=lambda one: one[:2])
    parts = [way.centre[:, :2], beyond.centre[:, :2]]
    return parts if ahead else parts[::-1]


def _combinations() -> Iterator[tuple[str, ...]]:
    for count in range(1, len(WAYS) + 1):
        yield from combinations(WAYS, count)


def _template(ways: tuple[str, ...], width: float, length: float) -> NDArray[np.float64]:
    """The cells of an arrow, along by across."""
    wide = 6.0 * min(width / 3.0, 1.15) * (1.0 if length == ARROWS_M[0] else 0.9)
    shape = shapely.affinity.scale(arrow(ways), length, wide, origin=(0, 0))
    x = np.arange(-length + CELL_M / 2, 0.0, CELL_M)
    y = np.arange(-1.5, 1.5, CELL_M)
    return shapely.contains_xy(shape, *np.meshgrid(x, y, indexing="ij")).astype(np.float64)
