"""Lane sections: the lanes of a road side by side, with widths that vary along it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

from urbantwin.roads.model.profile import Profile

__all__ = [
    "CURB_HEIGHT_M",
    "LANE_KINDS",
    "RAISED_KINDS",
    "LaneSection",
    "SectionLane",
    "turned_round",
]

#: Kinds of lanes. Lanes of connecting roads have the kind of the traffic on them.
LANE_KINDS = (
    "driving",
    "bus",
    "bicycle",
    "parking",
    "shoulder",
    "sidewalk",
    "curb",
    "median",
    "island",
    "none",
)
#: Height of curbs, sidewalks, medians and islands above the carriageway, metres (AASHTO Green Book:
#: vertical curbs 0.10 to 0.20 m).
CURB_HEIGHT_M = 0.15
#: Kinds of lanes that are raised above the carriageway.
RAISED_KINDS = ("sidewalk", "curb", "median", "island")


@dataclass(frozen=True)
class SectionLane:
    """One lane within one lane section.

    Attributes:
        id: negative to the right of the reference line, positive to its left, counted outwards from
            1; never 0 (ASAM OpenDRIVE 1.8, 11.2).
        kind: one of ``LANE_KINDS``.
        width: metres, over the distance from the start of the section.
        forward: whether traffic runs along the reference line.
        speed_limit: m/s; 0 for lanes without traffic.
        allowed: classes of actors that may use it.
        strip: id of the lane in the SUMO network and in ``RoadNetwork``; empty if it has none yet.
            Consecutive sections of one road share it where the lane continues.
        predecessor: id of the preceding lane, in the section before or in the linked road; ``None``
            at a junction or if there is none.
        successor: the same at the section's end.
        height: height above the carriageway, metres.
        mark: line on its outer border, in OpenDRIVE's terms: none, solid, broken, curb, ...
        change: lane changes permitted over that line: none, both, increase, decrease.
        parking: orientation of vehicles on a parking lane: parallel, diagonal or perpendicular;
            empty if unknown. Lanes less than 3.5 m wide always have parallel parking.
        opposite: on a lane that both directions share, the strip of the direction opposite to
            ``forward``; else empty.
    """

    id: int
    kind: str
    width: Profile
    forward: bool
    speed_limit: float = 0.0
    allowed: tuple[str, ...] = ()
    strip: str = ""
    predecessor: int | None = None
    successor: int | None = None
    height: float = 0.0
    mark: str = "none"
    change: str = "none"
    parking: str = ""
    opposite: str = ""


def turned_round(lane: SectionLane) -> SectionLane:
    """Return a lane that both directions share as seen in the opposite direction."""
    return replace(lane, strip=lane.opposite, opposite=lane.strip, forward=not lane.forward)


@dataclass(frozen=True)
class LaneSection:
    """The lanes of a road from station ``s`` to the next section.

    Attributes:
        s: start of the section, metres along the reference line.
        lanes: from left to right.
        centre_mark: line on the reference line itself.
        centre_change: lane changes permitted over that line.
    """

    s: float
    lanes: tuple[SectionLane, ...]
    centre_mark: str = "none"
    centre_change: str = "none"

    @cached_property
    def by_id(self) -> dict[int, SectionLane]:
        """Lanes by id."""
        return {lane.id: lane for lane in self.lanes}

    @cached_property
    def directed(self) -> tuple[SectionLane, ...]:
        """Lanes by direction: a lane that both directions share occurs once for each of them."""
        return tuple(
            directed_lane
            for lane in self.lanes
            for directed_lane in ((lane, turned_round(lane)) if lane.opposite else (lane,))
        )

    def inwards(self, lane: SectionLane) -> Iterable[SectionLane]:
        """Return the lanes between a lane and the reference line, from the line outwards."""
        step = 1 if lane.id > 0 else -1
        return (self.by_id[k] for k in range(step, lane.id, step))
