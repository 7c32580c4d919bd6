"""Conflicts of trams with other traffic: the input of ``trams`` about rails and lanes.

Rails are a separate part of SUMO's network, so that SUMO ignores trams that cross the path of a
car. This finds the stretches of lanes on which a tram would touch a vehicle, and the signals that a
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

#: Half the width of a tram, of a bus, and the gap between them, metres.
REACH_M = 1.2 + 1.25 + 0.15
#: In a curve the bodies of a tram are chords: its half width grows by this square of length over
#: radius, metres^2; curvature of rails is limited to the second, 1/m.
CHORD_M2, SHARPEST_PER_M = 9.0, 0.08
#: Spacing of the points along lanes that are checked, metres.
STEP_M = 0.5
#: Angle between lane and rails below which a tram counts as traffic ahead on the lane.
SHARED_COS = float(np.cos(np.radians(25.0)))
#: Maximum distance of a parallel lane whose signal a tram obeys; at other signals it stops this far
#: before the first conflict, metres.
BESIDE_M, BEFORE_M = 9.0, 3.0
#: Signals of one program that are nearer to each other than this are one stop, metres.
SAME_M = 25.0


def tram_conflicts(net_path: Path, roads: RoadNetwork | None) -> dict[str, Any]:
    """Return the input of ``trams.Trams``; empty without rails.

    - ``tracks``: edge -> points (N, 2) of the track's line;
    - ``outer``: edges of outer tracks;
    - ``zones``: lane of a street -> rows of the track's edge, begin and end along the lane and
      along the track, and whether both run together there;
    - ``signals``: edge of a track -> rows of the stop position of the front, the program, the links
      of which one must be green, and those that must not be green.
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
    """Return the stretches of a lane's line that a tram on a track reaches."""
    rails, whole = shapely.LineString(track.line[:, :2]), shapely.LineString(line)
    if rails.distance(whole) > REACH_M + CHORD_M2 * SHARPEST_PER_M:
        return []
    station_m = np.linspace(0.0, whole.length, max(2, int(np.ceil(whole.length / STEP_M)) + 1))
    points = shapely.line_interpolate_point(whole, station_m)
    on_rails = shapely.line_locate_point(rails, points)
    swept = CHORD_M2 * np.interp(on_rails, *_curvature(track.line[:, :2]))
    is_near = shapely.distance(rails, points) <= REACH_M + swept
    zones = []
    for run in np.split(np.arange(len(station_m)), np.flatnonzero(np.diff(is_near)) + 1):
        if not is_near[run[0]]:
            continue
        a, b = station_m[run[[0, -1]]]
        c, d = on_rails[run].min(), on_rails[run].max()
        along = np.diff(on_rails[run]) / max(float(station_m[1]), 1e-9)
        together = len(along) > 0 and bool(np.mean(along > SHARED_COS) > 0.9)
        zones.append([track.id, *np.round([a, b, c, d], 2).tolist(), together])
    return zones


def _curvature(line: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the stations (N,) of a line's points and the curvature (N,) there, 1/m."""
    leg = np.diff(line, axis=0)
    turn = np.abs(np.diff(np.unwrap(np.arctan2(leg[:, 1], leg[:, 0]))))
    length = np.maximum(np.linalg.norm(leg, axis=1), 1e-9)
    bend = turn / np.maximum((length[1:] + length[:-1]) / 2, 2.0)
    return stations_of_points(line), np.concatenate([[0.0], bend, [0.0]]).clip(0, SHARPEST_PER_M)


def _links(net_path: Path) -> list[dict[str, Any]]:
    """Return the connections that signals control."""
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
    """Return the stops of a tram on a track at signals."""
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
        station_m = rails.project(shapely.Point(end))
        away = rails.distance(shapely.Point(end))
        if away > BESIDE_M or not 0.5 < station_m < rails.length - 0.5:
            continue
        ahead = shapely.get_coordinates(rails.interpolate([station_m - 0.5, station_m + 0.5]))
        turn = np.diff(ahead, axis=0)[0] @ (end - before)
        if turn > SHARED_COS * np.linalg.norm(np.diff(ahead, axis=0)) * np.linalg.norm(
            end - before
        ):
            beside[link["program"]].append((float(away), float(station_m), link["link"]))
    stops = []
    for program in sorted(crossing.keys() | beside.keys()):
        rows = sorted(crossing[program])
        own = sorted(beside[program])
        if own:
            same_stop = [
                signal
                for signal in own
                if abs(signal[1] - own[0][1]) < SAME_M and signal[0] < own[0][0] + 4
            ]
            stop = own[0][1] - 0.5
            foes = sorted({row[2] for row in rows})
            stops.append([round(stop, 2), program, sorted({x[2] for x in same_stop}), foes])
        elif rows and (stop := rows[0][0] - BEFORE_M) > 1.0:
            stops.append([round(stop, 2), program, [], sorted({row[2] for row in rows})])
    return sorted(stops)
