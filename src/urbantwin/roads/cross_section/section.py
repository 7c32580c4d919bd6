"""Cross sections: the lanes of both directions and the roadsides."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

__all__ = ["CarriagewayLane", "CrossSection", "Parking", "Roadside"]


@dataclass(frozen=True)
class CarriagewayLane:
    """A traffic lane.

    Attributes:
        kind: driving, bus, bicycle, or none (closed to all).
        width: metres.
        speed: limit, m/s.
        allowed: classes of actors that may use it.
        turns: turns of its arrows, as in OpenStreetMap; empty for no arrow.
        track: whether it is a cycle track separate from the carriageway.
        both_ways: whether both directions share it, such as a middle turn lane.
        listed: whether tags with a value per lane (``turn:lanes``) count it.
        assumed: whether its width is a default.
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
        width: depth from the carriageway to the curb, metres.
        position: lane, street_side, on_kerb, half_on_kerb or shoulder.
    """

    orientation: str
    width: float
    position: str


@dataclass(frozen=True)
class Roadside:
    """Roadside beyond the outermost lane; widths in metres, 0 if absent."""

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
        left, right: roadsides, as seen along the way.
        one_lane: whether both directions share the innermost lane; ``forward`` and ``backward``
            then begin with one half of it each.
        middle: offset of the middle of the road to the left of the mapped line at the way's start
            and end, metres; ``None`` if the tags leave it open. The middle is the border between
            both directions; on a one-way road, the inner border of its lanes.
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
        """Return the roadside of one direction."""
        return self.left if forward == (self.driving_side == "left") else self.right

    @cached_property
    def width(self) -> float:
        """Width of the carriageway including cycle lanes, without tracks and parking, metres."""
        lanes = (*self.forward, *self.backward)
        return sum(lane.width for lane in lanes if not lane.track)
