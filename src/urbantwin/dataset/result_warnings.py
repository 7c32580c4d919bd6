"""What is wrong with a dataset that was recorded, from what its frames hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from urbantwin.result_warning import ResultWarning

__all__ = ["warnings_of_record"]

#: Least share of the boxes in reach that have points, where nothing is said, and fewest actors
#: that say anything: of two at the end of a street it is chance.
ENOUGH, FEW = 0.5, 4
#: Why boxes do not count: the sensors are not meant to see them.
BEYOND = ("outside", "far")


def warnings_of_record(entries: Sequence[Mapping[str, Any]]) -> Iterator[ResultWarning]:
    """Yield what is wrong with a dataset.

    Args:
        entries: what ``layout.write_frame`` returned of each frame.
    """
    empty = sum(not entry["points"] for entry in entries)
    if empty:
        yield ResultWarning(
            "points", f"{empty} of {len(entries)} frames have none", "the sensors saw nothing"
        )
    boxes = [box for entry in entries for box in entry["boxes"] if box["ignored"] not in BEYOND]
    few: dict[str, float] = {}
    unseen: list[Mapping[str, Any]] = []
    for kind in sorted({box["class"] for box in boxes}):
        mine = [box for box in boxes if box["class"] == kind]
        empty_ones = [box for box in mine if not box["num_points"]]
        actors = {box["track"] for box in mine}
        if len(actors) >= FEW and len(empty_ones) > (1 - ENOUGH) * len(mine):
            few[kind] = 1 - len(empty_ones) / len(mine)
            unseen += empty_ones
    if few:
        yield ResultWarning(
            "objects",
            "of those in reach few have points: "
            + ", ".join(f"{share:.0%} of {kind} boxes" for kind, share in few.items()),
            _reason(unseen),
            "move the sensors, or add one: urbantwin coverage shows what they see",
        )
    if not boxes:
        yield ResultWarning(
            "objects",
            "no actor is ever within the region and in reach of a sensor",
            "",
            "a longer motion (traffic.duration_s), or more traffic",
        )


def _reason(unseen: Sequence[Mapping[str, Any]]) -> str:
    """Return why most of the boxes without points have none."""
    hidden = sum(box["num_points_alone"] > 0 for box in unseen)
    if 2 * hidden >= len(unseen):
        return "most of the others stand behind something"
    return "most of the others are too far away for the beams, or beside them"
