"""Interaction of trams with other traffic, in SUMO's process.

SUMO runs trams on separate rails and ignores crossing traffic. Before every step this finds what is
in a tram's way (vehicles, pedestrians, red signals) and limits its speed, and it finds the vehicles
that must wait for a tram or follow it. Without signals, trams have the right of way.

The file is loaded by its path and imports nothing of UrbanTwin (see ``worker``).
"""

from __future__ import annotations

import math
from typing import Any

import libsumo
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
#: Begin and end of rails ahead, whether a tram needs them, and the position on the tram's path.
_RailZone = tuple[float, float, bool, float]

#: Comfortable and hardest braking, m/s2.
TRAM_BRAKING, TRAM_HARDEST = 1.1, 2.7
CAR_BRAKING, CAR_HARDEST = 3.0, 6.0
#: Half the width of a tram with clearance, and gap to obstacles ahead, metres. In a curve its
#: bodies are chords: its half width grows by this square of length over radius, metres^2.
HALF_M, GAP_M, CHORD_M2 = 1.5, 2.5, 9.0
#: Look-ahead of a tram, metres; others wait for it if it arrives within this time, seconds.
AHEAD_M, COMING_S = 90.0, 6.0
#: Vehicles farther from a tram are ignored, metres.
AROUND_M = 110.0
#: Prediction time of pedestrians, seconds, and their waiting distance from the rails, metres.
EXPECTED_S, KERB_M = 1.2, 1.0
#: Waiting position of vehicles before the rails, metres.
BEFORE_M = 1.0
#: Look-ahead of vehicles for rails, and room that a car needs between two tracks, metres.
WAY_M, ROOM_M = 70.0, 7.0
#: Where no street runs parallel to the rails, a tram that waited this long at a signal proceeds;
#: for a tram that vehicles on its rails have stopped for this long, others no longer wait: their
#: queue can reach the rails. Seconds.
PATIENCE_S = 15.0
#: A tram that has waited for longer than a cycle at a signal also proceeds while all traffic that
#: crosses its rails is stopped, seconds.
LONGEST_CYCLE_S = 120.0
#: Maximum extent of a signalised junction, metres.
JUNCTION_M = 100.0
#: SUMO's checks of a set speed, except that of the maximum deceleration.
SPEED_MODE = 31 - 4
#: SUMO's lane-change modes: no changes beside a tram, and the default.
NO_CHANGE, ANY_CHANGE = 512, 1621


class _Tram:
    """A tram in a step: its path, and the positions of its ends along it."""

    def __init__(self, name: str, tracks: dict[str, Any]) -> None:
        self.name = name
        route = libsumo.vehicle.getRoute(name)
        index = libsumo.vehicle.getRouteIndex(name)
        self.length = libsumo.vehicle.getLength(name)
        self.speed = libsumo.vehicle.getSpeed(name)
        self.nose = np.array(libsumo.vehicle.getPosition(name))
        lane_position_m = libsumo.vehicle.getLanePosition(name)
        first = index
        left_m = self.length + 5.0 - lane_position_m
        while left_m > 0 and first > 0:
            first -= 1
            left_m -= tracks[route[first]][1][-1]
        points: list[Floats] = []
        self.starts: dict[str, float] = {}
        total, k = 0.0, first
        self.front = 0.0
        while k < len(route) and (k <= index or total < self.front + AHEAD_M):
            line, along = tracks[route[k]]
            # Of a track that occurs twice, the part near the front counts.
            self.starts[route[k]] = total
            if k == index:
                self.front = total + lane_position_m
            points.append(line if not points else line[1:])
            total += along[-1]
            k += 1
        self.line = np.vstack(points)
        leg = np.diff(self.line, axis=0)
        self.legs = np.maximum(np.hypot(leg[:, 0], leg[:, 1]), 1e-9)
        self.unit = leg / self.legs[:, None]
        self.along = np.concatenate([[0.0], np.cumsum(self.legs)])
        turn = np.diff(np.unwrap(np.arctan2(self.unit[:, 1], self.unit[:, 0])))
        bend = np.abs(turn) / np.maximum((self.legs[1:] + self.legs[:-1]) / 2, 2.0)
        self.half = HALF_M + CHORD_M2 * np.minimum(np.concatenate([[0.0], bend, [0.0]]), 0.08)
        self.stops = libsumo.vehicle.isStopped(name)
        # Free distance ahead, and the same without crossing traffic, metres.
        self.free = self.room = AHEAD_M

    def locate(self, points: Floats) -> tuple[Floats, Floats]:
        """Return positions along the path and lateral distances of points (M, 2)."""
        rel = points[:, None] - self.line[None, :-1]
        station_m = np.clip((rel * self.unit[None]).sum(axis=2), 0.0, self.legs[None])
        off = rel - station_m[..., None] * self.unit[None]
        away = np.hypot(off[..., 0], off[..., 1])
        best = away.argmin(axis=1)
        rows = np.arange(len(points))
        return self.along[best] + station_m[rows, best], away[rows, best]


