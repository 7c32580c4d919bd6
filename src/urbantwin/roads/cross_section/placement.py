"""Placement: where the mapped line lies among the lanes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from urbantwin.roads.cross_section.section import CarriagewayLane

__all__ = ["MIDDLE", "centred_middle", "middle_of_road"]

#: Tag of a way whose lanes a person corrected: how far the middle lies to the left of the line at
#: its start and end, metres. No other tag keeps one curb in place while the other one moves.
MIDDLE = "urbantwin:middle"
TWO_NUMBERS = re.compile(r"(-?\d{1,3}(?:\.\d{1,4})?);(-?\d{1,3}(?:\.\d{1,4})?)")
PLACE = re.compile(r"(left_of|middle_of|right_of):(\d+)")


def middle_of_road(
    tags: Mapping[str, str],
    forward: Sequence[CarriagewayLane],
    backward: Sequence[CarriagewayLane],
    outward: int,
) -> tuple[float | None, float | None]:
    """Return how far the middle of the road lies to the left of the line, at its start and end.

    The middle is where the lanes of both directions meet; of a road of one direction the inner
    border of its lanes. Without ``placement`` the line runs along the middle of the carriageway
    (OSM wiki, "Proposal:Placement").

    Args:
        tags: the way's tags.
        forward: lanes along the way, from the middle outwards.
        backward: lanes against it.
        outward: 1 where lanes along the way lie to the left of the middle, else -1.

    Returns:
        metres; ``None`` where ``placement=transition`` leaves it to the ways before and after.
    """
    if (known := TWO_NUMBERS.fullmatch(tags.get(MIDDLE, ""))) is not None:
        return float(known[1]), float(known[2])
    usual = centred_middle(forward, backward, outward)
    ends = []
    for end in ("start", "end"):
        offset: float | None = usual
        for key, value in _values(tags, end):
            if value == "transition":
                offset = None
                break
            found = _offset(key, value, forward, backward, outward)
            if found is not None:
                offset = found
                break
        ends.append(offset)
    return ends[0], ends[1]


def _values(tags: Mapping[str, str], end: str) -> list[tuple[str, str]]:
    keys = ("placement:forward", "placement", "placement:backward")
    # placement:end and placement:start of a transition say where it leads from and to.
    return [(key, tags[full]) for key in keys for full in (f"{key}:{end}", key) if full in tags]


def centred_middle(
    forward: Sequence[CarriagewayLane], backward: Sequence[CarriagewayLane], outward: int
) -> float:
    """Return how far the middle lies left of a line along the middle of the carriageway."""
    ahead, back = (sum(x.width for x in lanes if not x.track) for lanes in (forward, backward))
    return -outward * (ahead - back) / 2


def _offset(
    key: str,
    value: str,
    forward: Sequence[CarriagewayLane],
    backward: Sequence[CarriagewayLane],
    outward: int,
) -> float | None:
    match = PLACE.fullmatch(value)
    if not match:
        return None
    number = int(match[2])
    # Lanes from left to right as seen along the way, and how far each lies left of the middle.
    ahead = list(forward) if outward < 0 else list(forward)[::-1]
    back = list(backward)[::-1] if outward < 0 else list(backward)
    if key.endswith("backward"):
        # Lanes count from the left in the direction of travel: from right to left here.
        edge = 0.0 if outward < 0 else -sum(lane.width for lane in back)
        position = _along(back[::-1], match[1], number)
        return None if position is None else -(edge + position)
    if backward and not key.endswith("forward"):
        left, right = (back, ahead) if outward < 0 else (ahead, back)
        lanes, edge = left + right, sum(lane.width for lane in left)
    else:
        lanes, edge = ahead, 0.0 if outward < 0 else sum(lane.width for lane in ahead)
    position = _along(lanes, match[1], number)
    return None if position is None else position - edge


def _along(lanes: Sequence[CarriagewayLane], word: str, number: int) -> float | None:
    """Return how far a place lies from the outer border of the first of lanes."""
    share = {"left_of": 0.0, "middle_of": 0.5}.get(word, 1.0)
    before, counted = 0.0, 0
    for lane in lanes:
        counted += lane.listed
        if lane.listed and counted == number:
            return before + lane.width * share
        before += lane.width
    return None
