"""Lane sections that are too short to be anything, left out with their links kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from urbantwin.roads.model import LaneSection

__all__ = ["without_slivers"]

#: Lane sections shorter than this are left out, metres: tools leave some of a tenth of a
#: millimetre where they cut roads.
SLIVER_M = 1e-3


def without_slivers(sections: Sequence[LaneSection], length: float) -> list[LaneSection]:
    """Return lane sections without the shortest ones; lanes go on over them.

    Args:
        sections: lane sections in order, links as written.
        length: length of the road.
    """
    kept = list(sections)
    k = 0
    while len(kept) > 1 and k < len(kept):
        end = kept[k + 1].s if k + 1 < len(kept) else length
        if end - kept[k].s >= SLIVER_M:
            k += 1
            continue
        sliver = kept.pop(k)
        if k > 0:
            kept[k - 1] = _relinked(kept[k - 1], "successor", sliver)
        if k < len(kept):
            start = 0.0 if k == 0 else kept[k].s
            kept[k] = replace(_relinked(kept[k], "predecessor", sliver), s=start)
        k = max(k - 1, 0)
    return kept


def _relinked(section: LaneSection, tag: str, sliver: LaneSection) -> LaneSection:
    """Return a section whose links lead to what the lanes of a sliver lead to."""
    through = {lane.id: getattr(lane, tag) for lane in sliver.lanes}
    lanes = tuple(
        replace(
            lane,
            predecessor=_beyond(lane.predecessor, through)
            if tag == "predecessor"
            else lane.predecessor,
            successor=_beyond(lane.successor, through) if tag == "successor" else lane.successor,
        )
        for lane in section.lanes
    )
    return replace(section, lanes=lanes)


def _beyond(lane: int | None, through: dict[int, int | None]) -> int | None:
    # A lane that the sliver does not have is left as it is, to be told of.
    return lane if lane is None else through.get(lane, lane)
