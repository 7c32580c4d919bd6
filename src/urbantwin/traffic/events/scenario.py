"""``scenario.yaml``: rare events by name, with parameters, place and time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field, model_validator

from urbantwin.errors import InputError
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import nearest, read_document, wrong
from urbantwin.taxonomy import BOX_SEMANTICS
from urbantwin.traffic.events.places import Place, find_spot, nearest_to_anchor
from urbantwin.twin import Twin

__all__ = [
    "EVENTS",
    "BicycleWithoutLight",
    "BlockedSensor",
    "ChildBetweenParkedCars",
    "Collision",
    "Convoy",
    "Crowd",
    "Debris",
    "EmergencyVehicle",
    "Event",
    "HardBrake",
    "NearMiss",
    "Passage",
    "RedLightRunning",
    "StalledVehicle",
    "Trajectory",
    "UTurn",
    "WorkZone",
    "WrongWay",
    "load_scenario",
    "one_passage",
    "scenario_events",
]

Moment = Annotated[float, Field(ge=0.0, le=86400.0, allow_inf_nan=False)]
Lasting = Annotated[float, Field(gt=0.0, le=86400.0, allow_inf_nan=False)]
Within = Annotated[float, Field(ge=0.0, le=3600.0, allow_inf_nan=False)]
Series = Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=2)]
Braking = Annotated[float, Field(ge=2.0, le=10.0, allow_inf_nan=False)]
Pace = Annotated[float, Field(ge=0.5, le=40.0, allow_inf_nan=False)]
Apart = Annotated[float, Field(ge=0.1, le=10.0, allow_inf_nan=False)]
Vehicle = Literal["car", "truck", "bus", "motorcycle", "bicycle"]


class Event(Strict):
    """Fields of all events.

    Attributes:
        event: its name.
        at_s: requested time, seconds of the motion.
        within_s: tolerance of the time, seconds, within which the event finds the traffic or room
            that it needs: later, or for inserted actors also earlier.
    """

    event: str
    at_s: Moment
    within_s: Within = 20.0

    @property
    def users(self) -> str:
        """The class of actors whose lane the place is on."""
        return str(getattr(self, "actor", "car"))


class PlacedEvent(Event):
    """An event at a place.

    Attributes:
        place: the requested place.
        within_m: distance within which another place may be used (on the same lane if the place
            names one) if the requested one lacks the traffic or room that it needs, metres.
    """

    place: Place
    within_m: Annotated[float, Field(ge=0.0, le=1000.0, allow_inf_nan=False)] = 100.0


class HardBrake(PlacedEvent):
    """The next vehicle at a place brakes to a stop, and stands."""

    deceleration: Braking = 7.0
    stands_s: Lasting = 3.0
    within_s: Within = 90.0


class RedLightRunning(PlacedEvent):
    """The next vehicle that approaches a red signal on the place's lane drives on."""

    within_s: Within = 90.0


class StalledVehicle(PlacedEvent):
    """The next vehicle stops at a place and stays."""

    lasts_s: Lasting = 60.0
    within_s: Within = 90.0


class Collision(PlacedEvent):
    """A driver does not notice that the vehicle ahead brakes; both stay as wrecks."""

    deceleration: Braking = 8.0
    within_s: Within = 90.0


class EmergencyVehicle(PlacedEvent):
    """A vehicle with a blue light passes a place, and others make way."""

    speed_factor: Annotated[float, Field(ge=0.5, le=2.0)] = 1.4


class Convoy(PlacedEvent):
    """Trucks that pass a place one behind the other."""

    count: Annotated[int, Field(ge=2, le=30)] = 5

    @property
    def users(self) -> str:
        """Trucks."""
        return "truck"


class WorkZone(PlacedEvent):
    """Cones and barriers close a part of a lane, from the place onwards."""

    length_m: Annotated[float, Field(ge=5.0, le=200.0)] = 20.0
    lasts_s: Lasting | None = None
    within_s: Within = 90.0


class Debris(PlacedEvent):
    """A lost object lies on a lane."""

    lasts_s: Lasting | None = None
    within_s: Within = 90.0


