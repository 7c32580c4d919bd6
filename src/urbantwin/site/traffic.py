"""``traffic:`` of a site: volumes by class, duration, seed, and sizes of actors."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from urbantwin.errors import InputError
from urbantwin.site.conditions import Strict
from urbantwin.site.yaml_document import nearest, read_document, wrong
from urbantwin.taxonomy import ACTOR_CLASSES, COMPANIONS

__all__ = ["DEFAULT_PER_HOUR", "TrafficSpec", "checked_time_of_day", "load_traffic_changes"]

#: Assumption: a moderately busy urban junction at midday, actors per hour over all approaches.
DEFAULT_PER_HOUR: dict[str, float] = {
    "car": 1080.0,
    "truck": 60.0,
    "bus": 40.0,
    "motorcycle": 60.0,
    "bicycle": 150.0,
    "pedestrian": 400.0,
    "van": 120.0,
}
#: Fraction of occupied parking spaces by day: below the 85 % at which a street counts as full and
#: drivers begin to search (Shoup, The High Cost of Free Parking, 2005, chapter 12).
USUALLY_PARKED = 0.7


def _known_class(name: str) -> str:
    if name not in ACTOR_CLASSES:
        raise wrong("is not a class of actors", nearest(name, ACTOR_CLASSES))
    return name


ActorClass = Annotated[str, AfterValidator(_known_class)]
PerHour = Annotated[float, Field(ge=0.0, le=100_000.0, allow_inf_nan=False)]
SizeFactor = Annotated[float, Field(ge=0.5, le=2.0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Seconds = Annotated[float, Field(le=86400.0, allow_inf_nan=False)]
#: Tolerance of shares that must sum to 1.
_ROUNDED = 0.01


def _id(value: Any) -> Any:  # noqa: ANN401
    """Return an id as text, also if YAML reads it as a number."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _time_of_day(value: object) -> object:
    """Return a time as ``07:15``; YAML reads 10:30 as a number of minutes."""
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1440:
        return f"{value // 60:02}:{value % 60:02}"
    if not isinstance(value, str) or not re.fullmatch(r"([01]?\d|2[0-3]):[0-5]\d", value):
        raise wrong(f"is {str(value)[:20]!r}", "a time of day from 00:00 to 23:59, such as 08:00")
    return value.rjust(5, "0")


TimeOfDay = Annotated[str, BeforeValidator(_time_of_day)]


class SizeSpec(Strict):
    """Factors on the catalogue's length, width and height."""

    length: SizeFactor = 1.0
    width: SizeFactor = 1.0
    height: SizeFactor = 1.0


class CountSpec(Strict):
    """A traffic count of a turn at a junction, a road, or a crossing.

    Attributes:
        junction: junction: its id, or its streets (``First Street / Second Street``); the main
            junction if not given.
        approach: origin of the turn: the id of a road, an arm of the junction (``north``), or the
            name of a street with one approach.
        turn: destination of the turn: ``left``, ``through``, ``right``, ``u-turn``, or the id of a
            road, an arm, or a street's name.
        road: instead of approach and turn, a cross-section: the id of a road or of one of its
            lanes, or the name of a street with one direction; all lanes together.
        crossing: instead, a crossing for pedestrians or bicycles: its id, or the arm of the
            junction that it crosses.
        actor_class: counted class; if not given, the motor traffic, distributed as in ``per_hour``.
        begin: start of the first quarter of an hour, ``07:15``; with ``traffic.time_of_day`` the
            motion begins with the quarter of that time.
        per_hour: count per hour; or
        per_quarter: count in each quarter of an hour from the motion's start; the last value holds
            afterwards, the first one before.
        row: place in the source file, for errors.
    """

    junction: str = ""
    approach: str = ""
    turn: str = ""
    road: str = ""
    crossing: str = ""
    actor_class: ActorClass | None = None
    per_hour: PerHour | None = None
    per_quarter: list[PerHour] | None = None
    begin: TimeOfDay | None = None
    row: str = ""

    @field_validator("junction", "approach", "turn", "road", "crossing", mode="before")
    @classmethod
    def _numbers_are_ids(cls, value: Any) -> Any:  # noqa: ANN401
        return _id(value)

    @model_validator(mode="after")
    def _says_how_many_once(self) -> CountSpec:
        if (self.per_hour is None) == (not self.per_quarter):
            raise wrong("has no number, or two", "per_hour or per_quarter")
        where = [bool(self.approach and self.turn), bool(self.road), bool(self.crossing)]
        if sum(where) != 1 or bool(self.approach) != bool(self.turn):
            raise wrong("is at no place, or at two", "approach and turn, or road, or crossing")
        return self


