"""Cross sections: the lanes of both directions and what lies beside them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

__all__ = ["CarriagewayLane", "CrossSection", "Parking", "Roadside"]


@dataclass(frozen=True)
class CarriagewayLane:
    """A lane that traffic follows.

    Attributes:
        kind: driving, bus, bicycle, or none (nobody may use it).
        width: metres.
        speed: limit, m/s.
        allowed: classes of actors that may use it.
        turns: turns that its arrows show, in OpenStreetMap's words; empty for no arrow.
        track: whether it is a cycle track, apart from the carriageway, and not a lane on it.
        both_ways: whether it is shared by both directions, as a middle lane for turning is.
        listed: whether tags with a value for each lane (``turn:lanes``) count it.
        assumed: whether nobody mapped how wide it is.
    """

    kind: str
    width: float
    speed: float
    allowed: tuple[str, ...]
    turns: tuple[str, ...] = ()
    track: bool = False
    both_ways: bool = False
    listed: bool = True
    assumed: bool = False


@dataclass(frozen=True)
class Parking:
    """Parking along a road.

    Attributes:
        orientation: parallel, diagonal or perpendicular.
        width: metres from the carriageway to the curb.
        position: where it is: lane, street_side, on_kerb, half_on_kerb, shoulder.
    """

    orientation: str
    width: float
    position: str


@dataclass(frozen=True)
class Roadside:
    """What lies beyond the outermost lane of one side; widths in metres, 0 where there is none."""

    parking: Parking | None = None
    shoulder: float = 0.0
    sidewalk: float = 0.0


@dataclass(frozen=True)
class CrossSection:
    """A road's lanes according to its tags.

    Attributes:
        driving_side: ``right`` or ``left``.
        kind: value of ``highway``.
        forward: lanes along the way, from the middle of the road outwards.
        backward: lanes against it, from the middle outwards.
        left, right: what lies beside the lanes, as seen along the way.
        one_lane: whether both directions share the innermost lane: ``forward`` and ``backward``
            begin with one half of it each.
        middle: how far the middle of the road (where forward and backward lanes meet; for a road
            of one direction the inner border of its lanes) lies to the left of the mapped line,
            metres, at the way's start and end; ``None`` where the tags leave that open.
    """

    driving_side: str
    kind: str
    forward: tuple[CarriagewayLane, ...]
    backward: tuple[CarriagewayLane, ...]
    left: Roadside
    right: Roadside
    middle: tuple[float | None, float | None]
    one_lane: bool = False

    @property
    def outward(self) -> int:
        """1 where lanes along the way lie to the left of the middle, -1 to its right."""
        return 1 if self.driving_side == "left" else -1

    def lanes(self, *, forward: bool) -> tuple[CarriagewayLane, ...]:
        """Return the lanes of one direction."""
        return self.forward if forward else self.backward

    def side(self, *, forward: bool) -> Roadside:
        """Return what lies beyond the lanes of one direction."""
        return self.left if forward == (self.driving_side == "left") else self.right

    @cached_property
    def width(self) -> float:
        """Width of the carriageway, cycle lanes included, tracks and parking not, metres."""
        lanes = (*self.forward, *self.backward)
        return sum(lane.width for lane in lanes if not lane.track)