class NearMiss(PlacedEvent):
    """An actor crosses the path of a vehicle of the traffic with a requested margin.

    Attributes:
        actor: class of the crossing actor.
        pet_s: post-encroachment time: it passes before the vehicle (``passes: before``) or after.
        ttc_s: least time to collision: it is on a collision course, and brakes.
        passes: before or after the vehicle.
        speed: speed of the crossing actor, m/s; default: usual for the class.
    """

    actor: Literal["car", "motorcycle", "bicycle", "pedestrian"] = "bicycle"
    pet_s: Apart | None = None
    ttc_s: Apart | None = None
    passes: Literal["before", "after"] = "before"
    within_s: Within = 60.0
    speed: Pace | None = None

    @model_validator(mode="after")
    def _asks_one(self) -> NearMiss:
        if (self.pet_s is None) == (self.ttc_s is None):
            raise wrong("has to say how near", "one of pet_s and ttc_s, seconds")
        return self

    @property
    def users(self) -> str:
        """The class of the vehicle whose path is crossed."""
        return "car"


class ChildBetweenParkedCars(PlacedEvent):
    """A child runs out from between two parked cars, in front of a vehicle."""

    pet_s: Apart = 1.0
    speed: Pace = 3.0
    within_s: Within = 60.0


class WrongWay(PlacedEvent):
    """A vehicle drives against the direction of a lane."""

    actor: Vehicle = "car"
    speed: Pace = 8.0


class Passage(PlacedEvent):
    """An additional actor passes along the lane at a place."""

    actor: Literal["car", "truck", "bus", "motorcycle", "bicycle", "pedestrian"] = "bicycle"
    speed: Pace | None = None


class UTurn(PlacedEvent):
    """A vehicle makes a U-turn on the street."""

    actor: Vehicle = "car"
    speed: Pace = 4.0


class BicycleWithoutLight(PlacedEvent):
    """A bicycle without lights or reflectors, in dark clothes."""

    speed: Pace = 5.0

    @property
    def users(self) -> str:
        """Bicycles."""
        return "bicycle"


class Crowd(PlacedEvent):
    """A group of standing pedestrians."""

    count: Annotated[int, Field(ge=2, le=300)] = 20
    lasts_s: Lasting = 30.0

    @property
    def users(self) -> str:
        """People."""
        return "pedestrian"


class Trajectory(Event):
    """An actor follows a trajectory, regardless of other actors.

    Attributes:
        actor: its class.
        name: its name in the trajectory's file.
        asset: its asset; default: a usual one of the class.
        time_s: ascending times, seconds of the motion.
        x: east coordinate of the centre of its bounds at these times, site frame, metres.
        y: north coordinate, metres.
        yaw_deg: heading, degrees counter-clockwise from east; default: the direction of travel.
    """

    actor: str = "car"
    name: Annotated[str, Field(max_length=200)] | None = None
    asset: str | None = None
    time_s: Series
    x: Series
    y: Series
    yaw_deg: Series | None = None

    @model_validator(mode="after")
    def _is_a_path(self) -> Trajectory:
        if self.actor not in BOX_SEMANTICS:
            raise wrong(f"is of class {self.actor!r:.40}", ", ".join(BOX_SEMANTICS))
        lengths = {
            len(column)
            for column in (self.time_s, self.x, self.y, self.yaw_deg)
            if column is not None
        }
        if len(lengths) > 1:
            raise wrong("has columns of different lengths", "time_s, x and y of the same length")
        if any(after <= before for before, after in pairwise(self.time_s)):
            raise wrong("has a time that does not go on", "later times")
        return self


class BlockedSensor(Event):
    """A truck stands in front of a sensor of the twin's rig.

    Attributes:
        sensor: its name; default: the first of the rig.
        lasts_s: duration of the stop.
        least_share: least share that it hides of the part of the junction that the sensor sees
            without it.
    """

    sensor: str | None = None
    lasts_s: Lasting = 20.0
    least_share: Annotated[float, Field(gt=0.0, le=1.0)] = 0.05


