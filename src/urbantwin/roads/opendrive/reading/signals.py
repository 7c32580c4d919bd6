"""Signals, signs and their controllers, with their ids in the lane model."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from lxml import etree

from urbantwin.geometry import wrapped
from urbantwin.number_text import finite_number, whole_number
from urbantwin.roads.model import ModelRoad, RoadArea, RoadSignal, SignalController
from urbantwin.roads.opendrive.reading.objects import WrittenArea
from urbantwin.roads.opendrive.reading.parsing import (
    Log,
    Spot,
    id_number,
    station_on_road,
    user_data,
)

__all__ = [
    "Program",
    "Reference",
    "WrittenSignal",
    "read_program",
    "read_references",
    "read_signals",
    "resolve_references",
    "with_model_ids",
]

#: Default height and width of a signal, metres.
HEIGHT_M, WIDTH_M = 0.9, 0.3
#: Smaller differences in angle (radians) and position (metres) are ignored.
SAME_ANGLE, SAME_M = 1e-3, 0.01
_UNITS = ("m", "km", "ft", "mile", "m/s", "mph", "km/h", "kg", "t", "%")


@dataclass(frozen=True)
class WrittenSignal:
    """A signal or sign with its ids in the file; those of ``signal`` are set later.

    ``turned``: rotation from facing the traffic of its orientation, radians.
    """

    id: str
    road: str
    signal: RoadSignal
    turned: float = 0.0


@dataclass(frozen=True)
class Program:
    """A controller with ids of the file; see ``SignalController``."""

    id: str
    name: str
    signals: tuple[str, ...]
    offset: float
    phases: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class Reference:
    """A signal beside one road that applies to traffic of another, ``road``."""

    id: str
    road: str
    s: float
    t: float
    orientation: str
    lanes: tuple[int, ...]


def read_signals(
    item: etree._Element, name: str, road: ModelRoad, spot: Spot
) -> Iterator[WrittenSignal]:
    """Yield the signals and signs of a ``<road>``; ``road`` is the same as read so far."""
    for signal in item.findall("signals/signal"):
        identity = signal.get("id", "")
        place = spot.within(f"signal {identity}")
        with place.dropping():
            s = station_on_road(signal, road.length, place)
            height = place.number(signal, "height", 0.0)
            height = height if height > 0 else HEIGHT_M
            width = place.number(signal, "width", 0.0)
            read = RoadSignal(
                id=0,
                road=0,
                name=signal.get("name") or "",
                dynamic=signal.get("dynamic") == "yes",
                country=signal.get("country") or "OpenDRIVE",
                type=signal.get("type") or "-1",
                subtype=signal.get("subtype") or "-1",
                value=_value(signal),
                unit=signal.get("unit") if signal.get("unit") in _UNITS else "",
                s=s,
                t=place.number(signal, "t"),
                z=place.number(signal, "zOffset", 0.0) + height / 2,
                orientation=_orientation(signal),
                lanes=_valid_lanes(signal, road, s, place),
                links=tuple(_numbers(user_data(signal).get("links", ""))),
                height=height,
                width=width if width > 0 else WIDTH_M,
                pose=_inertial_pose(signal, height, place),
            )
            yield WrittenSignal(identity, name, read, place.number(signal, "hOffset", 0.0))


def read_references(
    item: etree._Element, name: str, road: ModelRoad, spot: Spot
) -> Iterator[Reference]:
    """Yield the references of a ``<road>`` to signals of other roads."""
    for reference in item.findall("signals/signalReference"):
        identity = reference.get("id", "")
        place = spot.within(f"signalReference {identity}")
        with place.dropping():
            s = min(max(place.number(reference, "s"), 0.0), road.length)
            t, lanes = place.number(reference, "t"), _valid_lanes(reference, road, s, place)
            yield Reference(identity, name, s, t, _orientation(reference), lanes)


def read_program(item: etree._Element, spot: Spot) -> Program:
    """Return a ``<controller>``, with its program if UrbanTwin wrote it."""
    notes = user_data(item)
    phases = []
    for text in filter(None, notes.get("phases", "").split(", ")):
        seconds, _, state = text.partition(" ")
        duration = finite_number(seconds)
        if duration is None or duration <= 0 or not state:
            raise spot.error(f"has the phase {text[:40]!r}", expected="seconds, a space, a state")
        phases.append((duration, state))
    offset = finite_number(notes.get("offset") or "0")
    if offset is None:
        raise spot.error("has an offset that is not a number", expected="seconds")
    identity = item.get("id", "")
    switched = dict.fromkeys(control.get("signalId", "") for control in item.findall("control"))
    return Program(identity, item.get("name") or identity, tuple(switched), offset, tuple(phases))


def _orientation(item: etree._Element) -> str:
    orientation = item.get("orientation", "none")
    return orientation if orientation in ("+", "-") else "none"


def _inertial_pose(signal: etree._Element, height: float, spot: Spot) -> tuple[float, ...]:
    """Return the pose that a file gives in its own coordinates; empty if there is none."""
    item = signal.find("positionInertial")
    if item is None:
        return ()
    x, y, z = (spot.number(item, key) for key in "xyz")
    return x, y, z + height / 2, spot.number(item, "hdg", 0.0)


def _value(signal: etree._Element) -> float:
    """Return the value of a sign; -1 without a unit means none (OpenDRIVE 1.4)."""
    try:
        value = float(signal.get("value") or "nan")
    except ValueError:
        return math.nan
    if not math.isfinite(value) or (value == -1 and not signal.get("unit")):
        return math.nan
    return value


def _valid_lanes(item: etree._Element, road: ModelRoad, s: float, spot: Spot) -> tuple[int, ...]:
    """Return the lanes that a signal or a reference applies to; empty for all."""
    present = sorted(road.section_at(s).by_id)
    lanes: list[int] = []
    for validity in item.findall("validity"):
        first, last = sorted(spot.whole(validity, key) for key in ("fromLane", "toLane"))
        lanes += [lane for lane in present if first <= lane <= last]
    return tuple(dict.fromkeys(lanes))


def _numbers(text: str) -> Iterator[int]:
    for word in text.split():
        number = whole_number(word)
        if number is not None and number >= 0:
            yield number


def resolve_references(
    roads: Mapping[str, ModelRoad],
    signals: Sequence[WrittenSignal],
    references: Iterable[Reference],
    log: Log,
) -> list[WrittenSignal]:
    """Return signals on the roads that they apply to, with a pose if they are beside another road.

    A signal without lanes of its own road moves to the first road that refers to it.
    """
    references_of: dict[str, list[Reference]] = {}
    for reference in references:
        references_of.setdefault(reference.id, []).append(reference)
    for _ in references_of.keys() - {written.id for written in signals}:
        log.at("signalReference").remark("references to signals that do not exist")
    resolved = []
    for written in signals:
        refs, signal = references_of.get(written.id, []), written.signal
        if not refs or signal.lanes:
            if not signal.pose and abs(written.turned) > SAME_ANGLE:
                signal = replace(signal, pose=_pose(roads[written.road], signal, written.turned))
            resolved.append(replace(written, signal=signal))
            continue
        if len({other.road for other in refs}) > 1:
            log.at(f"signal {written.id}").remark("references of several roads to one signal")
        first = refs[0]
        pose = signal.pose or _pose(roads[written.road], signal, written.turned)
        road = roads[first.road]
        ground = float(road.place(first.s, first.t)[0, 2])
        moved_signal = replace(
            signal,
            s=first.s,
            t=first.t,
            z=pose[2] - ground,
            orientation=first.orientation,
            lanes=first.lanes,
        )
        new_pose = _pose(road, moved_signal, 0.0)
        is_same = (
            math.dist(pose[:3], new_pose[:3]) < SAME_M
            and abs(wrapped(pose[3] - new_pose[3])) < SAME_ANGLE
        )
        moved_signal = replace(moved_signal, pose=() if is_same else pose)
        resolved.append(WrittenSignal(written.id, first.road, moved_signal, written.turned))
    return resolved


def _pose(road: ModelRoad, signal: RoadSignal, turned: float) -> tuple[float, float, float, float]:
    x, y, z = (float(v) for v in road.place(signal.s, signal.t)[0])
    heading = float(road.curve.at(signal.s)[0, 2]) + turned
    heading += 0.0 if signal.orientation == "-" else math.pi
    return x, y, z + signal.z, wrapped(heading)


class _Ids:
    """Numbers for ids: those of the file if they are unused whole numbers, else new ones."""

    def __init__(self, texts: Iterable[str]) -> None:
        self.free = 1 + max((k for k in map(id_number, texts) if k is not None), default=0)
        self.used: set[int] = set()

    def assign(self, text: str) -> int:
        number = id_number(text)
        if number is None or number in self.used:
            number = self.free
            self.free += 1
        self.used.add(number)
        return number


def with_model_ids(
    roads: Mapping[str, ModelRoad],
    areas: Sequence[WrittenArea],
    signals: Sequence[WrittenSignal],
    programs: Mapping[str, Program],
    junctions: Mapping[str, tuple[int, ...]],
    log: Log,
    *,
    dropped: Collection[str] = (),
) -> tuple[tuple[RoadArea, ...], tuple[RoadSignal, ...], tuple[SignalController, ...]]:
    """Return areas, signals and controllers with ids of the lane model.

    Controllers lose missing signals, with a remark unless these were ``dropped``.

    Args:
        roads: id in the file -> road.
        areas: areas as written.
        signals: signals as written, on the roads that they apply to.
        programs: id in the file -> controller.
        junctions: controller -> junctions that refer to it.
        log: remarks on the file.
        dropped: ids of signals that were dropped with their roads.
    """
    ids = _Ids([*(s.id for s in signals), *programs, *(a.id for a in areas)])
    number: dict[str, int] = {}
    program_of = {signal: p.name for p in programs.values() for signal in p.signals}
    result = []
    for written in signals:
        spot = log.at(f"road {written.road}, signal {written.id}")
        if written.id in number:
            if written.id in program_of:
                spot.drop("is there twice, and is switched by a controller: the first one is used")
                continue
            spot.remark("signals of the same id: they are numbered")
        number[written.id] = ids.assign(written.id)
        result.append(
            replace(
                written.signal,
                id=number[written.id],
                road=roads[written.road].id,
                program=program_of.get(written.id, ""),
            )
        )
    controllers: dict[object, SignalController] = {}
    for key, program in programs.items():
        spot = log.at(f"controller {key}")
        for signal in program.signals:
            if signal not in number and signal not in dropped:
                spot.drop(f"switches signal {signal}, which does not exist")
        switched = tuple(number[signal] for signal in program.signals if signal in number)
        if program.signals and not switched:
            continue
        # A program written by UrbanTwin for CARLA is split into stages of one name.
        stage: object = (program.name, program.offset, program.phases) if program.phases else key
        if stage in controllers:
            existing = controllers[stage]
            all_signals = tuple(sorted({*existing.signals, *switched}))
            controllers[stage] = replace(existing, signals=all_signals)
            continue
        controllers[stage] = SignalController(
            ids.assign(key),
            program.name,
            switched,
            junctions.get(key, ()),
            program.offset,
            program.phases,
        )
    for key in junctions:
        if key not in programs:
            log.at(f"controller {key}").remark("controllers of junctions that do not exist")
    numbered = (replace(a.area, id=ids.assign(a.id), road=roads[a.road].id) for a in areas)
    return tuple(numbered), tuple(result), tuple(controllers.values())
