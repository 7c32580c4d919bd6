"""Events that others react to: staged within SUMO, next to the same traffic without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from urbantwin.errors import StageError
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.assets import asset, asset_names
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.events.lane_way import lane_way
from urbantwin.traffic.events.places import Spot, find_spot
from urbantwin.traffic.events.scenario import (
    Collision,
    Convoy,
    Debris,
    EmergencyVehicle,
    Event,
    HardBrake,
    PlacedEvent,
    StalledVehicle,
    WorkZone,
)
from urbantwin.traffic.events.things import DEBRIS
from urbantwin.traffic.sumo.simulation import Simulated
from urbantwin.twin import Twin

__all__ = [
    "REACTING",
    "NotStagedError",
    "Plan",
    "Reaction",
    "changed_from",
    "everybody",
    "plan_events",
    "reactions",
    "spliced",
]

#: Events that SUMO's vehicles take part in, and the reason if one cannot be staged.
REACTING = {
    "hard_brake": "no vehicle drove past the place",
    "collision": "no two vehicles drove one close behind the other at the place",
    "red_light_running": "no vehicle came to a red signal at the end of the lane",
    "stalled_vehicle": "no vehicle came to the place",
    "emergency_vehicle": "there was no room to come in",
    "convoy": "there was no room to come in",
    "work_zone": "the lane was never free there",
    "debris": "the lane was never free there",
}
#: Length of the route of vehicles that enter for an event, before and beyond the place, metres.
_ROUTE_BEFORE_M, _ROUTE_BEYOND_M = 150.0, 200.0
#: Duration over which differences fade out where the motion changes into the one with events,
#: seconds.
_FADE_S = 2.0
#: Maximum width of a work zone, metres.
_MAX_WORK_ZONE_WIDTH_M = 2.0


class NotStagedError(StageError):
    """An event could not be staged.

    Attributes:
        number: number of the event in its scenario.
    """

    def __init__(self, problem: str, number: int) -> None:
        super().__init__(problem)
        self.number = number


@dataclass(frozen=True)
class Plan:
    """The events that SUMO is to stage.

    Attributes:
        rows: one entry per event, in the form of ``staging``; times from SUMO's start.
        added: trips of vehicles that enter for an event, numbered after the demand's.
        spots: position of each event, by its number.
    """

    rows: tuple[dict[str, Any], ...]
    added: tuple[Trip, ...]
    spots: dict[int, Spot]


@dataclass(frozen=True, eq=False)
class Reaction:
    """The outcome of an event within SUMO; times are the motion's.

    Attributes:
        number: number of the event in its scenario.
        event: the event.
        trips: trips of its actors, the main one first.
        from_s: begin of the event.
        until_s: end of the event.
        told: further results.
    """

    number: int
    event: Event
    trips: tuple[int, ...]
    from_s: float
    until_s: float
    told: dict[str, Any]


def plan_events(
    events: Sequence[tuple[int, Event]], twin: Twin, demand: Demand, start_s: float
) -> Plan:
    """Return the events in the form that SUMO's process stages.

    Args:
        events: number of each in its scenario, and the event.
        twin: the twin.
        demand: trips without the events.
        start_s: SUMO's time at which the motion starts.

    Raises:
        StageError: a place is not on a lane of a street.
    """
    rows, spots = [], {}
    added: list[Trip] = []
    for number, event in events:
        assert isinstance(event, PlacedEvent)
        spot = find_spot(event.place, twin, event.users)
        if not spot.lane.road:
            raise StageError(
                f"{event.event} at {event.at_s:g} s cannot be staged: its place is in a junction, "
                "and it needs a lane of a street"
            )
        spots[number] = spot
        row: dict[str, Any] = {
            "number": number,
            "event": event.event,
            "at_s": round(start_s + event.at_s, 6),
            "within_s": event.within_s,
            "lane": spot.lane.id,
            "lanes": _usable_lanes(event, spot, twin),
            "along_m": round(spot.along_m, 3),
        }
        if isinstance(event, HardBrake):
            row |= {"deceleration": event.deceleration, "stands_s": event.stands_s}
        elif isinstance(event, Collision):
            row |= {"deceleration": event.deceleration}
        elif isinstance(event, StalledVehicle):
            row |= {"lasts_s": event.lasts_s}
        elif isinstance(event, WorkZone | Debris):
            row |= _obstacle(event, spot)
        elif isinstance(event, EmergencyVehicle | Convoy):
            arrivals = _arrivals(event, number, spot, twin, row["at_s"])
            first = len(demand.trips) + len(added)
            names = [str(first + k) for k in range(len(arrivals))]
            row |= _entering_vehicles(event, arrivals, names)
            added += arrivals
        rows.append(row)
    return Plan(tuple(rows), tuple(added), spots)


def reactions(
    simulated: Simulated, events: Sequence[tuple[int, Event]], start_s: float, until_s: float
) -> list[Reaction]:
    """Return the outcomes of the events.

    Raises:
        NotStagedError: an event could not be staged; the message gives the reason.
    """
    by_number = dict(events)
    outcomes = []
    for row in simulated.staged:
        event = by_number[row["number"]]
        begun = row["from_s"] >= 0
        missing = None
        if not begun:
            missing = f"{REACTING[event.event]} within {event.within_s:g} s"
        elif event.event == "collision" and "impact_s" not in row["note"]:
            missing = "the vehicles did not touch before the motion's end"
        elif event.event == "stalled_vehicle" and "halted_s" not in row["note"]:
            missing = "the vehicle did not come to a stop before the motion's end"
        elif event.event == "red_light_running" and "crossed_s" not in row["note"]:
            missing = "the vehicle did not reach the junction before the motion's end"
        elif event.event in ("work_zone", "debris") and not row["note"].get("stands"):
            missing = REACTING[event.event]
        if missing is not None:
            problem = f"{event.event} at {event.at_s:g} s cannot be staged: {missing}"
            raise NotStagedError(problem, row["number"])
        note = {
            key: round(value - start_s, 3) if key.endswith("_s") else value
            for key, value in row["note"].items()
            if key not in ("tried", "stands", "route")
        }
        ends = row["until_s"] - start_s if row["until_s"] >= 0 else until_s
        begins = row["from_s"] - start_s
        outcomes.append(
            Reaction(
                row["number"],
                event,
                tuple(row["trips"]),
                round(max(begins, 0.0), 3),
                round(min(ends, until_s), 3),
                note,
            )
        )
    return outcomes


def changed_from(events: Sequence[tuple[int, Event]]) -> float:
    """Return the first time at which an event may change the motion, seconds."""
    return min(event.at_s for _, event in events)


def spliced(
    without: pa.Table, with_them: pa.Table, from_s: float
) -> tuple[pa.Table, dict[int, int], float]:
    """Return the table without the events up to a time, and with them from then on.

    Smoothing of paths and resolving of conflicts look ahead, so that later events would change
    earlier rows. Here the rows before the events are byte-identical to a motion without them;
    afterwards the difference fades out.

    Args:
        without: actors of the same traffic without the events; tracks are numbers of trips.
        with_them: actors with the events; tracks are numbers of the same trips.
        from_s: begin of the first event.

    Returns:
        The table, with tracks numbered as without the events, followed by the event's own actors;
            the track of each trip; and the largest distance between the two versions in the last
            step before the events, metres.
    """
    before = without.filter(pc.less(without["time_s"], from_s - 1e-6))
    after = with_them.filter(pc.greater_equal(with_them["time_s"], from_s - 1e-6))
    apart = _displacements_before(without, with_them, from_s)
    after = _faded(after, apart, from_s)
    usual = np.unique(without["track"].to_numpy())
    both = pa.concat_tables([before, after]).combine_chunks()
    trips = both["track"].to_numpy()
    further = np.setdiff1d(np.unique(trips), usual)
    numbers = {int(trip): n for n, trip in enumerate([*usual, *further], 1)}
    tracks = np.array([numbers[int(trip)] for trip in trips], np.int32)
    place = both.schema.get_field_index("track")
    both = both.set_column(place, both.schema.field(place), pa.array(tracks, pa.int32()))
    order = np.lexsort([tracks, both["time_s"].to_numpy()])
    seam = max((float(np.hypot(*shift)) for shift in apart.values()), default=0.0)
    return both.take(order).combine_chunks(), numbers, seam


def _displacements_before(
    without: pa.Table, with_them: pa.Table, from_s: float
) -> dict[int, NDArray[np.float64]]:
    """Return each track's displacement (2,) by events in the last step before a time, metres."""
    times = without["time_s"].to_numpy()
    earlier = times[times < from_s - 1e-6]
    if not len(earlier):
        return {}
    places = []
    for table in (without, with_them):
        rows = table.filter(pc.equal(table["time_s"], float(earlier[-1])))
        xy = np.column_stack([rows["x"].to_numpy(), rows["y"].to_numpy()])
        places.append(dict(zip(rows["track"].to_pylist(), xy, strict=True)))
    return {track: xy - places[1][track] for track, xy in places[0].items() if track in places[1]}