#: Events by name.
EVENTS: dict[str, type[Event]] = {
    "near_miss": NearMiss,
    "collision": Collision,
    "red_light_running": RedLightRunning,
    "hard_brake": HardBrake,
    "wrong_way": WrongWay,
    "u_turn": UTurn,
    "stalled_vehicle": StalledVehicle,
    "emergency_vehicle": EmergencyVehicle,
    "work_zone": WorkZone,
    "debris": Debris,
    "child_between_parked_cars": ChildBetweenParkedCars,
    "bicycle_without_light": BicycleWithoutLight,
    "crowd": Crowd,
    "convoy": Convoy,
    "passage": Passage,
    "trajectory": Trajectory,
    "blocked_sensor": BlockedSensor,
}


def load_scenario(path: Path, twin: Twin | None, until_s: float) -> list[dict[str, Any]]:
    """Read a scenario and return its events in the form of ``traffic.scenario``.

    Args:
        path: the ``scenario.yaml``, or a ``.xosc`` (ASAM OpenSCENARIO XML).
        twin: the twin whose lanes, streets and crossings are named; ``None``: places are not
            checked.
        until_s: duration of the motion, seconds.

    Raises:
        InputError: the file is wrong, or names a place that the twin does not have; the message
            names file and line.
    """
    if path.suffix.lower() == ".xosc":
        from urbantwin.traffic.events.openscenario import openscenario_events

        return openscenario_events(path, until_s)
    document = read_document(path, kind="a scenario")
    strange = [key for key in document.value if key != "events"]
    if strange:
        raise document.error("is not a field that is known here", [strange[0]], "'events'")
    events = document.value.get("events")
    if not isinstance(events, list) or not events:
        raise document.error("has no events", ["events"], "a list of events")
    several, rows = document.part("events"), []
    for number, value in enumerate(events):
        if not isinstance(value, dict):
            raise several.error("is no event", [number], "a mapping with event, at_s and place")
        part = several.part(number)
        name = value.get("event")
        if name not in EVENTS:
            problem = "is missing" if name is None else f"is {str(name)!r:.60}"
            expected = nearest(str(name), list(EVENTS))
            raise part.error(problem, ["event"], expected)
        event = part.validated(EVENTS[name])
        if event.at_s >= until_s:
            raise part.error(f"is {event.at_s:g}", ["at_s"], f"less than {until_s:g} s, the motion")
        if twin is not None and isinstance(event, PlacedEvent):
            try:
                find_spot(event.place, twin, event.users)
            except InputError as error:
                where = (error.place or "place").split(".")
                raise part.error(error.problem, where, error.expected) from None
        rows.append(event.model_dump(exclude_unset=True, exclude_none=True))
    return rows


def one_passage(
    actor: str, street: str | None, twin: Twin, from_s: float, until_s: float
) -> dict[str, Any]:
    """Return an event of an additional actor in an interval, as in ``traffic.scenario``.

    Args:
        actor: its class.
        street: name of a street; ``None``: the lane nearest to the anchor.
        twin: the twin.
        from_s: begin of the interval, seconds of the motion.
        until_s: end of the interval, seconds of the motion.

    Raises:
        InputError: no such class or street, or no lane for it.
    """
    actor_classes = get_args(Passage.model_fields["actor"].annotation)
    if actor not in actor_classes:
        raise InputError(f"no class of actors {actor!r:.40}", expected=", ".join(actor_classes))
    if street is not None:
        place: dict[str, Any] = {"street": street}
    else:
        x, y = nearest_to_anchor(twin, actor)
        place = {"x": x, "y": y}
    find_spot(Place.model_validate(place), twin, actor)
    middle = round((from_s + until_s) / 2, 3)
    within = round((until_s - from_s) / 2, 3)
    fields = {"event": "passage", "at_s": middle, "within_s": within, "actor": actor}
    one_more = Passage.model_validate({**fields, "place": place})
    return one_more.model_dump(exclude_unset=True, exclude_none=True)


def scenario_events(told: Sequence[Mapping[str, Any]]) -> list[Event]:
    """Return events from the form that `load_scenario` returns."""
    return [EVENTS[row["event"]].model_validate(dict(row), strict=True) for row in told]