class ArrivalSpec(Strict):
    """Platoons from a signal upstream, on a counted approach.

    Attributes:
        approach: id of the road.
        cycle_s: cycle of the platoons, seconds.
        shares: relative numbers of vehicles that would reach the approach's end, unimpeded, in each
            equal part of the cycle. The first part begins with the warm-up, like a signal program
            without an offset.
    """

    approach: str
    cycle_s: Annotated[float, Field(ge=10.0, le=600.0, allow_inf_nan=False)]
    shares: Annotated[
        list[Annotated[float, Field(gt=0.0, allow_inf_nan=False)]],
        Field(min_length=2, max_length=120),
    ]


class DriverSpec(Strict):
    """Driving behaviour of a class; values that are not given are the default.

    Attributes:
        speed_factor: mean desired speed as a fraction of the limit.
        speed_spread: its standard deviation.
        headway_s: time headway to the leader, seconds.
        queue_headway_s: time headway of a stopped vehicle, which changes to ``headway_s`` while it
            drives, seconds.
        standing_gap_m: mean gap to the leader at a stop, metres.
        standing_gap_spread_m: its standard deviation between drivers, metres.
        acceleration: maximum acceleration, m/s2.
        acceleration_at_10: maximum acceleration at 10 m/s; it decreases linearly with speed, m/s2.
        sideways_acceleration: accepted lateral acceleration in bends of the mapped radius, m/s2.
        critical_gap_s: shortest accepted gap in conflicting traffic, seconds.
        lane_offset_m: preferred lateral position: offset from the lane's centre towards the
            street's centre, metres; negative towards the kerb.
    """

    speed_factor: Annotated[float, Field(ge=0.1, le=2.0)] | None = None
    speed_spread: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    headway_s: Annotated[float, Field(ge=0.1, le=10.0)] | None = None
    queue_headway_s: Annotated[float, Field(ge=0.1, le=10.0)] | None = None
    standing_gap_m: Annotated[float, Field(ge=0.1, le=20.0)] | None = None
    standing_gap_spread_m: Annotated[float, Field(ge=0.0, le=10.0)] | None = None
    acceleration: Annotated[float, Field(ge=0.2, le=10.0)] | None = None
    acceleration_at_10: Annotated[float, Field(ge=0.1, le=10.0)] | None = None
    sideways_acceleration: Annotated[float, Field(ge=0.5, le=30.0)] | None = None
    critical_gap_s: Annotated[float, Field(ge=0.1, le=20.0)] | None = None
    lane_offset_m: Annotated[float, Field(ge=-5.0, le=5.0)] | None = None


class LaneUseSpec(Strict):
    """Distribution over the lanes of an approach for one destination.

    Attributes:
        turn: id of the destination road.
        shares: id of a lane of the approach -> share of the vehicles; sums to 1.
    """

    turn: str
    shares: Annotated[dict[str, Share], Field(min_length=1)]

    @field_validator("turn", mode="before")
    @classmethod
    def _numbers_are_ids(cls, value: Any) -> Any:  # noqa: ANN401
        return _id(value)

    @field_validator("shares")
    @classmethod
    def _all_of_them(cls, value: dict[str, float]) -> dict[str, float]:
        if abs(sum(value.values()) - 1.0) > _ROUNDED:
            raise wrong(f"are {sum(value.values()):g} together", "1")
        return value


class ApproachSpec(Strict):
    """Use of an approach by motor traffic; values that are not given are the default.

    Attributes:
        approach: id of the road.
        queue_headway_s: time headway of stopped motor vehicles, instead of the class's, seconds.
        lanes: distribution over the lanes, by destination.
    """

    approach: str
    queue_headway_s: Annotated[float, Field(ge=0.1, le=10.0)] | None = None
    lanes: list[LaneUseSpec] = Field(default_factory=list)

    @field_validator("approach", mode="before")
    @classmethod
    def _numbers_are_ids(cls, value: Any) -> Any:  # noqa: ANN401
        return _id(value)


class ParkedSpec(Strict):
    """Fraction of occupied parking spaces, 0..1, along streets and in car parks."""

    street: Share = USUALLY_PARKED
    car_park: Share = USUALLY_PARKED


class OwnAssetSpec(Strict):
    """A mesh added to the catalogue of actors.

    Attributes:
        file: glTF file, relative to ``site.yaml``.
        actor_class: written ``class``: label of its boxes.
        scale: length of its unit, metres.
        forward: its forward axis; found from its shape if not given.
        share: its share of the actors of its class.
        licence: licence of the mesh.
        attribution: author.
    """

    file: Annotated[str, Field(min_length=1)]
    actor_class: Annotated[ActorClass, Field(alias="class")]
    scale: Annotated[float, Field(gt=0.0, le=1000.0, allow_inf_nan=False)] = 1.0
    forward: Literal["x", "-x", "z", "-z"] | None = None
    share: Share = 0.1
    licence: str = "not stated"
    attribution: str = "not stated"

    @property
    def name(self) -> str:
        """Name of the asset: ``own-`` and the file's name in letters, digits and dashes."""
        return "own-" + re.sub("[^a-z0-9]+", "-", Path(self.file).stem.lower()).strip("-")


