"""Reading signals, signs and their controllers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from lxml import etree

from urbantwin.number_text import finite_number, whole_number
from urbantwin.roads.model import ModelRoad
from urbantwin.roads.opendrive.reading.parsing import Spot

__all__ = ["Program", "Sign", "read_program", "read_signs", "read_validity"]

#: Size of a head or a sign that has none, metres.
HEIGHT_M, WIDTH_M = 0.9, 0.3
#: How far beyond its road a signal may stand, metres.
BEYOND_M = 1.0
_UNITS = ("m", "km", "ft", "mile", "m/s", "mph", "km/h", "kg", "t", "%")


@dataclass(frozen=True)
class Sign:
    """A signal or a sign; see ``RoadSignal``.

    ``turned``: how far it is turned from facing the traffic of its orientation, radians.
    """

    id: str
    name: str
    dynamic: bool
    country: str
    type: str
    subtype: str
    value: float
    unit: str
    s: float
    t: float
    z: float
    orientation: str
    lanes: tuple[int, ...]
    links: tuple[int, ...]
    height: float
    width: float
    pose: tuple[float, ...] = ()
    turned: float = 0.0


@dataclass(frozen=True)
class Program:
    """A controller; see ``SignalController``."""

    id: str
    name: str
    signals: tuple[str, ...]
    offset: float
    phases: tuple[tuple[float, str], ...]


def read_signs(item: etree._Element, road: ModelRoad, spot: Spot) -> Iterator[Sign]:
    """Yield the signals and signs of a road.

    Args:
        item: the ``<road>``.
        road: the same as far as it is read: its lanes are those that signals may hold for.
        spot: the road, for errors.
    """
    for signal in item.findall("signals/signal"):
        here = spot.within(f"signal {signal.get('id', '')}")
        with here.dropping():
            s = here.number(signal, "s")
            if not -BEYOND_M <= s <= road.length + BEYOND_M:
                here.remark("objects and signals beyond their road: they are put at its end")
            s = min(max(s, 0.0), road.length)
            height = here.number(signal, "height", 0.0)
            height = height if height > 0 else HEIGHT_M
            width = here.number(signal, "width", 0.0)
            orientation = signal.get("orientation", "none")
            yield Sign(
                id=signal.get("id", ""),
                name=signal.get("name") or "",
                dynamic=signal.get("dynamic") == "yes",
                country=signal.get("country") or "OpenDRIVE",
                type=signal.get("type") or "-1",
                subtype=signal.get("subtype") or "-1",
                value=_value(signal),
                unit=signal.get("unit") if signal.get("unit") in _UNITS else "",
                s=s,
                t=here.number(signal, "t"),
                z=here.number(signal, "zOffset", 0.0) + height / 2,
                orientation=orientation if orientation in ("+", "-") else "none",
                lanes=read_validity(signal, road, s, here),
                links=tuple(_numbers(_note(signal, "links"))),
                height=height,
                width=width if width > 0 else WIDTH_M,
                pose=_pose(signal, height, here),
                turned=here.number(signal, "hOffset", 0.0),
            )


def _pose(signal: etree._Element, height: float, spot: Spot) -> tuple[float, ...]:
    """Return where a signal stands if the file says so in its own coordinates."""
    item = signal.find("positionInertial")
    if item is None:
        return ()
    x, y, z = (spot.number(item, key) for key in "xyz")
    return x, y, z + height / 2, spot.number(item, "hdg", 0.0)


def _value(signal: etree._Element) -> float:
    """Return what a sign says; -1 without a unit means nothing (1.4)."""
    try:
        value = float(signal.get("value") or "nan")
    except ValueError:
        return math.nan
    if not math.isfinite(value) or (value == -1 and not signal.get("unit")):
        return math.nan
    return value


def read_validity(signal: etree._Element, road: ModelRoad, s: float, spot: Spot) -> tuple[int, ...]:
    """Return the lanes of a road that a signal or a reference is valid for; empty for all."""
    present = sorted(road.section_at(s).by_id)
    found: list[int] = []
    for validity in signal.findall("validity"):
        ends = sorted(spot.whole(validity, key) for key in ("fromLane", "toLane"))
        found += [k for k in present if ends[0] <= k <= ends[1]]
    return tuple(dict.fromkeys(found))


def read_program(item: etree._Element, spot: Spot) -> Program:
    """Return a controller, with its program if it is one that we wrote.

    Args:
        item: the ``<controller>``.
        spot: the controller, for errors.
    """
    phases = []
    for text in filter(None, _note(item, "phases").split(", ")):
        seconds, _, state = text.partition(" ")
        duration = finite_number(seconds)
        if duration is None or duration <= 0 or not state:
            raise spot.error(f"has the phase {text[:40]!r}", expected="seconds, a space, a state")
        phases.append((duration, state))
    offset = finite_number(_note(item, "offset") or "0")
    if offset is None:
        raise spot.error("has an offset that is not a number", expected="seconds")
    return Program(
        item.get("id", ""),
        item.get("name") or item.get("id", ""),
        tuple(dict.fromkeys(c.get("signalId", "") for c in item.findall("control"))),
        offset,
        tuple(phases),
    )


def _note(item: etree._Element, code: str) -> str:
    for note in item.findall("userData"):
        if note.get("code") == code:
            return note.get("value") or ""
    return ""


def _numbers(text: str) -> Iterator[int]:
    for word in text.split():
        number = whole_number(word)
        if number is not None and number >= 0:
            yield number
