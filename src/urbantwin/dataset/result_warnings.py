"""What is wrong with a dataset that was recorded, from what its frames hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.result_warning import ResultWarning
from urbantwin.traffic.result_warnings import PAST_SENSORS

__all__ = ["warnings_of_record"]

#: Least share of the boxes in reach that have points, where nothing is said, and fewest actors
#: that say anything: of two at the end of a street it is chance.
ENOUGH, FEW = 0.5, 4
#: Why boxes do not count: the sensors are not meant to see them.
BEYOND = ("outside", "far")


def warnings_of_record(
    entries: Sequence[Mapping[str, Any]], motion: Sequence[ResultWarning] = ()
) -> Iterator[ResultWarning]:
    """Yield what is wrong with a dataset.

    Args:
        entries: what ``layout.write_frame`` returned of each frame.
        motion: the warnings of the motion: where it has too little traffic past the sensors, that
            comes first, and their range is not the reason.
    """
    empty_streets = [one for one in motion if one.about == PAST_SENSORS]
    yield from empty_streets
    empty = sum(not entry["points"] for entry in entries)
    if empty:
        yield ResultWarning(
            "points", f"{empty} of {len(entries)} frames have none", "the sensors saw nothing"
        )
    boxes = _in_reach(entries)
    few: dict[str, float] = {}
    alone = [np.zeros(0, np.int32)]
    for kind in sorted(set(boxes["class"].tolist())):
        mine = boxes["class"] == kind
        nothing = mine & (boxes["num_points"] == 0)
        actors, share = np.unique(boxes["track"][mine]), nothing.sum() / mine.sum()
        if len(actors) >= FEW and share > 1 - ENOUGH:
            few[kind] = float(1 - share)
            alone.append(boxes["num_points_alone"][nothing])
    if few:
        yield ResultWarning(
            "objects",
            "of those in reach few have points: "
            + ", ".join(f"{share:.0%} of {kind} boxes" for kind, share in few.items()),
            f"{PAST_SENSORS}: {empty_streets[0].problem}"
            if empty_streets
            else _reason(np.concatenate(alone)),
            empty_streets[0].remedy
            if empty_streets
            else "move the sensors, or add one: urbantwin rig coverage shows what they see",
        )
    if not len(boxes["class"]):
        yield ResultWarning(
            "objects",
            "no actor is ever within the region and in reach of a sensor",
            "",
            "a longer motion (traffic.duration_s), or more traffic",
        )


def _in_reach(entries: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
    """Return columns of the boxes of all frames that the sensors are meant to see."""
    none: dict[str, NDArray[Any]] = {
        "class": np.zeros(0, object),
        **{name: np.zeros(0, np.int32) for name in ("track", "num_points", "num_points_alone")},
    }
    parts = {name: [values] for name, values in none.items()}
    for entry in entries:
        reached = ~np.isin(entry["boxes"]["ignored"], BEYOND)
        for name, found in parts.items():
            found.append(entry["boxes"][name][reached])
    return {name: np.concatenate(found) for name, found in parts.items()}


def _reason(alone: NDArray[Any]) -> str:
    """Return why most of the boxes without points have none, from their points if alone."""
    if 2 * (alone > 0).sum() >= len(alone):
        return "most of the others stand behind something"
    return "most of the others are too far away for the beams, or beside them"
