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

#: A moderately busy urban junction in the middle of the day, all approaches together.
DEFAULT_PER_HOUR: dict[str, float] = {
    "car": 1080.0,
    "truck": 60.0,
    "bus": 40.0,
    "motorcycle": 60.0,
    "bicycle": 150.0,
    "pedestrian": 400.0,
    "van": 120.0,
}
#: Share of parking spaces that are taken by day: below the 85 % at which a street counts as full
#: and drivers begin to search (Shoup, The High Cost of Free Parking, 2005, chapter 12).
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
#: Shares may be 1 together to within this.
_ROUNDED = 0.01


def _id(value: Any) -> Any:  # noqa: ANN401
    """Return an id that YAML takes for a number as text."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _time_of_day(value: object) -> object:
    """Return a time as ``07:15``: YAML takes 10:30 for a number of minutes."""
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1440:
        return f"{value // 60:02}:{value % 60:02}"
    if not isinstance(value, str) or not re.fullmatch(r"([01]?\d|2[0-3]):[0-5]\d", value):
        raise wrong(f"is {str(value)[:20]!r}", "a time of day from 00:00 to 23:59, such as 08:00")
    return value.rjust(5, "0")


TimeOfDay = Annotated[str, BeforeValidator(_time_of_day)]


class SizeSpec(Strict):
    """Factors of the catalogue's length, width and height."""

    length: SizeFactor = 1.0
    width: SizeFactor = 1.0
    height: SizeFactor = 1.0


class CountSpec(Strict):
    """What was counted of one way through a junction, on one road, or on one crossing.

    Attributes:
        junction: where: its id, or its streets (``First Street / Second Street``); without it the
            main junction.
        approach: where it comes from: the id of a road, an arm of the junction (``north``), or the
            name of a street that has one approach.
        turn: where it goes: ``left``, ``through``, ``right``, ``u-turn``, or the id of a road, an
            arm, or a street's name.
        road: instead of approach and turn, a cross-section: the id of a road or of one of its
            lanes, or the name of a street that has one direction; all lanes together.
        crossing: or who crosses on foot, or by bicycle: a crossing's id, or the arm of the junction
            that it crosses.
        actor_class: of which class; without it, the motor traffic, shared out as ``per_hour`` is.
        begin: when the first quarter of an hour begins, ``07:15``; with ``traffic.time_of_day`` the
            motion begins with the quarter of that time.
        per_hour: how many in an hour; or
        per_quarter: how many in each quarter of an hour from the motion's start on; the last one
            holds from then on, and the first one before.
        row: where it was written, for errors.
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
    """Platoons from a signal upstream, by an approach that was counted.

    Attributes:
        approach: id of the road.
        cycle_s: the cycle in which they come, seconds.
        shares: of who comes, how many would reach the approach's end in each equal part of the
            cycle if nobody held them up; relative numbers. The first part begins when the warm-up
            does, as a signal's program without an offset.
    """

    approach: str
    cycle_s: Annotated[float, Field(ge=10.0, le=600.0, allow_inf_nan=False)]
    shares: Annotated[
        list[Annotated[float, Field(gt=0.0, allow_inf_nan=False)]],
        Field(min_length=2, max_length=120),
    ]


class DriverSpec(Strict):
    """How the drivers of a class drive, where it is not as usual.

    Attributes:
        speed_factor: mean of the desired speed as a share of the limit.
        speed_spread: its standard deviation.
        headway_s: time that they keep to who is ahead, seconds.
        queue_headway_s: the same of who stands, which comes to ``headway_s`` as it drives.
        standing_gap_m: mean of the distance that they keep when they stand, metres.
        standing_gap_spread_m: its standard deviation from driver to driver.
        acceleration: most that they speed up with, m/s2.
        acceleration_at_10: what is left of that at 10 m/s; it falls in a line with the speed.
        sideways_acceleration: what they accept in bends, m/s2, as sharp as the map has them.
        critical_gap_s: shortest gap in the other traffic that they take, seconds.
        lane_offset_m: where in the lane they would ride: so far from its middle towards the middle
            of the street, metres; towards the kerb below 0.
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
    """By which lanes of an approach those leave it who go the same way.

    Attributes:
        turn: id of the road that they go to.
        shares: id of a lane of the approach -> share of them, 1 together.
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
    """How motor traffic uses an approach, where it is not as usual.

    Attributes:
        approach: id of the road.
        queue_headway_s: time that motor traffic which stands there keeps to who is ahead, in place
            of its class's, seconds.
        lanes: by which lanes who leaves.
    """

    approach: str
    queue_headway_s: Annotated[float, Field(ge=0.1, le=10.0)] | None = None
    lanes: list[LaneUseSpec] = Field(default_factory=list)

    @field_validator("approach", mode="before")
    @classmethod
    def _numbers_are_ids(cls, value: Any) -> Any:  # noqa: ANN401
        return _id(value)


class ParkedSpec(Strict):
    """Which share of the parking spaces is taken, 0..1, along streets and in car parks."""

    street: Share = USUALLY_PARKED
    car_park: Share = USUALLY_PARKED


class OwnAssetSpec(Strict):
    """A mesh that joins the catalogue of actors.

    Attributes:
        file: glTF, relative to ``site.yaml``.
        actor_class: written ``class``: what its boxes are labelled with.
        scale: metres of one of its units.
        forward: its axis that points ahead; found from its shape if not given.
        share: which share of the actors of its class it is.
        licence: on what terms it may be used.
        attribution: who made it.
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
        """What the asset is called: ``own-`` and the file's name in letters, digits and dashes."""
        return "own-" + re.sub("[^a-z0-9]+", "-", Path(self.file).stem.lower()).strip("-")