def _faded(table: pa.Table, apart: dict[int, NDArray[np.float64]], from_s: float) -> pa.Table:
    """Return rows shifted by their tracks' displacements, which fade out after a time."""
    times = table["time_s"].to_numpy()
    share = np.clip(1.0 - (times - from_s) / _FADE_S, 0.0, 1.0)
    none = np.zeros(2)
    moved = np.array([apart.get(track, none) for track in table["track"].to_pylist()])
    for column, name in enumerate(("x", "y")):
        place = table.schema.get_field_index(name)
        values = table[name].to_numpy() + share * moved.reshape(-1, 2)[:, column]
        table = table.set_column(place, table.schema.field(place), pa.array(values))
    return table


def everybody(demand: Demand, plan: Plan) -> Demand:
    """Return the demand with the trips that events add."""
    return replace(demand, trips=(*demand.trips, *plan.added))


def _usable_lanes(event: PlacedEvent, spot: Spot, twin: Twin) -> list[str]:
    """Return the place's lane, and parallel ones unless that lane was requested by id."""
    if event.place.lane is not None:
        return [spot.lane.id]
    road = next(candidate for candidate in twin.roads.roads if candidate.id == spot.lane.road)
    beside = [
        name
        for name in road.lanes
        if name != spot.lane.id and "car" in twin.roads.lane_by_id[name].allowed
    ]
    return [spot.lane.id, *beside]