class TrafficSpec(Strict):
    """Volumes and duration of the traffic.

    Attributes:
        per_hour: actors that enter the region per hour, by class, over all streets. Classes not
            named have none.
        guessed: whether these are guesses; then motor vehicles are limited to the capacity of the
            signals' green times.
        duration_s: length of the motion, seconds.
        warmup_s: simulated time before the motion starts, which fills the streets, seconds.
        step_s: time step of the simulation, seconds.
        seed: random seed; the same seed gives the same traffic.
        size: factors on the catalogue's sizes, by class.
        counts: traffic counts. Counted classes enter as the counts say, pass through and leave, and
            their ``per_hour`` has no effect.
        arrivals: platoons by approach, for counted traffic; uniform arrivals if not given.
        counted_set_out: ``evenly``, one in each equal part of the time, per count and class; or
            ``at_random``, independently of each other. The numbers are the same.
        time_of_day: start of the motion, ``08:00``. Counts with a start are used from then on;
            guessed volumes, which are those of midday, are scaled by the hour.
        drivers: driving behaviour by class.
        approaches: use of single approaches: lanes and headway.
        in_groups: fraction of pedestrians who walk in groups, 0..0.95; the default is that of a
            street on a weekday (Moussaid et al., PLOS ONE 5, 2010; on a Saturday 0.67).
        passengers_per_halt: mean number of people who board, and alight, at a bus stop, in a closed
            loop. London: 2.34e9 journeys and 490e6 km a year (Transport for London, 2012), with a
            stop every 400 m.
        parked: fraction of occupied parking spaces, 0..1: of all, or by ``street`` and
            ``car_park``.
        assets: meshes added to the catalogue.
    """

    per_hour: dict[ActorClass, PerHour] = Field(default_factory=lambda: dict(DEFAULT_PER_HOUR))
    guessed: bool = False
    duration_s: Annotated[Seconds, Field(gt=0.0)] = 60.0
    warmup_s: Annotated[Seconds, Field(ge=0.0)] = 120.0
    step_s: Annotated[float, Field(ge=0.01, le=1.0, allow_inf_nan=False)] = 0.1
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    size: dict[ActorClass, SizeSpec] = Field(default_factory=dict)
    counts: list[CountSpec] = Field(default_factory=list)
    arrivals: list[ArrivalSpec] = Field(default_factory=list)
    counted_set_out: Literal["evenly", "at_random"] = "evenly"
    time_of_day: TimeOfDay | None = None
    drivers: dict[ActorClass, DriverSpec] = Field(default_factory=dict)
    approaches: list[ApproachSpec] = Field(default_factory=list)
    parked: ParkedSpec = Field(default_factory=ParkedSpec)
    in_groups: Annotated[float, Field(ge=0.0, le=0.95, allow_inf_nan=False)] = 0.56
    passengers_per_halt: Annotated[float, Field(ge=0.0, le=6.0, allow_inf_nan=False)] = 1.9
    assets: list[OwnAssetSpec] = Field(default_factory=list)

    @field_validator("assets")
    @classmethod
    def _told_apart(cls, value: list[OwnAssetSpec]) -> list[OwnAssetSpec]:
        names = [one.name for one in value]
        for name in names:
            if names.count(name) > 1:
                raise wrong(f"has two files that are called {name!r}", "files of different names")
        return value

    @field_validator("parked", mode="before")
    @classmethod
    def _of_all(cls, value: object) -> object:
        if isinstance(value, int | float) and not isinstance(value, bool):
            return {"street": value, "car_park": value}
        return value

    @field_validator("per_hour")
    @classmethod
    def _every_class_is_named(cls, value: dict[str, float]) -> dict[str, float]:
        for name in COMPANIONS:
            if value.get(name, 0.0) > 0:
                raise wrong(f"asks for {name}s", "none: they come with others")
        return {name: value.get(name, 0.0) for name in ACTOR_CLASSES}


def checked_time_of_day(time: str) -> str:
    """Return a time of day as ``08:00``.

    Raises:
        InputError: the text is not a time of day.
    """
    try:
        return str(_time_of_day(time))
    except ValueError:
        raise InputError(
            f"is {time[:20]!r}", place="time of day", expected="00:00 to 23:59, such as 08:00"
        ) from None


def load_traffic_changes(path: Path) -> dict[str, Any]:
    """Read a file of fields of ``traffic:``, and return the given fields, checked.

    Raises:
        InputError: the file is missing or wrong; names file, field and line.
    """
    document = read_document(path, kind="traffic")
    found = document.validated(TrafficSpec)
    if found.assets:
        raise InputError(
            "brings meshes along",
            file=path,
            place=document.place(("assets",)),
            expected="them under `traffic:` of site.yaml: `urbantwin build` reads them",
        )
    return found.model_dump(exclude_unset=True)