class TrafficSpec(Strict):
    """How much traffic, for how long.

    Attributes:
        per_hour: actors that come into the region per hour, by class, over all streets together. A
            class that is not named has none.
        guessed: whether these are guesses: no more motor vehicles come then than the signals' lanes
            have green for.
        duration_s: length of the motion, seconds.
        warmup_s: simulated before the motion starts, so that the streets are not empty, seconds.
        step_s: time between two steps of the simulation, seconds.
        seed: of every random choice; the same seed gives the same traffic.
        size: by class, how large its actors are against the catalogue's.
        counts: what was counted, way by way. Classes that are counted come as the counts say, pass
            through and leave, and ``per_hour`` says nothing of them.
        arrivals: by approach, in which part of a cycle upstream who is counted comes; evenly where
            nothing is said.
        counted_set_out: ``evenly``, one in each equal part of the time, way by way and class by
            class; or ``at_random``, as who knows nothing of the others. As many come either way.
        time_of_day: when the motion begins, ``08:00``. Counts that say when they begin are taken
            from then on; guessed volumes, which are those of midday, are scaled by the hour.
        drivers: by class, how its drivers drive.
        approaches: how single approaches are used: by which lanes, with which headway.
        in_groups: share of people on foot who walk with others, 0..0.95; the default is that of a
            street on a weekday (Moussaid et al., PLOS ONE 5, 2010; on a Saturday 0.67).
        passengers_per_halt: how many people get on, and off, at a halt of a bus on average, in a
            closed loop. London: 2.34e9 journeys and 490e6 km a year (Transport for London, 2012),
            with a stop every 400 m.
        parked: share of the parking spaces that are taken, 0..1: of all, or by ``street`` and
            ``car_park``.
        assets: meshes that join the catalogue.
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
        InputError: it is none.
    """
    try:
        return str(_time_of_day(time))
    except ValueError:
        raise InputError(
            f"is {time[:20]!r}", place="time of day", expected="00:00 to 23:59, such as 08:00"
        ) from None


def load_traffic_changes(path: Path) -> dict[str, Any]:
    """Read a file of fields of ``traffic:``, and return those that it has, checked.

    Raises:
        InputError: the file is missing or wrong; it names the file, the field and the line.
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