def _obstacle(event: WorkZone | Debris, spot: Spot) -> dict[str, Any]:
    vclass = "passenger" if "car" in spot.lane.allowed else "bicycle"
    if isinstance(event, WorkZone):
        length, width = event.length_m, min(_MAX_WORK_ZONE_WIDTH_M, spot.lane.width)
    else:
        lost = asset(DEBRIS)
        length, width = round(lost.length, 3), round(lost.width, 3)
    return {"length_m": length, "width_m": width, "vclass": vclass, "lasts_s": event.lasts_s}


def _arrivals(
    event: EmergencyVehicle | Convoy, number: int, spot: Spot, twin: Twin, at_s: float
) -> list[Trip]:
    """Return the trips of vehicles that enter for an event."""
    path, _ = lane_way(
        twin.roads,
        spot.lane,
        spot.along_m,
        event.users,
        back_m=_ROUTE_BEFORE_M,
        ahead_m=_ROUTE_BEYOND_M,
    )
    lanes = [twin.roads.lane_by_id[name] for name in path.lanes]
    edges = tuple(dict.fromkeys(lane.road for lane in lanes if lane.road))
    if isinstance(event, Convoy):
        names = asset_names("truck")
        meshes = [("truck", names[(number + k) % len(names)]) for k in range(event.count)]
    else:
        meshes = [_emergency_mesh()]
    return [Trip(kind, name, at_s, edges) for kind, name in meshes]


def _emergency_mesh() -> tuple[str, str]:
    """Return the class and asset of a vehicle with a blue light: dedicated, or a large van."""
    for kind in ("car", "truck"):
        for name in asset_names(kind):
            if any(word in name for word in ("ambulance", "police", "fire")):
                return kind, name
    return "truck", "truck-luton-3t5"


def _entering_vehicles(
    event: EmergencyVehicle | Convoy, arrivals: Sequence[Trip], names: Sequence[str]
) -> dict[str, Any]:
    """Return SUMO's input about the vehicles that enter."""
    emergency = isinstance(event, EmergencyVehicle)
    types: dict[str, dict[str, Any]] = {}
    vehicles = []
    for name, trip in zip(names, arrivals, strict=True):
        mesh = asset(trip.asset)
        kind = f"event-{trip.asset}"
        types[kind] = {
            "vclass": "emergency" if emergency else "truck",
            "length": round(mesh.length, 3),
            "width": round(mesh.width, 3),
            "height": round(mesh.height, 3),
            "speed_factor": event.speed_factor if isinstance(event, EmergencyVehicle) else 0.9,
        }
        vehicles.append((name, kind))
    return {
        "kind": "emergency" if emergency else "convoy",
        "edges": list(arrivals[0].edges),
        "types": types,
        "vehicles": vehicles,
        "classes": [ACTOR_CLASSES.index(trip.actor_class) for trip in arrivals],
    }
