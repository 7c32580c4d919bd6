"""Counts of bicycles by movement, since they share the discharge of queues on lanes with cars."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.calibration.elsewhere import counted_elsewhere
from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.parameters import count_rows
from urbantwin.traffic.calibration.passages import JunctionLinks, SeenTrack, passages_of

__all__ = ["bicycle_counts"]

_BICYCLE = ("bicycle",)
#: Least number of bicycles for counts; and least share of them that must be counted, since counts
#: replace all bicycles.
_MIN_BICYCLES, _MIN_COUNTED_SHARE = 5, 0.9


def bicycle_counts(
    part: Measured, tracks: Sequence[SeenTrack], roads: RoadNetwork, links: JunctionLinks
) -> list[dict[str, Any]]:
    """Return rows of ``traffic.counts`` of bicycles; empty if too few of them were counted.

    Args:
        part: measurement of the part that is fitted to, which begins the recording.
        tracks: tracks of the whole recording.
        roads: the lanes.
        links: the movements over the main junction.
    """
    recorded = part.new.get("bicycle", 0)
    mapped = {(lane.rpartition("_")[0], leaving) for lane, leaving in links.ways.values()}
    passages = [
        passage
        for passage in passages_of(tracks, roads, links, _BICYCLE)
        if (passage.approach, passage.leaving) in mapped
    ]
    elsewhere = counted_elsewhere(tracks, roads, links.junction, _BICYCLE)
    turns = {
        (passage.approach, passage.leaving)
        for passage in passages
        if np.nan_to_num(passage.passed_s, nan=passage.seen.time_s[0]) < part.seconds
    }
    begun = {
        passage.seen.track.name
        for passage in passages
        if 0.5 < passage.seen.time_s[0] < part.seconds
    }
    counted = len(begun) + elsewhere.besides(passages, part.seconds)
    if recorded < _MIN_BICYCLES or counted < _MIN_COUNTED_SHARE * recorded:
        return []
    return count_rows(turns, passages, (0.0, part.seconds), elsewhere, _BICYCLE)
