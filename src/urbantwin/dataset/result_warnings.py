"""Warnings about a recorded dataset, from its frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.result_warning import ResultWarning
from urbantwin.traffic.result_warnings import PAST_SENSORS

__all__ = ["warnings_of_record"]

#: Least share of boxes in range with points, and fewest actors for a warning: with two at the end
#: of a street it is chance.
ENOUGH, FEW = 0.5, 4
#: Reasons for which sensors are not expected to see a box.
BEYOND = ("outside", "far")


def warnings_of_record(
    entries: Sequence[Mapping[str, Any]], motion: Sequence[ResultWarning] = ()
) -> Iterator[ResultWarning]:
    """Yield warnings about a dataset.

    Args:
        entries: return value of ``layout.write_frame`` for each frame.
        motion: warnings of the motion: too little traffic past the sensors comes first, and
            explains missing objects.
    """
    empty_streets = [warning for warning in motion if warning.about == PAST_SENSORS]
    yield from empty_streets
    empty = sum(not entry["points"] for entry in entries)
    if empty:
        yield ResultWarning(
            "points", f"{empty} of {len(entries)} frames have none", "the sensors saw nothing"
        )
    boxes = _in_reach(entries)
    rarely_hit: dict[str, float] = {}
    unoccluded_points = [np.zeros(0, np.int32)]
    for kind in sorted(set(boxes["class"].tolist())):
        of_kind = boxes["class"] == kind
        nothing = of_kind & (boxes["num_points"] == 0)
        actors, share = np.unique(boxes["track"][of_kind]), nothing.sum() / of_kind.sum()
        if len(actors) >= FEW and share > 1 - ENOUGH:
            rarely_hit[kind] = float(1 - share)
            unoccluded_points.append(boxes["num_points_alone"][nothing])
    if rarely_hit:
        yield ResultWarning(
            "objects",
            "of those in reach few have points: "
            + ", ".join(f"{share:.0%} of {kind} boxes" for kind, share in rarely_hit.items()),
            f"{PAST_SENSORS}: {empty_streets[0].problem}"
            if empty_streets
            else _reason(np.concatenate(unoccluded_points)),
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
    """Return columns of the boxes of all frames that the sensors are expected to see."""
    empty: dict[str, NDArray[Any]] = {
        "class": np.zeros(0, object),
        **{name: np.zeros(0, np.int32) for name in ("track", "num_points", "num_points_alone")},
    }
    parts = {name: [values] for name, values in empty.items()}
    for entry in entries:
        reached = ~np.isin(entry["boxes"]["ignored"], BEYOND)
        for name, values in parts.items():
            values.append(entry["boxes"][name][reached])
    return {name: np.concatenate(values) for name, values in parts.items()}


def _reason(alone: NDArray[Any]) -> str:
    """Return why most boxes without points have none, from their points without occlusion."""
    if 2 * (alone > 0).sum() >= len(alone):
        return "most of the others stand behind something"
    return "most of the others are too far away for the beams, or beside them"
