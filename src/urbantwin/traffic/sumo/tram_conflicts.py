"""Where trams and the rest of traffic meet: what ``trams`` has to know of rails and lanes.

Rails are a part of SUMO's network by themselves, so SUMO knows of no tram in the way of a car. Here
it is found on which stretches of lanes somebody would be touched by a tram, and which signals a
tram obeys.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

from urbantwin.geometry import stations_of_points
from urbantwin.roads import RoadNetwork, Track

__all__ = ["tram_conflicts"]

#: Half the width of a tram, of a bus, and room between them, metres.
REACH_M = 1.2 + 1.25 + 0.15
#: In a bend the bodies of a tram are chords: by half a square of their length over the radius,
#: metres^2, it is wider; rails bend no more than this, 1/m.
CHORD_M2, SHARPEST_PER_M = 9.0, 0.08
#: Lanes are looked at so often, metres.
STEP_M = 0.5
#: Where a lane runs with the rails by less than this, a tram is somebody who drives ahead.
SHARED_COS = float(np.cos(np.radians(25.0)))
#: A tram obeys the signal of a lane that runs with it, so far beside it at most; at others it stops
#: so far before whatever crosses its way, metres.
BESIDE_M, BEFORE_M = 9.0, 3.0
#: Two signals of one program nearer to each other than this are one place to stop, metres.
SAME_M = 25.0


def tram_conflicts(net_path: Path, roads: RoadNetwork | None) -> dict[str, Any]:
    """Return what ``trams.Trams`` takes; empty where there are no rails.

    - ``tracks``: edge -> points (N, 2) of the track's line;
    - ``zones``: lane of a street -> rows of the track's edge, from where to where along the lane
      and along the track, and whether both run together there;
    - ``signals``: edge of a track -> rows of where the front has to stop, the program, the links
      that let it go while one of them is green, and those that must not be green.
    """
    if roads is None or not roads.tracks:
        return {}
    inner = [track for track in roads.tracks if not track.outer]
    zones: defaultdict[str, list[Any]] = defaultdict(list)
    for lane in roads.lanes:
        if lane.kind not in ("driving", "bus", "bicycle", "connection", "crossing"):
            continue
        for track in inner:
            if track.level == lane.level:
                zones[lane.id] += _zones(lane.centre[:, :2], track)
    links = _links(net_path)
    return {
        "tracks": {track.id: np.round(track.line[:, :2], 3).tolist() for track in roads.tracks},
        "outer": sorted(track.id for track in roads.tracks if track.outer),
        "zones": {
            lane.id: zones[lane.id]
            for lane in roads.lanes
            if zones[lane.id] and lane.kind != "crossing"
        },
        "signals": {
            track.id: rows for track in inner if (rows := _signals(track, roads, zones, links))
        },
    }


def _zones(line: NDArray[np.float64], track: Track) -> list[list[Any]]:
    """Return the stretches of a lane's line that a tram on a track reaches to."""
    rails, whole = shapely.LineString(track.line[:, :2]), shapely.LineString(line)
    if rails.distance(whole) > REACH_M + CHORD_M2 * SHARPEST_PER_M:
        return []
    at = np.linspace(0.0, whole.length, max(2, int(np.ceil(whole.length / STEP_M)) + 1))
    points = shapely.line_interpolate_point(whole, at)
    on_rails = shapely.line_locate_point(rails, points)
    swept = CHORD_M2 * np.interp(on_rails, *_bend(track.line[:, :2]))
    near = shapely.distance(rails, points) <= REACH_M + swept
    found = []
    for run in np.split(np.arange(len(at)), np.flatnonzero(np.diff(near)) + 1):
        if not near[run[0]]:
            continue
        a, b = at[run[[0, -1]]]
        c, d = on_rails[run].min(), on_rails[run].max()
        along = np.diff(on_rails[run]) / max(float(at[1]), 1e-9)
        together = len(along) > 0 and bool(np.mean(along > SHARED_COS) > 0.9)
        found.append([track.id, *np.round([a, b, c, d], 2).tolist(), together])
    return found


def _bend(line: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the stations (N,) of a line's points and the curvature (N,) there, 1/m."""
    leg = np.diff(line, axis=0)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(leg[:, 1], leg[:, 0]))))
    length = np.maximum(np.linalg.norm(leg, axis=1), 1e-9)
    bend = turn / np.maximum((length[1:] + length[:-1]) / 2, 2.0)
    return stations_of_points(line), np.concatenate([[0.0], bend, [0.0]]).clip(0, SHARPEST_PER_M)


def _links(net_path: Path) -> list[dict[str, Any]]:
    """Return the connections that signals govern."""
    root = etree.parse(net_path).getroot()
    return [
        {
            "program": item.get("tl"),
            "link": int(item.get("linkIndex")),
            "lane": f"{item.get('from')}_{item.get('fromLane')}",
            "via": item.get("via") or f"{item.get('to')}_{item.get('toLane')}",
            "straight": item.get("dir") == "s",
        }
        for item in root.iterfind("connection")
        if item.get("tl")
    ]


def _signals(
    track: Track,
    roads: RoadNetwork,
    zones: dict[str, list[Any]],
    links: Sequence[dict[str, Any]],
) -> list[list[Any]]:
    """Return where a tram on a track stops for signals."""
    rails = shapely.LineString(track.line[:, :2])
    crossing: defaultdict[str, list[tuple[float, float, int]]] = defaultdict(list)
    beside: defaultdict[str, list[tuple[float, float, int]]] = defaultdict(list)
    for link in links:
        via, lane = link["via"], roads.lane_by_id.get(link["lane"])
        for name, _, _, first, last, together in zones.get(via, ()):
            if name == track.id and not together:
                crossing[link["program"]].append((first, last, link["link"]))
        if lane is None or lane.kind not in ("driving", "bus") or not link["straight"]:
            continue
        end, before = lane.centre[-1, :2], lane.centre[-2, :2]
        at = rails.project(shapely.Point(end))
        away = rails.distance(shapely.Point(end))
        if away > BESIDE_M or not 0.5 < at < rails.length - 0.5:
            continue
        ahead = shapely.get_coordinates(rails.interpolate([at - 0.5, at + 0.5]))
        turn = np.diff(ahead, axis=0)[0] @ (end - before)
        if turn > SHARED_COS * np.linalg.norm(np.diff(ahead, axis=0)) * np.linalg.norm(
            end - before
        ):
            beside[link["program"]].append((float(away), float(at), link["link"]))
    found = []
    for program in sorted(crossing.keys() | beside.keys()):
        rows = sorted(crossing[program])
        own = sorted(beside[program])
        if own:
            near = [
                one for one in own if abs(one[1] - own[0][1]) < SAME_M and one[0] < own[0][0] + 4
            ]
            stop = own[0][1] - 0.5
            found.append([round(stop, 2), program, sorted({x[2] for x in near}), []])
        elif rows and (stop := rows[0][0] - BEFORE_M) > 1.0:
            found.append([round(stop, 2), program, [], sorted({row[2] for row in rows})])
    return sorted(found)
