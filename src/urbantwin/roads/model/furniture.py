"""Objects and signals of roads: crosswalks, stop lines, islands, signals, signs."""

from __future__ import annotations

from dataclasses import dataclass

from urbantwin.artefact.typed_document import Said, Triples

__all__ = [
    "CROSSING_MARKINGS",
    "MINI_ROUNDABOUT",
    "Phase",
    "RoadArea",
    "RoadSignal",
    "SignalController",
]

#: What crossings are marked with: stripes, two lines, two broken lines, two rows of studs, nothing.
CROSSING_MARKINGS = ("zebra", "lines", "dashes", "dots", "none")
#: Name of areas that are painted in the middle of mini-roundabouts.
MINI_ROUNDABOUT = "MiniRoundabout"
#: A phase of a fixed-time program: seconds, and one character of state per link, as SUMO writes it.
Phase = tuple[float, str]


@dataclass(frozen=True)
class RoadArea:
    """An area on a road: a crosswalk, a stop line, a traffic island.

    Attributes:
        id: its id, unique among everything on roads.
        road: the road that it lies on.
        kind: as OpenDRIVE names it: crosswalk, roadMark, trafficIsland.
        name: ``crosswalk``, ``StopLine``, ...
        s: station of its origin, on the reference line.
        corners: (N, 3) outline in the road's frame there: ahead, left, up; not closed.
        height: how far it stands above the carriageway, metres.
        strip: id of the crossing in ``RoadNetwork``; empty for all else.
        marking: what a crosswalk is marked with, as ``Lane.marking``; empty where nobody told.
    """

    id: int
    road: int
    kind: str
    name: str
    s: float
    corners: Triples
    height: float = 0.0
    strip: str = ""
    marking: str = ""


@dataclass(frozen=True)
class RoadSignal:
    """A signal head or a sign on a road.

    Attributes:
        id: its id, unique among everything on roads.
        road: the road that it is for.
        name: for people.
        dynamic: whether it changes: a traffic light.
        country, type, subtype: its number in a catalogue (``OpenDRIVE`` or ISO 3166 code).
        value, unit: what a sign says (``50``, ``km/h``); nan and empty where nothing.
        s, t: its place.
        z: height of its middle above the road, metres.
        orientation: ``+``, ``-`` or ``none``: the traffic that it is for.
        lanes: ids of the lanes that it governs; empty for all.
        program: id of its signal program; empty for signs.
        links: what it shows: indices into the program's states.
        strip: ids of the strips that it governs, joined by spaces; empty if unknown.
        height: of its lights or its plate, metres.
        width: the same.
        pose: where it does not stand at ``s``, ``t`` but elsewhere, beyond the junction: x, y, z of
            its middle, metres, and the heading that it faces, radians, site frame; else empty.
    """

    id: int
    road: int
    name: str
    dynamic: bool
    country: str
    type: str
    subtype: str
    value: Said
    unit: str
    s: float
    t: float
    z: float
    orientation: str
    lanes: tuple[int, ...] = ()
    program: str = ""
    links: tuple[int, ...] = ()
    strip: str = ""
    height: float = 0.9
    width: float = 0.3
    pose: tuple[float, ...] = ()


@dataclass(frozen=True)
class SignalController:
    """What switches signals together.

    Attributes:
        id: its id, unique among everything on roads.
        name: id of the signal program.
        signals: ids of its signals.
        junctions: ids of the junctions where they stand.
        offset: seconds by which the program starts late.
        phases: its fixed-time program; empty where it is not known.
    """

    id: int
    name: str
    signals: tuple[int, ...]
    junctions: tuple[int, ...]
    offset: float = 0.0
    phases: tuple[Phase, ...] = ()