class Trams:
    """Controls trams and the traffic around them.

    Args:
        known: result of ``tram_conflicts.tram_conflicts``.
    """

    def __init__(self, known: dict[str, Any]) -> None:
        self.tracks = {}
        for name, points in known.get("tracks", {}).items():
            line = np.array(points, np.float64)
            along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
            self.tracks[name] = line, along
        self.outer = frozenset(known.get("outer", ()))
        self.zones: dict[str, list[Any]] = known.get("zones", {})
        self.on_track: dict[str, list[tuple[str, Any]]] = {}
        for lane, rows in self.zones.items():
            for row in rows:
                self.on_track.setdefault(row[0], []).append((lane, row))
        self.signals: dict[str, list[Any]] = known.get("signals", {})
        self.held: dict[str, float] = {}
        self.blocked: dict[str, float] = {}
        self.passed: dict[str, dict[str, float]] = {}
        self.slowed: set[str] = set()
        self.calmed: set[str] = set()
        self.waiting: set[str] = set()

    def heed(self, step_s: float) -> None:
        """Set speeds for the next step."""
        if not self.tracks:
            return
        now = [
            _Tram(name, self.tracks)
            for name in libsumo.vehicle.getIDList()
            if libsumo.vehicle.getVehicleClass(name) == "tram"
        ]
        seen = [tram for tram in now if not self._is_out(tram.name)]
        names = list(libsumo.vehicle.getIDList())
        places = np.array([libsumo.vehicle.getPosition(name) for name in names]).reshape(-1, 2)
        people = list(libsumo.person.getIDList()) if seen else []
        where = np.array([libsumo.person.getPosition(name) for name in people]).reshape(-1, 2)
        slowed: dict[str, float] = {}
        calmed: set[str] = set()
        waiting: set[str] = set()
        trams = {tram.name for tram in now}
        for tram in seen:
            self._obey_signals(tram, step_s)
            nearby = np.flatnonzero(np.hypot(*(places - tram.nose).T) < AROUND_M)
            in_way = self._vehicles_ahead(tram, [names[k] for k in nearby], trams)
            waiting |= self._people(tram, people, where)
            blocked = bool(in_way) and tram.speed < 0.1 and tram.free < 1.0 and not tram.stops
            self.blocked[tram.name] = self.blocked.get(tram.name, 0.0) + step_s if blocked else 0.0
            reserved = self._reserved(tram)
            for k in nearby.tolist():
                name = names[k]
                if name in trams:
                    continue
                most = self._most(tram, name, reserved, name in in_way)
                if most is not None:
                    slowed[name] = min(slowed.get(name, math.inf), most)
                if name in self._beside(tram, name, places[k]):
                    calmed.add(name)
            allowed = _safe_speed(tram.free, 0.0, TRAM_BRAKING)
            allowed = max(allowed, tram.speed - TRAM_HARDEST * step_s, 0.0)
            libsumo.vehicle.setSpeedMode(tram.name, SPEED_MODE)
            libsumo.vehicle.setSpeed(tram.name, allowed if tram.free < AHEAD_M else -1)
        for name, most in slowed.items():
            least = libsumo.vehicle.getSpeed(name) - CAR_HARDEST * step_s
            libsumo.vehicle.setSpeed(name, max(most, least, 0.0))
        self._release(set(slowed), calmed, waiting)

    def _release(self, slowed: set[str], calmed: set[str], waiting: set[str]) -> None:
        present, walk = set(libsumo.vehicle.getIDList()), set(libsumo.person.getIDList())
        for name in sorted((self.slowed - slowed) & present):
            libsumo.vehicle.setSpeed(name, -1)
        for name in sorted(calmed - self.calmed):
            libsumo.vehicle.setLaneChangeMode(name, NO_CHANGE)
        for name in sorted((self.calmed - calmed) & present):
            libsumo.vehicle.setLaneChangeMode(name, ANY_CHANGE)
        for name in sorted(waiting - self.waiting):
            libsumo.person.setSpeed(name, 0.0)
        for name in sorted((self.waiting - waiting) & walk):
            libsumo.person.setSpeed(name, -1)
        self.slowed, self.calmed, self.waiting = slowed, calmed, waiting

    def _is_out(self, name: str) -> bool:
        if libsumo.vehicle.getRoadID(name) not in self.outer:
            return False
        position_m, length = libsumo.vehicle.getLanePosition(name), libsumo.vehicle.getLength(name)
        lane = libsumo.vehicle.getLaneID(name)
        return bool(position_m > length and libsumo.lane.getLength(lane) - position_m > AHEAD_M)

    def _obey_signals(self, tram: _Tram, step_s: float) -> None:
        """Stop a tram at signals; one that was passed no longer counts on the same junction."""
        held, driven = False, libsumo.vehicle.getDistance(tram.name)
        passed = self.passed.setdefault(tram.name, {})
        for edge, start in tram.starts.items():
            for stop, program, own, foes in self.signals.get(edge, ()):
                ahead = start + stop - tram.front
                if -tram.speed < ahead < 0.0:
                    passed.setdefault(program, driven)
                if not -0.5 < ahead < AHEAD_M:
                    continue
                if driven + ahead < passed.get(program, -math.inf) + JUNCTION_M:
                    continue
                passed.pop(program, None)
                state = libsumo.trafficlight.getRedYellowGreenState(program)
                go = any(state[k] in "Gg" for k in own)
                if own and self.held.get(tram.name, 0.0) > LONGEST_CYCLE_S:
                    go = go or not any(state[k] in "Ggy" for k in foes)
                if not own:
                    go = not any(state[k] in "Gy" for k in foes)
                    if ahead < 3.0 and self.held.get(tram.name, 0.0) > PATIENCE_S:
                        passed[program] = driven
                        go = True
                # A tram that can no longer stop proceeds, as at yellow.
                if go or ahead < tram.speed**2 / (2 * TRAM_BRAKING) - 1.0:
                    held = held or (go and ahead < 3.0 and tram.speed < 0.1)
                    continue
                tram.free = min(tram.free, max(ahead - 0.3, 0.0))
                held = held or ahead < 3.0
        tram.room = tram.free
        self.held[tram.name] = self.held.get(tram.name, 0.0) + step_s if held else 0.0

    def _vehicles_ahead(self, tram: _Tram, names: list[str], trams: set[str]) -> set[str]:
        """Limit a tram's free distance by vehicles in its way; return their names."""
        in_way = set()
        for name in names:
            if name == tram.name:
                continue
            body = self._body(name, name in trams)
            station_m, away = tram.locate(body)
            half = np.interp(station_m, tram.along, tram.half) + (
                libsumo.vehicle.getWidth(name) / 2 - 0.25 if name in trams else 0.0
            )
            inside = (
                (away < half) & (station_m > tram.front - 1.0) & (station_m < tram.front + AHEAD_M)
            )
            if not inside.any():
                continue
            in_way.add(name)
            gap = float(station_m[inside].min()) - tram.front - GAP_M
            # A vehicle driving ahead moves on; a crossing one does not.
            yaw = math.radians(90.0 - libsumo.vehicle.getAngle(name))
            k = int(np.searchsorted(tram.along[:-1], station_m[inside].min(), "right")) - 1
            along = float(tram.unit[k] @ np.array([math.cos(yaw), math.sin(yaw)]))
            speed = libsumo.vehicle.getSpeed(name) * max(along, 0.0)
            if along > 0.9:
                gap = max(gap, 0.0) + speed**2 / (2 * CAR_BRAKING)
                tram.room = min(tram.room, gap)
            tram.free = min(tram.free, max(gap, 0.0))
        return in_way

    def _body(self, name: str, is_tram: bool) -> Floats:
        """Return points (M, 2) around a vehicle, or along the middle of a tram."""
        if is_tram:
            other = _Tram(name, self.tracks)
            station_m = np.linspace(max(other.front - other.length, 0.0), other.front, 24)
            return np.column_stack(
                [np.interp(station_m, other.along, other.line[:, k]) for k in (0, 1)]
            )
        x, y = libsumo.vehicle.getPosition(name)
        yaw = math.radians(90.0 - libsumo.vehicle.getAngle(name))
        length, half = libsumo.vehicle.getLength(name), libsumo.vehicle.getWidth(name) / 2
        back = np.linspace(0.0, length, max(2, int(length)))
        ahead, left = (
            np.array([math.cos(yaw), math.sin(yaw)]),
            np.array([-math.sin(yaw), math.cos(yaw)]),
        )
        middle = np.array([x, y]) - back[:, None] * ahead
        return np.vstack([middle + half * left, middle, middle - half * left])

    def _people(self, tram: _Tram, people: list[str], where: Floats) -> set[str]:
        """Brake for pedestrians on the rails; return those that wait until a tram has passed."""
        nearby = np.flatnonzero(np.hypot(*(where - tram.nose).T) < AROUND_M)
        if not len(nearby):
            return set()
        station_m, away = tram.locate(where[nearby])
        waits = set()
        for k, along, off in zip(nearby.tolist(), station_m.tolist(), away.tolist(), strict=True):
            ahead = along - tram.front
            if off > 4.0 or not -tram.length - 1.0 < ahead < AHEAD_M:
                continue
            name = people[k]
            half = float(np.interp(along, tram.along, tram.half))
            if off < half + 0.1:
                if ahead > -1.0:
                    tram.free = min(tram.free, max(ahead - 2.0, 0.0))
                continue
            yaw = math.radians(90.0 - libsumo.person.getAngle(name))
            step = EXPECTED_S * 1.5
            later = where[k] + step * np.array([math.cos(yaw), math.sin(yaw)])
            closer = float(tram.locate(later[None])[1][0])
            comes = ahead / max(tram.speed, 1.0) < COMING_S and (tram.speed > 0.3 or ahead < 1.0)
            if closer < half + 0.4 and closer < off and comes and off < half + KERB_M:
                waits.add(name)
        return waits

    def _reserved(self, tram: _Tram) -> dict[str, list[Any]]:
        """Return, by lane, the stretches that a tram occupies now or soon."""
        reserved: dict[str, list[Any]] = {}
        if self.blocked.get(tram.name, 0.0) > PATIENCE_S:
            return reserved
        reach = tram.front + min(tram.room, tram.speed * COMING_S + 12.0)
        if tram.stops:
            reach = tram.front
        for edge, start in tram.starts.items():
            for lane, (_, a, b, c, d, together) in self.on_track.get(edge, ()):
                if start + d > tram.front - tram.length - 0.5 and start + c < reach + 1.0:
                    reserved.setdefault(lane, []).append((a, b, start + c, start + d, together))
        return reserved

    def _most(  # noqa: PLR0912 - all effects of a tram on others
        self, tram: _Tram, name: str, reserved: dict[str, list[Any]], in_way: bool
    ) -> float | None:
        """Return the speed limit of a vehicle because of a tram; ``None``: no limit."""
        speed = libsumo.vehicle.getSpeed(name)
        tail = tram.front - tram.length
        most = math.inf
        crossed: list[_RailZone] = []
        for lane, offset in self._way_of(name):
            for a, b, c, d, together in reserved.get(lane, ()):
                if not (together and c < tram.front and offset + b > 0) or in_way:
                    continue
                # Behind a tram: follow its tail.
                gap = offset + a + (tail - c) * (b - a) / max(d - c, 0.1) - GAP_M
                if gap + GAP_M > -0.5:
                    most = min(most, _safe_speed(max(gap, 0.0), tram.speed, CAR_BRAKING))
            taken = [row[:3] for row in reserved.get(lane, ())]
            for row in self.zones.get(lane, ()):
                trams_at = [c for a, b, c in taken if (a, b) == (row[1], row[2])]
                if row[5] and trams_at:
                    continue
                rails = offset + row[1], offset + row[2]
                crossed.append((*rails, bool(trams_at), min(trams_at, default=0.0)))
        if in_way:
            return None if most == math.inf else most
        ahead_m = self._room(name)
        for group in _groups(crossed):
            begin, end = group[0][0], max(row[1] for row in group)
            if begin > 0.3:
                # No vehicle stops on rails: it enters only if all are free and there is room
                # beyond.
                full = ahead_m < end + libsumo.vehicle.getLength(name) + 1.0
                if not full and not any(row[2] for row in group):
                    continue
                if begin - 0.2 > speed**2 / (2.6 * CAR_BRAKING):
                    most = min(most, _safe_speed(max(begin - BEFORE_M, 0.0), 0.0, CAR_BRAKING))
                    continue
            for first, _, is_taken, station_m in group:
                if not is_taken:
                    continue
                if first < 0.3:
                    continue  # already on the rails, where the tram reacts to it
                if first > speed**2 / (2 * CAR_HARDEST):
                    most = min(most, _safe_speed(max(first - BEFORE_M, 0.0), 0.0, CAR_BRAKING))
                elif station_m > tram.front:
                    tram.free = min(tram.free, max(station_m - tram.front - 1.0, 0.0))
        return None if most == math.inf else most

    def _way_of(self, name: str) -> list[tuple[str, float]]:
        """Return the lanes of a vehicle's path with the distance to the start of each."""
        lane = str(libsumo.vehicle.getLaneID(name))
        offset = -float(libsumo.vehicle.getLanePosition(name))
        lanes = [(lane, offset)]
        links: Any = libsumo.vehicle.getNextLinks(name)
        for link in links:
            for following in filter(None, (link[4], link[0])):
                offset += libsumo.lane.getLength(lane)
                if offset > WAY_M:
                    return lanes
                lane = following
                lanes.append((lane, offset))
        return lanes

    def _room(self, name: str) -> float:
        """Return the distance to a standing vehicle ahead, metres; infinite without one."""
        leader = libsumo.vehicle.getLeader(name, WAY_M)
        if not leader or not leader[0] or libsumo.vehicle.getSpeed(leader[0]) > 2.0:
            return math.inf
        return float(leader[1] + libsumo.vehicle.getMinGap(name))

    def _beside(self, tram: _Tram, name: str, place: Floats) -> set[str]:
        """Return the vehicle if it drives beside a tram."""
        station_m, away = tram.locate(place[None])
        ahead = float(station_m[0]) - tram.front
        return {name} if float(away[0]) < 7.0 and -tram.length - 8.0 < ahead < 12.0 else set()


def _groups(rows: list[_RailZone]) -> list[list[_RailZone]]:
    """Return stretches of a path in groups between which there is no room for a car."""
    groups: list[list[_RailZone]] = []
    for row in sorted(rows):
        if row[1] < 0:
            continue
        if groups and row[0] < max(stretch[1] for stretch in groups[-1]) + ROOM_M:
            groups[-1].append(row)
        else:
            groups.append([row])
    return groups


def _safe_speed(gap_m: float, ahead_ms: float, braking: float) -> float:
    """Return the safe speed behind a vehicle that brakes as hard (Gipps), m/s."""
    reaction = braking * 0.5
    return max(
        -reaction + math.sqrt(reaction**2 + ahead_ms**2 + 2 * braking * max(gap_m, 0.0)), 0.0
    )
