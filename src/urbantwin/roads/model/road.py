"""Roads of the lane model: a reference line, profiles and lane sections."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.roads.model.curve import Curve
from urbantwin.roads.model.lane_section import RAISED_KINDS, LaneSection, SectionLane
from urbantwin.roads.model.profile import Profile

__all__ = ["ModelRoad", "RoadLink", "with_lane_marks", "without_lines"]

_MOTOR = ("driving", "bus")


@dataclass(frozen=True)
class RoadLink:
    """The road or junction linked at one end of a road.

    Attributes:
        element: ``road`` or ``junction``.
        id: its id.
        contact: end of the linked road: ``start`` or ``end``; empty for a junction.
    """

    element: str
    id: int
    contact: str = ""


@dataclass(frozen=True)
class ModelRoad:
    """A street between two junctions, or a connecting road through a junction.

    The surface at station s and offset t metres to the left of the reference line has the height
    ``elevation(s) + t sin(bank(s)) - crown(s) |t|``. Its offset in plan is t cos(bank(s)) to the
    left (ASAM OpenDRIVE 1.8, 10.5).

    Attributes:
        id: unique among roads.
        name: name of the street.
        kind: class of the street as in OpenStreetMap (``residential``); empty if unknown.
        ways: ids of its OSM ways.
        junction: id of its junction; -1 for a street.
        curve: the reference line, site frame.
        offset: lane offset to the left of the reference line, metres.
        elevation: height of the reference line, metres.
        bank: superelevation, radians, positive where the left side is higher.
        crown: cross fall away from the reference line on both sides, as a fraction.
        sections: lane sections, the first at station 0.
        predecessor: link at the start.
        successor: link at the end.
        level: 0 on the ground, 1, 2, ... above other roads.
    """

    id: int
    name: str
    kind: str
    ways: tuple[int, ...]
    junction: int
    curve: Curve
    offset: Profile
    elevation: Profile
    bank: Profile
    crown: Profile
    sections: tuple[LaneSection, ...]
    predecessor: RoadLink | None = None
    successor: RoadLink | None = None
    level: int = 0

    @property
    def length(self) -> float:
        """Length of the reference line, metres."""
        return self.curve.length

    @cached_property
    def section_ends(self) -> tuple[float, ...]:
        """End station of each section, metres."""
        return (*(section.s for section in self.sections[1:]), self.length)

    def section_at(self, s: float) -> LaneSection:
        """Return the section at a station; at a boundary, the one that begins there."""
        starts = [section.s for section in self.sections]
        return self.sections[max(0, int(np.searchsorted(starts, s + 1e-9, side="right")) - 1)]

    def place(self, s: ArrayLike, t: ArrayLike) -> NDArray[np.float64]:
        """Return points (N, 3) of the surface at stations and offsets t to the left, metres."""
        s = np.atleast_1d(np.asarray(s, np.float64))
        t = np.broadcast_to(np.asarray(t, np.float64), s.shape)
        angle = self.bank.at(s)
        xy = self.curve.beside(s, t * np.cos(angle))
        z = self.elevation.at(s) + t * np.sin(angle) - self.crown.at(s) * np.abs(t)
        return np.column_stack([xy, z])

    def heights(self, s: ArrayLike, t: ArrayLike) -> NDArray[np.float64]:
        """Return heights (N,) of the surface at stations and offsets ``t`` in plan, metres."""
        s = np.atleast_1d(np.asarray(s, np.float64))
        angle = self.bank.at(s)
        across = np.asarray(t, np.float64) / np.cos(angle)
        return np.asarray(
            self.elevation.at(s) + across * np.sin(angle) - self.crown.at(s) * np.abs(across)
        )

    def border(
        self, section: LaneSection, lane: SectionLane, s: ArrayLike, *, outer: bool
    ) -> NDArray[np.float64]:
        """Return the offset t (N,) of a lane's inner or outer border at stations of its section."""
        s = np.atleast_1d(np.asarray(s, np.float64))
        between = [*section.inwards(lane), *([lane] if outer else [])]
        t = self.offset.at(s)
        sign = 1.0 if lane.id > 0 else -1.0
        for other in between:
            t = t + sign * other.width.at(s - section.s)
        return np.asarray(t)

    def middle(self, section: LaneSection, lane: SectionLane, s: ArrayLike) -> NDArray[np.float64]:
        """Return the offset t (N,) of a lane's centre line at stations of its section."""
        inner = self.border(section, lane, s, outer=False)
        return np.asarray((inner + self.border(section, lane, s, outer=True)) / 2)


def with_lane_marks(section: LaneSection) -> LaneSection:
    """Return a lane section with markings on the borders of its lanes.

    Between lanes of motor traffic in one direction the line is broken and may be crossed. Between
    lanes of different kinds it is solid; beside raised lanes there is a curb. The centre line of a
    two-way street is broken with one lane each way and solid with more (US MUTCD 3B.01, German RMS
    1).
    """
    lanes = tuple(_marked(section, lane) for lane in section.lanes)
    return replace(section, lanes=lanes, centre_mark=_centre(section), centre_change="none")


def without_lines(road: ModelRoad) -> ModelRoad:
    """Return a road without painted lane lines; curbs stay."""
    sections = []
    for section in road.sections:
        lanes = tuple(
            lane if lane.mark == "curb" else replace(lane, mark="none") for lane in section.lanes
        )
        centre = section.centre_mark if section.centre_mark == "curb" else "none"
        sections.append(replace(section, lanes=lanes, centre_mark=centre))
    return replace(road, sections=tuple(sections))


def _centre(section: LaneSection) -> str:
    inner = [section.by_id[k] for k in (1, -1) if k in section.by_id]
    if len({lane.forward for lane in section.lanes if lane.kind in _MOTOR}) == 2:
        return "solid" if sum(lane.kind in _MOTOR for lane in section.lanes) > 2 else "broken"
    if any(lane.kind in RAISED_KINDS for lane in inner):
        return "none" if len(inner) == 1 else "curb"
    return "solid"


def _marked(section: LaneSection, lane: SectionLane) -> SectionLane:
    outer = section.by_id.get(lane.id + (1 if lane.id > 0 else -1))
    raised = lane.kind in RAISED_KINDS, outer is not None and outer.kind in RAISED_KINDS
    mark, change = "solid", "none"
    if outer is None:
        mark = "none" if raised[0] else "solid"
    elif any(raised):
        mark = "none" if all(raised) else "curb"
    elif lane.kind == outer.kind == "driving" and lane.forward == outer.forward:
        mark, change = "broken", "both"
    if (mark, change) == (lane.mark, lane.change):
        return lane
    return replace(lane, mark=mark, change=change)
