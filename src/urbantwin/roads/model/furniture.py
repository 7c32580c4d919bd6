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

#: Markings of crossings: stripes, two lines, two broken lines, two rows of studs, none.
CROSSING_MARKINGS = ("zebra", "lines", "dashes", "dots", "none")
#: Name of painted areas in the middle of mini-roundabouts.
MINI_ROUNDABOUT = "MiniRoundabout"
#: A phase of a fixed-time program: duration in seconds, and a state with one character per link, in
#: SUMO's notation.
Phase = tuple[float, str]


@dataclass(frozen=True)
class RoadArea:
    """An area on a road: a crosswalk, a stop line, a traffic island.

    Attributes:
        id: unique among areas, signals and controllers.
        road: id of the road that it belongs to.
        kind: OpenDRIVE object type: crosswalk, roadMark, trafficIsland.
        name: ``crosswalk``, ``StopLine``, ...
        s: station of its origin, on the reference line, metres.
        corners: (N, 3) outline relative to the origin, in the road's frame: ahead, left, up,
            metres; not closed.
        height: height above the carriageway, metres.
        strip: id of the crossing in ``RoadNetwork``; empty for other areas.
        marking: marking of a crosswalk, as ``Lane.marking``; empty if unknown.
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
        id: unique among areas, signals and controllers.
        road: id of the road that it applies to.
        name: readable name.
        dynamic: whether its state changes (traffic lights).
        country, type, subtype: number in a catalogue (``OpenDRIVE`` or an ISO 3166 code).
        value, unit: value of a sign (``50``, ``km/h``); nan and empty if it has none.
        s, t: position in the road's coordinates, metres.
        z: height of its centre above the road, metres.
        orientation: direction of the traffic that it applies to: ``+``, ``-`` or ``none``.
        lanes: ids of the lanes that it applies to; empty for all.
        program: id of its signal program; empty for signs.
        links: indices of its links in the program's states.
        strip: ids of the strips that it applies to, separated by spaces; empty if unknown.
        height: height of its lights or plate, metres.
        width: width of its lights or plate, metres.
        pose: position if it is not at ``s``, ``t``, such as beyond the junction: x, y, z of its
            centre, metres, and the heading that it faces, radians, site frame; else empty.
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
    """A controller that switches a group of signals.

    Attributes:
        id: unique among areas, signals and controllers.
        name: id of the signal program.
        signals: ids of its signals.
        junctions: ids of the junctions of its signals.
        offset: delay of the program's start, seconds.
        phases: its fixed-time program; empty if unknown.
    """

    id: int
    name: str
    signals: tuple[int, ...]
    junctions: tuple[int, ...]
    offset: float = 0.0
    phases: tuple[Phase, ...] = ()
